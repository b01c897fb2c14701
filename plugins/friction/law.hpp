#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/friction/formula.hpp>

/// Static friction laws of a robot joint: values in, value out.
///
/// Every law of the table is a special case of one general law,
///
///   tau_f(v, l, T) = s(T) [ (A + A_T T + A_TT T^2 + A_l l) + (B + B_T T + B_TT T^2 + B_l l) e^-|v/vs(T)|^alpha
///                         + C_l l e^-|v/vl|^alpha                                                                 g
///                         + (F1 + F1_t T + F1_tt T^2 + F1_T e^(-T/T_V)) v + F2 v^2 + F3 v^3
///                         + (Fb + Fb_T e^(-T/T_V)) v^beta(T) ]                                                    h
///   vs(T) = vs + vs_T T + vs_TT T^2
///   s(T) = max(0, 1 + s_T (T - s_T0)),  beta(T) = beta + beta_T T held within `exponent_min` .. `exponent_max`
///
/// for v >= 0, odd in v, with g the velocity-weakening and h the velocity-strengthening part; formula.hpp evaluates it.
/// A law is therefore a name, a table of parameters and a function that gives the numbers of the general law; parsing,
/// validation, help and documentation read the same table.
namespace tribotwin::friction {

/// The shaft whose speed a law takes.
enum class Side { motor, arm };

/// What a law does with an input outside the range it was identified in. `clamp` holds the input at the edge;
/// `extrapolate` evaluates the formula as it stands, floored at 0 and, where the result is not finite, clamped; `error`
/// evaluates like `clamp`, and the caller stops. Under every policy the result is finite, >= 0 for v > 0, odd in v, and
/// says whether the input lay outside.
enum class Validity { clamp, extrapolate, error };

inline constexpr std::size_t max_parameters = 13;
inline constexpr double unlimited = std::numeric_limits<double>::infinity();

struct Parameter {
  std::string_view name;    ///< as in MJCF, YAML, JSON, tables and help
  std::string_view unit;    ///< "-" is normalised torque, torque / torque_max
  double minimum, maximum;  ///< accepted range, inclusive
  double published;         ///< value in the source; NaN where the source gives none
  double sigma;             ///< one standard deviation in the source; NaN where the source gives none
  std::string_view meaning;
  /// The parameter of the law that is a lower bound of this one; empty: none. Identification searches for the
  /// difference.
  std::string_view not_below = {};
};

/// Where a law was identified. Bounds are inclusive, `unlimited` where the law does not depend on the input
/// or the source names no bound.
struct Range {
  double speed_max_rad_s = unlimited;  ///< |speed| on the law's side [rad/s]
  double load_max = unlimited;         ///< |load torque| / torque_max [-]
  double temperature_min_degC = -unlimited;
  double temperature_max_degC = unlimited;
};

using formula::Coefficients;

struct LawInfo {
  std::string_view name, equation, source;
  Side side;
  bool normalised;  ///< torque in units of torque_max, else arm-side Nm
  bool temperature_dependent, load_dependent;
  Range identified;
  std::span<const Parameter> parameters;
  /// The numbers of the general law. Every one is affine in the parameters, general_law(a) + general_law(b) -
  /// general_law(0) == general_law(a + b): identification takes its exact derivatives from that.
  GeneralLaw (*general_law)(std::span<const double> parameters);
  /// Conditions between parameters (Fs >= Fc, ...); nullptr or an explanation.
  const char* (*conflict)(std::span<const double> parameters);
};

/// All laws, in the order of the documentation.
std::span<const LawInfo> laws();
const LawInfo* find_law(std::string_view name);

/// A law with its numbers: immutable, copyable, shared between threads.
struct Law {
  const LawInfo* info = nullptr;
  std::array<double, max_parameters> parameters{};
  Range range;
  Validity validity = Validity::clamp;
  GeneralLaw general_law;  ///< follows from the parameters, except after `scaled`

  std::span<const double> values() const& { return {parameters.data(), info->parameters.size()}; }
  void values() const&& = delete;  ///< a temporary law would not outlive the result
};

/// A law from named values, each parameter exactly once.
/// Fails with a sentence that names the parameter, the value and what would be accepted.
Result<Law> make_law(std::string_view name, std::span<const std::pair<std::string, double>> parameters);

/// The law with the numbers of its source. Fails where the source publishes none.
Result<Law> published_law(std::string_view name);

/// The same law with other numbers. Accepted ranges are not checked, because wear may leave them.
Law with_parameters(const Law& law, std::span<const double> parameters);

/// The same law with g, the Stribeck velocities and h multiplied by factors at every temperature and load. `parameters`
/// do not change.
Law scaled(const Law& law, double weakening, double stribeck_velocity, double strengthening);

/// The largest growth of the friction level per load [unit of the law], at standstill and just above the Stribeck
/// velocities, at s(T) = 1.
double growth_with_load(const Law& law);

struct Gradient {
  double torque;                                                     ///< at v > 0, not clamped [unit of the law]
  std::array<double, formula::term_count> by_terms;                  ///< by the numbers of formula::terms
  std::array<double, formula::shape_number_count> by_shape_numbers;  ///< by those of formula::shape_numbers
};
/// The general law and its exact derivatives, for identification: no range applies, nothing is floored.
/// speed_rad_s > 0, load_norm >= 0.
Gradient gradient(const GeneralLaw& law, double speed_rad_s, double load_norm, double temperature_degC);

/// The bounds that `level` and `at_temperature` hold inputs to under the law's policy: its own range or, where it
/// extrapolates or is unlimited, the physical bounds (1e6 rad/s, load 1e3, -273.15 .. 1000 degC).
Range held_range(const Law& law);

struct AtTemperature {
  Coefficients coefficients;
  bool outside;  ///< the temperature lay outside the law's range
};

/// Coefficients at a temperature [degC], validity policy applied to the temperature.
AtTemperature at_temperature(const Law& law, double temperature_degC);

struct Level {
  double weakening;      ///< g >= 0, unit of the law
  double strengthening;  ///< h, unit of the law
  bool outside;          ///< speed or load lay outside the law's range
  /// Friction torque at this speed, >= 0, unit of the law.
  double total() const { return weakening + strengthening; }
};

/// Friction level at |speed| [rad/s, the law's side] and |load| [-]; speed 0 gives the breakaway level. The result is
/// finite for every input; NaN counts as 0 and as outside.
Level level(const Law& law, const AtTemperature& at, double speed_rad_s, double load_norm);

/// Friction torque in the direction of motion, odd in speed; 0 at standstill. Unit of the law.
double torque(const Law& law, double speed_rad_s, double load_norm, double temperature_degC);

}  // namespace tribotwin::friction
