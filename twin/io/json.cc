#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/json.hpp>

namespace tribotwin::twin {

nlohmann::json parse_json(const std::string& text) { return nlohmann::json::parse(text, nullptr, false); }

std::string files_json(std::span<const std::string> files) {
  nlohmann::ordered_json json{{"files", nlohmann::ordered_json::array()}};
  for (const auto& file : files) json["files"].push_back(file);
  return json.dump(2) + "\n";
}

}  // namespace tribotwin::twin
