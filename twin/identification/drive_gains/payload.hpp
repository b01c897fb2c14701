#pragma once

#include <optional>
#include <string>
#include <string_view>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_recording.hpp>
#include <tribotwin/twin/robot/regressor.hpp>

/// What is known of the payload that a robot carried in a recording.
namespace tribotwin::twin::identification {

struct KnownPayload {
  std::string file;  ///< the recording
  std::string text;  ///< what is known, as written: equal texts are the same payload
  double mass_kg = 0, mass_sigma_kg = 0;
  std::optional<Eigen::Vector3d> centre_m;  ///< of mass, in the frame that `on` names; none: unknown
  double centre_sigma_m = 0;                ///< of each coordinate
  /// About the centre of mass, in axes of that frame: XX YY ZZ XY XZ YZ [kg m^2]; none: unknown
  std::optional<Eigen::Matrix<double, 6, 1>> inertia_kg_m2;
  std::string on;  ///< site, or body; empty: the site "flange", else the body of the last joint
};

/// Of "FILE=MASS kg [+- SIGMA] [at X Y Z [+- SIGMA]] [inertia XX YY ZZ [XY XZ YZ]] [on SITE]", lengths in m, the
/// bracketed parts in any order. ErrorKind::input with what is wrong and the form that is right.
Result<KnownPayload> known_payload(std::string_view text);

/// A payload in the parameters of the regressor: `body.parameters` + spread z, where every z is normal with mean 0 and
/// standard deviation 1. What the user does not say has a wide one: coordinates of the centre 0.5 m, inertias those of
/// a radius of gyration of 0.2 m (0.5 m where the centre is unknown too).
struct PlacedPayload {
  CarriedBody body;
  Eigen::MatrixXd spread;  ///< parameters x z; no columns: everything is known
  /// The frame in which the user gives the centre of mass, in that of the body.
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
};

/// The centre of mass [m] in that frame, of parameters as identified, and the standard deviations of its coordinates.
struct Centre {
  Eigen::Vector3d position_m, sigma_m;
};
Centre centre_of(const PlacedPayload& payload, const Eigen::VectorXd& parameters, const Eigen::MatrixXd& covariance);

/// ErrorKind::input where the model has no such site or body, or it does not move.
Result<PlacedPayload> placed(const KnownPayload& payload, const Regressor& regressor);

}  // namespace tribotwin::twin::identification
