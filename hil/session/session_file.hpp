#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/hil/can/record_file.hpp>
#include <tribotwin/hil/drives/wiring.hpp>
#include <tribotwin/hil/faults/faults.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

/// What a candump log does not say about a session, in a text file beside it (LOG.session), so that a replay repeats
/// the session: when the program looked at its clock, how far the robot moved then, whose frames were foreign, which
/// drives had injected faults, how the drives started. The log itself stays as candump writes it: tshark and log2long
/// read no comments in it, and tshark no direction marks either.
///
/// One turn per line: microseconds since the turn before, then words for what happened. A turn of which the log says
/// everything has no line. Times are those of the log.
namespace tribotwin::hil {

/// One turn of a session: timers, the frames of the log with this time, steps of the robot, the link.
struct Turn {
  static constexpr std::size_t at_end = static_cast<std::size_t>(-1);
  struct Imposed {
    std::size_t after;  ///< so many frames of the turn; `at_end`: after the steps
    DriveFault fault;
  };

  std::int64_t time_ns = 0;             ///< CLOCK_REALTIME, in whole microseconds
  std::int64_t steps = 0;               ///< of the robot by the clock
  std::vector<std::size_t> misleading;  ///< frames (0, 1, ...) not sent by whom their identifier says
  std::vector<Imposed> faults;
  std::vector<std::size_t> not_kept;   ///< of the commands to store (0, 1, ...) those whose file could not be written
  std::vector<std::size_t> recovered;  ///< buses that were back after a link loss
  std::vector<std::string> events;     ///< of the scenario, which happened before all else: YAML
  static constexpr std::int64_t goes_on = -1;
  std::optional<std::int64_t> hold;  ///< before all else: the robot stands after so many more cycles, or `goes_on`

  bool operator==(const Turn&) const = default;
};
inline bool operator==(const Turn::Imposed& a, const Turn::Imposed& b) {
  return a.after == b.after && a.fault == b.fault;
}

/// A file that told the drives how to start, as it was then: a replay must not depend on what has become of it.
struct StartFile {
  enum class Kind { eds, dcf, store };
  Kind kind = Kind::eds;
  std::filesystem::path name;          ///< for messages
  std::optional<std::string> content;  ///< none: a store that did not exist yet
  bool operator==(const StartFile&) const = default;
};
/// "eds", "dcf", "store": the options that name the files.
std::string_view word_of(StartFile::Kind kind);

/// How the drives of a session started, where that is not as they left the factory.
struct StartConditions {
  bool unconfigured = false;  ///< without node numbers
  std::vector<StartFile> files;
  bool operator==(const StartConditions&) const = default;
};

struct SessionHead {
  bool realtime = false;
  std::uint32_t cycle_us = 2000;
  std::int64_t start_ns = 0;     ///< when the drives booted: the time of the log's first frames
  std::uint32_t scenario = 0;    ///< scenario_checksum
  StartConditions conditions{};  ///< how the drives started
  Wiring wiring{};               ///< its buses are can0, can1, ... in the log
  bool complete = true;          ///< false: of an older version, which wrote no scenario and no conditions
  bool operator==(const SessionHead&) const = default;
};

/// Of the scenario with its settings (--set) and its place.
std::uint32_t scenario_checksum(const twin::Scenario& scenario);

/// Where the session file of a log is or would be; empty where the log is no regular file (a pipe, a device).
std::filesystem::path session_file_of(const std::filesystem::path& log);

class SessionWriter {
 public:
  static Result<SessionWriter> create(const std::filesystem::path& file, const SessionHead& head,
                                      RecordOptions options = {});
  /// Fails once the file cannot take more (full disk); the message names it.
  Result<void> write(const Turn& turn);
  Result<void> flush() { return out_.flush(); }
  /// Writes that the session ended in order, and closes the file.
  Result<void> finish();

 private:
  SessionWriter(RecordFile out, std::int64_t start_ns) : out_(std::move(out)), last_ns_(start_ns) {}
  RecordFile out_;
  std::int64_t last_ns_;
};

/// The wiring of a recorded session: empty where there is no session file, or one bus
/// with all drives in their order.
Result<Wiring> recorded_wiring(const std::filesystem::path& log);

class SessionReader {
 public:
  /// Fails with file and line where the head is none.
  static Result<SessionReader> open(const std::filesystem::path& file);
  const SessionHead& head() const { return head_; }
  const std::filesystem::path& file() const { return file_; }
  /// The next turn; false at the end. Fails with file and line where a line is none.
  Result<bool> next(Turn& turn);
  /// After the last turn: whether the session ended in order. Else it was killed, or its disk was full.
  bool complete() const { return complete_; }

 private:
  Result<void> read_head();
  bool read_bus(const std::string& line);
  Result<void> read_conditions();
  Result<StartFile> read_start_file(StartFile::Kind kind, std::string_view size_and_name);
  std::filesystem::path file_;
  std::ifstream in_;
  std::size_t line_ = 0;
  SessionHead head_;
  std::int64_t last_ns_ = 0;
  bool complete_ = false;
};

}  // namespace tribotwin::hil
