#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <tribotwin/twin/control/state_numbers.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

/// What the health check (health.hpp) counts in every step.
namespace tribotwin::twin {

class Twin;

/// One joint since the start of the run, in steps, skipped ones included.
struct JointWatch {
  double saturated = 0;                                            ///< the control lay at or beyond a torque limit
  double beyond_range = 0;                                         ///< the joint was past an end of its range
  double too_fast = 0, overloaded = 0, too_cold = 0, too_hot = 0;  ///< outside the range of the law
  double error_squared_sum = 0, error_max = 0;  ///< position against its set point [rad^2, rad; m of a slide]
};

/// Two geoms that touched although the robot should touch neither itself nor its surroundings.
struct TouchedGeoms {
  int geom1, geom2;
  double steps;  ///< skipped ones included
  std::int64_t last_step;
};

/// The torque range of a drive's control, in the control's own unit: ctrlrange, forcerange, the joint's
/// actuatorfrcrange and the current limit of a small servo, whichever is narrower. Infinite without a limit.
struct ControlRange {
  double low, high;
};
ControlRange control_range(const Scenario& scenario, std::size_t drive);
/// The same, whatever controls the drive.
ControlRange control_range(const mujoco::Model& model, std::size_t drive);

/// Counts without allocating. Speeds and loads count where the law's range bounds them.
class Watch {
 public:
  /// `follows`: the drives follow the scenario's motion.
  Watch(const Scenario& scenario, bool follows);
  /// Called after every computed step.
  void add(const Twin& twin);

  /// Whether positions are compared with set points.
  bool follows() const { return follows_; }
  std::span<const JointWatch> joints() const { return joints_; }
  /// The first pairs that touched; `touched_steps` has those of all.
  std::span<const TouchedGeoms> touched() const { return touched_; }
  double touched_steps() const { return touched_steps_; }
  /// Appends all counts but the largest error; those of pairs last, because their number grows.
  void append_sums(std::vector<double>& sums) const;
  /// Adds what was counted in skipped steps; `sums` as appended.
  void add_sums(std::span<const double> sums);
  /// The counts.
  void state(StateNumbers& s);

 private:
  static constexpr std::size_t pairs_named = 16;
  struct Bounds {
    int control;
    double control_low, control_high, position_low, position_high;
    double speed_scale, speed_max_rad_s, load_max_nm, temperature_min_degC, temperature_max_degC;
  };
  /// How a body belongs to the robot: not at all, to one that stands on the ground, or to one that moves freely.
  enum class Part : char { none, fixed, free };

  void add_contacts(const Twin& twin);
  template <class Self, class Each>
  static void each_sum(Self& self, Each each);
  bool unwanted(int geom1, int geom2) const;
  void count(int geom1, int geom2, std::int64_t step);

  const mjModel* model_;
  bool follows_;
  std::vector<Bounds> bounds_;
  std::vector<JointWatch> joints_;
  std::vector<Part> parts_;    ///< per body
  std::vector<int> moved_by_;  ///< per body, the nearest body above it, or itself, that a drive moves
  std::vector<TouchedGeoms> touched_;
  double touched_steps_ = 0;
};

}  // namespace tribotwin::twin
