#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/twin/control/dc_position_keys.hpp>

namespace tribotwin::twin {
namespace {

constexpr double any = friction::unlimited;

/// A curve's name in keys: error_1_rad, error_factor_1; kp_1, kp_factor_1.
struct CurveName {
  GainCurve DcPositionOptions::*curve;
  std::string_view name, unit;
  std::string knot(std::size_t k) const { return fmt::format("{}_{}{}", name, k + 1, unit); }
  std::string factor(std::size_t k) const { return fmt::format("{}_factor_{}", name, k + 1); }
};
constexpr CurveName curves[] = {{&DcPositionOptions::over_error, "error", "_rad"},
                                {&DcPositionOptions::over_kp, "kp", ""}};

std::vector<DcPositionKey> made_keys() {
  using O = DcPositionOptions;
  const auto number = [](double O::*member) { return [member](O& o) -> double& { return o.*member; }; };
  std::vector<DcPositionKey> all{{"kp", 0, 1e9, number(&O::kp)},
                                 {"error_gain", 0, 1e9, number(&O::error_gain), true},
                                 {"duty_limit", 0, 1, number(&O::duty_limit)},
                                 {"duty_slew_1_s", 1e-3, any, number(&O::duty_slew_1_s)},
                                 {"supply_V", 0, 1e6, number(&O::supply_V), true},
                                 {"resistance_ohm", 1e-9, 1e9, number(&O::resistance_ohm), true},
                                 {"supply_resistance_ohm", 0, 1e9, number(&O::supply_resistance_ohm)},
                                 {"kt_nm_A", 0, 1e6, number(&O::kt_nm_A), true},
                                 {"torque_limit_nm", 0, any, number(&O::torque_limit_nm)},
                                 {"resistance_per_K", -0.1, 0.1, number(&O::resistance_per_K)},
                                 {"reference_degC", -100, 300, number(&O::reference_degC)}};
  for (const CurveName& c : curves)
    for (std::size_t k = 0; k < GainCurve::most; ++k) {
      const auto curve = c.curve;
      all.push_back({c.knot(k), 0, 1e9, [curve, k](O& o) -> double& { return (o.*curve).at[k]; }, false, true});
      all.push_back({c.factor(k), 0, 1e3, [curve, k](O& o) -> double& { return (o.*curve).factor[k]; }});
    }
  return all;
}

}  // namespace

std::span<const DcPositionKey> dc_position_keys() {
  static const std::vector<DcPositionKey> keys = made_keys();
  return keys;
}

std::string problem_of(const DcPositionOptions& o) {
  if (o.supply_resistance_ohm > o.resistance_ohm)
    return fmt::format(
        "supply_resistance_ohm: is {:g} but must be within 0 .. {:g}, resistance_ohm: a supply loses "
        "less than the whole voltage",
        o.supply_resistance_ohm, o.resistance_ohm);
  for (const CurveName& c : curves) {
    const GainCurve& curve = o.*c.curve;
    for (std::size_t k = 0; k < GainCurve::most; ++k) {
      const bool knot = !std::isnan(curve.at[k]);
      if (!knot && !std::isnan(curve.factor[k]))
        return fmt::format("{}: has no effect without its knot; give {}, too", c.factor(k), c.knot(k));
      if (!knot || k == 0) continue;
      if (std::isnan(curve.at[k - 1]))
        return fmt::format("{}: is a knot, but {} is missing; number them from 1", c.knot(k), c.knot(k - 1));
      if (curve.at[k] <= curve.at[k - 1])
        return fmt::format("{}: is {:g} but must be above {}, {:g}", c.knot(k), curve.at[k], c.knot(k - 1),
                           curve.at[k - 1]);
    }
  }
  return {};
}

}  // namespace tribotwin::twin
