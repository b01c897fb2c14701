#pragma once

#include <deque>
#include <memory>
#include <string>
#include <vector>

#include <tribotwin/twin/live/protocol/foxglove.hpp>
#include <tribotwin/twin/live/row_files.hpp>
#include <tribotwin/twin/live/server.hpp>

namespace tribotwin::twin::live {

class Viewer;
using Text = std::shared_ptr<const std::string>;

/// A status or event as JSON, and when it was.
struct Told {
  Text text;
  double time_s = 0;
};

/// What the connections of a server share. Of the server's thread alone, but for `commands`.
struct Hub {
  ServerOptions options;
  Hello hello;
  std::string token;  ///< empty: none is needed
  Text hello_text;
  Text poses;  ///< a binary message; nullptr: none came yet
  Told status;
  std::deque<Told> events;
  foxglove::Topics foxglove_topics;
  Text foxglove_info, foxglove_channels;
  std::size_t connections = 0;
  std::uint64_t viewers_so_far = 0;
  std::vector<std::shared_ptr<Viewer>> viewers;
  Queue<Command, 64> commands;
  std::unique_ptr<RowFiles> files;  ///< nullptr: rows cannot be recorded
};

/// A connection counts as long as its place is kept.
class Place {
 public:
  explicit Place(Hub& hub) : hub_(&hub) { ++hub_->connections; }
  Place(Place&& other) noexcept : hub_(std::exchange(other.hub_, nullptr)) {}
  Place& operator=(Place&&) = delete;
  ~Place() {
    if (hub_) --hub_->connections;
  }

 private:
  Hub* hub_;
};

}  // namespace tribotwin::twin::live
