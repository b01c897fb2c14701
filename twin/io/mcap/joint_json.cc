#include <cassert>
#include <cmath>
#include <iterator>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/mcap/joint_json.hpp>

namespace tribotwin::twin::mcap {
namespace {

using Object = nlohmann::ordered_json;

/// Names come from files and may be no UTF-8.
std::string json_text(const Object& value) { return dump_json(value); }

/// A number that some readers would take for an integer, and -0 for 0, gets a point.
void append_number(std::string& out, double value) {
  if (!std::isfinite(value)) {
    out += "null";
    return;
  }
  const auto begin = static_cast<std::ptrdiff_t>(out.size());
  fmt::format_to(std::back_inserter(out), "{}", value);
  if (std::string_view(out).substr(static_cast<std::size_t>(begin)).find_first_of(".e") == std::string_view::npos)
    out += ".0";
}

Object number_schema(const Quantity& quantity) {
  std::string text = quantity.description;
  if (!quantity.unit.empty()) text += fmt::format("{}[{}]", text.empty() ? "" : " ", quantity.unit);
  return {{"type", "number"}, {"description", text}};
}

}  // namespace

JointJson::JointJson(std::vector<Quantity> quantities) : quantities_(std::move(quantities)) {
  for (const Quantity& quantity : quantities_) heads_.push_back("," + json_text(Object(quantity.name)) + ":");
}

std::string JointJson::schema() const {
  Object properties{{"time_s", number_schema({"time_s", "s", "of the run, from 0"})}};
  for (const Quantity& quantity : quantities_) properties[quantity.name] = number_schema(quantity);
  return json_text({{"$schema", "https://json-schema.org/draft/2020-12/schema"},
                    {"title", "tribotwin.Joint"},
                    {"description", "A row of one joint. Numbers that are not finite are null."},
                    {"type", "object"},
                    {"properties", properties}});
}

void JointJson::append(std::string& out, double time_s, std::span<const double> values) const {
  assert(values.size() == heads_.size());
  out += R"({"time_s":)";
  append_number(out, time_s);
  for (std::size_t i = 0; i < heads_.size(); ++i) {
    out += heads_[i];
    append_number(out, values[i]);
  }
  out += '}';
}

std::string joint_topic(std::string_view joint) { return fmt::format("/joints/{}", joint); }

std::string joint_schema_name(std::string_view joint, std::string_view schema, std::string_view first) {
  return schema == first ? "tribotwin.Joint" : fmt::format("tribotwin.Joint.{}", joint);
}

}  // namespace tribotwin::twin::mcap
