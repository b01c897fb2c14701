#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/portable/fmu_variables.hpp>
#include <tribotwin/twin/portable/joint_parameters.hpp>

namespace tribotwin::twin {
namespace {

using drive::Dynamics;

/// Adds one symbol of a unit to its powers.
void add_symbol(FmuUnit& unit, std::string_view symbol, int power) {
  const auto add = [&](int kg, int m, int s, int K, int rad) {
    unit.kg += power * kg, unit.m += power * m, unit.s += power * s, unit.K += power * K, unit.rad += power * rad;
  };
  if (symbol == "Nm" || symbol == "J")
    add(1, 2, -2, 0, 0);
  else if (symbol == "W")
    add(1, 2, -3, 0, 0);
  else if (symbol == "N")
    add(1, 1, -2, 0, 0);
  else if (symbol == "m")
    add(0, 1, 0, 0, 0);
  else if (symbol == "s")
    add(0, 0, 1, 0, 0);
  else if (symbol == "rad")
    add(0, 0, 0, 0, 1);
  else if (symbol == "K" || symbol == "degC")
    add(0, 0, 0, 1, 0);
  else if (symbol == "A")
    unit.A += power;
  else if (symbol == "ohm")
    add(1, 2, -3, 0, 0), unit.A -= 2 * power;
  else
    unit.known = false;
}

void add_outputs(const drive::Drive& d, std::vector<FmuVariable>& all) {
  const auto add = [&](const char* name, const char* unit, const char* meaning, FmuKind kind, const char* member) {
    all.push_back({.name = name, .unit = unit, .meaning = meaning, .kind = kind, .member = member});
  };
  add("friction_nm", "Nm", "friction in the last step, arm side, positive with motion; at rest that of the bristles",
      FmuKind::output, "joint.friction_nm");
  add("limit_nm", "Nm", "up to which friction holds the joint at rest", FmuKind::output, "joint.limit_nm");
  add("heat_W", "W", "heat of the friction in the last step", FmuKind::output, "heat_W");
  if (has_heat(d)) add("temperature_degC", "degC", "temperature of the lubricant", FmuKind::output, "temperature_degC");
  add("heat_J", "J", "heat since the start", FmuKind::local, "joint.heat_J");
  add("position_rad", "rad", "angle since the start", FmuKind::local, "joint.position_rad");
  add("load_seen_nm", "Nm", "load that friction sees", FmuKind::local, "joint.load_nm");
  for (int i = 0; i < thermal::info(d.thermal.order).nodes; ++i)
    all.push_back({.name = fmt::format("node{}_K", i + 1),
                   .unit = "K",
                   .meaning = "part of the lubricant's temperature above T_amb",
                   .kind = FmuKind::local,
                   .member = fmt::format("joint.node_K[{}]", i)});
  if (d.dynamics == Dynamics::lugre)
    add("bristle_rad", "rad", "deflection of the bristles, on the law's side", FmuKind::local, "joint.bristle");
  if (d.dynamics == Dynamics::gear_loss)
    add("bristle", "1", "z of the gear loss, -1 .. 1", FmuKind::local, "joint.bristle");
  add("backlash_position", "1", "within the backlash, -1 .. 1", FmuKind::local, "joint.backlash_position");
}

/// Results of the winding, if there is one.
void add_winding(const drive::Drive& d, std::vector<FmuVariable>& all) {
  if (!d.winding.present()) return;
  const auto add = [&](const char* name, const char* unit, const char* meaning, FmuKind kind, const char* member) {
    all.push_back({.name = name, .unit = unit, .meaning = meaning, .kind = kind, .member = member});
  };
  add("winding_temperature_degC", "degC", "temperature of the winding", FmuKind::output, "winding_degC");
  add("motor_current_A", "A", "current that load, friction and offset need, at most its limit", FmuKind::output,
      "joint.current_A");
  add("motor_current_limit_A", "A", "largest current that the drive gives in the step", FmuKind::output,
      "joint.current_limit_A");
  add("overload", "1", "share of the overload that I^2 t protection allows; 0 without", FmuKind::output,
      "joint.overload");
  add("copper_loss_J", "J", "heat made in the winding since the start", FmuKind::local, "joint.copper_loss_J");
  add("winding_heat_J", "J", "of it, what has flowed to the gear: a part of heat_J", FmuKind::local,
      "joint.winding_heat_J");
}

void add_start(const char* name, const char* meaning, double T_amb_degC, const char* member,
               std::vector<FmuVariable>& all) {
  all.push_back({.name = name,
                 .unit = "degC",
                 .meaning = meaning,
                 .kind = FmuKind::fixed,
                 .start = T_amb_degC,
                 .minimum = -273.15,
                 .maximum = 1000,
                 .member = member});
}

void add_faults(const drive::Drive& d, std::vector<FmuVariable>& all) {
  const auto add = [&](const char* name, const char* unit, const char* meaning, double minimum, double maximum) {
    all.push_back({.name = fmt::format("fault_{}", name),
                   .unit = unit,
                   .meaning = meaning,
                   .kind = FmuKind::tunable,
                   .minimum = minimum,
                   .maximum = maximum,
                   .member = fmt::format("joint.{}", name)});
  };
  add("boundary", "1", "fault: relative change of boundary friction", -0.99, 100);
  add("stribeck_velocity", "1", "fault: relative change of the Stribeck velocities", -0.99, 100);
  add("viscous", "1", "fault: relative change of viscous friction", -0.99, 100);
  add("ripple", "1", "pitted bearing: friction times (1 + ripple cos(motor angle))", 0, 1);
  add("backlash_rad", "rad", "backlash, arm side", 0, 1);
  if (d.winding.present())
    add("torque_loss", "1", "fault: share of the torque computed from the current that does not come", 0, 0.9);
}

}  // namespace

bool has_heat(const drive::Drive& d) { return d.thermal.order != thermal::Order::prescribed; }

FmuUnit fmu_unit(const std::string& unit) {
  FmuUnit u;
  if (unit == "-" || unit == "1") return u.name = "1", u;
  if (unit == "degC") return u.name = unit, u.K = 1, u.offset = 273.15, u;
  std::string above, below;
  int below_count = 0;
  for (std::size_t at = 0; at < unit.size();) {
    const bool divides = unit[at] == '/';
    if (divides || unit[at] == ' ') ++at;
    const std::size_t end = unit[at] == '(' ? unit.size() : std::min(unit.find_first_of(" /", at), unit.size());
    const std::string factor = unit.substr(at, end - at);
    const std::size_t hat = factor.find('^');
    const std::string symbol = factor.substr(0, hat);
    at = end;
    if (symbol == "1") continue;
    const int power = hat == factor.npos || factor[0] == '(' ? 1 : factor[hat + 1] - '0';
    add_symbol(u, symbol, divides ? -power : power);
    std::string spelled = symbol == "Nm" ? "N.m" : factor[0] == '(' ? factor : symbol;
    if (power != 1) spelled += std::to_string(power);
    std::string& side = divides ? below : above;
    side += (side.empty() ? "" : ".") + spelled;
    below_count += divides;
  }
  u.name = above.empty() ? "1" : above;
  if (below_count > 0) u.name += below_count > 1 ? "/(" + below + ")" : "/" + below;
  return u;
}

std::vector<FmuVariable> fmu_variables(const drive::Drive& d) {
  std::vector<FmuVariable> all;
  const double T_amb = d.thermal.T_amb_degC;
  all.push_back({.name = "time", .unit = "s", .meaning = "time", .kind = FmuKind::independent, .member = "time_s"});
  all.push_back({.name = "speed_rad_s",
                 .unit = "rad/s",
                 .meaning = "speed of the joint, constant in a step",
                 .kind = FmuKind::input,
                 .member = "speed_rad_s"});
  all.push_back({.name = "load_nm",
                 .unit = "Nm",
                 .meaning = "torque that the gear transmits to the arm, constant in a step",
                 .kind = FmuKind::input,
                 .member = "load_nm"});
  all.push_back({.name = has_heat(d) ? "ambient_degC" : "temperature_degC",
                 .unit = "degC",
                 .meaning = has_heat(d) ? "temperature of the surroundings" : "temperature of the lubricant",
                 .kind = FmuKind::input,
                 .start = T_amb,
                 .minimum = -273.15,
                 .maximum = 1000,
                 .member = has_heat(d) ? "ambient_degC" : "held_degC"});
  add_outputs(d, all);
  add_winding(d, all);
  if (has_heat(d))
    add_start("temperature_start_degC", "temperature of the lubricant at the start", T_amb, "start_degC", all);
  if (d.winding.present())
    add_start("winding_temperature_start_degC", "temperature of the winding at the start", T_amb, "winding_start_degC",
              all);
  for (const JointParameter& p : joint_parameters(d))
    all.push_back({.name = std::string(p.name),
                   .unit = p.unit,
                   .meaning = std::string(p.meaning),
                   .kind = FmuKind::tunable,
                   .start = p.value,
                   .minimum = p.minimum,
                   .maximum = p.maximum,
                   .member = fmt::format("joint.p.{}", p.name)});
  add_faults(d, all);
  all.push_back({.name = "outside",
                 .unit = "",
                 .meaning = "an input lay outside the range of the law, or was no number",
                 .kind = FmuKind::output,
                 .member = ""});
  return all;
}

}  // namespace tribotwin::twin
