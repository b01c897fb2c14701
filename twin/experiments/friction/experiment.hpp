#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/control/servo.hpp>
#include <tribotwin/twin/identification/samples/levels.hpp>
#include <tribotwin/twin/identification/samples/recording.hpp>
#include <tribotwin/twin/robot/pose.hpp>

/// Measures friction in the twin as on the robot. The servo moves one joint, the others are braked, and `levels_of`
/// evaluates the recording of the controller.
namespace tribotwin::twin {

enum class LoadBy {
  torque,  ///< gravity removed, an external torque on the joint
  pose,    ///< gravity of the arm in a pose found for it
  payload  ///< gravity of the arm and a body it carries, in a given pose
};

/// The joint's temperature while it is measured.
struct Heat {
  thermal::Rise rise;           ///< at the start
  double ambient_offset_K = 0;  ///< of the ambient temperature over the drive's T_amb
  bool held = true;             ///< the temperature is constant
};

/// One measurement on a bench.
struct Measurement {
  std::vector<double> speeds_rad_s;  ///< of the levels, > 0, arm side
  std::vector<double> start_rad;     ///< pose per drive, the joint's own included: where Bittencourt 2012 measures
  double external_nm = 0;            ///< load in addition to gravity, arm side
  double width_rad = std::numeric_limits<double>::infinity();  ///< of the range around the joint's start
  Heat heat;
  drive::Faults faults{};  ///< of the joint
  CascadedOptions servo{.position_gain_1_s = 20, .speed_bandwidth_rad_s = 100, .integral_time_s = 0.05};
  Sensors sensors;
  std::uint64_t seed = 1;  ///< of the sensors' noise
};

/// A copy of the arm without end stops (the run-up at full speed needs room), contacts and current limits, with or
/// without gravity, at a time step that divides the sampling period. ErrorKind::input where the drives do not allow it.
Result<std::shared_ptr<const mujoco::Model>> bench_of(const mujoco::Model& arm, bool gravity, double sampling_hz);

/// Bittencourt 2012, section 2.1: each speed back and forth through the joint's start, with room to reach a steady
/// speed. ErrorKind::work for speeds at which the servo cannot move the joint steadily.
Result<Motion> plus_minus(const mujoco::Model& bench, std::size_t drive, const Measurement& measurement);

/// Zhou 2024, Table 1: speeds [rad/s] of its 15 levels.
std::vector<double> test_cycle_speeds_rad_s();
/// Travel [rad] of each level.
std::vector<double> test_cycle_travel_rad();
/// Zhou 2024's cycle around the joint's start. "Angular displacement" and "sampling time" of Table 1 are interpreted as
/// those of the way back and forth: the whole cycle then lasts under three minutes, as in the paper.
Motion test_cycle_of(const mujoco::Model& bench, std::size_t drive, std::span<const double> start_rad);

/// The recording of the controller while the joint follows `motion`. ErrorKind::work when the simulation diverges.
Result<JointRecording> record(const mujoco::Model& bench, std::size_t drive, const Motion& motion,
                              const Measurement& measurement, const std::function<void(double share)>& progress = {});

/// One level of a friction curve. Motor-side speed; torques over torque_max_nm unless _nm.
struct CurvePoint {
  double speed_rad_s, load_norm, temperature_degC;
  double friction_norm, friction_nm, stderr_nm;  ///< of both directions together, with the sign of the speed
  double forward_nm, backward_nm;                ///< opposing motion at that speed, offset included
};

/// The law at these speeds [rad/s, motor side].
std::vector<CurvePoint> law_curve(const drive::Drive& drive, std::span<const double> speeds_rad_s, double load_norm,
                                  double temperature_degC);

struct ExperimentOptions {
  double load_norm = 0, temperature_degC = 50;
  LoadBy load_by = LoadBy::torque;  ///< torque or pose
  double noise_nm = 0;              ///< standard deviation of the measured motor torque, arm side
  std::uint64_t seed = 1;
  std::function<void(double)> progress;
};

/// The curve measured in simulation by Bittencourt 2012's procedure, at prescribed temperature. Speeds [rad/s, motor
/// side] other than 0. `load_norm` of a point is the mean measured load. ErrorKind::input where no pose has the load
/// (with the possible loads), ErrorKind::work where the servo reaches no steady speed.
Result<std::vector<CurvePoint>> measure_curve(const mujoco::Model& model, std::size_t drive,
                                              std::span<const double> speeds_rad_s, const ExperimentOptions& options);

}  // namespace tribotwin::twin
