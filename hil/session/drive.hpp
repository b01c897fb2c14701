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

}  // namespace tribotwin::hil
