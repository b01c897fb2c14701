#include <tribotwin/twin/io/json.hpp>

namespace tribotwin::twin {

nlohmann::json parse_json(const std::string& text) { return nlohmann::json::parse(text, nullptr, false); }

}  // namespace tribotwin::twin
