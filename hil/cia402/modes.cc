#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/cia402/cyclic_modes.hpp>
#include <tribotwin/hil/cia402/modes.hpp>

namespace tribotwin::hil {
namespace {

constexpr ModeOfOperation modes[] = {
    {.number = 1,
     .name = "PP",
     .target = od::target_position,
     .needs = {od::position_window, od::position_window_time, od::software_position_limit, od::max_profile_velocity,
               od::max_motor_speed, od::profile_velocity, od::end_velocity, od::profile_acceleration,
               od::profile_deceleration, od::motion_profile_type, od::profile_jerk, od::max_acceleration,
               od::max_deceleration},
     .follows_demand = true,
     .set_points = SetPoints::on_request,
     .enter = profile_position::enter,
     .resume = profile_position::resume,
     .control = profile_position::control,
     .command = profile_position::command,
     .observe = profile_position::observe,
     .status = profile_position::status},
    {.number = 3,
     .name = "PV",
     .target = od::target_velocity,
     .needs = {od::velocity_window, od::velocity_window_time, od::velocity_threshold, od::velocity_threshold_time,
               od::software_position_limit, od::max_profile_velocity, od::max_motor_speed, od::profile_acceleration,
               od::profile_deceleration, od::motion_profile_type, od::profile_jerk, od::max_acceleration,
               od::max_deceleration},
     .set_points = SetPoints::rare,
     .command = profile_velocity::command,
     .observe = profile_velocity::observe,
     .status = profile_velocity::status},
    {.number = 6,
     .name = "HM",
     .target = 0,
     .needs = {od::home_offset, od::homing_method, od::homing_speeds, od::homing_acceleration, od::max_motor_speed,
               od::velocity_threshold, od::simulated_switches},
     .follows_demand = true,
     .set_points = SetPoints::on_request,
     .resume = homing::resume,
     .control = homing::control,
     .command = homing::command,
     .observe = homing::observe,
     .status = homing::status},
    {.number = 7,
     .name = "IP",
     .target = od::interpolation_data_record,
     .needs = {od::interpolation_submode, od::interpolation_time_period, od::software_position_limit,
               od::max_motor_speed, od::profile_deceleration, od::max_deceleration, od::motion_profile_type,
               od::profile_jerk},
     .follows_demand = true,
     .enter = cyclic::ip_enter,
     .resume = cyclic::ip_resume,
     .control = cyclic::ip_control,
     .target_written = cyclic::ip_target,
     .command = cyclic::ip,
     .status = cyclic::ip_status},
    {.number = 8,
     .name = "CSP",
     .target = od::target_position,
     .needs = {od::velocity_offset, od::torque_offset, od::software_position_limit, od::max_motor_speed,
               od::interpolation_time_period},
     .follows_demand = true,
     .target_written = cyclic::csp_target,
     .command = cyclic::csp,
     .status = cyclic::status},
    {.number = 9,
     .name = "CSV",
     .target = od::target_velocity,
     .needs = {od::velocity_offset, od::torque_offset, od::software_position_limit, od::max_motor_speed},
     .command = cyclic::csv,
     .status = cyclic::status},
    {.number = 10,
     .name = "CST",
     .target = od::target_torque,
     .needs = {od::torque_offset, od::max_motor_speed},
     .command = cyclic::cst,
     .status = cyclic::status},
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

// index, sub, standing_counts
constexpr Target all_targets[] = {{od::target_position, 0, standing_position},
                                  {od::interpolation_data_record, 1, standing_position},
                                  {od::target_velocity, 0, standing_velocity},
                                  {od::target_torque, 0, standing_torque}};

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
