#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/identification/resampling/folds.hpp>
#include <tribotwin/twin/identification/resampling/jackknife.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_problem.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/median.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>
#include <tribotwin/twin/numerics/triangular_factor.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/inertial_prior/inertial_prior.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr double unknown = std::numeric_limits<double>::quiet_NaN(), huber_limit = 1.345, tukey_limit = 4.685;
const DynamicsProblem::Weight no_weight = [](Index, double) { return 1.0; };

/// Number of correlated samples per independent one: variance of means over batches of increasing length, relative to
/// that of independent samples; the largest of those known to 15 %.
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

bool at_bound(const friction::Parameter& p, double value) { return value == p.minimum || value == p.maximum; }

double robust_weight(Robust robust, double residual_per_sigma) {
  const double r = std::abs(residual_per_sigma);
  switch (robust) {
    case Robust::none:
      return 1;
    case Robust::huber:
      return r <= huber_limit ? 1 : std::sqrt(huber_limit / r);
    case Robust::tukey:
      return r < tukey_limit ? 1 - (r / tukey_limit) * (r / tukey_limit) : 0;
  }
  return 1;
}

/// The loss that reweighting with `robust_weight` minimises, in squares of sigma.
double robust_loss(Robust robust, double residual_per_sigma) {
  const double r = std::abs(residual_per_sigma);
  if (robust == Robust::huber && r > huber_limit) return huber_limit * (2 * r - huber_limit);
  if (robust != Robust::tukey) return r * r;
  const double inside = r < tukey_limit ? 1 - std::pow(r / tukey_limit, 2) : 0;
  return tukey_limit * tukey_limit / 3 * (1 - inside * inside * inside);
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

/// Friction of a rotor by its joint's torque, less what rigid bodies and other rotors need (`friction` at `now`) and
/// less its offset, as samples for its law, thinned. Not where the rotor turns: there the filter leaves little friction
/// to divide.
Samples friction_samples(const JointFriction& f, const Regressor& regressor, const RobotFriction& friction,
                         const RobotParameters& now, const JointMotion& motion, const MatrixXd& rigid, double offset,
                         Index rotor) {
  constexpr Index enough = 3000;  // for start values
  constexpr double turned = 0.5;
  Samples samples;
  const Index j = regressor.joint_of(rotor), every = std::max<Index>(1, motion.moving.row(j).count() / enough);
  Index seen = 0;
  for (Index i = 0; i < motion.size(); ++i) {
    if (!motion.moving(j, i) || seen++ % every) continue;
    const double speed = regressor.speed(rotor, motion.qd.col(i)), direction = motion.direction(rotor, i);
    if (std::copysign(1, speed) * direction < turned) continue;
    double rest = motion.torque(j, i) - rigid(j, i) - offset;
    for (Index r = 0; r < regressor.rotors(); ++r)
      if (r != rotor && regressor.turns(r, j) != 0)
        rest -= regressor.turns(r, j) * friction_of(regressor, friction, now, motion, r, i, rigid.col(i));
    samples.speed.push_back(std::abs(speed) * f.scales().speed);
    samples.friction.push_back(rest / (regressor.turns(rotor, j) * direction * f.scales().torque));
    samples.load.push_back(std::abs(regressor.load(rotor, rigid.col(i), motion.qdd.col(i))) / f.scales().torque_max_nm);
    samples.temperature_degC.push_back(motion.temperature_degC(j, i));
    samples.curve.push_back(0);
  }
  return samples;
}

/// The steps of fit_dynamics, in the order in which they are called.
class Identification {
 public:
  Identification(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                 const JointMotion& motion, const DynamicsOptions& options)
      : regressor_(regressor),
        base_(base),
        friction_(friction),
        motion_(motion),
        options_(options),
        problem_(regressor, base, friction, motion, options.threads),
        noise_(VectorXd::Ones(regressor.joints())),
        correlation_(VectorXd::Ones(regressor.joints())) {}

  Result<DynamicsFit> run() && {
    progress(0);
    if (auto ok = require_linear(); !ok) return tl::unexpected(ok.error());
    if (auto ok = require_motion(); !ok) return tl::unexpected(ok.error());
    now_.base = of_model_ = base_.from_all * regressor_.model_parameters();
    for (const auto& f : friction_) now_.friction.emplace_back(static_cast<std::size_t>(f.size()), 0.0);
    if (options_.start) begin_at(*options_.start);
    restrict();
    if (!friction_.front().linear() && !options_.start)
      if (auto ok = start(); !ok) return tl::unexpected(ok.error());
    progress(0.3);
    iterate();
    if (options_.instruments)
      if (auto ok = apply_instruments(); !ok) return tl::unexpected(ok.error());
    if (options_.essential_only) eliminate();
    if (options_.folds > 1) leave_out();
    if (options_.lag) add_lags();
    conclude();
    keep_objective();
    progress(1);
    return std::move(out_);
  }

 private:
  Index joints() const { return regressor_.joints(); }
  bool left_out(Index rotor) const { return rotor < joints() && motion_.is_left_out(rotor); }
  /// "joint NAME", "motor NAME"
  std::string named(Index rotor) const {
    return fmt::format("{} {}", regressor_.is_coupled(rotor) ? "motor" : "joint", regressor_.rotor_name(rotor));
  }
  void progress(double share) const {
    if (options_.progress) options_.progress(share);
  }

  /// What instruments do not go with.
  Result<void> require_linear() const {
    const DynamicsOptions& o = options_;
    if (!o.instruments) return {};
    if (o.robust != Robust::none || o.prior > 0 || o.essential_only || o.evidence || o.lag || o.folds > 1)
      return tl::unexpected(
          Error("instrumental variables go with no robust loss, prior, elimination, lag that is unknown or folds"));
    for (const JointFriction& f : friction_)
      if (!f.linear() || !knows_instruments(f.law()))
        return tl::unexpected(Error(
            fmt::format("instrumental variables go with friction that is linear in its parameters and knows no load: "
                        "coulomb_viscous or coulomb_viscous_stribeck without asymmetry, not '{}'{}",
                        f.law().name, f.directional().asymmetry ? " with asymmetry" : "")));
    return {};
  }

  Result<void> require_motion() const {
    for (Index j = 0; j < joints(); ++j) {
      if (left_out(j)) continue;
      const auto torque = motion_.torque.row(j);
      const double low = torque.minCoeff<Eigen::PropagateNumbers>(), high = torque.maxCoeff<Eigen::PropagateNumbers>();
      if (torque.size() && high - low <= 1e-9 * std::max(std::abs(low), std::abs(high)))
        return tl::unexpected(Error(fmt::format("the torque of joint {} is always {:.4g}; is the column empty?",
                                                regressor_.joint_name(j), torque(0))));
      if (const Index moving = motion_.moving.row(j).count();
          moving < 10 + friction_[static_cast<std::size_t>(j)].size())
        return tl::unexpected(Error(fmt::format(
            "joint {} moves in {} of {} samples only: the low-pass of {:.3g} Hz leaves out what is within two of its "
            "periods, {:.2g} s, of a rest or reversal; raise --cutoff, or record more of its motion",
            regressor_.joint_name(j), moving, motion_.size(), motion_.cutoff_hz, 2 / motion_.cutoff_hz)));
    }
    return {};
  }

  void begin_at(const DynamicsFit& start) {
    now_.base = start.parameters.base;
    for (std::size_t r = 0; r < friction_.size(); ++r)
      for (Index p = 0; p < friction_[r].size(); ++p)
        for (const Estimate& e : start.friction[r])
          if (e.name == friction_[r].parameter(p).name) now_.friction[r][static_cast<std::size_t>(p)] = e.value;
  }

  /// Base parameters that are a rotor inertia alone, where there are none.
  bool excluded(Index base) const { return !options_.rotor_inertia && base_.is_rotor_inertia(base); }

  /// Whether a rotor slides both ways in samples that count, so that they tell its offset from its friction.
  bool turns_both_ways(Index rotor) const {
    constexpr double clearly = 0.5;
    bool forward = false, reverse = false;
    for (Index i = 0; i < motion_.size(); ++i) {
      if (!motion_.moving(regressor_.joint_of(rotor), i)) continue;
      forward |= motion_.direction(rotor, i) > clearly, reverse |= motion_.direction(rotor, i) < -clearly;
    }
    return forward && reverse;
  }

  /// The value at which a friction parameter stays; none where it is sought.
  std::optional<double> held(std::size_t rotor, Index parameter, bool both_ways) const {
    const JointFriction& f = friction_[rotor];
    const std::string_view name = f.parameter(parameter).name;
    if (!both_ways && (name == offset_name || name == asymmetry_name)) return 0;
    return f.held(parameter);
  }

  /// Fixes what friction holds, data cannot tell and the options exclude, and takes the prior.
  void restrict() {
    for (std::size_t r = 0; r < friction_.size(); ++r) {
      const bool both_ways = turns_both_ways(static_cast<Index>(r));
      for (Index p = 0; p < friction_[r].size(); ++p)
        if (const auto value = held(r, p, both_ways)) {
          problem_.fix(problem_.friction_at(static_cast<Index>(r), p));
          now_.friction[r][static_cast<std::size_t>(p)] = *value;
        }
    }
    for (Index k = 0; k < base_.size(); ++k)
      if (excluded(k)) {
        problem_.fix(k);
        now_.base(k) = 0;
      }
    if (options_.prior <= 0) return;
    prior_ = symmetric_inverse(options_.prior * options_.prior * prior_covariance(regressor_, base_));
  }

  /// The prior's part of the normal matrix [free unknowns, residual] at the present parameters; 0 without one.
  MatrixXd prior_normal() const {
    const auto n = static_cast<Index>(order_.size());
    MatrixXd N = MatrixXd::Zero(n + 1, n + 1);
    if (prior_.size() == 0) return N;
    std::vector<Index> of_base, at;
    for (std::size_t c = 0; c < order_.size(); ++c)
      if (order_[c] < base_.size()) of_base.push_back(order_[c]), at.push_back(static_cast<Index>(c));
    N(at, at) = prior_(of_base, of_base);
    N(at, n) = prior_(of_base, Eigen::all) * (of_model_ - now_.base);
    N(n, at) = N(at, n).transpose();
    return N;
  }

  /// R of the weighted rows of a pass and of the prior.
  MatrixXd factor(const DynamicsProblem::Pass& pass) {
    MatrixXd R = problem_.combined(pass, weights_, order_);
    if (prior_.size() == 0) return R;
    const Index n = R.cols() - 1;
    MatrixXd N = prior_normal();
    N(n, n) = (of_model_ - now_.base).dot(prior_ * (of_model_ - now_.base)) * (1 + 1e-6) + 1;
    TriangularFactor all(n + 1);
    all.add(R);
    all.add(triangular_root(N));
    return all.R();
  }

  /// Start values of a nonlinear law: rigid dynamics under the linear law, then friction and rigid dynamics in turn, as
  /// loads and laws depend on each other.
  Result<void> start() {
    RobotFriction linear;
    for (Index r = 0; r < regressor_.rotors(); ++r)
      linear.emplace_back(coulomb_viscous(), JointFriction::Scales{}, Directional{.offset = !regressor_.is_coupled(r)});
    const auto first = fit_dynamics(regressor_, base_, linear, motion_,
                                    {.robust = options_.robust,
                                     .weigh = options_.weigh,
                                     .rotor_inertia = options_.rotor_inertia,
                                     .prior = options_.prior,
                                     .threads = options_.threads});
    if (!first) return tl::unexpected(first.error());
    now_.base = first->parameters.base;
    for (std::size_t j = 0; j < friction_.size(); ++j)
      if (friction_[j].directional().offset)
        now_.friction[j][static_cast<std::size_t>(friction_[j].law_size())] = first->parameters.friction[j].back();
    VectorXd weights(joints());
    for (Index j = 0; j < joints(); ++j)
      weights(j) = left_out(j) ? 0 : 1 / first->joints[static_cast<std::size_t>(j)].noise;
    RobotFriction present = linear;
    RobotParameters friction = first->parameters;
    constexpr int rounds = 4;
    for (int round = 0;; ++round) {
      RobotParameters frictionless{.base = now_.base,
                                   .friction = std::vector<std::vector<double>>(friction_.size(), {0, 0, 0})};
      const MatrixXd rigid = predicted_torque(regressor_, base_, linear, frictionless, motion_, options_.threads);
      const auto fixed = start_friction(rigid, present, friction);
      if (!fixed) return tl::unexpected(fixed.error());
      if (round + 1 == rounds) {
        for (const Index u : *fixed) problem_.fix(u);
        return {};
      }
      update_rigid(weights);
    }
  }

  /// Fits the law of each rotor to what rigid dynamics and the `present` friction of others leave, and puts it there.
  /// Returns the unknowns that are not estimated: not identifiable, or at a bound.
  Result<std::vector<Index>> start_friction(const MatrixXd& rigid, RobotFriction& present, RobotParameters& friction) {
    std::vector<Index> fixed;
    out_.notes.clear();
    for (Index r = 0; r < regressor_.rotors(); ++r) {
      const auto at = static_cast<std::size_t>(r);
      const JointFriction& f = friction_[at];
      if (left_out(r)) {
        for (Index p = 0; p < f.size(); ++p) fixed.push_back(problem_.friction_at(r, p));
        continue;
      }
      FitOptions options{.count_arcs = false, .threads = options_.threads};
      // A convention: another reference temperature gives the same friction.
      for (const std::string_view name : f.reference_temperatures()) options.fixed.emplace_back(name, 20);
      for (Index p = 0; p < f.law_size(); ++p)
        if (const auto value = f.held(p)) options.fixed.emplace_back(f.parameter(p).name, *value * f.scales().speed);
      const auto found = fit(
          f.law(), friction_samples(f, regressor_, present, friction, motion_, rigid, f.offset(now_.friction[at]), r),
          options);
      if (!found) return tl::unexpected(Error(fmt::format("friction of {}: {}", named(r), found.error().message)));
      std::vector<std::string> held;
      for (const Estimate& e : found->parameters)
        if (e.status == Status::held) held.push_back(e.name);
      if (!held.empty())
        out_.notes.push_back(
            fmt::format("friction of {}: {} not identifiable from these data; fixed", named(r), joined(held)));
      for (Index p = 0; p < f.law_size(); ++p) {
        const Estimate& e = found->parameters[static_cast<std::size_t>(p)];
        now_.friction[at][static_cast<std::size_t>(p)] = e.value;
        if (e.status != Status::estimated) fixed.push_back(problem_.friction_at(r, p));
      }
      present[at] = f;
      friction.friction[at] = now_.friction[at];
    }
    return fixed;
  }

  /// One step of the base parameters alone.
  void update_rigid(const VectorXd& weights) {
    DynamicsProblem rigid(regressor_, base_, friction_, motion_, options_.threads);
    for (Index u = base_.size(); u < rigid.unknowns(); ++u) rigid.fix(u);
    std::vector<Index> order;
    const auto pass = rigid.pass(now_, no_weight);
    for (const Index u : dependent(rigid.combined(pass, weights, order), order, base_.size())) rigid.fix(u);
    const VectorXd step = solved(rigid.combined(pass, weights, order));
    now_.base(order) += step;
  }

  /// Noise, correlation and relative errors at the residuals of a pass, and the joints' weights from them.
  void judge(const MatrixXd& residuals) {
    out_.joints.clear();
    double squares = 0, torque_squares = 0;
    for (Index j = 0; j < joints(); ++j) {
      std::vector<double> r;
      double own = 0, torque = 0;
      for (Index i = 0; i < motion_.size(); ++i)
        if (const double x = residuals(j, i); !std::isnan(x))
          r.push_back(x), own += x * x, torque += motion_.torque(j, i) * motion_.torque(j, i);
      if (r.empty()) {  // left out: any weight will do for no rows
        out_.joints.push_back({regressor_.joint_name(j), unknown, 1, unknown, 0});
        continue;
      }
      const auto parameters = std::min<Index>(base_.size() / joints() + friction_[static_cast<std::size_t>(j)].size(),
                                              static_cast<Index>(r.size()) / 2);
      noise_(j) = std::max(noise_of(r, parameters, options_.robust),
                           1e-12 * std::sqrt(torque / static_cast<double>(r.size())) + 1e-300);
      correlation_(j) = correlation_of(residuals.row(j), motion_, own / static_cast<double>(r.size()));
      out_.joints.push_back({regressor_.joint_name(j), noise_(j), correlation_(j), std::sqrt(own / torque),
                             static_cast<Index>(r.size())});
      squares += own, torque_squares += torque;
    }
    out_.relative_error = std::sqrt(squares / torque_squares);
  }

  void weigh() {
    if (options_.weigh)
      weights_ = (noise_.array() * correlation_.array().sqrt()).inverse();
    else
      weights_.setConstant(joints(), 1 / std::sqrt((noise_.array().square() * correlation_.array()).mean()));
  }

  double cost_of(const MatrixXd& residual) const {
    double sum = prior_.size() == 0 ? 0 : (of_model_ - now_.base).dot(prior_ * (of_model_ - now_.base));
    for (Index j = 0; j < joints(); ++j)
      for (Index i = 0; i < motion_.size(); ++i)
        if (const double r = residual(j, i); !std::isnan(r))
          sum += std::pow(weights_(j) * noise_(j), 2) * robust_loss(options_.robust, r / noise_(j));
    return sum;
  }

  /// The parameters after a step of the free unknowns, friction within the bounds of its law.
  RobotParameters advanced(const VectorXd& step) const {
    RobotParameters out = now_;
    for (std::size_t c = 0; c < order_.size(); ++c) {
      const double change = step(static_cast<Index>(c));
      if (order_[c] < base_.size()) {
        out.base(order_[c]) += change;
        continue;
      }
      const auto [j, p] = problem_.place_of(order_[c]);
      const auto& info = friction_[j].parameter(static_cast<Index>(p));
      out.friction[j][p] = std::clamp(out.friction[j][p] + change, info.minimum, info.maximum);
    }
    return out;
  }
  void advance(const VectorXd& step, double share) { now_ = advanced(share * step); }

  void fix_dependent() {
    for (const Index u : dependent(R_, order_, base_.size())) {
      problem_.fix(u);
      if (u < base_.size())
        out_.notes.push_back(fmt::format("{} not identifiable from these data; fixed at the model's value",
                                         base_.parameters[static_cast<std::size_t>(u)].name));
    }
  }

  /// Parameters at a bound would step against it in every iteration.
  void fix_at_bounds() {
    for (const Index u : order_)
      if (u >= base_.size())
        if (const auto [r, p] = problem_.place_of(u);
            at_bound(friction_[r].parameter(static_cast<Index>(p)), now_.friction[r][p])) {
          problem_.fix(u);
          out_.notes.push_back(fmt::format("friction of {}: {} fixed at {:g}, a bound of its law",
                                           named(static_cast<Index>(r)),
                                           friction_[r].parameter(static_cast<Index>(p)).name, now_.friction[r][p]));
        }
  }

  /// Gauss-Newton with shortened steps; reweighted after every step.
  void iterate() {
    const int max_passes = options_.trial ? 6 : 40;
    const double at_rest = options_.trial ? 0.1 : 1e-2;
    RobotParameters best = now_;
    VectorXd step;
    double share = 1, cost = 0;
    for (int k = 0;; ++k) {
      pass_ = problem_.pass(
          now_, [&](Index j, double r) { return k == 0 ? 1.0 : robust_weight(options_.robust, r / noise_(j)); });
      if (k > 0 && cost_of(pass_.residual) > cost * (1 + 1e-6) && share > 1e-3) {  // shorten a step that was too long
        share /= 4;
        now_ = best;
        advance(step, share);
        continue;
      }
      best = now_;
      share = 1;
      judge(pass_.residual);
      weigh();
      cost = cost_of(pass_.residual);
      R_ = factor(pass_);
      if (k == 0) {
        fix_dependent();
        R_ = factor(pass_);
      }
      step = solved(R_);
      const double largest =
          step.size() ? step.cwiseQuotient(unit_covariance(R_).diagonal().cwiseSqrt()).cwiseAbs().maxCoeff() : 0;
      progress(0.3 + 0.7 * std::min(1.0, (k + 1) / 6.0));
      if (largest < at_rest) return;
      if (k >= max_passes) {
        out_.notes.push_back(
            fmt::format("after {} steps parameters still move by {:.2g} of their sigmas", max_passes, largest));
        return;
      }
      advance(step, 1);
      if (k >= 5) fix_at_bounds();
    }
  }

  /// Sets base parameters to 0, the least significant first, while F < 4.
  void eliminate() {
    while (true) {
      const VectorXd deviation = unit_covariance(R_).diagonal().cwiseSqrt();
      Index weakest = -1;
      double ratio = 2;  // F = 4
      for (std::size_t c = 0; c < order_.size(); ++c)
        if (order_[c] < base_.size())
          if (const double own = std::abs(now_.base(order_[c])) / deviation(static_cast<Index>(c)); own < ratio)
            ratio = own, weakest = static_cast<Index>(c);
      if (weakest < 0) break;
      // Without it the others step to the minimum of the residual that is left.
      const Index gone = order_[static_cast<std::size_t>(weakest)];
      const double value = now_.base(gone);
      MatrixXd rows(R_.rows(), R_.cols() - 1);
      rows << R_.leftCols(weakest), R_.middleCols(weakest + 1, R_.cols() - weakest - 1);
      rows.col(rows.cols() - 1) += value * R_.col(weakest);
      TriangularFactor smaller(rows.cols());
      smaller.add(rows);
      R_ = smaller.R();
      problem_.fix(gone);
      order_.erase(order_.begin() + weakest);
      now_.base(gone) = 0;
      const VectorXd change = solved(R_);
      advance(change, 1);
      R_.col(R_.cols() - 1).head(R_.cols() - 1).setZero();  // the minimum again
    }
    pass_ = problem_.pass(now_, [&](Index j, double r) { return robust_weight(options_.robust, r / noise_(j)); });
    judge(pass_.residual);
  }

  /// The change of the free unknowns that the rows of the normal matrix `rest` ask for, and that matrix of them alone.
  struct Asked {
    VectorXd change;
    MatrixXd normal;
  };
  /// What the rows do not tell is drawn to the model by a very weak prior in units of `all`.
  Asked asked(const MatrixXd& rest, const MatrixXd& all) const {
    constexpr double prior = 1e-8;
    const auto n = static_cast<Index>(order_.size());
    MatrixXd left = rest.topLeftCorner(n, n);
    VectorXd right = rest.col(n).head(n);
    for (Index c = 0; c < n; ++c) {
      const double weight = prior * all(c, c);
      left(c, c) += weight;
      if (const Index u = order_[static_cast<std::size_t>(c)]; u < base_.size())
        right(c) += weight * (of_model_(u) - now_.base(u));
    }
    const VectorXd scale = left.diagonal().cwiseSqrt().cwiseInverse();
    VectorXd change = scale.cwiseProduct(
        symmetric_solution(scale.asDiagonal() * left * scale.asDiagonal(), scale.cwiseProduct(right)));
    return {std::move(change), std::move(left)};
  }

  /// Predicts every fold from the others.
  void leave_out() {
    const auto& blocks = problem_.blocks();
    const std::vector<Fold>& folds = out_.folds =
        options_.known_folds ? *options_.known_folds
                             : folds_of(motion_.q, motion_.qd, blocks, problem_.files(), options_.folds);
    std::vector<MatrixXd> of_block;
    for (std::size_t b = 0; b < blocks.size(); ++b)
      of_block.push_back(problem_.normal_matrix(pass_, b, weights_, order_));
    MatrixXd all = prior_normal();
    for (const MatrixXd& N : of_block) all += N;
    std::vector<DynamicsProblem::Rows> rows;
    if (options_.trial && options_.robust != Robust::none) rows = problem_.rows(now_);
    std::vector<Asked> of_fold(folds.size());
    in_parallel(folds.size(), options_.threads, [&](std::size_t f) {
      std::vector<bool> gone(blocks.size());
      for (const auto* left_out : {&folds[f].held, &folds[f].alike})
        for (const std::size_t b : *left_out) gone[b] = true;
      if (rows.empty()) {
        MatrixXd rest = all;
        for (std::size_t b = 0; b < blocks.size(); ++b)
          if (gone[b]) rest -= of_block[b];
        of_fold[f] = asked(rest, all);
      } else {
        of_fold[f] = asked_robustly(rows, gone, all);
      }
    });
    out_.in_folds = order_;
    MatrixXd changes = MatrixXd::Zero(problem_.unknowns(), std::ssize(folds));
    std::vector<std::size_t> fold_of(blocks.size());
    for (std::size_t f = 0; f < folds.size(); ++f) {
      changes(order_, static_cast<Index>(f)) = of_fold[f].change;
      out_.partial.push_back({advanced(of_fold[f].change), triangular_root(of_fold[f].normal)});
      for (const std::size_t b : folds[f].held) fold_of[b] = f;
    }
    out_.held_out = problem_.predicted(now_, changes, fold_of);
  }

  /// The change of the free unknowns by the blocks that are not `gone`, begun without weights, as the fit of all is:
  /// noise and outliers are those of these blocks alone. Weights by the fit of all samples would know of the others.
  Asked asked_robustly(const std::vector<DynamicsProblem::Rows>& rows, const std::vector<bool>& gone,
                       const MatrixXd& all) const {
    constexpr int most_rounds = 8;
    constexpr double at_rest = 0.1;  // of a sigma, all unknowns together
    VectorXd change = VectorXd::Zero(problem_.unknowns());
    for (int round = 0;; ++round) {
      MatrixXd N = prior_normal();
      for (Index j = 0; j < joints(); ++j)
        add_weighted(j, rows[static_cast<std::size_t>(j)], gone, change, round > 0, N);
      Asked now = asked(N, all);
      const VectorXd step = now.change - change(order_);
      change(order_) = now.change;
      const auto n = static_cast<Index>(order_.size());
      if (round >= most_rounds || (round > 0 && step.dot(N.topLeftCorner(n, n) * step) < at_rest * at_rest)) return now;
    }
  }

  /// Adds a joint's rows to the normal matrix, weighted by their residuals after `change` or, first, not.
  void add_weighted(Index joint, const DynamicsProblem::Rows& rows, const std::vector<bool>& gone,
                    const VectorXd& change, bool weighted, MatrixXd& N) const {
    const auto& columns = problem_.columns(joint);
    const auto width = static_cast<Index>(columns.size());
    const VectorXd residual = rows.values.col(width) - rows.values.leftCols(width) * change(columns);
    std::vector<double> counted;
    std::vector<Index> kept;
    for (Index i = 0; i < residual.size(); ++i)
      if (!gone[rows.block[static_cast<std::size_t>(i)]]) counted.push_back(residual(i)), kept.push_back(i);
    if (kept.empty()) return;
    const double noise = noise_of(counted, 0, options_.robust);
    MatrixXd weighed = rows.values(kept, Eigen::all);
    for (std::size_t k = 0; weighted && noise > 0 && k < kept.size(); ++k)
      weighed.row(static_cast<Index>(k)) *= robust_weight(options_.robust, counted[k] / noise);
    const double of_joint =
        weighted && options_.weigh && noise > 0 ? 1 / (noise * std::sqrt(correlation_(joint))) : weights_(joint);
    MatrixXd own = MatrixXd::Zero(width + 1, width + 1);
    own.selfadjointView<Eigen::Lower>().rankUpdate(weighed.transpose(), of_joint * of_joint);
    own.triangularView<Eigen::StrictlyUpper>() = own.transpose();
    std::vector<Index> from, to;
    for (Index c = 0; c < width; ++c)
      if (const auto at = std::ranges::find(order_, columns[static_cast<std::size_t>(c)]); at != order_.end())
        from.push_back(c), to.push_back(at - order_.begin());
    from.push_back(width), to.push_back(N.cols() - 1);
    N(to, to) += own(from, from);
  }

  /// Makes the lags unknown, to first order about 0.
  void add_lags() {
    const MatrixXd predicted = problem_.predicted(now_, MatrixXd::Zero(problem_.unknowns(), 1),
                                                  std::vector<std::size_t>(problem_.blocks().size(), 0));
    out_.lag_of_files = lag_of_files(regressor_, motion_, predicted);
    problem_.add_lags(slope_by_time(predicted, regressor_, motion_));
    for (Index j = 0; j < joints(); ++j)
      if (left_out(j)) problem_.fix(problem_.lag_at(j));
    pass_ = problem_.pass(now_, [&](Index j, double r) { return robust_weight(options_.robust, r / noise_(j)); });
    R_ = factor(pass_);
    if (dependent(R_, order_, base_.size()).empty()) return;
    for (Index j = 0; j < joints(); ++j) problem_.fix(problem_.lag_at(j));
    R_ = factor(pass_);
    out_.notes.push_back(fmt::format("lags of the torques are not identifiable from these data"));
  }

  struct Uncertainty {
    MatrixXd covariance;  ///< of the unknowns in order_
    VectorXd quantile;    ///< half widths of 95 % intervals in sigmas
  };

  /// From the estimates of least squares to those of instrumental variables, whose residuals weigh the joints.
  Result<void> apply_instruments() {
    constexpr int rounds = 3;  // the weights settle; the equations are linear
    constexpr double singular = 1e-12;
    const DynamicsProblem other(regressor_, base_, friction_, options_.instruments->motion, options_.threads);
    const auto n = static_cast<Index>(order_.size());
    for (int round = 0; round < rounds; ++round) {
      const MatrixXd M = all_moments(problem_, other);
      const VectorXd scale = M.diagonal().head(n).cwiseAbs().cwiseSqrt().cwiseInverse();
      const auto step = well_conditioned_solution(scale.asDiagonal() * M.topLeftCorner(n, n) * scale.asDiagonal(),
                                                  scale.cwiseProduct(M.col(n).head(n)), singular);
      if (!step) return tl::unexpected(Error("the instruments do not follow the motion: their equations are singular"));
      advance(scale.cwiseProduct(*step), 1);
      judge(problem_.residuals(now_).residual);
      weigh();
    }
    const MatrixXd inverse_moments = inverse(all_moments(problem_, other).topLeftCorner(n, n));
    // Rows of Z with themselves: the covariance for independent errors, which the jackknife scales.
    sandwich_ = inverse_moments * all_moments(other, other).topLeftCorner(n, n) * inverse_moments.transpose();
    auto known = uncertainty_of_instruments();
    if (!known) return tl::unexpected(known.error());
    of_instruments_ = std::move(*known);
    out_.instrumental = true;
    out_.notes.insert(out_.notes.end(), options_.instruments->notes.begin(), options_.instruments->notes.end());
    return {};
  }

  MatrixXd all_moments(const DynamicsProblem& rows, const DynamicsProblem& instruments) const {
    return rows
        .moments(instruments, now_, weights_, order_, std::vector<Index>(static_cast<std::size_t>(motion_.size()), 0),
                 1)
        .front();
  }

  /// Correlations as the information has them, variances as the jackknife, which knows what data tell, and the prior.
  Uncertainty uncertainty() {
    if (options_.instruments) return of_instruments_;
    const MatrixXd C = unit_covariance(R_), prior = prior_normal();
    const VectorXd of_prior = (C * prior.topLeftCorner(C.rows(), C.rows()) * C).diagonal(),
                   of_data = (C.diagonal() - of_prior).cwiseMax(1e-12 * C.diagonal());
    std::vector<MatrixXd> blocks, files;
    const std::vector<std::size_t> file = problem_.files();
    const auto parts = static_cast<double>(file.size());
    for (std::size_t b = 0; b < file.size(); ++b) {
      blocks.push_back(problem_.normal_matrix(pass_, b, weights_, order_) + prior / parts);
      if (b == 0 || file[b] != file[b - 1])
        files.push_back(blocks.back());
      else
        files.back() += blocks.back();
    }
    const auto found = jackknife(blocks);
    if (!found) {
      out_.notes.push_back(fmt::format(
          "sigmas are those of the information alone: one of {} stretches of time alone tells some parameter",
          blocks.size()));
      double effective = 0;
      for (const auto& j : out_.joints) effective += static_cast<double>(j.samples) / j.correlation;
      return {C, VectorXd::Constant(C.rows(), interval_sigmas(effective - static_cast<double>(order_.size())))};
    }
    const Jackknife between_blocks = moderated(*found, of_data);
    const double of_files = between(jackknife(files), std::ssize(files), between_blocks.variance);
    const VectorXd scatter = of_files * of_files * between_blocks.variance, variance = scatter + of_prior;
    const VectorXd factor = variance.cwiseQuotient(C.diagonal()).cwiseSqrt();
    // That of the sum of a variance that is estimated and one that is stated (Satterthwaite 1946).
    const VectorXd freedom = between_blocks.freedom.array() * variance.cwiseQuotient(scatter).array().square();
    return {factor.asDiagonal() * C * factor.asDiagonal(), freedom.unaryExpr(&interval_sigmas)};
  }

  /// By the larger of two variances: between stretches of time, and between groups of the instruments, across which no
  /// error meets itself. Repeated errors of the model are in the second alone, drift in the first alone.
  Result<Uncertainty> uncertainty_of_instruments() {
    const Instruments& z = *options_.instruments;
    const DynamicsProblem other(regressor_, base_, friction_, z.motion, options_.threads);
    std::vector<Index> block(z.group.size(), 0);
    for (std::size_t b = 0; b < problem_.blocks().size(); ++b)
      for (Index i = problem_.blocks()[b].first; i < problem_.blocks()[b].second; ++i)
        block[static_cast<std::size_t>(i)] = static_cast<Index>(b);
    const auto of_blocks =
        problem_.moments(other, now_, weights_, order_, block, static_cast<Index>(problem_.blocks().size()));
    const auto in_time = jackknife_of_instruments(of_blocks),
               by_group = jackknife_of_instruments(problem_.moments(other, now_, weights_, order_, z.group, z.groups));
    const VectorXd formal = sandwich_.diagonal();
    if (!in_time || !by_group)
      return tl::unexpected(
          Error("instrumental variables: one stretch of the motion alone tells some parameter, so "
                "that sigmas are not known"));
    const Jackknife a = moderated(*in_time, formal), b = moderated(*by_group, formal);
    const VectorXd variance = a.variance.cwiseMax(b.variance);
    const VectorXd freedom = (a.variance.array() > b.variance.array()).select(a.freedom, b.freedom);
    std::vector<MatrixXd> files;
    const std::vector<std::size_t> file = problem_.files();
    for (std::size_t k = 0; k < file.size(); ++k)
      if (k == 0 || file[k] != file[k - 1])
        files.push_back(of_blocks[k]);
      else
        files.back() += of_blocks[k];
    const VectorXd factor = variance.cwiseQuotient(formal).cwiseSqrt() *
                            between(jackknife_of_instruments(files), std::ssize(files), variance);
    return Uncertainty{factor.asDiagonal() * sandwich_ * factor.asDiagonal(), freedom.unaryExpr(&interval_sigmas)};
  }

  /// How much more estimates vary between files than between blocks of time, as a factor of sigmas: the median over all
  /// unknowns, as each alone is known poorly from a few files.
  double between(const std::optional<Jackknife>& found, std::ptrdiff_t files, const VectorXd& between_blocks) {
    if (files < 3 || !found) return 1;
    const VectorXd ratio = found->variance.cwiseQuotient(between_blocks);
    const double freedom = static_cast<double>(files) - 1, expected = chi_squared_median(freedom) / freedom;
    out_.between_files = std::sqrt(std::max(1.0, median_of({ratio.begin(), ratio.end()}) / expected));
    return out_.between_files;
  }

  /// The width of a prior that is the most probable, by the first moments: gravity tells them best, while estimates of
  /// inertias take up much of what the friction law does not describe. By all parameters where there are hardly any.
  void weigh_evidence(const MatrixXd& covariance) {
    constexpr Index enough = 3;
    const auto moments = std::ranges::count_if(order_, [&](Index u) { return u < base_.size() && is_first_moment(u); });
    std::vector<Index> of_base, at;
    for (std::size_t c = 0; c < order_.size(); ++c)
      if (const Index u = order_[c];
          u < base_.size() && !base_.is_rotor_inertia(u) && (moments < enough || is_first_moment(u)))
        of_base.push_back(u), at.push_back(static_cast<Index>(c));
    if (of_base.empty()) return;
    out_.prior_by_evidence = most_probable_prior(
        covariance(at, at), prior_covariance(regressor_, base_)(of_base, of_base), (of_model_ - now_.base)(of_base));
  }

  bool is_first_moment(Index base_parameter) const {
    const std::string& name = base_.parameters[static_cast<std::size_t>(base_parameter)].name;
    const std::string_view first = std::string_view(name).substr(0, name.find(' '));
    return first.ends_with(".mx") || first.ends_with(".my") || first.ends_with(".mz");
  }

  /// Estimates with sigmas, information of the base parameters, condition number.
  void conclude() {
    const Uncertainty of_unknowns = uncertainty();
    std::vector<Index> place(static_cast<std::size_t>(problem_.unknowns()), -1);
    for (std::size_t c = 0; c < order_.size(); ++c) place[static_cast<std::size_t>(order_[c])] = static_cast<Index>(c);
    const auto estimate = [&](Index u, std::string name, std::string unit, double value) {
      Estimate e = without_sigma(std::move(name), std::move(unit), value, Status::held);
      if (const Index c = place[static_cast<std::size_t>(u)]; c >= 0) {
        const double t = of_unknowns.quantile(c);
        e.sigma = std::sqrt(of_unknowns.covariance(c, c));
        e.low = value - t * e.sigma, e.high = value + t * e.sigma;
        e.status = Status::estimated;
      }
      return e;
    };
    for (Index k = 0; k < base_.size(); ++k)
      out_.base.push_back(estimate(k, base_.parameters[static_cast<std::size_t>(k)].name,
                                   base_.parameters[static_cast<std::size_t>(k)].unit, now_.base(k)));
    for (Index r = 0; r < regressor_.rotors(); ++r) {
      auto& of_rotor = out_.friction.emplace_back();
      const JointFriction& f = friction_[static_cast<std::size_t>(r)];
      for (Index p = 0; p < f.size(); ++p) {
        const auto& info = f.parameter(p);
        // Motor-side parameters have the motor's units, whatever the joint does.
        const bool slide =
            regressor_.is_slide(regressor_.joint_of(r)) && (p >= f.law_size() || f.law().side == friction::Side::arm);
        of_rotor.push_back(estimate(problem_.friction_at(r, p), std::string(info.name), unit_of(info.unit, slide),
                                    now_.friction[static_cast<std::size_t>(r)][static_cast<std::size_t>(p)]));
      }
    }
    if (options_.lag) {
      const VectorXd step = solved(R_);
      for (Index j = 0; j < joints(); ++j) {
        const Index c = place[static_cast<std::size_t>(problem_.lag_at(j))];
        const double removed = motion_.lag_s.empty() ? 0 : motion_.lag_s[static_cast<std::size_t>(j)];
        out_.lag.push_back(
            estimate(problem_.lag_at(j), regressor_.joint_name(j), "s", removed + (c < 0 ? 0 : step(c))));
      }
    }
    for (Index j = 0; j < joints(); ++j) {
      std::vector<Index> of_joint, at;
      for (Index p = 0; p < friction_[static_cast<std::size_t>(j)].size(); ++p)
        if (const Index c = place[static_cast<std::size_t>(problem_.friction_at(j, p))]; c >= 0)
          of_joint.push_back(p), at.push_back(c);
      const Index size = friction_[static_cast<std::size_t>(j)].size();
      out_.friction_covariance.push_back(MatrixXd::Constant(size, size, unknown));
      out_.friction_covariance.back()(of_joint, of_joint) = of_unknowns.covariance(at, at);
    }
    out_.information = MatrixXd::Zero(base_.size(), base_.size());
    std::vector<Index> of_base, at;
    for (Index k = 0; k < base_.size(); ++k)
      if (const Index c = place[static_cast<std::size_t>(k)]; c >= 0) of_base.push_back(k), at.push_back(c);
    const MatrixXd own_information = symmetric_inverse(of_unknowns.covariance(at, at));
    out_.information(of_base, of_base) = own_information;
    if (options_.evidence) weigh_evidence(of_unknowns.covariance);
    out_.condition_number = scaled_condition_number(R_.topLeftCorner(R_.cols() - 1, R_.cols() - 1));
    out_.parameters = now_;
  }

  void keep_objective() {
    for (Index k = 0; k < base_.size(); ++k)
      if (!excluded(k)) problem_.release(k);
    for (Index j = 0; j < joints() && options_.lag; ++j) problem_.fix(problem_.lag_at(j));  // of the recordings
    const MatrixXd R = factor(pass_);
    out_.objective = R.topLeftCorner(R.cols() - 1, R.cols() - 1);
    out_.unknowns = order_;
  }

  const Regressor& regressor_;
  const BaseParameters& base_;
  const RobotFriction& friction_;
  const JointMotion& motion_;
  const DynamicsOptions& options_;
  DynamicsProblem problem_;
  DynamicsProblem::Pass pass_;  ///< the last with weights
  DynamicsFit out_;
  RobotParameters now_;
  VectorXd noise_, correlation_, weights_;  ///< per joint
  VectorXd of_model_;                       ///< base parameters
  MatrixXd prior_;                          ///< information of the prior; empty: none
  MatrixXd sandwich_;                       ///< covariance by instruments for independent errors
  Uncertainty of_instruments_;
  MatrixXd R_;                ///< of the free unknowns, at the last pass
  std::vector<Index> order_;  ///< the unknown of each column of R_
};

}  // namespace

std::string_view name_of(Robust robust) {
  return robust == Robust::huber ? "huber" : robust == Robust::tukey ? "tukey" : "none";
}

bool knows_instruments(const friction::LawInfo& law) { return JointFriction::is_linear(law) && !law.load_dependent; }

std::string_view estimator_of(const DynamicsFit& fit) {
  return fit.instrumental ? "instrumental_variables" : "least_squares";
}

Result<DynamicsFit> fit_dynamics(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                                 const JointMotion& motion, const DynamicsOptions& options) {
  return Identification(regressor, base, friction, motion, options).run();
}

}  // namespace tribotwin::twin::identification
