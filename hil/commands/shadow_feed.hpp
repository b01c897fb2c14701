#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/shadow/shadow.hpp>
#include <tribotwin/twin/live/server.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::hil::program {

/// Joints, and a row per cycle: time_s, then of each joint position_rad, velocity_rad_s and the columns of the CSV. It
/// tells no laws: a shadow has no drive whose state they would be of.
twin::live::Hello shadow_hello(const twin::Scenario& scenario, const std::string& version);

/// Tells a server what a shadow finds. For the thread that listens.
class ShadowFeed {
 public:
  struct Options {
    std::string bus;                   ///< its name
    bool recording = false;            ///< a CSV is written
    std::optional<double> limit_nm;    ///< of the residual
    std::vector<std::string> limited;  ///< joints that it holds for; all if empty
  };
  ShadowFeed(twin::live::Server& server, Options options, std::vector<std::string> joints);

  void heard(const Frame& frame);
  void cycle(const ShadowCycle& cycle);
  /// To be called often; now and then it tells the status, and obeys the pages. `lost`: frames, since the start.
  void look(std::uint64_t lost);
  /// The status as it is now.
  void tell(std::uint64_t lost);
  void note(const std::string& text);

 private:
  using Clock = std::chrono::steady_clock;
  twin::live::Server& server_;
  Options options_;
  twin::live::BusStatus bus_;
  std::vector<twin::live::Residual> residual_;
  double time_s_ = 0;
  const Clock::time_point started_ = Clock::now();
  Clock::time_point status_due_ = started_;
};

}  // namespace tribotwin::hil::program
