#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/sensor.hpp>

namespace tribotwin::mujoco {
namespace {

/// Torque of the joint's friction row, which carries gear and brake, positive with motion.
double row_torque_nm(const mjData* d, const Binding& b) {
  const int row = engine::friction_row(d, b.dof, b.row_hint);
  return row >= 0 ? -d->efc_force[row] : 0;
}

double largest_change(const drive::Workspace& s) {
  return *std::ranges::max_element(s.change, {}, [](double change) { return std::abs(change); });
}

constexpr SensorQuantity quantities[] = {
    {"temperature", "degC", "lubricant",
     [](const mjModel*, const mjData* d, const Binding& b) { return drive::temperature_degC(b.drive, state(d, b)); }},
    {"friction", "Nm", "friction torque of the gear at the joint, positive with motion, brake and offset excluded",
     [](const mjModel*, const mjData* d, const Binding& b) {
       return drive::gear_friction_nm(workspace(d, b), row_torque_nm(d, b));
     }},
    {"load", "Nm", "gear torque of the step before, at the joint: what friction is evaluated at",
     [](const mjModel*, const mjData* d, const Binding& b) { return state(d, b).load_nm; }},
    {"brake", "1", "holding brake, 0 released to 1 engaged",
     [](const mjModel*, const mjData* d, const Binding& b) { return workspace(d, b).brake_engaged; }},
    {"stuck", "1", "1 while friction or the brake holds the joint, else 0",
     [](const mjModel*, const mjData* d, const Binding& b) {
       return drive::holds(b.drive, state(d, b), workspace(d, b), row_torque_nm(d, b)) ? 1.0 : 0.0;
     }},
    {"wear", "1", "relative change of the law parameter that has changed most",
     [](const mjModel*, const mjData* d, const Binding& b) { return largest_change(workspace(d, b)); }},
};

}  // namespace

std::span<const SensorQuantity> sensor_quantities() { return quantities; }

Result<Sensor> make_sensor(std::string_view quantity) {
  if (quantity.empty()) return Sensor{.first = 0, .count = std::size(quantities)};
  for (std::size_t i = 0; i < std::size(quantities); ++i)
    if (quantities[i].name == quantity) return Sensor{.first = i, .count = 1};
  std::vector<std::string_view> names;
  for (const SensorQuantity& q : quantities) names.push_back(q.name);
  return tl::unexpected<Error>(fmt::format("key 'quantity' is '{}' but must be one of {}, or absent for all of them",
                                           quantity, fmt::join(names, ", ")));
}

std::string sensor_reference_markdown() {
  std::string out =
      "\n### Sensors: `tribotwin.sensor`\n\n"
      "With the key `quantity` a sensor is one number, without it all of them in this order.\n\n"
      "| `quantity` | unit | meaning |\n|---|---|---|\n";
  for (const SensorQuantity& q : quantities) out += fmt::format("| `{}` | {} | {} |\n", q.name, q.unit, q.meaning);
  return out;
}

void measure(const mjModel* m, mjData* d, const Binding& drive, const Sensor& sensor) {
  for (std::size_t i = 0; i < sensor.count; ++i)
    d->sensordata[sensor.address + static_cast<int>(i)] = quantities[sensor.first + i].value(m, d, drive);
}

}  // namespace tribotwin::mujoco
