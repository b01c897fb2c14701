#pragma once

/// Temperature of a motor's winding from its copper loss: the third node of a drive's heat, before those of
/// thermal.hpp (gear and housing).
///
///   C dT_w/dt = I^2 R(T_w) - (T_w - T) / R_th,   R = R_0 (1 + alpha (T_w - T_ref)),   k = k_0 (1 - beta (T_w - T_ref))
///
/// with T the lubricant's temperature. The flow (T_w - T) / R_th heats the gear beside its friction. R, alpha, R_th and
/// C have the meaning of MuJoCo's dcmotor (its thermal attribute); its winding cools to the ambience, ours to the gear.
namespace tribotwin::thermal {

struct Winding {
  double resistance_ohm = 0;                ///< R_0, of the DC motor with the same loss; 0: the drive has no winding
  double torque_constant_nm_A = 0;          ///< k_0, motor side
  double heat_capacity_J_K = 0;             ///< C
  double thermal_resistance_K_W = 0;        ///< R_th, to the gear
  double copper_1_K = 0, magnet_1_K = 0;    ///< alpha, beta
  double reference_degC = 25;               ///< T_ref
  double warning_degC = 0, limit_degC = 0;  ///< the current limit falls from current_max_A to 0 between them
  double current_max_A = 0;
  double current_rated_A = 0;  ///< for any time; 0: no I^2 t protection
  double overload_s = 0;       ///< time for which current_max_A may flow, from cold

  bool present() const { return resistance_ohm > 0; }
  double resistance_at_ohm(double winding_degC) const;
  /// k(T_w) / k_0.
  double torque_share(double winding_degC) const;
  /// Largest current [A] that the drive gives at this temperature and this share 0..1 of its I^2 t overload. It falls
  /// gradually, so that it settles instead of switching.
  double current_limit_A(double winding_degC, double overload) const;
};

struct WindingState {
  double rise_K = 0;    ///< over T_amb
  double overload = 0;  ///< share of the overload that I^2 t allows
};

/// Heat of one step [W]: what the current made, and the part of it that left for the gear.
struct WindingHeat {
  double copper_W, to_gear_W;
};

/// Advances a winding at `winding_degC` over dt at constant current, beside a gear that is gear_rise_K over T_amb.
/// Exact for constant loss and gear temperature. The heat balances to rounding: copper - to_gear = C dT_w/dt.
WindingHeat step(const Winding& winding, double winding_degC, double current_A, double gear_rise_K, double dt_s,
                 WindingState& state);

}  // namespace tribotwin::thermal
