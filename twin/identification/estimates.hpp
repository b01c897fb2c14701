#pragma once

#include <cmath>
#include <string>
#include <vector>

#include <Eigen/Dense>

namespace tribotwin::twin::identification {

enum class Status {
  estimated,
  fixed,    ///< by the user
  held,     ///< not identifiable from the data: its term is 0, or it has no effect
  at_bound  ///< of the accepted range; without a sigma
};

struct Estimate {
  std::string name, unit;
  double value = 0;
  double sigma = 0;          ///< one standard deviation; NaN unless estimated
  double low = 0, high = 0;  ///< 95 % confidence interval; NaN unless estimated
  Status status = Status::estimated;
};

/// Identified numbers with their uncertainty.
struct Estimates {
  std::vector<Estimate> parameters;
  Eigen::MatrixXd covariance;   ///< of the parameters; NaN rows where not estimated
  double condition_number = 0;  ///< of the Jacobian with unit columns, at the solution
  struct {
    double mean = 0, std = 0, max_abs = 0;
  } residual;       ///< measured - predicted
  double cost = 0;  ///< weighted sum of squares
  double r_squared = 0, aicc = 0;
  std::size_t samples = 0, estimated = 0;
  std::vector<std::string> unidentifiable;  ///< names of parameters that are not identifiable from these data
  std::vector<std::string> notes;           ///< limits of the result, for its user

  /// Between two estimated parameters, -1 .. 1.
  double correlation(std::size_t i, std::size_t j) const {
    const auto a = static_cast<Eigen::Index>(i), b = static_cast<Eigen::Index>(j);
    return covariance(a, b) / std::sqrt(covariance(a, a) * covariance(b, b));
  }
};

}  // namespace tribotwin::twin::identification
