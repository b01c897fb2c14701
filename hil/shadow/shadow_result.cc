#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/hil/shadow/shadow.hpp>
#include <tribotwin/twin/io/text_table.hpp>

namespace tribotwin::hil {
namespace {

std::string figure(const ShadowJoint& j, double x) { return j.samples ? fmt::format("{:.4g}", x) : "-"; }

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
  constexpr auto left = twin::TextTable::left, right = twin::TextTable::right;
  twin::TextTable table{{left("joint"), right("samples"), right("mean [Nm]"), right("RMS [Nm]"), right("largest [Nm]"),
                         right("lag [ms]"), right("lubricant"), right("lost q/torque"), left("judged")}};
  for (const auto& j : joints)
    table.add({j.name, fmt::format("{}", j.samples), figure(j, j.residual_mean_nm), figure(j, j.residual_rms_nm),
               figure(j, j.residual_max_nm), j.samples ? fmt::format("{:.1f}", 1e3 * j.lag_s) : "-",
               fmt::format("{:.2f} degC", j.temperature_degC), fmt::format("{}/{}", j.positions_lost, j.torques_lost),
               range(j) + (j.exceeded ? "; limit exceeded" : "")});
  return fmt::format("{:.2f} s, cycle {:.4g} ms ({})\n", seconds, 1e3 * cycle_s, cycle_source) + table.text();
}

}  // namespace tribotwin::hil
