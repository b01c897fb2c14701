#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/json_input.hpp>
#include <tribotwin/twin/io/mcap/joint_states_json.hpp>

namespace tribotwin::twin::mcap {
namespace {

using nlohmann::json;

/// Where the message has no such list, it is empty.
const json& list_of(const json& message, const char* name) {
  static const json none = json::array();
  if (!message.is_object() || !message.contains(name)) return none;
  const json& list = message[name];
  if (!list.is_array()) throw InputError(fmt::format("{} must be a list", name));
  return list;
}

std::string_view text_of(const json& value, const char* name) {
  if (!value.is_string()) throw InputError(fmt::format("{} must hold texts", name));
  return value.get_ref<const std::string&>();
}

/// JSON has no NaN: null stands for it.
double number_of(const json& value, const char* name) {
  if (value.is_null()) return std::numeric_limits<double>::quiet_NaN();
  if (!value.is_number()) throw InputError(fmt::format("{} must hold numbers", name));
  return value.get<double>();
}

void require_as_many(const json& numbers, const char* name, const json& names, const char* of) {
  if (numbers.size() != names.size())
    throw InputError(fmt::format("{} {} but {} of {}", names.size(), of, numbers.size(), name));
}

std::int64_t stamp_of(const json& message) {
  if (!message.contains("header")) return 0;
  const JsonInput stamp = JsonInput(message, "")["header"]["stamp"];
  constexpr double most_s = 4e9, ns_per_s = 1e9;
  const double seconds = stamp["sec"].number({-most_s, most_s}),
               rest = stamp[stamp.has("nsec") ? "nsec" : "nanosec"].number({0, ns_per_s});
  return std::llround(seconds) * 1'000'000'000 + std::llround(rest);
}

void read_joint_state(const json& message, JointNumbers& out) {
  const json& names = list_of(message, "name");
  for (const json& name : names) out.names.push_back(text_of(name, "name"));
  for (const char* const field : joint_state_fields) {
    const json& numbers = list_of(message, field);
    if (numbers.empty()) continue;
    require_as_many(numbers, field, names, "names");
    for (std::size_t k = 0; k < numbers.size(); ++k)
      out.values.push_back({out.names[k], field, number_of(numbers[k], field)});
  }
}

void read_dynamic_joint_state(const json& message, JointNumbers& out) {
  const json &joints = list_of(message, "joint_names"), &all = list_of(message, "interface_values");
  require_as_many(all, "interface_values", joints, "joint_names");
  for (std::size_t j = 0; j < joints.size(); ++j) {
    out.names.push_back(text_of(joints[j], "joint_names"));
    const json &interfaces = list_of(all[j], "interface_names"), &values = list_of(all[j], "values");
    require_as_many(values, "values", interfaces, "interface_names");
    for (std::size_t k = 0; k < values.size(); ++k)
      out.values.push_back({out.names[j], text_of(interfaces[k], "interface_names"), number_of(values[k], "values")});
  }
}

}  // namespace

Result<void> decode_json(JointMessage kind, std::string_view data, JointNumbers& out) {
  const auto message = std::make_shared<const json>(parse_json(std::string(data)));
  if (!message->is_object()) return tl::unexpected(Error("is no JSON object"));
  out.texts = message;
  out.names.clear();
  try {
    out.stamp_ns = stamp_of(*message);
    (kind == JointMessage::joint_state ? read_joint_state : read_dynamic_joint_state)(*message, out);
  } catch (const InputError& e) {
    return tl::unexpected(Error(e.what()));
  }
  return {};
}

}  // namespace tribotwin::twin::mcap
