#include <cmath>
#include <random>

#include <fmt/format.h>

#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/triangular_factor.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

namespace tribotwin::twin {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// What remains of a unit column of R beyond those before it, where it depends on them: far above rounding (1e-14), far
/// below what a geometry of any real proportions leaves.
constexpr double dependent_below = 1e-8;
/// Torques this much smaller than the largest are no robot's: axes that are parallel or vertical but for angles of five
/// digits (1.5708, 3.1416 in a URDF) leave 1e-5 of them. No recording shows it, and a parameter that only they tell
/// would have no value but the noise.
constexpr double nothing = 2e-5;
/// Coefficients that differ from 0 or 1 by less do so for such angles, or for rounding.
constexpr double as_good_as_equal = 1e-5;

MatrixXd excited(Regressor& regressor) {
  std::mt19937_64 random(1);
  // Not std::normal_distribution: base parameters are names in files, the same on every standard library.
  const auto uniform = [&](double scale) { return scale * (2 * static_cast<double>(random() >> 11) * 0x1p-53 - 1); };
  const auto columns = static_cast<Index>(regressor.columns().size()), n = regressor.joints();
  TriangularFactor factor(columns);
  VectorXd q(n), qd(n), qdd(n);
  for (Index state = 0; state < 50 + 4 * columns / n; ++state) {
    for (Index j = 0; j < n; ++j)
      q(j) = uniform(regressor.is_slide(j) ? 1 : 3.2), qd(j) = uniform(3), qdd(j) = uniform(10);
    factor.add(regressor.at(q, qd, qdd));
  }
  return factor.R();
}

std::string group_text(const std::vector<Regressor::Column>& columns, Index leading, const VectorXd& row) {
  std::string text = columns[static_cast<std::size_t>(leading)].name;
  for (Index c = 0; c < row.size(); ++c) {
    if (c == leading || row(c) == 0) continue;
    const double size = std::abs(row(c));
    text += fmt::format(" {} {}{}", row(c) < 0 ? '-' : '+', size == 1 ? "" : fmt::format("{:.4g} ", size),
                        columns[static_cast<std::size_t>(c)].name);
  }
  return text;
}

}  // namespace

BaseParameters base_parameters(Regressor regressor) {
  const auto& columns = regressor.columns();
  MatrixXd R = excited(regressor);
  VectorXd length = R.colwise().norm();
  const double longest = length.maxCoeff();
  for (Index c = 0; c < R.cols(); ++c)
    if (length(c) > nothing * longest)
      R.col(c) /= length(c);
    else
      length(c) = 0, R.col(c).setZero();

  BaseParameters base;
  base.numerical_rank = numerical_rank(R, dependent_below);

  // Gram-Schmidt in the order of preference, twice for orthogonality to rounding.
  MatrixXd Q(R.rows(), R.cols());
  std::vector<Index> dependent;
  for (Index c = 0; c < R.cols(); ++c) {
    const auto found = static_cast<Index>(base.independent.size());
    VectorXd rest = R.col(c);
    for (int pass = 0; pass < 2; ++pass) rest -= Q.leftCols(found) * (Q.leftCols(found).transpose() * rest);
    if (rest.norm() <= std::max(dependent_below, nothing * longest / length(c))) {
      if (length(c) > 0) dependent.push_back(c);
      continue;
    }
    Q.col(found) = rest.normalized();
    base.independent.push_back(c);
  }
  const auto n = static_cast<Index>(base.independent.size());
  const MatrixXd groups = least_squares_solutions(R(Eigen::all, base.independent), R(Eigen::all, dependent));
  base.from_all = MatrixXd::Zero(n, R.cols());
  for (Index i = 0; i < n; ++i) {
    base.from_all(i, base.independent[static_cast<std::size_t>(i)]) = 1;
    for (Index k = 0; k < groups.cols(); ++k) {
      const Index c = dependent[static_cast<std::size_t>(k)];
      double x = groups(i, k);
      if (std::abs(x) * length(c) < nothing * longest || std::abs(x) < 1e-9) continue;
      x *= length(c) / length(base.independent[static_cast<std::size_t>(i)]);
      base.from_all(i, c) = std::abs(std::abs(x) - 1) < as_good_as_equal ? std::copysign(1, x) : x;
    }
    const auto& leading = columns[static_cast<std::size_t>(base.independent[static_cast<std::size_t>(i)])];
    base.parameters.push_back({leading.name,
                               group_text(columns, base.independent[static_cast<std::size_t>(i)], base.from_all.row(i)),
                               leading.unit});
  }
  return base;
}

}  // namespace tribotwin::twin
