#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/faults/faults.hpp>
#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/hil/session/session_file.hpp>
#include <tribotwin/hil/timing/sync_timing.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>

namespace tribotwin::hil {

/// What can be done to a running session.
class SessionControl {
 public:
  virtual ~SessionControl() = default;
  /// A fault begins now, as read_fault reads it. Throws InputError.
  virtual void inject(twin::Mapping& keys) = 0;
  /// An event of a scenario happens now (Plant::happen); whether a record has it. Throws InputError.
  virtual bool happen(YAML::Node event) = 0;
  /// As Bench::hold, in the record too. Throws InputError where that could not repeat it.
  virtual void hold(std::optional<std::int64_t> cycles) = 0;
};

/// State of a session for its status line.
struct SessionStatus {
  struct Bus {
    const Transport* transport;        ///< nullptr in a replay
    double bits_per_s;                 ///< since the last one
    std::optional<double> bit_rate;    ///< [bit/s] of a bus that has one
    const SyncTiming* sync = nullptr;  ///< none in a replay
  };
  double simulated_s, wall_s;
  std::uint64_t overruns;  ///< steps in real time that began more than a step too late
  const Bench* bench;
  std::vector<Bus> buses;
  SessionControl* control = nullptr;  ///< none in a replay
};

/// What a session says at the moment it is so, at simulated time `time_s`. Functions may be empty.
struct SessionEvents {
  /// A drive sends an EMCY: its error code, 0: no error any more.
  std::function<void(double time_s, std::size_t drive, std::uint16_t code)> emcy;
  /// Of a replay: an event of a scenario that the session had happens again.
  std::function<void(double time_s, const YAML::Node& event)> happened;
  /// Of a replay: an injected fault of a drive begins or ends again.
  std::function<void(double time_s, const DriveFault& fault)> imposed;
};

struct DriveOptions {
  Profile profile = Profile::cia402;
  int first_node = 1;
  Wiring wiring;  ///< the drives on each bus; all on one without
  std::uint32_t cycle_us = 2000;
  std::vector<NodeSetup> nodes;      ///< how they start, see BenchOptions
  StartConditions conditions;        ///< what `nodes` were made of, for the record
  bool realtime = false;             ///< physics on the clock instead of on SYNC
  std::optional<double> duration_s;  ///< of simulated time [s]; unlimited without
  std::optional<double> bit_rate;    ///< [bit/s] of all buses, for their load; without: their own
  std::filesystem::path record;      ///< a candump log of everything on the bus, and LOG.session
  std::filesystem::path statistics;  ///< JSON
  /// Gets the same text.
  std::function<void(const std::string&)> show_statistics;
  std::filesystem::path output;                      ///< folder for telemetry
  twin::Existing existing = twin::Existing::refuse;  ///< what happens to older records and statistics
  std::vector<Fault> faults;                         ///< injected, by simulated time
  std::function<bool()> stop;                        ///< polled often; true ends the session
  std::function<void(const SessionStatus&)> status;  ///< a few times a second
  /// What telemetry.h5 would hold, also without `output`, after each step that it has a sample of.
  std::function<void(const twin::Twin&, double time_s)> sample;
  std::function<void(const std::string&)> note;  ///< called with messages of one line for the user
  SessionEvents events;
};

/// Runs the drives of a scenario on a bus until `duration_s` or `stop`. When a record cannot be written any more (full
/// disk), a note says so and the drives continue without it. Fails at the end with one line: what was lost, or that
/// `stop` came before `duration_s` was over.
Result<void> drive(const twin::Scenario& scenario, Transport& bus, const DriveOptions& options);
/// The same on as many buses as `wiring` has.
Result<void> drive(const twin::Scenario& scenario, std::span<Transport* const> buses, const DriveOptions& options);

}  // namespace tribotwin::hil
