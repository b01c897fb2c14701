#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <numbers>

#include <tribotwin/hil/drives/drive_parameters.hpp>

/// The digital inputs of a drive, as switches along the way of its joint: each closes at its position and stays closed
/// beyond. The index pulse of the encoder comes once in each turn of the motor.
namespace tribotwin::hil {

/// The limit switches close so long before the ends of the joint's range.
inline constexpr double limit_switch_margin_rad = std::numbers::pi / 180;

enum class Input : std::uint8_t { negative_limit, positive_limit, home, probe_2, index };

/// Where the switches are. Joint side, absolute.
struct SwitchPositions {
  double negative_limit_rad = -std::numeric_limits<double>::infinity();
  double positive_limit_rad = std::numeric_limits<double>::infinity();
  double home_rad = 0, probe_2_rad = 0;
  double turn_rad = 1;  ///< one turn of the motor
};
/// The limit switches of a joint, if it has a range; the index pulse.
SwitchPositions switches_of(const DriveParameters& parameters);

class Inputs {
 public:
  struct Edge {
    bool rising = false, falling = false;
    double position_rad = 0;  ///< absolute
  };

  /// The joint is at `joint_rad` now, absolute. The first call gives no edges.
  void move_to(const SwitchPositions& switches, double joint_rad);
  bool active(Input input) const { return active_[static_cast<std::size_t>(input)]; }
  /// What an input did in the last move.
  const Edge& edge(Input input) const { return edges_[static_cast<std::size_t>(input)]; }

 private:
  static constexpr std::size_t count = 5;
  void set(Input input, bool active, double position_rad);
  void watch_index(double turn_rad, double joint_rad);

  std::array<bool, count> active_{};
  std::array<Edge, count> edges_{};
  double last_rad_ = 0;
  bool known_ = false;
};

}  // namespace tribotwin::hil
