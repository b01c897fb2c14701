#include <algorithm>
#include <cmath>
#include <optional>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/twin/experiments/working_days/day_friction.hpp>
#include <tribotwin/twin/experiments/working_days/day_recording.hpp>
#include <tribotwin/twin/experiments/working_days/working_day.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/identification/rigid_body/temperature_estimator.hpp>
#include <tribotwin/twin/identification/samples/recording.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>
#include <tribotwin/twin/numerics/interpolation.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::repeatability {
namespace {

using namespace identification;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr double kept_hz = 60;  ///< samples per second of the fits: above the filter's band there is no information
/// Unit of temperature where only friction is measured: a kelvin reduces it by 1 %, a = -0.01 / K by definition.
constexpr double share_per_K = 0.01;
constexpr int rounds = 4;  ///< of friction over the day and the fit of all cycles in turn

Measured measured(const Estimate& e) { return {e.value, e.sigma}; }

std::vector<Measured> measured(const std::vector<Estimate>& estimates) {
  std::vector<Measured> out;
  for (const auto& e : estimates) out.push_back(measured(e));
  return out;
}

std::vector<std::vector<Measured>> torques_of(const std::vector<std::vector<Estimate>>& friction) {
  std::vector<std::vector<Measured>> out;
  for (const auto& joint : friction) out.push_back(measured({joint.begin(), joint.begin() + torque_parameters}));
  return out;
}

/// A cycle's sections, prepared.
struct Sections {
  JointMotion measuring, heating;
};

/// Sets the temperatures of joint j in the recordings by Pagani's Algorithm 1, sample by sample, as a joint may warm
/// up within seconds.
void set_temperatures(TemperatureEstimator joint, std::size_t j, const std::vector<Sections>& sections,
                      std::vector<Recorded>& recorded) {
  const auto row = static_cast<Index>(j);
  for (std::size_t k = 0; k < recorded.size(); ++k) {
    std::vector<double> temperature;
    for (const JointMotion* motion : {&sections[k].measuring, &sections[k].heating}) {
      for (std::size_t s = 0; s < motion->segments.size(); ++s) {
        const auto [first, past] = motion->segments[s];
        joint.update(motion->qd(row, first), 0, motion->edge_s[s]);
        for (Index i = first; i < past; ++i) {
          if (motion == &sections[k].measuring) temperature.push_back(joint.temperature_degC());
          const auto now = static_cast<std::size_t>(i);
          joint.update(motion->qd(row, i), 0,
                       i + 1 < past ? motion->time_s[now + 1] - motion->time_s[now] : motion->edge_s[s]);
        }
      }
    }
    auto& r = recorded[k].measuring;
    for (std::size_t i = 0; i < r.time_s.size(); ++i)
      r.temperature_degC(row, static_cast<Index>(i)) =
          between_samples(sections[k].measuring.time_s, temperature, r.time_s[i]);
  }
}

/// The thermal model of every joint from its warming, and with it the temperatures of the recordings.
Result<void> set_all_temperatures(std::vector<Recorded>& recorded, const std::vector<Sections>& sections,
                                  const std::vector<Warming>& warming, const RobotFriction& law,
                                  const RobotParameters& reference) {
  for (auto& r : recorded) r.measuring.temperature_degC.resizeLike(r.measuring.position);
  for (std::size_t j = 0; j < warming.size(); ++j) {
    const HeatSession session = as_heat(warming[j], 0, rises(warming[j]));
    const auto fit = fit_thermal({&session, 1}, {.rested = true});
    if (!fit) return work_failed(fmt::format("joint {}: {}", j + 1, fit.error().message));
    // In its units T_amb is the friction at the start of the day, with the sign of as_heat.
    thermal::Model model = fit->model;
    for (double& gain : model.gain_K_J) gain /= -share_per_K * model.T_amb_degC;
    model.T_amb_degC = reference_degC;
    std::vector<double> parameters = reference.friction[j];
    parameters[torque_parameters] = -share_per_K;
    parameters[torque_parameters + 1] = reference_degC;
    set_temperatures(TemperatureEstimator(law[j], parameters, model, reference_degC), j, sections, recorded);
  }
  return {};
}

Stretch stretch_of(const JointMotion& motion, const MatrixXd& predicted, double length_s) {
  Stretch s;
  s.measured_nm.resize(static_cast<std::size_t>(predicted.rows()));
  s.predicted_nm.resize(s.measured_nm.size());
  s.moving.resize(s.measured_nm.size());
  for (Index i = 0; i < motion.size() && motion.time_s[static_cast<std::size_t>(i)] < motion.time_s.front() + length_s;
       ++i) {
    s.time_s.push_back(motion.time_s[static_cast<std::size_t>(i)]);
    for (std::size_t j = 0; j < s.measured_nm.size(); ++j) {
      s.measured_nm[j].push_back(motion.torque(static_cast<Index>(j), i));
      s.predicted_nm[j].push_back(predicted(static_cast<Index>(j), i));
      s.moving[j].push_back(motion.moving(static_cast<Index>(j), i));
    }
  }
  return s;
}

/// The identification of a test, step by step as in working_day.hpp.
class Test {
 public:
  Test(const Campaign& c, const Excitation& e, std::size_t test)
      : c_(c),
        e_(e),
        test_(test),
        preparation_{.decimation = static_cast<unsigned>(std::max(1.0, std::round(c.sampling_hz / kept_hz)))} {}

  Result<WorkingDay> run() && {
    if (auto ok = record(); !ok) return fail(ok.error());
    if (auto ok = identify_cycles(); !ok) return fail(ok.error());
    const auto fit = identify_day();
    if (!fit) return fail(fit.error());
    day_.base = measured(fit->base);
    day_.friction = torques_of(fit->friction);
    compare_with_robot();
    for (const auto& [part, out] : {std::pair{&measuring_.front(), &day_.cold}, {&measuring_.back(), &day_.hot}}) {
      const auto shown = prepared(*part);
      if (!shown) return fail(shown.error());
      *out = stretch_of(*shown, predicted_torque(*regressor_, base_, law_, fit->parameters, *shown, 1),
                        c_.excitation.period_s);
    }
    return std::move(day_);
  }

 private:
  tl::unexpected<Error> fail(const Error& why) const {
    return work_failed(fmt::format("robot {}, day {}: {}", c_.robot_of(test_) + 1, c_.day_of(test_) + 1, why.message));
  }
  std::size_t joints() const { return static_cast<std::size_t>(regressor_->joints()); }
  Result<JointMotion> prepared(const RobotRecording& r) const { return prepare({&r, 1}, *regressor_, preparation_); }

  /// Draws the robot and simulates its day. The owner knows the geometry of the type, but not the masses of this robot.
  Result<void> record() {
    auto robot = individual(c_, c_.robot_of(test_));
    if (!robot) return tl::unexpected(robot.error());
    robot_ = *std::move(robot);
    auto regressor = Regressor::create(c_.model->get());
    if (!regressor) return tl::unexpected(regressor.error());
    regressor_.emplace(*std::move(regressor));
    base_ = base_parameters(*regressor_);
    auto law = robot_friction(*c_.model, *regressor_, law_of_days(), {});
    if (!law) return tl::unexpected(law.error());
    law_ = *std::move(law);
    day_.ambient_degC = ambient_degC(c_, c_.day_of(test_));
    auto recorded = simulated(c_, e_, test_, robot_, day_.ambient_degC, *regressor_);
    if (!recorded) return tl::unexpected(recorded.error());
    recorded_ = std::move(recorded->cycles);
    day_.warnings = std::move(recorded->warnings);
    return {};
  }

  /// Step 1: each cycle by itself. The reference has the mean of their parameters, inertial ones weighted.
  Result<void> identify_cycles() {
    MatrixXd information = MatrixXd::Zero(base_.size(), base_.size());
    VectorXd weighted = VectorXd::Zero(base_.size());
    reference_.friction.assign(joints(), std::vector<double>(static_cast<std::size_t>(law_.front().size()), 0.0));
    for (const auto& r : recorded_) {
      auto during = prepared(r.measuring), after = prepared(r.heating);
      if (!during || !after) return tl::unexpected(during ? after.error() : during.error());
      const auto fit = fit_dynamics(*regressor_, base_, law_, *during, {.threads = 1});
      if (!fit) return tl::unexpected(fit.error());
      day_.cycles.push_back({.start_s = r.measuring.time_s.front(),
                             .base = measured(fit->base),
                             .friction = torques_of(fit->friction),
                             .level_nm = {}});
      sections_.push_back({std::move(*during), std::move(*after)});
      information += fit->information;
      weighted += fit->information * fit->parameters.base;
      for (std::size_t j = 0; j < joints(); ++j)
        for (std::size_t p = 0; p < torque_parameters; ++p)
          reference_.friction[j][p] += fit->parameters.friction[j][p] / static_cast<double>(recorded_.size());
    }
    reference_.base = symmetric_solution(information, weighted);
    return {};
  }

  /// Step 2: friction over the day, by the reference.
  void measure_friction() {
    DayFriction friction(*regressor_, base_, law_, reference_,
                         level_share * motion_limits(*c_.model, *regressor_, 1).speed);
    for (std::size_t k = 0; k < sections_.size(); ++k) {
      day_.cycles[k].level_nm = friction.add(sections_[k].measuring, day_.cycles[k].start_s + e_.inertia_s);
      friction.add(sections_[k].heating, 0);
    }
    day_.warming = friction.warming();
  }

  /// Steps 2 and 3 in turn: friction curves of single cycles, in which a joint warms up from slow passes to fast ones,
  /// have the wrong shape.
  Result<DynamicsFit> identify_day() {
    Result<DynamicsFit> fit;
    for (int round = 0;; ++round) {
      measure_friction();
      if (round == rounds) return fit;
      if (auto ok = set_all_temperatures(recorded_, sections_, day_.warming, law_, reference_); !ok)
        return tl::unexpected(ok.error());
      measuring_.clear();
      for (const auto& r : recorded_) measuring_.push_back(r.measuring);
      const auto motion = prepare(measuring_, *regressor_, preparation_);
      if (!motion) return tl::unexpected(motion.error());
      fit = fit_dynamics(*regressor_, base_, law_, *motion, {.threads = 1});
      if (!fit) return fit;
      reference_ = fit->parameters;
      for (auto& joint : reference_.friction) joint[torque_parameters] = 0;  // the curve at the start of the day
    }
  }

  /// The true parameters of the simulated robot.
  void compare_with_robot() {
    const VectorXd truth = base_.from_all * Regressor::create(robot_.model->get())->model_parameters();
    day_.base_of_robot.assign(truth.begin(), truth.end());
    const auto drives = c_.model->drives();
    for (std::size_t j = 0; j < joints(); ++j) {
      auto& of_robot = day_.friction_of_robot.emplace_back();
      const auto drive = std::ranges::find(drives, static_cast<int>(j), &mujoco::Binding::dof);
      const auto f = drive->drive.law.values();
      for (std::size_t p = 0; p < torque_parameters; ++p)
        of_robot.push_back(f[p] * robot_.friction[static_cast<std::size_t>(drive - drives.begin())] *
                           (1 + f[torque_parameters] * (day_.ambient_degC - f[torque_parameters + 1])));
    }
  }

  const Campaign& c_;
  const Excitation& e_;
  const std::size_t test_;
  const Preparation preparation_;
  Individual robot_;
  std::optional<Regressor> regressor_;
  BaseParameters base_;
  RobotFriction law_;
  std::vector<Recorded> recorded_;
  std::vector<Sections> sections_;  ///< per cycle
  std::vector<RobotRecording> measuring_;
  RobotParameters reference_;
  WorkingDay day_;
};

}  // namespace

bool rises(const Warming& w) { return w.friction_nm.back() > w.friction_nm.front(); }

HeatSession as_heat(const Warming& w, std::size_t file, bool rising) {
  HeatSession out{
      .file = file, .time_s = w.time_s, .power_w = w.power_w, .temperature_degC = w.friction_nm, .start_s = 0};
  if (!rising)
    for (double& T : out.temperature_degC) T = -T;
  return out;
}

Result<WorkingDay> working_day(const Campaign& c, const Excitation& e, std::size_t test) {
  return Test(c, e, test).run();
}

}  // namespace tribotwin::twin::repeatability
