#pragma once

#include <limits>
#include <memory>

#include <Eigen/Dense>
#include <ceres/ceres.h>

/// A nonlinear least-squares problem of one block of bounded parameters, for Ceres.
namespace tribotwin::twin::identification {

/// Sets x to the minimum of |residual|^2 within the bounds that is found from the start x; returns half of that
/// minimum. `options` says when to end. Returns infinity where the solver cannot begin (no unknowns, a start or
/// residual that is not finite), because Ceres would abort.
inline double least_squares(ceres::CostFunction& residual, Eigen::VectorXd& x, const Eigen::VectorXd& low,
                            const Eigen::VectorXd& high, ceres::Solver::Options options) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  if (x.size() == 0 || !x.allFinite() || !(low.array() <= high.array()).all()) return infinity;
  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  problem.AddResidualBlock(&residual, nullptr, x.data());
  for (int i = 0; i < x.size(); ++i) {
    problem.SetParameterLowerBound(x.data(), i, low(i));
    problem.SetParameterUpperBound(x.data(), i, high(i));
  }
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.IsSolutionUsable() && x.allFinite() ? summary.final_cost : infinity;
}

/// The problem of residual(x), a vector of `count`; derivatives by differences.
template <ceres::NumericDiffMethodType differences, class Residual>
std::unique_ptr<ceres::CostFunction> by_differences(Residual residual, Eigen::Index unknowns, Eigen::Index count) {
  const auto evaluate = [=](double const* const* parameters, double* out) {
    Eigen::Map<Eigen::VectorXd>(out, count) =
        residual(Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(parameters[0], unknowns)));
    return Eigen::Map<const Eigen::VectorXd>(out, count).allFinite();
  };
  auto cost = std::make_unique<ceres::DynamicNumericDiffCostFunction<decltype(evaluate), differences>>(
      new auto(evaluate));  // deleted by it
  cost->AddParameterBlock(static_cast<int>(unknowns));
  cost->SetNumResiduals(static_cast<int>(count));
  return cost;
}

}  // namespace tribotwin::twin::identification
