#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

/// The elastic, hysteretic transmission of a gear, between its torsion phi = theta / u - q and its torque (RH380-N
/// study (2), (3)):
///
///   tau_g = w k phi + (1 - w) k x,   x' = phi' - beta |phi'| |x|^(n-1) x - gamma phi' |x|^n
///   k = k0(T) + k1(T) |phi| + k2(T) |phi|^3,   each k_i = k_i0 + k_i1 T + k_i2 T^2
///
/// Time enters only through phi: x advances over the increment of phi, not over dt, so loops are the same at every
/// rate. Of the hysteretic work, (1 - w) k x^2 / 2 is stored at most and the rest is heat; the heat of a closed loop is
/// its area. Where k rises with |phi| the heat of a step can be negative, that of a loop cannot.
namespace tribotwin::transmission {

struct Hysteresis {
  std::string name;
  std::string drive;    ///< instance of the tribotwin.drive that supplies the temperature and receives the heat
  double k[3][3] = {};  ///< [i][j]: coefficient of T^j in k_i; Nm/rad, Nm/rad^2, Nm/rad^4 per K^j
  double w = 0.5;       ///< elastic share, 0..1
  double beta = 1, gamma = 0, n = 1;                            ///< [rad^-n], -beta < gamma <= beta; n >= 1
  double torsion_max_rad = 1;                                   ///< beyond it the stiffness stays the same
  double temperature_min_degC = 20, temperature_max_degC = 50;  ///< held to this range

  /// k [Nm/rad] at a torsion and a temperature, held to the ranges above.
  double stiffness(double torsion_rad, double temperature_degC) const;
  /// Limit of |x| under continued motion in one direction [rad].
  double limit_rad() const;
  /// Largest d tau_g / d phi within the ranges [Nm/rad].
  double stiffest() const;
};

/// x after the torsion changed by `increment_rad`, from x0. Classical Runge-Kutta over phi, in pieces that are short
/// compared with the distance over which x approaches its limit; the result stays within `limit_rad`.
double advance(const Hysteresis& h, double x0_rad, double increment_rad);

/// tau_g [Nm, arm side].
double torque_nm(const Hysteresis& h, double torsion_rad, double x_rad, double temperature_degC);

struct Advance {
  double x_rad;
  double heat_J;  ///< hysteretic work - stored
};
/// x and heat after the torsion changed from `from_rad` to `to_rad`.
Advance advance(const Hysteresis& h, double x_rad, double from_rad, double to_rad, double temperature_degC);

using Configuration = std::vector<std::pair<std::string, std::string>>;
/// Every key of the plugin, for engines that want them declared. Storage is static.
std::span<const char* const> all_keys();
/// Fails with a sentence that names key, value and what would be right.
Result<Hysteresis> make_hysteresis(std::string name, const Configuration& configuration);
/// The configuration that `make_hysteresis` would read back to the same spring.
Configuration configuration_of(const Hysteresis& hysteresis);
/// The table of keys as Markdown.
std::string reference_markdown();

}  // namespace tribotwin::transmission
