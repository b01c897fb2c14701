#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/table.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/recording.hpp>

namespace tribotwin::twin {
namespace {

using Read = Result<SetPoints>;

Read read_json(const std::filesystem::path& file, const std::string& text) {
  const auto fail = [&](const std::string& why) { return tl::unexpected(fmt::format("{}: {}", file.string(), why)); };
  const auto json = parse_json(text);
  if (json.is_discarded()) return fail("is not well-formed JSON");
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
    points.measured_rad.push_back(number("position"));
    points.temperature_degC.push_back(number("temp"));
    points.torque_on.push_back(!entry.contains("torque_enable") || entry["torque_enable"] != false);
    ++i;
  }
  if (i == 0) return fail("the recording is empty");
  return points;
}

Read read_csv(const std::filesystem::path& file) {
  const auto table = read_table(file);
  if (!table) return tl::unexpected(table.error());
  auto time = table->numbers("time_s");
  if (!time) return tl::unexpected(time.error());
  SetPoints points{.time_s = std::move(*time)};
  for (std::size_t i = 1; i < points.time_s.size(); ++i)
    if (points.time_s[i] <= points.time_s[i - 1])
      return tl::unexpected(
          fmt::format("{}time {} s does not come after {} s", table->where(i), points.time_s[i], points.time_s[i - 1]));
  for (const auto& name : table->names) {
    constexpr std::string_view prefix = "position_";
    if (!name.starts_with(prefix)) continue;
    const std::string_view unit = name.ends_with("_rad") ? "_rad" : name.ends_with("_m") ? "_m" : "";
    if (unit.empty()) continue;
    auto column = table->numbers(name);
    if (!column) return tl::unexpected(column.error());
    points.position_rad.push_back(std::move(*column));
    points.joints.push_back(name.substr(prefix.size(), name.size() - prefix.size() - unit.size()));
    const std::string velocity = fmt::format("velocity_{}{}_s", points.joints.back(), unit);
    if (!table->has(velocity)) continue;
    auto speeds = table->numbers(velocity);
    if (!speeds) return tl::unexpected(speeds.error());
    points.velocity_rad_s.push_back(std::move(*speeds));
  }
  if (!points.velocity_rad_s.empty() && points.velocity_rad_s.size() < points.joints.size())
    return tl::unexpected(fmt::format("{}:1: {} of {} joints have a velocity; give it for all or none", file.string(),
                                      points.velocity_rad_s.size(), points.joints.size()));
  if (points.joints.empty()) return tl::unexpected(fmt::format("{}:1: no column 'position_JOINT_rad'", file.string()));
  return points;
}

}  // namespace

Read read_set_points(const std::filesystem::path& file) {
  if (file.extension() != ".json") return read_csv(file);
  const auto text = read_text(file, "a recording");
  return text ? read_json(file, *text) : tl::unexpected(text.error());
}

}  // namespace tribotwin::twin
