#include <tribotwin/twin/identification/thermal_recording.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/identification/time_series.hpp>
#include <tribotwin/twin/table/table.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr double session_gap_s = 3600;
constexpr std::size_t most_samples = 5000, fewest_samples = 20;

/// Column of a joint's power, or of the two that make it: torque and speed, or torque and position.
struct Source {
  std::string power, torque, speed, position;
};

std::optional<Source> source_of(const std::vector<std::string>& names, const std::string& joint) {
  const auto first_of = [&](std::initializer_list<std::string> choices) {
    for (const auto& name : choices)
      if (std::ranges::find(names, name) != names.end()) return name;
    return std::string();
  };
  Source s{.power = first_of({fmt::format("power_w_{}", joint)})};
  if (!s.power.empty()) return s;
  s.torque = first_of({fmt::format("torque_{}_nm", joint), fmt::format("torque_{}_n", joint)});
  s.speed = first_of({fmt::format("velocity_{}_rad_s", joint), fmt::format("velocity_{}_m_s", joint)});
  if (s.speed.empty()) s.position = first_of({fmt::format("position_{}_rad", joint), fmt::format("position_{}_m", joint)});
  if (s.torque.empty() || (s.speed.empty() && s.position.empty())) return std::nullopt;
  return s;
}

/// Work of each interval over its length, [0] unused.
std::vector<double> mean_power(const std::vector<double>& time, const Numbers& numbers, const Source& source) {
  const auto column = [&](const std::string& name) -> const std::vector<double>& {
    static const std::vector<double> none;
    const auto at = std::ranges::find(numbers.names, name);
    return at == numbers.names.end() ? none : numbers.columns[static_cast<std::size_t>(at - numbers.names.begin())];
  };
  const auto &power = column(source.power), &torque = column(source.torque), &speed = column(source.speed), &position = column(source.position);
  std::vector<double> mean(time.size(), 0.0);
  for (std::size_t i = 1; i < time.size(); ++i) {
    if (!power.empty()) mean[i] = (power[i - 1] + power[i]) / 2;
    else if (!speed.empty()) mean[i] = (torque[i - 1] * speed[i - 1] + torque[i] * speed[i]) / 2;
    else mean[i] = (torque[i - 1] + torque[i]) / 2 * (position[i] - position[i - 1]) / (time[i] - time[i - 1]);
  }
  return mean;
}

/// Across gaps: the mean of the stretches before and after.
void bridge_gaps(std::vector<double>& power, const std::vector<double>& time, const std::vector<std::size_t>& gaps) {
  const auto stretch_mean = [&](std::size_t first, std::size_t last) {   // first sample, past the last one
    double work = 0;
    for (std::size_t i = first + 1; i < last; ++i) work += power[i] * (time[i] - time[i - 1]);
    return last - first > 1 ? work / (time[last - 1] - time[first]) : power[std::max<std::size_t>(first, 1)];
  };
  std::vector<double> bridged;
  for (std::size_t g = 0; g < gaps.size(); ++g) {
    const std::size_t before = g ? gaps[g - 1] : 0, after = g + 1 < gaps.size() ? gaps[g + 1] : time.size();
    bridged.push_back((stretch_mean(before, gaps[g]) + stretch_mean(gaps[g], after)) / 2);
  }
  for (std::size_t g = 0; g < gaps.size(); ++g) power[gaps[g]] = bridged[g];
}

/// Samples first..past, averaged in groups within `width_s`. A group's time is the mean of its samples'; the power between two
/// such times is the work in between.
HeatSession averaged(std::size_t file, const std::vector<double>& time, const std::vector<double>& power, const std::vector<double>& temperature, std::size_t first, std::size_t past, double width_s) {
  HeatSession out{.file = file};
  std::vector<double> work(past - first, 0.0);   // since the first sample
  for (std::size_t i = first + 1; i < past; ++i) work[i - first] = work[i - first - 1] + power[i] * (time[i] - time[i - 1]);
  double last_work = 0;
  for (std::size_t begin = first, end; begin < past; begin = end) {
    double t = 0, w = 0, T = 0;
    for (end = begin; end < past && (end == begin || time[end] < time[begin] + width_s); ++end) t += time[end] - time[begin], w += work[end - first], T += temperature[end];
    const auto n = static_cast<double>(end - begin);
    t = time[begin] + t / n, w /= n;
    out.power_w.push_back(out.time_s.empty() ? 0 : (w - last_work) / (t - out.time_s.back()));
    out.time_s.push_back(t);
    out.temperature_degC.push_back(T / n);
    last_work = w;
  }
  return out;
}

}  // namespace

tl::expected<ThermalRecording, std::string> read_thermal_recording(const std::filesystem::path& file, std::size_t index, double cycle_s) {
  const auto header = read_numbers(file, {"time_s"});
  if (!header) return tl::unexpected(header.error());
  if (header->columns[0].empty()) return tl::unexpected(fmt::format("{}:1: no column 'time_s' with numbers; its header names: {}", file.string(), fmt::join(header->names, ", ")));
  ThermalRecording out{.file = file};
  std::vector<Source> sources;
  std::vector<std::string> wanted{"time_s"};
  constexpr std::string_view prefix = "temperature_", suffix = "_degC";
  for (const auto& name : header->names) {
    if (!name.starts_with(prefix) || !name.ends_with(suffix) || name.size() <= prefix.size() + suffix.size()) continue;
    const std::string joint = name.substr(prefix.size(), name.size() - prefix.size() - suffix.size());
    const auto source = source_of(header->names, joint);
    if (!source) return tl::unexpected(fmt::format("{0}:1: {1} needs power_w_{2}, or torque_{2}_nm with velocity_{2}_rad_s or position_{2}_rad; its header names: {3}", file.string(), name, joint, fmt::join(header->names, ", ")));
    out.joints.push_back({.name = joint});
    sources.push_back(*source);
    wanted.push_back(name);
    for (const auto& column : {source->power, source->torque, source->speed, source->position})
      if (!column.empty()) wanted.push_back(column);
  }
  if (out.joints.empty()) return tl::unexpected(fmt::format("{}:1: no column temperature_JOINT_degC; its header names: {}", file.string(), fmt::join(header->names, ", ")));
  auto numbers = read_numbers(file, wanted);
  if (!numbers) return tl::unexpected(numbers.error());
  numbers->names = wanted;   // one name per column that was kept
  const auto& time = numbers->columns[0];
  if (time.size() < fewest_samples) return tl::unexpected(fmt::format("{}: {} rows of finite numbers; at least {} are needed", file.string(), time.size(), fewest_samples));
  if (numbers->left_out) out.notes.push_back(fmt::format("{}: {} rows with empty, NaN or infinite cells are gaps, the first in line {}", file.string(), numbers->left_out, numbers->first_left_out));
  std::vector<double> steps;
  for (std::size_t i = 1; i < time.size(); ++i) {
    if (!(time[i] > time[i - 1])) return tl::unexpected(fmt::format("{}: time_s {} in row {} does not come after {}", file.string(), time[i], i + 1, time[i - 1]));
    steps.push_back(time[i] - time[i - 1]);
  }
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  const double typical = *middle;
  std::vector<std::size_t> gaps, starts{0};
  double recorded_s = time.back() - time.front();
  for (std::size_t i = 1; i < time.size(); ++i) {
    const double step = time[i] - time[i - 1];
    if (step <= 2.5 * typical) continue;
    gaps.push_back(i);
    if (step <= session_gap_s) continue;
    starts.push_back(i);
    recorded_s -= step;
    out.notes.push_back(fmt::format("{}: {:.2g} h without samples before {:.6g} s; what follows begins anew", file.string(), step / 3600, time[i]));
  }
  starts.push_back(time.size());
  for (std::size_t j = 0; j < out.joints.size(); ++j) {
    const std::string column = fmt::format("{}{}{}", prefix, out.joints[j].name, suffix);
    const auto& temperature = numbers->columns[static_cast<std::size_t>(std::ranges::find(wanted, column) - wanted.begin())];
    if (auto problem = implausible_temperature(file, column, temperature)) return tl::unexpected(std::move(*problem));
    const auto [low, high] = std::ranges::minmax(temperature);
    if (!(high > low)) return tl::unexpected(fmt::format("{}: {} is always {:.4g}; a thermal model is told by warming or cooling", file.string(), column, low));
    auto power = mean_power(time, *numbers, sources[j]);
    bridge_gaps(power, time, gaps);
    for (std::size_t s = 0; s + 1 < starts.size(); ++s) {
      if (starts[s + 1] - starts[s] < fewest_samples) continue;
      out.joints[j].sessions.push_back(averaged(index, time, power, temperature, starts[s], starts[s + 1], std::max(cycle_s, recorded_s / most_samples)));
    }
    if (out.joints[j].sessions.empty()) return tl::unexpected(fmt::format("{}: no {} rows without an hour's gap", file.string(), fewest_samples));
  }
  return out;
}

}  // namespace tribotwin::twin::identification
