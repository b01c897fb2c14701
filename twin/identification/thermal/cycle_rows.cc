#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/twin/identification/thermal/cycle_rows.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr std::size_t max_rows = 5000;
constexpr double least_rise_K = 1e-3;

/// Rows `every` cycles apart: the power between two rows is the mean of the cycles between them, exactly.
HeatSession session_of(const Recording& record, const std::string& joint, std::size_t index, double cycle_s) {
  const auto power = record.channel(joint, "cycle_friction_power_W"),
             temperature = record.channel(joint, "cycle_temperature_degC");
  const auto& end_s = record.cycle_time_s;
  const std::size_t every = (end_s.size() + max_rows - 1) / max_rows;
  HeatSession out{.file = index, .cycle_s = cycle_s, .cycle_power_w = {}, .start_s = end_s[0] - (end_s[1] - end_s[0])};
  double from_s = *out.start_s, before_s = from_s, work_j = 0;
  for (std::size_t i = 0; i < end_s.size(); ++i) {
    work_j += power[i] * (end_s[i] - before_s);
    before_s = end_s[i];
    if ((i + 1) % every != 0) continue;
    out.time_s.push_back(end_s[i]);
    out.power_w.push_back(work_j / (end_s[i] - from_s));
    out.temperature_degC.push_back(temperature[i]);
    if (cycle_s > 0) out.cycle_power_w.push_back(out.power_w.back());
    from_s = end_s[i], work_j = 0;
  }
  return out;
}

}  // namespace

Result<std::optional<ThermalRecording>> cycle_rows(const std::filesystem::path& file, std::size_t index, double cycle_s,
                                                   std::size_t least_rows) {
  const auto path = record_of(file);
  if (!path) return std::nullopt;
  const auto record = read_telemetry(*path);
  if (!record) return tl::unexpected(record.error());
  if (record->cycle_time_s.size() < least_rows) return std::nullopt;
  ThermalRecording out{.file = file};
  out.notes.push_back(
      fmt::format("{}: the {} work cycles of the record are used, their mean friction power and "
                  "temperature, not its samples",
                  file.string(), record->cycle_time_s.size()));
  for (const auto& joint : record->joints) {
    const auto temperature = record->channel(joint, "cycle_temperature_degC");
    if (temperature.empty() || record->channel(joint, "cycle_friction_power_W").empty()) return std::nullopt;
    const auto [low, high] = std::ranges::minmax(temperature);
    if (high - low > least_rise_K)
      out.joints.push_back({.name = joint, .sessions = {session_of(*record, joint, index, cycle_s)}});
    else
      out.notes.push_back(
          fmt::format("{}: the temperature of {} is always {:.4g} degC; a thermal model is identified "
                      "from warming or cooling",
                      file.string(), joint, low));
  }
  if (out.joints.empty()) return tl::unexpected(Error(out.notes.back()));
  return out;
}

}  // namespace tribotwin::twin::identification
