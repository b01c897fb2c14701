#include <algorithm>
#include <cmath>
#include <memory>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_prediction.hpp>
#include <tribotwin/twin/identification/thermal/thermal_torque.hpp>
#include <tribotwin/twin/identification/verdict/report.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>

namespace tribotwin::twin::program {
namespace {

using namespace identification;
using Json = nlohmann::ordered_json;

/// Assumed alpha [1/K] where it is unknown; the predicted torque does not depend on it.
constexpr double guessed_alpha = -0.01;

struct Arguments {
  std::vector<std::string> data;
  std::string evaluate;
  Destination output;
  TableArguments tables;
  std::vector<double> cycle_s;  ///< none, one for all files, or one each
  int order = 0;
  double alpha = 0, rest_degC = 20;  ///< of friction; 0: not known
  bool rested = false, chain = false, winding = false, json = false, quiet = false;
};

bool has_temperature(const HeatSession& session) { return !session.temperature_degC.empty(); }

/// Whether a joint can be identified: from temperatures in all files, or in none and from rest.
void require_thermometer_or_rest(const Arguments& a, const JointHeat& joint) {
  const auto without = std::ranges::find_if_not(joint.sessions, has_temperature);
  if (without == joint.sessions.end()) return;
  if (std::ranges::any_of(joint.sessions, has_temperature))
    throw InputError(
        fmt::format("{}: has no column temperature_{}_degC, which other files have; give all files one, or none",
                    a.data[without->file], joint.name));
  if (!a.rested && !a.chain)
    throw InputError(
        fmt::format("{}: has no temperatures; torque alone shows the change from rest temperature, so every "
                    "recording must begin there, as after a night: confirm it with --rested",
                    a.data[without->file]));
}

/// All joints of all files; each joint has the sessions of the files that contain it.
ThermalRecordings read(const Arguments& a) {
  refuse_twice(a.data);
  auto all = or_wrong_input(read_thermal_recordings(a.data, a.cycle_s, or_wrong_input(a.tables.options())));
  if (a.evaluate.empty())
    for (const auto& joint : all.joints) require_thermometer_or_rest(a, joint);
  if (!a.quiet)
    for (const auto& text : all.notes) note("{}", text);
  return all;
}

template <class Fit>
bool times_identifiable(const Fit& fit) {
  return std::ranges::none_of(fit.unidentifiable, [](const std::string& name) { return name.starts_with("t"); });
}

/// A fit of the requested order. Default: second order where both time constants are identifiable, else first.
template <class Fitted>
auto of_order(int order, const Fitted& with) {
  if (order == 1) return with(thermal::Order::first);
  auto second = with(thermal::Order::second);
  return order == 2 || times_identifiable(second) ? second : with(thermal::Order::first);
}

ThermalFit fitted(const Arguments& a, const std::string& joint, std::span<const HeatSession> sessions) {
  return of_order(a.order, [&](thermal::Order order) {
    auto fit = fit_thermal(sessions, {.order = order, .rested = a.rested});
    if (!fit) throw InputError(fmt::format("{}: {}: {}", a.data[sessions.front().file], joint, fit.error().message));
    return *std::move(fit);
  });
}

TorqueThermalFit fitted_to_torque(const Arguments& a, const std::string& joint, std::span<const HeatSession> sessions) {
  return of_order(a.order, [&](thermal::Order order) {
    auto fit = fit_thermal_torque(sessions, order);
    if (!fit) throw InputError(fmt::format("{}: {}: {}", a.data[sessions.front().file], joint, fit.error().message));
    return *std::move(fit);
  });
}

bool is_withheld(std::span<const Lacking> lacking, const std::string& name) {
  return std::ranges::any_of(lacking, [&](const Lacking& one) { return one.withheld && one.parameter == name; });
}

/// A withheld value is null, and stands as `fitted` beside: what the model of -o has, no result.
Json json_of(const Estimate& e, std::span<const Lacking> lacking, const std::string& name) {
  if (!is_withheld(lacking, name))
    return {{"value", e.value}, {"sigma", e.sigma}, {"low", e.low}, {"high", e.high}, {"unit", e.unit}};
  return {{"value", nullptr}, {"sigma", nullptr}, {"low", nullptr},
          {"high", nullptr},  {"unit", e.unit},   {"fitted", e.value}};
}

/// The part that both fits share. A missing sigma is NaN, which JSON shows as null.
Json json_of(const auto& fit, thermal::Order order) {
  Json j{{"order", order == thermal::Order::first ? 1 : 2}};
  for (const auto& e : fit.parameters) j["parameters"][e.name] = json_of(e, fit.lacking, e.name);
  j["correlated_samples"] = fit.correlation;
  j["samples"] = fit.samples;
  j["unidentifiable"] = fit.unidentifiable;
  j["lacking"] = json_of(fit.lacking);
  return j;
}

Json json_of(const ThermalFit& fit) {
  Json j = json_of(fit, fit.model.order);
  for (const auto& e : fit.ambient) j["T_amb_degC"].push_back(json_of(e, fit.lacking, e.name));
  j["rms_K"] = fit.rms_K;
  return j;
}

Json json_of(const TorqueThermalFit& fit) {
  Json j = json_of(fit, fit.order);
  for (const auto& e : fit.power_w) j["P_0_W"].push_back(json_of(e, fit.lacking, e.name));
  j["rms"] = fit.rms;
  j["final_to_cold"] = fit.final_to_cold;
  return j;
}

TextTable estimates_table(const char* from = "") {
  using T = TextTable;
  return T{
      {T::left("joint"), T::left(), T::right("value"), T::right("sigma"), T::left("unit"), T::left(from), T::left()}};
}

/// A row of the table; no numbers where they are withheld. `name`: in `lacking`.
std::vector<std::string> cells_of(const std::string& joint, const std::string& from, const Estimate& e,
                                  std::span<const Lacking> lacking, const std::string& name) {
  const bool none = is_withheld(lacking, name);
  return {joint,
          e.name,
          none ? "-" : fmt::format("{:.5g}", e.value),
          none || std::isnan(e.sigma) ? "-" : fmt::format("{:.2g}", e.sigma),
          e.unit,
          from,
          none ? "not identifiable from this record" : ""};
}

/// Why, and what to record next.
void add_reasons(TextTable& table, const std::string& joint, std::span<const Lacking> lacking) {
  for (auto& line : lines_of(lacking)) table.add({joint, std::move(line)});
}

/// `others`: A or P_0 of each file.
template <class Fit>
void add_estimates(TextTable& table, const std::string& joint, const std::string& from, const Fit& fit,
                   const std::vector<Estimate>& others) {
  for (const auto* all : {&fit.parameters, &others})
    for (const auto& e : *all) table.add(cells_of(joint, from, e, fit.lacking, e.name));
  add_reasons(table, joint, fit.lacking);
}

void add_rows(TextTable& table, const std::string& joint, const std::string& from, const TorqueThermalFit& fit) {
  add_estimates(table, joint, from, fit, fit.power_w);
  table.add({joint, fmt::format("friction falls to {:.3g} of the cold one; residual {:.2g} % rms, {} cycles, {:.0f} "
                                "per independent one",
                                fit.final_to_cold, 100 * fit.rms, fit.samples, fit.correlation)});
}

void add_rows(TextTable& table, const std::string& joint, const std::string& from, const ThermalFit& fit) {
  add_estimates(table, joint, from, fit, fit.ambient);
  table.add({joint, fmt::format("residual {:.3g} K rms, {} samples, {:.0f} per independent one", fit.rms_K, fit.samples,
                                fit.correlation)});
}

/// Fits a joint to all its sessions and, where there are several files, to each file: it shows how far days agree.
template <class Fitted>
auto fit_files(const Arguments& a, const JointHeat& joint, const Fitted& fitted, Json& j, TextTable& table) {
  const auto& sessions = joint.sessions;
  const bool several = sessions.front().file != sessions.back().file;
  auto all = fitted(a, joint.name, std::span(sessions));
  j["joints"][joint.name] = json_of(all);
  add_rows(table, joint.name, several ? "all" : a.data[sessions.front().file], all);
  for (auto first = sessions.begin(); several && first != sessions.end();) {
    const auto last = std::find_if(first, sessions.end(), [&](const HeatSession& s) { return s.file != first->file; });
    const auto fit = fitted(a, joint.name, std::span(first, last));
    j["joints"][joint.name]["files"][a.data[first->file]] = json_of(fit);
    add_rows(table, joint.name, a.data[first->file], fit);
    first = last;
  }
  return all;
}

Result<Exit> identify(const Arguments& a) {
  const auto joints = read(a).joints;
  std::vector<NamedThermalFit> fits;
  Json j{{"joints", Json::object()}};
  TextTable table = estimates_table("from");
  Progress progress(a.quiet, "identifying");
  bool from_torque = false;
  for (const auto& joint : joints) {
    const bool torque_only = !has_temperature(joint.sessions.front());
    from_torque |= torque_only;
    if (torque_only) {
      const auto fit = fit_files(a, joint, fitted_to_torque, j, table);
      constexpr double steady = 0.05;
      if (fit.rms > steady && !a.quiet)
        note(
            "{}: the work of the cycles scatters by {:.2g} % about the model; is --work-cycle their period, and does "
            "the "
            "robot go back the way it came?",
            joint.name, 100 * fit.rms);
      fits.emplace_back(joint.name, with_alpha(fit, a.alpha != 0 ? a.alpha : guessed_alpha, a.alpha != 0, a.rest_degC));
    } else
      fits.emplace_back(joint.name, fit_files(a, joint, fitted, j, table));
    if (!torque_only && !a.cycle_s.empty()) {
      const Estimate alpha = fit_alpha(joint.sessions, a.rest_degC);
      const auto lacks = lacking({.parameters = {&alpha, 1}}, thermal_advice(0));
      j["joints"][joint.name]["alpha"] = json_of(alpha, lacks, alpha.name);
      table.add(cells_of(joint.name, fmt::format("at {:g} degC", a.rest_degC), alpha, lacks, alpha.name));
      add_reasons(table, joint.name, lacks);
    }
    progress(static_cast<double>(fits.size()) / static_cast<double>(joints.size()));
  }
  if (from_torque && !a.quiet && a.alpha == 0)
    note("torque identifies alpha c, not alpha and c separately; for that give --alpha, or temperatures.{}",
         a.output.named() ? fmt::format(" {} is in units in which alpha is {} 1/K", a.output.file, guessed_alpha) : "");
  if (a.output.named())
    if (auto ok = deliver(to_yaml(fits, a.data), a.output); !ok) return ok;
  return deliver(a.json ? dump_json(j, 2) + "\n" : table.text());
}

Result<Exit> identify_chain(const Arguments& a) {
  const auto joints = read(a).joints;
  for (const auto& joint : joints)
    if (!std::ranges::all_of(joint.sessions, has_temperature))
      throw InputError(
          fmt::format("{}: --chain takes the temperatures of all joints; {} has none", a.data.front(), joint.name));
  std::vector<WindingTrial> trials;
  if (a.winding) {
    auto tried = try_windings(joints);
    if (!tried) throw InputError(fmt::format("{}: {}", a.data.front(), tried.error().message));
    trials = *std::move(tried);
  }
  const auto best = std::ranges::min_element(trials, {}, &WindingTrial::held_out_rms_K);
  const auto fit = fit_thermal_chain(joints, trials.empty() ? ChainWinding{} : best->winding);
  if (!fit) throw InputError(fmt::format("{}: {}", a.data.front(), fit.error().message));
  Json j{{"exchange_1_s", json_of(fit->exchange, fit->lacking, fit->exchange.name)},
         {"rms_K", fit->rms_K},
         {"correlated_samples", fit->correlation},
         {"samples", fit->samples},
         {"unidentifiable", fit->unidentifiable},
         {"lacking", json_of(fit->lacking)}};
  for (const auto& t : trials)
    j["windings"].push_back({{"winding_s", t.winding.winding_s},
                             {"copper_1_K", t.winding.copper_1_K},
                             {"held_out_rms_K", t.held_out_rms_K}});
  TextTable table = estimates_table();
  if (!trials.empty()) {
    const ChainWinding& w = fit->chain.winding;
    j["winding"] = {{"winding_s", w.winding_s}, {"copper_1_K", w.copper_1_K}};
    table.add({"all", fmt::format("winding of {:g} s, {:g} 1/K: chosen by the last third of each session, {:.3g} K rms "
                                  "(without a winding {:.3g} K)",
                                  w.winding_s, w.copper_1_K, best->held_out_rms_K, trials.front().held_out_rms_K)});
  }
  table.add(cells_of("all", "", fit->exchange, fit->lacking, fit->exchange.name));
  for (std::size_t k = 0; k < fit->parameters.size(); ++k)
    for (const auto& e : fit->parameters[k]) {
      const auto& joint = fit->chain.joints[k];
      table.add(cells_of(joint, "", e, fit->lacking, joint + "." + e.name));
      j["joints"][joint][e.name] = json_of(e, fit->lacking, joint + "." + e.name);
    }
  add_reasons(table, "all", fit->lacking);
  table.add({"all", fmt::format("residual {:.3g} K rms, {} samples, {:.0f} per independent one", fit->rms_K,
                                fit->samples, fit->correlation)});
  if (a.output.named())
    if (auto ok = deliver(to_yaml(*fit, a.data), a.output); !ok) return ok;
  return deliver(a.json ? dump_json(j, 2) + "\n" : table.text());
}

Result<Exit> evaluate(const Arguments& a) {
  const auto recordings = read(a);
  const auto all = or_wrong_input(predict_temperatures(a.evaluate, recordings));
  Json j{{"joints", Json::object()}};
  constexpr auto right = TextTable::right;
  TextTable table{{TextTable::left("joint"), right("error rms K"), right("largest K"), right("95 % band +- K"),
                   right("inside"), right("from degC"), right("samples"), TextTable::left("session")}};
  double worst = 0;
  for (std::size_t k = 0; k < all.size(); ++k)
    for (std::size_t s = 0; s < all[k].size(); ++s) {
      const auto& joint = recordings.joints[k];
      const auto& session = joint.sessions[s];
      const auto& p = all[k][s];
      const bool known = !p.half_width_K.empty();
      const double widest = known ? std::ranges::max(p.half_width_K) : 0;
      worst = std::max(worst, p.rms_K);
      j["joints"][joint.name].push_back({{"file", a.data[session.file]},
                                         {"from_s", session.time_s.front()},
                                         {"rms_K", p.rms_K},
                                         {"largest_K", p.largest_K},
                                         {"half_width_K", known ? Json(widest) : Json(nullptr)},
                                         {"inside", known ? Json(p.inside) : Json(nullptr)},
                                         {"samples", p.temperature_degC.size()}});
      table.add({joint.name, fmt::format("{:.3f}", p.rms_K), fmt::format("{:.3f}", p.largest_K),
                 known ? fmt::format("{:.3f}", widest) : "-", known ? fmt::format("{:.1f} %", 100 * p.inside) : "-",
                 fmt::format("{:.2f}", session.temperature_degC.front()), fmt::format("{}", p.temperature_degC.size()),
                 fmt::format("{} from {:.6g} s", a.data[session.file], session.time_s.front())});
    }
  j["worst_rms_K"] = worst;
  return deliver(a.json ? dump_json(j, 2) + "\n" : table.text());
}

}  // namespace

void add_thermal(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand(
      "thermal", "Identify thermal models of joints from recorded heat and temperature, or from torque alone");
  c->add_option("DATA", a->data,
                "Table (CSV, folder of a run, telemetry.h5, .npz, .npy, .mat, .mcap): time_s, power_JOINT_w or "
                "torque_JOINT_nm with velocity_JOINT_rad_s or position_JOINT_rad, and "
                "temperature_JOINT_degC; without temperatures --work-cycle and --rested")
      ->required();
  auto* order = c->add_option("--order", a->order,
                              "Order of the model (default: 2 where both time constants are identifiable, else 1)")
                    ->check(CLI::IsMember({1, 2}));
  c->add_option("--work-cycle,--cycle", a->cycle_s,
                "Length of the working cycle [s], for heat from torque and motion: one, or one for each file as A,B")
      ->delimiter(',')
      ->check(CLI::Range(1e-3, 3600.0));
  auto* rested = c->add_flag("--rested", a->rested, "Every file starts at ambient temperature, as after a night");
  auto* chain = c->add_flag("--chain", a->chain,
                            "Joints heat their neighbours, in the order of the columns, at one rate; for records too "
                            "short to identify slow poles joint by joint")
                    ->excludes(order)
                    ->excludes(rested);
  c->add_flag(
       "--winding", a->winding,
       "With --chain and squared currents as power: heat passes through windings, whose time constant and copper "
       "are chosen by predicting the last third of each session from the rest")
      ->needs(chain);
  auto* alpha =
      c->add_option(
           "--alpha", a->alpha,
           "Without temperatures: change of friction per K over friction at rest temperature, where it is known [1/K]")
          ->check(CLI::Range(-1.0, 1.0));
  auto* rest = c->add_option("--rest", a->rest_degC, "Temperature at rest [degC], the reference of alpha")
                   ->check(CLI::Range(-60.0, 250.0))
                   ->capture_default_str();
  a->tables.add_to(*c);
  a->tables.add_gear_ratio_to(*c);
  auto* output = a->output.add_to(*c, "PARAMS.yaml to write");
  c->add_option(
       "--evaluate", a->evaluate,
       "PARAMS.yaml of an earlier call: how far its predictions of these data are off, and how far they may be")
      ->excludes(order)
      ->excludes(rested)
      ->excludes(output)
      ->excludes(alpha)
      ->excludes(rest)
      ->excludes(chain);
  c->add_flag("--json", a->json, "Print JSON instead of the table");
  c->add_flag("--quiet", a->quiet, "No progress, no notes");
  c->footer(
      "The data are yours: recordings of a robot that warms up, monday.csv and tuesday.csv say, with time_s and for "
      "each "
      "joint temperature_JOINT_degC and power_JOINT_w, or torque_JOINT_nm with velocity_JOINT_rad_s or "
      "position_JOINT_rad; for slides torque_JOINT_n, velocity_JOINT_m_s, position_JOINT_m. Other names: "
      "--columns.\nExample:\n  tribotwin thermal monday.csv tuesday.csv -o thermal.yaml");
  c->callback([a, &code] {
    check(a->output, paths(a->data));
    code = or_throw(!a->evaluate.empty() ? evaluate(*a) : a->chain ? identify_chain(*a) : identify(*a));
  });
}

}  // namespace tribotwin::twin::program
