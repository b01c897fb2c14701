#include <algorithm>
#include <cmath>

#include <tribotwin/plugins/thermal/winding.hpp>

namespace tribotwin::thermal {
namespace {

/// From this share of the overload on, the current limit falls.
constexpr double nearly_overloaded = 0.8;

/// Neither a resistance nor a torque constant vanishes, however wrong the temperature.
constexpr double least_share = 0.05;

}  // namespace

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
