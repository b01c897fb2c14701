#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/identification/rigid_body/temperature_estimator.hpp>
#include <tribotwin/twin/identification/rigid_body/wrench.hpp>
#include <tribotwin/twin/identification/verdict/lag_of_files.hpp>
#include <tribotwin/twin/identification/verdict/report.hpp>
#include <tribotwin/twin/identification/verdict/torque_band.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::program {
namespace {

using namespace identification;
using Json = nlohmann::ordered_json;
using Eigen::Index;

constexpr double infinity = std::numeric_limits<double>::infinity();

struct Arguments {
  std::string model, parameters, wrench, site = "flange", bodies = "auto";
  Destination output;
  TableArguments tables;
  std::vector<std::string> data, payloads, lag{"file"};
  std::vector<double> window_s;    ///< none, or first and last time whose errors count
  std::vector<double> start_degC;  ///< none, one for all joints, or one each
  Preparation preparation;
  unsigned threads = threads_of(0);
  bool json = false, quiet = false;
};

using Samples = Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic>;

/// Of recorded torques about predicted ones.
struct Bands {
  Eigen::VectorXd half_width;   ///< per joint [Nm; N]; NaN: none
  Eigen::VectorXd independent;  ///< per joint, independent samples that it is from; NaN: not known
  std::string lacking;          ///< why there is none; empty: there are bands

  double at(const Samples& trained, Index joint, Index sample) const {
    return trained(joint, sample) ? half_width(joint) : std::nan("");
  }
};

/// What the motion asks of the parameters, and what they make of it.
struct Judgement {
  std::vector<JointVerdict> joints;
  std::vector<std::vector<Beyond>> beyond;  ///< per joint; empty: the ranges of the training are not known
  Samples trained;                          ///< as of in_training
  Samples in_span;                          ///< as of motion_in_span
  Samples loading;                          ///< joints x joints: whether the first loads the second
};

/// Over the samples in which the joint moves; at rest friction is not determined by the motion.
struct Error {
  double rms = 0, range = 0, largest = 0;
  Index samples = 0;
  double half_width = 0;        ///< of the band; NaN: there is none
  double of_independent = 0;    ///< independent samples that the band is from; NaN: not known
  InBand band;                  ///< of the samples in the training
  InBand as_trained;            ///< of those in which all joints that load this one are in the training's spans
  std::vector<double> outside;  ///< per joint: share of the band's samples in which it loads this one, outside
  double step_s = 0;            ///< from sample to sample
  double share() const { return rms / range; }
  /// Errors below a thousandth of the range, as between twins without noise, are no matter.
  bool band_fails() const { return band.fails() && share() > 1e-3; }
  /// Nothing but the robot or the model is left to explain that.
  bool has_changed() const { return band_fails() && as_trained.is_refuted() && of_independent >= least_of_band; }
};

/// Where the band is made, by which joints the motion is further than the training's nevertheless.
void count_in_band(const JointMotion& motion, const Judgement& judgement, Index joint,
                   const std::vector<std::pair<Index, double>>& errors, Error& e) {
  std::vector<double> all, as_trained;
  e.outside.assign(static_cast<std::size_t>(motion.q.rows()), 0.0);
  for (const auto& [i, error] : errors) {
    bool is_trained = true;
    for (Index other = 0; other < motion.q.rows(); ++other)
      if (judgement.loading(other, joint) && !judgement.in_span(other, i))
        is_trained = false, e.outside[static_cast<std::size_t>(other)] += 1 / static_cast<double>(errors.size());
    const bool is_inside = std::abs(error) <= e.half_width;
    ++e.band.samples, e.band.inside += is_inside, all.push_back(error);
    if (is_trained) ++e.as_trained.samples, e.as_trained.inside += is_inside, as_trained.push_back(error);
  }
  e.band.independent = independent_errors(all, motion);
  e.as_trained.independent = independent_errors(as_trained, motion);
}

Error error_of(const JointMotion& motion, const Eigen::MatrixXd& predicted, const Bands& bands,
               const Judgement& judgement, Index joint, double from_s, double until_s) {
  Error e{.half_width = bands.half_width(joint),
          .of_independent = bands.independent(joint),
          .band = {},
          .as_trained = {},
          .outside = {},
          .step_s = motion.period_s};
  std::vector<std::pair<Index, double>> in_training;
  double squares = 0, low = infinity, high = -low;
  for (Index i = 0; i < motion.size(); ++i) {
    if (const double t = motion.time_s[static_cast<std::size_t>(i)]; t < from_s || t > until_s) continue;
    low = std::min(low, motion.torque(joint, i)), high = std::max(high, motion.torque(joint, i));
    if (!motion.moving(joint, i) || std::isnan(predicted(joint, i))) continue;
    const double difference = motion.torque(joint, i) - predicted(joint, i);
    squares += difference * difference;
    e.largest = std::max(e.largest, std::abs(difference));
    ++e.samples;
    if (!std::isnan(bands.at(judgement.trained, joint, i))) in_training.emplace_back(i, difference);
  }
  count_in_band(motion, judgement, joint, in_training, e);
  e.rms = std::sqrt(squares / static_cast<double>(e.samples));
  e.range = high - low;
  return e;
}

/// Of the samples whose errors count.
Judgement judged(const Arguments& a, const Robot& robot, const DynamicsFile& file, const RobotParameters& parameters,
                 const JointMotion& motion, bool with_temperature, const Eigen::MatrixXd& predicted) {
  const auto load_by = [&](const Eigen::VectorXd& base) {
    return gear_load(robot.regressor, robot.base, base, motion, a.threads);
  };
  const Eigen::MatrixXd load = load_by(parameters.base), load_of_fit = load_by(file.parameters.base);  // as the ranges'
  Samples loading(motion.q.rows(), motion.q.rows());
  for (Index k = 0; k < loading.size(); ++k)
    loading(k % loading.rows(), k / loading.rows()) = loads(robot.regressor, k % loading.rows(), k / loading.rows());
  const auto of = [&](const JointMotion& counted) -> Judgement {
    return {judge_joints(robot.regressor, counted, predicted, load),
            beyond(file.ranges, counted, load_of_fit, with_temperature),
            in_training(file.ranges, motion, load_of_fit, with_temperature), motion_in_span(file.ranges, motion),
            loading};
  };
  if (a.window_s.empty()) return of(motion);
  JointMotion counted = motion;
  for (Index i = 0; i < motion.size(); ++i)
    if (const double t = motion.time_s[static_cast<std::size_t>(i)]; t < a.window_s[0] || t > a.window_s[1])
      counted.moving.col(i).setConstant(false);
  return of(counted);
}

/// The quantity of which most samples lie outside of the training.
std::string outside_of(const std::vector<std::vector<Beyond>>& beyond, Index joint) {
  if (beyond.empty()) return "unknown";
  const auto& all = beyond[static_cast<std::size_t>(joint)];
  const auto most = std::ranges::max_element(all, {}, &Beyond::share);
  if (most == all.end() || most->share == 0) return "-";
  return fmt::format("{:.2g} % by {}", 100 * most->share, most->info().name);
}

/// For rows of row_of.
TextTable table_of_errors() {
  constexpr auto right = TextTable::right;
  return TextTable{{TextTable::left("joint"), right("error rms"), right("of its range"), right("range"),
                    right("largest"), right("95 % band"), TextTable::left(), right("inside"), right("samples"),
                    right("outside training"), TextTable::left()}};
}

/// `lacking`: why there is no error; empty: there is one if the joint moves.
std::vector<std::string> row_of(const std::string& joint, const Error& e, const std::string& unit,
                                const std::string& outside, const std::string& lacking) {
  const auto figure = [](double x) { return fmt::format("{:.4g}", x); };
  if (!lacking.empty()) return {joint, "-", "-", "-", "-", "-", unit, "-", "0", outside, lacking};
  if (e.samples == 0) return {joint, "-", "-", figure(e.range), "-", "-", unit, "-", "0", outside, "does not move"};
  return {joint,
          figure(e.rms),
          fmt::format("{:.2f} %", 100 * e.share()),
          figure(e.range),
          figure(e.largest),
          std::isnan(e.half_width) ? "-" : "+-" + figure(e.half_width),
          unit,
          e.band.samples == 0 ? "-" : fmt::format("{:.1f} % of {}", 100 * e.band.share(), e.band.samples),
          fmt::format("{}", e.samples),
          outside};
}

/// Null where ranges are not known.
Json training_of(const Judgement& judgement, Index joint) {
  if (judgement.beyond.empty()) return nullptr;
  Json out = Json::object();
  for (const Beyond& b : judgement.beyond[static_cast<std::size_t>(joint)])
    out[std::string(b.info().name)] = {{"low", b.trained.low},
                                       {"high", b.trained.high},
                                       {"share_outside", b.share},
                                       {"furthest", b.share > 0 ? Json(b.furthest) : Json(nullptr)}};
  return out;
}

/// Null where there is none.
Json band_of(const Error& e) {
  if (std::isnan(e.half_width)) return nullptr;
  const Json as_trained = {{"samples", e.as_trained.samples},
                           {"share_inside", e.as_trained.samples > 0 ? Json(e.as_trained.share()) : Json(nullptr)},
                           {"independent", std::round(10 * e.as_trained.independent) / 10}};  // its digits are noise
  return {{"half_width", e.half_width},
          {"samples", e.band.samples},
          {"share_inside", e.band.samples > 0 ? Json(e.band.share()) : Json(nullptr)},
          {"as_trained", as_trained},
          {"fails", e.band_fails()},
          {"changed", e.has_changed()}};
}

Json json_of(const Error& e, const std::string& unit, const JointVerdict& verdict) {
  return {{"rms", e.rms},         {"relative_to_range", e.share()}, {"range", e.range},
          {"largest", e.largest}, {"samples", e.samples},           {"unit", unit},
          {"band", band_of(e)},   {"verdict", json_of(verdict)}};
}

/// Whether the parameters of real bodies are taken: not where the data contradict them all beyond doubt, or samples
/// that they have not seen, as what keeps them from being real (a spring, coupled motors, torques that are late) is
/// then a part of the torque that real bodies cannot give.
bool takes_consistent(const Arguments& a, const DynamicsFile& file) {
  if (!file.consistent) return false;
  if (a.bodies != "auto") return a.bodies == "consistent";
  return file.consistent->same || !(file.contradicted || file.consistent->predict_worse);
}

/// What is to be known of the parameters before the errors are believed.
std::vector<std::string> warnings_of(const Arguments& a, const Robot& robot, const DynamicsFile& file,
                                     const Judgement& judgement) {
  std::vector<std::string> lines;
  if (file.ranges.empty())
    lines.push_back(
        fmt::format("{}: of an earlier version: whether the motion stays in the training is not known", a.parameters));
  for (std::size_t j = 0; j < judgement.beyond.size(); ++j) {
    const auto joint = static_cast<Index>(j);
    if (auto line =
            beyond_training(robot.regressor.joint_name(joint), robot.regressor.is_slide(joint), judgement.beyond[j]);
        !line.empty())
      lines.push_back(line + ": errors there are not those of the training");
  }
  if (!file.possible && !(file.consistent && file.consistent->same))
    lines.push_back(fmt::format(
        "no real bodies have the least-squares parameters of {}: the nearest are {:.1f} sigma away ({}): springs, "
        "coupled motors, a payload or another geometry than the model's would do that. {}",
        a.parameters, file.distance_sigma,
        std::isnan(file.chance) ? "chance not kept" : fmt::format("{:.2g} by chance", file.chance),
        takes_consistent(a, file) ? "Real bodies are taken all the same"
                                  : "They predict motions like the training's only"));
  return lines;
}

/// How much worse than least squares real bodies explain the training, as a factor of the residual's rms.
double largest_growth(const DynamicsFile& file) {
  double largest = 1;
  if (file.consistent)
    for (const double growth : file.consistent->growth) largest = growth > largest ? growth : largest;
  return largest;
}

/// Real bodies leave more of the training unexplained than the parameters whose band the file has.
Bands bands_of(const Arguments& a, const DynamicsFile& file, const JointMotion& motion) {
  const Eigen::VectorXd unknown = Eigen::VectorXd::Constant(motion.q.rows(), std::nan(""));
  Bands out{.half_width = unknown, .independent = unknown, .lacking = {}};
  if (!file.band_independent.empty())
    out.independent =
        Eigen::Map<const Eigen::VectorXd>(file.band_independent.data(), std::ssize(file.band_independent));
  if (file.band.empty())
    out.lacking =
        fmt::format("{}: of an earlier version, or of --iv: predicted torques have no 95 % band", a.parameters);
  else if (motion.cutoff_hz != file.signals.cutoff_hz || motion.lag_s != file.signals.lag_s)
    out.lacking = fmt::format(
        "predicted torques have no 95 % band: that of {} is for torques with the cut-off and lag "
        "of its fit",
        a.parameters);
  else
    out.half_width = Eigen::Map<const Eigen::VectorXd>(file.band.data(), std::ssize(file.band));
  if (takes_consistent(a, file) && !file.consistent->same) out.half_width.array() *= file.consistent->growth.array();
  return out;
}

/// Why a band that fails is not the robot's or the model's doing beyond doubt.
std::string doubts(const Regressor& regressor, const Error& e) {
  std::vector<std::string> others, out;
  for (std::size_t k = 0; k < e.outside.size(); ++k)
    if (e.outside[k] > 0)
      others.push_back(fmt::format("{} in {:.3g} %", regressor.joint_name(static_cast<Index>(k)), 100 * e.outside[k]));
  if (!others.empty()) out.push_back("joints that load it are outside of what was trained: " + joined(others));
  if (e.as_trained.samples > 0 && e.as_trained.share() >= InBand::too_few)
    out.push_back(fmt::format("where all are within it, {:.0f} % of {} samples are inside", 100 * e.as_trained.share(),
                              e.as_trained.samples));
  else if (e.as_trained.samples > 0 && !e.as_trained.is_refuted())
    out.push_back(fmt::format("the {} samples where all are within it count as {:.2g} independent ones, of {:g} needed",
                              e.as_trained.samples, e.as_trained.independent, InBand::enough));
  if (std::isnan(e.of_independent))
    out.push_back("the parameters are of an earlier version: how well the band is known is not");
  else if (e.of_independent < least_of_band)
    out.push_back(fmt::format("the band is from {:.2g} independent samples of the training, of {:g} needed",
                              e.of_independent, least_of_band));
  return joined(out, "; ");
}

/// Empty where the band holds, or none is known.
std::string band_that_fails(const Regressor& regressor, Index joint, const Error& e) {
  if (!e.band_fails()) return {};
  const std::string band =
      fmt::format("the 95 % band of +-{:.3g} {}", e.half_width, unit_of("Nm", regressor.is_slide(joint)));
  if (e.has_changed())
    return fmt::format(
        "joint {}: only {:.0f} % of the recorded torques are within {}, and {:.0f} % where it and the joints that load "
        "it are within the training's ranges ({} samples, {:.0f} independent ones): the robot has changed, or its "
        "model lacks something",
        regressor.joint_name(joint), 100 * e.band.share(), band, 100 * e.as_trained.share(), e.as_trained.samples,
        e.as_trained.independent);
  const auto seconds = [&](Index samples) { return static_cast<double>(samples) * e.step_s; };
  return fmt::format("joint {}: recorded torques are outside {} in {:.2g} of {:.2g} s. That proves no change: {}",
                     regressor.joint_name(joint), band, seconds(e.band.samples - e.band.inside),
                     seconds(e.band.samples), doubts(regressor, e));
}

/// For tribotwin-report dynamics, which reads them again.
Json origin_of(const Arguments& a) {
  return {{"model", a.model},
          {"parameters", a.parameters},
          {"data", a.data},
          {"table", a.output.named() ? Json(a.output.file) : Json(nullptr)}};
}

Json bodies_of(const Arguments& a, const DynamicsFile& file) {
  return {{"used", takes_consistent(a, file) ? "consistent" : "least_squares"},
          {"same", file.consistent ? Json(file.consistent->same) : Json(nullptr)},
          {"possible", file.possible},
          {"contradicted", file.contradicted},
          {"predict_worse", file.consistent && file.consistent->predict_worse},
          {"distance_sigma", std::isnan(file.distance_sigma) ? Json(nullptr) : Json(file.distance_sigma)},
          {"chance", std::isnan(file.chance) ? Json(nullptr) : Json(file.chance)},
          {"residual_growth", largest_growth(file)}};
}

std::string words_of(const Arguments& a, const DynamicsFile& file) {
  if (!file.consistent) return "bodies: those of least squares; the file has no others\n";
  if (file.consistent->same) return {};
  return fmt::format(
      "bodies: {}; in the training residuals of real ones are up to {:.4g} times those of least squares\n",
      takes_consistent(a, file) ? "real ones with the smallest sum of squares"
                                : "those of least squares, which are not real",
      largest_growth(file));
}

/// In the time of the recording: at each time what was recorded then, and what is predicted of that.
std::string csv_of(const Robot& robot, const JointMotion& motion, const Eigen::MatrixXd& predicted, const Bands& bands,
                   const Samples& trained) {
  const AsRecorded measured_then = as_recorded(motion, motion.torque), predicted_then = as_recorded(motion, predicted);
  std::string s = "time_s";
  for (Index j = 0; j < predicted.rows(); ++j) {
    const char* unit = robot.regressor.is_slide(j) ? "n" : "nm";
    s += fmt::format(",torque_{0}_{1},predicted_{0}_{1},band_{0}_{1},temperature_{0}_degC,moving_{0}",
                     robot.regressor.joint_name(j), unit);
  }
  s += '\n';
  for (Index i = 0; i < motion.size(); ++i) {
    if (!predicted_then.known[static_cast<std::size_t>(i)]) continue;
    s += fmt::format("{:.9g}", motion.time_s[static_cast<std::size_t>(i)]);
    for (Index j = 0; j < predicted.rows(); ++j) {
      for (const double torque : {measured_then.torque(j, i), predicted_then.torque(j, i), bands.at(trained, j, i)})
        s += std::isnan(torque) ? "," : fmt::format(",{:.9g}", torque);
      s += fmt::format(",{:.7g},{:d}", motion.temperature_degC(j, i), motion.moving(j, i));
    }
    s += '\n';
  }
  return s;
}

/// Start temperatures of the files, per joint.
std::vector<double> start_of(const Arguments& a, const Robot& robot, const std::vector<thermal::Model>& models) {
  std::vector<double> start;
  for (const auto& m : models) start.push_back(m.T_amb_degC);
  if (a.start_degC.size() > 1 && a.start_degC.size() != start.size())
    throw InputError(fmt::format("--start: {} temperatures; give one, or one for each of the {} joints of {}",
                                 a.start_degC.size(), robot.regressor.joints(), a.model));
  for (std::size_t j = 0; j < start.size() && !a.start_degC.empty(); ++j)
    start[j] = a.start_degC[a.start_degC.size() == 1 ? 0 : j];
  return start;
}

std::string wrench_csv_of(const Arguments& a, const Robot& robot, const JointMotion& motion,
                          const Eigen::MatrixXd& predicted) {
  const auto found = external_wrench(*robot.model, a.site, motion, predicted);
  if (!found) throw InputError(fmt::format("--site: {} {}", a.model, found.error().message));
  const Eigen::MatrixXd& wrench = *found;
  std::string s = "time_s,force_x_n,force_y_n,force_z_n,torque_x_nm,torque_y_nm,torque_z_nm\n";
  for (Index i = 0; i < motion.size(); ++i) {
    s += fmt::format("{:.9g}", motion.time_s[static_cast<std::size_t>(i)]);
    for (Index k = 0; k < wrench.rows(); ++k)
      s += std::isnan(wrench(k, i)) ? "," : fmt::format(",{:.6g}", wrench(k, i));
    s += '\n';
  }
  return s;
}

/// Per joint, why its prediction has no error; "": it has one.
std::vector<std::string> lacking_of(const DynamicsFile& file, const JointMotion& motion) {
  std::vector<std::string> out;
  for (std::size_t j = 0; j < file.left_out.size(); ++j)
    out.push_back(!file.left_out[j].empty()                   ? "not identified: " + file.left_out[j]
                  : motion.is_left_out(static_cast<Index>(j)) ? "torque not recorded"
                                                              : "");
  return out;
}

/// Takes back predictions of joints whose friction is not known. No wrench without the torque of every joint.
void blank(const Arguments& a, const Robot& robot, const DynamicsFile& file, const std::vector<std::string>& lacking,
           Eigen::MatrixXd& predicted) {
  for (std::size_t j = 0; j < lacking.size(); ++j) {
    if (!file.left_out[j].empty()) predicted.row(static_cast<Index>(j)).setConstant(std::nan(""));
    if (!a.wrench.empty() && !lacking[j].empty())
      throw InputError(fmt::format("--wrench needs the torque of every joint; {}: {}",
                                   robot.regressor.joint_name(static_cast<Index>(j)), lacking[j]));
  }
}

/// What is removed from the torques: by default what the fit's recordings had.
std::vector<double> lag_of(const Arguments& a, const Robot& robot, const DynamicsFile& file) {
  if (a.lag == std::vector<std::string>{"none"}) return {};
  if (a.lag != std::vector<std::string>{"file"}) return given_lags(a.lag, robot.regressor);
  if (!a.quiet && !file.signals.lag_s.empty())
    note(
        "torques are compared without the lag of the recordings that {} is from, and written with it; --lag none "
        "compares as recorded with a prediction that has none",
        a.parameters);
  return file.signals.lag_s;
}

/// As for the fit, unless --cutoff says another one.
Preparation preparation_of(const Arguments& a, const Robot& robot, const DynamicsFile& file) {
  Preparation p = a.preparation;
  if (p.cutoff_hz == 0) p.cutoff_hz = file.signals.cutoff_hz;
  p.recorded_velocity = file.signals.recorded_velocity;
  p.reversals = file.signals.reversals;
  p.turn_lead_s = file.signals.turn_lead_s;
  p.lag_s = lag_of(a, robot, file);
  p.still_joints = true;  // their friction is not predicted
  return p;
}

/// With the coupled motors of the fit, whatever the model's tendons say.
Robot loaded(const Arguments& a) {
  Robot robot = load_robot(a.model);
  auto motors = or_wrong_input(read_coupling(a.parameters, robot.regressor));
  return motors.empty() ? robot : with_motors(robot, std::move(motors), a.parameters + ": coupling");
}

/// Estimates the temperatures that the data lack, where the law needs them and PARAMS.yaml can. Returns whether they
/// are known.
bool take_temperatures(const Arguments& a, const Robot& robot, const DynamicsFile& file, const RobotFriction& friction,
                       const RobotParameters& parameters, JointMotion& motion) {
  const bool unknown = file.law->temperature_dependent && !motion.has_temperature,
             estimated = unknown && !file.thermal.empty();
  if (!a.start_degC.empty() && !estimated)
    throw InputError(
        fmt::format("--start: temperatures are not estimated; that takes data without temperature columns and {} by "
                    "dynamics --thermal",
                    a.parameters));
  if (estimated)
    estimate_temperatures(robot.regressor, robot.base, friction, parameters, file.thermal,
                          start_of(a, robot, file.thermal), motion, a.threads);
  if (unknown && !a.quiet)
    note("without temperature columns {}",
         estimated ? "temperatures are estimated from the motion, from the start of each file on"
                   : fmt::format("law '{}' is that of 20 degC", file.law->name));
  return motion.has_temperature || estimated;
}

/// With the drive gains of the fit and what the robot carries.
std::vector<RobotRecording> recordings_of(const Arguments& a, const Robot& robot, const DynamicsFile& file) {
  const auto payloads = known_payloads(a.payloads, a.data);
  auto recordings = read_recordings(robot, a.data, a.tables, a.quiet, file.drive_gains);
  carry(robot, payloads, recordings, a.quiet);
  return recordings;
}

RobotFriction friction_of(const Arguments& a, const Robot& robot, const DynamicsFile& file) {
  auto friction = robot_friction(*robot.model, robot.regressor, *file.law, file.directional, file.torque_max_nm);
  if (!friction) throw InputError(fmt::format("{}: {}", a.model, friction.error().message));
  for (std::size_t r = 0; r < friction->size(); ++r)
    if (file.by_position[r]) (*friction)[r].depend_on_position();
  return *std::move(friction);
}

Result<Exit> execute(const Arguments& a) {
  const Robot robot = loaded(a);
  const auto file = or_wrong_input(read_dynamics(a.parameters, robot.regressor, robot.base));
  const RobotFriction friction = friction_of(a, robot, file);
  JointMotion motion = prepared(robot, recordings_of(a, robot, file), preparation_of(a, robot, file), a.quiet);
  const RobotParameters& parameters = takes_consistent(a, file) ? file.consistent->parameters : file.parameters;
  const bool with_temperature = take_temperatures(a, robot, file, friction, parameters, motion);
  Eigen::MatrixXd predicted = predicted_torque(robot.regressor, robot.base, friction, parameters, motion, a.threads);
  const std::vector<std::string> lacking = lacking_of(file, motion);
  blank(a, robot, file, lacking, predicted);
  const std::string wrench_csv = a.wrench.empty() ? std::string() : wrench_csv_of(a, robot, motion, predicted);
  const Judgement judgement = judged(a, robot, file, parameters, motion, with_temperature, predicted);
  Json j{{"of", origin_of(a)}, {"joints", Json::object()}, {"bodies", bodies_of(a, file)}};
  TextTable table = table_of_errors();
  std::vector<std::string> warnings = warnings_of(a, robot, file, judgement);
  const Bands bands = bands_of(a, file, motion);
  double worst = 0;
  int moving = 0;
  for (Index joint = 0; joint < predicted.rows(); ++joint) {
    const auto& name = robot.regressor.joint_name(joint);
    const std::string unit = unit_of("Nm", robot.regressor.is_slide(joint));
    const auto [from_s, until_s] =
        a.window_s.empty() ? std::pair(-infinity, infinity) : std::pair(a.window_s[0], a.window_s[1]);
    const Error e = error_of(motion, predicted, bands, judgement, joint, from_s, until_s);
    const std::string& why = lacking[static_cast<std::size_t>(joint)];
    table.add(row_of(name, e, unit, outside_of(judgement.beyond, joint), why));
    if (!why.empty()) {
      j["joints"][name] = {{"lacking", why}, {"unit", unit}};
      continue;
    }
    if (e.samples == 0 && !a.window_s.empty())
      throw InputError(
          fmt::format("--interval: joint {} does not move from {:g} to {:g} s", name, a.window_s[0], a.window_s[1]));
    j["joints"][name] = json_of(e, unit, judgement.joints[static_cast<std::size_t>(joint)]);
    j["joints"][name]["training"] = training_of(judgement, joint);
    if (auto line = band_that_fails(robot.regressor, joint, e); !line.empty()) warnings.push_back(std::move(line));
    moving += e.samples > 0;
    if (e.samples > 0) worst = std::max(worst, e.share());
  }
  if (moving == 0 && a.wrench.empty())
    throw InputError(
        fmt::format("{}: the robot stands still: no joint moves, and friction at rest does not follow from the motion",
                    joined(a.data)));
  j["worst_relative_to_range"] = worst;
  std::ranges::move(late_torques(robot.regressor, a.data, lag_of_files(robot.regressor, motion, predicted), motion),
                    std::back_inserter(warnings));
  j.update(
      {{"bands_lacking", bands.lacking}, {"warnings", warnings}, {"badly_explained", warnings_of(judgement.joints)}});
  if (a.output.named())
    if (auto ok = deliver(csv_of(robot, motion, predicted, bands, judgement.trained), a.output); !ok) return ok;
  if (!a.wrench.empty())
    if (auto ok = deliver(wrench_csv, {a.wrench, a.output.force}); !ok) return ok;
  if (!a.quiet) {
    if (!bands.lacking.empty()) note("{}", bands.lacking);
    for (const auto& text : warnings) note("{}", text);
    for (const auto& text : warnings_of(judgement.joints)) note("{}", text);
  }
  return deliver(a.json ? dump_json(j, 2) + "\n"
                        : table.text() + words_of(a, file) + "\n" + table_of(judgement.joints));
}

}  // namespace

void add_predict(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand("predict",
                               "Predict the torques of a recorded motion from identified dynamics, and their error");
  c->add_option("MODEL", a->model, "MJCF model")->required();
  c->add_option("PARAMS", a->parameters, "PARAMS.yaml of tribotwin dynamics")->required();
  c->add_option("DATA", a->data, "Tables as for tribotwin dynamics")->required();
  c->add_option("--start", a->start_degC,
                "Where temperatures are estimated: at the start of each file [degC], one or one for each joint as A,B "
                "(default: that of rest)")
      ->delimiter(',')
      ->check(CLI::Range(-60.0, 250.0));
  c->add_option("--interval,--window", a->window_s,
                "First and last time_s whose errors count [s], as A,B; for records that start with a warm-up")
      ->delimiter(',')
      ->expected(2);
  add_payload(*c, a->payloads);
  a->tables.add_to(*c);
  a->tables.add_gear_ratio_to(*c);
  add_preparation(*c, a->preparation);
  c->add_option("--lag", a->lag,
                "How late torques were recorded behind positions: errors are counted without it, tables have it: file "
                "(as for the fit), none, or seconds, one for all joints or one each as A,B")
      ->delimiter(',')
      ->capture_default_str();
  a->output.add_to(*c,
                   "CSV to write: time_s, torque_JOINT_nm (as recorded at that time, filtered as for the fit), "
                   "predicted_JOINT_nm (as late), band_JOINT_nm (half the width of the 95 % band about it, in which 95 "
                   "% of recorded torques lie where robot and motion are as in the training; empty at rest, outside of "
                   "the training and where it is not known), temperature_JOINT_degC (recorded, estimated, or 20), "
                   "moving_JOINT");
  auto* wrench = c->add_option("--wrench", a->wrench,
                               "CSV to write: external force and torque at the tool, world axes; empty where "
                               "joints rest or the arm is singular");
  c->add_option("--site", a->site, "Site of the model at which force and torque act")
      ->needs(wrench)
      ->capture_default_str();
  c->add_option("--bodies", a->bodies,
                "consistent: the real bodies (positive masses and pseudo-inertias) that explain the training best; "
                "least_squares: base parameters as fitted, which may belong to no real bodies; auto: consistent unless "
                "the training contradicts every real body beyond doubt, or dynamics found that they predict worse")
      ->check(CLI::IsMember({"auto", "consistent", "least_squares"}))
      ->capture_default_str();
  c->add_option("--threads", a->threads, "Threads; they do not change the result")->check(CLI::Range(1, 256));
  c->add_flag("--json", a->json, "Print JSON instead of the table");
  c->add_flag("--quiet", a->quiet, "No notes");
  c->footer(
      "Example:\n  tribotwin run er3a_c60_day -o runs/day --set duration_s=120 --set telemetry_rate_hz=250\n  "
      "tribotwin export runs/day --recording -o recorded.csv\n  tribotwin dynamics er3a_c60 recorded.csv --friction "
      "polynomial -o robot.yaml\n  tribotwin predict er3a_c60 robot.yaml recorded.csv -o predicted.csv");
  c->callback([a, &code] {
    auto inputs = paths(a->data);
    inputs.insert(inputs.end(), {a->model, a->parameters});
    check(a->output, inputs);
    inputs.push_back(a->output.file);
    check({a->wrench, a->output.force}, inputs);
    code = or_throw(execute(*a));
  });
}

}  // namespace tribotwin::twin::program
