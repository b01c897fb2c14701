#include <algorithm>
#include <cmath>
#include <memory>

#include <fmt/format.h>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/diagnosis/healthy_file.hpp>
#include <tribotwin/twin/diagnosis/learn.hpp>
#include <tribotwin/twin/diagnosis/sequence.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>

namespace tribotwin::twin::program {
namespace {

using namespace diagnosis;
using Json = nlohmann::ordered_json;

struct Arguments {
  std::vector<std::string> data, loaded;
  std::string healthy;
  Destination output;
  ObservationOptions read;
  LearnOptions learn;
  CheckOptions check;
  ResidualOptions residuals;
  TableArguments tables;
  double false_alarm = once_a_year;
  bool json = false, quiet = false;
};

std::vector<ObservationFile> read(const std::vector<std::string>& files, const ObservationOptions& options,
                                  bool quiet) {
  std::vector<ObservationFile> all;
  for (const auto& file : files) {
    auto one = read_observations(file, options);
    if (!one) throw InputError(one.error().message);
    if (!quiet)
      for (const auto& text : one->notes) note("{}", text);
    all.push_back(*std::move(one));
  }
  return all;
}

/// What both options of the command line and options of tables say about columns.
TableOptions tables_of(const Arguments& a, const std::string& joint) {
  auto options = or_wrong_input(a.tables.options());
  options.joint = joint;
  return options;
}

ObservationOptions read_options(const Arguments& a) {
  ObservationOptions options = a.read;
  options.table = tables_of(a, a.read.table.joint);
  return options;
}

Result<Exit> learn_state(const Arguments& a) {
  const ObservationOptions options = read_options(a);
  const auto healthy = read(a.data, options, a.quiet), loaded = read(a.loaded, options, a.quiet);
  auto state = learn(healthy, loaded, a.read.load_sensitivity, a.learn);
  if (!state) throw InputError(state.error().message);
  if (state->joint.empty()) state->joint = a.read.table.joint;
  if (!(state->torque_max_nm > 0)) state->torque_max_nm = a.read.torque_max_nm;
  if (auto ok = deliver(to_yaml(*state), a.output); !ok) return ok;
  if (!a.output.named() || a.quiet) return done;
  report_text(fmt::format("healthy state of {} curves{}{}{}\n", state->observations,
                          state->left_out ? fmt::format(" ({} left out)", state->left_out) : "",
                          state->knows_temperature ? fmt::format(", {:.1f} to {:.1f} degC", state->temperature_low_degC,
                                                                 state->temperature_high_degC)
                                                   : "",
                          state->observations < observations_usual
                              ? fmt::format("; {} and more, cold to hot, detect smaller changes", observations_usual)
                              : ""));
  if (!state->knows_temperature)
    note(
        "the curves span less than 5 K or have no temperature_degC: effects of temperature cannot be separated from "
        "faults");
  return done;
}

Json json_of(const RegionVerdict& v) {
  return {{"distance", v.distance},
          {"anomalous", v.anomalous},
          {"statistic", v.statistic},
          {"limit", v.limit},
          {"by_chance", v.by_chance},
          {"beyond_two_sigma", v.beyond_two_sigma},
          {"beyond_wear_threshold", v.beyond_wear}};
}

Json json_of(const Observation& o, const Verdict& v) {
  Json j{{"file", o.file},
         {"curve", o.curve},
         {"temperature_degC", or_null(o.temperature_degC)},
         {"anomalous", v.anomalous}};
  for (std::size_t r = 0; r < regions.size(); ++r) j[regions[r].name] = json_of(v.region[r]);
  j["equivalent_load"] = v.load.load_norm;
  j["equivalent_load_sigma"] = v.load.sigma;
  j["equivalent_load_threshold"] = v.load.threshold;
  j["equivalent_load_nm"] = or_null(v.load.nm);
  j["equivalent_load_kg"] = or_null(v.load.kg);
  j["pattern"] = v.pattern;
  j["severity"] = v.severity;
  j["confidence"] = v.confidence;
  j["perhaps_healthy"] = v.perhaps_healthy;
  for (const auto& c : v.candidates) j["probabilities"][c.pattern ? c.pattern->name : "healthy"] = c.probability;
  for (Eigen::Index i = 0; i < feature_count; ++i)
    j["features"][feature_names[static_cast<std::size_t>(i)]] = o.features(i);
  for (std::size_t k = 0; k < indicator_count; ++k)
    if (v.indicators[k])
      j["indicators"][indicators[k].name] = {{"value", v.indicators[k]->value},
                                             {"limit", v.indicators[k]->limit},
                                             {"anomalous", v.indicators[k]->anomalous}};
  j["sentence"] = v.sentence;
  return j;
}

/// As the state was learned.
ObservationOptions options_of(const Arguments& a, const HealthyState& state) {
  ObservationOptions options = read_options(a);
  options.load_sensitivity = state.load_sensitivity;
  if (!(options.torque_max_nm > 0)) options.torque_max_nm = state.torque_max_nm;
  return options;
}

Result<Exit> check_curves(const Arguments& a) {
  const HealthyState state = or_wrong_input(read_healthy(a.healthy));
  Json j{{"healthy", a.healthy},
         {"joint", state.joint},
         {"false_alarm", a.check.false_alarm},
         {"observations", Json::array()}};
  std::string table = fmt::format("{:<5} {:>7} {:>10} {:>10} {:>8} {:>10} {:>10} {:>8} {:>11}  {:<15} {}\n", "curve",
                                  "degC", "distance 1", "T^2 1", "limit", "distance 2", "T^2 2", "limit", "equiv. load",
                                  "pattern", "confidence"),
              sentences;
  bool anomalous = false;
  for (const auto& file : read(a.data, options_of(a, state), a.quiet)) {
    const auto verdicts = check(state, file, a.check);
    if (!verdicts) throw InputError(verdicts.error().message);
    for (std::size_t i = 0; i < verdicts->size(); ++i) {
      const Observation& o = file.observations[i];
      const Verdict& v = (*verdicts)[i];
      anomalous |= v.anomalous;
      j["observations"].push_back(json_of(o, v));
      table += fmt::format(
          "{:<5} {:>7} {:>10.3f} {:>10.3f} {:>7.2f}{} {:>10.3f} {:>10.3f} {:>7.2f}{} {:>11.3f}  {:<15} {}\n",
          j["observations"].size(), o.temperature_degC ? fmt::format("{:.1f}", *o.temperature_degC) : "-",
          v.region[0].distance, v.region[0].statistic, v.region[0].limit, v.region[0].anomalous ? "!" : " ",
          v.region[1].distance, v.region[1].statistic, v.region[1].limit, v.region[1].anomalous ? "!" : " ",
          v.load.load_norm, v.pattern, probability_text(v.confidence));
      sentences += v.sentence + "\n";
    }
  }
  if (auto ok = deliver(a.json ? dump_json(j, 2) + "\n" : table + "\n" + sentences, a.output); !ok) return ok;
  return anomalous ? limit_exceeded : done;
}

Json json_of(const Margin& m) {
  return {{"straight", m.straight},
          {"load_norm", {{"value", m.load_norm.value}, {"low", m.load_norm.low}, {"high", m.load_norm.high}}},
          {"observations",
           {{"value", or_null(m.observations)}, {"low", or_null(m.earliest)}, {"high", or_null(m.latest)}}}};
}

std::string text_of(const Margin& m) {
  std::string s =
      fmt::format("margin to the wear threshold: {:.3g} of torque_max in equivalent load (95 %: {:.3g} .. {:.3g})",
                  m.load_norm.value, m.load_norm.low, m.load_norm.high);
  if (!m.straight) return s + ", by the last observation: the equivalent loads do not follow a straight line\n";
  if (!m.observations) return s + "; it does not shrink\n";
  return s + fmt::format("; at this rate {:.0f} more observations (95 %: {:.0f} .. {})\n", *m.observations,
                         m.earliest.value_or(0), m.latest ? fmt::format("{:.0f}", *m.latest) : "never");
}

Result<Exit> watch_curves(const Arguments& a) {
  const HealthyState state = or_wrong_input(read_healthy(a.healthy));
  std::vector<Observation> all;
  for (const auto& file : read(a.data, options_of(a, state), a.quiet)) {
    if (const auto fit = check(state, file); !fit) throw InputError(fit.error().message);
    all.insert(all.end(), file.observations.begin(), file.observations.end());
  }
  const Watch w = watch(state, all, a.false_alarm);
  Json j{{"healthy", a.healthy},
         {"false_alarm", a.false_alarm},
         {"threshold", w.threshold},
         {"observations", Json::array()}};
  std::string table = fmt::format("{:>5} {:>7} {:>9} {:>9} {:>9} {:>9}   {}\n", "", "degC", "score 1", "CUSUM 1",
                                  "score 2", "CUSUM 2", "from");
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto& s = w.steps[i];
    Json one{{"file", all[i].file}, {"curve", all[i].curve}};
    for (std::size_t r = 0; r < regions.size(); ++r)
      one[regions[r].name] = {{"score", s.region[r].score}, {"cusum", s.region[r].sum}, {"alarm", s.alarm[r]}};
    j["observations"].push_back(std::move(one));
    table += fmt::format("{:>5} {:>7} {:>9.3f} {:>8.3f}{} {:>9.3f} {:>8.3f}{}   {}\n", i + 1,
                         all[i].temperature_degC ? fmt::format("{:.1f}", *all[i].temperature_degC) : "-",
                         s.region[0].score, s.region[0].sum, s.alarm[0] ? "!" : " ", s.region[1].score, s.region[1].sum,
                         s.alarm[1] ? "!" : " ", all[i].file);
  }
  j["first_alarm"] = w.first_alarm ? Json(*w.first_alarm + 1) : Json(nullptr);
  j["margin"] = w.margin ? json_of(*w.margin) : Json(nullptr);
  table +=
      fmt::format("threshold {:.3f}, {}\n", w.threshold,
                  w.first_alarm ? fmt::format("first exceeded by observation {}", *w.first_alarm + 1) : "not exceeded");
  if (w.margin) table += text_of(*w.margin);
  if (auto ok = deliver(a.json ? dump_json(j, 2) + "\n" : table, a.output); !ok) return ok;
  return w.first_alarm ? limit_exceeded : done;
}

Result<Exit> watch_shadow(const Arguments& a) {
  ResidualOptions options = a.residuals;
  options.table = tables_of(a, a.residuals.table.joint);
  const auto w = watch_residuals(a.data.front(), options);
  if (!w) throw InputError(w.error().message);
  for (const auto& text : w->notes)
    if (!a.quiet) note("{}", text);
  // Beyond 2 / sqrt(n) it is hardly chance.
  if (!a.quiet && w->correlation > 2 / std::sqrt(static_cast<double>(a.residuals.learn)))
    note(
        "neighbouring windows are correlated ({:.2f}): there will be more false alarms than requested; lengthen "
        "--window",
        w->correlation);
  Json j{{"joint", w->joint},
         {"false_alarm", a.residuals.false_alarm},
         {"threshold", w->threshold},
         {"correlation", w->correlation},
         {"windows", Json::array()}};
  std::string table = fmt::format("{:>10} {:>12} {:>9} {:>9}\n", "time s", "rms Nm", "score", "CUSUM");
  for (const auto& x : w->windows) {
    j["windows"].push_back({{"time_s", x.time_s},
                            {"rms_nm", x.rms_nm},
                            {"score", x.cusum.score},
                            {"cusum", x.cusum.sum},
                            {"alarm", x.alarm}});
    table += fmt::format("{:>10.1f} {:>12.5g} {:>9.3f} {:>8.3f}{}\n", x.time_s, x.rms_nm, x.cusum.score, x.cusum.sum,
                         x.alarm ? "!" : "");
  }
  j["first_alarm_s"] = w->first_alarm ? Json(w->windows[*w->first_alarm].time_s) : Json(nullptr);
  table += fmt::format(
      "threshold {:.3f}, {}\n", w->threshold,
      w->first_alarm ? fmt::format("first exceeded at {:.1f} s", w->windows[*w->first_alarm].time_s) : "not exceeded");
  if (auto ok = deliver(a.json ? dump_json(j, 2) + "\n" : table, a.output); !ok) return ok;
  return w->first_alarm ? limit_exceeded : done;
}

std::vector<std::filesystem::path> inputs_of(const Arguments& a) {
  auto files = paths(a.data);
  files.emplace_back(a.healthy);
  return files;
}

void add_units(CLI::App& c, Arguments& a) {
  c.add_option("--tau-max", a.read.torque_max_nm,
               "Largest manipulation torque [Nm], arm side, for curves in friction_norm alone")
      ->check(CLI::Range(1e-9, 1e9));
  c.add_option("--gear-ratio", a.read.gear_ratio, "Motor turns per joint turn, for recordings")
      ->check(CLI::Range(1e-6, 1e6));
  c.add_option("--joint", a.read.table.joint, "Joint of a table of several, such as a telemetry.h5");
  a.tables.add_to(c);
  c.add_flag("--quiet", a.quiet, "No notes on stderr");
}

void add_learn(CLI::App& app, const std::shared_ptr<Arguments>& a, int& code) {
  auto* command =
      app.add_subcommand("learn", "The healthy state of a joint, from unloaded friction curves cold to hot");
  command->add_option("CURVES", a->data, "Friction curves (CSV), as of tribotwin lab; recordings or telemetry.h5")
      ->required();
  command
      ->add_option("--loaded", a->loaded,
                   "Curves of the same joint with a payload, to learn the effect of load; may be repeated")
      ->allow_extra_args(false);
  command->add_option("--load-sensitivity", a->read.load_sensitivity, "Relative rise of Fc and Fs per load_norm")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  command
      ->add_option("--lever", a->learn.lever_m,
                   "Distance of a payload from the joint's axis [m], for equivalent loads in kg")
      ->check(CLI::Range(1e-6, 1e3));
  command->add_flag("--leave-out-outliers,--robust", a->learn.robust, "Leave out outliers among the curves");
  a->output.add_to(*command, "healthy.yaml to write (default: stdout)");
  a->output.add_json_to(*command);
  add_units(*command, *a);
  command->footer(
      "Example:\n  tribotwin lab br609_campaign -o lab/br609\n  tribotwin diagnose learn lab/br609/curves/00?.csv "
      "lab/br609/curves/01[012].csv -o healthy.yaml");
  command->callback([a, &code] {
    auto curves = a->data;
    curves.insert(curves.end(), a->loaded.begin(), a->loaded.end());
    check(a->output, paths(curves));
    refuse_twice(curves);
    code = or_throw(learn_state(*a));
  });
}

void add_check(CLI::App& app, const std::shared_ptr<Arguments>& a, int& code) {
  auto* command = app.add_subcommand("check", "Verdicts on friction curves; exit code 3 where one is not healthy");
  command->add_option("HEALTHY", a->healthy, "healthy.yaml of tribotwin diagnose learn")->required();
  command->add_option("CURVES", a->data, "Friction curves (CSV), as of tribotwin lab; recordings or telemetry.h5")
      ->required();
  command
      ->add_option("--false-alarm", a->check.false_alarm,
                   "Share of healthy observations that may be called anomalous, per region and indicator")
      ->check(CLI::Range(1e-9, 0.5))
      ->capture_default_str();
  a->output.add_to(*command, "File for the verdicts (default: stdout)");
  command->add_flag("--json", a->json, "Print JSON instead of the table");
  add_units(*command, *a);
  command->footer(
      "Example:\n  tribotwin lab br609_campaign -o lab/br609\n  tribotwin diagnose learn lab/br609/curves/00?.csv "
      "lab/br609/curves/01[012].csv -o healthy.yaml\n  tribotwin diagnose check healthy.yaml lab/br609/curves/013.csv "
      "--json");
  command->callback([a, &code] {
    check(a->output, inputs_of(*a));
    refuse_twice(a->data);
    code = or_throw(check_curves(*a));
  });
}

void add_watch(CLI::App& app, const std::shared_ptr<Arguments>& a, int& code) {
  auto* command = app.add_subcommand(
      "watch", "Small changes over many observations (CUSUM), and the margin left; exit code 3 at an alarm");
  command->add_option("HEALTHY", a->healthy, "healthy.yaml of tribotwin diagnose learn")->required();
  command->add_option("CURVES", a->data, "Friction curves in the order of time")->required();
  command->add_option("--false-alarm", a->false_alarm, "False alarms per observation of a healthy joint, on average")
      ->check(CLI::Range(1e-7, 0.3))
      ->capture_default_str();
  a->output.add_to(*command, "File for the verdicts (default: stdout)");
  command->add_flag("--json", a->json, "Print JSON instead of the table");
  add_units(*command, *a);
  command->footer(
      "Example:\n  tribotwin lab br609_campaign -o lab/br609\n  tribotwin diagnose learn lab/br609/curves/00?.csv "
      "lab/br609/curves/01[012].csv -o healthy.yaml\n  tribotwin diagnose watch healthy.yaml lab/br609/curves/0??.csv");
  command->callback([a, &code] {
    check(a->output, inputs_of(*a));
    refuse_twice(a->data);
    code = or_throw(watch_curves(*a));
  });
}

void add_residuals(CLI::App& app, const std::shared_ptr<Arguments>& a, int& code) {
  auto* command = app.add_subcommand("residuals", "The same over the residuals of a shadow; exit code 3 at an alarm");
  command->add_option("CSV", a->data, "Table of tribotwin-hil shadow -o or of tribotwin predict")
      ->required()
      ->expected(1);
  a->tables.add_to(*command);
  a->tables.add_gear_ratio_to(*command);
  command->add_option("--joint", a->residuals.table.joint, "Joint, where there are several");
  command->add_option("--window", a->residuals.window_s, "Length of a window [s]; whole work cycles")
      ->check(CLI::Range(1e-3, 1e7))
      ->capture_default_str();
  command->add_option("--learn", a->residuals.learn, "Windows at the beginning that are healthy")
      ->check(CLI::Range(8, 1000000))
      ->capture_default_str();
  command
      ->add_option("--false-alarm", a->residuals.false_alarm, "False alarms per window of a healthy joint, on average")
      ->check(CLI::Range(1e-7, 0.3))
      ->capture_default_str();
  a->output.add_to(*command, "File for the verdicts (default: stdout)");
  command->add_flag("--json", a->json, "Print JSON instead of the table");
  command->add_flag("--quiet", a->quiet, "No notes on stderr");
  command->footer(
      "Example:\n  tribotwin diagnose residuals shadow.csv --joint joint2\n\nshadow.csv is written by tribotwin-hil "
      "shadow -o shadow.csv.");
  command->callback([a, &code] {
    check(a->output, paths(a->data));
    code = or_throw(watch_shadow(*a));
  });
}

}  // namespace

void add_diagnose(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand("diagnose", "Diagnose a joint from its friction at any temperature (Zhou 2024)");
  c->require_subcommand(1);
  add_learn(*c, a, code);
  add_check(*c, a, code);
  add_watch(*c, a, code);
  add_residuals(*c, a, code);
}

}  // namespace tribotwin::twin::program
