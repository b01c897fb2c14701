#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <tribotwin/hil/canopen/emcy.hpp>
#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/cia402/modes.hpp>
#include <tribotwin/hil/cia402/state_machine.hpp>
#include <tribotwin/hil/motion/sync_mean.hpp>

namespace tribotwin::hil {

/// The drive behind the objects of CiA 402: controlword to state machine, targets to set points, feedback to actual
/// values, and the reactions to errors.
class DriveProfile {
 public:
  DriveProfile(NodeContext& node, Emcy& emcy, const DriveParameters& parameters);

  const StateMachine& machine() const { return machine_; }
  bool halted() const { return halted_; }
  /// Index of the set point of the mode that the drive is in, halted or not; 0: none.
  std::uint16_t target() const {
    const ModeOfOperation* mode = followed_mode();
    return mode && !demand_.idle ? mode->target : std::uint16_t{0};
  }
  /// The set point must keep coming, by the rules of the mode.
  bool target_is_cyclic() const {
    const ModeOfOperation* mode = followed_mode();
    return mode && mode->set_points == SetPoints::cyclic;
  }
  /// 60F9h, 60FBh.
  twin::LoopGains gains() const { return objects_.gains(); }
  /// The state machine sets the brake, or the master does (60FEh).
  bool brake_engaged() const;
  /// The mode was entered in motion, and the drive itself set the speed or torque that keeps it until a master does.
  bool target_is_made_up() const { return made_up_; }
  /// Commands were lost, and the motor is not at rest yet.
  bool stops_alone() const { return stops_alone_; }
  std::uint16_t error_code() const { return static_cast<std::uint16_t>(objects_.error_code->value); }
  /// 2110h [degC], when a bench writes one.
  std::optional<double> measured_temperature_degC() const;

  /// Rules for writes to the drive's objects.
  tl::expected<void, Abort> may_write(const Object& object, std::int64_t value) const;
  /// An object was written by the bus.
  void written(const Object& object);
  /// As after power-up; what the motor does and the demand stay. `refresh_status` follows.
  void reset();

  /// A fault: error code and register, EMCY, and the way to the state fault, with a ramp if `ramp`.
  void fail(std::uint16_t code, std::uint8_t register_bits, bool ramp);
  /// The master is gone: reaction 6007h while powered, else only an EMCY.
  void lose_commands(ErrorCode code);

  /// The set point of the next step of dt [s].
  twin::DriveCommand command(double dt_s);
  /// A SYNC was answered: the next mean of 6077h begins.
  void sync() { torque_.sync(); }
  /// What that step did.
  void feedback(const Feedback& feedback, double dt_s);
  /// After a frame or a change from outside: the bits of the controlword that are the mode's, and the statusword.
  void refresh_status();

 private:
  const ModeOfOperation* active_mode() const;  ///< null: none
  /// The mode whose set points the drive follows or, halted, would follow; null: none.
  const ModeOfOperation* followed_mode() const { return machine_.follows() ? active_mode() : nullptr; }
  /// The drive is enabled, but its master halts it (bit 8 of the controlword) or has it in no mode.
  bool halts() const;
  /// The drive follows the set points of its mode.
  bool follows_target() const { return machine_.follows() && !halts(); }
  /// A mode is active that watches the following error.
  bool follows_demand() const { return follows_target() && active_mode()->follows_demand; }
  bool has_homing_method(std::int64_t number) const;
  void apply_controlword();
  /// Enters the mode when the drive begins to follow set points or 6060h changed; updates the statusword.
  void update_status();
  void take_up_mode();
  Demand demand_here() const;
  void resume();
  std::uint16_t statusword() const;
  StopOptions stop_options() const;
  /// A ramp down to standstill by 6085h or, for a halt with 605Dh = 1, 6084h; then held there.
  twin::DriveCommand ramp_down(twin::DriveCommand command, double dt_s);
  void move_zero(double joint_rad);
  void read_inputs(double joint_rad);
  void watch_safe_torque_off();
  void show(const Feedback& feedback, double dt_s);
  void set(Object* object, double counts);
  void watch_following_error(double lag_rad, double dt_s);
  void watch_standstill(double dt_s);
  void watch_temperature();
  /// Whether the winding is warmer than this object says; false without a winding.
  bool above(const Object* winding_limit) const;
  void watch_rest(double dt_s);
  bool stands() const;

  NodeContext& node_;
  Emcy& emcy_;
  DriveObjects objects_;
  double gear_ratio_;
  StateMachine machine_;
  SwitchPositions switches_;
  Inputs inputs_;
  SyncMean torque_;    // joint side
  Feedback feedback_;  // positions count from the drive's zero
  Demand demand_;
  double reaction_s_ = 0;  // time for which a fault reaction has lasted
  double ramp_rad_s_ = 0;
  double following_s_ = 0;                  // time for which the following error has been beyond its window
  double standing_s_ = 0;                   // time for which the motor has stood at the end of a ramp
  double resting_s_ = 0;                    // and for which it has stood without power and torque
  bool followed_ = false, halted_ = false;  // set points, when refresh_status was last called
  std::int64_t controlword_ = 0;            // when the frame before this one had been taken
  bool controls_ = false;                   // and whether its bits for a mode counted then
  bool stops_alone_ = false, made_up_ = false;
  std::vector<bool> fresh_ =
      std::vector<bool>(targets().size());  // targets written since the drive last entered a mode
};

}  // namespace tribotwin::hil
