#include <algorithm>
#include <cmath>

#include <tribotwin/plugins/thermal/winding.hpp>

namespace tribotwin::thermal {
namespace {

constexpr double large = 1e9;
constexpr Key keys[] = {
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
static_assert(std::size(keys) == winding_key_count);

/// From this share of the overload on, the current limit falls.
constexpr double nearly_overloaded = 0.8;

/// Neither a resistance nor a torque constant vanishes, however wrong the temperature.
constexpr double least_share = 0.05;

}  // namespace

std::span<const Key> winding_keys() { return keys; }

std::array<double*, winding_key_count> winding_values(Winding& w) {
  return {&w.resistance_ohm, &w.torque_constant_nm_A, &w.heat_capacity_J_K, &w.thermal_resistance_K_W,
          &w.copper_1_K,     &w.magnet_1_K,           &w.reference_degC,    &w.warning_degC,
          &w.limit_degC,     &w.current_max_A,        &w.current_rated_A,   &w.overload_s};
}

double Winding::resistance_at_ohm(double winding_degC) const {
  return resistance_ohm * std::max(1 + copper_1_K * (winding_degC - reference_degC), least_share);
}

double Winding::torque_share(double winding_degC) const {
  return std::max(1 - magnet_1_K * (winding_degC - reference_degC), least_share);
}

double Winding::current_limit_A(double winding_degC, double overload) const {
  double limit = current_max_A;
  if (current_rated_A > 0)
    limit += (current_rated_A - current_max_A) *
             std::clamp((overload - nearly_overloaded) / (1 - nearly_overloaded), 0.0, 1.0);
  return limit * std::clamp((limit_degC - winding_degC) / (limit_degC - warning_degC), 0.0, 1.0);
}

WindingHeat step(const Winding& w, double winding_degC, double current_A, double gear_rise_K, double dt_s,
                 WindingState& state) {
  const double copper_W = current_A * current_A * w.resistance_at_ohm(winding_degC);
  const double target_K = gear_rise_K + w.thermal_resistance_K_W * copper_W;
  const double change_K =
      (target_K - state.rise_K) * -std::expm1(-dt_s / (w.thermal_resistance_K_W * w.heat_capacity_J_K));
  state.rise_K += change_K;
  if (w.current_rated_A > 0) {
    const double rated_A2 = w.current_rated_A * w.current_rated_A;
    const double rate_1_s =
        (current_A * current_A - rated_A2) / (w.overload_s * (w.current_max_A * w.current_max_A - rated_A2));
    state.overload = std::clamp(state.overload + rate_1_s * dt_s, 0.0, 1.0);
  }
  return {copper_W, copper_W - w.heat_capacity_J_K * change_K / dt_s};
}

}  // namespace tribotwin::thermal
