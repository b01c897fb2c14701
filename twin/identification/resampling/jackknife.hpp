#pragma once

#include <optional>
#include <span>

#include <Eigen/Dense>

namespace tribotwin::twin::identification {

/// How the solution of a least-squares problem varies, whose rows come in groups with independent errors: the jackknife
/// that leaves out one group at a time (Efron 1982). It holds whatever the errors within a group are: correlated,
/// of unequal size, those of a model that does not fit.
struct Jackknife {
  Eigen::VectorXd variance;
  Eigen::VectorXd freedom;  ///< degrees of freedom of each variance, >= 1: fewer where few groups decide
};

/// `normal`: of each group [columns, right-hand side]^T [columns, right-hand side], at least two that are not 0. None
/// where the other groups do not determine the solution without one of them.
std::optional<Jackknife> jackknife(std::span<const Eigen::MatrixXd> normal);

/// The same for instrumental variables, `moments`: of each group [instruments, 0]^T [columns, right-hand side].
std::optional<Jackknife> jackknife_of_instruments(std::span<const Eigen::MatrixXd> moments);

/// Variances `known` of correlated, unequal errors as multiples of those that `information` gives, each drawn towards
/// the median multiple as if that had ten degrees of freedom (Smyth 2004): a variance from few groups is known poorly.
Jackknife moderated(const Jackknife& known, const Eigen::VectorXd& of_information);

}  // namespace tribotwin::twin::identification
