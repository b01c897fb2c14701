#pragma once

#include <optional>
#include <string>

#include <nlohmann/json.hpp>

namespace tribotwin::twin {

/// is_discarded() where the text is not well formed or beyond limits::json_*. A function because nlohmann's parser
/// takes 2 s of compilation in every source that instantiates it.
nlohmann::json parse_json(const std::string& text);
/// The same, with keys in the order of the text.
nlohmann::ordered_json parse_ordered_json(const std::string& text);

/// null where there is no value.
template <class T>
nlohmann::ordered_json or_null(const std::optional<T>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json(nullptr);
}

}  // namespace tribotwin::twin
