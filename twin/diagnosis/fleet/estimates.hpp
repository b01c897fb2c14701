#pragma once

#include <tribotwin/twin/diagnosis/fleet/type_model.hpp>

/// The estimates of which learn_type consists.
namespace tribotwin::twin::diagnosis::fleet {

constexpr double temperature_unit_K = 10;

/// Pooled regression within robots on T and T^2 [10 K], and what is left.
struct WithinRobots {
  Eigen::Matrix<double, 2, feature_count> slopes = Eigen::Matrix<double, 2, feature_count>::Zero();
  FeatureMatrix covariance = FeatureMatrix::Zero(), residual = FeatureMatrix::Zero();
  double freedom = 0;      ///< about the means of robots
  double own_freedom = 0;  ///< about regressions of each robot of its own
};
WithinRobots within_robots(const EachRobot& each, bool temperature);

/// S_n, S_d and phi of a region by restricted maximum likelihood, from the variogram's directions on, and the
/// probability of every phi by its likelihood. Models with decouple, lambda, persistence and probability, the most
/// probable first, without those that are improbable; scatter, curvature and temperatures are those of `type` so far.
std::vector<RegionModel> learn_noise(const EachRobot& each, const WithinRobots& within, std::size_t region,
                                     TypeModel& type);

/// Sums of one joint in the coordinates z: information X'R^-1 X and X'R^-1 z, component after component.
struct RobotSums {
  Eigen::MatrixXd information;      ///< p q x p q
  Eigen::VectorXd moment;           ///< p q
  double squares = 0, freedom = 0;  ///< of the residuals of the robot's own regression, of all p together
};
RobotSums robot_sums(const TypeModel& type, std::size_t region, const Rows& rows);

/// mean, between and mean_error by restricted maximum likelihood.
void learn_between(const std::vector<RobotSums>& robots, RegionModel& out);

/// scale and scale_freedom: the moments of ln s^2 (Smyth 2004, section 6.2).
void learn_scale(const std::vector<RobotSums>& robots, RegionModel& out);

}  // namespace tribotwin::twin::diagnosis::fleet
