#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/hil/session/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>

namespace tribotwin::hil {

struct ReplayResult {
  std::uint64_t frames = 0;    ///< in the log
  std::uint64_t compared = 0;  ///< of them, from the drives
  std::uint64_t differing = 0;
  std::uint64_t missing = 0;  ///< in the log, not said now
  std::uint64_t added = 0;    ///< said now, not in the log; not counted for `silent` drives and interrupted replays
  std::vector<std::string> silent;  ///< joints whose drives say nothing in the log: nothing was compared
  bool interrupted = false;
  bool session_file = false;  ///< there was one beside the log
  /// Why the end was not compared: the session file has none, because the session was killed. Empty otherwise.
  std::string cut;
  std::string first_difference;  ///< one line; empty without a difference
};
struct ReplayOptions {
  Profile profile = Profile::cia402;
  int first_node = 1;
  Wiring wiring;                      ///< the drives on each bus; all on one without: then any channel is that bus
  std::vector<std::string> channels;  ///< what the log calls these buses; can0, can1, ... without
  std::uint32_t cycle_us = 2000;
  std::vector<NodeSetup> nodes;  ///< how they start, see BenchOptions; of a session file: made of its conditions
  double rate = 0;               ///< of the original speed; 0: as fast as possible
  std::filesystem::path output;
  twin::Existing existing = twin::Existing::refuse;  ///< what happens to an older record in it
  std::function<bool()> stop;
  std::function<void(const SessionStatus&)>
      status;  ///< five times a second, also while a pause of the log is waited for
  /// What telemetry.h5 would hold, see DriveOptions.
  std::function<void(const twin::Twin&, double time_s)> sample;
  std::function<void(const std::string&)> note;  ///< the first difference, when it is found
  SessionEvents events;
};
/// Runs a recorded session through the same code and compares the frames of the drives with the recorded ones. With the
/// session file beside the log every session repeats; without it the log is taken for one in lockstep without injected
/// faults. Fails when reading or the simulation fails (ErrorKind::work), where a line of the log is no frame,
/// where `output` may not be written, and where log, session file and options do not belong together
/// (ErrorKind::input).
Result<ReplayResult> replay(const twin::Scenario& scenario, const std::filesystem::path& log,
                            const ReplayOptions& options);

}  // namespace tribotwin::hil
