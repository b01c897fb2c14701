#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/plugins/friction/text.hpp>

namespace tribotwin::friction {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

// Sources by author and year: the bibliography is in plugins/README.md.

constexpr Parameter stribeck_parameters[] = {
    {"Fc", "-", 0, 10, 3.4e-2, 0.176e-2, "Coulomb friction"},
    {"Fs", "-", -10, 10, 4.6e-2, 0.48e-2, "standstill friction, excess over Fc"},
    {"Fv", "s/rad", 0, 1, 3.68e-4, 0.12e-4, "viscous slope"},
    {"vs", "rad/s", 1e-9, 1e6, 10.68, 1.08, "Stribeck velocity"},
    {"alpha", "1", 0.01, 10, 1.93, 0.60, "exponent of the Stribeck term"},
};
GeneralLaw stribeck_general_law(std::span<const double> p) {
  return {.A = p[0], .B = p[1], .vs = p[3], .alpha = p[4], .F1 = p[2]};
}

constexpr Parameter non_newtonian_parameters[] = {
    {"Fc", "-", 0, 10, none, none, "Coulomb friction"},
    {"Fs", "-", -10, 10, none, none, "standstill friction, excess over Fc"},
    {"Fv", "s/rad", -1, 1, none, none, "viscous slope"},
    {"vs", "rad/s", 1e-9, 1e6, none, none, "Stribeck velocity"},
    {"alpha", "1", 0.01, 10, none, none, "exponent of the Stribeck term"},
    {"Fmu", "(s/rad)^beta", -10, 10, none, none, "non-Newtonian coefficient"},
    {"beta", "1", exponent_min, exponent_max, none, none, "non-Newtonian exponent"},
};
GeneralLaw non_newtonian_general_law(std::span<const double> p) {
  return {.A = p[0], .B = p[1], .vs = p[3], .alpha = p[4], .F1 = p[2], .Fb = p[5], .beta = p[6]};
}

constexpr Parameter load_parameters[] = {
    {"Fc0", "-", 0, 10, none, none, "Coulomb friction without load"},
    {"Fcl", "-", -1, 1, 2.34e-2, 0.071e-2, "Coulomb friction per load"},
    {"Fs0", "-", -10, 10, none, none, "standstill friction without load, excess over Coulomb"},
    {"Fsl", "-", -1, 1, 1.26e-1, 0.025e-1, "standstill friction per load"},
    {"vs", "rad/s", 1e-9, 1e6, 9.22, 0.12, "Stribeck velocity"},
    {"alpha", "1", 0.01, 10, 1.36, 0.011, "exponent of the Stribeck term"},
    {"Fv", "s/rad", 0, 1, none, none, "viscous slope"},
};
GeneralLaw load_general_law(std::span<const double> p) {
  return {.A = p[0], .A_l = p[1], .B = p[2], .B_l = p[3], .vs = p[4], .alpha = p[5], .F1 = p[6]};
}

constexpr Parameter extended_parameters[] = {
    {"Fc0", "-", 0, 10, 3.11e-2, 0.028e-2, "Coulomb friction without load"},
    {"Fcl", "-", -1, 1, 2.34e-2, 0.071e-2, "Coulomb friction per load"},
    {"Fs0", "-", -10, 10, -2.50e-2, 0.12e-2, "standstill friction at 0 degC, excess over Coulomb"},
    {"FsT", "1/K", -1, 1, 1.60e-3, 0.022e-3, "standstill friction per degC"},
    {"Fsl", "-", -1, 1, 1.26e-1, 0.025e-1, "standstill friction per load"},
    {"vs0", "rad/s", -1e6, 1e6, -24.81, 0.87, "Stribeck velocity at 0 degC"},
    {"vsT", "rad/s/K", -1e4, 1e4, 0.98, 0.018, "Stribeck velocity per degC"},
    {"vsl", "rad/s", 1e-9, 1e6, 9.22, 0.12, "Stribeck velocity of the load term"},
    {"alpha", "1", 0.01, 10, 1.36, 0.011, "exponent of both Stribeck terms"},
    {"Fv0", "s/rad", 0, 1, 1.30e-4, 0.056e-4, "viscous slope of hot lubricant"},
    {"FvT", "s/rad", 0, 1, 1.32e-3, 0.076e-3, "viscous slope that decays with temperature"},
    {"TV0", "K", 1, 1000, 20.71, 0.91, "temperature scale of the viscosity"},
};
GeneralLaw extended_general_law(std::span<const double> p) {
  return {.A = p[0],
          .A_l = p[1],
          .B = p[2],
          .B_T = p[3],
          .vs = p[5],
          .vs_T = p[6],
          .C_l = p[4],
          .vl = p[7],
          .alpha = p[8],
          .F1 = p[9],
          .F1_T = p[10],
          .T_V = p[11]};
}

constexpr Parameter steady_state_parameters[] = {
    {"Fc", "Nm", 0, 1e6, none, none, "Coulomb friction"},
    {"Fs", "Nm", 0, 1e6, none, none, "standstill friction, the level itself (>= Fc)", "Fc"},
    {"Vs", "rad/s", 1e-9, 1e6, none, none, "Stribeck velocity"},
    {"alpha", "1", 0.01, 10, 1.3, none, "exponent of the Stribeck term"},
    {"Fv", "Nm (s/rad)^beta", 0, 1e6, none, none, "viscous coefficient"},
    {"beta", "1", exponent_min, exponent_max, none, none, "viscous exponent"},
};
GeneralLaw steady_state_general_law(std::span<const double> p) {
  return {.A = p[0], .B = p[1] - p[0], .vs = p[2], .alpha = p[3], .Fb = p[4], .beta = p[5]};
}
const char* steady_state_conflict(std::span<const double> p) {
  return p[1] >= p[0] ? nullptr : "Fs is the standstill level of this law and must not be below Fc";
}

constexpr Parameter steady_state_extended_parameters[] = {
    {"Fc0", "Nm", 0, 1e6, none, none, "Coulomb friction at 0 degC without load"},
    {"FcT", "Nm/K", -1e4, 1e4, none, none, "Coulomb friction per degC"},
    {"Fcl", "Nm", -1e6, 1e6, none, none, "Coulomb friction per load l, the gear torque over torque_max_nm"},
    {"Fs0", "Nm", 0, 1e6, none, none, "standstill friction without load, the level itself (>= Coulomb)"},
    {"Fsl", "Nm", -1e6, 1e6, none, none, "standstill friction per load"},
    {"Vs0", "rad/s", -1e6, 1e6, none, none, "Stribeck velocity at 0 degC; its small growth with load is not modelled"},
    {"VsT", "rad/s/K", -1e4, 1e4, none, none, "Stribeck velocity per degC"},
    {"alpha", "1", 0.01, 10, 1.3, none, "exponent of the Stribeck term"},
    {"FvT", "Nm (s/rad)^beta", 0, 1e6, none, none, "viscous coefficient at 0 degC"},
    {"TV0", "K", 1, 1000, none, none, "temperature scale of the viscosity"},
    {"beta0", "1", exponent_min, exponent_max, none, none, "viscous exponent at 0 degC"},
    {"betaT", "1/K", -1, 1, none, none, "viscous exponent per degC"},
};
GeneralLaw steady_state_extended_general_law(std::span<const double> p) {
  return {.A = p[0],
          .A_T = p[1],
          .A_l = p[2],
          .B = p[3] - p[0],
          .B_T = -p[1],
          .B_l = p[4] - p[2],
          .vs = p[5],
          .vs_T = p[6],
          .alpha = p[7],
          .T_V = p[9],
          .Fb_T = p[8],
          .beta = p[10],
          .beta_T = p[11]};
}
constexpr Range steady_state_extended_range = {
    .speed_max_rad_s = 174.6, .load_max = 1, .temperature_min_degC = 20, .temperature_max_degC = 60};
/// Zhou 2024 (12) and similar conditions. They are affine in T and l, so a condition that holds at the corners of the
/// range holds within it.
const char* steady_state_extended_conflict(std::span<const double> p) {
  const Range& r = steady_state_extended_range;
  for (const double T : {r.temperature_min_degC, r.temperature_max_degC}) {
    for (const double l : {0.0, r.load_max}) {
      const double Fc = p[0] + p[1] * T + p[2] * l, Fs = p[3] + p[4] * l;
      if (!(Fc >= 0))
        return "Fc0 + FcT T + Fcl l is Coulomb friction and must not be below 0 at 20 .. 60 degC, l = 0 .. 1";
      if (!(Fs >= Fc))
        return "Fs0 + Fsl l is the standstill level and must not be below Fc0 + FcT T + Fcl l at 20 .. 60 degC, l = 0 "
               ".. 1";
    }
    if (!(p[5] + p[6] * T > 0)) return "Vs0 + VsT T is the Stribeck velocity and must be above 0 at 20 .. 60 degC";
    const double beta = p[10] + p[11] * T;
    if (!(beta >= exponent_min && beta <= exponent_max))
      return "beta0 + betaT T is the viscous exponent and must be within 0.01 .. 5 at 20 .. 60 degC";
  }
  return nullptr;
}

constexpr Parameter polynomial_parameters[] = {
    {"f1", "Nm", 0, 1e6, none, none, "friction at standstill, at T0"},
    {"f2", "Nm s/rad", -1e6, 1e6, none, none, "linear coefficient, at T0"},
    {"f3", "Nm s^2/rad^2", -1e6, 1e6, none, none, "quadratic coefficient, at T0"},
    {"f4", "Nm s^3/rad^3", -1e6, 1e6, none, none, "cubic coefficient, at T0"},
    {"a", "1/K", -1, 1, none, none, "relative change per degree"},
    {"T0", "degC", -100, 300, none, none, "temperature of f1 to f4"},
};
GeneralLaw polynomial_general_law(std::span<const double> p) {
  return {.A = p[0], .F1 = p[1], .F2 = p[2], .F3 = p[3], .s_T = p[4], .s_T0 = p[5]};
}

constexpr Parameter stribeck_T_parameters[] = {
    {"Fc0", "Nm", -1e6, 1e6, none, none, "Coulomb friction at 0 degC"},
    {"FcT", "Nm/K", -1e4, 1e4, none, none, "Coulomb friction per degC"},
    {"FcTT", "Nm/K^2", -1e3, 1e3, none, none, "Coulomb friction per degC squared"},
    {"Fs0", "Nm", -1e6, 1e6, none, none, "standstill friction at 0 degC, the level itself (>= Coulomb)"},
    {"FsT", "Nm/K", -1e4, 1e4, none, none, "standstill friction per degC"},
    {"FsTT", "Nm/K^2", -1e3, 1e3, none, none, "standstill friction per degC squared"},
    {"vs0", "rad/s", -1e6, 1e6, none, none, "Stribeck velocity at 0 degC"},
    {"vsT", "rad/s/K", -1e4, 1e4, none, none, "Stribeck velocity per degC"},
    {"vsTT", "rad/s/K^2", -1e3, 1e3, none, none, "Stribeck velocity per degC squared"},
    {"delta", "1", 0.01, 10, none, none, "exponent of the Stribeck term"},
    {"Fv0", "Nm s/rad", -1e6, 1e6, none, none, "viscous slope at 0 degC"},
    {"FvT", "Nm s/rad/K", -1e4, 1e4, none, none, "viscous slope per degC"},
    {"FvTT", "Nm s/rad/K^2", -1e3, 1e3, none, none, "viscous slope per degC squared"},
};
GeneralLaw stribeck_T_general_law(std::span<const double> p) {
  return {.A = p[0],
          .A_T = p[1],
          .A_TT = p[2],
          .B = p[3] - p[0],
          .B_T = p[4] - p[1],
          .B_TT = p[5] - p[2],
          .vs = p[6],
          .vs_T = p[7],
          .vs_TT = p[8],
          .alpha = p[9],
          .F1 = p[10],
          .F1_t = p[11],
          .F1_tt = p[12]};
}
constexpr Range stribeck_T_range = {.speed_max_rad_s = 150, .temperature_min_degC = 20, .temperature_max_degC = 50};
const char* stribeck_T_conflict(std::span<const double> p) {
  // The minimum of c0 + c1 T + c2 T^2 in the range: at its ends or at its vertex.
  const auto minimum = [](double c0, double c1, double c2) {
    const double low = stribeck_T_range.temperature_min_degC, high = stribeck_T_range.temperature_max_degC;
    const double vertex = c2 == 0 ? low : std::clamp(-c1 / (2 * c2), low, high);
    const auto at = [&](double T) { return c0 + (c1 + c2 * T) * T; };
    return std::min({at(low), at(high), at(vertex)});
  };
  if (!(minimum(p[0], p[1], p[2]) >= 0))
    return "Fc0 + FcT T + FcTT T^2 is Coulomb friction and must not be below 0 at 20 .. 50 degC";
  if (!(minimum(p[3] - p[0], p[4] - p[1], p[5] - p[2]) >= 0))
    return "Fs0 + FsT T + FsTT T^2 is the standstill level and must not be below Fc0 + FcT T + FcTT T^2 at 20 .. 50 "
           "degC";
  if (!(minimum(p[6], p[7], p[8]) > 0))
    return "vs0 + vsT T + vsTT T^2 is the Stribeck velocity and must be above 0 at 20 .. 50 degC";
  if (!(minimum(p[10], p[11], p[12]) >= 0))
    return "Fv0 + FvT T + FvTT T^2 is the viscous slope and must not be below 0 at 20 .. 50 degC";
  return nullptr;
}

constexpr LawInfo table[] = {
    {.name = "stribeck",
     .equation = "Fc + Fs e^-|v/vs|^alpha + Fv v",
     .source = "Bittencourt 2012 (M0), Table 1",
     .side = Side::motor,
     .normalised = true,
     .temperature_dependent = false,
     .load_dependent = false,
     .identified = {.speed_max_rad_s = 280},
     .parameters = stribeck_parameters,
     .general_law = stribeck_general_law,
     .conflict = nullptr},
    {.name = "stribeck_non_newtonian",
     .equation = "Fc + Fs e^-|v/vs|^alpha + Fv v + Fmu v^beta",
     .source = "Bittencourt 2012 (M0+)",
     .side = Side::motor,
     .normalised = true,
     .temperature_dependent = false,
     .load_dependent = false,
     .identified = {.speed_max_rad_s = 280},
     .parameters = non_newtonian_parameters,
     .general_law = non_newtonian_general_law,
     .conflict = nullptr},
    {.name = "load",
     .equation = "(Fc0 + Fcl l) + (Fs0 + Fsl l) e^-|v/vs|^alpha + Fv v",
     .source = "Bittencourt 2012 (M1), Table 2",
     .side = Side::motor,
     .normalised = true,
     .temperature_dependent = false,
     .load_dependent = true,
     .identified = {.speed_max_rad_s = 280, .load_max = 0.73},
     .parameters = load_parameters,
     .general_law = load_general_law,
     .conflict = nullptr},
    {.name = "extended",
     .equation = "(Fc0 + Fcl l) + Fsl l e^-|v/vsl|^alpha + (Fs0 + FsT T) e^-|v/(vs0 + vsT T)|^alpha"
                 " + (Fv0 + FvT e^(-T/TV0)) v",
     .source = "Bittencourt 2012 (M*), Tables 2 and 3",
     .side = Side::motor,
     .normalised = true,
     .temperature_dependent = true,
     .load_dependent = true,
     .identified = {.speed_max_rad_s = 280, .load_max = 0.73, .temperature_min_degC = 38, .temperature_max_degC = 81.2},
     .parameters = extended_parameters,
     .general_law = extended_general_law,
     .conflict = nullptr},
    {.name = "steady_state",
     .equation = "Fc + (Fs - Fc) e^-|v/Vs|^alpha + Fv v^beta",
     .source = "Zhou 2024 (11), (12)",
     .side = Side::motor,
     .normalised = false,
     .temperature_dependent = false,
     .load_dependent = false,
     .identified = {.speed_max_rad_s = 174.6},
     .parameters = steady_state_parameters,
     .general_law = steady_state_general_law,
     .conflict = steady_state_conflict},
    {.name = "steady_state_extended",
     .equation = "Fc + (Fs - Fc) e^-|v/Vs|^alpha + FvT e^(-T/TV0) v^(beta0 + betaT T) with Fc = Fc0 + FcT T + Fcl l,"
                 " Fs = Fs0 + Fsl l, Vs = Vs0 + VsT T",
     .source = "Zhou 2024 (11) with coefficients that move as its Table IV and text say; choice",
     .side = Side::motor,
     .normalised = false,
     .temperature_dependent = true,
     .load_dependent = true,
     .identified = steady_state_extended_range,
     .parameters = steady_state_extended_parameters,
     .general_law = steady_state_extended_general_law,
     .conflict = steady_state_extended_conflict},
    {.name = "polynomial",
     .equation = "(f1 + f2 v + f3 v^2 + f4 v^3) (1 + a (T - T0))",
     .source = "Pagani (2), (5)",
     .side = Side::arm,
     .normalised = false,
     .temperature_dependent = true,
     .load_dependent = false,
     .identified = {},
     .parameters = polynomial_parameters,
     .general_law = polynomial_general_law,
     .conflict = nullptr},
    {.name = "stribeck_T",
     .equation = "Fc + (Fs - Fc) e^-|v/vs|^delta + Fv v with Fc = Fc0 + FcT T + FcTT T^2, and Fs, vs, Fv alike",
     .source = "RH380-N study (6), whose motor-side torque times u this is; range as measured there",
     .side = Side::motor,
     .normalised = false,
     .temperature_dependent = true,
     .load_dependent = false,
     .identified = stribeck_T_range,
     .parameters = stribeck_T_parameters,
     .general_law = stribeck_T_general_law,
     .conflict = stribeck_T_conflict},
};

}  // namespace

std::span<const LawInfo> laws() { return table; }

const LawInfo* find_law(std::string_view name) {
  const auto found = std::ranges::find(table, name, &LawInfo::name);
  return found == std::end(table) ? nullptr : &*found;
}

Result<Law> make_law(std::string_view name, std::span<const std::pair<std::string, double>> parameters) {
  Law law{.info = find_law(name)};
  if (!law.info) {
    std::vector<std::string_view> names;
    for (const LawInfo& info : table) names.push_back(info.name);
    return tl::unexpected(fmt::format("law '{}' is not known; did you mean '{}'? Known laws: {}", name,
                                      nearest(name, names), fmt::join(names, ", ")));
  }
  law.range = law.info->identified;
  std::array<bool, max_parameters> given{};
  const auto& accepted = law.info->parameters;
  for (const auto& [key, value] : parameters) {
    const auto found = std::ranges::find(accepted, key, &Parameter::name);
    if (found == accepted.end()) {
      std::vector<std::string_view> names;
      for (const Parameter& p : accepted) names.push_back(p.name);
      return tl::unexpected(fmt::format("law '{}' has no parameter '{}'; did you mean '{}'? Parameters: {}", name, key,
                                        nearest(key, names), fmt::join(names, ", ")));
    }
    const std::size_t i = static_cast<std::size_t>(found - accepted.begin());
    if (given[i]) return tl::unexpected(fmt::format("parameter '{}' of law '{}' is given twice", key, name));
    if (!(value >= found->minimum && value <= found->maximum))
      return tl::unexpected(fmt::format("parameter '{}' of law '{}' is {} but must be within {} .. {} [{}]", key, name,
                                        value, found->minimum, found->maximum, found->unit));
    law.parameters[i] = value;
    given[i] = true;
  }
  for (std::size_t i = 0; i < accepted.size(); ++i)
    if (!given[i])
      return tl::unexpected(fmt::format("law '{}' lacks its parameter '{}' ({} [{}])", name, accepted[i].name,
                                        accepted[i].meaning, accepted[i].unit));
  if (const char* conflict = law.info->conflict ? law.info->conflict(law.values()) : nullptr)
    return tl::unexpected(fmt::format("law '{}': {}", name, conflict));
  law.general_law = law.info->general_law(law.values());
  return law;
}

Law with_parameters(const Law& law, std::span<const double> parameters) {
  Law changed = law;
  std::ranges::copy(parameters, changed.parameters.begin());
  changed.general_law = law.info->general_law(changed.values());
  return changed;
}

Law scaled(const Law& law, double weakening, double stribeck_velocity, double strengthening) {
  Law result = law;
  GeneralLaw& f = result.general_law;
  for (const formula::Term& term : formula::terms)
    f.*term.number *= formula::shape_infos[term.shape].weakening ? weakening : strengthening;
  for (const formula::ShapeNumber& row : formula::shape_numbers)
    if (row.quantity == formula::stribeck_velocity || row.quantity == formula::load_velocity)
      f.*row.number *= stribeck_velocity;
  return result;
}

double growth_with_load(const Law& law) {
  double above = 0, at_rest = 0;
  for (const formula::Term& term : formula::terms)
    if (term.load == 1 && formula::shape_infos[term.shape].weakening) {
      at_rest += law.general_law.*term.number;
      if (term.shape == formula::constant) above += law.general_law.*term.number;
    }
  return std::max(std::abs(above), std::abs(at_rest));
}

Result<Law> published_law(std::string_view name) {
  std::vector<std::pair<std::string, double>> values;
  if (const LawInfo* info = find_law(name))
    for (const Parameter& p : info->parameters) {
      if (std::isnan(p.published))
        return tl::unexpected(
            fmt::format("{} publishes no value for parameter '{}' of law '{}'", info->source, p.name, name));
      values.emplace_back(p.name, p.published);
    }
  return make_law(name, values);
}

}  // namespace tribotwin::friction
