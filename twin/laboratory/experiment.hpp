#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include <tribotwin/plugins/mujoco/loader.hpp>

/// Measuring friction in the twin the way paper 1 does on the robot (section 2.1): the joint runs at +v and -v through the
/// same angle under its speed servo, the others are braked; half the difference of the motor torques is friction (4).
namespace tribotwin::twin {

/// One level of a friction curve. Motor-side speed; torques over torque_max_nm unless _nm.
struct CurvePoint {
  double speed_rad_s, load_norm, temperature_degC;
  double friction_norm, friction_nm, stderr_nm;
};

/// The law itself at these speeds [rad/s, motor side].
std::vector<CurvePoint> law_curve(const drive::Drive& drive, std::span<const double> speeds_rad_s, double load_norm, double temperature_degC);

enum class LoadBy {
  torque,   ///< gravity removed, an external torque on the joint
  pose      ///< gravity of the arm in a pose found for it
};

struct ExperimentOptions {
  double load_norm = 0, temperature_degC = 50;
  LoadBy load_by = LoadBy::torque;
  double noise_nm = 0;         ///< standard deviation of the measured motor torque, arm side
  std::uint64_t seed = 1;
  std::function<void(double)> progress;
};

/// The curve measured in simulation, at prescribed temperature. `load_norm` of a point is the mean measured load.
/// Fails when the pose cannot give the load (says which loads can be had), or the servo finds no steady speed.
tl::expected<std::vector<CurvePoint>, std::string> measure_curve(const mujoco::Model& model, std::size_t drive,
                                                                 std::span<const double> speeds_rad_s, const ExperimentOptions& options);

}  // namespace tribotwin::twin
