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

/// `value` as text of one line or, with an indent >= 0, of one line per value. Bytes that are not UTF-8, as names of
/// files may have, become U+FFFD.
std::string dump_json(const nlohmann::json& value, int indent = -1);
std::string dump_json(const nlohmann::ordered_json& value, int indent = -1);

/// null where there is no value.
template <class T>
nlohmann::ordered_json or_null(const std::optional<T>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json(nullptr);
}

}  // namespace tribotwin::twin
