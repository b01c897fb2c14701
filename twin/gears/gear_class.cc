#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/gears/gear_class.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin {
namespace {

using Values = std::pair<std::string_view, double>;

// Joint 1 of the BR609 twin (mjcf/br609.xml). Its 15.0 Nm at 5 deg/s, 100:1 and alpha are Zhou 2024's.
constexpr Values br609[] = {{"Fc0", 7.92},    {"FcT", 0.027}, {"Fcl", 5.4},   {"Fs0", 13},
                            {"Fsl", 7.8},     {"Vs0", 2},     {"VsT", 0.025}, {"alpha", 1.3},
                            {"FvT", 5.66483}, {"TV0", 32},    {"beta0", 0.5}, {"betaT", 0.0025}};
// Bittencourt 2012, Tables 2 and 3: joint 2 of an IRB 6620.
constexpr Values irb6620[] = {{"Fc0", 3.11e-2}, {"Fcl", 2.34e-2}, {"Fs0", -2.50e-2}, {"FsT", 1.60e-3},
                              {"Fsl", 1.26e-1}, {"vs0", -24.81},  {"vsT", 0.98},     {"vsl", 9.22},
                              {"alpha", 1.36},  {"Fv0", 1.30e-4}, {"FvT", 1.32e-3},  {"TV0", 20.71}};
// Model m4 of Duclusaud 2024 is our law `load`; its joint-side numbers over torque_max and gear ratio.
constexpr Values erob80_50[] = {{"Fc0", 5.968e-2}, {"Fcl", 6.3087e-2}, {"Fs0", 1.59e-7}, {"Fsl", 7.13e-7},
                                {"vs", 17.301},    {"alpha", 2.7272},  {"Fv", 4.2047e-4}};
constexpr Values erob80_100[] = {{"Fc0", 1.063e-6}, {"Fcl", 2.127e-6}, {"Fs0", 3.7259e-2}, {"Fsl", 0.16614},
                                 {"vs", 197.71},    {"alpha", 2.9999}, {"Fv", 7.6777e-4}};
constexpr Values mx64[] = {{"Fc0", 1.0258e-2}, {"Fcl", 0},        {"Fs0", 3.9825e-3}, {"Fsl", 0.23429},
                           {"vs", 304.12},     {"alpha", 1.3344}, {"Fv", 1.2296e-5}};
constexpr Values mx106[] = {{"Fc0", 0},     {"Fcl", 9.1503e-3}, {"Fs0", 1.2489e-2}, {"Fsl", 0.22236},
                            {"vs", 365.24}, {"alpha", 1.3235},  {"Fv", 2.6964e-5}};
// mjcf/xl330_pendulum.xml, identified from all 16 recordings.
constexpr Values xl330[] = {{"Fc0", 1.4534e-2}, {"Fcl", 0.29384},  {"Fs0", -1.1321e-2}, {"Fsl", 0.24427},
                            {"vs", 132.90},     {"alpha", 1.9720}, {"Fv", 3.9065e-5}};
// Katz 2019: 0.2 Nm dry friction and 0.01 Nm s/rad at a joint of 18 Nm behind 6:1.
constexpr Values mini_cheetah[] = {{"Fc0", 1.1111e-2}, {"Fcl", 0.03},   {"Fs0", 0},       {"Fsl", 0},
                                   {"vs", 10},         {"alpha", 1.36}, {"Fv", 9.2593e-5}};
constexpr Values screw[] = {{"Fc0", 0.02}, {"Fcl", 0.05},   {"Fs0", 0.01}, {"Fsl", 0.02},
                            {"vs", 10},    {"alpha", 1.36}, {"Fv", 5e-5}};

constexpr std::string_view br609_joint1 =
    "joint 1 of the BR609 twin (Zhou 2024: 15.0 Nm at 5 deg/s, 100:1, alpha; load, temperature, inertia, heat: "
    "choices of mjcf/br609.xml)";
constexpr std::string_view from_br609 =
    "scaled from joint 1 of the BR609 twin (Zhou 2024), see harmonic_220; torque, inertia, heat: choices of "
    "mjcf/br609.xml";
constexpr std::string_view irb6620_joint2 =
    "joint 2 of the IRB 6620 (Bittencourt 2012: law, 3.04 h; torque, inertia, R_th: choices of mjcf/irb6620.xml)";
constexpr std::string_view from_irb6620 =
    "scaled from joint 2 of the IRB 6620 (Bittencourt 2012), see cycloidal_7500; torque, inertia, R_th: choices of "
    "mjcf/irb6620.xml";
constexpr std::string_view of_erob =
    "Duclusaud 2024, eRob80, model m4; torque: 12 A of its bench times its torque constant; heat: choice";
constexpr std::string_view of_dynamixel =
    "Duclusaud 2024, model m4; stall torque at 12 V and ratio of "
    "ROBOTIS 2024; heat: choice";
constexpr std::string_view of_xl330 = "identified here from the recordings of Duclusaud 2024; heat: choice";
constexpr std::string_view of_cheetah =
    "Katz 2019 (dry friction, damping, rotor, 6:1, 18 Nm); load share of a 97 % efficient stage and heat: choices";
constexpr std::string_view of_screw =
    "choice: lead 10 mm, preload friction 2 %, efficiency 95 %, Stribeck shape of Bittencourt 2012";

// name, family, linear, torque, ratio, rotor, speed, law, scale, parameters, law's speed, load, R_th, kappa, source
constexpr GearClass table[] = {
    {"xl330", "hobby_servo", false, 0.52, 288.35, 1.782e-8, 8, "load", 1, xl330, 6000, 1, 15, 900, of_xl330},
    {"mx64", "hobby_servo", false, 6.0, 200, 2.740e-7, 5, "load", 1, mx64, 1400, 1, 3, 1200, of_dynamixel},
    {"mx106", "hobby_servo", false, 8.4, 225, 4.854e-7, 4, "load", 1, mx106, 1100, 1, 2.5, 1200, of_dynamixel},
    {"planetary_18", "planetary", false, 18, 6, 6.3e-5, 10, "load", 1, mini_cheetah, 280, 1, 1.5, 1800, of_cheetah},
    {"harmonic_30", "harmonic", false, 30, 100, 1.2e-5, 1.745, "steady_state_extended", 0.18, br609, 0, 0, 6.111, 10944,
     from_br609},
    {"harmonic_55", "harmonic", false, 55, 100, 2.5e-5, 1.745, "steady_state_extended", 0.3, br609, 0, 0, 3.667, 10944,
     from_br609},
    {"harmonic_130", "harmonic", false, 130, 100, 6e-5, 1.745, "steady_state_extended", 0.6, br609, 0, 0, 1.833, 10944,
     from_br609},
    {"harmonic_220", "harmonic", false, 220, 100, 1.2e-4, 1.745, "steady_state_extended", 1, br609, 0, 0, 1.1, 10944,
     br609_joint1},
    {"harmonic_345", "harmonic", false, 345, 100, 1.2e-4, 1.745, "steady_state_extended", 1.1, br609, 0, 0, 1, 10944,
     from_br609},
    {"erob80_50", "erob80", false, 57.87, 50, 1.3353e-4, 3, "load", 1, erob80_50, 0, 1, 4, 7200, of_erob},
    {"erob80_100", "erob80", false, 117.6, 100, 9.4698e-5, 2, "load", 1, erob80_100, 0, 1, 2, 7200, of_erob},
    {"cycloidal_1200", "cycloidal", false, 1200, 107, 1.485e-3, 2.6, "extended", 1, irb6620, 0, 0, 0.5787, 10944,
     from_irb6620},
    {"cycloidal_4000", "cycloidal", false, 4000, 178, 2.493e-3, 1.57, "extended", 1, irb6620, 0, 0, 0.2893, 10944,
     from_irb6620},
    {"cycloidal_7500", "cycloidal", false, 7500, 178, 4.513e-3, 1.57, "extended", 1, irb6620, 0, 0, 0.118, 10944,
     irb6620_joint2},
    {"ball_screw_1000", "ball_screw", true, 1000, 628.3, 1e-4, 0.3, "load", 1, screw, 0, 1, 2, 3600, of_screw},
};

}  // namespace

std::vector<std::string_view> gear_names() {
  std::vector<std::string_view> names;
  for (const GearClass& g : table) {
    if (std::ranges::find(names, g.family) == names.end()) names.push_back(g.family);
    names.push_back(g.name);
  }
  return names;
}

std::span<const GearClass> gear_classes() { return table; }

Result<const GearClass*> find_gear_class(std::string_view name, double effort_nm) {
  const GearClass* nearest = nullptr;
  const auto distance = [&](const GearClass& g) { return std::abs(std::log(effort_nm / g.torque_max_nm)); };
  for (const GearClass& g : table) {
    if (g.name == name) return &g;
    if (g.family == name && (!nearest || distance(g) < distance(*nearest))) nearest = &g;
  }
  if (nearest) return nearest;
  return tl::unexpected(fmt::format("gear class '{}' is not known; did you mean '{}'? `tribotwin list gears` shows all",
                                    name, tribotwin::nearest(name, gear_names())));
}

std::string_view usual_family(double effort_nm, bool slide, bool legged) {
  if (slide) return "ball_screw";
  if (effort_nm < 5) return "hobby_servo";
  if (legged && effort_nm <= 60) return "planetary";
  return effort_nm < 500 ? "harmonic" : "cycloidal";
}

drive::Configuration configuration_of(const GearClass& gear, double scale) {
  drive::Configuration keys;
  const auto add = [&](std::string_view key, double value) {
    keys.emplace_back(std::string(key), fmt::format("{:.6g}", value));
  };
  const friction::LawInfo& law = *friction::find_law(gear.law);
  keys.emplace_back("law", std::string(gear.law));
  for (const auto& [name, value] : gear.parameters) {
    const auto parameter = std::ranges::find(law.parameters, name, &friction::Parameter::name);
    const bool torque = parameter->unit.starts_with("Nm");
    add(name, torque ? value * gear.friction_scale * scale : value);
  }
  add("torque_max_nm", gear.torque_max_nm * scale);
  add("gear_ratio", gear.gear_ratio);
  if (gear.law_speed_max_rad_s > 0) add("speed_max_rad_s", gear.law_speed_max_rad_s);
  if (gear.law_load_max > 0) add("load_max", gear.law_load_max);
  keys.emplace_back("thermal", "first_order");
  add("R_th", gear.R_th_K_W / scale);
  add("kappa", gear.kappa_s);
  add("T_amb", 25);
  return keys;
}

std::string description(const GearClass& gear, double scale) {
  if (std::abs(scale - 1) < 1e-9) return std::string(gear.name);
  return fmt::format("{}, scaled by {:.3g} from {:g} {}", gear.name, scale, gear.torque_max_nm,
                     unit_of("Nm", gear.linear));
}

std::string gear_classes_markdown() {
  std::string text =
      "| class | family | torque | gear ratio | rotor [kg m^2] | law | R_th [K/W], kappa [s] | source |\n";
  text += "|---|---|---|---|---|---|---|---|\n";
  for (const GearClass& g : table)
    text += fmt::format("| `{}` | `{}` | {:g} {} | {:g}{} | {:.3g} | `{}` | {:g}, {:g} | {} |\n", g.name, g.family,
                        g.torque_max_nm, unit_of("Nm", g.linear), g.gear_ratio, g.linear ? " rad/m" : "",
                        g.rotor_inertia_kg_m2, g.law, g.R_th_K_W, g.kappa_s, g.source);
  return text;
}

}  // namespace tribotwin::twin
