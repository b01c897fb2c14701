#include <tribotwin/twin/motion/recording.hpp>

#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace tribotwin::twin {
namespace {

using Result = tl::expected<SetPoints, std::string>;

Result read_json(const std::filesystem::path& file, std::istream& stream) {
  const auto fail = [&](const std::string& why) { return tl::unexpected(fmt::format("{}: {}", file.string(), why)); };
  const auto json = nlohmann::json::parse(stream, nullptr, false);
  if (json.is_discarded()) return fail("is not well-formed JSON");
  if (!json.is_object() || !json.contains("entries") || !json["entries"].is_array())
    return fail("has no array 'entries'");
  SetPoints points;
  for (const auto& [key, value] : json.items())
    if (value.is_number()) points.numbers.emplace_back(key, value.get<double>());
  points.position_rad.resize(1);
  std::size_t i = 0;
  for (const auto& entry : json["entries"]) {
    const auto number = [&](const char* key) { return entry.is_object() && entry.contains(key) && entry[key].is_number() ? entry[key].get<double>() : std::nan(""); };
    const double t = number("timestamp"), goal = number("goal_position");
    if (!std::isfinite(t) || !std::isfinite(goal)) return fail(fmt::format("entry {}: needs the numbers timestamp and goal_position", i));
    if (!points.time_s.empty() && t <= points.time_s.back()) return fail(fmt::format("entry {}: timestamp {} does not come after {}", i, t, points.time_s.back()));
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

Result read_csv(const std::filesystem::path& file, std::istream& stream) {
  std::size_t line_number = 1;
  const auto fail = [&](const std::string& why) { return tl::unexpected(fmt::format("{}:{}: {}", file.string(), line_number, why)); };
  const auto cells_of = [](std::string line) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::vector<std::string> cells;
    std::istringstream in(line);
    for (std::string cell; std::getline(in, cell, ',');) {
      const auto first = cell.find_first_not_of(" \t"), last = cell.find_last_not_of(" \t");
      cells.push_back(first == std::string::npos ? "" : cell.substr(first, last - first + 1));
    }
    return cells;
  };
  std::string line;
  if (!std::getline(stream, line)) return fail("the recording is empty; its first line should name the columns: time_s, position_JOINT_rad");
  const auto header = cells_of(line);
  std::size_t time_column = header.size();
  std::vector<std::size_t> columns;
  SetPoints points;
  for (std::size_t i = 0; i < header.size(); ++i) {
    if (header[i] == "time_s") time_column = i;
    if (header[i].starts_with("position_") && header[i].ends_with("_rad")) {
      columns.push_back(i);
      points.joints.push_back(header[i].substr(9, header[i].size() - 13));
    }
  }
  if (time_column == header.size()) return fail("no column 'time_s' (a header line names the columns)");
  if (columns.empty()) return fail("no column 'position_JOINT_rad'");
  points.position_rad.resize(columns.size());
  while (std::getline(stream, line)) {
    ++line_number;
    const auto cells = cells_of(line);
    if (cells.empty()) continue;
    if (cells.size() != header.size()) return fail(fmt::format("{} cells but {} columns", cells.size(), header.size()));
    const auto number = [&](std::size_t i) {
      double x = std::nan("");
      const auto& c = cells[i];
      const auto [end, error] = std::from_chars(c.data(), c.data() + c.size(), x);
      return error == std::errc{} && end == c.data() + c.size() ? x : std::nan("");
    };
    const double t = number(time_column);
    if (!std::isfinite(t)) return fail(fmt::format("column 'time_s' is '{}', not a finite number", cells[time_column]));
    if (!points.time_s.empty() && t <= points.time_s.back()) return fail(fmt::format("time {} s does not come after {} s", t, points.time_s.back()));
    points.time_s.push_back(t);
    for (std::size_t k = 0; k < columns.size(); ++k) {
      const double x = number(columns[k]);
      if (!std::isfinite(x)) return fail(fmt::format("column '{}' is '{}', not a finite number", header[columns[k]], cells[columns[k]]));
      points.position_rad[k].push_back(x);
    }
  }
  if (points.time_s.empty()) return fail("the recording is empty: a header but no samples");
  return points;
}

}  // namespace

Result read_set_points(const std::filesystem::path& file) {
  std::error_code error;
  if (std::filesystem::is_directory(file, error)) return tl::unexpected(fmt::format("{}: is a folder, not a recording", file.string()));
  std::ifstream stream(file);
  if (!stream) return tl::unexpected(fmt::format("{}: cannot be read ({})", file.string(), std::strerror(errno)));
  return file.extension() == ".json" ? read_json(file, stream) : read_csv(file, stream);
}

}  // namespace tribotwin::twin
