#pragma once

#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <tribotwin/twin/control/encoder.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/motion.hpp>

/// Joint controllers: set points in, motor torques (mjData.ctrl) out, once per time step.
namespace tribotwin::twin {

class Servo {
 public:
  virtual ~Servo() = default;
  /// Called inside the step, with positions, velocities and gravity of its start. Set points per drive.
  virtual void control(const mjModel* m, mjData* d, std::span<const SetPoint> set_points) = 0;
  /// What it carries from step to step; nothing for one without memory.
  virtual void state(StateNumbers&) {}
};

/// Gains of a drive's loops, as in CascadedOptions.
struct LoopGains {
  double position_gain_1_s = 10, speed_bandwidth_rad_s = 60, integral_time_s = 0.1;
  double speed_gain_nm_s_rad = 0;  ///< above 0: in place of bandwidth x inertia
  double torque_limit_nm = friction::unlimited;
  double torque_gain = 1;  ///< what the drive delivers of a commanded torque
};

/// The command of one drive for a time step. Arm side.
struct DriveCommand {
  enum class Mode { off, torque, velocity, position };
  Mode mode = Mode::off;
  double position_rad = 0;
  double velocity_rad_s = 0;  ///< set point, or added to the position loop's output
  double torque_nm = 0;       ///< set point, or added to the speed loop's output
  double torque_limit_nm = friction::unlimited;
};

/// Position P over speed PI, as in industrial drives. Torque limit: the actuator's ctrlrange.
struct CascadedOptions {
  DriveCommand::Mode mode = DriveCommand::Mode::position;  ///< what of a set point is followed; the rest is added to it
  double position_gain_1_s = 10;
  double speed_bandwidth_rad_s = 60;   ///< speed gain over the joint's inertia at the start
  double integral_time_s = 0.1;        ///< 0: no integral part
  bool gravity = true;                 ///< feed gravity forward
  double encoder_counts = 0;           ///< per motor turn; 0: angle and speed are measured exactly
  double speed_filter_rad_s = 300;     ///< bandwidth of the tracking loop behind the encoder
  std::vector<LoopGains> per_drive{};  ///< in place of the first three; empty: the same for all
};

/// The loops of industrial drives; each drive has its own mode. The actuator's ctrlrange limits the torque, too.
class DriveServo {
 public:
  DriveServo(const mujoco::Model& model, const mjData* start, const CascadedOptions& options);
  /// Inside the step: `measure`, then `actuate`.
  void control(const mjModel* m, mjData* d, std::span<const DriveCommand> commands) {
    measure(m, d);
    actuate(m, d, commands);
  }
  /// Reads the encoders.
  void measure(const mjModel* m, const mjData* d);
  const Encoder& encoder(std::size_t drive) const { return loops_[drive].encoder; }
  /// In place of those of the options, from the next step on; the torque of the integral part stays. The bandwidth is
  /// cut to 1 / time step.
  void set_gains(std::size_t drive, const LoopGains& gains);
  /// Drives that are off have torque 0 and integral 0.
  void actuate(const mjModel* m, mjData* d, std::span<const DriveCommand> commands);
  /// Whether a drive's torque was cut to a limit in the last step.
  bool limited(std::size_t drive) const { return loops_[drive].limited; }
  void state(StateNumbers& s);

 private:
  struct Loop {
    double inertia_kg_m2 = 0, limit = 0, integral_nm = 0;
    LoopGains gains;
    int position = 0;
    bool limited = false;
    Encoder encoder{};
  };
  const mujoco::Model& model_;
  CascadedOptions options_;
  std::vector<Loop> loops_;
};
std::unique_ptr<Servo> make_cascaded(const mujoco::Model& model, const mjData* start, const CascadedOptions& options);

/// A factor over something >= 0: linear between its knots, constant beyond them, 1 without any.
struct GainCurve {
  static constexpr std::size_t most = 4;
  static constexpr std::array<double, most> none = [] {
    std::array<double, most> all{};
    all.fill(std::numeric_limits<double>::quiet_NaN());
    return all;
  }();
  std::array<double, most> at = none;      ///< increasing, of the first knots; NaN: no further knot
  std::array<double, most> factor = none;  ///< NaN: 1

  double operator()(double x) const;
};

/// A small servo's firmware: position error -> duty cycle -> DC motor with winding resistance and back-EMF.
struct DcPositionOptions {
  double kp = 400, error_gain = 0;               ///< duty = kp error_gain (goal - position), times both curves
  GainCurve over_error{}, over_kp{};             ///< of |goal - position| [rad] and of kp
  double duty_limit = 1;                         ///< 0..1
  double duty_slew_1_s = friction::unlimited;    ///< maximum rate of the duty
  double torque_limit_nm = friction::unlimited;  ///< current limit
  double supply_V = 7.4, resistance_ohm = 1, kt_nm_A = 1;  ///< torque = kt / R (duty V' - kt speed)
  double supply_resistance_ohm = 0;  ///< V' = V (1 - R_supply / R duty^2): what the supply loses under load
  /// R (1 + resistance_per_K (T - reference_degC)) at the temperature T of the drive's winding, of its lubricant
  /// without one; copper alone has 0.0039.
  double resistance_per_K = 0, reference_degC = 25;
};
/// Motor torque [Nm] at a position error [rad] and speed [rad/s], at reference_degC and with any rate of the duty.
double dc_torque_nm(const DcPositionOptions& options, double error_rad, double speed_rad_s);
/// Options per drive.
std::unique_ptr<Servo> make_dc_position(const mujoco::Model& model, std::vector<DcPositionOptions> options);

/// Constant torques [Nm, arm side] per drive.
std::unique_ptr<Servo> make_torque(const mujoco::Model& model, std::vector<double> torque_nm);

}  // namespace tribotwin::twin
