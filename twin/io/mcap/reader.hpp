#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

/// MCAP, the container of timed messages that ROS 2, Foxglove and Lichtblick write and read. Specification 1.0:
/// https://mcap.dev/spec
namespace tribotwin::twin::mcap {

/// What the messages of one topic are; names as in the file, not trusted to be printable.
struct Channel {
  std::string topic;
  std::string encoding;  ///< of the messages: "cdr", "json", ..
  std::string schema;    ///< their type: "sensor_msgs/msg/JointState"; empty without schema

  bool operator==(const Channel&) const = default;
};

using Visit = std::function<Result<void>(const Channel& channel, std::uint64_t log_time_ns, std::string_view data)>;

struct Contents {
  std::vector<Channel> channels;  ///< in the order of the file
  std::string cut_off;            ///< why the file is read in part, with the place; empty: it is whole
};

/// Calls `visit` for every message in the order of the file, with or without chunks, index and summary. Checksums of
/// chunks, of the data and of the summary are checked where they are given; memory is at most the largest record and
/// the largest chunk. A file whose recorder was killed (no end, no damage before) is read up to its last whole record
/// or chunk. Fails with the file and the place [byte] where anything is damaged, and where `visit` fails.
Result<Contents> read(const std::filesystem::path& file, const Visit& visit);

/// Whether a file begins like MCAP.
bool begins_as_mcap(std::string_view first_bytes);

}  // namespace tribotwin::twin::mcap
