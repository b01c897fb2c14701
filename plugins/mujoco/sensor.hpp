#pragma once

#include <span>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/binding.hpp>

/// What a drive knows, as a sensor of the engine: <plugin plugin="tribotwin.sensor" objtype="actuator" objname="...">
/// writes one quantity of that drive, or all of them, to mjData.sensordata.
namespace tribotwin::mujoco {

/// Name of the plugin in MJCF.
inline constexpr char sensor_plugin_name[] = "tribotwin.sensor";

struct SensorQuantity {
  const char* name;  ///< value of the key `quantity`
  const char* unit;
  const char* meaning;
  double (*value)(const mjModel* m, const mjData* d, const Binding& drive);
};
/// In the order of a sensor without the key `quantity`.
std::span<const SensorQuantity> sensor_quantities();

/// The README's table of them.
std::string sensor_reference_markdown();

/// Where a sensor is in a model.
struct Sensor {
  int address = -1;                  ///< in mjData.sensordata
  int drive = -1;                    ///< index in the host's drives; on 3.x the instance
  std::size_t member = 0;            ///< on 3.x: which drive of the instance
  std::size_t first = 0, count = 0;  ///< of sensor_quantities()
};

/// Numbers that a sensor with this value of the key `quantity` writes ("" = all): first and count are set. Fails for an
/// unknown quantity.
Result<Sensor> make_sensor(std::string_view quantity);

/// Writes the quantities of the step under way, whose constraint forces are known: at mjSTAGE_ACC.
void measure(const mjModel* m, mjData* d, const Binding& drive, const Sensor& sensor);

}  // namespace tribotwin::mujoco
