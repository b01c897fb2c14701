#include <fmt/format.h>

#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/live/web_options.hpp>

namespace tribotwin::twin::live {

std::unique_ptr<Server> WebOptions::start(Hello hello) const {
  if (!given()) return nullptr;
  const auto named = [](Error error) { return Error("--web " + error.message, error.kind); };
  if (!origin.empty() && !is_origin(origin))
    throw InputError(fmt::format(
        "--web-origin '{}': must be the Origin of a site as a browser sends it, for example http://localhost:8081, or "
        "file://; neither null nor * name one",
        printable(origin)));
  ServerOptions options{.address = {}, .readonly = readonly, .foxglove_origin = origin, .limits = {}};
  if (!address.empty()) options.address = or_throw(read_address(address).map_error(named));
  auto server = or_throw(Server::start(options, std::move(hello)).map_error(named));
  report_text(fmt::format("web: {}\n", server->url()));
  return server;
}

}  // namespace tribotwin::twin::live
