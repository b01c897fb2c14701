#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

/// The set points of an arm as a pure function of time: a list of straight joint moves with trapezoidal speed,
/// held commands of a recording, or cubics through samples of position and speed. Angles [rad] (slides [m]), speeds
/// [rad/s], torques [Nm; N] of the motor seen from the arm, one entry per driven joint.
namespace tribotwin::twin {

struct SetPoint {
  double position_rad = 0, velocity_rad_s = 0, torque_nm = 0;
};

class Motion {
 public:
  explicit Motion(std::vector<double> start_rad) : start_(start_rad), last_(std::move(start_rad)) {}

  /// Appends a straight move in which no joint exceeds its speed [rad/s] and acceleration [rad/s^2]; the joint that
  /// needs longest sets the pace and runs at exactly its speed on the plateau, if there is one.
  Motion& move_to(std::vector<double> target_rad, std::span<const double> speed, std::span<const double> acceleration);
  Motion& dwell(double duration_s);
  /// Appends recorded commands: a jump, held until the next move. Empty speeds and torques are 0.
  Motion& hold_at(double time_s, std::vector<double> position_rad, std::vector<double> velocity_rad_s = {},
                  std::vector<double> torque_nm = {});
  /// Appends the cubic from the end of the last such piece to a position and velocity at a time; without one before,
  /// from the start at time 0, at rest.
  Motion& pass_through(double time_s, std::vector<double> position_rad, std::vector<double> velocity_rad_s);
  /// Appends another motion, which begins where this one ends and does not repeat.
  Motion& then(const Motion& other);
  /// Repeats the motion without end; the last dwell is extended to a whole number of time steps. The motion must end
  /// where it began.
  Motion& repeat(double timestep_s);

  std::size_t joints() const { return start_.size(); }
  double duration_s() const { return end_s_; }
  /// Length of one repetition, 0 when the motion does not repeat.
  double period_s() const { return period_s_; }
  std::span<const double> start_rad() const { return start_; }
  /// Smallest and largest position of a joint over the motion.
  std::pair<double, double> reach_rad(std::size_t joint) const;

  /// Pieces of the motion in which a joint moves, in order, with their lengths and the largest speed [rad/s; m/s] in
  /// each. A held sample counts from the one before it, and only where a neighbouring sample goes the same way: a
  /// single jump is a step, which has no speed.
  struct Pace {
    double duration_s, speed_rad_s;
  };
  std::vector<Pace> paces(std::size_t joint) const;

  void at(double time_s, std::span<SetPoint> out) const;

  bool operator==(const Motion&) const = default;

 private:
  struct Segment {
    double start_s, duration_s, ramp_s;
    std::vector<double> from, to;
    std::vector<double> from_velocity, to_velocity;      ///< of cubics; else empty
    std::vector<double> held_velocity{}, held_torque{};  ///< of recorded commands; may be empty
    bool operator==(const Segment&) const = default;
    double peak_rad_s(std::size_t joint) const;
  };
  std::vector<double> start_, last_;
  std::vector<Segment> segments_;
  double end_s_ = 0, period_s_ = 0;
};

/// Back and forth between -travel/2 and +travel/2 around `centre` on one joint at constant speed, others at rest.
Motion back_and_forth(std::vector<double> centre_rad, std::size_t joint, double travel_rad, double speed_rad_s,
                      double acceleration_rad_s2, double dwell_s);

/// Zhou 2024, Table 1: 15 speed levels, each forward and back over its travel, on the chosen joints one after the
/// other.
Motion test_cycle(std::vector<double> centre_rad, std::span<const std::size_t> joints, double acceleration_rad_s2,
                  double dwell_s);

}  // namespace tribotwin::twin
