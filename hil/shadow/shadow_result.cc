#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/hil/shadow/shadow.hpp>

namespace tribotwin::hil {
namespace {

std::string residuals(const ShadowJoint& j) {
  if (j.samples == 0) return fmt::format("{:>14} {:>14} {:>14} {:>9}", "-", "-", "-", "-");
  return fmt::format("{:>14.4g} {:>14.4g} {:>14.4g} {:>9.1f}", j.residual_mean_nm, j.residual_rms_nm, j.residual_max_nm,
                     1e3 * j.lag_s);
}

/// "0.23 .. 7.90 s; not judged: 120 not enabled": what the residuals hold for.
std::string range(const ShadowJoint& j) {
  std::string s = j.samples ? fmt::format("{:.2f} .. {:.2f} s", j.judged_from_s, j.judged_to_s) : "never";
  std::string why;
  for (const auto& [count, reason] : {std::pair{j.not_enabled, "not enabled"},
                                      {j.torque_missing, "without torques"},
                                      {j.position_missing, "without its positions"}})
    if (count > 0) why += fmt::format("{}{} {}", why.empty() ? "; not judged: " : ", ", count, reason);
  return s + why;
}

}  // namespace

bool ShadowResult::exceeded() const { return std::ranges::any_of(joints, &ShadowJoint::exceeded); }

std::string ShadowResult::table() const {
  std::string s =
      fmt::format("{:.2f} s, cycle {:.4g} ms ({})\n{:<12} {:>8} {:>14} {:>14} {:>14} {:>9} {:>12} {:>13}  {}\n",
                  seconds, 1e3 * cycle_s, cycle_source, "joint", "samples", "mean [Nm]", "RMS [Nm]", "largest [Nm]",
                  "lag [ms]", "lubricant", "lost q/torque", "judged");
  for (const auto& j : joints)
    s += fmt::format("{:<12} {:>8} {} {:>7.2f} degC {:>13}  {}{}\n", j.name, j.samples, residuals(j),
                     j.temperature_degC, fmt::format("{}/{}", j.positions_lost, j.torques_lost), range(j),
                     j.exceeded ? "; limit exceeded" : "");
  return s;
}

}  // namespace tribotwin::hil
