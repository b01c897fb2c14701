#pragma once

#include <map>
#include <memory>
#include <string>
#include <variant>

#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/robot/arm.hpp>

/// Changes on a scenario's time line, and how they are read. The readers throw InputError through their Mapping.
namespace tribotwin::twin {

struct PayloadChange {
  std::shared_ptr<const mujoco::Model> model;  ///< the arm with the payload
};
struct AmbientChange {
  double temperature_degC;
};
struct Wear {
  std::string joint;
  std::map<std::string, double> factors;  ///< by parameter of the law
};
/// A fault of a joint; replaces an earlier one of the same type. Grows with the hours since the event.
struct FaultChange {
  std::size_t drive;
  const drive::FaultInfo* type;
  double severity, growth_per_h;
};
/// Changes nothing: words that stay with the scenario.
struct Marker {
  std::string text;
};
struct Event {
  double time_s = 0;
  std::variant<PayloadChange, AmbientChange, Wear, FaultChange, Marker> what;
};

/// One entry of `events` of a scenario that lasts `duration_s`.
Event read_event(Mapping in, const mujoco::Model& model, double duration_s);

struct FaultSetting {
  const drive::FaultInfo* type;
  double severity;
};
/// A fault's type and severity from the keys `type_key` and `severity`. The run adds `growth` to the severity. Fails
/// where the drive cannot be simulated with the fault.
FaultSetting fault_of(Mapping& in, const std::string& type_key, const mujoco::Model& model, std::size_t drive,
                      double growth = 0);

/// `event`, an entry of `events`, as the last one of the scenario in `resolved_yaml`.
std::string with_event(const std::string& resolved_yaml, const YAML::Node& event);

/// The keys `joint` and `factors`, the latter by name of the law's parameters.
Wear read_wear(Mapping& in, const mujoco::Model& model);

/// The index of a joint's drive. Fails at `key` with the nearest name that exists.
std::size_t drive_index(const mujoco::Model& model, const Mapping& mapping, const std::string& key,
                        const std::string& joint);

}  // namespace tribotwin::twin
