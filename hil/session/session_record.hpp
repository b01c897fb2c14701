#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/hil/session/session_file.hpp>

namespace tribotwin::hil {

/// What `drive --record` writes: the log of the bus, and the session file beside it. Both end with the first failure
/// of either (full disk); every call then fails with its message.
class SessionRecord {
 public:
  static Result<SessionRecord> create(const std::filesystem::path& log, const SessionHead& head, bool replace);
  /// Whether a replay can repeat the session whatever happens in it: there is a session file.
  bool repeats() const { return session_.has_value(); }

  /// A new turn; all that follows belongs to it. `time_ns`: CLOCK_REALTIME.
  void begin(std::int64_t time_ns);
  /// Between two turns: an event of the scenario happened, in YAML.
  void event(std::string text) { events_.push_back(std::move(text)); }
  /// Between two turns: the robot stands after so many more cycles, or goes on (Bench::hold).
  void hold(std::optional<std::int64_t> cycles) { hold_ = cycles.value_or(Turn::goes_on); }
  /// A frame of this turn on `bus`. `misleading`: it was not sent by whom its identifier says.
  Result<void> frame(std::size_t bus, Frame frame, bool misleading);
  void fault(const DriveFault& fault) { turn_.faults.push_back({turn_.steps ? Turn::at_end : frames_, fault}); }
  void step() { ++turn_.steps; }
  /// A drive wanted its parameters kept; `done`: they were.
  void keep(bool done) {
    if (!done) turn_.not_kept.push_back(keeps_);
    ++keeps_;
  }
  void recovered(std::size_t bus) { turn_.recovered.push_back(bus); }
  Result<void> end();

  Result<void> flush();
  Result<void> finish();

 private:
  SessionRecord(LogWriter log, std::optional<SessionWriter> session, std::int64_t start_ns)
      : log_(std::move(log)), session_(std::move(session)) {
    begin(start_ns);
  }
  LogWriter log_;
  std::optional<SessionWriter> session_;
  Turn turn_;
  // Of the turn to come.
  std::vector<std::string> events_;
  std::optional<std::int64_t> hold_;
  std::size_t frames_ = 0, keeps_ = 0;  // of this turn
};

}  // namespace tribotwin::hil
