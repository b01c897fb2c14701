#pragma once

#include <chrono>

#include <tribotwin/twin/live/commands.hpp>
#include <tribotwin/twin/live/server.hpp>
#include <tribotwin/twin/simulation/run.hpp>

/// A twin on a live bench.
namespace tribotwin::twin::live {

/// Joints and columns: time_s, then the channels of telemetry.h5, joint by joint.
Hello hello_of(const Scenario& scenario, std::string program, std::string version);

/// The states of its joints, for their laws.
std::vector<drive::Workspace> joints_of(const Twin& twin);

/// What telemetry.h5 has of the step that began at `time_s`. For the thread of the steps.
void push_row(Server& server, const Twin& twin, double time_s);

/// Tells a server what happens to a twin. For the thread of its steps.
class TwinFeed {
 public:
  /// `recording`: the run writes telemetry.
  TwinFeed(Server& server, bool recording) : server_(server), recording_(recording) {}
  /// Adds what its pages may ask.
  static void add_commands(Hello& hello);
  /// A row as telemetry.h5 has it, of the step that began at `time_s`.
  void sample(const Twin& twin, double time_s);
  /// To be called between steps, and again while it is true: a page has paused the run. Now and then obeys commands and
  /// tells the status.
  bool held(RunningTwin& run);

 private:
  Acts acts(RunningTwin& run);
  void tell_status(const Twin& twin);
  using Clock = std::chrono::steady_clock;
  Server& server_;
  const bool recording_;
  const Clock::time_point started_ = Clock::now();
  Clock::time_point status_due_ = started_;
  std::optional<std::int64_t> rows_left_;  // until the run stands
};

}  // namespace tribotwin::twin::live
