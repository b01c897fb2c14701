#include <tribotwin/twin/diagnosis/fleet/database/database.hpp>

namespace tribotwin::twin::diagnosis::fleet {

bool is_url(std::string_view name) { return name.starts_with("postgresql://") || name.starts_with("postgres://"); }

std::string without_password(std::string_view name) {
  std::string text(name);
  if (!is_url(name)) return text;
  // From the first colon to the last @, whatever is between: a password whose own @ or / is not escaped stays hidden.
  const auto user = text.find("://") + 3;
  if (const auto colon = text.find(':', user), at = text.rfind('@'); at != text.npos && colon < at)
    text.erase(colon, at - colon);
  for (auto key = text.find('?'); key != text.npos; key = text.find('&', key + 1)) {
    const auto value = text.find('=', key);
    if (value == text.npos || text.substr(key + 1, value - key - 1).find("password") == text.npos) continue;
    text.erase(value + 1, text.find('&', value) - value - 1);
  }
  return text;
}

std::unique_ptr<Database> open_database(const std::string& name, const char* schema) {
  return is_url(name) ? open_postgresql(name, schema) : open_sqlite(name, schema);
}

}  // namespace tribotwin::twin::diagnosis::fleet
