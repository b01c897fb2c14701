#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/live/access.hpp>
#include <tribotwin/twin/live/limits.hpp>
#include <tribotwin/twin/live/protocol/messages.hpp>
#include <tribotwin/twin/live/ring.hpp>

namespace tribotwin::twin::live {

struct ServerOptions {
  Address address;
  bool readonly = false;
  std::string foxglove_origin = {};   ///< the one site that may connect by Foxglove's protocol; empty: our own only
  std::filesystem::path folder = {};  ///< of what pages record and export; empty: they cannot
  /// How many bytes pages may write into that folder; empty: all but a reserve for the record of the program.
  std::function<std::uintmax_t(const std::filesystem::path&)> room = {};
  Limits limits;
};

/// Between two statuses.
inline constexpr std::chrono::milliseconds status_period{200};
/// Between two laws.
inline constexpr std::chrono::milliseconds law_period{1000};

/// The page and the data of a live bench, served by a thread of its own:
///
///     auto server = Server::start({.address = *address}, hello);
///     while (...) (*server)->rows().push([&](std::span<double> row) { ... });
///
/// After `start` one thread calls: that of the steps. Nothing it calls waits for the server or for a viewer; what the
/// server cannot take in time is lost. The end of a server waits at most `farewell` for viewers to get what is left.
class Server {
 public:
  /// Fails where the address cannot be had (ErrorKind::input).
  static Result<std::unique_ptr<Server>> start(const ServerOptions& options, Hello hello);
  ~Server();

  /// Where the page is, with the token if one is needed.
  const std::string& url() const;
  /// Rows as hello.columns says.
  RowRing& rows();
  /// Poses as read_poses writes them; their number is that of the row they belong to.
  Newest& poses();
  /// With the number of events lost so far.
  void tell(Status status);
  void tell(Event event);
  /// The answer to the last command taken; always has room.
  void tell(Done done);
  /// The next command of a page; none as well while answers wait for the server, so that none is ever lost.
  std::optional<Command> take();

 private:
  struct Impl;
  explicit Server(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tribotwin::twin::live
