#include <algorithm>
#include <cmath>

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/separable.hpp>
#include <tribotwin/twin/identification/dynamic_friction/prediction_error.hpp>
#include <tribotwin/twin/numerics/correlation.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Wide enough that the number of substeps of a simulation, which may change, has no visible effect.
constexpr double difference = 1e-4;

MatrixXd open_basis(const Simulated& model, const MatrixXd& basis) {
  std::vector<Index> open;
  for (std::size_t i = 0; i < model.linear_free.size(); ++i)
    if (model.linear_free[i]) open.push_back(static_cast<Index>(i));
  return basis(Eigen::all, open);
}

std::vector<Index> free_numbers(const Simulated& model) {
  std::vector<Index> open;
  for (Index i = 0; i < model.low.size(); ++i)
    if (model.low(i) < model.high(i)) open.push_back(i);
  return open;
}

/// d prediction / d nonlinear of the free numbers, at fixed linear ones; differences stay within the bounds.
MatrixXd by_nonlinear(const Simulated& model, const VectorXd& at, const VectorXd& linear) {
  const std::vector<Index> open = free_numbers(model);
  MatrixXd D(model.measured.size(), static_cast<Index>(open.size()));
  in_parallel(open.size(), model.threads, [&](std::size_t k) {
    const Index i = open[k];
    VectorXd up = at, down = at;
    up(i) = std::min(at(i) + difference, model.high(i));
    down(i) = std::max(at(i) - difference, model.low(i));
    const Prediction a = model.predict(up), b = model.predict(down);
    D.col(static_cast<Index>(k)) = (a.known - b.known + (a.basis - b.basis) * linear) / (up(i) - down(i));
  });
  return D;
}

class Residual final : public ceres::CostFunction {
 public:
  Residual(const Simulated& model, VectorXd start, double scale)
      : model_(model), start_(std::move(start)), open_(free_numbers(model)), scale_(scale) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(open_.size()));
    set_num_residuals(static_cast<int>(model.measured.size()));
  }
  VectorXd full(const double* x) const {
    VectorXd all = start_;
    for (std::size_t k = 0; k < open_.size(); ++k) all(open_[k]) = x[k];
    return all;
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const VectorXd at = full(parameters[0]);
    const Simulation now = simulate(model_, at);
    if (!std::isfinite(now.cost)) return false;
    Eigen::Map<VectorXd>(residuals, now.residual.size()) = now.residual * scale_;
    if (!jacobians || !jacobians[0]) return true;
    MatrixXd D = by_nonlinear(model_, at, now.linear);
    // A linear number at its bound stays there.
    const MatrixXd B = open_basis(model_, model_.predict(at).basis);
    if (now.linear.size() != 1 || now.linear(0) > model_.linear_low)
      D -= B * (pseudo_inverse(B.transpose() * B) * (B.transpose() * D));
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(jacobians[0], D.rows(),
                                                                                       D.cols()) = -scale_ * D;
    return true;
  }

 private:
  const Simulated& model_;
  const VectorXd start_;
  const std::vector<Index> open_;
  const double scale_;
};

}  // namespace

Simulation simulate(const Simulated& model, const VectorXd& nonlinear) {
  const Prediction p = model.predict(nonlinear);
  Simulation s{.nonlinear = nonlinear, .linear = VectorXd::Zero(p.basis.cols()), .residual = model.measured - p.known};
  const MatrixXd B = open_basis(model, p.basis);
  const VectorXd found = (pseudo_inverse(B.transpose() * B) * (B.transpose() * s.residual)).cwiseMax(model.linear_low);
  for (Index i = 0, k = 0; i < s.linear.size(); ++i)
    if (model.linear_free[static_cast<std::size_t>(i)]) s.linear(i) = found(k++);
  s.residual -= p.basis * s.linear;
  s.cost = s.residual.squaredNorm();
  return s;
}

namespace {

/// From a start nearby, until a step gains less than `tolerance` of the cost.
Simulation descend(const Simulated& model, const VectorXd& start, double tolerance) {
  const std::vector<Index> open = free_numbers(model);
  const Simulation first = simulate(model, start);
  const double size = static_cast<double>(model.measured.size());
  if (open.empty() || first.cost <= 1e-26 * model.measured.squaredNorm()) return first;
  VectorXd x = start(open);
  // Costs in units of the noise, so that Ceres' absolute tolerances mean something.
  auto* residual = new Residual(model, start, std::sqrt(size / first.cost));
  ceres::Problem problem;
  problem.AddResidualBlock(residual, nullptr, x.data());
  for (std::size_t k = 0; k < open.size(); ++k) {
    problem.SetParameterLowerBound(x.data(), static_cast<int>(k), model.low(open[k]));
    problem.SetParameterUpperBound(x.data(), static_cast<int>(k), model.high(open[k]));
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 60;
  options.function_tolerance = tolerance;
  options.parameter_tolerance = 1e-10;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return simulate(model, residual->full(x.data()));
}

}  // namespace

Simulation search(const Simulated& few, const Simulated& all, const std::vector<VectorXd>& starts) {
  constexpr std::size_t followed = 4;
  constexpr double rough = 1e-3;
  std::vector<std::pair<double, std::size_t>> tried(starts.size());
  in_parallel(starts.size(), all.threads, [&](std::size_t i) { tried[i] = {simulate(few, starts[i]).cost, i}; });
  std::ranges::sort(tried);
  Simulation best = simulate(few, starts[tried[0].second]);
  for (std::size_t i = 0; i < std::min(followed, tried.size()); ++i)
    if (Simulation found = descend(few, starts[tried[i].second], rough); found.cost < best.cost)
      best = std::move(found);
  return descend(all, best.nonlinear, 1e-5 / static_cast<double>(all.measured.size()));  // a few thousandths of a sigma
}

namespace {

/// Derivatives of the prediction by all numbers; 0 for fixed ones.
MatrixXd sensitivity(const Simulated& model, const Simulation& minimum) {
  const Index linear = minimum.linear.size();
  MatrixXd S = MatrixXd::Zero(model.measured.size(), linear + minimum.nonlinear.size());
  S.leftCols(linear) = model.predict(minimum.nonlinear).basis;
  const MatrixXd D = by_nonlinear(model, minimum.nonlinear, minimum.linear);
  const std::vector<Index> open = free_numbers(model);
  for (std::size_t k = 0; k < open.size(); ++k) S.col(linear + open[k]) = D.col(static_cast<Index>(k));
  return S;
}

/// Status of number i, dependence aside.
Status status_of(const Simulated& model, const Simulation& minimum, Index i) {
  const Index linear = minimum.linear.size();
  if (i < linear) {
    if (!model.linear_free[static_cast<std::size_t>(i)]) return Status::held;
    return minimum.linear(i) <= model.linear_low ? Status::at_bound : Status::estimated;
  }
  const double low = model.low(i - linear), high = model.high(i - linear), value = minimum.nonlinear(i - linear);
  if (low == high) return Status::held;
  return value <= low || value >= high ? Status::at_bound : Status::estimated;
}

double condition_number(const MatrixXd& H) {
  const VectorXd unit = H.diagonal().cwiseSqrt().cwiseInverse();
  const VectorXd eigenvalues = symmetric_eigenvalues(unit.asDiagonal() * H * unit.asDiagonal());
  return std::sqrt(eigenvalues.maxCoeff() / std::max(eigenvalues.minCoeff(), 1e-300));
}

}  // namespace

Uncertainty uncertainty(const Simulated& model, const Simulation& minimum) {
  const MatrixXd S = sensitivity(model, minimum);
  const MatrixXd H = S.transpose() * S;
  const Index count = H.rows();
  const auto rows = static_cast<double>(model.measured.size());
  Uncertainty result{.covariance = MatrixXd::Constant(count, count, std::nan("")), .status = {}, .effect = {}};
  for (Index i = 0; i < count; ++i) result.effect.push_back(std::sqrt(H(i, i) / rows));
  // Cholesky in the given order: a vanishing pivot belongs to a column in the span of those before it.
  std::vector<Index> kept;
  for (Index i = 0; i < count; ++i) {
    Status& status = result.status.emplace_back(status_of(model, minimum, i));
    if (status != Status::estimated) continue;
    const MatrixXd among = H(kept, kept);
    const VectorXd with = H(kept, i);
    if (H(i, i) - (kept.empty() ? 0 : with.dot(pseudo_inverse(among) * with)) > 1e-10 * H(i, i))
      kept.push_back(i);
    else
      status = Status::held;
  }
  const MatrixXd open_H = H(kept, kept);
  const std::vector<double> r(minimum.residual.begin(), minimum.residual.end());
  const double freedom = std::max(1.0, rows - static_cast<double>(kept.size()));
  result.correlated = samples_per_independent(r);
  const MatrixXd inverse = pseudo_inverse(open_H) * (minimum.cost / freedom * result.correlated);
  result.covariance(kept, kept) = inverse;
  if (!kept.empty()) result.condition_number = condition_number(open_H);
  return result;
}

namespace {

/// Sigmas and intervals from the covariance.
void conclude_parameters(Estimates& result) {
  constexpr double quantile = 1.959964, nan = std::numeric_limits<double>::quiet_NaN();  // long series: normal
  for (std::size_t i = 0; i < result.parameters.size(); ++i) {
    Estimate& e = result.parameters[i];
    const auto k = static_cast<Index>(i);
    if (e.status != Status::estimated) {
      result.covariance.row(k).setConstant(nan), result.covariance.col(k).setConstant(nan);
      e.sigma = e.low = e.high = nan;
      if (e.status != Status::held)
        result.notes.push_back(fmt::format(
            "{} = {:.6g} is at the edge of its range; the sigmas of the others hold only if that is its value", e.name,
            e.value));
      continue;
    }
    ++result.estimated;
    e.sigma = std::sqrt(std::max(0.0, result.covariance(k, k)));
    e.low = e.value - quantile * e.sigma;
    e.high = e.value + quantile * e.sigma;
  }
}

}  // namespace

void conclude(const Simulated& model, const Simulation& minimum, const Uncertainty& uncertainty, const MatrixXd& to,
              Evidence evidence, const Advice& advice, Estimates& result) {
  result.condition_number = uncertainty.condition_number;
  result.covariance =
      to * uncertainty.covariance.unaryExpr([](double c) { return std::isnan(c) ? 0 : c; }) * to.transpose();
  conclude_parameters(result);
  evidence.parameters = result.parameters;
  evidence.covariance = result.covariance;
  result.lacking = lacking(evidence, advice);
  result.unidentifiable = withheld(result.lacking);
  const VectorXd& r = minimum.residual;
  const auto n = static_cast<double>(r.size()), p = static_cast<double>(result.estimated) + 1;  // with the variance
  result.samples = static_cast<std::size_t>(r.size());
  result.cost = minimum.cost;
  result.residual.mean = r.mean();
  result.residual.std = std::sqrt((r.array() - r.mean()).square().mean());
  result.residual.max_abs = r.cwiseAbs().maxCoeff();
  result.r_squared = 1 - minimum.cost / (model.measured.array() - model.measured.mean()).square().sum();
  result.aicc = n * std::log(std::max(minimum.cost, 1e-300) / n) + 2 * p + 2 * p * (p + 1) / std::max(1.0, n - p - 1);
  if (uncertainty.correlated > 3)
    result.notes.push_back(
        fmt::format("errors are correlated over some {:.0f} successive samples, which the sigmas include: the model "
                    "does not follow these data, or the torque was filtered",
                    uncertainty.correlated));
  if (std::abs(result.residual.mean) > 0.2 * result.residual.std)
    result.notes.push_back(
        fmt::format("the mean error is {:.3g} Nm: a sensor may have an offset", result.residual.mean));
  if (1 - result.r_squared > 1e-3 && uncertainty.correlated > 3)
    result.notes.push_back(
        fmt::format("normalised MSE {:.2g}: the model does not describe these data well", 1 - result.r_squared));
}

}  // namespace tribotwin::twin::identification
