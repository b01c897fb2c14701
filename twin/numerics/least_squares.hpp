#pragma once

#include <limits>
#include <memory>

#include <Eigen/Dense>
#include <ceres/ceres.h>

/// A nonlinear least-squares problem of one block of bounded parameters, as Ceres wants it.
namespace tribotwin::twin::identification {

/// Leaves in x the minimum of |residual|^2 that is found from there, within the bounds; returns half of it. `options`
/// says when to end. Where the solver cannot begin - no unknowns, no start or residual that is finite - it returns
/// infinity: Ceres would abort.
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

/// Of residual(x), a vector of `count`; derivatives by differences.
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
