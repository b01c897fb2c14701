#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/database/database.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::twin::diagnosis::fleet {

std::unique_ptr<Database> open_postgresql(const std::string& url, const char*) {
  throw InputError(
      fmt::format("{}: this program was built without PostgreSQL; install libpqxx-dev and build again, or name a file",
                  without_password(url)));
}

}  // namespace tribotwin::twin::diagnosis::fleet
