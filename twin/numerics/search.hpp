#pragma once

#include <functional>
#include <limits>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/numerics/inquiry.hpp>

/// Searches for the minimum of a function, which ask for its values.
namespace tribotwin::twin {

/// Slope and (Gauss-Newton's) positive semidefinite curvature at a point.
struct Quadratic {
  Eigen::VectorXd gradient;
  Eigen::MatrixXd curvature;
};

struct Minimum {
  Eigen::VectorXd z;
  double objective = std::numeric_limits<double>::infinity();
  int evaluations = 0;
};

struct Trial {
  std::vector<Eigen::VectorXd> points;  ///< whose values are asked for
  double step = 0;                      ///< above 0: not the value, but the Quadratic at the only point is asked for
};
struct Tried {
  std::vector<double> values;
  Quadratic quadratic;
};
using Search = Inquiry<Trial, Tried, Minimum>;

/// Answers all questions of a search, one after the other.
Minimum answered(Search search, const std::function<double(const Eigen::VectorXd&)>& objective,
                 const std::function<Quadratic(const Eigen::VectorXd&, double step)>& quadratic = {});

}  // namespace tribotwin::twin
