#pragma once

#include <array>
#include <span>
#include <string>

#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/cia402/homing.hpp>
#include <tribotwin/hil/cia402/profile_position.hpp>
#include <tribotwin/hil/cia402/profile_velocity.hpp>
#include <tribotwin/hil/drives/bus_drive.hpp>
#include <tribotwin/hil/motion/inputs.hpp>
#include <tribotwin/hil/motion/motion_profile.hpp>
#include <tribotwin/hil/motion/torque_limit.hpp>

/// The modes of operation (CiA 402-2, 6060h) as one table. The checks of 6060h, the supported modes 6502h, the meanings
/// in the dictionary and the EDS, and the set points follow from its rows.
///
/// To add a mode: one row in modes.cc with its function, and the expected list in tests/hil/cia402. A set point that no
/// mode has yet is one more object (object_index.hpp, drive_objects.cc) and one row of the targets in modes.cc.
namespace tribotwin::hil {

/// What a mode keeps from step to step; made anew when the drive enters a mode. Joint side.
struct Demand {
  double position_rad = 0;
  double step_rad_s = 0, left_s = 0;  ///< CSP, IP: a straight line from one target to the next
  SpeedLimitedTorque torque;          ///< CST
  MotionState motion;                 ///< PP, PV, HM, IP: the set point of the last step
  PositionMove move;                  ///< PP
  VelocityMove turn;                  ///< PV
  HomingRun homing;                   ///< HM
  const Inputs* inputs = nullptr;     ///< HM
  bool idle = false;                  ///< IP: switched off, it needs no set points
  bool halted = false;                ///< the master halts the drive (bit 8 of the controlword)
  bool lags = false;                  ///< the following error is beyond its window
};

/// How a mode gets its set points.
enum class SetPoints : std::uint8_t {
  cyclic,     ///< again and again: their absence is watched (2121h)
  rare,       ///< once: the drive goes on with the last one
  on_request  ///< once, taken by a bit of the controlword: an old one does not move the drive
};

/// The rule of a mode, from the dictionary to set points and status.
struct ModeOfOperation {
  std::int8_t number;                     ///< value of 6060h; bit number - 1 of 6502h
  const char* name;                       ///< "CSP"
  std::uint16_t target;                   ///< index of its set point, one of `targets()`; 0: none
  std::array<std::uint16_t, 16> needs{};  ///< indices of the other objects that it reads; 0: none
  bool follows_demand = false;            ///< whether the following error of `Demand` is watched (6065h, 6066h)
  SetPoints set_points = SetPoints::cyclic;
  /// The drive enters the mode; `Demand` is at the present position and speed. Null: nothing to do.
  void (*enter)(Demand&, const DriveObjects&) = nullptr;
  /// A halt ended: `Demand` is at the present position and speed, `before` as the halt found it. Null: nothing to do.
  void (*resume)(Demand&, const Demand& before, const DriveObjects&) = nullptr;
  /// A frame changed the controlword while the mode was active; it may have changed other objects, too. Null: no bits.
  void (*control)(Demand&, const DriveObjects&, std::int64_t before, std::int64_t now) = nullptr;
  /// Called when the bus wrote the target while the mode was active; null where `command` reads the target itself.
  void (*target_written)(Demand&, const DriveObjects&) = nullptr;
  /// The set point of the next step of dt [s].
  twin::DriveCommand (*command)(Demand&, const DriveObjects&, const Feedback&, double dt_s);
  /// What the step did, halted or not. Null: nothing to watch.
  void (*observe)(Demand&, const DriveObjects&, const Feedback&, double dt_s) = nullptr;
  /// The bits 10 to 13 of the statusword, while the mode is active.
  int (*status)(const Demand&);
};

std::span<const ModeOfOperation> modes_of_operation();
/// Null for a mode that the drive does not have.
const ModeOfOperation* find_mode(std::int64_t number);
constexpr std::int8_t default_mode = 8;  ///< value of 6060h after a reset: CSP
constexpr std::int8_t no_mode = 0;       ///< value of 6060h: the drive follows no set points

/// A set point object. `standing_counts`: the value that keeps the present motion when the drive enters a mode or
/// changes to another (`moving`: it followed a mode before).
struct Target {
  std::uint16_t index;
  std::uint8_t sub;
  std::int64_t (*standing_counts)(const DriveObjects&, const Feedback&, bool moving);
};
std::span<const Target> targets();

/// For the dictionary: "0 none, 8 CSP, 9 CSV, 10 CST", the bits of 6502h, "CSP, CSV, CST".
std::string mode_numbers();
std::int64_t supported_modes();
std::string mode_names();
/// Names of the modes whose target is this object.
std::string modes_with_target(std::uint16_t index);
/// "added in CSP and CSV", "added in every mode": the modes that need this offset.
std::string modes_that_add(std::uint16_t index);

}  // namespace tribotwin::hil
