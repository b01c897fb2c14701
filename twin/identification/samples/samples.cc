#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/twin/identification/samples/levels.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>
#include <tribotwin/twin/identification/time_series.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {
namespace {

namespace fs = std::filesystem;
using Problem = std::optional<std::string>;

/// Beyond these, numbers cannot be what their column says.
constexpr double max_motor_speed = 1500, max_arm_speed = 60, max_load = 3, max_friction_norm = 2;

/// Factors from what a file holds to what the law takes; a sentence where a number is missing for that.
struct Units {
  double speed_from_motor = 1, friction_from_norm = 1, friction_from_nm = 1;
};

Result<Units> units_of(const friction::LawInfo& law, const ReadOptions& o, bool friction_is_norm) {
  Units u;
  if (law.side == friction::Side::arm) {
    if (!(o.gear_ratio > 0))
      return tl::unexpected(
          fmt::format("law '{}' takes joint speeds, speed_rad_s is the motor's: --gear-ratio is needed", law.name));
    u.speed_from_motor = 1 / o.gear_ratio;
  }
  if (law.normalised != friction_is_norm && !(o.torque_max_nm > 0))
    return tl::unexpected(
        fmt::format("law '{}' is one of {}, the data are {}: --tau-max (largest manipulation torque [Nm]) is needed",
                    law.name, law.normalised ? "normalised torque" : "Nm", friction_is_norm ? "normalised" : "in Nm"));
  if (law.normalised)
    u.friction_from_nm = o.torque_max_nm > 0 ? 1 / o.torque_max_nm : 1;
  else
    u.friction_from_norm = o.torque_max_nm > 0 ? o.torque_max_nm : 1;
  return u;
}

/// Refuses what cannot be true. Speeds on the motor side.
Problem implausible(const fs::path& file, std::span<const double> speed, std::span<const double> load,
                    std::span<const double> temperature, std::span<const double> friction, bool friction_is_norm) {
  const auto largest = [](std::span<const double> x) {
    return x.empty() ? 0.0 : std::ranges::max(x, {}, [](double v) { return std::abs(v); });
  };
  const auto magnitude = [&](std::span<const double> x) { return std::abs(largest(x)); };
  if (magnitude(speed) > max_motor_speed)
    return fmt::format(
        "{}: speed_rad_s reaches {:.4g} rad/s, {:.0f} rpm at the motor, where {:g} is beyond any; are these degrees "
        "per second, or is it another column?",
        file.string(), magnitude(speed), magnitude(speed) * 60 / 6.283185307, max_motor_speed);
  if (magnitude(load) > max_load)
    return fmt::format(
        "{}: load_norm reaches {:.4g}, where a joint carries up to 1 (load torque / torque_max); are these Nm, or is "
        "it another column?",
        file.string(), magnitude(load));
  if (const Problem p = implausible_temperature(file, "temperature_degC", temperature)) return p;
  if (friction_is_norm && magnitude(friction) > max_friction_norm)
    return fmt::format(
        "{}: friction_norm reaches {:.4g}, where friction is a part of torque_max; are these Nm (friction_nm), or is "
        "it another column?",
        file.string(), magnitude(friction));
  std::size_t against = 0;
  for (std::size_t i = 0; i < speed.size(); ++i) against += speed[i] * friction[i] < 0;
  if (2 * against > speed.size())
    return fmt::format(
        "{}: friction has the sign opposite to speed in {} of {} rows; it is counted positive when it opposes positive "
        "motion",
        file.string(), against, speed.size());
  return {};
}

/// Friction in Nm that the joint could not overcome.
Problem beyond_torque_max(const fs::path& file, std::span<const double> friction_nm, const ReadOptions& options) {
  const double limit = max_friction_norm * options.torque_max_nm;
  if (friction_nm.empty() || !(limit > 0)) return {};
  const auto [low, high] = std::ranges::minmax(friction_nm);
  const double largest = std::max(-low, high);
  if (largest <= limit) return {};
  return fmt::format(
      "{}: friction reaches {:.4g} Nm, where torque_max is {:g}; is its unit mNm or A, or torque_max that of the "
      "motor?",
      file.string(), largest, options.torque_max_nm);
}

struct LevelColumns {
  std::vector<double> speed, friction, load, temperature, error, curve;
  std::vector<double> forward = {}, backward = {};  ///< empty, or of each level, NaN where not known
};

/// Half of what friction of the forward direction is above that of the backward one, in the unit of the file.
double difference_of(const LevelColumns& c, std::size_t i) {
  return c.forward.empty() || c.backward.empty() ? std::nan("") : 0.5 * (c.forward[i] - c.backward[i]);
}

/// Appends one file's curves.
Problem append(Samples& s, const fs::path& file, const LevelColumns& c, const Units& u, bool is_norm) {
  const std::size_t n = c.speed.size();
  const bool weighted = !c.error.empty() && std::ranges::all_of(c.error, [](double e) { return e > 0; });
  if (!c.error.empty() && !weighted)
    s.notes.push_back(fmt::format(
        "{}: standard errors that are not all above 0 cannot be weights; every row counts the same", file.string()));
  const bool first = s.speed.empty();
  if (!first && weighted != !s.standard_error.empty()) {
    s.standard_error.clear();
    s.notes.push_back(fmt::format("{}: not all files have standard errors; every row counts the same", file.string()));
  }
  const bool keep_errors = weighted && (first || !s.standard_error.empty());
  std::size_t standing = 0, against = 0;
  std::uint32_t curve = s.curve.empty() ? 0 : s.curve.back() + 1;
  bool any = false;
  double last_speed = 0;
  std::optional<double> last_curve;
  std::size_t passes = 1;
  for (std::size_t i = 1; i < n; ++i) passes += std::abs(c.speed[i]) < std::abs(c.speed[i - 1]);
  // Without a column that says so, a curve is one pass upwards; where speeds are in no order, a file.
  const bool by_pass = c.curve.empty() && n >= 4 * passes;
  for (std::size_t i = 0; i < n; ++i) {
    const double v = std::abs(c.speed[i]);
    if (v == 0) {
      ++standing;
      continue;
    }
    if (any && ((by_pass && v < last_speed) || (!c.curve.empty() && c.curve[i] != *last_curve))) ++curve;
    any = true;
    last_speed = v;
    if (!c.curve.empty()) last_curve = c.curve[i];
    const double scale = is_norm ? u.friction_from_norm : u.friction_from_nm,
                 friction = std::copysign(scale, c.speed[i]) * c.friction[i];
    against += friction < 0;
    s.speed.push_back(v * u.speed_from_motor);
    s.friction.push_back(friction);
    s.load.push_back(c.load.empty() ? 0 : std::abs(c.load[i]));
    s.temperature_degC.push_back(c.temperature.empty() ? 0 : c.temperature[i]);
    if (keep_errors) s.standard_error.push_back(c.error[i] * scale);
    s.curve.push_back(curve);
    s.difference.push_back(difference_of(c, i) * scale);
    s.direction.push_back(std::isfinite(s.difference.back()) ? 0 : std::copysign(1, c.speed[i]));
  }
  if (standing)
    s.notes.push_back(
        fmt::format("{}: {} rows at speed 0 are left out: friction at rest equals the load, up to breakaway",
                    file.string(), standing));
  if (against)
    s.notes.push_back(fmt::format("{}: friction drives the motion in {} rows; noise may do that, a wrong sign too",
                                  file.string(), against));
  return any ? Problem{} : fmt::format("{}: no row with motion", file.string());
}

/// "; laws that these columns allow (--law): stribeck"
std::string laws_with(bool load, bool temperature) {
  std::vector<std::string_view> names;
  for (const friction::LawInfo& law : friction::laws())
    if ((load || !law.load_dependent) && (temperature || !law.temperature_dependent)) names.push_back(law.name);
  return names.empty() ? "" : fmt::format("; laws that these columns allow (--law): {}", joined(names));
}

Problem read_curves(Samples& samples, const Numbers& table, const friction::LawInfo& law, const ReadOptions& options) {
  const auto& c = table.columns;
  const std::string file = table.file.string();
  const bool norm = !c[1].empty() && (law.normalised || c[2].empty());
  if (c[0].empty() || (c[1].empty() && c[2].empty()))
    return table.left_out ? fmt::format("{}: no row without an empty, NaN or infinite cell", file)
                          : fmt::format("{}: is empty: a header but no samples", file);
  const bool has_load = !c[3].empty(), has_temperature = !c[4].empty();
  if (law.load_dependent && !has_load)
    return fmt::format("{}:1: law '{}' depends on load: a column load_norm is needed; the header names {}{}", file,
                       law.name, table.header, laws_with(has_load, has_temperature));
  if (law.temperature_dependent && !has_temperature)
    return fmt::format(
        "{}:1: law '{}' depends on temperature: a column temperature_degC is needed; the header names {}{}", file,
        law.name, table.header, laws_with(has_load, has_temperature));
  const auto& friction = norm ? c[1] : c[2];
  if (const Problem p = implausible(table.file, c[0], c[3], c[4], friction, norm)) return p;
  if (const Problem p = beyond_torque_max(table.file, norm ? std::span<const double>{} : friction, options)) return p;
  const auto units = units_of(law, options, norm);
  if (!units) return fmt::format("{}: {}", file, units.error().message);
  return append(samples, table.file,
                {.speed = c[0],
                 .friction = friction,
                 .load = c[3],
                 .temperature = c[4],
                 .error = norm ? c[5] : c[6],
                 .curve = c[7],
                 .forward = norm ? c[8] : c[10],
                 .backward = norm ? c[9] : c[11]},
                *units, norm);
}

const std::vector<std::string> curve_columns{"speed_rad_s",
                                             "friction_norm",
                                             "friction_nm",
                                             "load_norm",
                                             "temperature_degC",
                                             "stderr_norm",
                                             "stderr_nm",
                                             "curve",
                                             "friction_forward_norm",
                                             "friction_backward_norm",
                                             "friction_forward_nm",
                                             "friction_backward_nm"};
const std::vector<std::string> series_columns{"time_s",    "position_rad",     "velocity_rad_s",
                                              "torque_nm", "temperature_degC", "load_nm"};

/// Friction levels of a recording, arm side, as a curve file would hold them.
Problem append_levels(Samples& samples, const fs::path& file, const JointRecording& recording,
                      const friction::LawInfo& law, const ReadOptions& o) {
  if (!(o.gear_ratio > 0))
    return fmt::format("{}: a recording has joint speeds, the law takes motor speeds: --gear-ratio is needed",
                       file.string());
  if (law.load_dependent && recording.load_nm.empty())
    samples.notes.push_back(
        fmt::format("{}: without a column load_nm the load is taken from (u+ + u-)/2, which holds where friction is "
                    "the same both ways",
                    file.string()));
  if (law.load_dependent && !(o.torque_max_nm > 0))
    return fmt::format("{}: law '{}' depends on load / torque_max: --tau-max is needed", file.string(), law.name);
  if (law.temperature_dependent && recording.temperature_degC.empty())
    return fmt::format("{}: law '{}' depends on temperature: a column temperature_degC is needed", file.string(),
                       law.name);
  if (!recording.velocity_rad_s.empty())
    if (const auto ratio = velocity_over_slope(recording.time_s, recording.position_rad, recording.velocity_rad_s);
        ratio && ratio->contradicts())
      return fmt::format("{}: velocity_rad_s {}", file.string(), ratio->text("position_rad"));
  const auto levels = levels_of(recording);
  if (!levels) return fmt::format("{}: {}", file.string(), levels.error().message);
  if (!levels->left_out.empty())
    samples.notes.push_back(fmt::format("{}: {} stretches of constant speed are no levels, the first: {}",
                                        file.string(), levels->left_out.size(), levels->left_out.front()));
  LevelColumns c;
  for (const Level& level : levels->levels) {
    c.speed.push_back(level.speed_rad_s * o.gear_ratio);
    c.friction.push_back(level.friction_nm);
    c.load.push_back(o.torque_max_nm > 0 ? level.load_nm / o.torque_max_nm : 0);
    c.temperature.push_back(std::isnan(level.temperature_degC) ? 0 : level.temperature_degC);
    c.error.push_back(level.stderr_nm);
    c.curve.push_back(0);
    c.forward.push_back(level.forward ? level.forward->friction_nm : std::nan(""));
    c.backward.push_back(level.backward ? level.backward->friction_nm : std::nan(""));
  }
  if (const Problem p = implausible(file, c.speed, c.load, c.temperature, c.friction, false)) return p;
  if (const Problem p = beyond_torque_max(file, c.friction, o)) return p;
  const auto units = units_of(law, o, false);
  if (!units) return fmt::format("{}: {}", file.string(), units.error().message);
  return append(samples, file, c, *units, false);
}

Problem read_series(Samples& samples, const Numbers& table, const friction::LawInfo& law, const ReadOptions& options) {
  const auto& c = table.columns;
  for (const int needed : {0, 1, 3})
    if (c[static_cast<std::size_t>(needed)].empty())
      return fmt::format(
          "{}:1: no samples in column {}; {}a recording has time_s, position_rad, torque_nm and may have "
          "velocity_rad_s, "
          "temperature_degC, load_nm",
          table.file.string(), series_columns[static_cast<std::size_t>(needed)],
          table.hint(series_columns[static_cast<std::size_t>(needed)]));
  if (const Problem p = not_increasing(table, c[0])) return p;
  return append_levels(samples, table.file,
                       {.time_s = c[0],
                        .position_rad = c[1],
                        .velocity_rad_s = c[2],
                        .torque_nm = c[3],
                        .load_nm = c[5],
                        .temperature_degC = c[4]},
                       law, options);
}

Problem read_record(Samples& samples, const fs::path& file, const friction::LawInfo& law, ReadOptions options) {
  const auto record = read_telemetry(file);
  if (!record) return record.error().message;
  std::size_t joint = 0;
  if (options.table.joint.empty()) {
    if (record->joints.size() != 1)
      return fmt::format("{}: has the joints {}; --joint says which", file.string(), joined(record->joints));
  } else {
    joint = static_cast<std::size_t>(std::ranges::find(record->joints, options.table.joint) - record->joints.begin());
    if (joint == record->joints.size())
      return fmt::format("{}: no joint '{}'; it has {}", file.string(), options.table.joint, joined(record->joints));
  }
  if (joint < record->joint_attributes.size())
    for (const auto& [name, value] : record->joint_attributes[joint]) {
      if (name == "gear_ratio" && !(options.gear_ratio > 0)) options.gear_ratio = value;
      if (name == "torque_max_nm" && !(options.torque_max_nm > 0)) options.torque_max_nm = value;
    }
  const auto column = [&](std::string_view name) {
    const auto c = record->channel(record->joints[joint], name);
    return std::vector<double>(c.begin(), c.end());
  };
  return append_levels(samples, file,
                       {.time_s = record->time_s,
                        .position_rad = column("position_rad"),
                        .velocity_rad_s = column("velocity_rad_s"),
                        .torque_nm = column("torque_nm"),
                        .load_nm = column("load_nm"),
                        .temperature_degC = column("temperature_degC")},
                       law, options);
}

}  // namespace

Samples Samples::subset(std::span<const std::size_t> rows) const {
  Samples some;
  const auto take = [&](auto& to, const auto& from) {
    if (from.empty()) return;
    to.reserve(rows.size());
    for (const std::size_t i : rows) to.push_back(from[i]);
  };
  take(some.speed, speed);
  take(some.load, load);
  take(some.temperature_degC, temperature_degC);
  take(some.friction, friction);
  take(some.standard_error, standard_error);
  take(some.direction, direction);
  take(some.difference, difference);
  // Curves keep their order but count from 0 again.
  std::uint32_t next = 0;
  for (std::size_t k = 0; k < rows.size() && !curve.empty(); ++k) {
    if (k && curve[rows[k]] != curve[rows[k - 1]]) ++next;
    some.curve.push_back(next);
  }
  return some;
}

std::vector<double> weights_of(const Samples& samples) {
  std::vector<double> w;
  for (const double e : samples.standard_error) w.push_back(1 / (e * e));
  // Only their ratios matter; around 1 they keep the sums well scaled.
  const double mean = std::accumulate(w.begin(), w.end(), 0.0) / static_cast<double>(w.size());
  for (double& x : w) x /= mean;
  return w;
}

namespace {

struct Opened {
  Numbers table;
  bool series = false;  ///< a recording, not a friction curve
};

/// The columns that are wanted decide which joint a name is of: first as a recording, then as a friction curve.
Result<Opened> open_samples(const fs::path& file, const TableOptions& options) {
  TableOptions of_any_joint = options;
  of_any_joint.any_joint = true;
  auto table = OpenTable::open(file, of_any_joint);
  if (!table) return tl::unexpected(table.error());
  const auto opened = [&](const std::vector<std::string>& columns, bool series) -> Result<Opened> {
    auto numbers = table->read(columns);
    if (!numbers) return tl::unexpected(numbers.error());
    return Opened{std::move(*numbers), series};
  };
  const auto series = table->header(series_columns);
  if (series && series->has("time_s") && series->has("position_rad")) return opened(series_columns, true);
  const auto curve = table->header(curve_columns);
  if (!curve) return tl::unexpected(curve.error());
  if (curve->has("speed_rad_s") && (curve->has("friction_norm") || curve->has("friction_nm")))
    return opened(curve_columns, false);
  if (!series) return tl::unexpected(series.error());
  return tl::unexpected(
      fmt::format("{}:1: neither a friction curve (speed_rad_s; friction_norm or friction_nm) nor a recording "
                  "(time_s, position_rad, torque_nm); the header names {}",
                  file.string(), curve->header));
}

/// Speeds of one sign are those of friction levels by custom, of both signs those of directions.
void forget_unknown_directions(Samples& s) {
  if (std::ranges::find(s.direction, -1.0) == s.direction.end()) s.direction.clear();
  if (std::ranges::none_of(s.difference, [](double d) { return std::isfinite(d); })) s.difference.clear();
}

Problem append_table(Samples& samples, const Numbers& table, bool series, const friction::LawInfo& law,
                     const ReadOptions& options) {
  samples.notes.insert(samples.notes.end(), table.notes.begin(), table.notes.end());
  if (table.left_out)
    samples.notes.push_back(
        fmt::format("{}: {} rows with empty, NaN or infinite cells are left out, the first in {} {}",
                    table.file.string(), table.left_out, table.row, table.first_left_out));
  samples.left_out += table.left_out;
  if (const Problem p = series ? read_series(samples, table, law, options) : read_curves(samples, table, law, options))
    return p;
  if (3 * table.left_out > table.columns[0].size() + table.left_out)
    return fmt::format("{}: {} of {} rows hold no finite numbers; what is left may not be a fair sample",
                       table.file.string(), table.left_out, table.columns[0].size() + table.left_out);
  return {};
}

/// Columns in memory, as a table that was read: rows with a cell that is no finite number are left out. A sentence
/// where lengths differ.
Result<Numbers> table_of(const CurveColumns& c, const std::string& name) {
  const std::vector<double>* given[] = {&c.speed_rad_s,      &c.friction_norm, &c.friction_nm, &c.load_norm,
                                        &c.temperature_degC, &c.stderr_norm,   &c.stderr_nm,   &c.curve};
  const std::size_t rows = c.speed_rad_s.size();
  Numbers table{.file = name, .names = {}, .header = {}, .row = "row"};
  table.columns.resize(curve_columns.size());
  for (std::size_t k = 0; k < std::size(given); ++k) {
    if (given[k]->empty() && rows > 0) continue;
    if (given[k]->size() != rows)
      return tl::unexpected(fmt::format("{}: {} has {} values but speed_rad_s has {}; one per level is needed", name,
                                        curve_columns[k], given[k]->size(), rows));
    table.names.push_back(curve_columns[k]);
  }
  table.header = joined(table.names);
  for (std::size_t i = 0; i < rows; ++i) {
    const bool finite =
        std::ranges::all_of(given, [&](const auto* column) { return column->empty() || std::isfinite((*column)[i]); });
    if (!finite && table.left_out++ == 0) table.first_left_out = i + 1;
    for (std::size_t k = 0; finite && k < std::size(given); ++k)
      if (!given[k]->empty()) table.columns[k].push_back((*given[k])[i]);
    if (finite) table.lines.push_back(i + 1);
  }
  return table;
}

}  // namespace

Result<Samples> samples_of(const CurveColumns& columns, const std::string& name, const friction::LawInfo& law,
                           const ReadOptions& options) {
  const auto table = table_of(columns, name);
  if (!table) return tl::unexpected(table.error());
  Samples samples;
  if (const Problem p = append_table(samples, *table, false, law, options)) return tl::unexpected(*p);
  forget_unknown_directions(samples);
  return samples;
}

Result<Samples> read_samples(std::span<const fs::path> files, const friction::LawInfo& law,
                             const ReadOptions& options) {
  Samples samples;
  const TableOptions tables = with_gear_ratio(options.table, options.gear_ratio);
  for (const fs::path& file : files) {
    if (const auto record = record_of(file); record && tables.topic.empty()) {
      if (const Problem p = read_record(samples, *record, law, options)) return tl::unexpected(*p);
      continue;
    }
    const auto opened = open_samples(file, tables);
    if (!opened) return tl::unexpected(opened.error());
    const Numbers* table = &opened->table;
    const bool series = opened->series;
    if (const Problem p = append_table(samples, *table, series, law, options)) return tl::unexpected(*p);
  }
  forget_unknown_directions(samples);
  return samples;
}

}  // namespace tribotwin::twin::identification
