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

/// Why a parameter is no number, in the order of the rule of identifiability.hpp: the first that applies is reported.
enum class Lack {
  no_effect,       ///< held: the data show no effect of it
  no_whole_cycle,  ///< fewer whole work cycles than needed
  short_record,    ///< shorter than its time constant, or than the upper end of that one's interval
  at_bound,        ///< of its accepted range
  wide_interval,   ///< 95 % interval wider than the value
  correlated,      ///< correlation over 0.99 with another parameter, and an interval wider than a tenth of the value
  structured       ///< residuals are no noise: arcs along time or speed
};

struct Lacking {
  std::string parameter;
  Lack lack;
  std::string reason;    ///< "its 95 % interval, -17 .. 21 rad/s, is wider than its value"
  std::string next;      ///< what to record: "record speeds below 10 rad/s"
  bool withheld = true;  ///< no number to be shown; false: a doubt beside a number whose sigma counts it
};

/// Identified numbers with their uncertainty.
struct Estimates {
  std::vector<Estimate> parameters;
  Eigen::MatrixXd covariance;   ///< of the parameters; NaN rows where not estimated
  double condition_number = 0;  ///< of the Jacobian with unit columns, at the solution
  struct {
    double mean = 0, std = 0, max_abs = 0;
    double arcs = 0;  ///< share of their mean square that neighbours have in common, which noise has not
  } residual;         ///< measured - predicted
  double cost = 0;    ///< weighted sum of squares
  double r_squared = 0, aicc = 0;
  std::size_t samples = 0, estimated = 0;
  std::vector<Lacking> lacking;             ///< what keeps parameters from being numbers, or makes them doubtful
  std::vector<std::string> unidentifiable;  ///< names of parameters that are not identifiable from these data
  std::vector<std::string> notes;           ///< limits of the result, for its user

  /// Between two estimated parameters, -1 .. 1.
  double correlation(std::size_t i, std::size_t j) const {
    const auto a = static_cast<Eigen::Index>(i), b = static_cast<Eigen::Index>(j);
    return covariance(a, b) / std::sqrt(covariance(a, a) * covariance(b, b));
  }
};

}  // namespace tribotwin::twin::identification
