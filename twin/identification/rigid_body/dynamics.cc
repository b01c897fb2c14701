#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>
#include <tribotwin/twin/numerics/triangular_factor.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr Index chunk = 4096;
constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

/// Everything that a pass over the motion needs, and where each joint's columns are among all unknowns.
class Problem {
 public:
  Problem(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
          const JointMotion& motion, unsigned threads)
      : regressor_(regressor), base_(base), friction_(friction), motion_(motion), threads_(threads) {
    armature_ = regressor.model_parameters().tail(joints());
    for (Index j = 0; j < joints(); ++j) {
      auto& columns = columns_.emplace_back();
      for (Index k = 0; k < base.size(); ++k)
        for (Index c = 0; c < base.from_all.cols(); ++c)
          if (base.from_all(k, c) != 0 && regressor.acts(static_cast<std::size_t>(c), j)) {
            columns.push_back(k);
            break;
          }
      base_columns_.push_back(static_cast<Index>(columns.size()));
      first_friction_.push_back(unknowns_);
      for (Index p = 0; p < friction[static_cast<std::size_t>(j)].size(); ++p)
        columns.push_back(base.size() + unknowns_++);
    }
    unknowns_ += base.size();
    open_.assign(static_cast<std::size_t>(unknowns_), true);
  }

  Index joints() const { return regressor_.joints(); }
  Index unknowns() const { return unknowns_; }
  Index friction_at(Index joint, Index parameter) const {
    return base_.size() + first_friction_[static_cast<std::size_t>(joint)] + parameter;
  }
  void hold(Index u) { open_[static_cast<std::size_t>(u)] = false; }
  bool is_open(Index u) const { return open_[static_cast<std::size_t>(u)]; }

  struct Pass {
    std::vector<MatrixXd> R;  ///< per joint, of [columns, residual]; empty when it was not asked for
    MatrixXd residual;        ///< joints x samples; NaN at rest
  };

  /// Residuals at `parameters` and, with `factors`, the regressor of each joint; `weight(joint, residual)` multiplies
  /// rows.
  template <class Weight>
  Pass pass(const RobotParameters& parameters, bool factors, const Weight& weight) const {
    Pass out{.R = {}, .residual = MatrixXd::Constant(joints(), motion_.size(), unknown)};
    const auto chunks = static_cast<std::size_t>((motion_.size() + chunk - 1) / chunk);
    std::vector<std::vector<TriangularFactor>> partial(factors ? chunks : 0);
    in_parallel(chunks, threads_, [&](std::size_t part) {
      Regressor own = regressor_;
      std::vector<TriangularFactor> R;
      if (factors)
        for (const auto& c : columns_) R.emplace_back(static_cast<Index>(c.size()) + 1);
      std::vector<double> by(friction::max_parameters);
      MatrixXd Yb(joints(), base_.size());
      const Index first = static_cast<Index>(part) * chunk;
      for (Index i = first; i < std::min(first + chunk, motion_.size()); ++i) {
        if (!motion_.moving.col(i).any()) continue;
        const MatrixXd& Y = own.at(motion_.q.col(i), motion_.qd.col(i), motion_.qdd.col(i));
        for (Index k = 0; k < base_.size(); ++k) Yb.col(k) = Y.col(base_.independent[static_cast<std::size_t>(k)]);
        for (Index j = 0; j < joints(); ++j) {
          if (!motion_.moving(j, i)) continue;
          const auto at = static_cast<std::size_t>(j);
          const double rigid = Yb.row(j) * parameters.base;
          const double sliding = friction_[at].torque(parameters.friction[at], motion_.qd(j, i), load(j, i, rigid),
                                                      motion_.temperature_degC(j, i), by.data());
          const double residual = motion_.torque(j, i) - rigid - sliding;
          out.residual(j, i) = residual;
          if (!factors) continue;
          const double w = weight(j, residual);
          auto row = R[at].row();
          const Index own_base = base_columns_[at];
          for (Index c = 0; c < own_base; ++c) row(c) = w * Yb(j, columns_[at][static_cast<std::size_t>(c)]);
          for (Index p = 0; p < friction_[at].size(); ++p) row(own_base + p) = w * by[static_cast<std::size_t>(p)];
          row(row.size() - 1) = w * residual;
        }
      }
      if (factors) partial[part] = std::move(R);
    });
    for (std::size_t j = 0; factors && j < columns_.size(); ++j) {
      TriangularFactor all(static_cast<Index>(columns_[j].size()) + 1);
      for (const auto& p : partial) all.add(p[j]);
      out.R.push_back(all.R());
    }
    return out;
  }

  /// R of [all open unknowns, residual], the joints weighed; `order` gets the unknown of each column.
  MatrixXd combined(const Pass& pass, const VectorXd& joint_weight, std::vector<Index>& order) const {
    order.clear();
    std::vector<Index> place(static_cast<std::size_t>(unknowns_), -1);
    for (Index u = 0; u < unknowns_; ++u)
      if (is_open(u)) place[static_cast<std::size_t>(u)] = static_cast<Index>(order.size()), order.push_back(u);
    const auto width = static_cast<Index>(order.size()) + 1;
    TriangularFactor all(width);
    for (std::size_t j = 0; j < columns_.size(); ++j) {
      const MatrixXd& R = pass.R[j];
      for (Index r = 0; r < R.rows(); ++r) {
        auto row = all.row();
        for (Index c = 0; c + 1 < R.cols(); ++c)
          if (const Index at = place[static_cast<std::size_t>(columns_[j][static_cast<std::size_t>(c)])]; at >= 0)
            row(at) = joint_weight(static_cast<Index>(j)) * R(r, c);
        row(width - 1) = joint_weight(static_cast<Index>(j)) * R(r, R.cols() - 1);
      }
    }
    return all.R();
  }

  /// Torque that the gear transmits to the links: what rotors need is not among it.
  double load(Index joint, Index sample, double rigid) const {
    return rigid - armature_(joint) * motion_.qdd(joint, sample);
  }

 private:
  const Regressor& regressor_;
  const BaseParameters& base_;
  const RobotFriction& friction_;
  const JointMotion& motion_;
  unsigned threads_;
  VectorXd armature_;
  std::vector<std::vector<Index>> columns_;  ///< per joint, unknowns that act on it: base first
  std::vector<Index> base_columns_, first_friction_;
  Index unknowns_ = 0;
  std::vector<bool> open_;
};

constexpr auto no_weight = [](Index, double) { return 1.0; };

/// How many correlated samples are worth an independent one: variance of means over ever longer batches against what
/// independent samples would give, the largest of those known to 15 %.
double correlation_of(const VectorXd& residual, const JointMotion& motion, double variance) {
  double worst = 1;
  for (Index length = 1; length * 50 <= motion.size(); length *= 2) {
    double sum_squares = 0, batches = 0;
    for (const auto& [first, last] : motion.segments)
      for (Index i = first; i + length <= last; i += length) {
        double sum = 0, count = 0;
        for (Index k = i; k < i + length; ++k)
          if (!std::isnan(residual(k))) sum += residual(k), ++count;
        if (count == 0) continue;
        sum_squares += sum * sum / count, ++batches;
      }
    if (batches >= 50) worst = std::max(worst, sum_squares / batches / variance);
  }
  return worst;
}

double robust_weight(Robust robust, double residual_per_sigma) {
  const double r = std::abs(residual_per_sigma);
  switch (robust) {
    case Robust::none:
      return 1;
    case Robust::huber:
      return r <= 1.345 ? 1 : std::sqrt(1.345 / r);
    case Robust::tukey:
      return r < 4.685 ? 1 - (r / 4.685) * (r / 4.685) : 0;
  }
  return 1;
}

/// Standard deviation; in robust fits by the median of magnitudes.
double noise_of(const std::vector<double>& residual, Index parameters, Robust robust) {
  if (robust == Robust::none) {
    const double sum = std::inner_product(residual.begin(), residual.end(), residual.begin(), 0.0);
    return std::sqrt(sum / static_cast<double>(
                               std::max<std::ptrdiff_t>(1, static_cast<std::ptrdiff_t>(residual.size()) - parameters)));
  }
  std::vector<double> magnitude(residual.size());
  std::ranges::transform(residual, magnitude.begin(), [](double r) { return std::abs(r); });
  const auto middle = magnitude.begin() + static_cast<std::ptrdiff_t>(magnitude.size() / 2);
  std::ranges::nth_element(magnitude, middle);
  return 1.4826 * *middle;
}

/// Open unknowns whose columns depend on those before them, friction first: these data cannot tell them.
std::vector<Index> dependent(const MatrixXd& R, const std::vector<Index>& order, Index base_size) {
  std::vector<Index> sequence(order.size());
  std::iota(sequence.begin(), sequence.end(), 0);
  std::ranges::stable_partition(sequence, [&](Index c) { return order[static_cast<std::size_t>(c)] >= base_size; });
  MatrixXd Q(R.rows(), R.cols());
  Index found = 0;
  std::vector<Index> out;
  for (const Index c : sequence) {
    const double length = R.col(c).norm();
    VectorXd rest = length > 0 ? VectorXd(R.col(c) / length) : VectorXd::Zero(R.rows());
    for (int pass = 0; pass < 2; ++pass) rest -= Q.leftCols(found) * (Q.leftCols(found).transpose() * rest);
    if (rest.norm() < 1e-6)
      out.push_back(order[static_cast<std::size_t>(c)]);
    else
      Q.col(found++) = rest.normalized();
  }
  return out;
}

VectorXd solved(const MatrixXd& R) {
  const Index n = R.cols() - 1;
  VectorXd x = R.col(n).head(n);
  R.topLeftCorner(n, n).triangularView<Eigen::Upper>().solveInPlace(x);
  return x;
}

MatrixXd covariance(const MatrixXd& R) {
  const Index n = R.cols() - 1;
  MatrixXd inverse = MatrixXd::Identity(n, n);
  R.topLeftCorner(n, n).triangularView<Eigen::Upper>().solveInPlace(inverse);
  return inverse * inverse.transpose();
}

/// Parameters of a law that is not linear, fitted joint by joint to what rigid dynamics leave. Returns those that are
/// not estimated: these data cannot tell them, or they are at a bound.
Result<std::vector<Index>> start_friction(const Problem& problem, const Regressor& regressor,
                                          const RobotFriction& friction, const JointMotion& motion,
                                          const MatrixXd& rigid, RobotParameters& parameters, unsigned threads,
                                          std::vector<std::string>& notes) {
  constexpr Index enough = 20000;
  std::vector<Index> held;
  notes.clear();
  for (Index j = 0; j < problem.joints(); ++j) {
    const auto at = static_cast<std::size_t>(j);
    const JointFriction& f = friction[at];
    Samples samples;
    const Index every = std::max<Index>(1, motion.moving.row(j).count() / enough);
    Index seen = 0;
    for (Index i = 0; i < motion.size(); ++i) {
      if (!motion.moving(j, i) || seen++ % every) continue;
      samples.speed.push_back(std::abs(motion.qd(j, i)) * f.scales().speed);
      samples.friction.push_back(std::copysign(1 / f.scales().torque, motion.qd(j, i)) *
                                 (motion.torque(j, i) - rigid(j, i)));
      samples.load.push_back(std::abs(problem.load(j, i, rigid(j, i))) / f.scales().torque_max_nm);
      samples.temperature_degC.push_back(motion.temperature_degC(j, i));
      samples.curve.push_back(0);
    }
    FitOptions options{.threads = threads};
    for (const auto& p : f.law().parameters)
      if (p.name == "T0") options.fixed.emplace_back("T0", 20);  // a convention: another one gives the same friction
    const auto found = fit(f.law(), samples, options);
    if (!found)
      return tl::unexpected(fmt::format("friction of joint {}: {}", regressor.joint_name(j), found.error().message));
    if (!found->unidentifiable.empty())
      notes.push_back(fmt::format("friction of joint {}: {} cannot be told from these data and are held",
                                  regressor.joint_name(j), fmt::join(found->unidentifiable, ", ")));
    for (Index p = 0; p < f.size(); ++p) {
      parameters.friction[at][static_cast<std::size_t>(p)] = found->parameters[static_cast<std::size_t>(p)].value;
      if (found->parameters[static_cast<std::size_t>(p)].status != Status::estimated)
        held.push_back(problem.friction_at(j, p));
    }
  }
  return held;
}

}  // namespace

Result<RobotFriction> robot_friction(const mujoco::Model& model, const Regressor& regressor,
                                     const friction::LawInfo& law) {
  RobotFriction out;
  for (Index j = 0; j < regressor.joints(); ++j) {
    JointFriction::Scales scales;
    const auto drive = std::ranges::find(model.drives(), static_cast<int>(j), &mujoco::Binding::dof);
    if (drive != model.drives().end()) {
      scales.torque_max_nm = drive->drive.torque_max_nm;
      if (law.side == friction::Side::motor) scales.speed = drive->drive.gear_ratio;
      if (law.normalised) scales.torque = drive->drive.torque_max_nm;
    } else if (law.side == friction::Side::motor || law.normalised || law.load_dependent) {
      return tl::unexpected(
          fmt::format("law '{}' is one of motor speed, normalised torque or load, but joint {} has no tribotwin.drive "
                      "in the model that says its gear_ratio and torque_max_nm",
                      law.name, regressor.joint_name(j)));
    }
    out.emplace_back(law, scales);
  }
  return out;
}

MatrixXd gear_load(const Regressor& regressor, const BaseParameters& base, const VectorXd& parameters,
                   const JointMotion& motion, unsigned threads) {
  RobotFriction none;
  for (Index j = 0; j < regressor.joints(); ++j) none.emplace_back(coulomb_viscous(), JointFriction::Scales{});
  MatrixXd load = predicted_torque(
      regressor, base, none, {.base = parameters, .friction = std::vector<std::vector<double>>(none.size(), {0, 0, 0})},
      motion, threads);
  load -= regressor.model_parameters().tail(regressor.joints()).asDiagonal() * motion.qdd;
  return load;
}

MatrixXd predicted_torque(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                          const RobotParameters& parameters, const JointMotion& motion, unsigned threads) {
  MatrixXd torque(regressor.joints(), motion.size());
  const Problem problem(regressor, base, friction, motion, threads);
  in_parallel(static_cast<std::size_t>((motion.size() + chunk - 1) / chunk), threads, [&](std::size_t part) {
    Regressor own = regressor;
    const Index first = static_cast<Index>(part) * chunk;
    for (Index i = first; i < std::min(first + chunk, motion.size()); ++i) {
      torque.col(i) =
          own.at(motion.q.col(i), motion.qd.col(i), motion.qdd.col(i))(Eigen::all, base.independent) * parameters.base;
      for (Index j = 0; j < regressor.joints(); ++j)
        if (const auto at = static_cast<std::size_t>(j); motion.qd(j, i) != 0)
          torque(j, i) += friction[at].torque(parameters.friction[at], motion.qd(j, i),
                                              problem.load(j, i, torque(j, i)), motion.temperature_degC(j, i));
    }
  });
  return torque;
}

Result<DynamicsFit> fit_dynamics(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                                 const JointMotion& motion, const DynamicsOptions& options) {
  const Index joints = regressor.joints();
  Problem problem(regressor, base, friction, motion, options.threads);
  DynamicsFit out;
  const auto progress = [&](double share) {
    if (options.progress) options.progress(share);
  };
  progress(0);
  for (Index j = 0; j < joints; ++j)
    if (const Index moving = motion.moving.row(j).count(); moving < 10 + friction[static_cast<std::size_t>(j)].size())
      return tl::unexpected(
          fmt::format("joint {} moves in {} samples only; record more of its motion", regressor.joint_name(j), moving));

  RobotParameters now{.base = base.from_all * regressor.model_parameters(), .friction = {}};
  for (const auto& f : friction) now.friction.emplace_back(static_cast<std::size_t>(f.size()), 0.0);
  if (&friction.front().law() != &coulomb_viscous()) {
    // Rigid dynamics under the linear law first: their residual is where the search for the friction begins.
    RobotFriction linear;
    for (std::size_t j = 0; j < friction.size(); ++j) linear.emplace_back(coulomb_viscous(), JointFriction::Scales{});
    const auto first = fit_dynamics(regressor, base, linear, motion,
                                    {.robust = options.robust, .weigh = options.weigh, .threads = options.threads});
    if (!first) return first;
    now.base = first->parameters.base;
    VectorXd weights(joints);
    for (Index j = 0; j < joints; ++j) weights(j) = 1 / first->joints[static_cast<std::size_t>(j)].noise;
    // Friction and rigid dynamics in turn, each given the other, as loads and laws depend on them.
    constexpr int rounds = 4;
    for (int round = 0; round < rounds; ++round) {
      RobotParameters frictionless{.base = now.base,
                                   .friction = std::vector<std::vector<double>>(friction.size(), {0, 0, 0})};
      const MatrixXd rigid = predicted_torque(regressor, base, linear, frictionless, motion, options.threads);
      const auto started = start_friction(problem, regressor, friction, motion, rigid, now, options.threads, out.notes);
      if (!started) return tl::unexpected(started.error());
      if (round + 1 == rounds) {
        for (const Index u : *started) problem.hold(u);
        break;
      }
      Problem rigid_only(regressor, base, friction, motion, options.threads);
      for (Index u = base.size(); u < rigid_only.unknowns(); ++u) rigid_only.hold(u);
      std::vector<Index> order;
      const auto pass = rigid_only.pass(now, true, no_weight);
      for (const Index u : dependent(rigid_only.combined(pass, weights, order), order, base.size())) rigid_only.hold(u);
      const VectorXd step = solved(rigid_only.combined(pass, weights, order));
      now.base(order) += step;
    }
  }
  progress(0.3);

  VectorXd noise = VectorXd::Ones(joints), correlation = VectorXd::Ones(joints);
  std::vector<Index> order;
  MatrixXd R;
  const auto judge = [&](const Problem::Pass& pass) {
    out.joints.clear();
    double squares = 0, torque_squares = 0;
    for (Index j = 0; j < joints; ++j) {
      std::vector<double> r;
      double own = 0, torque = 0;
      for (Index i = 0; i < motion.size(); ++i)
        if (const double x = pass.residual(j, i); !std::isnan(x))
          r.push_back(x), own += x * x, torque += motion.torque(j, i) * motion.torque(j, i);
      const auto parameters = std::min<Index>(base.size() / joints + friction[static_cast<std::size_t>(j)].size(),
                                              static_cast<Index>(r.size()) / 2);
      noise(j) = std::max(noise_of(r, parameters, options.robust),
                          1e-12 * std::sqrt(torque / static_cast<double>(r.size())) + 1e-300);
      correlation(j) = correlation_of(pass.residual.row(j), motion, own / static_cast<double>(r.size()));
      out.joints.push_back(
          {regressor.joint_name(j), noise(j), correlation(j), std::sqrt(own / torque), static_cast<Index>(r.size())});
      squares += own, torque_squares += torque;
    }
    out.relative_error = std::sqrt(squares / torque_squares);
  };
  VectorXd weights;
  const auto weigh = [&] {
    if (options.weigh)
      weights = (noise.array() * correlation.array().sqrt()).inverse();
    else
      weights.setConstant(joints, 1 / std::sqrt((noise.array().square() * correlation.array()).mean()));
  };
  // The joint and parameter of an unknown of friction.
  const auto place_of = [&](Index u) {
    std::size_t j = friction.size() - 1;
    while (u < problem.friction_at(static_cast<Index>(j), 0)) --j;
    return std::pair{j, static_cast<std::size_t>(u - problem.friction_at(static_cast<Index>(j), 0))};
  };
  const auto unpack = [&](RobotParameters& to, const VectorXd& by, double part) {
    for (std::size_t c = 0; c < order.size(); ++c) {
      const double change = part * by(static_cast<Index>(c));
      if (order[c] < base.size()) {
        to.base(order[c]) += change;
        continue;
      }
      const auto [j, p] = place_of(order[c]);
      const auto& info = friction[j].law().parameters[p];
      to.friction[j][p] = std::clamp(to.friction[j][p] + change, info.minimum, info.maximum);
    }
  };

  const auto cost_of = [&](const MatrixXd& residual) {
    double sum = 0;
    for (Index j = 0; j < joints; ++j)
      for (Index i = 0; i < motion.size(); ++i)
        if (const double r = residual(j, i); !std::isnan(r)) {
          const double limit = options.robust == Robust::none ? std::abs(r) : std::min(std::abs(r), 4.685 * noise(j));
          sum += weights(j) * weights(j) * limit * limit;
        }
    return sum;
  };
  constexpr int most_passes = 40;
  RobotParameters best = now;
  VectorXd step;
  double share = 1, cost = 0;
  for (int k = 0;; ++k) {
    const auto pass = problem.pass(
        now, true, [&](Index j, double r) { return k == 0 ? 1.0 : robust_weight(options.robust, r / noise(j)); });
    if (k > 0 && cost_of(pass.residual) > cost * (1 + 1e-6) &&
        share > 1e-3) {  // a step that made it worse is shortened
      share /= 4;
      now = best;
      unpack(now, step, share);
      continue;
    }
    best = now;
    share = 1;
    judge(pass);
    weigh();
    cost = cost_of(pass.residual);
    R = problem.combined(pass, weights, order);
    if (k == 0) {
      for (const Index u : dependent(R, order, base.size())) {
        problem.hold(u);
        if (u < base.size())
          out.notes.push_back(fmt::format("{} cannot be told from these data and is held at the model's value",
                                          base.parameters[static_cast<std::size_t>(u)].name));
      }
      R = problem.combined(pass, weights, order);
    }
    step = solved(R);
    const double largest =
        step.size() ? step.cwiseQuotient(covariance(R).diagonal().cwiseSqrt()).cwiseAbs().maxCoeff() : 0;
    progress(0.3 + 0.7 * std::min(1.0, (k + 1) / 6.0));
    if (largest < 1e-2) break;
    if (k >= most_passes) {
      out.notes.push_back(
          fmt::format("after {} steps parameters still move by {:.2g} of their sigmas", most_passes, largest));
      break;
    }
    unpack(now, step, 1);
    // Parameters that lean on a bound would step against it for ever.
    for (const Index u : order)
      if (u >= base.size() && k >= 5)
        if (const auto [j, p] = place_of(u); now.friction[j][p] == friction[j].law().parameters[p].minimum ||
                                             now.friction[j][p] == friction[j].law().parameters[p].maximum) {
          problem.hold(u);
          out.notes.push_back(fmt::format("friction of joint {}: {} is held at a bound of what its law accepts, {:g}",
                                          regressor.joint_name(static_cast<Index>(j)),
                                          friction[j].law().parameters[p].name, now.friction[j][p]));
        }
  }

  if (options.essential_only) {
    while (true) {
      const VectorXd deviation = covariance(R).diagonal().cwiseSqrt();
      Index least = -1;
      double ratio = 2;  // F = 4
      for (std::size_t c = 0; c < order.size(); ++c)
        if (order[c] < base.size())
          if (const double own = std::abs(now.base(order[c])) / deviation(static_cast<Index>(c)); own < ratio)
            ratio = own, least = static_cast<Index>(c);
      if (least < 0) break;
      // Set to 0; the others take over what it did: their step solves for the residual that is left.
      const Index gone = order[static_cast<std::size_t>(least)];
      const double value = now.base(gone);
      MatrixXd rows(R.rows(), R.cols() - 1);
      rows << R.leftCols(least), R.middleCols(least + 1, R.cols() - least - 1);
      rows.col(rows.cols() - 1) += value * R.col(least);
      TriangularFactor smaller(rows.cols());
      smaller.add(rows);
      R = smaller.R();
      problem.hold(gone);
      order.erase(order.begin() + least);
      now.base(gone) = 0;
      const VectorXd change = solved(R);
      unpack(now, change, 1);
      R.col(R.cols() - 1).head(R.cols() - 1).setZero();  // the minimum again
    }
    judge(problem.pass(now, false, no_weight));
  }

  const MatrixXd C = covariance(R);
  double effective = 0;
  for (const auto& j : out.joints) effective += static_cast<double>(j.samples) / j.correlation;
  const double t = interval_sigmas(effective - static_cast<double>(order.size()));
  std::vector<Index> place(static_cast<std::size_t>(problem.unknowns()), -1);
  for (std::size_t c = 0; c < order.size(); ++c) place[static_cast<std::size_t>(order[c])] = static_cast<Index>(c);
  const auto estimate = [&](Index u, std::string name, std::string unit, double value) {
    Estimate e{.name = std::move(name),
               .unit = std::move(unit),
               .value = value,
               .sigma = unknown,
               .low = unknown,
               .high = unknown,
               .status = Status::held};
    if (const Index c = place[static_cast<std::size_t>(u)]; c >= 0) {
      e.sigma = std::sqrt(C(c, c));
      e.low = value - t * e.sigma, e.high = value + t * e.sigma;
      e.status = Status::estimated;
    }
    return e;
  };
  for (Index k = 0; k < base.size(); ++k)
    out.base.push_back(estimate(k, base.parameters[static_cast<std::size_t>(k)].name,
                                base.parameters[static_cast<std::size_t>(k)].unit, now.base(k)));
  for (Index j = 0; j < joints; ++j) {
    auto& of_joint = out.friction.emplace_back();
    for (Index p = 0; p < friction[static_cast<std::size_t>(j)].size(); ++p) {
      const auto& info = friction[static_cast<std::size_t>(j)].law().parameters[static_cast<std::size_t>(p)];
      of_joint.push_back(estimate(problem.friction_at(j, p), std::string(info.name), std::string(info.unit),
                                  now.friction[static_cast<std::size_t>(j)][static_cast<std::size_t>(p)]));
    }
  }
  out.information = MatrixXd::Zero(base.size(), base.size());
  std::vector<Index> of_base, at;
  for (Index k = 0; k < base.size(); ++k)
    if (const Index c = place[static_cast<std::size_t>(k)]; c >= 0) of_base.push_back(k), at.push_back(c);
  const MatrixXd own = C(at, at), own_information = own.ldlt().solve(MatrixXd::Identity(own.rows(), own.cols()));
  out.information(of_base, of_base) = own_information;
  out.condition_number = scaled_condition_number(R.topLeftCorner(R.cols() - 1, R.cols() - 1));
  out.parameters = std::move(now);
  progress(1);
  return out;
}

}  // namespace tribotwin::twin::identification
