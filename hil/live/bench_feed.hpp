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
  BenchFeed(twin::live::Server& server, bool recording) : server_(server), recording_(recording) {}
  void sample(const twin::Twin& twin, double time_s) { twin::live::push_row(server_, twin, time_s); }
  /// The status, and an event for each drive whose error code changed since the last one; then commands are
  /// obeyed.
  void status(const SessionStatus& session);
  void note(const std::string& text);

 private:
  twin::live::Acts acts(SessionControl& control);
  std::string inject(SessionControl& control, twin::Mapping& keys);
  std::string happen(SessionControl& control, const YAML::Node& event);
  void tell_errors(const twin::live::Status& status);
  void add_times_to_limits(twin::live::Status& status, const twin::Twin& twin);

  twin::live::Server& server_;
  bool recording_;
  double time_s_ = 0;
  std::vector<std::uint16_t> codes_;
  /// Heat of each joint since the start [J], over the last minute of simulated time.
  struct Heat {
    double time_s;
    std::vector<double> joints_J;
  };
  std::deque<Heat> heat_;
};

}  // namespace tribotwin::hil
