#include <fmt/format.h>

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/live/web_options.hpp>

namespace tribotwin::twin::live {

namespace {

/// Of the folder that is given; that of the results may be made later.
void check_folder(const std::string& folder) {
  std::error_code error;
  if (!std::filesystem::is_directory(folder, error))
    throw InputError(fmt::format("--web-folder {}: is no folder; name one that exists", printable(folder)));
  or_wrong_input(check_output(std::filesystem::path(folder) / "live.mcap", Existing::replace));
}

}  // namespace

std::unique_ptr<Server> WebOptions::start(Hello hello, const std::filesystem::path& results) const {
  if (!given()) return nullptr;
  const auto named = [](Error error) { return Error("--web " + error.message, error.kind); };
  if (!origin.empty() && !is_origin(origin))
    throw InputError(fmt::format(
        "--web-origin '{}': must be the Origin of a site as a browser sends it, for example http://localhost:8081, or "
        "file://; neither null nor * name one",
        printable(origin)));
  ServerOptions options{.address = {},
                        .readonly = readonly,
                        .foxglove_origin = origin,
                        .folder = results.empty() ? std::filesystem::path(".") : results,
                        .limits = {}};
  if (!folder.empty()) check_folder(folder), options.folder = folder;
  if (!address.empty()) options.address = or_throw(read_address(address).map_error(named));
  auto server = or_throw(Server::start(options, std::move(hello)).map_error(named));
  report_text(fmt::format("web: {}\n", server->url()));
  return server;
}

}  // namespace tribotwin::twin::live
