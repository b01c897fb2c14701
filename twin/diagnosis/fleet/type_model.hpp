#pragma once

#include <functional>
#include <string>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/fleet/row.hpp>

/// What is normal for one joint of all robots of a type, learned from healthy curves of many robots, so that a robot
/// with few curves borrows from the others (empirical Bayes).
///
/// Logarithmic features of a region, p numbers, of robot r at time t (days) and temperature T:
///   y = B_r' x + c T^2 + d_r(t) + e,   x = (1, T), T in units of 10 K from the middle of the learned temperatures,
///   vec B_r ~ N(mean, Omega)           between robots,
///   d_r ~ N(0, S_d), correlation phi^days   from day to day (Ornstein and Uhlenbeck),
///   e ~ N(0, v S_n)                    of the measurement, v as each fit claims it for itself,
///   S_d and S_n of robot r times s_r, 1 / s_r ~ chi^2_k / (k s)   (Smyth 2004).
/// S_n, S_d and phi from the differences of observations of one robot (variogram, Cressie 1993, 2.4), mean and Omega by
/// restricted maximum likelihood (EM, Laird 1982), k and s from the residual sums of squares.
namespace tribotwin::twin::diagnosis::fleet {

constexpr std::size_t robots_minimum = 6;  ///< from which robots borrow from each other

/// Coordinates z = W (y - c T^2), in which W S_n W' = 1 and W S_d W' = diag(lambda): the p numbers of an observation
/// are independent but for what robots have in common.
struct RegionModel {
  Eigen::MatrixXd decouple;    ///< W, p x p
  Eigen::VectorXd lambda;      ///< p, >= 0
  double persistence = 0;      ///< phi, 0 .. 1
  Eigen::VectorXd curvature;   ///< c, p
  Eigen::VectorXd mean;        ///< p q, of z: component after component
  Eigen::MatrixXd between;     ///< Omega, p q x p q, of z
  Eigen::MatrixXd mean_error;  ///< covariance of `mean`
  double between_freedom = 0;  ///< robots - 1
  double noise_freedom = 1e6;  ///< with which the scatter within robots is known
  /// Of the estimates: variance of ln lambda, and d ln s / d ln lambda of the scale s that belongs to lambda. Where
  /// measurement and day cannot be separated, their sum is known all the same.
  Eigen::VectorXd lambda_variance, scale_by_lambda;
  double persistence_variance = 0;        ///< of the logarithm of a window's variance, as phi is uncertain
  double typical_scatter = 0;             ///< v = scatter / this; 0: v = 1
  double scale = 1, scale_freedom = 1e6;  ///< s, k

  Eigen::Index features() const { return lambda.size(); }
  Eigen::Index regressors() const { return mean.size() / lambda.size(); }
};

/// What a joint is expected to do: vec B_r as in RegionModel::mean, its covariance, and the scale of its scatter.
struct JointBaseline {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  double scale = 1, freedom = 1e6;  ///< s_r given the robot's own curves
};

struct TypeModel {
  std::string type, joint;  ///< type of robot, name of the joint
  std::size_t robots = 0, observations = 0;
  double temperature_low_degC = 0, temperature_high_degC = 0;
  bool knows_temperature = false;  ///< x = (1, T) instead of 1
  std::array<RegionModel, 2> region;
  FeatureMatrix within = FeatureMatrix::Zero();  ///< covariance of one robot's logarithmic features, all temperatures
  double load_norm = std::numeric_limits<double>::quiet_NaN();  ///< mean of the healthy curves
  std::vector<std::string> notes;

  Eigen::VectorXd regressors(const Row& row) const;
  /// z of a row.
  Eigen::VectorXd decoupled(const Row& row, std::size_t region) const;
  double scatter(const Row& row, std::size_t region) const;
};

/// Standard deviations of ln Fc at the middle temperature, for people.
struct Spread {
  double between = 0, days = 0, measurement = 0;
};
Spread spread_of(const TypeModel& type);

/// Calls its argument with the rows of every robot, in the same order whenever it is called.
using EachRobot = std::function<void(const std::function<void(const Rows&)>&)>;

/// Fails with what is missing. Reads the rows several times and keeps a few hundred bytes per robot.
Result<TypeModel> learn_type(const EachRobot& each);

/// s_r from the robot's own healthy rows.
JointBaseline robot_scale(const TypeModel& type, std::size_t region, const Rows& healthy);

/// The state of a joint in one region: its regression and the deviation of the day, after any number of rows (Kalman).
class JointFilter {
 public:
  JointFilter(const TypeModel& type, std::size_t region, const JointBaseline& scale);

  struct Innovation {
    double statistic = 0;  ///< T^2 of the row given all before it
    double by_chance = 1;  ///< probability of at least this on a healthy joint
  };
  /// Compares the row with what is known so far; then, unless `learn` is false, learns from it.
  Innovation take(const Row& row, bool learn = true);
  /// Takes T^2 of a row into the joint's own scale, so that what robots of larger scatter do next is independent of it.
  void learn_scale(double statistic);
  /// From now on all numbers may have moved by an unknown amount, which is a further part of the state.
  void begin_shift();
  /// The regression alone; the shift since begin_shift(), of z.
  JointBaseline baseline() const, shift() const;

 private:
  void advance(double day);
  Eigen::MatrixXd seen(const Row& row) const;
  const TypeModel& type_;
  const std::size_t region_;
  const RegionModel& model_ = type_.region[region_];
  JointBaseline scale_;
  const Eigen::Index b_ = scale_.mean.size();  // numbers of the regression
  Eigen::VectorXd state_;                      // deviations of the day, the regression, the shift
  Eigen::MatrixXd covariance_;
  double day_ = 0;
  bool begun_ = false;
};

/// What a variance consists of; the rest is measurement.
struct Shares {
  Eigen::VectorXd day;  ///< of every component of z
  double between = 0;   ///< on average
  bool window = false;  ///< of the mean of many days; one step depends on phi about half as much
};
/// Probability that T^2 of p numbers is exceeded on a healthy joint: all variances are estimates, the scale of the
/// joint with `scale_freedom` degrees of freedom.
double exceeded_by_chance(const RegionModel& model, double statistic, const Shares& share, double scale_freedom);

/// Columns (one row per observation) of component k without their correlation in time and with variance 1: the
/// innovations of d + e over their deviation. `scatter`: v. The logs of their variances are added to `log_variance`.
Eigen::MatrixXd whiten(const RegionModel& model, Eigen::Index component, std::span<const double> days,
                       std::span<const double> scatter, const Eigen::MatrixXd& columns, double* log_variance = nullptr);

}  // namespace tribotwin::twin::diagnosis::fleet
