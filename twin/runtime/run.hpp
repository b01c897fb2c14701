#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include <tribotwin/twin/runtime/recorder.hpp>

namespace tribotwin::twin {

struct RunOptions {
  std::filesystem::path directory;                    ///< empty: nothing is written
  bool realtime = false;                              ///< not faster than the clock
  std::function<void(double share, double seconds_left)> progress;
};

/// Runs a scenario to its end. With a directory: telemetry.h5 grows while it runs, scenario.yaml is written first and
/// summary.json, which marks a whole run, last.
tl::expected<Summary, std::string> run(const Scenario& scenario, const RunOptions& options);

}  // namespace tribotwin::twin
