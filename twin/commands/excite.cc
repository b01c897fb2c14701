#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/identification/experiment_design/experiment_design.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/excitation.hpp>

namespace tribotwin::twin::program {
namespace {

using namespace identification;
using Json = nlohmann::ordered_json;
using Eigen::Index;

struct Arguments {
  std::string model, friction, params;
  std::vector<std::string> given, noise, coupling;
  TableArguments tables;
  Destination output;
  ExcitationOptions options;
  double rate_hz = 250, heating_min = 3;
  bool json = false, quiet = false, inertia_only = false;

  bool for_friction() const { return !friction.empty() || !params.empty() || !given.empty() || !noise.empty(); }
};

/// What is known before the motion, and where it lies.
struct Known {
  std::optional<DynamicsFile> file;
  std::optional<JointMotion> recorded;
  DesignInput input;
};

std::vector<std::optional<double>> noise_of(const Arguments& a, const Regressor& regressor) {
  const PerJoint noise = or_wrong_input(PerJoint::of("--noise", a.noise));
  std::vector<std::optional<double>> out;
  std::vector<std::string> names;
  for (Index j = 0; j < regressor.joints(); ++j) {
    names.push_back(regressor.joint_name(j));
    out.push_back(noise.find(names.back()));
  }
  for (const auto& entry : noise.named())
    if (std::ranges::find(names, entry.first) == names.end())
      throw InputError(
          fmt::format("--noise: {} has no joint '{}'; its joints are {}", a.model, entry.first, joined(names)));
  return out;
}

/// In one place: `input` points to the rest.
std::unique_ptr<Known> known_of(const Arguments& a, const Robot& robot) {
  if (!a.given.empty() && !a.params.empty())
    throw InputError("--given and --params: give one; parameters may come from the same recordings, and count twice");
  auto out = std::make_unique<Known>();
  if (!a.friction.empty()) out->input.law = or_wrong_input(dynamics_law(a.friction, "--friction"));
  out->input.noise = noise_of(a, robot.regressor);
  if (!a.params.empty()) {
    out->file = or_wrong_input(read_dynamics(a.params, robot.regressor, robot.base));
    out->input.known = &*out->file;
  }
  if (!a.given.empty()) {
    out->recorded = read_motion(robot, a.given, {.still_joints = true}, a.tables, a.quiet);
    out->input.recorded = &*out->recorded;
  }
  if (!out->input.law) out->input.law = out->file ? out->file->law : &coulomb_viscous();
  return out;
}

/// "0.8 %" of the value; in the parameter's unit where that may be 0.
std::string words_of(const DesignParameter& p, double sigma) {
  if (std::isinf(sigma)) return "-";
  return p.scale != std::abs(p.value) ? fmt::format("{:.2g}", sigma * p.scale) : fmt::format("{:.2g} %", 100 * sigma);
}

/// Names of the friction parameters whose interval is wider than they are.
std::vector<std::string> poorly_told(const ExperimentDesign& d, const Eigen::VectorXd& sigmas) {
  std::vector<std::string> out;
  for (Index c = 0; c < sigmas.size(); ++c)
    if (const auto& p = d.parameters[static_cast<std::size_t>(c)];
        p.rotor >= 0 && !ExperimentDesign::is_told(sigmas(c)))
      out.push_back(p.name);
  return out;
}

int told_base(const ExperimentDesign& d, const Eigen::VectorXd& sigmas) {
  int out = 0;
  for (Index c = 0; c < sigmas.size(); ++c)
    out += d.parameters[static_cast<std::size_t>(c)].rotor < 0 && ExperimentDesign::is_told(sigmas(c));
  return out;
}

std::string words_of(const WarmUp& w, const Robot& robot, double motion_s) {
  const std::string twice = "this law needs two temperatures: record the motion cold, warm the robot up, record again";
  if (!w.lacking.empty())
    return fmt::format("{}, warmer by 15 K or more ({}: how long that takes is not known); sigmas are those of both\n",
                       twice, w.lacking);
  std::string text = fmt::format("{}; by the thermal models repeat the motion {:.0f} times ({:.0f} min), to", twice,
                                 std::ceil(w.duration_s / motion_s), w.duration_s / 60);
  for (Index j = 0; j < w.warm_degC.size(); ++j)
    text += fmt::format(" {}={:.1f}", robot.regressor.joint_name(j), w.warm_degC(j));
  return text + " degC; sigmas are those of both\n";
}

/// "joint1 -0.3 .. 0.2": what a law of load is identified on.
std::string loads_of(const ExperimentDesign& d, const Robot& robot) {
  std::string text;
  for (std::size_t r = 0; r < d.loads.size(); ++r)
    text += fmt::format("{}{} {:.2g} .. {:.2g}", r == 0 ? "loads of the motion, gear torque over torque_max: " : ", ",
                        robot.regressor.rotor_name(static_cast<Index>(r)), d.loads[r].first, d.loads[r].second);
  return text.empty() ? text : text + "; a payload reaches others\n";
}

std::string text_of(const ExperimentDesign& d, const Known& known, const Robot& robot) {
  constexpr auto right = TextTable::right;
  TextTable table{{TextTable::left("friction"), right("about"), right("sigma before"), right("after")}};
  for (Index c = 0; c < d.after.size(); ++c)
    if (const auto& p = d.parameters[static_cast<std::size_t>(c)]; p.rotor >= 0)
      table.add({p.name, fmt::format("{:.4g}", p.value), words_of(p, d.before(c)), words_of(p, d.after(c))});
  std::string text = fmt::format("\nfriction {}, noise {}:", known.input.law->name, d.noise_source);
  for (Index j = 0; j < d.noise.size(); ++j)
    text += fmt::format(" {}={:.3g}", robot.regressor.joint_name(j), d.noise(j));
  text += fmt::format(" (torques below {:g} Hz)\n{}", d.cutoff_hz, table.text());
  text += loads_of(d, robot);
  const auto before = poorly_told(d, d.before), after = poorly_told(d, d.after);
  text += fmt::format("base parameters with a sigma below a quarter of their size: {} of {} before, {} after\n",
                      told_base(d, d.before), robot.base.size(), told_base(d, d.after));
  const auto names = [&](const std::vector<std::string>& all) {
    return all.empty()                                                                       ? "none"
           : all.size() + static_cast<std::size_t>(robot.base.size()) == d.parameters.size() ? "all"
                                                                                             : joined(all);
  };
  text += fmt::format("poorly known before: {}\npoorly known after: {}\n", names(before), names(after));
  if (d.warm_up) text += words_of(*d.warm_up, robot, d.motion.duration_s());
  return text;
}

Json json_of(const ExperimentDesign& d, const Known& known, const Robot& robot) {
  const auto number = [](double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); };
  Json j{{"law", known.input.law->name}, {"cutoff_hz", d.cutoff_hz}, {"noise_source", d.noise_source}};
  for (Index k = 0; k < d.noise.size(); ++k) j["noise"][robot.regressor.joint_name(k)] = d.noise(k);
  for (Index c = 0; c < d.after.size(); ++c) {
    const auto& p = d.parameters[static_cast<std::size_t>(c)];
    j[p.rotor < 0 ? "base_parameters" : "parameters"][p.name] = {{"about", p.value},
                                                                 {"sigma_before", number(p.scale * d.before(c))},
                                                                 {"sigma_after", number(p.scale * d.after(c))}};
  }
  for (std::size_t r = 0; r < d.loads.size(); ++r)
    j["loads"][robot.regressor.rotor_name(static_cast<Index>(r))] = {d.loads[r].first, d.loads[r].second};
  j["poorly_known"] = {{"before", poorly_told(d, d.before)}, {"after", poorly_told(d, d.after)}};
  j["base_parameters_known"] = {{"before", told_base(d, d.before)}, {"after", told_base(d, d.after)}};
  if (!d.warm_up) return j;
  const WarmUp& w = *d.warm_up;
  j["warm_up"] = {{"duration_s", w.lacking.empty() ? Json(w.duration_s) : Json(nullptr)}, {"lacking", w.lacking}};
  for (Index k = 0; k < w.warm_degC.size(); ++k)
    j["warm_up"]["temperature_degC"][robot.regressor.joint_name(k)] = {{"cold", w.cold_degC(k)},
                                                                       {"warm", w.warm_degC(k)}};
  return j;
}

/// The sections of a motion.
std::string text_of(const Arguments& a, const Excitation& motion, const Robot& robot) {
  std::string text = fmt::format("condition number {:.1f} (the first tried: {:.3g}), {} base parameters\n",
                                 motion.condition_number, motion.first_condition_number, robot.base.size());
  text += fmt::format("section 1, inertia: 0 .. {:.1f} s\n", motion.inertia_s);
  if (a.inertia_only) return text;
  text +=
      fmt::format("section 2, friction {}: .. {:.1f} s, {}", a.for_friction() ? "by chosen passes" : "joint by joint",
                  motion.friction_s, a.for_friction() ? "from and to" : "the others at");
  for (Index k = 0; k < motion.pose.size(); ++k)
    text += fmt::format(" {}={:.3g}", robot.regressor.joint_name(k), motion.pose(k));
  return text + fmt::format("\nsection 3, heating: .. {:.1f} s\n", motion.duration_s());
}

Json json_of(const Arguments& a, const Excitation& motion, const Robot& robot) {
  Json j{{"condition_number", motion.condition_number},
         {"first_condition_number", motion.first_condition_number},
         {"base_parameters", robot.base.size()},
         {"duration_s", motion.duration_s()},
         {"sections_s", {motion.inertia_s, motion.friction_s, motion.duration_s()}},
         {"interrupted", motion.interrupted}};
  for (Index k = 0; k < motion.pose.size() && !a.inertia_only; ++k)
    j["pose"][robot.regressor.joint_name(k)] = motion.pose(k);
  return j;
}

/// The motion, with the search's progress on the terminal; a design for friction where something is `known` of it.
Result<ExperimentDesign> searched(const Arguments& a, const Robot& robot, const Known* known) {
  ExcitationOptions o = a.options;
  o.heating_s = a.inertia_only ? 0 : 60 * a.heating_min;
  o.friction = !a.inertia_only;
  o.stop = &interrupted();
  Progress progress(a.quiet, "searching");
  progress(0, -1);  // the law is fitted first
  const auto started = std::chrono::steady_clock::now();
  o.progress = [&](double share) {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    progress(share, share > 0.01 ? seconds * (1 / share - 1) : -1);
  };
  if (known) return design_experiment(*robot.model, robot.regressor, robot.base, known->input, o);
  auto motion = excite(*robot.model, robot.regressor, robot.base, o);
  if (!motion) return tl::unexpected(motion.error());
  return ExperimentDesign{.motion = std::move(*motion)};
}

/// With the coupled motors of --params, of --coupling, or of the model's tendons.
Robot loaded(const Arguments& a) {
  if (a.params.empty()) return coupled_robot(a.model, a.coupling, a.quiet);
  if (!a.coupling.empty())
    throw InputError("--coupling and --params: give one; the parameters say which motors turn with several joints");
  Robot robot = load_robot(a.model);
  auto motors = or_wrong_input(read_coupling(a.params, robot.regressor));
  return motors.empty() ? robot : with_motors(robot, std::move(motors), a.params + ": coupling");
}

Result<Exit> execute(const Arguments& a) {
  const Robot robot = loaded(a);
  const auto known = a.for_friction() ? known_of(a, robot) : nullptr;
  catch_interrupts();
  const auto found = searched(a, robot, known.get());
  if (!found) return work_failed(fmt::format("{}: {}", a.model, found.error().message));
  const Excitation& motion = found->motion;
  for (const auto* notes : {&found->notes, &motion.notes})
    for (const auto& text : *notes)
      if (!a.quiet) note("{}", text);
  if (a.output.named())
    if (auto ok = deliver(to_csv(motion, robot.regressor, a.rate_hz), a.output); !ok) return ok;
  Json j = json_of(a, motion, robot);
  if (known) j["friction"] = json_of(*found, *known, robot);
  const std::string text = text_of(a, motion, robot) + (known ? text_of(*found, *known, robot) : "");
  if (auto ok = deliver(a.json ? dump_json(j, 2) + "\n" : text); !ok) return ok;
  if (!motion.interrupted) return done;
  return work_failed(
      fmt::format("interrupted; the best motion so far is complete{}", a.output.named() ? " in " + a.output.file : ""));
}

}  // namespace

void add_excite(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand(
      "excite", "Design a motion that identifies a robot's dynamics: inertia, friction joint by joint, heating");
  c->add_option("MODEL", a->model, "MJCF model")->required();
  a->output.add_to(*c, "CSV of set points to write: time_s, section, position_JOINT_rad, velocity_JOINT_rad_s");
  c->add_option("--friction", a->friction,
                "Design for the friction of the joints too: coulomb_viscous, stribeck, polynomial or another law of "
                "dynamics (default: inertia by condition number, friction joint by joint)");
  c->add_option(
      "--given", a->given,
      "Recordings that there are already, tables as for dynamics, behind MODEL: the motion adds what they lack");
  c->add_option(
       "--coupling", a->coupling,
       "JOINT=SUM: the motor of JOINT turns with a sum of joints, as in dynamics; may be repeated; none leaves "
       "out what the model's tendons say")
      ->allow_extra_args(false);
  c->add_option("--params", a->params, "PARAMS.yaml of dynamics instead: its sigmas, its noise, its law");
  c->add_option(
       "--noise", a->noise,
       "[JOINT=]NM: standard deviation of the filtered torque [Nm; N]; may be repeated (default: of --given or "
       "--params, else 1 % of the torque)")
      ->allow_extra_args(false);
  a->tables.add_to(*c);
  a->tables.add_gear_ratio_to(*c);
  c->add_option("--share", a->options.share, "Share of the speeds and torques that the model allows")
      ->check(CLI::Range(0.01, 1.0))
      ->capture_default_str();
  c->add_option("--period", a->options.period_s, "Period of the Fourier series [s]")
      ->check(CLI::Range(1.0, 1000.0))
      ->capture_default_str();
  c->add_option("--harmonics", a->options.harmonics, "Harmonics of the Fourier series")
      ->check(CLI::Range(2, 20))
      ->capture_default_str();
  c->add_option("--periods", a->options.periods, "Repetitions of the series")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  c->add_option("--heating", a->heating_min, "Length of the third section [min]")
      ->check(CLI::Range(0.0, 600.0))
      ->capture_default_str();
  c->add_flag("--inertia-only", a->inertia_only, "Only the first section");
  c->add_option("--evaluations", a->options.evaluations, "Number of motions to evaluate")
      ->check(CLI::Range(10, 10000000))
      ->capture_default_str();
  c->add_option("--seed", a->options.seed, "Seed of the search")->capture_default_str();
  c->add_option("--sampling,--rate", a->rate_hz, "Sampling rate of the set points [Hz]")
      ->check(CLI::Range(1.0, 100000.0))
      ->capture_default_str();
  c->add_flag("--json", a->json, "Print JSON instead of text");
  c->add_flag("--quiet", a->quiet, "No progress, no notes");
  c->footer(
      "Example:\n  tribotwin excite mjcf/er3a_c60.xml -o motion.csv\n  tribotwin excite mjcf/er3a_c60.xml --friction "
      "stribeck -o motion.csv");
  c->callback([a, &code] {
    auto inputs = paths(a->given);
    inputs.insert(inputs.end(), {a->model, a->params});
    check(a->output, inputs);
    code = or_throw(execute(*a));
  });
}

}  // namespace tribotwin::twin::program
