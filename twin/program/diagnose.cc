#include <algorithm>
#include <cmath>
#include <memory>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/program/program.hpp>
#include <tribotwin/twin/scenario/input.hpp>

namespace tribotwin::twin::program {
namespace {

using namespace diagnosis;
using Json = nlohmann::ordered_json;

struct Arguments {
  std::vector<std::string> data, loaded;
  std::string healthy, output;
  ObservationOptions read;
  LearnOptions learn;
  CheckOptions check;
  bool json = false, quiet = false;
};

template <class T>
Json or_null(const std::optional<T>& x) { return x ? Json(*x) : Json(nullptr); }

std::vector<ObservationFile> read(const std::vector<std::string>& files, const ObservationOptions& options, bool quiet) {
  std::vector<ObservationFile> all;
  for (const auto& file : files) {
    auto one = read_observations(file, options);
    if (!one) throw InputError(one.error());
    if (!quiet)
      for (const auto& note : one->notes) fmt::print(stderr, "note: {}\n", note);
    all.push_back(*std::move(one));
  }
  return all;
}

int learn_state(const Arguments& a) {
  const auto healthy = read(a.data, a.read, a.quiet), loaded = read(a.loaded, a.read, a.quiet);
  auto state = learn(healthy, loaded, a.read.load_sensitivity, a.learn);
  if (!state) throw InputError(state.error());
  if (state->joint.empty()) state->joint = a.read.joint;
  if (!(state->torque_max_nm > 0)) state->torque_max_nm = a.read.torque_max_nm;
  if (const int code = deliver(to_yaml(*state), a.output)) return code;
  if (a.output.empty() || a.quiet) return done;
  fmt::print(stderr, "healthy state of {} curves{}{}{}\n", state->observations, state->left_out ? fmt::format(" ({} left out)", state->left_out) : "",
             state->knows_temperature ? fmt::format(", {:.1f} to {:.1f} degC", state->temperature_low_degC, state->temperature_high_degC) : "",
             state->observations < observations_usual ? fmt::format("; {} and more, cold to hot, detect smaller changes", observations_usual) : "");
  if (!state->knows_temperature) fmt::print(stderr, "note: the curves span less than 5 K or have no temperature_degC: what temperature does is not told apart from faults\n");
  return done;
}

Json json_of(const RegionVerdict& v) {
  return {{"distance", v.distance}, {"anomalous", v.anomalous}, {"statistic", v.statistic}, {"limit", v.limit}, {"by_chance", v.by_chance}, {"beyond_two_sigma", v.beyond_two_sigma}, {"beyond_wear_threshold", v.beyond_wear}};
}

Json json_of(const Observation& o, const Verdict& v) {
  Json j{{"file", o.file}, {"curve", o.curve}, {"temperature_degC", or_null(o.temperature_degC)}, {"anomalous", v.anomalous}};
  for (std::size_t r = 0; r < regions.size(); ++r) j[regions[r].name] = json_of(v.region[r]);
  j["equivalent_load"] = v.load.load_norm;
  j["equivalent_load_sigma"] = v.load.sigma;
  j["equivalent_load_threshold"] = v.load.threshold;
  j["equivalent_load_nm"] = or_null(v.load.nm);
  j["equivalent_load_kg"] = or_null(v.load.kg);
  j["pattern"] = v.pattern;
  j["severity"] = v.severity;
  j["confidence"] = v.confidence;
  for (const auto& c : v.candidates) j["probabilities"][c.pattern ? c.pattern->name : "healthy"] = c.probability;
  for (Eigen::Index i = 0; i < feature_count; ++i) j["features"][feature_names[static_cast<std::size_t>(i)]] = o.features(i);
  for (std::size_t k = 0; k < indicator_count; ++k)
    if (v.indicators[k]) j["indicators"][indicators[k].name] = {{"value", v.indicators[k]->value}, {"limit", v.indicators[k]->limit}, {"anomalous", v.indicators[k]->anomalous}};
  j["sentence"] = v.sentence;
  return j;
}

int check_curves(const Arguments& a) {
  const HealthyState state = read_healthy(a.healthy);
  ObservationOptions options = a.read;
  options.load_sensitivity = state.load_sensitivity;
  if (!(options.torque_max_nm > 0)) options.torque_max_nm = state.torque_max_nm;
  Json j{{"healthy", a.healthy}, {"joint", state.joint}, {"false_alarm", a.check.false_alarm}, {"observations", Json::array()}};
  std::string table = fmt::format("{:<5} {:>7} {:>10} {:>10} {:>8} {:>10} {:>10} {:>8} {:>11}  {:<15} {}\n", "curve", "degC", "distance 1", "T^2 1", "limit", "distance 2", "T^2 2", "limit", "equiv. load", "pattern", "confidence"), sentences;
  bool anomalous = false;
  for (const auto& file : read(a.data, options, a.quiet)) {
    const auto verdicts = check(state, file, a.check);
    if (!verdicts) throw InputError(verdicts.error());
    for (std::size_t i = 0; i < verdicts->size(); ++i) {
      const Observation& o = file.observations[i];
      const Verdict& v = (*verdicts)[i];
      anomalous |= v.anomalous;
      j["observations"].push_back(json_of(o, v));
      table += fmt::format("{:<5} {:>7} {:>10.3f} {:>10.3f} {:>7.2f}{} {:>10.3f} {:>10.3f} {:>7.2f}{} {:>11.3f}  {:<15} {:.2f}\n", j["observations"].size(), o.temperature_degC ? fmt::format("{:.1f}", *o.temperature_degC) : "-",
                           v.region[0].distance, v.region[0].statistic, v.region[0].limit, v.region[0].anomalous ? "!" : " ", v.region[1].distance, v.region[1].statistic, v.region[1].limit, v.region[1].anomalous ? "!" : " ",
                           v.load.load_norm, v.pattern, v.confidence);
      sentences += v.sentence + "\n";
    }
  }
  if (const int code = deliver(a.json ? j.dump(2) + "\n" : table + "\n" + sentences, "")) return code;
  return anomalous ? limit_exceeded : done;
}

void add_units(CLI::App& c, Arguments& a) {
  c.add_option("--tau-max", a.read.torque_max_nm, "Largest manipulation torque [Nm], arm side, for curves in friction_norm alone")->check(CLI::Range(1e-9, 1e9));
  c.add_option("--gear-ratio", a.read.gear_ratio, "Motor turns per joint turn, for recordings")->check(CLI::Range(1e-6, 1e6));
  c.add_option("--joint", a.read.joint, "Joint of a telemetry.h5");
  c.add_flag("--quiet", a.quiet, "No notes on stderr");
}

}  // namespace

void add_diagnose(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand("diagnose", "Whether a joint is healthy, from its friction at any temperature (paper 2)");
  c->require_subcommand(1);

  auto* l = c->add_subcommand("learn", "The healthy state of a joint, from unloaded friction curves cold to hot");
  l->add_option("CURVES", a->data, "Friction curves (CSV), as of tribotwin lab; recordings or telemetry.h5")->required();
  l->add_option("--loaded", a->loaded, "Curves of the same joint with a payload, to learn what load does; may be repeated")->allow_extra_args(false);
  l->add_option("--load-sensitivity", a->read.load_sensitivity, "Relative rise of Fc and Fs per load_norm")->check(CLI::Range(0.0, 100.0))->capture_default_str();
  l->add_option("--lever", a->learn.lever_m, "Distance of a payload from the joint's axis [m], for equivalent loads in kg")->check(CLI::Range(1e-6, 1e3));
  l->add_flag("--robust", a->learn.robust, "Leave out curves far off the rest");
  l->add_option("-o,--output", a->output, "healthy.yaml to write (default: stdout)");
  add_units(*l, *a);
  l->footer("Example:\n  tribotwin lab br609_campaign -o lab/br609\n  tribotwin diagnose learn lab/br609/curves/00?.csv lab/br609/curves/01[012].csv -o healthy.yaml");
  l->callback([a, &code] { code = learn_state(*a); });

  auto* k = c->add_subcommand("check", "Verdicts on friction curves; exit code 3 where one is not healthy");
  k->add_option("HEALTHY", a->healthy, "healthy.yaml of tribotwin diagnose learn")->required();
  k->add_option("CURVES", a->data, "Friction curves (CSV), as of tribotwin lab; recordings or telemetry.h5")->required();
  k->add_option("--false-alarm", a->check.false_alarm, "Share of healthy observations that may be called anomalous, per region and indicator")->check(CLI::Range(1e-9, 0.5))->capture_default_str();
  k->add_flag("--json", a->json, "Print JSON instead of the table");
  add_units(*k, *a);
  k->footer("Example:\n  tribotwin diagnose check healthy.yaml lab/br609/curves/013.csv --json");
  k->callback([a, &code] { code = check_curves(*a); });
}

}  // namespace tribotwin::twin::program
