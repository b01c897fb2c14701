#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace tribotwin::twin {

/// is_discarded() where the text is not well formed. A function because nlohmann's parser takes 2 s of compilation in
/// every source that instantiates it.
nlohmann::json parse_json(const std::string& text);

}  // namespace tribotwin::twin
