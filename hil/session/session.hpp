#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/hil/session/faults.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>

namespace tribotwin::hil {

/// A drive session as its status line shows it.
struct SessionStatus {
  double simulated_s, wall_s, bus_load;  ///< load: share of 1 Mbit/s in the last second
  const Bench* bench;
  const Transport* bus;
};

struct DriveOptions {
  Profile profile = Profile::cia402;
  int first_node = 1;
  std::uint32_t cycle_us = 2000;
  bool realtime = false;                             ///< physics on the clock instead of on SYNC
  std::optional<double> duration_s;                  ///< of simulated time; for ever without
  std::filesystem::path record;                      ///< a candump log of everything on the bus
  std::filesystem::path statistics;                  ///< JSON
  std::filesystem::path output;                      ///< folder for telemetry
  twin::Existing existing = twin::Existing::refuse;  ///< what happens to older records and statistics
  std::vector<Fault> faults;                         ///< on purpose, by simulated time
  std::function<bool()> stop;                        ///< asked often: end now?
  std::function<void(const SessionStatus&)> status;  ///< a few times a second
  std::function<void(const std::string&)> note;      ///< what the user should know, one line
};

/// Drives on a bus until the end. A record that cannot be written any more (full disk) is noted and given up; the
/// drives go on. Fails at the end with one line: what was lost, or that `stop` came before `duration_s` was over.
Result<void> drive(const twin::Scenario& scenario, Transport& bus, const DriveOptions& options);

struct ReplayResult {
  std::uint64_t frames = 0;    ///< in the log
  std::uint64_t compared = 0;  ///< of them, from the drives
  std::uint64_t differing = 0;
  std::uint64_t missing = 0;  ///< in the log, not said now
  std::uint64_t added = 0;    ///< said now, not in the log; not counted for `silent` drives and interrupted replays
  std::vector<std::string> silent;  ///< joints whose drives say nothing in the log: nothing was compared
  bool interrupted = false;
  std::string first_difference;  ///< one line; empty if all is the same
};
struct ReplayOptions {
  Profile profile = Profile::cia402;
  int first_node = 1;
  std::uint32_t cycle_us = 2000;
  double rate = 0;  ///< of the original speed; 0: as fast as possible
  std::filesystem::path output;
  twin::Existing existing = twin::Existing::refuse;  ///< what happens to an older record in it
  std::function<bool()> stop;
};
/// A recorded session through the same code: what the drives answered then is compared with what they answer now.
Result<ReplayResult> replay(const twin::Scenario& scenario, const std::filesystem::path& log,
                            const ReplayOptions& options);

}  // namespace tribotwin::hil
