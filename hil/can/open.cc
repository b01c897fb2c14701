#include <optional>
#include <string_view>

#include <fmt/format.h>

#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/plugins/friction/number.hpp>

namespace tribotwin::hil {
namespace {

using Opened = Result<std::unique_ptr<Transport>>;

constexpr std::string_view forms =
    "can0 or socketcan:NAME (SocketCAN), socketcand://127.0.0.1:29536/NAME (served over TCP), "
    "gateway://HOST:29536/NAME "
    "(a socketcand elsewhere), memory:NAME (in this process)";

std::optional<std::string> after(std::string_view prefix, std::string_view address) {
  if (!address.starts_with(prefix)) return std::nullopt;
  return std::string(address.substr(prefix.size()));
}

/// HOST:PORT/NAME
struct Server {
  std::string host, bus;
  int port = 0;
};
std::optional<Server> server(const std::string& where) {
  const auto slash = where.find('/');
  const auto colon = where.rfind(':', slash);
  if (slash == where.npos || colon == where.npos) return std::nullopt;
  const auto port = to_integer<int>(where.substr(colon + 1, slash - colon - 1));
  if (!port) return std::nullopt;
  Server out{.host = where.substr(0, colon), .bus = where.substr(slash + 1), .port = *port};
  if (out.host.empty() || out.bus.empty()) return std::nullopt;
  if (out.host.front() == '[' && out.host.back() == ']') out.host = out.host.substr(1, out.host.size() - 2);  // IPv6
  return out;
}

}  // namespace

Opened open_bus(const std::string& address, const OpenOptions& options) {
  const auto fail = [&](std::string_view why) { return tl::unexpected(Error(fmt::format("'{}' {}", address, why))); };
  if (after("log:", address)) return fail("is a log, not a bus: replay reads logs, --record writes them");
  if (const auto rest = after("socketcand://", address)) {
    const auto where = server(*rest);
    if (!where) return fail("is not of the form socketcand://127.0.0.1:29536/NAME");
    return open_socketcand(where->host, where->port, where->bus, options);
  }
  if (const auto rest = after("gateway://", address)) {
    const auto where = server(*rest);
    if (!where) return fail("is not of the form gateway://HOST:29536/NAME");
    return open_gateway(where->host, where->port, where->bus, options);
  }
  const auto memory = after("memory:", address);
  if (memory && !memory->empty()) return open_memory(*memory, options);
  const auto interface = after("socketcan:", address);
  if (interface && !interface->empty()) return open_socketcan(*interface, options);
  // A kernel's interface name has up to 15 characters, none of them a blank, ':' or '/'.
  if (!address.empty() && address.size() <= 15 && address.find_first_of(" \t\r\n:/") == address.npos)
    return open_socketcan(address, options);
  return fail(fmt::format("is no address of a bus; known are {}", forms));
}

}  // namespace tribotwin::hil
