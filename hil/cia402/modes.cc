#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/cia402/modes.hpp>

namespace tribotwin::hil {
namespace {

using twin::DriveCommand;

/// Cyclic synchronous position (CiA 402-2): straight lines over the interpolation time 60C2h, within 607Dh, 6080h.
void csp_target(Demand& demand, const DriveObjects& o) {
  const auto target = std::clamp(o.target_position->value, o.position_limit_low->value, o.position_limit_high->value);
  const double speed_max = o.speed_max_rad_s();
  demand.left_s = o.interpolation_s();
  demand.step_rad_s = std::clamp((o.position_rad(target) - demand.position_rad) / demand.left_s, -speed_max, speed_max);
}

DriveCommand csp(Demand& demand, const DriveObjects& o, const Feedback&, double dt) {
  DriveCommand c{.mode = DriveCommand::Mode::position};
  const double step = std::min(dt, demand.left_s);
  demand.position_rad += demand.step_rad_s * step;
  c.velocity_rad_s = (demand.left_s > 0 ? demand.step_rad_s : 0) + o.velocity_rad_s(o.velocity_offset);
  demand.left_s = std::max(0.0, demand.left_s - dt);
  c.position_rad = demand.position_rad;
  c.torque_nm = o.torque_nm(o.torque_offset);
  return c;
}

/// Cyclic synchronous velocity (CiA 402-2): stops at the position limits 607Dh.
DriveCommand csv(Demand&, const DriveObjects& o, const Feedback& feedback, double) {
  DriveCommand c{.mode = DriveCommand::Mode::velocity};
  const double speed_max = o.speed_max_rad_s();
  double speed =
      std::clamp(o.velocity_rad_s(o.target_velocity) + o.velocity_rad_s(o.velocity_offset), -speed_max, speed_max);
  const double low = o.position_rad(o.position_limit_low), high = o.position_rad(o.position_limit_high);
  if ((feedback.position_rad >= high && speed > 0) || (feedback.position_rad <= low && speed < 0)) speed = 0;
  c.velocity_rad_s = speed;
  c.torque_nm = o.torque_nm(o.torque_offset);
  return c;
}

/// Cyclic synchronous torque (CiA 402-2). When the next step would be faster than 6080h and the target does not slow it
/// down, the speed loop takes over and holds that speed, until the target asks for less torque in this direction than
/// the loop does.
DriveCommand cst(Demand& demand, const DriveObjects& o, const Feedback& feedback, double) {
  const double torque = o.torque_nm(o.target_torque) + o.torque_nm(o.torque_offset);
  const double speed_max = o.speed_max_rad_s(), speed = feedback.velocity_rad_s;
  const double next = 2 * speed - demand.speed_rad_s;
  const bool slows_down = torque * next < 0 && std::abs(next) <= std::abs(speed);
  demand.speed_rad_s = speed;
  if (demand.limited_way != 0 && demand.limited_way * (torque - feedback.torque_nm) < 0)
    demand.limited_way = 0;
  else if (demand.limited_way == 0 && std::abs(next) > speed_max && !slows_down)
    demand.limited_way = next > 0 ? 1 : -1;
  if (demand.limited_way == 0) return {.mode = DriveCommand::Mode::torque, .torque_nm = torque};
  return {.mode = DriveCommand::Mode::velocity, .velocity_rad_s = demand.limited_way * speed_max};
}

// number, name, target, needs, follows_demand, target_written, command
constexpr ModeOfOperation modes[] = {
    {8,
     "CSP",
     od::target_position,
     {od::velocity_offset, od::torque_offset, od::software_position_limit, od::max_motor_speed,
      od::interpolation_time_period},
     true,
     csp_target,
     csp},
    {9,
     "CSV",
     od::target_velocity,
     {od::velocity_offset, od::torque_offset, od::software_position_limit, od::max_motor_speed},
     false,
     nullptr,
     csv},
    {10, "CST", od::target_torque, {od::torque_offset, od::max_motor_speed}, false, nullptr, cst},
};

std::int64_t standing_position(const DriveObjects& o, const Feedback& f, bool) {
  return std::llround(f.position_rad / o.increment_rad);
}
std::int64_t standing_velocity(const DriveObjects& o, const Feedback& f, bool moving) {
  return moving ? std::llround(f.velocity_rad_s / o.milli_rpm_rad_s) : 0;
}
std::int64_t standing_torque(const DriveObjects& o, const Feedback& f, bool) {
  return std::llround(f.torque_nm / o.per_mille_nm);
}

// index, standing_counts
constexpr Target all_targets[] = {{od::target_position, standing_position},
                                  {od::target_velocity, standing_velocity},
                                  {od::target_torque, standing_torque}};

/// Names of the modes for which `chosen` holds.
template <class Predicate>
std::vector<std::string> names(Predicate chosen) {
  std::vector<std::string> all;
  for (const auto& mode : modes)
    if (chosen(mode)) all.emplace_back(mode.name);
  return all;
}

}  // namespace

std::span<const ModeOfOperation> modes_of_operation() { return modes; }

const ModeOfOperation* find_mode(std::int64_t number) {
  const auto found = std::ranges::find(modes, number, &ModeOfOperation::number);
  return found == std::end(modes) ? nullptr : found;
}

std::span<const Target> targets() { return all_targets; }

std::string mode_numbers() {
  std::vector<std::string> all{fmt::format("{} none", no_mode)};
  for (const auto& mode : modes) all.push_back(fmt::format("{} {}", mode.number, mode.name));
  return fmt::format("{}", fmt::join(all, ", "));
}

std::int64_t supported_modes() {
  std::int64_t bits = 0;
  for (const auto& mode : modes) bits |= std::int64_t{1} << (mode.number - 1);
  return bits;
}

std::string mode_names() {
  return fmt::format("{}", fmt::join(names([](const auto&) { return true; }), ", "));
}

std::string modes_with_target(std::uint16_t index) {
  return fmt::format("{}", fmt::join(names([&](const auto& mode) { return mode.target == index; }), ", "));
}

std::string modes_that_add(std::uint16_t index) {
  const auto some = names([&](const auto& mode) { return std::ranges::find(mode.needs, index) != mode.needs.end(); });
  if (some.size() == std::size(modes)) return "added in every mode";
  const std::span all_but_last(some.begin(), some.empty() ? some.end() : some.end() - 1);
  return all_but_last.empty() ? fmt::format("added in {}", fmt::join(some, ""))
                              : fmt::format("added in {} and {}", fmt::join(all_but_last, ", "), some.back());
}

}  // namespace tribotwin::hil
