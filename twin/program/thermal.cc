#include <algorithm>
#include <cmath>
#include <memory>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/identification/thermal_file.hpp>
#include <tribotwin/twin/program/program.hpp>
#include <tribotwin/twin/scenario/input.hpp>

namespace tribotwin::twin::program {
namespace {

using namespace identification;
using Json = nlohmann::ordered_json;

struct Arguments {
  std::vector<std::string> data;
  std::string evaluate, output;
  std::vector<double> cycle_s;   ///< none, one for all files, or one each
  int order = 0;
  bool rested = false, json = false, quiet = false;
};

/// The joints of all files, each with the sessions of those that have it.
std::vector<JointHeat> read(const Arguments& a) {
  if (a.cycle_s.size() > 1 && a.cycle_s.size() != a.data.size()) throw InputError(fmt::format("--cycle: {} values for {} files; give one, or one for each", a.cycle_s.size(), a.data.size()));
  std::vector<JointHeat> joints;
  for (std::size_t f = 0; f < a.data.size(); ++f) {
    auto recording = read_thermal_recording(a.data[f], f, a.cycle_s.empty() ? 0 : a.cycle_s[a.cycle_s.size() == 1 ? 0 : f]);
    if (!recording) throw InputError(recording.error());
    if (!a.quiet)
      for (const auto& note : recording->notes) fmt::print(stderr, "note: {}\n", note);
    for (auto& joint : recording->joints) {
      auto at = std::ranges::find(joints, joint.name, &JointHeat::name);
      if (at == joints.end()) at = joints.insert(joints.end(), {.name = joint.name});
      std::ranges::move(joint.sessions, std::back_inserter(at->sessions));
    }
  }
  return joints;
}

bool tells_times(const ThermalFit& fit) {
  return std::ranges::none_of(fit.unidentifiable, [](const std::string& name) { return name.starts_with("t"); });
}

/// Of the order asked for; without one, of the second where these data tell both time constants, else of the first.
ThermalFit fitted(const Arguments& a, const std::string& joint, std::span<const HeatSession> sessions) {
  const auto with = [&](thermal::Order order) {
    auto fit = fit_thermal(sessions, {.order = order, .rested = a.rested});
    if (!fit) throw InputError(fmt::format("{}: {}: {}", a.data[sessions.front().file], joint, fit.error()));
    return *std::move(fit);
  };
  if (a.order == 1) return with(thermal::Order::first);
  auto second = with(thermal::Order::second);
  return a.order == 2 || tells_times(second) ? second : with(thermal::Order::first);
}

/// What has no sigma is NaN, which JSON shows as null.
Json json_of(const ThermalFit& fit) {
  Json j{{"order", fit.model.order == thermal::Order::first ? 1 : 2}};
  for (const auto& e : fit.parameters) j["parameters"][e.name] = {{"value", e.value}, {"sigma", e.sigma}, {"low", e.low}, {"high", e.high}, {"unit", e.unit}};
  for (const auto& e : fit.ambient) j["T_amb_degC"].push_back({{"value", e.value}, {"sigma", e.sigma}});
  j["rms_K"] = fit.rms_K;
  j["correlated_samples"] = fit.correlation;
  j["samples"] = fit.samples;
  j["unidentifiable"] = fit.unidentifiable;
  return j;
}

std::string rows_of(const std::string& joint, const std::string& from, const ThermalFit& fit) {
  std::string s;
  const auto row = [&](const Estimate& e, const std::string& remark) {
    s += fmt::format("{:<14} {:<7} {:>12.5g} {:>10}   {:<6}  {:<20} {}\n", joint, e.name, e.value, std::isnan(e.sigma) ? "none" : fmt::format("{:.2g}", e.sigma), e.unit, from, remark);
  };
  for (const auto& e : fit.parameters) {
    const bool blind = std::ranges::find(fit.unidentifiable, e.name) != fit.unidentifiable.end();
    row(e, !blind ? "" : e.status == Status::held ? "not identifiable from this record: no effect of the power is seen" : "not identifiable from this record");
  }
  for (const auto& e : fit.ambient) row(e, "");
  s += fmt::format("{:<14} residual {:.3g} K rms, {} samples, {:.0f} worth one independent\n", joint, fit.rms_K, fit.samples, fit.correlation);
  return s;
}

int identify(const Arguments& a) {
  const auto joints = read(a);
  std::vector<NamedThermalFit> fits;
  Json j{{"joints", Json::object()}};
  std::string table = fmt::format("{:<14} {:<7} {:>12} {:>10}   {:<6}  {}\n", "joint", "", "value", "sigma", "unit", "from");
  Progress progress(a.quiet, "identifying");
  for (const auto& joint : joints) {
    fits.emplace_back(joint.name, fitted(a, joint.name, joint.sessions));
    j["joints"][joint.name] = json_of(fits.back().second);
    table += rows_of(joint.name, joint.sessions.front().file == joint.sessions.back().file ? a.data[joint.sessions.front().file] : "all", fits.back().second);
    // File by file where there are several: how far the days agree.
    if (joint.sessions.front().file != joint.sessions.back().file)
      for (auto first = joint.sessions.begin(); first != joint.sessions.end();) {
        const auto last = std::find_if(first, joint.sessions.end(), [&](const HeatSession& s) { return s.file != first->file; });
        const auto fit = fitted(a, joint.name, {first, last});
        j["joints"][joint.name]["files"][a.data[first->file]] = json_of(fit);
        table += rows_of(joint.name, a.data[first->file], fit);
        first = last;
      }
    progress(static_cast<double>(fits.size()) / static_cast<double>(joints.size()));
  }
  if (!a.output.empty())
    if (const int code = deliver(to_yaml(fits, a.data), a.output)) return code;
  return deliver(a.json ? j.dump(2) + "\n" : table, "");
}

/// Each session from its first temperature alone.
int evaluate(const Arguments& a) {
  const auto models = read_thermal(a.evaluate);
  const auto joints = read(a);
  Json j{{"joints", Json::object()}};
  std::string table = fmt::format("{:<14} {:>12} {:>12} {:>12} {:>10}   {}\n", "joint", "error rms K", "largest K", "from degC", "samples", "session");
  double worst = 0;
  for (const auto& joint : joints) {
    const auto model = std::ranges::find(models, joint.name, [](const auto& m) { return m.first; });
    if (model == models.end()) throw InputError(fmt::format("{}: joints: has no '{}', of which {} has a temperature", a.evaluate, joint.name, a.data[joint.sessions.front().file]));
    for (const auto& session : joint.sessions) {
      const auto predicted = predicted_temperature(model->second, session);
      double squares = 0, largest = 0;
      for (std::size_t i = 0; i < predicted.size(); ++i) {
        const double error = predicted[i] - session.temperature_degC[i];
        squares += error * error;
        largest = std::max(largest, std::abs(error));
      }
      const double rms = std::sqrt(squares / static_cast<double>(predicted.size()));
      worst = std::max(worst, rms);
      j["joints"][joint.name].push_back({{"file", a.data[session.file]}, {"from_s", session.time_s.front()}, {"rms_K", rms}, {"largest_K", largest}, {"samples", predicted.size()}});
      table += fmt::format("{:<14} {:>12.3f} {:>12.3f} {:>12.2f} {:>10}   {} from {:.6g} s\n", joint.name, rms, largest, session.temperature_degC.front(), predicted.size(), a.data[session.file], session.time_s.front());
    }
  }
  j["worst_rms_K"] = worst;
  return deliver(a.json ? j.dump(2) + "\n" : table, "");
}

}  // namespace

void add_thermal(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand("thermal", "How joints warm up: thermal models from recorded heat and temperature");
  c->add_option("DATA", a->data, "CSV: time_s, temperature_JOINT_degC, and power_w_JOINT or torque_JOINT_nm with velocity_JOINT_rad_s or position_JOINT_rad")->required();
  auto* order = c->add_option("--order", a->order, "Of the model (default: 2 where both time constants can be told, else 1)")->check(CLI::IsMember({1, 2}));
  c->add_option("--cycle", a->cycle_s, "Length of the working cycle [s], for heat from torque and motion: one, or one for each file as A,B")->delimiter(',')->check(CLI::Range(1e-3, 3600.0));
  auto* rested = c->add_flag("--rested", a->rested, "Every file begins at ambient temperature, as after a night");
  auto* output = c->add_option("-o,--output", a->output, "PARAMS.yaml to write");
  c->add_option("--evaluate", a->evaluate, "PARAMS.yaml of an earlier call: how well it predicts these data from their first temperatures")->excludes(order)->excludes(rested)->excludes(output);
  c->add_flag("--json", a->json, "Print JSON instead of the table");
  c->add_flag("--quiet", a->quiet, "No progress, no notes");
  c->footer("Example:\n  tribotwin thermal monday.csv tuesday.csv -o thermal.yaml");
  c->callback([a, &code] { code = a->evaluate.empty() ? identify(*a) : evaluate(*a); });
}

}  // namespace tribotwin::twin::program
