#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/experiments/sweep/output.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::sweep {
namespace {

using nlohmann::json;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

constexpr FigureInfo figure_table[] = {
    {"max", Figure::max, false, "largest value"},
    {"min", Figure::min, false, "smallest value"},
    {"max_abs", Figure::max_abs, false, "largest magnitude"},
    {"mean", Figure::mean, false, "mean over time"},
    {"rms", Figure::rms, false, "root of the mean square over time"},
    {"time_above", Figure::time_above, true, "time above the threshold [s]"},
    {"time_below", Figure::time_below, true, "time below the threshold [s]"},
};

/// Not the same for two runs of the same scenario.
constexpr std::string_view of_this_machine[] = {"wall_s", "realtime_factor"};

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts{""};
  for (const char c : text)
    if (c == at)
      parts.emplace_back();
    else
      parts.back() += c;
  return parts;
}

/// The entry of a list with this name, or with this number.
const json* entry(const json& list, const std::string& key) {
  for (const auto& one : list)
    if (one.is_object() && one.contains("name") && one["name"] == key) return &one;
  const auto index = to_number(key);
  return index && *index >= 0 && *index < static_cast<double>(list.size()) && *index == std::floor(*index)
             ? &list[static_cast<std::size_t>(*index)]
             : nullptr;
}

/// "; did you mean ...?" or what there is.
std::string choices(const json& at) {
  std::vector<std::string> names;
  if (at.is_object())
    for (const auto& [key, value] : at.items()) names.push_back(key);
  else if (at.is_array())
    for (const auto& one : at) names.push_back(one.is_object() ? one.value("name", "") : "");
  std::erase(names, "");
  return names.empty() ? " (nothing lies below it)" : "; there is " + joined(names);
}

const json* below(const json& at, const std::string& key) {
  if (at.is_array()) return entry(at, key);
  return at.is_object() && at.contains(key) ? &at[key] : nullptr;
}

/// Numbers of a summary that are never negative, by the last key of their path.
constexpr std::string_view never_negative[] = {
    "heat_J",  "rms",     "clamped_samples",    "mae_mrad", "baseline_mae_mrad",
    "l1_mrad", "stuck_s", "standstill_pp_mrad", "steps",    "steps_computed"};

/// What the value of an output can be.
Range range_of(const Output& out, const Scenario& scenario) {
  Range range;
  const auto is = [&](const auto&... figures) { return out.path.empty() && ((out.figure == figures) || ...); };
  const bool time = is(Figure::time_above, Figure::time_below) || (!out.path.empty() && out.path.back() == "stuck_s");
  if (time || is(Figure::rms, Figure::max_abs) ||
      (!out.path.empty() && std::ranges::find(never_negative, out.path.back()) != std::end(never_negative)))
    range.low = 0;
  if (!time) return range;
  range.high = scenario.duration_s;
  // What is known per work cycle is known of whole ones.
  if (const double period_s = out.signal.of_cycles ? scenario.motion->period_s() : 0; period_s > 0)
    range.high = std::floor(scenario.duration_s / period_s + 1e-9) * period_s;
  return range;
}

/// The number at a path. Fails with what would be right.
Result<double> number_at(const json& summary, const std::vector<std::string>& path) {
  const json* at = &summary;
  std::string so_far;
  for (const auto& key : path) {
    const json* next = below(*at, key);
    if (!next)
      return tl::unexpected(Error(fmt::format("'{}' is not in {} of a summary{}", key,
                                              so_far.empty() ? "the root" : "'" + so_far + "'", choices(*at))));
    at = next, so_far += (so_far.empty() ? "" : ".") + key;
  }
  if (at->is_number() || at->is_boolean())
    return at->is_boolean() ? static_cast<double>(at->get<bool>()) : at->get<double>();
  return tl::unexpected(
      Error(fmt::format("'{}' of a summary is no number{}", so_far, at->is_structured() ? choices(*at) : "")));
}

Result<Output> path_output(Output out, const std::string& expression, const Scenario& scenario,
                           const Summary& summary) {
  out.path = split(expression, '.');
  if (std::ranges::find(of_this_machine, out.path[0]) != std::end(of_this_machine))
    return tl::unexpected(Error(fmt::format("'{}' is a property of the computer, not of the run", out.path[0])));
  json known = parse_json(summary_json(summary));
  if (scenario.baseline) known["comparison"] = {{"mae_mrad", 0}, {"baseline_mae_mrad", 0}};
  if (const auto number = number_at(known, out.path); !number) return tl::unexpected(number.error());
  out.range = range_of(out, scenario);
  return out;
}

}  // namespace

std::span<const FigureInfo> figures() { return figure_table; }

Result<Signal> find_signal(const std::string& name, const Scenario& scenario) {
  const auto dot = name.rfind('.');
  if (dot == name.npos || dot == 0 || dot + 1 == name.size())
    return tl::unexpected(Error(fmt::format("'{}' must be JOINT.CHANNEL, for example joint2.temperature_degC", name)));
  const auto drive = find_drive(*scenario.model, name.substr(0, dot));
  if (!drive) return tl::unexpected(Error(drive.error().message));
  const bool repeats = scenario.motion && scenario.motion->period_s() > 0;
  std::vector<std::string> names;
  const auto plain = channels(*scenario.model), cycles = cycle_channels();
  for (const auto& channel : plain) names.push_back(channel.name);
  for (const auto& channel : cycles) names.push_back(channel.name);
  const std::string channel = name.substr(dot + 1);
  const auto found = std::ranges::find(names, channel);
  if (found == names.end())
    return tl::unexpected(Error(fmt::format("'{}' is no channel of telemetry{}; there is {}", channel,
                                            did_you_mean(channel, names), joined(names))));
  const auto index = static_cast<std::size_t>(found - names.begin());
  const bool of_cycles = index >= plain.size();
  if (of_cycles && !repeats)
    return tl::unexpected(
        Error(fmt::format("'{}' is known per work cycle, but the motion of the scenario does not repeat", channel)));
  if (!of_cycles && scenario.multirate.enabled)
    return tl::unexpected(Error(fmt::format(
        "'{}' is not known at all times, because a multi-rate run skips work cycles; take one of {}, or set "
        "multirate.enabled: false",
        channel, joined(std::span<const std::string>(names).subspan(plain.size())))));
  return Signal{name, *drive, of_cycles ? index - plain.size() : index, of_cycles};
}

Result<Output> parse_output(const std::string& name, const std::string& expression, const Scenario& scenario,
                            const Summary& summary) {
  Output out{.name = name, .path = {}, .signal = {}};
  const auto open = expression.find('(');
  if (open == expression.npos) return path_output(std::move(out), expression, scenario, summary);
  const std::string figure(trimmed(std::string_view(expression).substr(0, open)));
  const auto info = std::ranges::find(figure_table, figure, &FigureInfo::name);
  std::vector<std::string_view> known;
  for (const auto& f : figure_table) known.push_back(f.name);
  if (info == std::end(figure_table))
    return tl::unexpected(Error(fmt::format("'{}' is no figure of telemetry; did you mean '{}'? There is {}", figure,
                                            nearest(figure, known), joined(known))));
  if (expression.back() != ')') return tl::unexpected(Error("must end with ')'"));
  const auto arguments = split(expression.substr(open + 1, expression.size() - open - 2), ',');
  if (arguments.size() != (info->with_threshold ? 2u : 1u))
    return tl::unexpected(
        Error(fmt::format("must be {}(JOINT.CHANNEL{})", info->name, info->with_threshold ? ", THRESHOLD" : "")));
  auto signal = find_signal(std::string(trimmed(arguments[0])), scenario);
  if (!signal) return tl::unexpected(signal.error());
  out.figure = info->figure;
  out.signal = std::move(*signal);
  out.range = range_of(out, scenario);
  if (!info->with_threshold) return out;
  const auto threshold = to_number(trimmed(arguments[1]));
  if (!threshold || !std::isfinite(*threshold))
    return tl::unexpected(Error(fmt::format("has the threshold '{}', which must be a number", trimmed(arguments[1]))));
  out.threshold = *threshold;
  return out;
}

Collector::Collector(const Scenario& scenario, std::span<const Output> outputs, std::span<const Signal> bands,
                     std::span<const double> times_s)
    : scenario_(scenario),
      outputs_(outputs),
      bands_(bands),
      times_s_(times_s),
      sums_(outputs.size(),
            Sum{.max = -std::numeric_limits<double>::infinity(), .min = std::numeric_limits<double>::infinity()}),
      tracks_(bands.size()),
      values_(bands.size(), std::vector<double>(times_s.size(), nan)),
      row_(scenario.model->drives().size() * channels(*scenario.model).size()),
      sample_s_(static_cast<double>(steps_per_sample(scenario)) * scenario.model->get()->opt.timestep) {
  // The temperature before the first work cycle is known too.
  for (std::size_t b = 0; b < bands.size(); ++b)
    if (bands[b].of_cycles && cycle_channels()[bands[b].channel].name == "cycle_temperature_degC")
      follow(b, 0, scenario.temperature_degC[bands[b].drive]);
}

void Collector::listen(RunOptions& options) {
  const bool cycles =
      std::ranges::any_of(bands_, &Signal::of_cycles) ||
      std::ranges::any_of(outputs_, [](const Output& o) { return o.path.empty() && o.signal.of_cycles; });
  const bool samples =
      std::ranges::any_of(bands_, [](const Signal& s) { return !s.of_cycles; }) ||
      std::ranges::any_of(outputs_, [](const Output& o) { return o.path.empty() && !o.signal.of_cycles; });
  if (samples)
    options.sample = [this](const Twin& twin, double time_s) {
      read_channels(twin, row_);
      add(false, time_s, std::min(sample_s_, scenario_.duration_s - time_s), row_,
          row_.size() / scenario_.model->drives().size());
    };
  if (cycles)
    options.cycle = [this](double time_s, std::span<const CycleSample> drives) {
      cycle_row_.clear();
      for (const CycleSample& drive : drives) add_channels(drive, cycle_row_);
      add(true, time_s, time_s - std::exchange(last_cycle_s_, time_s), cycle_row_, cycle_row_.size() / drives.size());
    };
}

void Collector::add(bool of_cycles, double time_s, double duration_s, std::span<const double> row, std::size_t width) {
  for (std::size_t o = 0; o < outputs_.size(); ++o) {
    const Output& out = outputs_[o];
    if (!out.path.empty() || out.signal.of_cycles != of_cycles) continue;
    const double x = row[out.signal.drive * width + out.signal.channel];
    Sum& s = sums_[o];
    s.max = std::max(s.max, x), s.min = std::min(s.min, x), s.max_abs = std::max(s.max_abs, std::abs(x));
    s.integral += x * duration_s, s.square += x * x * duration_s, s.time_s += duration_s;
    if (out.figure == Figure::time_above ? x > out.threshold : x < out.threshold) s.beyond_s += duration_s;
  }
  for (std::size_t b = 0; b < bands_.size(); ++b)
    if (bands_[b].of_cycles == of_cycles) follow(b, time_s, row[bands_[b].drive * width + bands_[b].channel]);
}

void Collector::follow(std::size_t band, double time_s, double value) {
  Track& track = tracks_[band];
  const double rounding = 1e-9 * std::max(1.0, time_s);
  for (; track.next < times_s_.size() && times_s_[track.next] <= time_s + rounding; ++track.next) {
    const double t = times_s_[track.next];
    if (std::abs(t - time_s) <= rounding)
      values_[band][track.next] = value;
    else if (track.begun && time_s > track.time_s)
      values_[band][track.next] = track.value + (value - track.value) * (t - track.time_s) / (time_s - track.time_s);
  }
  track.time_s = time_s, track.value = value, track.begun = true;
}

std::vector<double> Collector::outputs(const Summary& summary) const {
  std::vector<double> all;
  const json whole = parse_json(summary_json(summary));
  for (std::size_t o = 0; o < outputs_.size(); ++o) {
    const Output& out = outputs_[o];
    const Sum& s = sums_[o];
    if (!out.path.empty())
      all.push_back(number_at(whole, out.path).value_or(nan));
    else if (s.time_s <= 0)
      all.push_back(nan);
    else
      switch (out.figure) {
        case Figure::max:
          all.push_back(s.max);
          break;
        case Figure::min:
          all.push_back(s.min);
          break;
        case Figure::max_abs:
          all.push_back(s.max_abs);
          break;
        case Figure::mean:
          all.push_back(s.integral / s.time_s);
          break;
        case Figure::rms:
          all.push_back(std::sqrt(s.square / s.time_s));
          break;
        case Figure::time_above:
        case Figure::time_below:
          all.push_back(s.beyond_s);
          break;
      }
  }
  return all;
}

}  // namespace tribotwin::twin::sweep
