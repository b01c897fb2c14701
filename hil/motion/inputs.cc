#include <cmath>

#include <tribotwin/hil/motion/inputs.hpp>

namespace tribotwin::hil {

SwitchPositions switches_of(const DriveParameters& p) {
  SwitchPositions s{.turn_rad = 2 * std::numbers::pi / p.gear_ratio};
  if (p.limited) {
    s.negative_limit_rad = p.position_low_rad + limit_switch_margin_rad;
    s.positive_limit_rad = p.position_high_rad - limit_switch_margin_rad;
  }
  return s;
}

void Inputs::move_to(const SwitchPositions& s, double joint_rad) {
  edges_ = {};
  set(Input::negative_limit, joint_rad <= s.negative_limit_rad, s.negative_limit_rad);
  set(Input::positive_limit, joint_rad >= s.positive_limit_rad, s.positive_limit_rad);
  set(Input::home, joint_rad >= s.home_rad, s.home_rad);
  set(Input::probe_2, joint_rad >= s.probe_2_rad, s.probe_2_rad);
  watch_index(s.turn_rad, joint_rad);
  if (!known_) edges_ = {};
  known_ = true;
  last_rad_ = joint_rad;
}

void Inputs::set(Input input, bool active, double position_rad) {
  const auto i = static_cast<std::size_t>(input);
  edges_[i] = {.rising = active && !active_[i], .falling = !active && active_[i], .position_rad = position_rad};
  active_[i] = active;
}

/// The first pulse on the way from the last position.
void Inputs::watch_index(double turn_rad, double joint_rad) {
  const double before = std::floor(last_rad_ / turn_rad), now = std::floor(joint_rad / turn_rad);
  if (now == before) return;
  edges_[static_cast<std::size_t>(Input::index)] = {.rising = true,
                                                    .position_rad = (now > before ? before + 1 : before) * turn_rad};
}

}  // namespace tribotwin::hil
