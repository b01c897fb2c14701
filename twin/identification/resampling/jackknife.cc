#include <tribotwin/twin/identification/resampling/jackknife.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

namespace {

using Solver = std::optional<VectorXd> (*)(const MatrixXd& A, const VectorXd& b, double singular);

std::optional<Jackknife> jackknife_by(Solver solution_of, std::span<const MatrixXd> normal) {
  constexpr double singular = 1e-12;
  const Index n = normal.front().cols() - 1;
  MatrixXd all = MatrixXd::Zero(n + 1, n + 1);
  for (const MatrixXd& N : normal) all += N;
  const VectorXd scale = all.diagonal().head(n).cwiseAbs().cwiseSqrt().cwiseInverse();
  MatrixXd solutions(n, static_cast<Index>(normal.size()));
  Index groups = 0;
  for (const MatrixXd& N : normal) {
    if (N.isZero(0)) continue;
    const MatrixXd rest = scale.asDiagonal() * (all - N).topLeftCorner(n, n) * scale.asDiagonal();
    const auto solution = solution_of(rest, scale.cwiseProduct((all - N).col(n).head(n)), singular);
    if (!solution) return std::nullopt;
    solutions.col(groups++) = scale.cwiseProduct(*solution);
  }
  if (groups < 2) return std::nullopt;
  const MatrixXd found = solutions.leftCols(groups);
  const Eigen::ArrayXXd squares = (found.colwise() - VectorXd(found.rowwise().mean())).array().square();
  const auto g = static_cast<double>(groups);
  // Of normal errors the sum of fourth powers is three times what equal ones have.
  const Eigen::ArrayXd fourth = squares.square().rowwise().sum();  // 0 of what a prior alone tells
  const Eigen::ArrayXd freedom = (fourth > 0).select(3 * squares.rowwise().sum().square() / fourth - 1, 1);
  return Jackknife{.variance = (g - 1) / g * squares.rowwise().sum(), .freedom = freedom.max(1).min(g - 1)};
}

}  // namespace

std::optional<Jackknife> jackknife(std::span<const MatrixXd> normal) {
  return jackknife_by(
      [](const MatrixXd& A, const VectorXd& b, double singular) { return symmetric_solution(A, b, singular); }, normal);
}

std::optional<Jackknife> jackknife_of_instruments(std::span<const MatrixXd> moments) {
  return jackknife_by(well_conditioned_solution, moments);
}

Jackknife moderated(const Jackknife& known, const VectorXd& of_information) {
  constexpr double common = 10;
  const Eigen::ArrayXd multiple = known.variance.cwiseQuotient(of_information), d = known.freedom;
  const double middle = median_of({multiple.begin(), multiple.end()});
  return {.variance = of_information.array() * (common * middle + d * multiple) / (common + d), .freedom = d + common};
}

}  // namespace tribotwin::twin::identification
