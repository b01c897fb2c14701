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
///   e ~ N(0, K S_n K')                 of the measurement, K as each fit claims it for itself (claims.hpp),
///   S_d and S_n of robot r times s_r, 1 / s_r ~ chi^2_k / (k s)   (Smyth 2004).
/// S_n, S_d and phi by restricted maximum likelihood, in directions that begin with those of the differences of
/// observations of one robot (variogram, Cressie 1993, 2.4); mean and Omega too (EM, Laird 1982), k and s from the
/// residual sums of squares.
namespace tribotwin::twin::diagnosis::fleet {

constexpr std::size_t robots_minimum = 6;  ///< from which robots borrow from each other

/// Coordinates z = W (y - c T^2), in which W S_n W' = 1 and W S_d W' = diag(lambda): the p numbers of a typical
/// observation are independent but for what robots have in common; those of others in coordinates of their own robot.
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
  double typical_scatter = 0;             ///< v = scatter / this; 0: v = 1
  Eigen::MatrixXd typical_root;           ///< L of the typical claim (claims.hpp); empty: claims are v alone
  double scale = 1, scale_freedom = 1e6;  ///< s, k
  double probability = 1;                 ///< of this persistence, given the healthy curves

  Eigen::Index features() const { return lambda.size(); }
  Eigen::Index regressors() const { return mean.size() / lambda.size(); }
};

struct TypeModel {
  std::string type, joint;  ///< type of robot, name of the joint
  std::size_t robots = 0, observations = 0;
  double temperature_low_degC = 0, temperature_high_degC = 0;
  bool knows_temperature = false;                  ///< x = (1, T) instead of 1
  std::array<RegionModel, 2> region;               ///< with the most probable persistence
  std::array<std::vector<RegionModel>, 2> others;  ///< with other persistences that are possible too
  FeatureMatrix within = FeatureMatrix::Zero();    ///< covariance of one robot's logarithmic features, all temperatures
  double load_norm = std::numeric_limits<double>::quiet_NaN();  ///< mean of the healthy curves
  std::vector<std::string> notes;

  /// The persistences of a region: region[which], then others[which].
  std::size_t choices(std::size_t which) const { return 1 + others[which].size(); }
  const RegionModel& choice(std::size_t which, std::size_t k) const {
    return k == 0 ? region[which] : others[which][k - 1];
  }

  Eigen::VectorXd regressors(const Row& row) const;
  /// z of a row.
  Eigen::VectorXd decoupled(const Row& row, std::size_t region) const;
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

/// Columns (one row per observation) of component k without their correlation in time and with variance 1: the
/// innovations of d + e over their deviation. `scatter`: v. The logs of their variances are added to `log_variance`.
Eigen::MatrixXd whiten(const RegionModel& model, Eigen::Index component, std::span<const double> days,
                       std::span<const double> scatter, const Eigen::MatrixXd& columns, double* log_variance = nullptr);

}  // namespace tribotwin::twin::diagnosis::fleet
