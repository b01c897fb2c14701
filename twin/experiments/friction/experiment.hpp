#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/control/servo.hpp>
#include <tribotwin/twin/identification/curves/levels.hpp>
#include <tribotwin/twin/identification/curves/recording.hpp>
#include <tribotwin/twin/robot/pose.hpp>

/// Measuring friction in the twin as on the robot. One joint is moved by its servo, the others are braked and hold
/// their pose; what the controller records goes through `levels_of`.
namespace tribotwin::twin {

enum class LoadBy {
  torque,  ///< gravity removed, an external torque on the joint
  pose,    ///< gravity of the arm in a pose found for it
  payload  ///< gravity of the arm and a body it carries, in a pose that is given
};

/// What the joint's temperature does while it is measured.
struct Heat {
  thermal::Rise rise;           ///< at the start
  double ambient_offset_K = 0;  ///< of the ambient temperature over the drive's T_amb
  bool held = true;             ///< the thermal model rests
};

/// One measurement on a bench.
struct Measurement {
  std::vector<double> speeds_rad_s;  ///< of the levels, > 0, arm side
  std::vector<double> start_rad;     ///< pose per drive, the joint's own included: where paper 1 measures
  double external_nm = 0;            ///< load that no gravity gives, arm side
  double width_rad = std::numeric_limits<double>::infinity();  ///< measured around the joint's start
  Heat heat;
  drive::Faults faults{};  ///< of the joint
  CascadedOptions servo{.position_gain_1_s = 20, .speed_bandwidth_rad_s = 100, .integral_time_s = 0.05};
  Sensors sensors;
  std::uint64_t seed = 1;  ///< of the sensors' noise
};

/// A copy of the arm without end stops (the run-up at full speed needs room), contacts and current limits, with gravity
/// or without, at a time step that sampling is a multiple of. Fails where the drives cannot be carried so.
Result<std::shared_ptr<const mujoco::Model>> bench_of(const mujoco::Model& arm, bool gravity, double sampling_hz);

/// Paper 1, section 2.1: each speed forward and back through the joint's start, with room to settle. Fails for speeds
/// at which the servo cannot move the joint steadily.
Result<Motion> plus_minus(const mujoco::Model& bench, std::size_t drive, const Measurement& measurement);

/// Paper 2, Table 1: speeds [rad/s] of its 15 levels.
std::vector<double> test_cycle_speeds_rad_s();
/// Travel [rad] of each level.
std::vector<double> test_cycle_travel_rad();
/// Paper 2's cycle around the joint's start. "Angular displacement" and "sampling time" of Table 1 are taken to be
/// those of the way there and back, so that the whole lasts under three minutes as the paper says.
Motion test_cycle_of(const mujoco::Model& bench, std::size_t drive, std::span<const double> start_rad);

/// What the controller records while the joint follows `motion`. Fails when the simulation diverges.
Result<JointRecording> record(const mujoco::Model& bench, std::size_t drive, const Motion& motion,
                              const Measurement& measurement, const std::function<void(double share)>& progress = {});

/// One level of a friction curve. Motor-side speed; torques over torque_max_nm unless _nm.
struct CurvePoint {
  double speed_rad_s, load_norm, temperature_degC;
  double friction_norm, friction_nm, stderr_nm;
};

/// The law itself at these speeds [rad/s, motor side].
std::vector<CurvePoint> law_curve(const drive::Drive& drive, std::span<const double> speeds_rad_s, double load_norm,
                                  double temperature_degC);

struct ExperimentOptions {
  double load_norm = 0, temperature_degC = 50;
  LoadBy load_by = LoadBy::torque;  ///< torque or pose
  double noise_nm = 0;              ///< standard deviation of the measured motor torque, arm side
  std::uint64_t seed = 1;
  std::function<void(double)> progress;
};

/// The curve measured in simulation by paper 1's procedure, at prescribed temperature. `load_norm` of a point is the
/// mean measured load. Fails when no pose gives the load (says which loads can be had), or the servo finds no steady
/// speed.
Result<std::vector<CurvePoint>> measure_curve(const mujoco::Model& model, std::size_t drive,
                                              std::span<const double> speeds_rad_s, const ExperimentOptions& options);

}  // namespace tribotwin::twin
