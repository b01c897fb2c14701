#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <set>

#include <fmt/format.h>

#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/cma_es.hpp>
#include <tribotwin/twin/numerics/d_optimal.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/excitation.hpp>

namespace tribotwin::twin {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Self-collision by MuJoCo's contacts. A robot drawn without contacts gets them for this; bodies that touch in the
/// reference pose, as neighbours do, are taken to be meant so.
class Collisions {
 public:
  Collisions(const mjModel* model, const VectorXd& reference)
      : model_(mj_copyModel(nullptr, model)), data_(mj_makeData(model_.get())) {
    mjModel* m = model_.get();
    bool own = false;
    for (int g = 0; g < m->ngeom; ++g)
      own |= m->body_weldid[m->geom_bodyid[g]] != 0 && (m->geom_contype[g] || m->geom_conaffinity[g]);
    for (int g = 0; g < m->ngeom && !own; ++g) m->geom_contype[g] = m->geom_conaffinity[g] = 1;
    touching(reference, [&](int a, int b) {
      meant_.insert({a, b});
      return false;
    });
  }

  /// The two bodies that touch in a pose.
  std::optional<std::string> at(const VectorXd& q) {
    std::optional<std::string> found;
    touching(q, [&](int a, int b) {
      if (meant_.contains({a, b})) return false;
      const auto name = [&](int body) {
        return std::string(mj_id2name(model_.get(), mjOBJ_BODY, body) ? mj_id2name(model_.get(), mjOBJ_BODY, body)
                                                                      : "a body");
      };
      found = fmt::format("{} and {}", name(a), name(b));
      return true;
    });
    return found;
  }

 private:
  template <class Found>
  void touching(const VectorXd& q, const Found& found) {
    mjData* d = data_.get();
    std::copy(q.begin(), q.end(), d->qpos);
    mj_kinematics(model_.get(), d);
    mj_comPos(model_.get(), d);
    mj_collision(model_.get(), d);
    for (int c = 0; c < d->ncon; ++c) {
      if (d->contact[c].dist > 0) continue;
      const int a = model_->geom_bodyid[d->contact[c].geom1], b = model_->geom_bodyid[d->contact[c].geom2];
      if (found(std::min(a, b), std::max(a, b))) return;
    }
  }

  mujoco::ModelPtr model_;
  mujoco::DataPtr data_;
  std::set<std::pair<int, int>> meant_;
};

VectorXd reference_pose(const mjModel* m, const MotionLimits& limits) {
  const mjtNum* q = m->nkey > 0 ? m->key_qpos : m->qpos0;
  return Eigen::Map<const VectorXd>(q, m->nq).cwiseMax(limits.low).cwiseMin(limits.high);
}

/// Torques and condition numbers of a motion.
class Judge {
 public:
  Judge(const mujoco::Model& model, const Regressor& regressor, const BaseParameters& base, const MotionLimits& limits)
      : regressor_(regressor),
        base_(base),
        limits_(limits),
        phi_(regressor.model_parameters()),
        columns_(base.size() + 2 * regressor.rotors()),
        collisions(model.get(), reference_pose(model.get(), limits)) {
    for (Index j = 0; j < regressor.joints(); ++j) {
      const auto drive = std::ranges::find(model.drives(), static_cast<int>(j), &mujoco::Binding::dof);
      drives_.push_back(drive == model.drives().end() ? nullptr : &*drive);
    }
    // Torques are counted in units of what the joint takes at random states within its limits; so are columns.
    Gaussian gaussian(3);
    const Index n = regressor.joints();
    constexpr int states = 200;
    unit_.setZero(n);
    std::vector<MatrixXd> Ys;
    for (int s = 0; s < states; ++s) {
      const auto within = [&](const VectorXd& low, const VectorXd& high) -> VectorXd {
        return low + gaussian(n)
                         .unaryExpr([](double z) { return 0.5 * std::erfc(-z / std::numbers::sqrt2); })
                         .cwiseProduct(high - low);
      };
      const VectorXd q = within(limits.low, limits.high), qd = within(-limits.speed, limits.speed),
                     qdd = within(-limits.acceleration, limits.acceleration);
      unit_ += (regressor_.at(q, qd, qdd) * phi_).cwiseAbs2();
      Ys.push_back(rows(qd));
    }
    unit_ = (unit_ / states).cwiseSqrt().cwiseMax(1e-9);
    column_.setZero(columns_);
    for (const auto& Y : Ys) column_ += (unit_.cwiseInverse().asDiagonal() * Y).colwise().squaredNorm();
    column_ = (column_ / states).cwiseSqrt();
  }

  /// How far beyond its limit the torque of a state is, as a share of the limit; below 0 within.
  double torque_excess(const VectorXd& q, const VectorXd& qd, const VectorXd& qdd) {
    const VectorXd rigid = regressor_.at(q, qd, qdd) * phi_;
    double worst = -1;
    for (Index j = 0; j < rigid.size(); ++j) {
      double torque = rigid(j);
      if (const auto* d = drives_[static_cast<std::size_t>(j)])
        torque += mujoco::resistance_nm(d->drive, qd(j), std::abs(rigid(j)) / d->drive.torque_max_nm,
                                        d->drive.thermal.T_amb_degC);
      worst = std::max(worst, std::abs(torque) / limits_.torque(j) - 1);
    }
    return worst;
  }

  void begin() { gram_.setZero(columns_, columns_); }
  /// Adds the state that torque_excess was asked for last.
  void add(const VectorXd& qd) {
    const MatrixXd Y = unit_.cwiseInverse().asDiagonal() * rows(qd) * column_.cwiseInverse().asDiagonal();
    gram_.selfadjointView<Eigen::Lower>().rankUpdate(Y.transpose());
  }
  double condition_number() const {
    const VectorXd eigenvalues = symmetric_eigenvalues(gram_);
    return std::sqrt(eigenvalues(columns_ - 1) / std::max(eigenvalues(0), 1e-15 * eigenvalues(columns_ - 1)));
  }

 private:
  /// Base regressor, Coulomb and viscous friction.
  MatrixXd rows(const VectorXd& qd) {
    MatrixXd Y = MatrixXd::Zero(regressor_.joints(), columns_);
    Y.leftCols(base_.size()) = regressor_.last()(Eigen::all, base_.independent);
    for (Index r = 0; r < regressor_.rotors(); ++r) {
      const double speed = regressor_.speed(r, qd), sign = speed > 0 ? 1 : speed < 0 ? -1 : 0;
      for (Index j = 0; j < qd.size(); ++j) {
        const double turns = regressor_.turns(r, j);
        Y(j, base_.size() + 2 * r) = turns * sign, Y(j, base_.size() + 2 * r + 1) = turns * speed;
      }
    }
    return Y;
  }

  Regressor regressor_;
  const BaseParameters& base_;
  const MotionLimits& limits_;
  VectorXd phi_;
  Index columns_;
  std::vector<const mujoco::Binding*> drives_;
  VectorXd unit_, column_;
  MatrixXd gram_;

 public:
  Collisions collisions;
};

/// A search coordinate to 0 .. 1.
double share_of(double z) { return 1 / (1 + std::exp(-z)); }

/// Coordinates to a series that keeps positions, speeds and accelerations by construction: per joint the coefficients,
/// how much of what is allowed they use, and where in what is left the centre lies.
FourierSeries series_of(const VectorXd& z, const MotionLimits& limits, const ExcitationOptions& o) {
  const Index n = limits.low.size(), H = o.harmonics;
  FourierSeries s{.period_s = o.period_s,
                  .centre = VectorXd::Zero(n),
                  .a = z.head(n * H).reshaped(n, H),
                  .b = z.segment(n * H, n * H).reshaped(n, H)};
  s.start_at_rest();
  const int grid = 24 * o.harmonics;
  VectorXd q(n), qd(n), qdd(n), min_q = VectorXd::Constant(n, 1e300), max_q = -min_q, speed = VectorXd::Zero(n),
                                acceleration = VectorXd::Zero(n);
  for (int i = 0; i < grid; ++i) {
    s.at(i * o.period_s / grid, q, qd, qdd);
    min_q = min_q.cwiseMin(q), max_q = max_q.cwiseMax(q), speed = speed.cwiseMax(qd.cwiseAbs()),
    acceleration = acceleration.cwiseMax(qdd.cwiseAbs());
  }
  for (Index j = 0; j < n; ++j) {
    // The grid misses the peaks by less than 1 %.
    const double allowed = 0.99 * std::min({limits.speed(j) / speed(j), limits.acceleration(j) / acceleration(j),
                                            (limits.high(j) - limits.low(j)) / (max_q(j) - min_q(j))});
    const double scale = allowed * (0.1 + 0.9 * share_of(2 + z(2 * n * H + j)));
    s.a.row(j) *= scale, s.b.row(j) *= scale;
    const double first = limits.low(j) - scale * min_q(j), last = limits.high(j) - scale * max_q(j);
    s.centre(j) = first + share_of(z(2 * n * H + n + j)) * (last - first);
  }
  return s;
}

constexpr int states_per_period = 100;
/// The objective from which on a motion leaves its limits.
constexpr double impossible = 100;

MotionStates states_of(const FourierSeries& s) {
  const Index n = s.centre.size();
  MotionStates out{.step_s = s.period_s / states_per_period,
                   .q = MatrixXd(n, states_per_period),
                   .qd = MatrixXd(n, states_per_period),
                   .qdd = MatrixXd(n, states_per_period)};
  for (int i = 0; i < states_per_period; ++i) s.at((i + 0.5) * out.step_s, out.q.col(i), out.qd.col(i), out.qdd.col(i));
  return out;
}

/// How far a motion leaves its limits, 0 within them; adds its states to the condition number.
double excess_of(const MotionStates& states, Judge& judge) {
  double excess = 0;
  int collisions = 0;
  judge.begin();
  for (Index i = 0; i < states.size(); ++i) {
    excess = std::max(excess, judge.torque_excess(states.q.col(i), states.qd.col(i), states.qdd.col(i)));
    judge.add(states.qd.col(i));
    collisions += judge.collisions.at(states.q.col(i)).has_value();
  }
  return excess > 0 || collisions ? impossible + 10 * excess + collisions : 0;
}

/// Logarithm of the condition number, or of the mean sigma where there is a criterion; what leaves the limits is worse
/// than anything within, by how far it leaves them.
double objective(const FourierSeries& s, Judge& judge, const ExcitationOptions& o) {
  const MotionStates states = states_of(s);
  const double excess = excess_of(states, judge);
  if (!o.criterion) return excess + std::log(judge.condition_number());
  return excess + mean_log_sigma(o.criterion->known + o.periods * o.criterion->information(states));
}

double condition_number_of(const FourierSeries& s, Judge& judge) {
  excess_of(states_of(s), judge);
  return judge.condition_number();
}

/// `at` writes set points; the state at time 0 is left out.
template <class Points>
MotionStates sampled(const Points& at, Index n, double step_s, double until_s) {
  const auto size = static_cast<Index>(until_s / step_s);
  MotionStates out{.step_s = step_s, .q = MatrixXd(n, size), .qd = MatrixXd(n, size), .qdd = MatrixXd(n, size)};
  std::vector<SetPoint> before(static_cast<std::size_t>(n)), now(before);
  at(0, before);
  for (Index i = 0; i < size; ++i) {
    at(static_cast<double>(i + 1) * step_s, now);
    for (Index j = 0; j < n; ++j) {
      const auto k = static_cast<std::size_t>(j);
      out.q(j, i) = now[k].position_rad, out.qd(j, i) = now[k].velocity_rad_s,
               out.qdd(j, i) = (now[k].velocity_rad_s - before[k].velocity_rad_s) / step_s;
    }
    before = now;
  }
  return out;
}

MotionStates states_of(const Motion& motion, double step_s) {
  return sampled([&](double t, std::span<SetPoint> out) { motion.at(t, out); }, static_cast<Index>(motion.joints()),
                 step_s, motion.duration_s());
}

/// What of a motion of trapezoids leaves the limits: torque, self-collision. Empty: nothing.
std::string trouble(const Motion& motion, Judge& judge) {
  const MotionStates states = states_of(motion, 0.02);
  for (Index i = 0; i < states.size(); ++i) {
    if (judge.torque_excess(states.q.col(i), states.qd.col(i), states.qdd.col(i)) > 0) return "torque";
    if (const auto pair = judge.collisions.at(states.q.col(i))) return *pair;
  }
  return {};
}

std::span<const double> values(const VectorXd& v) { return {v.data(), static_cast<std::size_t>(v.size())}; }
std::vector<double> list(const VectorXd& v) { return {v.begin(), v.end()}; }

/// Where the joints are, and how fast they may accelerate.
struct Place {
  const MotionLimits& limits;
  VectorXd pose, acceleration;
  VectorXd approach() const { return 0.3 * limits.speed; }
  /// The largest travel of a joint to both sides of the pose.
  double half_travel(Index joint) const { return std::min(0.45 * (limits.high(joint) - limits.low(joint)), 1.2); }
};

/// Back and forth of some joints around a pose at a share of their speeds, all at the same time. Slow passes are short:
/// five seconds at most.
void append_pass(Motion& motion, const Place& at, std::span<const Index> joints, double travel, double share) {
  const VectorXd speed = share * at.limits.speed;
  VectorXd from = at.pose, to = at.pose;
  double longest_s = 5;
  for (const Index j : joints) {
    from(j) = std::max(at.limits.low(j), at.pose(j) - travel * at.half_travel(j)),
    to(j) = std::min(at.limits.high(j), at.pose(j) + travel * at.half_travel(j));
    if (joints.size() > 1) longest_s = std::min(longest_s, (to(j) - from(j)) / speed(j));
  }
  for (const Index j : joints) {
    const double shorter = std::min(1.0, longest_s * speed(j) / (to(j) - from(j))), middle = 0.5 * (from(j) + to(j));
    from(j) = middle + shorter * (from(j) - middle), to(j) = middle + shorter * (to(j) - middle);
  }
  const VectorXd approach = at.approach();
  motion.move_to(list(from), values(approach), values(at.acceleration)).dwell(0.1);
  motion.move_to(list(to), values(speed), values(at.acceleration))
      .dwell(0.1)
      .move_to(list(from), values(speed), values(at.acceleration))
      .dwell(0.1);
}

void return_to_pose(Motion& motion, const Place& at) {
  const VectorXd approach = at.approach();
  motion.move_to(list(at.pose), values(approach), values(at.acceleration)).dwell(0.1);
}

/// Back and forth around a pose at several speeds, slowly to fast.
Motion friction_of(Index joint, const Place& at, double travel) {
  Motion motion(list(at.pose));
  for (const double share : {0.03, 0.1, 0.25, 0.5, 0.75, 1.0}) append_pass(motion, at, {&joint, 1}, travel, share);
  return_to_pose(motion, at);
  return motion;
}

/// Fast moves of all joints for `length_s`.
Motion heating_of(const Place& at, double length_s, double travel) {
  const VectorXd half = travel * 0.3 * (at.limits.high - at.limits.low),
                 from = (at.pose - half).cwiseMax(at.limits.low), to = (at.pose + half).cwiseMin(at.limits.high),
                 approach = at.approach();
  Motion motion(list(at.pose));
  motion.move_to(list(from), values(approach), values(at.acceleration));
  while (motion.duration_s() < std::max(length_s, 1.0))
    motion.move_to(list(to), values(at.limits.speed), values(at.acceleration))
        .move_to(list(from), values(at.limits.speed), values(at.acceleration));
  motion.move_to(list(at.pose), values(approach), values(at.acceleration));
  return motion;
}

/// make(travel) within the limits: motions that take too much torque accelerate less, travels that collide are
/// shortened.
template <class Make>
Result<Motion> feasible(const Make& make, Place& at, Judge& judge, const std::string& what, int attempts = 12) {
  double travel = 1;
  std::string why;
  for (int k = 0; k < attempts; ++k) {
    Motion motion = make(travel);
    why = trouble(motion, judge);
    if (why.empty()) return motion;
    if (why == "torque")
      at.acceleration *= 0.7;
    else
      travel *= 0.7;
  }
  return tl::unexpected(fmt::format("{}: no motion within the limits around the pose of the first keyframe ({})", what,
                                    why == "torque" ? "torque" : why + " touch"));
}

/// Passes of one joint after the other.
Result<Motion> friction_by_joint(Place& at, Judge& judge, const Regressor& regressor) {
  Motion all(list(at.pose));
  for (Index j = 0; j < regressor.joints(); ++j) {
    const auto part = feasible([&](double travel) { return friction_of(j, at, travel); }, at, judge,
                               "friction of " + regressor.joint_name(j));
    if (!part) return tl::unexpected(part.error());
    all.then(*part);
  }
  return all;
}

/// The pose of the first keyframe, and others of which joints can come from it and back within the limits.
std::vector<Place> places_of(const Place& reference, Judge& judge, Gaussian& gaussian) {
  constexpr std::size_t wanted = 4, tries = 20;
  std::vector<Place> out{reference};
  const VectorXd middle = 0.5 * (reference.limits.low + reference.limits.high),
                 range = reference.limits.high - reference.limits.low;
  for (std::size_t k = 0; k < tries && out.size() < wanted; ++k) {
    Place other = reference;
    other.pose = middle + (0.2 * gaussian(range.size())).cwiseMax(-0.35).cwiseMin(0.35).cwiseProduct(range);
    Motion there(list(reference.pose));
    return_to_pose(there, other);
    return_to_pose(there, reference);
    if (trouble(there, judge).empty()) out.push_back(other);
  }
  return out;
}

/// Passes that a design may choose from: from a pose and back to it.
struct Passes {
  std::vector<Motion> motions;
  std::vector<Experiment> experiments;  ///< group: the place
};

Passes passes_of(const std::vector<Place>& places, Judge& judge, const DesignCriterion& criterion) {
  Passes out;
  const Index n = places.front().pose.size();
  std::vector<Index> all(static_cast<std::size_t>(n));
  std::iota(all.begin(), all.end(), 0);
  for (std::size_t p = 0; p < places.size(); ++p)
    for (Index j = n > 1 ? -1 : 0; j < n; ++j)
      for (const double share : {0.02, 0.04, 0.08, 0.16, 0.32, 0.6, 1.0}) {
        Place at = places[p];
        const std::span<const Index> joints = j < 0 ? std::span<const Index>(all) : std::span<const Index>(&j, 1);
        const auto pass = feasible(
            [&](double travel) {
              Motion motion(list(at.pose));
              append_pass(motion, at, joints, travel, share);
              return_to_pose(motion, at);
              return motion;
            },
            at, judge, {}, 4);
        if (!pass) continue;
        out.motions.push_back(*pass);
        out.experiments.push_back({criterion.information(states_of(*pass, 0.05)), pass->duration_s(), p});
      }
  return out;
}

/// The passes that add most to what is known, within the time that `by_joint` takes, place by place.
Motion d_optimal_passes(const Motion& by_joint, const Place& reference, Judge& judge, const DesignCriterion& criterion,
                        const MatrixXd& known, Gaussian& gaussian) {
  const std::vector<Place> places = places_of(reference, judge, gaussian);
  const Passes passes = passes_of(places, judge, criterion);
  std::vector<double> travel_s;
  for (const Place& place : places) {
    Motion there(list(reference.pose));
    if (&place != &places.front()) return_to_pose(there, place), return_to_pose(there, reference);
    travel_s.push_back(there.duration_s());
  }
  const auto chosen = d_optimal(known, passes.experiments, travel_s, by_joint.duration_s());
  Motion out(list(reference.pose));
  for (std::size_t p = 0; p < places.size(); ++p) {
    bool there = p == 0;
    for (const std::size_t one : chosen) {
      if (passes.experiments[one].group != p) continue;
      if (!there) return_to_pose(out, places[p]);
      there = true;
      out.then(passes.motions[one]);
    }
    if (there && p > 0) return_to_pose(out, reference);
  }
  return chosen.empty() ? by_joint : out;
}

}  // namespace

MotionLimits motion_limits(const mujoco::Model& model, const Regressor& regressor, double share) {
  const mjModel* m = model.get();
  const Index n = regressor.joints();
  MotionLimits limits{.low = VectorXd(n),
                      .high = VectorXd(n),
                      .speed = VectorXd::Constant(n, 2 * share),
                      .acceleration = {},
                      .torque = VectorXd::Constant(n, friction::unlimited),
                      .notes = {}};
  std::vector<std::string> unlimited;
  for (Index j = 0; j < n; ++j) {
    double low = m->jnt_range[2 * j], high = m->jnt_range[2 * j + 1];
    if (!m->jnt_limited[j]) {
      const double travel = regressor.is_slide(j) ? 0.5 : std::numbers::pi;
      low = m->qpos0[j] - travel, high = m->qpos0[j] + travel;
      unlimited.push_back(regressor.joint_name(j));
    }
    limits.low(j) = low + 0.02 * (high - low), limits.high(j) = high - 0.02 * (high - low);
  }
  if (!unlimited.empty())
    limits.notes.push_back(
        fmt::format("the model gives no range for {}: half a turn (0.5 m) to both sides is taken", joined(unlimited)));
  if (joint_speed_max_rad_s(model, 0))
    for (std::size_t d = 0; d < model.drives().size(); ++d)
      limits.speed(model.drives()[d].dof) = share * *joint_speed_max_rad_s(model, d);
  else
    limits.notes.push_back(
        "the model has no numeric joint_speed_max_rad_s with a number per drive: 2 rad/s (2 m/s) is taken");
  limits.acceleration = limits.speed / 0.4;
  for (const auto& drive : model.drives())
    if (m->actuator_ctrllimited[drive.actuator])
      limits.torque(drive.dof) = share * m->actuator_ctrlrange[2 * drive.control + 1] * drive.gear;
  return limits;
}

void Excitation::at(double time_s, std::span<SetPoint> out) const {
  if (time_s >= inertia_s) return rest.at(time_s - inertia_s, out);
  const Index n = inertia.centre.size();
  VectorXd q(n), qd(n), qdd(n);
  inertia.at(time_s, q, qd, qdd);
  for (Index j = 0; j < n; ++j) out[static_cast<std::size_t>(j)] = {q(j), qd(j)};
}

MotionStates Excitation::states(double step_s, double until_s) const {
  return sampled([&](double t, std::span<SetPoint> out) { at(t, out); }, inertia.centre.size(), step_s,
                 std::min(until_s, duration_s()));
}

std::string to_csv(const Excitation& e, const Regressor& regressor, double rate_hz) {
  std::string s = "time_s,section";
  for (Index j = 0; j < regressor.joints(); ++j)
    s += fmt::format(",position_{0}_{1},velocity_{0}_{1}_s", regressor.joint_name(j),
                     regressor.is_slide(j) ? "m" : "rad");
  s += '\n';
  std::vector<SetPoint> points(static_cast<std::size_t>(regressor.joints()));
  for (std::size_t i = 0; static_cast<double>(i) <= e.duration_s() * rate_hz; ++i) {
    const double t = static_cast<double>(i) / rate_hz;
    e.at(t, points);
    s += fmt::format("{:.9g},{}", t, e.section(t));
    for (const auto& p : points) s += fmt::format(",{:.9g},{:.9g}", p.position_rad, p.velocity_rad_s);
    s += '\n';
  }
  return s;
}

namespace {

/// The search for the first section.
struct Search {
  Minimum found;
  VectorXd first;  ///< the first series tried that keeps the limits
  bool interrupted = false;
};

Result<Search> search(Judge& judge, const MotionLimits& limits, const ExcitationOptions& o, Gaussian& gaussian) {
  const Index n = limits.low.size(), size = 2 * n * o.harmonics + 2 * n;
  // A few random series, then the search around the best.
  int evaluations = 0;
  Search out;
  const auto tried = [&](const VectorXd& z) {
    const double value = objective(series_of(z, limits, o), judge, o);
    if (out.first.size() == 0 && value < impossible) out.first = z;
    if (o.progress) o.progress(std::min(1.0, static_cast<double>(++evaluations) / o.evaluations));
    return value;
  };
  const auto stopped = [&] { return o.stop && *o.stop; };
  Minimum start{.z = gaussian(size)};
  start.objective = tried(start.z);
  for (int k = 1; k < std::min(50, o.evaluations / 10) && !stopped(); ++k)
    if (const VectorXd z = gaussian(size); true)
      if (const double value = tried(z); value < start.objective) start.z = z, start.objective = value;
  out.found = start;
  if (!stopped())
    out.found = answered(
        cma_es(start.z, {.population = 16, .evaluations = o.evaluations - evaluations, .stop = o.stop}, gaussian),
        tried);
  out.interrupted = stopped();
  if (out.found.objective < impossible) return out;
  return tl::unexpected(
      fmt::format("no motion of all joints within torque limits and without self-collision was found in {} trials{}; "
                  "lower --share, or a reference pose (first keyframe) that is free may help",
                  evaluations, out.interrupted ? ", being interrupted" : ""));
}

/// Second and third section, behind the first.
Result<void> append_rest(Excitation& out, Place at, Judge& judge, const Regressor& regressor,
                         const ExcitationOptions& o, Gaussian& gaussian) {
  if (!o.friction && o.heating_s == 0) return {};
  out.rest.dwell(0.2);
  return_to_pose(out.rest, at);
  out.rest.dwell(0.1);
  if (const auto why = trouble(out.rest, judge); !why.empty())
    out.notes.push_back(fmt::format("on the way from the first section to the pose: {}",
                                    why == "torque" ? "more torque than the limit is needed" : why + " touch"));
  if (o.friction) {
    const auto by_joint = friction_by_joint(at, judge, regressor);
    if (!by_joint) return tl::unexpected(by_joint.error());
    if (o.criterion)
      out.rest.then(d_optimal_passes(*by_joint, at, judge, *o.criterion,
                                     o.criterion->known + o.periods * o.criterion->information(states_of(out.inertia)),
                                     gaussian));
    else
      out.rest.then(*by_joint);
  }
  out.friction_s = out.inertia_s + out.rest.duration_s();
  if (o.heating_s == 0) return {};
  const auto heating =
      feasible([&](double travel) { return heating_of(at, o.heating_s, travel); }, at, judge, "heating");
  if (!heating) return tl::unexpected(heating.error());
  out.rest.then(*heating);
  return {};
}

}  // namespace

Result<Excitation> excite(const mujoco::Model& model, const Regressor& regressor, const BaseParameters& base,
                          const ExcitationOptions& o) {
  const MotionLimits limits = motion_limits(model, regressor, o.share);
  Judge judge(model, regressor, base, limits);
  Gaussian gaussian(o.seed);
  const auto found = search(judge, limits, o, gaussian);
  if (!found) return tl::unexpected(found.error());
  const Index n = regressor.joints();
  Excitation out{.inertia = series_of(found->found.z, limits, o),
                 .inertia_s = o.periods * o.period_s,
                 .friction_s = o.periods * o.period_s,
                 .rest = Motion({}),
                 .first_condition_number = condition_number_of(series_of(found->first, limits, o), judge),
                 .interrupted = found->interrupted,
                 .notes = limits.notes};
  out.condition_number = condition_number_of(out.inertia, judge);
  VectorXd q(n), qd(n), qdd(n);
  out.inertia.at(0, q, qd, qdd);
  out.pose = reference_pose(model.get(), limits);
  out.rest = Motion(list(q));
  if (auto ok = append_rest(out, {limits, out.pose, limits.acceleration}, judge, regressor, o, gaussian); !ok)
    return tl::unexpected(ok.error());
  return out;
}

}  // namespace tribotwin::twin
