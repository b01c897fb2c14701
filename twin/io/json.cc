#include <cstddef>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/json.hpp>

namespace tribotwin::twin {

namespace {

/// Of a text that is well formed; of any other text no matter what.
bool is_within_limits(std::string_view text) {
  std::size_t values = 1, depth = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted && c == '\\')
      ++i;
    else if (c == '"')
      quoted = !quoted;
    else if (!quoted && (c == '[' || c == '{'))
      ++values, ++depth;
    else if (!quoted && (c == ']' || c == '}') && depth > 0)
      --depth;
    else if (!quoted && c == ',')
      ++values;
    if (values > limits::json_values || depth > limits::json_depth) return false;
  }
  return true;
}

template <class Json>
Json parsed(const std::string& text) {
  return is_within_limits(text) ? Json::parse(text, nullptr, false) : Json(Json::value_t::discarded);
}

}  // namespace

nlohmann::json parse_json(const std::string& text) { return parsed<nlohmann::json>(text); }
nlohmann::ordered_json parse_ordered_json(const std::string& text) { return parsed<nlohmann::ordered_json>(text); }

namespace {

/// As the library writes it, and DEL escaped like all other control characters: only texts have any.
template <class Json>
std::string dump(const Json& value, int indent) {
  const std::string text = value.dump(indent, ' ', false, Json::error_handler_t::replace);
  std::string out;
  out.reserve(text.size());
  for (std::size_t at = 0;;) {
    const std::size_t end = text.find('\x7f', at);
    out.append(text, at, end - at);
    if (end == text.npos) return out;
    out += "\\u007f", at = end + 1;
  }
}

}  // namespace

std::string dump_json(const nlohmann::json& value, int indent) { return dump(value, indent); }
std::string dump_json(const nlohmann::ordered_json& value, int indent) { return dump(value, indent); }

std::string files_json(std::span<const std::string> files) {
  nlohmann::ordered_json json{{"files", nlohmann::ordered_json::array()}};
  for (const auto& file : files) json["files"].push_back(file);
  return dump_json(json, 2) + "\n";
}

}  // namespace tribotwin::twin
