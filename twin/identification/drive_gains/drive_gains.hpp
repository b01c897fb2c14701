#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/drive_gains/payload.hpp>
#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>

/// The drive gains of all joints at once, from motions with and without a known payload (Gautier and Briot 2014,
/// "Global identification of joint drive gains and dynamic parameters of robots").
///
/// Currents tell torques up to a factor per joint, tau_j = g_j y_j. Links and rotors cannot tell it: twice the masses
/// give twice the torques. The payload's parameters phi are known, and set the scale,
///
///   y_j = (Y_j beta + P_j phi) / g_j + F_j theta_j + noise,
///
/// for the joints that it loads, and through the base parameters beta that joints share for others. The noise is that
/// of y, so that sums of squares of y are minimised over ln g, beta, theta and what is not known of phi: with y as a
/// regressor, linear in g, noise would make every gain too small. Friction is Coulomb, viscous and per load beside an
/// offset, whatever law is identified later: what grows with the load and turns with the speed is no gain.
/// Sigmas: a jackknife over stretches of time, and the standard deviations of what is given of the payload.
namespace tribotwin::twin::identification {

struct DriveGains {
  std::vector<Estimate> factors;    ///< per joint, torque per recorded torque [1], named as the joint; held at 1 where
                                    ///< its torque is left out
  std::vector<Lacking> lacking;     ///< joints without a number, and what to record
  std::vector<Estimate> per_load;   ///< per joint, friction per load [1]; NaN sigma where its torque is left out
  Eigen::MatrixXd covariance;       ///< of ln factor, joints x joints
  Eigen::MatrixXd base_covariance;  ///< what uncertain gains and payloads add to that of base parameters
  std::vector<Eigen::VectorXd> payload;  ///< the parameters of every payload, as identified where not known
  std::vector<Eigen::MatrixXd> payload_covariance;

  bool known(std::size_t joint) const;
};

/// `payload_of_file`: per recording of `motion` an index of `payloads`, or -1 where it has none. ErrorKind::input where
/// no two recordings differ in their payload (with what to record) or a payload acts against its weight.
Result<DriveGains> identify_drive_gains(const Regressor& regressor, const BaseParameters& base,
                                        const JointMotion& motion, std::span<const PlacedPayload> payloads,
                                        std::span<const int> payload_of_file, unsigned threads);

/// Payloads whose centre of mass is elsewhere than said: by gains that take the mass alone. A mass that is wrong cannot
/// be told.
std::vector<std::string> doubtful_centres(const Regressor& regressor, const BaseParameters& base,
                                          const JointMotion& motion, std::span<const KnownPayload> payloads,
                                          std::span<const int> payload_of_file, unsigned threads);

/// Adds to sigmas and intervals of a fit of the corrected torques what the gains are uncertain by.
void count_gains(const DriveGains& gains, DynamicsFit& fit);

}  // namespace tribotwin::twin::identification
