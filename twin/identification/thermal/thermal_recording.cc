#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <span>

#include <fmt/format.h>

#include <tribotwin/twin/identification/thermal/cycle_rows.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>
#include <tribotwin/twin/identification/time_series.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::identification {
namespace {

/// A gap is bridged up to here: within repeated cycles, and without, where bodies of a gear keep their temperature.
constexpr double cycles_bridged_s = 3600, bridged_s = 60;
constexpr std::size_t max_samples = 5000, min_samples = 20;

/// Column of a joint's power, or the two whose product it is: torque and speed, or torque and position.
struct Source {
  std::string power, torque, speed, position;
};

std::optional<Source> source_of(const std::vector<std::string>& names, const std::string& joint) {
  const auto first_of = [&](std::initializer_list<std::string> choices) {
    for (const auto& name : choices)
      if (std::ranges::find(names, name) != names.end()) return name;
    return std::string();
  };
  Source s{.power = first_of({fmt::format("power_{}_w", joint)})};
  if (!s.power.empty()) return s;
  s.torque = first_of({fmt::format("torque_{}_nm", joint), fmt::format("torque_{}_n", joint)});
  s.speed = first_of({fmt::format("velocity_{}_rad_s", joint), fmt::format("velocity_{}_m_s", joint)});
  if (s.speed.empty())
    s.position = first_of({fmt::format("position_{}_rad", joint), fmt::format("position_{}_m", joint)});
  if (s.torque.empty() || (s.speed.empty() && s.position.empty())) return std::nullopt;
  return s;
}

/// Mean power of the interval before each sample; [0] is unused.
std::vector<double> mean_power(const std::vector<double>& time, const Numbers& numbers, const Source& source) {
  const auto column = [&](const std::string& name) -> const std::vector<double>& {
    static const std::vector<double> none;
    const auto at = std::ranges::find(numbers.names, name);
    return at == numbers.names.end() ? none : numbers.columns[static_cast<std::size_t>(at - numbers.names.begin())];
  };
  const auto &power = column(source.power), &torque = column(source.torque), &speed = column(source.speed),
             &position = column(source.position);
  std::vector<double> mean(time.size(), 0.0);
  for (std::size_t i = 1; i < time.size(); ++i) {
    if (!power.empty())
      mean[i] = (power[i - 1] + power[i]) / 2;
    else if (!speed.empty())
      mean[i] = (torque[i - 1] * speed[i - 1] + torque[i] * speed[i]) / 2;
    else
      mean[i] = (torque[i - 1] + torque[i]) / 2 * (position[i] - position[i - 1]) / (time[i] - time[i - 1]);
  }
  return mean;
}

/// Power across gaps: the mean of the stretches before and after.
void bridge_gaps(std::vector<double>& power, const std::vector<double>& time, const std::vector<std::size_t>& gaps) {
  const auto stretch_mean = [&](std::size_t first, std::size_t last) {  // first sample, past the last one
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

/// A piecewise linear curve through samples, and its integral.
class Curve {
 public:
  Curve(std::span<const double> time, std::vector<double> value)
      : time_(time), value_(std::move(value)), integral_(time.size(), 0.0) {
    for (std::size_t i = 1; i < time.size(); ++i)
      integral_[i] = integral_[i - 1] + (value_[i - 1] + value_[i]) / 2 * (time[i] - time[i - 1]);
  }
  double at(double t) const { return value_[before(t)] + slope(t) * (t - time_[before(t)]); }
  double mean(double from, double to) const { return (integral(to) - integral(from)) / (to - from); }

 private:
  /// First sample of the piece that t is in; the outermost pieces are extrapolated.
  std::size_t before(double t) const {
    const auto after = static_cast<std::size_t>(std::ranges::upper_bound(time_, t) - time_.begin());
    return std::clamp<std::size_t>(after, 1, time_.size() - 1) - 1;
  }
  double slope(double t) const {
    const std::size_t i = before(t);
    return (value_[i + 1] - value_[i]) / (time_[i + 1] - time_[i]);
  }
  double integral(double t) const {
    const std::size_t i = before(t);
    return integral_[i] + (value_[i] + at(t)) / 2 * (t - time_[i]);
  }

  std::span<const double> time_;
  std::vector<double> value_, integral_;
};

/// One session, averaged over windows of exactly `width_s` that begin with each stretch: a sample more or less of the
/// work that gravity stores within a cycle would count as heat. The power between the middles of two windows is the
/// work between them. Unchanged where windows are not longer than a step.
HeatSession averaged(std::size_t file, std::span<const double> time, std::span<const double> power,
                     std::span<const double> temperature, double step_s, double width_s, bool cycles) {
  if (!cycles && width_s <= step_s) {
    HeatSession out{.file = file,
                    .time_s = {time.begin(), time.end()},
                    .power_w = {power.begin(), power.end()},
                    .temperature_degC = {temperature.begin(), temperature.end()}};
    out.power_w.front() = 0;
    return out;
  }
  HeatSession out{.file = file, .cycle_s = cycles ? width_s : 0};
  std::vector<double> done(time.size(), 0.0);  // work since the first sample
  for (std::size_t i = 1; i < time.size(); ++i) done[i] = done[i - 1] + power[i] * (time[i] - time[i - 1]);
  const Curve work(time, std::move(done)),
      warmth(time, temperature.empty() ? std::vector<double>(time.size(), 0.0)
                                       : std::vector<double>(temperature.begin(), temperature.end()));
  double last_work = 0;
  for (std::size_t begin = 0, past = 0; begin < time.size();
       begin = past) {  // stretches; gaps do not matter where there are no cycles
    for (past = begin + 1; past < time.size() && (!cycles || time[past] - time[past - 1] <= gap_steps * step_s);)
      ++past;
    // The last sample of a cycle is a step before the next one's first.
    const double end = time[past - 1] + 1.001 * step_s;
    for (std::size_t k = 0;; ++k) {
      const double from = time[begin] + static_cast<double>(k) * width_s, to = from + width_s;
      if (to > end) break;
      const double middle = (from + to) / 2, mean_work = work.mean(from, to);
      if (cycles) out.cycle_power_w.push_back((work.at(to) - work.at(from)) / width_s);
      if (out.time_s.empty())
        out.power_w.push_back(0);
      else if (cycles && k == 0)  // the same cycle went on in the gap
        out.power_w.push_back((out.cycle_power_w.back() + out.cycle_power_w.end()[-2]) / 2);
      else
        out.power_w.push_back((mean_work - last_work) / (middle - out.time_s.back()));
      out.time_s.push_back(middle);
      if (!temperature.empty()) out.temperature_degC.push_back(warmth.mean(from, to));
      last_work = mean_work;
    }
  }
  return out;
}

/// Joints of the columns temperature_JOINT_degC, or, where there is none, power_JOINT_w and torque_JOINT_nm.
std::vector<std::string> joints_of(const std::vector<std::string>& header, bool with_temperature) {
  std::vector<std::string> joints;
  const std::vector<std::pair<std::string_view, std::string_view>> patterns =
      with_temperature ? std::vector<std::pair<std::string_view, std::string_view>>{{"temperature_", "_degC"}}
                       : std::vector<std::pair<std::string_view, std::string_view>>{
                             {"power_", "_w"}, {"torque_", "_nm"}, {"torque_", "_n"}};
  for (const auto& name : header)
    for (const auto& [prefix, suffix] : patterns)
      if (name.starts_with(prefix) && name.ends_with(suffix) && name.size() > prefix.size() + suffix.size())
        if (auto joint = name.substr(prefix.size(), name.size() - prefix.size() - suffix.size());
            std::ranges::find(joints, joint) == joints.end())
          joints.push_back(std::move(joint));
  return joints;
}

std::string temperature_column(const std::string& joint) { return fmt::format("temperature_{}_degC", joint); }

/// The joints of a file, and the columns that are read.
struct Layout {
  std::vector<std::string> joints, columns{"time_s"};
  std::vector<Source> sources;  ///< per joint
  bool with_temperature = false;
};

Result<Layout> layout_of(const std::filesystem::path& file, bool cycles, const OpenTable& table) {
  const auto header = table.header({"time_s"});
  if (!header) return tl::unexpected(header.error());
  if (!header->has("time_s"))
    return tl::unexpected(
        Error(fmt::format("{}:1: no column 'time_s'; its header names: {}", file.string(), header->header)));
  Layout out{.joints = joints_of(header->names, true)};
  out.with_temperature = !out.joints.empty();
  if (!out.with_temperature) out.joints = joints_of(header->names, false);
  if (!out.with_temperature && (!cycles || out.joints.empty()))
    return tl::unexpected(Error(fmt::format(
        "{}:1: no column temperature_JOINT_degC; without temperatures a thermal model is identified from working "
        "cycles only (--work-cycle, with power_JOINT_w, or torque_JOINT_nm and velocity_JOINT_rad_s or "
        "position_JOINT_rad); its header names: {}",
        file.string(), header->header)));
  for (const auto& joint : out.joints) {
    const auto source = source_of(header->names, joint);
    if (!source)
      return tl::unexpected(
          Error(fmt::format("{0}:1: joint {1} needs power_{1}_w, or torque_{1}_nm with velocity_{1}_rad_s or "
                            "position_{1}_rad; {2}its header names: {3}",
                            file.string(), joint, header->hint(fmt::format("torque_{}_nm", joint)), header->header)));
    out.sources.push_back(*source);
    for (const auto& column : {out.with_temperature ? temperature_column(joint) : std::string(), source->power,
                               source->torque, source->speed, source->position})
      if (!column.empty()) out.columns.push_back(column);
  }
  return out;
}

/// The time line: its typical step, gaps, and the sessions between gaps that are too long to be bridged.
struct Timeline {
  double typical_s = 0, recorded_s = 0;          ///< recorded: without those gaps
  std::vector<std::size_t> gaps, sessions{0};    ///< first sample after a gap; first of each session, then the end
  std::vector<double> long_gaps_s, stretches_s;  ///< between the sessions; of each session
};

Timeline timeline_of(const std::vector<double>& time, bool cycles) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < time.size(); ++i) steps.push_back(time[i] - time[i - 1]);
  Timeline out{.typical_s = median_of(steps), .recorded_s = time.back() - time.front()};
  for (std::size_t i = 1; i < time.size(); ++i) {
    const double step = time[i] - time[i - 1];
    if (step <= gap_steps * out.typical_s) continue;
    out.gaps.push_back(i);
    if (step <= (cycles ? cycles_bridged_s : std::max(bridged_s, 10 * out.typical_s))) continue;
    out.stretches_s.push_back(time[i - 1] - time[out.sessions.back()]);
    out.sessions.push_back(i);
    out.long_gaps_s.push_back(step);
    out.recorded_s -= step;
  }
  out.stretches_s.push_back(time.back() - time[out.sessions.back()]);
  out.sessions.push_back(time.size());
  return out;
}

/// What is done about gaps.
void note_gaps(const Timeline& line, const std::vector<double>& time, bool cycles, const std::string& file,
               std::vector<std::string>& notes) {
  double longest_s = 0;
  const std::size_t bridged = line.gaps.size() - line.long_gaps_s.size();
  for (const std::size_t i : line.gaps)
    if (const double step = time[i] - time[i - 1];
        line.long_gaps_s.empty() || step < std::ranges::min(line.long_gaps_s))
      longest_s = std::max(longest_s, step);
  if (bridged)
    notes.push_back(fmt::format("{}: {} gaps of up to {:.3g} s are bridged, {}", file, bridged, longest_s,
                                cycles ? "as if the same cycle went on" : "with the mean power on both sides"));
  if (line.long_gaps_s.size() > 3)
    notes.push_back(fmt::format("{}: {} gaps of up to {:.2g} h; a new session begins after each", file,
                                line.long_gaps_s.size(), std::ranges::max(line.long_gaps_s) / 3600));
  else
    for (std::size_t s = 1; s + 1 < line.sessions.size(); ++s)
      notes.push_back(fmt::format("{}: {:.2g} h without samples before {:.6g} s; a new session begins there", file,
                                  line.long_gaps_s[s - 1] / 3600, time[line.sessions[s]]));
}

/// Why the heat between stretches is not known: what a multi-rate run leaves of its samples.
std::optional<std::string> heat_unknown(const Timeline& line, bool cycles, const std::string& file) {
  if (cycles || line.long_gaps_s.size() < 3) return {};
  const double gap_s = median_of(line.long_gaps_s), stretch_s = median_of(line.stretches_s);
  if (stretch_s >= gap_s) return {};
  return fmt::format(
      "{}: {} gaps of {:.3g} s or so between stretches of {:.3g} s: the heat of the gaps is not recorded. Give the "
      "record of the run or its cycles.csv, where a multi-rate run has every cycle; or --work-cycle, if the same work "
      "cycle went on in the gaps; or record without gaps",
      file, line.long_gaps_s.size(), gap_s, stretch_s);
}

/// A joint's temperatures, or why they cannot be used; empty without such a column.
Result<std::span<const double>> temperature_of(const Numbers& numbers, const Layout& layout, const std::string& joint) {
  if (!layout.with_temperature) return {};
  const std::string column = temperature_column(joint);
  const std::span<const double> temperature =
      numbers.columns[static_cast<std::size_t>(std::ranges::find(layout.columns, column) - layout.columns.begin())];
  if (auto problem = implausible_temperature(numbers.file, column, temperature))
    return tl::unexpected(Error(std::move(*problem)));
  return temperature;
}

/// Why a joint tells nothing about how it warms up.
std::optional<std::string> always_alike(const Numbers& numbers, const std::string& joint,
                                        std::span<const double> temperature) {
  if (temperature.empty()) return std::nullopt;
  const auto [low, high] = std::ranges::minmax(temperature);
  constexpr double least_rise_K = 1e-3;
  if (high - low > least_rise_K) return std::nullopt;
  return fmt::format("{}: {} is always {:.4g}; a thermal model is identified from warming or cooling",
                     numbers.file.string(), temperature_column(joint), low);
}

/// The sessions of a joint that are long enough.
std::vector<HeatSession> sessions_of(std::size_t file, const std::vector<double>& time,
                                     const std::vector<double>& power, std::span<const double> temperature,
                                     const Timeline& line, double cycle_s) {
  const double width =
      cycle_s > 0 ? cycle_s * std::ceil(line.recorded_s / max_samples / cycle_s) : line.recorded_s / max_samples;
  std::vector<HeatSession> out;
  for (std::size_t s = 0; s + 1 < line.sessions.size(); ++s) {
    const std::size_t first = line.sessions[s], count = line.sessions[s + 1] - first;
    if (count < min_samples) continue;
    auto session = averaged(file, {&time[first], count}, {&power[first], count},
                            temperature.empty() ? temperature : temperature.subspan(first, count), line.typical_s,
                            width, cycle_s > 0);
    if (session.time_s.size() >= 2) out.push_back(std::move(session));
  }
  return out;
}

Result<ThermalRecording> from_samples(const std::filesystem::path& file, std::size_t index, double cycle_s,
                                      const TableOptions& options) {
  auto table = OpenTable::open(file, options);
  if (!table) return tl::unexpected(table.error());
  const auto layout = layout_of(file, cycle_s > 0, *table);
  if (!layout) return tl::unexpected(layout.error());
  auto numbers = table->read(layout->columns);
  if (!numbers) return tl::unexpected(numbers.error());
  numbers->file = file;
  numbers->names = layout->columns;  // one name per column that was read
  const auto& time = numbers->columns[0];
  if (time.size() < min_samples)
    return tl::unexpected(Error(
        fmt::format("{}: {} rows of finite numbers; at least {} are needed", file.string(), time.size(), min_samples)));
  ThermalRecording out{.file = file};
  out.notes = numbers->notes;
  if (numbers->left_out)
    out.notes.push_back(fmt::format("{}: {} rows with empty, NaN or infinite cells are gaps, the first in {} {}",
                                    file.string(), numbers->left_out, numbers->row, numbers->first_left_out));
  if (auto problem = not_increasing(*numbers, time)) return tl::unexpected(Error(*std::move(problem)));
  const Timeline line = timeline_of(time, cycle_s > 0);
  if (auto problem = heat_unknown(line, cycle_s > 0, file.string())) return tl::unexpected(Error(*std::move(problem)));
  note_gaps(line, time, cycle_s > 0, file.string(), out.notes);
  for (std::size_t j = 0; j < layout->joints.size(); ++j) {
    const std::string& joint = layout->joints[j];
    const auto temperature = temperature_of(*numbers, *layout, joint);
    if (!temperature) return tl::unexpected(temperature.error());
    if (auto problem = always_alike(*numbers, joint, *temperature)) {
      out.notes.push_back(*std::move(problem));
      continue;
    }
    auto power = mean_power(time, *numbers, layout->sources[j]);
    bridge_gaps(power, time, line.gaps);
    out.joints.push_back({.name = joint, .sessions = sessions_of(index, time, power, *temperature, line, cycle_s)});
    if (out.joints.back().sessions.empty())
      return tl::unexpected(Error(cycle_s > 0
                                      ? fmt::format("{}: no two whole cycles of {:g} s", file.string(), cycle_s)
                                      : fmt::format("{}: no {} rows without a gap", file.string(), min_samples)));
  }
  if (out.joints.empty()) return tl::unexpected(Error(out.notes.back()));
  return out;
}

}  // namespace

Result<ThermalRecording> read_thermal_recording(const std::filesystem::path& file, std::size_t index, double cycle_s,
                                                const TableOptions& options) {
  auto cycles = cycle_rows(file, index, cycle_s, min_samples);
  if (!cycles) return tl::unexpected(cycles.error());
  return *cycles ? *std::move(*cycles) : from_samples(file, index, cycle_s, options);
}

Result<ThermalRecordings> read_thermal_recordings(const std::vector<std::string>& files,
                                                  std::span<const double> cycle_s, const TableOptions& options) {
  if (cycle_s.size() > 1 && cycle_s.size() != files.size())
    return tl::unexpected(Error(
        fmt::format("--work-cycle: {} values for {} files; give one, or one for each", cycle_s.size(), files.size())));
  ThermalRecordings all{.files = files};
  for (std::size_t f = 0; f < files.size(); ++f) {
    auto one = read_thermal_recording(files[f], f, cycle_s.empty() ? 0 : cycle_s[cycle_s.size() == 1 ? 0 : f], options);
    if (!one) return tl::unexpected(one.error());
    std::ranges::move(one->notes, std::back_inserter(all.notes));
    for (auto& joint : one->joints) {
      auto at = std::ranges::find(all.joints, joint.name, &JointHeat::name);
      if (at == all.joints.end()) at = all.joints.insert(all.joints.end(), {.name = joint.name});
      std::ranges::move(joint.sessions, std::back_inserter(at->sessions));
    }
  }
  return all;
}

}  // namespace tribotwin::twin::identification
