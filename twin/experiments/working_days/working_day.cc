#include <algorithm>
#include <cmath>
#include <functional>

#include <Eigen/Dense>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/experiments/working_days/working_day.hpp>
#include <tribotwin/twin/identification/curves/recording.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/identification/rigid_body/temperature_estimator.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>
#include <tribotwin/twin/io/json_input.hpp>
#include <tribotwin/twin/numerics/correlation.hpp>
#include <tribotwin/twin/numerics/interpolation.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

namespace tribotwin::twin::repeatability {
namespace {

using namespace identification;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr std::uint64_t of_sensors = 100;  ///< purpose of the seed
constexpr double kept_hz = 60;      ///< samples per second of the fits: beyond the filter's band they tell little
constexpr double window_s = 3;      ///< of one value of friction over the day
constexpr double fewest_s = 1;      ///< of motion in such a window
constexpr std::size_t torques = 4;  ///< f1 .. f4; a and T0 follow them
/// Where only friction is seen, a kelvin is what takes 1 % of it: a = -0.01 / K by definition.
constexpr double share_per_K = 0.01;
constexpr int rounds = 4;              ///< of friction over the day and the fit of all cycles, each given the other
constexpr double reference_degC = 20;  ///< T0 of the law, at the start of the day

/// The excitation and the way back to its start, for ever.
Motion cycle_of(const Campaign& c, const Regressor& regressor, const Excitation& e) {
  const auto joints = static_cast<std::size_t>(regressor.joints());
  std::vector<SetPoint> points(joints);
  const auto split = [&](double time_s) {
    e.at(time_s, points);
    std::pair<std::vector<double>, std::vector<double>> out;
    for (const auto& p : points) out.first.push_back(p.position_rad), out.second.push_back(p.velocity_rad_s);
    return out;
  };
  const std::vector<double> start = split(0).first;
  Motion motion(start);
  const auto pieces = static_cast<int>(std::ceil(e.inertia_s * 250));
  for (int i = 1; i < pieces; ++i) {
    auto [q, qd] = split(e.inertia_s * i / pieces);
    motion.pass_through(e.inertia_s * i / pieces, std::move(q), std::move(qd));
  }
  motion.pass_through(e.inertia_s, start, std::vector<double>(joints, 0.0)).then(e.rest);
  const MotionLimits limits = motion_limits(*c.model, regressor, c.excitation.share);
  const VectorXd approach = 0.3 * limits.speed;
  const auto values = [](const VectorXd& v) {
    return std::span<const double>(v.data(), static_cast<std::size_t>(v.size()));
  };
  return motion.dwell(0.3)
      .move_to(start, values(approach), values(limits.acceleration))
      .dwell(0.5)
      .repeat((*c.model)->opt.timestep);
}

/// What the controller recorded of a cycle.
struct Recorded {
  RobotRecording measuring;  ///< sections of inertia and friction
  RobotRecording heating;
};

RobotRecording part_of(const std::vector<JointRecording>& joints, std::size_t first, std::size_t past) {
  RobotRecording r;
  const auto& time = joints.front().time_s;
  r.time_s.assign(time.begin() + static_cast<std::ptrdiff_t>(first), time.begin() + static_cast<std::ptrdiff_t>(past));
  r.position.resize(static_cast<Index>(joints.size()), static_cast<Index>(past - first));
  r.torque.resizeLike(r.position);
  for (std::size_t j = 0; j < joints.size(); ++j)
    for (std::size_t i = first; i < past; ++i) {
      r.position(static_cast<Index>(j), static_cast<Index>(i - first)) = joints[j].position_rad[i];
      r.torque(static_cast<Index>(j), static_cast<Index>(i - first)) = joints[j].torque_nm[i];
    }
  return r;
}

Result<std::vector<Recorded>> simulated(const Campaign& c, const Excitation& e, std::size_t test,
                                        const Individual& robot, double ambient, const Regressor& regressor) {
  Scenario s;
  s.model = robot.model;
  s.ambient_degC = ambient;
  s.motion = cycle_of(c, regressor, e);
  s.duration_s = c.duration_s;
  s.start_rad.assign(s.motion->start_rad().begin(), s.motion->start_rad().end());
  s.temperature_degC.assign(robot.friction.size(), ambient);
  s.control = CascadedOptions{};
  const auto drives = robot.model->drives();
  // Wear replaces earlier wear, so that a fault's factors come on top of what the robot is.
  for (std::size_t i = 0; i < drives.size(); ++i) {
    Wear own{.joint = joint_name(robot.model->get(), drives[i])};
    for (std::size_t p = 0; p < torques; ++p)
      own.factors[std::string(drives[i].drive.law.info->parameters[p].name)] = robot.friction[i];
    s.events.push_back({0, own});
    for (const Fault& fault : c.faults) {
      if (fault.robot != c.robot_of(test) || fault.day != c.day_of(test) || fault.wear.joint != own.joint) continue;
      Wear broken = own;
      for (const auto& [name, factor] : fault.wear.factors)
        broken.factors.try_emplace(name, 1.0).first->second *= factor;
      s.events.push_back({fault.time_s, broken});
    }
  }
  std::ranges::stable_sort(s.events, {}, &Event::time_s);

  const double dt = (*robot.model)->opt.timestep, period = s.motion->period_s();
  const auto cycles = static_cast<std::size_t>(c.duration_s / period + 1e-9);
  if (cycles < 1)
    return tl::unexpected(
        fmt::format("duration_s {:g} is shorter than a cycle of the motion, {:.0f} s", c.duration_s, period));
  const auto steps = std::llround(period / dt), every = std::max(1LL, std::llround(1 / (c.sampling_hz * dt)));
  Sensors sensors{.encoder_increments_per_turn = c.encoder_increments_per_turn,
                  .sampling_hz = 1 / (static_cast<double>(every) * dt)};
  Twin twin(s);
  std::vector<Recorded> out;
  for (std::size_t k = 0; k < cycles; ++k) {
    std::vector<JointRecording> signals(drives.size());
    for (long long i = 0; i < steps; ++i) {
      const double time = twin.time_s();
      if (auto ok = twin.step(); !ok) return tl::unexpected(ok.error());
      if (i % every) continue;
      for (std::size_t j = 0; j < drives.size(); ++j) {
        signals[j].time_s.push_back(time);
        signals[j].position_rad.push_back(twin.position_rad(j));
        signals[j].torque_nm.push_back(twin.drive(j).torque_nm);
      }
    }
    for (std::size_t j = 0; j < drives.size(); ++j) {
      sensors.torque_noise_nm = c.torque_noise_share * drives[j].drive.torque_max_nm;
      signals[j] = sensed(signals[j], sensors, seed_for(c, of_sensors + test, k * drives.size() + j));
    }
    const auto& time = signals.front().time_s;
    const auto heating =
        static_cast<std::size_t>(std::ranges::lower_bound(time, time.front() + e.friction_s) - time.begin());
    out.push_back({part_of(signals, 0, heating), part_of(signals, heating, time.size())});
  }
  return out;
}

Measured measured(const Estimate& e) { return {e.value, e.sigma}; }

std::vector<Measured> measured(const std::vector<Estimate>& estimates) {
  std::vector<Measured> out;
  for (const auto& e : estimates) out.push_back(measured(e));
  return out;
}

std::vector<std::vector<Measured>> torques_of(const std::vector<std::vector<Estimate>>& friction) {
  std::vector<std::vector<Measured>> out;
  for (const auto& joint : friction) out.push_back(measured({joint.begin(), joint.begin() + torques}));
  return out;
}

/// Friction of all joints over the day: what rigid dynamics leave of the motors' torques.
class Friction {
 public:
  /// `reference`: per joint, a friction curve of which the present one is a multiple.
  Friction(const Regressor& regressor, const BaseParameters& base, const RobotFriction& law, RobotParameters reference,
           const VectorXd& level_speed)
      : regressor_(regressor),
        base_(base),
        law_(law),
        reference_(std::move(reference)),
        rigid_(reference_),
        points_(static_cast<std::size_t>(regressor.joints())) {
    for (auto& joint : rigid_.friction) std::ranges::fill(joint, 0.0);
    for (Index j = 0; j < regressor.joints(); ++j) level_nm_.push_back(curve(j, level_speed(j)));
  }

  /// Takes in what came next. Returns each joint's friction at the level speed, from samples after `from_s` in which it
  /// moves.
  std::vector<Measured> add(const JointMotion& motion, double from_s) {
    const MatrixXd rest = motion.torque - predicted_torque(regressor_, base_, law_, rigid_, motion, 1);
    std::vector<Measured> out;
    for (Index j = 0; j < rest.rows(); ++j) {
      std::vector<double> at, shape, torque;
      for (const auto& [first, past] : motion.segments) window(motion, rest, j, first, past);
      for (Index i = 0; i < motion.size(); ++i)
        if (motion.moving(j, i) && motion.time_s[static_cast<std::size_t>(i)] >= from_s)
          shape.push_back(curve(j, motion.qd(j, i))), torque.push_back(rest(j, i));
      const Eigen::Map<const VectorXd> f(shape.data(), static_cast<Index>(shape.size())), u(torque.data(), f.size());
      const double scale = f.dot(u) / f.squaredNorm(), level = level_nm_[static_cast<std::size_t>(j)];
      const VectorXd residual = u - scale * f;
      const double variance = residual.squaredNorm() / static_cast<double>(residual.size()) *
                              samples_per_independent({residual.data(), static_cast<std::size_t>(residual.size())});
      out.push_back({scale * level, std::sqrt(variance / f.squaredNorm()) * level});
    }
    return out;
  }

  std::vector<Warming> warming() const {
    std::vector<Warming> out(points_.size());
    for (std::size_t j = 0; j < points_.size(); ++j) {
      double work = 0;
      for (const auto& p : points_[j].kept) {
        out[j].power_w.push_back((p.work_J - work) / (p.time_s - (out[j].time_s.empty() ? 0 : out[j].time_s.back())));
        out[j].time_s.push_back(p.time_s);
        out[j].friction_nm.push_back(p.friction_nm);
        work = p.work_J;
      }
    }
    return out;
  }

 private:
  struct Point {
    double time_s, work_J, friction_nm;
  };
  struct Points {
    double work_J = 0;  ///< of friction since the start of the day
    std::vector<Point> kept;
  };

  double curve(Index j, double speed) const {
    const auto at = static_cast<std::size_t>(j);
    return speed == 0 ? 0 : law_[at].torque(reference_.friction[at], speed, 0, reference_degC);
  }

  /// Stretches of window_s: friction at their mean time of motion, and the work done until then.
  void window(const JointMotion& motion, const MatrixXd& rest, Index j, Index first, Index past) {
    Points& points = points_[static_cast<std::size_t>(j)];
    const auto time = [&](Index i) { return motion.time_s[static_cast<std::size_t>(i)]; };
    for (Index begin = first; begin < past;) {
      double cross = 0, own = 0, count = 0, moved_at = 0, work_at = 0;
      Index i = begin;
      for (; i < past && time(i) < time(begin) + window_s; ++i) {
        if (i > first) points.work_J += rest(j, i) * motion.qd(j, i) * (time(i) - time(i - 1));
        if (!motion.moving(j, i)) continue;
        const double f = curve(j, motion.qd(j, i));
        cross += f * rest(j, i), own += f * f, ++count, moved_at += time(i), work_at += points.work_J;
      }
      if (count * motion.period_s >= fewest_s)
        points.kept.push_back(
            {moved_at / count, work_at / count, cross / own * level_nm_[static_cast<std::size_t>(j)]});
      begin = i;
    }
  }

  const Regressor& regressor_;
  const BaseParameters& base_;
  const RobotFriction& law_;
  RobotParameters reference_, rigid_;
  std::vector<double> level_nm_;
  std::vector<Points> points_;
};

/// A cycle's sections, prepared.
struct Sections {
  JointMotion measuring, heating;
};

/// Gives the recordings the temperatures of each joint's thermal model, in units of share_per_K: those of paper 5's
/// Algorithm 1, sample by sample, for a joint that warms up within seconds is not as warm at both ends of a window.
Result<void> take_temperature(std::vector<Recorded>& recorded, const std::vector<Sections>& sections,
                              const std::vector<Warming>& warming, const RobotFriction& law,
                              const RobotParameters& reference) {
  for (auto& r : recorded) r.measuring.temperature_degC.resizeLike(r.measuring.position);
  for (std::size_t j = 0; j < warming.size(); ++j) {
    const HeatSession session = as_heat(warming[j], 0, rises(warming[j]));
    const auto fit = fit_thermal({&session, 1}, {.rested = true});
    if (!fit) return tl::unexpected(fmt::format("joint {}: {}", j + 1, fit.error().message));
    // In its units T_amb is, as_heat's sign included, the friction at the start of the day.
    thermal::Model model = fit->model;
    for (double& gain : model.gain_K_J) gain /= -share_per_K * model.T_amb_degC;
    model.T_amb_degC = reference_degC;
    std::vector<double> parameters = reference.friction[j];
    parameters[torques] = -share_per_K;
    parameters[torques + 1] = reference_degC;
    TemperatureEstimator joint(law[j], parameters, model, reference_degC);
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

std::string name_of(const Campaign& c, std::size_t test) {
  return fmt::format("robot {}, day {}", c.robot_of(test) + 1, c.day_of(test) + 1);
}

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
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(fmt::format("{}: {}", name_of(c, test), why));
  };
  const auto robot = individual(c, c.robot_of(test));
  if (!robot) return fail(robot.error().message);
  // The owner knows the type: its geometry, not the masses of this robot.
  const auto regressor = Regressor::create(c.model->get()), own = Regressor::create(robot->model->get());
  if (!regressor || !own) return fail(regressor ? own.error().message : regressor.error().message);
  const BaseParameters base = base_parameters(*regressor);
  const auto law = robot_friction(*c.model, *regressor, *friction::find_law("polynomial"));
  if (!law) return fail(law.error().message);
  const auto joints = static_cast<std::size_t>(regressor->joints());

  WorkingDay day{.ambient_degC = ambient_degC(c, c.day_of(test))};
  auto recorded = simulated(c, e, test, *robot, day.ambient_degC, *regressor);
  if (!recorded) return fail(recorded.error().message);
  const Preparation preparation{.decimation =
                                    static_cast<unsigned>(std::max(1.0, std::round(c.sampling_hz / kept_hz)))};
  const auto prepared = [&](const RobotRecording& r) { return prepare({&r, 1}, *regressor, preparation); };

  // 1
  MatrixXd information = MatrixXd::Zero(base.size(), base.size());
  VectorXd weighted = VectorXd::Zero(base.size());
  RobotParameters reference{.base = {},
                            .friction = std::vector<std::vector<double>>(
                                joints, std::vector<double>(law->front().law().parameters.size(), 0.0))};
  std::vector<Sections> sections;
  for (const auto& r : *recorded) {
    auto during = prepared(r.measuring), after = prepared(r.heating);
    if (!during || !after) return fail(during ? after.error().message : during.error().message);
    const auto fit = fit_dynamics(*regressor, base, *law, *during, {.threads = 1});
    if (!fit) return fail(fit.error().message);
    day.cycles.push_back({.start_s = r.measuring.time_s.front(),
                          .base = measured(fit->base),
                          .friction = torques_of(fit->friction),
                          .level_nm = {}});
    sections.push_back({std::move(*during), std::move(*after)});
    information += fit->information;
    weighted += fit->information * fit->parameters.base;
    for (std::size_t j = 0; j < joints; ++j)
      for (std::size_t p = 0; p < torques; ++p)
        reference.friction[j][p] += fit->parameters.friction[j][p] / static_cast<double>(recorded->size());
  }
  reference.base = information.ldlt().solve(weighted);

  // 2 and 3, in turn: friction curves of single cycles, in which a joint warms up from slow passes to fast ones, have
  // the wrong shape.
  Result<DynamicsFit> fit;
  std::vector<RobotRecording> measuring;
  for (int round = 0;; ++round) {
    Friction friction(*regressor, base, *law, reference, level_share * motion_limits(*c.model, *regressor, 1).speed);
    for (std::size_t k = 0; k < sections.size(); ++k) {
      day.cycles[k].level_nm = friction.add(sections[k].measuring, day.cycles[k].start_s + e.inertia_s);
      friction.add(sections[k].heating, 0);
    }
    day.warming = friction.warming();
    if (round == rounds) break;
    if (auto ok = take_temperature(*recorded, sections, day.warming, *law, reference); !ok)
      return fail(ok.error().message);
    measuring.clear();
    for (const auto& r : *recorded) measuring.push_back(r.measuring);
    const auto motion = prepare(measuring, *regressor, preparation);
    if (!motion) return fail(motion.error().message);
    fit = fit_dynamics(*regressor, base, *law, *motion, {.threads = 1});
    if (!fit) return fail(fit.error().message);
    reference = fit->parameters;
    for (auto& joint : reference.friction) joint[torques] = 0;  // the curve at the start of the day
  }
  day.base = measured(fit->base);
  day.friction = torques_of(fit->friction);
  const VectorXd truth = base.from_all * own->model_parameters();
  day.base_of_robot.assign(truth.begin(), truth.end());
  for (std::size_t j = 0; j < joints; ++j) {
    auto& of_robot = day.friction_of_robot.emplace_back();
    const auto drive = std::ranges::find(c.model->drives(), static_cast<int>(j), &mujoco::Binding::dof);
    const auto f = drive->drive.law.values();
    for (std::size_t p = 0; p < torques; ++p)
      of_robot.push_back(f[p] * robot->friction[static_cast<std::size_t>(drive - c.model->drives().begin())] *
                         (1 + f[torques] * (day.ambient_degC - f[torques + 1])));
  }
  for (const auto& [part, out] : {std::pair{&measuring.front(), &day.cold}, {&measuring.back(), &day.hot}}) {
    const auto shown = prepared(*part);
    if (!shown) return fail(shown.error().message);
    *out =
        stretch_of(*shown, predicted_torque(*regressor, base, *law, fit->parameters, *shown, 1), c.excitation.period_s);
  }
  return day;
}

// ---- As text.

using Json = nlohmann::json;

void to_json(Json& j, const Measured& m) { j = {m.value, std::isfinite(m.sigma) ? Json(m.sigma) : Json(nullptr)}; }
void to_json(Json& j, const Cycle& c) {
  j = {{"start_s", c.start_s}, {"base", c.base}, {"friction", c.friction}, {"level_nm", c.level_nm}};
}
void to_json(Json& j, const Warming& w) {
  j = {{"time_s", w.time_s}, {"power_w", w.power_w}, {"friction_nm", w.friction_nm}};
}
void to_json(Json& j, const Stretch& s) {
  j = {{"time_s", s.time_s}, {"measured_nm", s.measured_nm}, {"predicted_nm", s.predicted_nm}, {"moving", s.moving}};
}
void to_json(Json& j, const WorkingDay& d) {
  j = {{"ambient_degC", d.ambient_degC},
       {"cycles", d.cycles},
       {"warming", d.warming},
       {"base", d.base},
       {"friction", d.friction},
       {"base_of_robot", d.base_of_robot},
       {"friction_of_robot", d.friction_of_robot},
       {"cold", d.cold},
       {"hot", d.hot}};
}

std::string to_text(const WorkingDay& day) { return Json(day).dump() + "\n"; }

namespace {

constexpr Bounds times_s{0, 1e9};

Measured measured_of(const JsonInput& in) {
  const auto pair = in.list(2, 2);
  return {pair[0].number(), pair[1].number_or_null({0, 1e12})};
}

std::vector<Measured> measured_of(const JsonInput& in, std::size_t count) {
  std::vector<Measured> all;
  for (const auto& one : in.list(count, count)) all.push_back(measured_of(one));
  return all;
}

/// Of every joint, f1 .. f4.
std::vector<std::vector<Measured>> friction_of(const JsonInput& in, std::size_t joints) {
  std::vector<std::vector<Measured>> all;
  for (const auto& joint : in.list(joints, joints)) all.push_back(measured_of(joint, torques));
  return all;
}

std::vector<double> increasing(const JsonInput& in, std::size_t least) {
  auto all = in.numbers(least, static_cast<std::size_t>(-1), times_s);
  if (std::ranges::adjacent_find(all, std::greater_equal{}) != all.end()) in.fail("must increase from entry to entry");
  return all;
}

Warming warming_of(const JsonInput& in) {
  Warming w{.time_s = increasing(in["time_s"], 2)};
  w.power_w = in["power_w"].numbers(w.time_s.size(), w.time_s.size());
  w.friction_nm = in["friction_nm"].numbers(w.time_s.size(), w.time_s.size());
  return w;
}

Stretch stretch_of(const JsonInput& in, std::size_t joints) {
  Stretch s{.time_s = increasing(in["time_s"], 1)};
  const std::size_t n = s.time_s.size();
  for (const auto& joint : in["measured_nm"].list(joints, joints)) s.measured_nm.push_back(joint.numbers(n, n));
  for (const auto& joint : in["predicted_nm"].list(joints, joints)) s.predicted_nm.push_back(joint.numbers(n, n));
  for (const auto& joint : in["moving"].list(joints, joints)) {
    auto& of_joint = s.moving.emplace_back();
    for (const auto& one : joint.list(n, n)) of_joint.push_back(one.truth());
    if (std::ranges::find(of_joint, true) == of_joint.end())
      joint.fail("is false everywhere, but a joint that rests has no friction to predict");
  }
  return s;
}

WorkingDay day_of(const JsonInput& in, const Shape& shape) {
  WorkingDay day{.ambient_degC = in["ambient_degC"].number({-273.15, 1000})};
  for (const auto& cycle : in["cycles"].list(1))
    day.cycles.push_back({.start_s = cycle["start_s"].number(times_s),
                          .base = measured_of(cycle["base"], shape.base),
                          .friction = friction_of(cycle["friction"], shape.joints),
                          .level_nm = measured_of(cycle["level_nm"], shape.joints)});
  for (const auto& joint : in["warming"].list(shape.joints, shape.joints)) day.warming.push_back(warming_of(joint));
  day.base = measured_of(in["base"], shape.base);
  day.friction = friction_of(in["friction"], shape.joints);
  day.base_of_robot = in["base_of_robot"].numbers(shape.base, shape.base);
  for (const auto& joint : in["friction_of_robot"].list(shape.joints, shape.joints))
    day.friction_of_robot.push_back(joint.numbers(torques, torques));
  day.cold = stretch_of(in["cold"], shape.joints);
  day.hot = stretch_of(in["hot"], shape.joints);
  return day;
}

}  // namespace

Result<WorkingDay> from_text(const std::string& text, const Shape& shape) {
  const Json root = Json::parse(text, nullptr, false);
  if (root.is_discarded()) return tl::unexpected(std::string("is no well-formed JSON"));
  try {
    return day_of(JsonInput(root, ""), shape);
  } catch (const InputError& e) {
    return tl::unexpected(std::string(e.what()));
  }
}

}  // namespace tribotwin::twin::repeatability
