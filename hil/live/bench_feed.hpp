#pragma once

#include <deque>
#include <string>
#include <vector>

#include <tribotwin/hil/session/drive.hpp>
#include <tribotwin/twin/live/twin_feed.hpp>

/// A bench of drives on a live page.
namespace tribotwin::hil {

/// Tells a server what happens on a bench. For the thread of the session.
class BenchFeed {
 public:
  /// `recording`: the session has a record or telemetry.
  BenchFeed(twin::live::Server& server, const twin::Scenario& scenario, bool recording);
  /// Adds what the pages of a session may ask.
  static void add_commands(twin::live::Hello& hello);
  void sample(const twin::Twin& twin, double time_s) { twin::live::push_row(server_, twin, time_s); }
  /// The status; then commands are obeyed.
  void status(const SessionStatus& session);
  /// Tell what happens in between.
  SessionEvents events();
  void note(const std::string& text);

 private:
  twin::live::Acts acts(SessionControl& control, const Bench& bench);
  std::string inject(SessionControl& control, twin::Mapping& keys);
  void add_times_to_limits(twin::live::Status& status, const twin::Twin& twin);

  twin::live::Server& server_;
  bool recording_;
  const std::vector<std::string> joints_;
  double time_s_ = 0;
  /// Heat of each joint since the start [J], over the last minute of simulated time.
  struct Heat {
    double time_s;
    std::vector<double> joints_J;
  };
  std::deque<Heat> heat_;
};

}  // namespace tribotwin::hil
