/// A law evaluated: values in, value out. Without text and tables, so that pages have it compiled for browsers too.
#include <algorithm>
#include <cmath>

#include <tribotwin/plugins/friction/law.hpp>

namespace tribotwin::friction {
namespace {

// Physical bounds of the inputs under every policy. They keep every formula finite.
constexpr Range physical = {
    .speed_max_rad_s = 1e6, .load_max = 1e3, .temperature_min_degC = -273.15, .temperature_max_degC = 1000};

/// Math of formula.hpp for one number at a time.
struct Libm {
  static constexpr bool branches = true;
  static double exp(double x) { return std::exp(x); }
  static double log(double x) { return std::log(x); }
  static double magnitude(double x) { return std::abs(x); }
  static double power(double x, double a) { return std::pow(x, a); }
  static double quotient(double a, double b) { return a / b; }
};
using Scalar = formula::Evaluator<Libm>;

/// Brings x into [lowest, highest], NaN to the point nearest 0.
double confined(double x, double lowest, double highest) {
  return std::clamp(std::isnan(x) ? 0.0 : x, lowest, highest);
}

/// Where the inputs of a law are held.
double held_speed(const Law& law) {
  if (law.validity == Validity::extrapolate) return physical.speed_max_rad_s;
  return std::min(law.range.speed_max_rad_s, physical.speed_max_rad_s);
}
double held_load(const Law& law) {
  if (law.validity == Validity::extrapolate || !law.info->load_dependent) return physical.load_max;
  return std::min(law.range.load_max, physical.load_max);
}

}  // namespace

Gradient gradient(const GeneralLaw& law, double speed_rad_s, double load_norm, double temperature_degC) {
  Gradient result{};
  result.torque = formula::gradient<Libm>(law, speed_rad_s, load_norm, temperature_degC, result.by_terms.data(),
                                          result.by_shape_numbers.data());
  return result;
}

Range held_range(const Law& law) {
  const LawInfo& info = *law.info;
  if (law.validity == Validity::extrapolate) return physical;
  return {.speed_max_rad_s = held_speed(law),
          .load_max = held_load(law),
          .temperature_min_degC = info.temperature_dependent
                                      ? std::max(law.range.temperature_min_degC, physical.temperature_min_degC)
                                      : physical.temperature_min_degC,
          .temperature_max_degC = info.temperature_dependent
                                      ? std::min(law.range.temperature_max_degC, physical.temperature_max_degC)
                                      : physical.temperature_max_degC};
}

AtTemperature at_temperature(const Law& law, double temperature_degC) {
  const bool outside = law.info->temperature_dependent && !(temperature_degC >= law.range.temperature_min_degC &&
                                                            temperature_degC <= law.range.temperature_max_degC);
  const Range held = held_range(law);
  AtTemperature at{Scalar::constants(law.general_law), outside};
  Scalar::set_temperature(law.general_law,
                          confined(temperature_degC, held.temperature_min_degC, held.temperature_max_degC),
                          at.coefficients);
  return at;
}

Level level(const Law& law, const AtTemperature& at, double speed_rad_s, double load_norm) {
  const LawInfo& info = *law.info;
  double v = std::abs(speed_rad_s), l = info.load_dependent ? std::abs(load_norm) : 0;
  bool outside = at.outside || !(v <= law.range.speed_max_rad_s);
  v = confined(v, 0, held_speed(law));
  if (info.load_dependent) {
    outside |= !(l <= law.range.load_max);
    l = confined(l, 0, held_load(law));
  }
  if (v == 0) return {std::max(Scalar::breakaway(at.coefficients, l), 0.0), 0, outside};
  const auto [weakening, strengthening] = Scalar::parts(at.coefficients, v, Libm::power(v, at.coefficients.alpha), l);
  const double total = std::max(weakening + strengthening, 0.0), g = std::max(weakening, 0.0);
  return {g, total - g, outside};
}

double torque(const Law& law, double speed_rad_s, double load_norm, double temperature_degC) {
  if (!(std::abs(speed_rad_s) > 0)) return 0;
  return std::copysign(level(law, at_temperature(law, temperature_degC), speed_rad_s, load_norm).total(), speed_rad_s);
}

}  // namespace tribotwin::friction
