#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Dense>

/// D-optimal choice of experiments: the volume of the confidence region of all parameters, det(information)^-1/2, small
/// (Atkinson 2007, Optimum Experimental Designs). Units of parameters have no effect on the choice.
namespace tribotwin::twin {

/// Mean over the parameters of ln sigma, as if they were independent: -ln det(information) / (2 size). Infinite where
/// the information, symmetric (lower triangle), is not positive definite.
double mean_log_sigma(const Eigen::MatrixXd& information);

struct Experiment {
  Eigen::MatrixXd information;
  double cost = 1;        ///< > 0
  std::size_t group = 0;  ///< experiments of a group share the cost of the group, paid once
};

/// Experiments, in the order of their choice and perhaps several times, of which each adds the most to
/// ln det(known + information) per cost, until none fits in the budget. `known` is positive definite. Gains never grow
/// with what is known (submodularity), so that few of them are computed anew in each step.
std::vector<std::size_t> d_optimal(const Eigen::MatrixXd& known, std::span<const Experiment> experiments,
                                   std::span<const double> group_cost, double budget);

}  // namespace tribotwin::twin
