#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <memory>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/identification/drive_gains/report.hpp>
#include <tribotwin/twin/identification/dynamics_choice/dynamics_choice.hpp>
#include <tribotwin/twin/identification/dynamics_choice/repetitions.hpp>
#include <tribotwin/twin/identification/dynamics_choice/torque_lag.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/identification/rigid_body/model_agreement.hpp>
#include <tribotwin/twin/identification/rigid_body/temperature_estimator.hpp>
#include <tribotwin/twin/identification/thermal/thermal_file.hpp>
#include <tribotwin/twin/identification/verdict/friction_lacking.hpp>
#include <tribotwin/twin/identification/verdict/lag_of_files.hpp>
#include <tribotwin/twin/identification/verdict/negative_values.hpp>
#include <tribotwin/twin/identification/verdict/report.hpp>
#include <tribotwin/twin/identification/verdict/torque_band.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/coupling/coupling.hpp>

namespace tribotwin::twin::program {
namespace {

using namespace identification;
using Json = nlohmann::ordered_json;
using Eigen::Index;

struct Arguments {
  std::string model, friction = "auto", thermal, robust = "auto";
  Destination output;
  TableArguments tables;
  std::vector<std::string> data, coupling, payloads, position_torque;
  std::vector<std::string> lag;  // empty: none, or what --friction auto finds
  Preparation preparation;
  unsigned threads = threads_of(0);
  std::optional<double> prior_percent;
  bool no_rotor_inertia = false, json = false, quiet = false, essential = false, unweighted = false, no_offset = false,
       asymmetry = false, drive_gains = false, iv = false;
};

std::vector<thermal::Model> thermal_models(const std::string& file, const Regressor& regressor) {
  const auto named = or_wrong_input(read_thermal(file));
  std::vector<thermal::Model> models;
  for (Index j = 0; j < regressor.joints(); ++j) {
    const auto found = std::ranges::find(named, regressor.joint_name(j), &NamedThermalModel::joint);
    if (found == named.end())
      throw InputError(fmt::format("{}: joints: has no '{}', which the model has", file, regressor.joint_name(j)));
    models.push_back(found->model);
  }
  return models;
}

Json number(double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); }

/// Nothing of a joint that was left out. Coupled motors come after the joints.
std::span<const Estimate> known_friction(const DynamicsFit& fit, std::size_t rotor) {
  if (rotor < fit.joints.size() && fit.joints[rotor].samples == 0) return {};
  return fit.friction[rotor];
}

/// What is known of the fit, and what is not.
struct Judgement {
  std::vector<JointVerdict> joints;
  std::vector<Lacking> lacking;  ///< of friction
  std::vector<JointRange> ranges;
  std::vector<Negative> negative;
  std::vector<FileLag> lags;  ///< of several files
};

Judgement judged(const Robot& robot, const RobotFriction& friction, const JointMotion& motion, const DynamicsFit& fit,
                 bool with_temperature, unsigned threads) {
  const Eigen::MatrixXd load = gear_load(robot.regressor, robot.base, fit.parameters.base, motion, threads);
  std::vector<JointRange> ranges = ranges_of(motion, load, with_temperature);
  std::vector<Negative> negative = negative_values(robot.regressor, friction, fit, ranges);
  const Eigen::MatrixXd predicted =
      predicted_torque(robot.regressor, robot.base, friction, fit.parameters, motion, threads);
  const bool several = motion.file.back() > 0;
  return {judge_joints(robot.regressor, motion, predicted, load),
          lacking_friction(robot.regressor, friction, motion, load, fit), std::move(ranges), std::move(negative),
          several ? lag_of_files(robot.regressor, motion, predicted) : std::vector<FileLag>{}};
}

Json json_of(std::span<const Negative> negative) {
  Json all = Json::array();
  for (const Negative& n : negative)
    all.push_back({{"parameter", n.parameter},
                   {"what", n.what},
                   {"value", n.value},
                   {"sigma", number(n.sigma)},
                   {"unit", n.unit},
                   {"significant", n.significant()}});
  return all;
}

/// Whether predict's parameters are those of least squares, and what it costs if not.
Json json_of(const Robot& robot, const ConsistentDynamics& dynamics) {
  Json j{{"same", dynamics.same}, {"predict_worse", dynamics.predict_worse}, {"residual_growth", Json::object()}};
  for (Index k = 0; k < dynamics.growth.size(); ++k)
    j["residual_growth"][robot.regressor.joint_name(k)] = number(dynamics.growth(k));
  return j;
}

Json json_of(const Robot& robot, const DynamicsFit& fit, const Consistency& consistency, const Judgement& judgement) {
  Json j;
  const Eigen::VectorXd of_model = robot.base.from_all * robot.regressor.model_parameters();
  for (std::size_t k = 0; k < fit.base.size(); ++k) {
    const Estimate& e = fit.base[k];
    j["base_parameters"][e.name] = {{"value", number(e.value)},
                                    {"sigma", number(e.sigma)},
                                    {"unit", e.unit},
                                    {"of_model", of_model(static_cast<Eigen::Index>(k))},
                                    {"group", robot.base.parameters[k].group}};
  }
  for (std::size_t r = 0; r < fit.friction.size(); ++r)
    for (const Estimate& e : known_friction(fit, r))
      j["friction"][robot.regressor.rotor_name(static_cast<Index>(r))][e.name] = {
          {"value", number(e.value)}, {"sigma", number(e.sigma)}, {"unit", e.unit}};
  for (const CoupledMotor& motor : robot.regressor.motors()) {
    Json& turns = j["coupling"][motor.name] = {{"joint", robot.regressor.joint_name(motor.joint)}};
    for (Index k = 0; k < motor.turns_with.size(); ++k)
      if (motor.turns_with(k) != 0) turns["turns_with"][robot.regressor.joint_name(k)] = motor.turns_with(k);
  }
  for (std::size_t i = 0; i < fit.joints.size(); ++i) {
    j["joints"][fit.joints[i].name] = {{"relative_error", number(fit.joints[i].relative_error)},
                                       {"noise", number(fit.joints[i].noise)},
                                       {"correlated_samples", number(fit.joints[i].correlation)},
                                       {"samples", fit.joints[i].samples},
                                       {"verdict", json_of(judgement.joints[i])}};
  }
  const BaseCount count = count_base(fit);
  j["base_parameter_count"] = {{"estimated", count.estimated}, {"wide_interval", count.wide}, {"held", count.held}};
  j["unidentifiable"] = withheld(judgement.lacking);
  j["lacking"] = json_of(judgement.lacking);
  j["relative_error"] = number(fit.relative_error);
  j["condition_number"] = number(fit.condition_number);
  j["between_files"] = number(fit.between_files);
  j["physically_possible"] = consistency.possible;
  j["distance_sigma"] = number(consistency.distance_sigma);
  j["chance"] = number(consistency.chance);
  j["negative"] = json_of(judgement.negative);
  j["bodies_judged"] = badly_explained(judgement.joints).empty();
  j["estimator"] = estimator_of(fit);
  j["notes"] = fit.notes;
  return j;
}

std::vector<std::string> row_of(const Estimate& e, const std::string& name) {
  return {fmt::format("{:.5g}", e.value), std::isnan(e.sigma) ? "held" : fmt::format("{:.2g}", e.sigma), e.unit, name};
}

TextTable estimates(const char* what) {
  return TextTable{
      {TextTable::right("value"), TextTable::right("sigma"), TextTable::left("unit"), TextTable::left(what)}};
}

std::string quality_of(const Robot& robot, std::span<const JointResult> joints) {
  constexpr auto right = TextTable::right;
  TextTable table{{TextTable::left("joint"), right("relative error"), right("residual std"), TextTable::left(),
                   right("samples"), right("per independent one")}};
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (joints[j].samples == 0) {
      table.add({joints[j].name, "left out", "-", "", "0", "-"});
      continue;
    }
    table.add({joints[j].name, fmt::format("{:.2f} %", 100 * joints[j].relative_error),
               fmt::format("{:.4g}", joints[j].noise),
               unit_of("Nm", robot.regressor.is_slide(static_cast<Eigen::Index>(j))),
               fmt::format("{}", joints[j].samples), fmt::format("{:.1f}", joints[j].correlation)});
  }
  return table.text();
}

/// Whether real bodies can have the base parameters; sigmas that count a joint's misfit would allow almost any.
std::string bodies_of(const Consistency& consistency, const std::vector<std::string>& badly) {
  if (!badly.empty())
    return fmt::format(
        "whether real bodies have these base parameters cannot be said while {} {} badly explained: the nearest "
        "possible ones are {:.2f} sigma away, and sigmas count what is not explained\n",
        joined(badly), badly.size() > 1 ? "are" : "is", consistency.distance_sigma);
  return fmt::format("{} bodies have these base parameters: the nearest possible ones are {:.2f} sigma away\n",
                     consistency.possible ? "within the noise, real" : "no real", consistency.distance_sigma);
}

/// Empty where none was looked for.
std::string table_of(std::span<const Estimate> lag) {
  if (lag.empty()) return {};
  TextTable table = estimates("lag of the torque behind the position");
  for (const Estimate& e : lag) table.add(row_of(e, e.name));
  return table.text() + "\n";
}

/// What predict takes.
std::string prediction_of(const ConsistentDynamics& dynamics, bool contradicted, bool instrumental) {
  if (dynamics.same) return {};
  double largest = 1;
  for (const double growth : dynamics.growth)
    if (growth > largest) largest = growth;
  return fmt::format(
      "residuals of the real bodies with the smallest sum of squares are up to {:.4g} times as large; {}\n", largest,
      contradicted || dynamics.predict_worse
          ? fmt::format("predict takes those of {}, as {}", instrumental ? "instrumental variables" : "least squares",
                        contradicted ? "the data contradict every real one beyond doubt"
                                     : "real ones predict worse what they have not seen")
          : "predict takes these bodies");
}

std::string table_of(const Robot& robot, const DynamicsFit& fit, const Consistency& consistency,
                     const Judgement& judgement, const ConsistentDynamics& consistent) {
  TextTable base = estimates("base parameter"), friction = estimates("friction");
  for (std::size_t k = 0; k < fit.base.size(); ++k) base.add(row_of(fit.base[k], robot.base.parameters[k].group));
  for (std::size_t r = 0; r < fit.friction.size(); ++r)
    for (const Estimate& e : known_friction(fit, r))
      friction.add(row_of(e, robot.regressor.rotor_name(static_cast<Index>(r)) + "." + e.name));
  std::string s = base.text() + "\n" + friction.text() + "\n" + quality_of(robot, fit.joints);
  s += fmt::format("\nrelative error {:.3f} %, condition number {:.0f}\n", 100 * fit.relative_error,
                   fit.condition_number);
  if (fit.instrumental) s += "estimates are those of instrumental variables\n";
  if (fit.between_files > 1)
    s += fmt::format("estimates vary {:.2g} times as much between files as within them; sigmas contain it\n",
                     fit.between_files);
  s += bodies_of(consistency, badly_explained(judgement.joints));
  s += prediction_of(consistent, contradicted(consistency.distance_sigma, robot.base.size()), fit.instrumental);
  const BaseCount count = count_base(fit);
  if (count.wide + count.held > 0)
    s += fmt::format("{} of {} base parameters have a 95 % interval wider than their value; {} held\n", count.wide,
                     count.estimated, count.held);
  for (const auto& line : lines_of(judgement.lacking)) s += line + "\n";
  return s + "\n" + table_of(judgement.joints);
}

std::string words_of(const Setting& s) {
  std::string text = fmt::format("friction {}", s.law->name);
  if (s.directional.offset) text += ", offset";
  if (s.directional.asymmetry) text += ", asymmetry";
  if (!s.by_position.empty()) text += fmt::format(", torque by position of {}", joined(s.by_position));
  if (s.signals.cutoff_hz > 0) text += fmt::format(", cut-off {:.3g} Hz", s.signals.cutoff_hz);
  if (s.signals.recorded_velocity) text += ", recorded velocity";
  if (s.signals.reversals) text += ", reversals";
  if (s.signals.turn_lead_s != 0) text += ", " + turn_text(s.signals.turn_lead_s);
  if (s.robust != Robust::none) text += fmt::format(", {}", name_of(s.robust));
  if (!s.rotor_inertia) text += ", no rotor inertias";
  for (const CoupledMotor& motor : s.motors) text += fmt::format(", {} coupled", motor.name);
  if (s.prior > 0) text += fmt::format(", prior of {:g} % about the model", 100 * s.prior);
  return text;
}

/// What was tried, and what it did to the error of samples that the fit had not seen. Empty where nothing was tried.
std::string table_of(const DynamicsChoice& choice) {
  if (choice.trials.empty()) return {};
  TextTable table{{TextTable::left("tried"), TextTable::right("held-out error"), TextTable::right("+-"),
                   TextTable::left("verdict")}};
  for (const Trial& t : choice.trials)
    if (t.failure.empty())
      table.add({t.what, &t == &choice.trials.front() ? "start" : fmt::format("{:+.2f} %", 100 * t.change),
                 &t == &choice.trials.front() ? "" : fmt::format("{:.2f} %", 100 * t.sigma),
                 t.taken            ? "taken"
                 : t.remark.empty() ? "no"
                                    : "no: " + t.remark});
    else
      table.add({t.what, "-", "", t.failure});
  return table.text() +
         fmt::format(
             "chosen: {}; errors are those of {} {}, against torque up to {:.3g} Hz{}\n\n", words_of(choice.setting),
             choice.folds, choice.by_file ? "files, each left out in turn" : "stretches of time left out in turn",
             choice.target_hz,
             choice.lag_target_hz > 0 ? fmt::format(" and, with the lag, up to {:.3g} Hz", choice.lag_target_hz) : "");
}

Json json_of(const DynamicsChoice& choice) {
  const Setting& s = choice.setting;
  Json j{{"friction", s.law->name},
         {"offset", s.directional.offset},
         {"asymmetry", s.directional.asymmetry},
         {"by_position", s.by_position},
         {"cutoff_hz", s.signals.cutoff_hz},
         {"recorded_velocity", s.signals.recorded_velocity},
         {"reversals", s.signals.reversals},
         {"turn_lead_s", s.signals.turn_lead_s},
         {"robust", name_of(s.robust)},
         {"rotor_inertia", s.rotor_inertia},
         {"prior", s.prior},
         {"trials", Json::array()}};
  for (const Trial& t : choice.trials)
    j["trials"].push_back({{"what", t.what},
                           {"change", number(t.change)},
                           {"sigma", number(t.sigma)},
                           {"taken", t.taken},
                           {"failure", t.failure},
                           {"remark", t.remark}});
  return j;
}

constexpr double unexplained_error = 0.7;

/// Joints whose torque the motion does not explain.
std::vector<Index> unexplained(const DynamicsFit& fit, double error = unexplained_error) {
  std::vector<Index> out;
  for (std::size_t j = 0; j < fit.joints.size(); ++j)
    if (fit.joints[j].relative_error > error) out.push_back(static_cast<Index>(j));
  return out;
}

/// Refuses fits that contradict the names of the columns.
void doubt(const Arguments& a, const Robot& robot, const DynamicsFit& fit, const std::vector<Index>& weak) {
  const auto where = fmt::format("{}{}", a.data.front(), a.data.size() > 1 ? " and others" : "");
  for (std::size_t j = 0; j < fit.joints.size(); ++j) {
    const auto& joint = fit.joints[j];
    const char* unit = robot.regressor.is_slide(static_cast<Eigen::Index>(j)) ? "n" : "nm";
    const bool is_weak = std::ranges::find(weak, static_cast<Index>(j)) != weak.end();
    if (joint.relative_error > unexplained_error && !is_weak)
      throw InputError(fmt::format(
          "{}: motion explains only {:.0f} % of torque_{}_{}; is it the torque of another joint, another "
          "column, another robot, late, or that of a motor that turns with two joints (--coupling)?{}",
          where, 100 * std::max(0.0, 1 - joint.relative_error), joint.name, unit,
          fit.instrumental ? " Or are accelerations too noisy, which --iv does not smooth? Lower --cutoff" : ""));
    const Estimate& level = fit.friction[j].front();  // Coulomb friction, or what is left of it at speed 0
    // Beside a coupled motor's friction a joint's own is what is left of it: any sign.
    const bool coupled = std::ranges::any_of(robot.regressor.motors(), [&](const CoupledMotor& motor) {
      return motor.turns_with(static_cast<Index>(j)) != 0;
    });
    if (level.name == "Fc" && level.value < -5 * level.sigma && !coupled && !is_weak)
      throw InputError(fmt::format(
          "{}: friction of {} would drive its motion ({} = {:.3g} {}); torque_{}_{} or its position has the wrong sign",
          where, joint.name, level.name, level.value, level.unit, joint.name, unit));
  }
}

/// Refuses torques that all have the wrong sign: friction of all joints together would drive their motion. Short
/// recordings leave that uncertain joint by joint; where gravity says so too, less is proof. Else what gravity and
/// friction say are notes.
void doubt_signs(const Arguments& a, const Robot& robot, const RobotFriction& friction, const JointMotion& motion,
                 DynamicsFit& fit) {
  constexpr double proven = -5, significant = -2;
  DoubtfulGravity gravity = doubtful_gravity(robot.regressor, motion);
  const double sigmas = pooled_friction(robot.regressor, friction, fit);
  const auto drives = fmt::format("friction of all joints together would drive their motion ({:.1f} sigma)", sigmas);
  if (sigmas < proven || (sigmas < significant && gravity.opposite))
    throw InputError(
        fmt::format("{}{}: {}{}: all torques have the wrong sign, or all positions; --columns maps them with sign: -1",
                    a.data.front(), a.data.size() > 1 ? " and others" : "", drives,
                    gravity.opposite ? ", and the torques follow the model's gravity with the other sign" : ""));
  if (sigmas < significant)
    fit.notes.push_back(drives + ": are the torques late, do they have the wrong sign, or are the joints slow?");
  std::ranges::move(gravity.findings, std::back_inserter(fit.notes));
}

Robust robust_of(const std::string& name) {
  for (const Robust robust : {Robust::huber, Robust::tukey})
    if (name == name_of(robust)) return robust;
  return Robust::none;
}

/// --position-torque: joints; none. Nothing where the option is not given.
std::vector<std::string> by_position(const Arguments& a, const Regressor& regressor) {
  if (a.position_torque == std::vector<std::string>{"none"}) return {};
  for (const std::string& name : a.position_torque) {
    Index r = 0;
    while (r < regressor.rotors() && (regressor.rotor_name(r) != name || !may_depend_on_position(regressor, r))) ++r;
    if (r == regressor.rotors())
      throw InputError(fmt::format("--position-torque: '{}' is no hinge of the model; name hinges, or none", name));
  }
  return a.position_torque;
}

Setting setting_of(const Arguments& a, const Regressor& regressor, const friction::LawInfo& law) {
  return {.signals = a.preparation,
          .law = &law,
          .directional = {.offset = !a.no_offset, .asymmetry = a.asymmetry},
          .by_position = by_position(a, regressor),
          .robust = robust_of(a.robust),
          .rotor_inertia = !a.no_rotor_inertia,
          .prior = a.prior_percent.value_or(0) / 100};
}

bool finds_lag(const Arguments& a) { return a.lag == std::vector<std::string>{"auto"}; }
bool knows_lag(const Arguments& a) {
  return !a.lag.empty() && !finds_lag(a) && a.lag != std::vector<std::string>{"none"};
}

/// What the options leave to the choice.
Decided decided(const Arguments& a, const Regressor& regressor) {
  Decided d;
  if (!a.position_torque.empty()) d.by_position = by_position(a, regressor);
  if (a.preparation.cutoff_hz > 0) d.cutoff_hz = a.preparation.cutoff_hz;
  if (a.preparation.decimation > 0) d.decimation = a.preparation.decimation;
  if (a.no_offset) d.offset = false;
  d.coupling = !a.coupling.empty() || a.drive_gains;  // drive gains are those of motors that turn with one joint
  if (a.asymmetry) d.asymmetry = true;
  if (a.robust != "auto") d.robust = robust_of(a.robust);
  if (a.no_rotor_inertia) d.rotor_inertia = false;
  d.lag = !a.lag.empty() && !finds_lag(a);
  d.take_lag = finds_lag(a);
  if (knows_lag(a)) d.lag_s = given_lags(a.lag, regressor);
  if (a.prior_percent) d.prior = *a.prior_percent / 100;
  if (a.iv) d.instruments = true;
  return d;
}

/// The largest torque of every joint in the recordings [Nm; N].
std::vector<double> largest_torques(const std::vector<RobotRecording>& recordings) {
  std::vector<double> out(static_cast<std::size_t>(recordings.front().torque.rows()));
  for (const auto& r : recordings)
    for (std::size_t j = 0; j < out.size(); ++j)
      out[j] = std::max(out[j], r.torque.row(static_cast<Index>(j)).cwiseAbs().maxCoeff());
  for (double& largest : out)
    if (largest == 0) largest = 1;  // of a joint without torque
  return out;
}

/// Null: to be chosen.
const friction::LawInfo* given_law(const Arguments& a) {
  return a.friction == "auto" ? nullptr : or_wrong_input(dynamics_law(a.friction, "--friction", "auto"));
}

/// By the held-out error, where the options leave that open.
DynamicsChoice choice_of(const Arguments& a, const friction::LawInfo* given, const Robot& robot,
                         const std::vector<RobotRecording>& recordings, std::span<const double> torque_max_nm,
                         Progress& progress) {
  if (!given) {
    auto choice = choose_dynamics(*robot.model, robot.regressor, robot.base, recordings, decided(a, robot.regressor),
                                  torque_max_nm, a.threads, [&](double share) { progress(0.9 * share); });
    // What it is refused for may come of gaps, which the notes on its motion name.
    if (!choice) prepared(robot, recordings, a.preparation, a.quiet);
    return or_wrong_input(std::move(choice));
  }
  return {.setting = setting_of(a, robot.regressor, *given), .trials = {}};
}

Result<DynamicsFit> fit_of(const Arguments& a, const Robot& robot, const DynamicsChoice& choice,
                           const RobotFriction& friction, std::span<const thermal::Model> models,
                           const std::optional<Instruments>& instruments, JointMotion& motion, Progress& progress) {
  const Setting& setting = choice.setting;
  DynamicsOptions options = options_of(setting, a.threads);
  if (!choice.fit.base.empty()) options.start = &choice.fit;  // it stays near what was chosen
  options.weigh = !a.unweighted;
  options.essential_only = a.essential;
  options.instruments = instruments ? &*instruments : nullptr;
  if (!instruments) options.folds = band_folds;
  options.lag = finds_lag(a) || (a.lag.empty() && !setting.signals.lag_s.empty());
  options.progress = [&](double share) { progress(share); };
  if (models.empty() || motion.has_temperature)
    return fit_dynamics(robot.regressor, robot.base, friction, motion, options);
  return fit_warming_dynamics(robot.regressor, robot.base, friction, models, motion, options);
}

/// Those of --lag: as given, or none. They are not estimates.
std::vector<Estimate> given_lag(const Arguments& a, const Regressor& regressor, Preparation& signals) {
  std::vector<Estimate> out;
  if (!knows_lag(a)) return out;
  signals.lag_s = given_lags(a.lag, regressor);
  constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t j = 0; j < signals.lag_s.size(); ++j)
    out.push_back(
        {regressor.joint_name(static_cast<Index>(j)), "s", signals.lag_s[j], unknown, unknown, unknown, Status::fixed});
  return out;
}

/// Fits again what `motion` holds.
using Fit = std::function<Result<DynamicsFit>(JointMotion& motion)>;

/// The fit of the motion without the lags of its torques, which become `motion` and `lag`.
Result<DynamicsFit> without_lag(const Robot& robot, const std::vector<RobotRecording>& recordings,
                                const Preparation& signals, const DynamicsChoice& choice, const Fit& fit_of,
                                JointMotion& motion, std::vector<Estimate>& lag) {
  auto found = torque_lag(recordings, robot.regressor, signals, fit_of, choice.setting.lag_of);
  if (!found) return tl::unexpected(found.error());
  motion = std::move(found->motion);
  lag = std::move(found->lag);
  std::ranges::move(found->notes, std::back_inserter(found->fit.notes));
  return std::move(found->fit);
}

/// Whether two joints' speeds are proportional: then the motion of either explains both torques, whosever they are.
bool move_alike(const JointMotion& motion, Index a, Index b) {
  constexpr double alike = 0.95;
  const auto va = motion.qd.row(a), vb = motion.qd.row(b);
  return std::abs(va.dot(vb)) > alike * va.norm() * vb.norm();
}

/// Whether torques that the motion does not explain are explained with the other sign, or as those of another joint
/// that is not explained well either: what was changed has to be explained, and all torques clearly better than as they
/// were recorded. Joints that move alike say nothing.
bool explained_otherwise(const std::vector<Index>& joints, const DynamicsFit& fit, const JointMotion& motion,
                         const Fit& fit_of) {
  constexpr double explained = 0.5, well = 0.3, clearly = 0.6;
  const auto explains = [&](JointMotion changed, std::initializer_list<Index> which) {
    const auto other = fit_of(changed);
    if (!other) return false;
    double log_ratio = 0;  // over all joints: what is wrong with one column spoils the others' errors too
    for (std::size_t j = 0; j < fit.joints.size(); ++j)
      if (fit.joints[j].samples > 0)
        log_ratio += std::log(other->joints[j].relative_error / fit.joints[j].relative_error);
    return log_ratio < static_cast<double>(which.size()) * std::log(clearly) &&
           std::ranges::all_of(
               which, [&](Index j) { return other->joints[static_cast<std::size_t>(j)].relative_error < explained; });
  };
  for (const Index j : joints) {
    JointMotion changed = motion;
    changed.torque.row(j) *= -1;
    if (explains(std::move(changed), {j})) return true;
    for (const Index k : unexplained(fit, well)) {
      if (j == k || move_alike(motion, j, k)) continue;
      changed = motion;
      changed.torque.row(j).swap(changed.torque.row(k));
      if (explains(std::move(changed), {j, k})) return true;
    }
  }
  return false;
}

/// Joints, at most a third, whose torque the motion hardly explains although it explains the others without them: a
/// joint of much noise and little torque, or a dead one. None where columns look mistaken: `doubt` refuses.
std::vector<Index> weak_joints(const Robot& robot, const Fit& fit_of, const JointMotion& motion,
                               const DynamicsFit& fit) {
  std::vector<Index> weak, more = unexplained(fit);
  while (!more.empty()) {  // without them another may be explained as badly
    std::ranges::move(more, std::back_inserter(weak));
    if (static_cast<Index>(3 * weak.size()) > robot.regressor.joints()) return {};
    JointMotion rest = motion;
    for (const Index j : weak) rest.leave_out(j);
    const auto without = fit_of(rest);
    if (!without) return {};
    more = unexplained(*without);
  }
  return explained_otherwise(weak, fit, motion, fit_of) ? std::vector<Index>{} : weak;
}

/// Leaves out those of the weak joints of whose torque the motion explains nothing; says so in the notes.
void leave_out_dead(const Robot& robot, const Fit& fit_of, const std::vector<Index>& weak, JointMotion& motion,
                    DynamicsFit& fit, std::vector<std::string>& left_out) {
  constexpr double nothing = 0.95;
  std::vector<Index> dead;
  std::ranges::copy_if(weak, std::back_inserter(dead),
                       [&](Index j) { return fit.joints[static_cast<std::size_t>(j)].relative_error > nothing; });
  if (dead.empty()) return;
  JointMotion rest = motion;
  for (const Index j : dead) rest.leave_out(j);
  auto second = fit_of(rest);
  if (!second) return;
  for (const Index j : dead) {
    const auto at = static_cast<std::size_t>(j);
    left_out[at] =
        fmt::format("motion explains only {:.0f} % of its torque", 100 * (1 - fit.joints[at].relative_error));
    second->notes.push_back(fmt::format(
        "torque_{}_{} is left out, {} and the others are explained without it: is the column dead, late or that of "
        "another joint? Friction of {} is not identified",
        robot.regressor.joint_name(j), robot.regressor.is_slide(j) ? "n" : "nm", left_out[at],
        robot.regressor.joint_name(j)));
  }
  fit = std::move(*second);
  motion = std::move(rest);
}

/// Per joint, why its torque counts nowhere.
std::vector<std::string> left_out_of(const Robot& robot, const JointMotion& motion) {
  std::vector<std::string> out;
  for (Index j = 0; j < robot.regressor.joints(); ++j)
    out.push_back(motion.is_left_out(j) ? "its torque was not recorded" : "");
  return out;
}

/// What PARAMS.yaml says of the data beside the numbers.
DynamicsOrigin origin_of(const Arguments& a, const Robot& robot, const Setting& setting, const JointMotion& motion,
                         const std::vector<double>& torque_max_nm, const std::vector<thermal::Model>& models) {
  DynamicsOrigin origin{.model = a.model,
                        .data = a.data,
                        .signals = setting.signals,
                        .torque_max_nm = {},
                        .thermal = models,
                        .left_out = {},
                        .drive_gains = {},
                        .lag = {},
                        .ranges = {},
                        .band = {},
                        .band_independent = {},
                        .consistent = {}};
  origin.signals.cutoff_hz = motion.cutoff_hz;
  origin.signals.reversals = motion.reversals;  // also where they count as there are hardly any other samples
  if (static_cast<Index>(robot.model->drives().size()) < robot.regressor.joints()) origin.torque_max_nm = torque_max_nm;
  return origin;
}

/// The drive gains that --drive-gains asks for, beside what was assumed.
struct Gains {
  DriveGains found;
  std::vector<AssumedGain> assumed;
  std::vector<Estimate> constants;
  std::vector<std::string> notes;
};

struct Recorded {
  std::vector<RobotRecording> recordings;  ///< with corrected torques and payloads
  std::vector<KnownPayload> payloads;
  std::optional<Gains> gains;
};

/// What the torques of the recordings are made of; throws InputError where recordings differ.
std::vector<AssumedGain> assumed_of(const Arguments& a, const Robot& robot,
                                    const std::vector<RobotRecording>& recordings,
                                    const std::vector<std::optional<double>>& nm_per_a) {
  std::vector<AssumedGain> out;
  for (std::size_t j = 0; j < nm_per_a.size(); ++j) {
    const auto joint = static_cast<Index>(j);
    const bool of_current = recordings.front().of_current[j];
    for (const RobotRecording& rec : recordings)
      if (rec.of_current[j] != of_current && !rec.without_torque[j])
        throw InputError(fmt::format(
            "--drive-gains: {} has a torque column of {}, {} a current; the gain of one is not that of the other",
            of_current ? rec.file.string() : recordings.front().file.string(), robot.regressor.joint_name(joint),
            of_current ? recordings.front().file.string() : rec.file.string()));
    out.push_back({.of_current = of_current, .nm_per_a = nm_per_a[j], .slide = robot.regressor.is_slide(joint)});
  }
  if (!a.tables.torque_constant.empty() && std::ranges::none_of(out, &AssumedGain::of_current))
    throw InputError("--torque-constant: no recording has a column current_JOINT_a");
  return out;
}

/// The payloads as they are placed, each once, and which one every recording has; -1: none.
struct Loads {
  std::vector<KnownPayload> known;
  std::vector<PlacedPayload> payloads;
  std::vector<int> of_file;
};

Loads loads_of(const Arguments& a, const Robot& robot, const std::vector<KnownPayload>& known) {
  Loads out{.known = {}, .payloads = {}, .of_file = std::vector<int>(a.data.size(), -1)};
  std::vector<std::string> texts;
  for (const KnownPayload& payload : known) {
    auto same = std::ranges::find(texts, payload.text);
    if (same == texts.end()) {
      out.payloads.push_back(or_wrong_input(placed(payload, robot.regressor)));
      out.known.push_back(payload);
      same = texts.insert(texts.end(), payload.text);
    }
    const auto file = std::ranges::find(a.data, payload.file) - a.data.begin();
    out.of_file[static_cast<std::size_t>(file)] = static_cast<int>(same - texts.begin());
  }
  return out;
}

/// Corrects torques by the gains. The torque of a joint counts nowhere where its current is all that is known.
void correct(const Gains& gains, const Loads& loads, std::vector<RobotRecording>& recordings) {
  for (std::size_t f = 0; f < recordings.size(); ++f) {
    RobotRecording& rec = recordings[f];
    for (std::size_t j = 0; j < gains.assumed.size(); ++j)
      if (gains.found.known(j))
        rec.torque.row(static_cast<Index>(j)) *= gains.found.factors[j].value;
      else if (gains.assumed[j].of_current && !gains.assumed[j].nm_per_a)
        rec.without_torque[j] = true;
    if (const int p = loads.of_file[f]; p >= 0)
      rec.carried = CarriedBody{loads.payloads[static_cast<std::size_t>(p)].body.body,
                                gains.found.payload[static_cast<std::size_t>(p)]};
  }
}

Gains gains_of(const Arguments& a, const Robot& robot, const Loads& loads, std::vector<AssumedGain> assumed,
               const std::vector<RobotRecording>& recordings) {
  const JointMotion motion = prepared(robot, recordings, a.preparation, true);
  auto found = identify_drive_gains(robot.regressor, robot.base, motion, loads.payloads, loads.of_file, a.threads);
  if (!found) throw InputError(fmt::format("--drive-gains: {}: {}", joined(std::span(a.data)), found.error().message));
  Gains out{.found = std::move(*found), .assumed = std::move(assumed), .constants = {}, .notes = {}};
  out.constants = drive_constants(out.found, out.assumed);
  if (std::ranges::all_of(out.constants, [](const Estimate& e) { return std::isnan(e.value); }))
    throw InputError(fmt::format("--drive-gains: {}: no gain is identifiable; {}", joined(std::span(a.data)),
                                 joined(lines_of(out.found.lacking), "; ")));
  out.notes = doubtful_centres(robot.regressor, robot.base, motion, loads.known, loads.of_file, a.threads);
  std::ranges::move(doubtful_mass(out.found, out.assumed), std::back_inserter(out.notes));
  return out;
}

Recorded recorded(const Arguments& a, const Robot& robot) {
  Recorded out{.recordings = {}, .payloads = known_payloads(a.payloads, a.data), .gains = {}};
  if (!a.drive_gains) {
    out.recordings = read_recordings(robot, a.data, a.tables, a.quiet);
    carry(robot, out.payloads, out.recordings, a.quiet);
    return out;
  }
  const Loads loads = loads_of(a, robot, out.payloads);
  const auto said = torque_per_ampere(robot, a.tables);
  std::vector<double> nm_per_a;
  for (const auto& one : said) nm_per_a.push_back(one.value_or(1));
  out.recordings = read_recordings(robot, a.data, a.tables, a.quiet, nm_per_a);
  out.gains = gains_of(a, robot, loads, assumed_of(a, robot, out.recordings, said), out.recordings);
  correct(*out.gains, loads, out.recordings);
  return out;
}

/// {JOINT: why its torque is left out}.
Json json_of(const Robot& robot, const std::vector<std::string>& left_out) {
  Json out = Json::object();
  for (std::size_t k = 0; k < left_out.size(); ++k)
    if (!left_out[k].empty()) out[robot.regressor.joint_name(static_cast<Index>(k))] = left_out[k];
  return out;
}

/// Says why torques are left out whose drive gain is not known.
void name_unknown_gains(const std::optional<Gains>& gains, std::vector<std::string>& left_out) {
  for (std::size_t j = 0; gains && j < left_out.size(); ++j)
    if (!left_out[j].empty() && gains->assumed[j].of_current && !gains->found.known(j))
      left_out[j] = "its drive gain is not identifiable";
}

void refuse_useless_thermal(const Arguments& a, const Robot& robot, const friction::LawInfo& law) {
  if (!a.thermal.empty() && !robot.regressor.motors().empty())
    throw InputError(
        fmt::format("--thermal: motor {} turns with several joints; the heat of coupled motors is not modelled. Record "
                    "temperature_JOINT_degC, or leave --thermal out",
                    robot.regressor.motors().front().name));
  if (!a.thermal.empty() && !law.temperature_dependent)
    throw InputError(
        fmt::format("--thermal: friction '{}' does not depend on temperature; --friction polynomial does", law.name));
}

/// All that is printed.
struct Report {
  const Robot& robot;
  const DynamicsChoice& choice;
  const DynamicsFit& fit;
  const Consistency& consistency;
  const ConsistentDynamics& consistent;
  const Judgement& judgement;
  const std::vector<Efficiency>& efficiencies;
  const Recorded& data;
  const std::vector<Estimate>& lag;
  const std::vector<std::string>& left_out;
  const std::vector<std::string>& files;
};

/// `cutoff_hz`: the one that was used; the setting has 0 for the usual one.
Json json_of(const Report& r, double cutoff_hz) {
  Json j = json_of(r.robot, r.fit, r.consistency, r.judgement);
  j["consistent"] = json_of(r.robot, r.consistent);
  j["choice"] = json_of(r.choice);
  j["choice"]["cutoff_hz"] = cutoff_hz;
  j["efficiency"] = json_of(r.efficiencies);
  if (r.data.gains) {
    j["drive_gains"] = json_of(r.data.gains->found, r.data.gains->assumed);
    for (const auto& text : r.data.gains->notes) j["notes"].push_back(text);
  }
  for (const Estimate& e : r.lag)
    j["lag"][e.name] = {{"value", number(e.value)}, {"sigma", number(e.sigma)}, {"unit", e.unit}};
  for (const FileLag& lag : r.judgement.lags)
    j["lag_of_files"][r.robot.regressor.joint_name(lag.joint)][r.files[lag.file]] = {
        {"value", number(lag.value_s)}, {"sigma", number(lag.sigma_s)}, {"unit", "s"}};
  j["left_out"] = json_of(r.robot, r.left_out);
  return j;
}

std::string text_of(const Report& r) {
  return (r.data.gains ? table_of(r.data.gains->found, r.data.gains->assumed, r.data.payloads) : "") +
         table_of(r.choice) + table_of(r.lag) + table_of(r.robot, r.fit, r.consistency, r.judgement, r.consistent) +
         table_of(r.efficiencies);
}

/// Options that --iv does not go with. `law`: null where it is to be chosen.
void refuse_beside_iv(const Arguments& a, const friction::LawInfo* law) {
  if (!a.iv) return;
  const std::pair<bool, std::string_view> others[] = {{a.asymmetry, "--asymmetry"},
                                                      {!a.position_torque.empty(), "--position-torque"},
                                                      {robust_of(a.robust) != Robust::none, "--robust"},
                                                      {a.prior_percent.value_or(0) > 0, "--prior"},
                                                      {a.essential, "--essential"},
                                                      {finds_lag(a), "--lag auto"},
                                                      {!a.thermal.empty(), "--thermal"},
                                                      {a.drive_gains, "--drive-gains"}};
  for (const auto& [given, option] : others)
    if (given) throw InputError(fmt::format("--iv: does not go with {}, which needs least squares", option));
  if (law && !knows_instruments(*law))
    throw InputError(fmt::format(
        "--iv: friction '{}' is not linear or depends on load; coulomb_viscous and coulomb_viscous_stribeck "
        "are what instrumental variables know, and what --friction auto then chooses among",
        law->name));
}

/// Of --iv; rows that do not repeat no longer count.
std::optional<Instruments> instruments_of(const Arguments& a, const Robot& robot,
                                          const std::vector<RobotRecording>& recordings, JointMotion& motion) {
  if (!a.iv) return {};
  auto found = instruments_of_repetitions(recordings, robot.regressor, motion);
  if (!found) throw InputError("--iv: " + found.error().message);
  if (a.friction == "auto")
    found->notes.push_back(
        "--friction auto chose by least squares, among laws that are linear in their parameters and know no load, "
        "without asymmetry, robust loss, prior and a lag that is not known");
  return std::move(*found);
}

/// Adds what the judgement warns of to the fit's notes, and says them.
void say_notes(const Arguments& a, const Robot& robot, const Judgement& judgement, DynamicsFit& fit) {
  std::ranges::move(warnings_of(judgement.joints), std::back_inserter(fit.notes));
  std::ranges::move(warnings_of(judgement.negative), std::back_inserter(fit.notes));
  std::ranges::move(files_that_differ(robot.regressor, a.data, judgement.lags), std::back_inserter(fit.notes));
  if (!a.quiet)
    for (const auto& text : fit.notes) note("{}", text);
}

Result<Exit> execute(const Arguments& a) {
  const friction::LawInfo* const given = given_law(a);
  refuse_beside_iv(a, given);
  Robot robot = coupled_robot(a.model, a.coupling, a.quiet);
  const Recorded data = recorded(a, robot);
  const auto& recordings = data.recordings;
  if (data.gains && !a.quiet)
    for (const auto& text : data.gains->notes) note("{}", text);
  const std::vector<double> torque_max_nm = largest_torques(recordings);
  Progress progress(a.quiet, "identifying");
  const DynamicsChoice choice = choice_of(a, given, robot, recordings, torque_max_nm, progress);
  if (!choice.setting.motors.empty()) robot = with_motors(robot, choice.setting.motors, "--friction auto");
  const friction::LawInfo& law = *choice.setting.law;
  refuse_useless_thermal(a, robot, law);
  Preparation signals = choice.setting.signals;
  std::vector<Estimate> lag = given_lag(a, robot.regressor, signals);
  JointMotion motion = prepared(robot, recordings, signals, a.quiet);
  const auto friction = friction_of(*robot.model, robot.regressor, choice.setting, torque_max_nm, motion);
  if (!friction) throw InputError(fmt::format("{}: {}", a.model, friction.error().message));
  const auto models = a.thermal.empty() ? std::vector<thermal::Model>{} : thermal_models(a.thermal, robot.regressor);
  const std::optional<Instruments> instruments = instruments_of(a, robot, recordings, motion);
  const Fit again = [&](JointMotion& m) {
    return fit_of(a, robot, choice, *friction, models, instruments, m, progress);
  };
  const bool lag_open = finds_lag(a) || (a.lag.empty() && !choice.setting.signals.lag_s.empty());
  auto fit = lag_open ? without_lag(robot, recordings, signals, choice, again, motion, lag) : again(motion);
  if (!fit) throw InputError(fmt::format("{}: {}", a.data.front(), fit.error().message));
  std::vector<std::string> left_out = left_out_of(robot, motion);
  name_unknown_gains(data.gains, left_out);
  const std::vector<Index> weak = weak_joints(robot, again, motion, *fit);
  leave_out_dead(robot, again, weak, motion, *fit, left_out);
  doubt_signs(a, robot, *friction, motion, *fit);
  doubt(a, robot, *fit, weak);
  if (data.gains) count_gains(data.gains->found, *fit);
  const auto efficiencies =
      data.gains ? transmission_efficiency(data.gains->found) : transmission_efficiency(*friction, *fit);
  const bool with_temperature = motion.has_temperature || (!models.empty() && law.temperature_dependent);
  const Judgement judgement = judged(robot, *friction, motion, *fit, with_temperature, a.threads);
  say_notes(a, robot, judgement, *fit);
  const Consistency consistency =
      nearest_consistent(robot.regressor, robot.base, fit->parameters.base, fit->information);
  ConsistentDynamics consistent = consistent_dynamics(robot.regressor, robot.base, *friction, *fit);
  measure_growth(robot.regressor, robot.base, *friction, *fit, motion, a.threads, consistent);
  consistent.predict_worse = !consistent.same && !choice.real_bodies;
  if (a.output.named()) {
    DynamicsOrigin origin = origin_of(a, robot, choice.setting, motion, torque_max_nm, models);
    if (data.gains) origin.drive_gains = data.gains->constants;
    origin.left_out = left_out, origin.lag = lag, origin.ranges = judgement.ranges;
    origin.band = band_of(motion, fit->held_out), origin.consistent = consistent;
    origin.band_independent = independent_of_band(motion, fit->held_out);
    if (auto ok = deliver(to_yaml(*fit, robot.base, law, robot.regressor, consistency, origin), a.output); !ok)
      return ok;
  }
  const Report report{robot,        choice, *fit, consistency, consistent, judgement,
                      efficiencies, data,   lag,  left_out,    a.data};
  return deliver(a.json ? dump_json(json_of(report, motion.cutoff_hz), 2) + "\n" : text_of(report));
}

/// Friction, outliers, lags and coupled motors.
void add_model_options(CLI::App& command, const std::shared_ptr<Arguments>& a) {
  command
      .add_option(
          "--friction", a->friction,
          "coulomb_viscous, polynomial or another law; auto: by what predicts best in these recordings, as cut-off, "
          "outliers, prior and more that are not given")
      ->capture_default_str();
  command.add_flag("--no-offset", a->no_offset, "No torque offset beside the law");
  command
      .add_option(
          "--lag", a->lag,
          "How late torques were recorded behind positions, which is removed: none (default), auto (found from the "
          "data, as --friction auto does where it predicts better), or seconds, one for all joints or one each as A,B")
      ->delimiter(',');
  command.add_flag("--asymmetry", a->asymmetry, "Friction forward and reverse may differ by a factor");
  command
      .add_option("--position-torque", a->position_torque,
                  "Hinges A,B beside whose friction a torque C cos q + S sin q acts, as of springs, cables and sensors "
                  "that turn with them (default: none, or what --friction auto finds); none: no joint")
      ->delimiter(',');
  command.add_option("--robust", a->robust, "Loss for data with outliers")
      ->check(CLI::IsMember({"auto", "none", "huber", "tukey"}))
      ->capture_default_str();
  command
      .add_option(
          "--coupling", a->coupling,
          "JOINT=SUM: the motor of JOINT turns with several joints, as in wrists: \"joint6 = joint5 + joint6\"; may "
          "be repeated (default: as the model's actuators on tendons say, or what --friction auto finds); none: no "
          "motor "
          "does")
      ->allow_extra_args(false);
}

}  // namespace

void add_dynamics(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand("dynamics",
                               "Identify a robot's inertial parameters and friction from recorded motion and torques");
  c->add_option("MODEL", a->model, "MJCF model: positions and axes of the joints; masses are identified")->required();
  c->add_option("DATA", a->data,
                "Table (CSV, folder of a run, telemetry.h5, .npz, .npy, .mat, .mcap): time_s, position_JOINT_rad (_m), "
                "torque_JOINT_nm (_n), optionally velocity_JOINT_rad_s, "
                "temperature_JOINT_degC")
      ->required();
  add_model_options(*c, a);
  add_payload(*c, a->payloads);
  c->add_flag("--drive-gains", a->drive_gains,
              "Identify torque constant x gear ratio of every joint from current_JOINT_a, or a factor that corrects "
              "torque_JOINT_nm: from recordings without and with a payload (--payload); kept for predict");
  c->add_option("--prior", a->prior_percent,
                "How far the bodies may be off the model's: standard deviation [%] of their masses, first moments and "
                "inertias; 0: whatever the data say")
      ->check(CLI::Range(0.0, 1e6));
  c->add_flag("--iv", a->iv,
              "Instrumental variables in place of least squares, for a repeated motion and a coarse encoder: errors of "
              "positions do not draw inertias towards 0");
  c->add_flag("--no-rotor-inertia", a->no_rotor_inertia, "Torques were measured behind the gear");
  c->add_flag("--unweighted", a->unweighted, "Give all joints the same weight");
  c->add_flag("--essential", a->essential, "Set base parameters that do not improve the fit to 0");
  c->add_option(
      "--thermal", a->thermal,
      "THERMAL.yaml of tribotwin thermal with every joint; stored for predict. Without temperature columns friction "
      "is fitted at the temperatures that it causes; every file starts at rest temperature");
  a->tables.add_to(*c);
  a->tables.add_gear_ratio_to(*c);
  add_preparation(*c, a->preparation);
  a->output.add_to(*c, "PARAMS.yaml to write: read by predict");
  c->add_option("--threads", a->threads, "Threads; they do not change the result")->check(CLI::Range(1, 256));
  c->add_flag("--json", a->json, "Print JSON instead of the table");
  c->add_flag("--quiet", a->quiet, "No progress, no notes");
  c->footer(
      "Example:\n  tribotwin run er3a_c60_day -o runs/day --set duration_s=120 --set telemetry_rate_hz=250\n  "
      "tribotwin export runs/day --recording -o recorded.csv\n  tribotwin dynamics er3a_c60 recorded.csv --friction "
      "polynomial -o robot.yaml");
  c->callback([a, &code] {
    auto inputs = paths(a->data);
    inputs.insert(inputs.end(), {a->model, a->thermal});
    check(a->output, inputs);
    code = or_throw(execute(*a));
  });
}

}  // namespace tribotwin::twin::program
