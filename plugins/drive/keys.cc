#include <algorithm>
#include <string>
#include <vector>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/keys.hpp>

namespace tribotwin::drive {
namespace {

constexpr double large = 1e9;
constexpr Key numbers[] = {
    {"torque_max_nm", "Nm", "", 1e-9, large,
     "largest manipulation torque at low speed (Bittencourt 2012), arm side: unit of load and of normalised laws"},
    {"gear_ratio", "1", "", 1e-6, 1e6, "motor turns per joint turn"},
    {"T_amb", "degC", "25", -100, 300, "ambient temperature; the temperature at reset"},
    {"brake_torque_nm", "Nm", "0", 0, large, "holding brake, arm side"},
    {"load_filter_s", "s", "0", 0, 100,
     "time constant of the load that friction sees; 0 = the load of the step before"},
    {"kp", "Nm/rad", "0", 0, large, "of control=\"position\": torque per angle; above 0"},
    {"kv", "Nm s/rad", "0", 0, large, "of control=\"position\": torque against speed"},
    {"asymmetry", "1", "0", -0.99, 0.99,
     "the friction level is (1 + asymmetry) times the law's with positive motion, (1 - asymmetry) times with negative"},
    {"offset_nm", "Nm", "0", -large, large,
     "torque against positive motion at every speed, arm side (N for a slide): spring, cable, unknown weight; it is no "
     "heat"},
    {"speed_max_rad_s", "rad/s", "of the law", 0, 1e6, "end of the law's range, on the law's side"},
    {"load_max", "-", "of the law", 0, 1e3, "end of the law's range, load / torque_max_nm"},
    {"temperature_min_degC", "degC", "of the law", -273.15, 1000, "start of the law's range"},
    {"temperature_max_degC", "degC", "of the law", -273.15, 1000, "end of the law's range"},
};
constexpr Key words[] = {
    {"law", "", "", 0, 0, "friction law, one of the table below"},
    {"thermal", "", "prescribed", 0, 0, ""},
    {"friction", "", "static", 0, 0,
     "static (the law limits a constraint), lugre or gear_loss (bristles over the law; the actuator then has actdim "
     "4)"},
    {"control", "", "torque", 0, 0,
     "torque: the control is the motor torque; position: it is a joint angle, as of MuJoCo's position actuator"},
    {"validity", "", "clamp", 0, 0, "outside the law's range: clamp, extrapolate or error"},
};
/// Of friction="lugre": RH380-N study (5).
constexpr Key lugre_keys[] = {
    {"sigma0", "law/rad", "", 1e-12, 1e15, "bristle stiffness: unit of the law per rad on its side"},
    {"sigma1", "law s/rad", "", 0, 1e15, "bristle damping at standstill: unit of the law per rad/s on its side"},
    {"vd", "rad/s", "", 1e-9, 1e9, "speed over which that damping fades, e^-(w/vd)^2, on the law's side"},
};
/// Of friction="gear_loss".
constexpr Key gear_loss_keys[] = {
    {"mu_avg", "1", "", 0, 1, "friction per load torque, mean of both directions"},
    {"mu_dif", "1", "", -1, 1, "half the difference, driving minus driven; |mu_dif| <= mu_avg, mu_avg + |mu_dif| < 1"},
    {"h", "rad", "", 1e-12, 1e9, "length of motion over which friction reverses, on the law's side"},
};
constexpr DynamicsInfo dynamics[] = {{"static", Dynamics::none, {}},
                                     {"lugre", Dynamics::lugre, lugre_keys},
                                     {"gear_loss", Dynamics::gear_loss, gear_loss_keys}};
constexpr Key lists[] = {
    {"load_table_speeds", "rad/s", "", 0, 1e6, "load table: speeds |w| on the law's side, ascending"},
    {"load_table_loads", "-", "", -1e3, 1e3,
     "load table: loads / torque_max_nm, ascending; above 0 the gear drives the load, below 0 the load drives"},
    {"load_table_values", "law", "", -1e9, 1e9,
     "load table: friction added to the law's weakening part, a row of loads per speed, unit of the law (RH380-N study "
     "(4))"},
};
constexpr Key winding_table[] = {
    {"winding_resistance_ohm", "ohm", "no winding", 1e-9, large,
     "winding: resistance R at winding_reference_degC, of the DC motor with the same copper loss I^2 R"},
    {"torque_constant_nm_A", "Nm/A", "", 1e-9, large,
     "winding: torque per current at winding_reference_degC, motor side"},
    {"winding_heat_capacity_J_K", "J/K", "", 1e-9, large, "winding: heat capacity C"},
    {"winding_thermal_resistance_K_W", "K/W", "", 1e-9, large, "winding: thermal resistance R_th to the gear"},
    {"winding_copper_1_K", "1/K", "0.00393", 0, 0.02, "winding: relative rise of the resistance per K"},
    {"winding_magnet_1_K", "1/K", "0.001", 0, 0.02, "winding: relative fall of the torque constant per K"},
    {"winding_reference_degC", "degC", "25", -100, 300, "winding: temperature of resistance and torque constant"},
    {"winding_warning_degC", "degC", "130", -100, 1000, "winding: from here on the current limit falls"},
    {"winding_limit_degC", "degC", "155", -100, 1000,
     "winding: the current limit is 0, a bus drive in fault (155: insulation class F, IEC 60085)"},
    {"current_max_A", "A", "of torque_max_nm", 1e-9, large, "winding: largest current of the drive"},
    {"current_rated_A", "A", "no I^2 t", 1e-9, large, "winding: current for any time; above, I^2 t protection counts"},
    {"overload_s", "s", "of current_rated_A", 1e-3, large,
     "winding: time for which current_max_A may flow; at its end current_rated_A is left"},
};
static_assert(std::size(winding_table) == winding_key_count);
constexpr ControlInfo control_table[] = {{"torque", Control::torque}, {"position", Control::position}};
constexpr ValidityInfo validity_table[] = {
    {"clamp", friction::Validity::clamp},
    {"extrapolate", friction::Validity::extrapolate},
    {"error", friction::Validity::error},
};

}  // namespace

std::span<const Key> word_keys() { return words; }
std::span<const Key> number_keys() { return numbers; }
std::span<const Key> list_keys() { return lists; }
std::span<const DynamicsInfo> dynamics_table() { return dynamics; }
std::span<const ControlInfo> controls() { return control_table; }
std::span<const ValidityInfo> validities() { return validity_table; }

std::span<const Key> winding_keys() { return winding_table; }

std::array<double*, winding_key_count> winding_values(thermal::Winding& w) {
  return {&w.resistance_ohm, &w.torque_constant_nm_A, &w.heat_capacity_J_K, &w.thermal_resistance_K_W,
          &w.copper_1_K,     &w.magnet_1_K,           &w.reference_degC,    &w.warning_degC,
          &w.limit_degC,     &w.current_max_A,        &w.current_rated_A,   &w.overload_s};
}

std::array<double*, 3> dynamics_values(Drive& d) {
  if (d.dynamics == Dynamics::gear_loss) return {&d.gear_loss.mu_avg, &d.gear_loss.mu_dif, &d.gear_loss.length_rad};
  return {&d.bristles.sigma0, &d.bristles.sigma1, &d.bristles.vd};
}

std::span<const char* const> all_keys() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    const auto add = [&all](std::string_view name) {
      if (std::ranges::find(all, name) == all.end()) all.emplace_back(name);
    };
    for (const auto& keys : {word_keys(), number_keys(), list_keys(), winding_keys()})
      for (const Key& key : keys) add(key.name);
    for (const DynamicsInfo& info : dynamics_table())
      for (const Key& key : info.keys) add(key.name);
    for (const auto& law : friction::laws())
      for (const auto& p : law.parameters) add(p.name);
    for (const auto& model : thermal::models())
      for (const auto& p : model.parameters) add(p.name);
    return all;
  }();
  static const std::vector<const char*> pointers = [] {
    std::vector<const char*> all;
    for (const std::string& name : names) all.push_back(name.c_str());
    return all;
  }();
  return pointers;
}

}  // namespace tribotwin::drive
