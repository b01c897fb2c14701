#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/recording.hpp>

namespace tribotwin::twin {
namespace {

using Read = Result<SetPoints>;

Read read_json(const std::filesystem::path& file, const std::string& text) {
  const auto fail = [&](const std::string& why) { return tl::unexpected(fmt::format("{}: {}", file.string(), why)); };
  const auto json = parse_json(text);
  if (json.is_discarded())
    return fail(fmt::format("is no JSON of at most {} values, nested at most {} deep", limits::json_values,
                            limits::json_depth));
  if (!json.is_object() || !json.contains("entries") || !json["entries"].is_array())
    return fail("has no array 'entries'");
  SetPoints points;
  for (const auto& [key, value] : json.items())
    if (value.is_number()) {
      points.numbers.emplace_back(key, value.get<double>());
      if (!quantity_of(key).contains(points.numbers.back().second))
        return fail(fmt::format("{} is {} but {}", key, points.numbers.back().second, quantity_of(key).requirement()));
    }
  points.position_rad.resize(1);
  points.measured_rad.resize(1);
  points.temperature_degC.resize(1);
  std::size_t i = 0;
  for (const auto& entry : json["entries"]) {
    const auto number = [&](const char* key) {
      return entry.is_object() && entry.contains(key) && entry[key].is_number() ? entry[key].get<double>()
                                                                                : std::nan("");
    };
    const double t = number("timestamp"), goal = number("goal_position");
    if (!std::isfinite(t) || !std::isfinite(goal))
      return fail(fmt::format("entry {}: needs the numbers timestamp and goal_position", i));
    for (const auto& [key, column] : {std::pair{"timestamp", "time_s"},
                                      {"goal_position", "position_rad"},
                                      {"position", "position_rad"},
                                      {"temp", "temperature_degC"}})
      if (const double x = number(key); std::isfinite(x) && !quantity_of(column).contains(x))
        return fail(fmt::format("entry {}: {} is {} but {}", i, key, x, quantity_of(column).requirement()));
    if (!points.time_s.empty() && t <= points.time_s.back())
      return fail(fmt::format("entry {}: timestamp {} does not come after {}", i, t, points.time_s.back()));
    points.time_s.push_back(t);
    points.position_rad[0].push_back(goal);
    points.measured_rad[0].push_back(number("position"));
    points.temperature_degC[0].push_back(number("temp"));
    points.torque_on.push_back(!entry.contains("torque_enable") || entry["torque_enable"] != false);
    ++i;
  }
  if (i == 0) return fail("the recording is empty");
  return points;
}

/// Joints that have a set point or, where none has, a position: with the base unit, "rad" or "m".
std::vector<std::pair<std::string, std::string>> joints_of(const Numbers& header, std::string_view quantity) {
  std::vector<std::pair<std::string, std::string>> joints;
  for (const auto& name : header.names) {
    const auto column = parse_column(name);
    if (!column || !*column || (*column)->quantity->name != quantity) continue;
    using enum Dimension;
    const Dimension dimension = (*column)->unit->dimension;
    const bool slides = dimension == length || dimension == speed || dimension == force;
    if (std::ranges::find(joints, (*column)->joint, [](const auto& j) { return j.first; }) == joints.end())
      joints.emplace_back((*column)->joint, slides ? "m" : "rad");
  }
  return joints;
}

/// "position_JOINT_rad", "position_rad"
std::string column_of(std::string_view quantity, const std::string& joint, std::string_view unit) {
  return fmt::format("{}_{}{}{}", quantity, joint, joint.empty() ? "" : "_", unit);
}

/// The columns of every joint: set point (or position), speed, and of a table with set points the commanded speed and
/// torque and what was measured.
constexpr std::size_t columns_each = 6;
std::vector<std::string> wanted_columns(const std::vector<std::pair<std::string, std::string>>& joints, bool measured) {
  std::vector<std::string> wanted{"time_s"};
  for (const auto& [joint, unit] : joints) {
    wanted.push_back(column_of(measured ? "set_point" : "position", joint, unit));
    wanted.push_back(column_of("velocity", joint, unit + "_s"));
    wanted.push_back(measured ? column_of("position", joint, unit) : "");
    wanted.push_back(column_of("temperature", joint, "degC"));
    wanted.push_back(measured ? column_of("set_point", joint, unit + "_s") : "");
    wanted.push_back(measured ? column_of("set_point", joint, unit == "rad" ? "nm" : "n") : "");
  }
  return wanted;
}

/// Why the columns of one quantity are not of every joint; empty where they are of all or none.
std::string not_of_all(const std::vector<std::vector<double>>& columns, std::size_t joints, std::string_view what) {
  if (columns.empty() || columns.size() == joints) return {};
  return fmt::format("{} of {} joints have a {}; give it for all or none", columns.size(), joints, what);
}

void take(std::vector<double>& column, std::vector<std::vector<double>>& all) {
  if (!column.empty()) all.push_back(std::move(column));
}

Read read_columns(const std::filesystem::path& file, const TableOptions& options) {
  auto opened = OpenTable::open(file, options);
  if (!opened) return tl::unexpected(opened.error());
  const auto header = opened->header();
  if (!header) return tl::unexpected(header.error());
  auto joints = joints_of(*header, "set_point");
  const bool measured = !joints.empty();
  if (!measured) joints = joints_of(*header, "position");
  if (joints.empty())
    return tl::unexpected(
        fmt::format("{}:1: no column 'position_JOINT_rad'; the header names {}", file.string(), header->header));
  auto table = opened->read(wanted_columns(joints, measured));
  if (!table) return tl::unexpected(table.error());
  if (table->left_out)
    return tl::unexpected(fmt::format("{}: {} {}: a cell is empty, NaN or infinite; set points must be finite numbers",
                                      file.string(), table->row, table->first_left_out));
  if (table->columns[0].empty())
    return tl::unexpected(
        fmt::format("{}:1: no column 'time_s' with numbers; the header names {}", file.string(), table->header));
  if (const auto problem = not_increasing(*table, table->columns[0])) return tl::unexpected(*problem);
  SetPoints points{.time_s = std::move(table->columns[0])};
  points.notes = std::move(table->notes);
  for (std::size_t k = 0; k < joints.size(); ++k) {
    auto* const of_joint = &table->columns[1 + columns_each * k];
    if (!joints[k].first.empty()) points.joints.push_back(joints[k].first);
    take(of_joint[0], points.position_rad);
    // Measured speeds are none of set points.
    if (!measured) {
      take(of_joint[1], points.velocity_rad_s);
      continue;
    }
    take(of_joint[4], points.command_rad_s);
    take(of_joint[5], points.command_nm);
    points.measured_rad.push_back(std::move(of_joint[2]));
    points.temperature_degC.push_back(std::move(of_joint[3]));
    points.temperature_degC.back().resize(points.time_s.size(), std::nan(""));
  }
  for (const auto& why : {not_of_all(points.velocity_rad_s, joints.size(), "velocity"),
                          not_of_all(points.position_rad, joints.size(), "set point of position"),
                          not_of_all(points.command_rad_s, joints.size(), "set point of speed"),
                          not_of_all(points.command_nm, joints.size(), "set point of torque")})
    if (!why.empty()) return tl::unexpected(fmt::format("{}:1: {}", file.string(), why));
  if (std::ranges::any_of(points.measured_rad, &std::vector<double>::empty))
    points.measured_rad.clear(), points.temperature_degC.clear();
  if (!points.measured_rad.empty()) points.torque_on.assign(points.time_s.size(), true);
  return points;
}

}  // namespace

Read read_set_points(const std::filesystem::path& file, const TableOptions& options) {
  if (file.extension() != ".json") return read_columns(file, options);
  const auto text = read_text(file, "a recording");
  return text ? read_json(file, *text) : tl::unexpected(text.error());
}

Motion motion_of(const SetPoints& points, std::span<const std::size_t> drives, std::vector<double> start_rad,
                 double delay_s) {
  Motion motion(start_rad);
  const auto fill = [&](const std::vector<std::vector<double>>& columns, std::size_t row, std::vector<double>& all) {
    for (std::size_t k = 0; k < columns.size(); ++k) all[drives[k]] = columns[k][row];
    return columns.empty() ? std::vector<double>{} : all;
  };
  std::vector<double> position = std::move(start_rad), velocity(position.size(), 0.0), torque = velocity;
  for (std::size_t i = 0; i < points.time_s.size(); ++i) {
    fill(points.position_rad, i, position);
    const double time_s = points.time_s[i] - points.time_s[0] + delay_s;
    if (points.velocity_rad_s.empty())
      motion.hold_at(time_s, position, fill(points.command_rad_s, i, velocity), fill(points.command_nm, i, torque));
    else
      motion.pass_through(time_s, position, fill(points.velocity_rad_s, i, velocity));
  }
  return motion;
}

}  // namespace tribotwin::twin
