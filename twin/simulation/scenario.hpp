#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <tribotwin/twin/control/compensated_servo.hpp>
#include <tribotwin/twin/robot/recording.hpp>
#include <tribotwin/twin/simulation/event.hpp>

/// What happens in a run, read from a YAML file. The keys are documented in twin/README.md.
namespace tribotwin::twin {

struct MultiRate {
  bool enabled = false;
  double tolerance_K = 2;  ///< max. temperature change over skipped cycles
};

/// Control of an actuator that is no tribotwin.drive: offset + amplitude sin(2 pi frequency t + phase), in the
/// actuator's unit.
struct Wave {
  int control;  ///< in mjData.ctrl
  double offset = 0, amplitude = 0, frequency_hz = 0, phase_rad = 0;
  double operator()(double time_s) const;
};

/// A scenario ready to run: the model is loaded and everything in the file has been checked against it.
struct Scenario {
  std::filesystem::path file;
  std::string name, description;
  std::string resolved_yaml;  ///< the same scenario with every path absolute and every --set applied
  std::shared_ptr<const mujoco::Model> model;
  double duration_s = 0;
  std::uint64_t seed = 1;
  std::optional<double> ambient_degC;
  std::vector<double> start_rad;         ///< per drive
  std::vector<double> temperature_degC;  ///< per drive, at the start
  std::variant<CascadedOptions, CompensatedOptions, std::vector<DcPositionOptions>, std::vector<double>> control;
  std::optional<Motion> motion;
  std::optional<SetPoints> recording;  ///< source of the motion, if it is a recorded one
  bool follow_recorded_temperature = false;
  std::shared_ptr<const mujoco::Model> baseline;  ///< the same mechanism with MuJoCo's native friction, for comparison
  DcPositionOptions baseline_control;
  double baseline_delay_s = 0;
  std::vector<Wave> waves;
  std::vector<Event> events;  ///< by time
  double telemetry_rate_hz = 100;
  MultiRate multirate;
  std::vector<std::string> expects;  ///< health checks of which no result is a warning
};

/// Reads and checks a scenario. `settings` are key=value with dotted keys, applied over the file. An error names file,
/// line, key and the accepted range.
Result<Scenario> load_scenario(const std::filesystem::path& file, const std::vector<std::string>& settings = {});

}  // namespace tribotwin::twin
