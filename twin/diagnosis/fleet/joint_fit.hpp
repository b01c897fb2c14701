#pragma once

#include <tribotwin/twin/diagnosis/fleet/claims.hpp>

/// What the rows of one joint say in one region, under one persistence: generalised least squares with the type as
/// prior,
///   B given the rows: precision A / s + D, D = (Omega + error of the mean)^-1, A = sum of x x' of whitened rows.
namespace tribotwin::twin::diagnosis::fleet {

constexpr int regression_maximum = 6;  ///< p q
using Regression = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, regression_maximum, 1>;
using RegressionMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, regression_maximum, regression_maximum>;

/// One persistence of one region with what is needed of it for every joint.
class Choice {
 public:
  Choice(const TypeModel& type, std::size_t region, const RegionModel& model);
  const TypeModel& type;
  const RegionModel& model;
  const std::size_t region;
  const Eigen::Index p, q;
  const RegressionMatrix prior;  ///< D
  const SmallMatrix decouple;    ///< W
  const Errors errors;
  const double log_determinant;    ///< ln |det W|
  const bool lambda_is_uncertain;  ///< else its effect is not computed
};

/// What of the variance of an estimate is itself an estimate.
struct Uncertainty {
  double between = 0;    ///< share of the variance that comes from other robots and not from the joint's own scatter
  double by_lambda = 0;  ///< relative variance of the variance, as lambda is uncertain
};
/// Probability that T^2 of p numbers is exceeded on a healthy joint: all variances are estimates, the scale of the
/// joint with `scale_freedom` degrees of freedom.
double exceeded_by_chance(const RegionModel& model, double statistic, const Uncertainty& uncertainty,
                          double scale_freedom);

/// Scale s of a joint's scatter and the degrees of freedom with which it is known.
struct Scale {
  double value = 1, freedom = 1e6;
};

/// How far the mean of the recent rows is from what the healthy ones predict, in z.
struct WindowFit {
  Small shift;
  SmallMatrix covariance;
  double statistic = 0;  ///< T^2
  Uncertainty uncertainty;
};

/// Rows of one joint in its own coordinates w, less what the type expects.
class JointSeries {
 public:
  /// Both in the order of time, the recent ones after the healthy ones.
  JointSeries(const Choice& choice, const Rows& healthy, const Rows& recent);

  Scale scale() const;  ///< by the healthy rows
  /// B from the healthy rows, of z, type and joint together: component after component.
  Eigen::VectorXd baseline() const;
  /// Of at least one recent row.
  WindowFit window(const Scale& scale) const;

  struct Innovation {
    double statistic = 0, by_chance = 1;
    Uncertainty uncertainty;
    double log_variance = 0;  ///< ln |F| of the row, of y; F its covariance given all before
  };
  /// Compares one recent row after the other with all before it. In order; `learn` false: from now on without taking
  /// the compared rows for normal.
  class Follower;

 private:
  static constexpr Eigen::Index shift_column = 2, w_column = 3;  ///< of Sums; x is in the first q
  using Sums = Eigen::Matrix4d;
  /// Sums of products of whitened columns, of all rows; those of the healthy rows in `healthy`.
  Sums sums(Eigen::Index component, double lambda, Sums* healthy) const;
  struct Solved {
    RegressionMatrix covariance;  ///< of B
    Regression mean;
    Small shift;
    SmallMatrix variance, between;  ///< of the shift; the part of it that does not scale with s
  };
  Solved solve(const std::array<Sums, features_maximum>& sums, double scale) const;

  const Choice& choice_;
  const OwnCoordinates own_;
  SmallMatrix back_;        // Q^-1
  RegressionMatrix prior_;  // D of w
  std::size_t healthy_, rows_;
  std::vector<double> kept_, temperature_;  // phi^days since the row before, x(1)
  std::vector<double> w_, variance_;        // of every component and its error, row after row
};

class JointSeries::Follower {
 public:
  Follower(const JointSeries& series, const Scale& scale);
  Innovation next(bool learn);
  /// Takes T^2 of a row into the joint's own scale, so that what robots of larger scatter do next is independent of it.
  void learn_scale(double statistic);
  const Scale& scale() const { return scale_; }
  const Regression& mean() const { return mean_; }  ///< B, less what the type expects

 private:
  struct Whitened {
    double constant = 0, temperature = 0, z = 0, day_share = 0, total = 1;
  };
  Whitened whiten(Eigen::Index component, bool learn);

  const JointSeries& series_;
  const Choice& choice_;
  Scale scale_;
  std::size_t row_ = 0;
  struct Day {
    double constant = 0, temperature = 0, z = 0, variance = 0;
  };
  std::array<Day, features_maximum> day_;  // of the deviation of the day, per component and column
  Regression mean_;
  RegressionMatrix covariance_;
};

}  // namespace tribotwin::twin::diagnosis::fleet
