#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/twin/control/compensated_servo.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/recording.hpp>

/// What happens in a run: a YAML file, read strictly. The keys are documented in twin/README.md.
namespace tribotwin::twin {

/// A change on the scenario's time line.
struct PayloadChange {
  std::shared_ptr<const mujoco::Model> model;
};  ///< the arm with it
struct AmbientChange {
  double temperature_degC;
};
struct Wear {
  std::string joint;
  std::map<std::string, double> factors;
};
/// A fault of a joint, in place of an earlier one of the same type. Grows with the hours since the event.
struct FaultChange {
  std::size_t drive;
  const drive::FaultInfo* type;
  double severity, growth_per_h;
};
struct Event {
  double time_s = 0;
  std::variant<PayloadChange, AmbientChange, Wear, FaultChange> what;
};

struct MultiRate {
  bool enabled = false;
  double tolerance_K = 2;  ///< largest temperature change over cycles that are not stepped
};

/// What drives an actuator that is no tribotwin.drive: offset + amplitude sin(2 pi frequency t + phase), in the
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
  std::variant<CascadedOptions, CompensatedOptions, DcPositionOptions, std::vector<double>> control;
  std::optional<Motion> motion;
  std::optional<SetPoints> recording;  ///< of which the motion was made
  bool follow_recorded_temperature = false;
  std::shared_ptr<const mujoco::Model> baseline;  ///< the same mechanism with native friction, to compare with
  DcPositionOptions baseline_control;
  double baseline_delay_s = 0;
  std::vector<Wave> waves;
  std::vector<Event> events;  ///< by time
  double telemetry_rate_hz = 100;
  MultiRate multirate;
};

/// Reads and checks a scenario. `overrides` are key=value with dotted keys. Throws InputError.
Scenario load_scenario(const std::filesystem::path& file, const std::vector<std::string>& overrides = {});

struct FaultSetting {
  const drive::FaultInfo* type;
  double severity;
};
/// A fault's type and severity from the keys `type_key` and `severity`, `growth` coming to the severity during the run.
/// Throws InputError through `in` where the drive cannot have it.
FaultSetting fault_of(Mapping& in, const std::string& type_key, const mujoco::Model& model, std::size_t drive,
                      double growth = 0);

/// A drive's index by joint name; throws InputError through `mapping` with the nearest name.
std::size_t drive_index(const mujoco::Model& model, const Mapping& mapping, const std::string& key,
                        const std::string& joint);

/// Keys `joint` and `factors`, the latter by name of the law's parameters; throws InputError.
Wear read_wear(Mapping& in, const mujoco::Model& model);

}  // namespace tribotwin::twin
