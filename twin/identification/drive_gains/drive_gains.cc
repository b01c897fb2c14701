#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>

#include <tribotwin/twin/identification/drive_gains/drive_gains.hpp>
#include <tribotwin/twin/identification/drive_gains/gain_equations.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/robot/inertial_prior/inertial_prior.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
/// Standard deviations that keep what the data do not show from infinity: of ln g; of base parameters in units of the
/// model's sizes; of friction in units of the torque.
constexpr double wide_log = 2, wide_base = 10, wide_friction = 10;

std::vector<Index> range(Index first, Index count) {
  std::vector<Index> out;
  for (Index i = 0; i < count; ++i) out.push_back(first + i);
  return out;
}

/// The steps of identify_drive_gains. Unknowns: ln k_j = -ln g_j of all joints, beta, friction that does not change
/// joint by joint, the rest of it period by period, z of the payloads.
class GainFit {
 public:
  GainFit(const Regressor& regressor, const BaseParameters& base, const JointMotion& motion,
          std::span<const PlacedPayload> payloads, std::span<const int> payload_of_file, unsigned threads)
      : regressor_(regressor),
        base_(base),
        motion_(motion),
        payloads_(payloads),
        payload_of_file_(payload_of_file),
        threads_(threads),
        stretches_(gain_stretches(motion)),
        columns_{.base = base.size()},
        weights_(VectorXd::Zero(regressor.joints())) {
    first_of_payloads_ = unknowns_ = friction_at(0, static_cast<Index>(stretches_.back().period) + 1);
    for (const PlacedPayload& p : payloads) first_z_.push_back(unknowns_), unknowns_ += p.spread.cols();
  }

  Result<DriveGains> run() && {
    const VectorXd phi = regressor_.model_parameters();
    x_ = VectorXd::Zero(unknowns_);
    x_.segment(joints(), base_.size()) = base_.from_all * phi;
    constexpr int rounds = 5;  // loads follow from beta
    for (int round = 0; round < rounds; ++round) {
      take_blocks();
      if (round == 0) {
        start();
        find_alone();
        if (auto ok = refuse_wrong_signs(); !ok) return tl::unexpected(ok.error());
        from_alone();
      }
      const int steps = converge();
      if (steps == 0)
        return tl::unexpected(
            work_failed("the drive gains do not converge: do the recordings have the torques that their columns say, "
                        "and the payload that --payload says?"));
      if (steps == 1 && round > 0) break;  // at the same loads
    }
    conclude();
    return std::move(out_);
  }

 private:
  Index joints() const { return regressor_.joints(); }
  /// The first unknown of friction that does not change, and of that of a period.
  Index friction_at(Index joint) const {
    return joints() + base_.size() + (GainColumns::friction - GainColumns::changing) * joint;
  }
  Index friction_at(Index joint, Index period) const {
    return friction_at(joints()) + GainColumns::changing * (joints() * period + joint);
  }
  /// The unknowns of the columns of friction.
  std::vector<Index> friction_of(Index joint, std::size_t period) const {
    std::vector<Index> out = range(friction_at(joint, static_cast<Index>(period)), GainColumns::changing);
    for (const Index u : range(friction_at(joint), GainColumns::friction - GainColumns::changing)) out.push_back(u);
    return out;
  }
  auto beta() const { return x_.segment(joints(), base_.size()); }

  VectorXd payload_parameters(std::size_t p, const VectorXd& x) const {
    const PlacedPayload& own = payloads_[p];
    return own.body.parameters + own.spread * x.segment(first_z_[p], own.spread.cols());
  }

  /// Normal matrices at the loads of the present parameters, by block and summed by period.
  void take_blocks() {
    std::vector<std::optional<CarriedBody>> carried;
    for (const int p : payload_of_file_)
      if (p < 0)
        carried.emplace_back();
      else
        carried.push_back(CarriedBody{payloads_[static_cast<std::size_t>(p)].body.body,
                                      payload_parameters(static_cast<std::size_t>(p), x_)});
    motion_.carried_torque = carried_torque(regressor_, carried, motion_);
    const MatrixXd load = gear_load(regressor_, base_, beta(), motion_, threads_);
    blocks_ = gain_blocks(regressor_, base_, motion_, stretches_, payloads_, payload_of_file_, load, threads_);
    sums_.clear();
    for (const GainBlock& b : blocks_) {
      if (sums_.empty() || sums_.back().period != b.period) {
        sums_.push_back(b);
        continue;
      }
      for (std::size_t j = 0; j < b.normal.size(); ++j) sums_.back().normal[j] += b.normal[j];
      sums_.back().samples += b.samples;
    }
  }

  /// Sum over all blocks of the product of two columns of a joint.
  double product(Index joint, Index a, Index b) const {
    double sum = 0;
    for (const GainBlock& s : sums_) sum += s.normal[static_cast<std::size_t>(joint)](a, b);
    return sum;
  }
  double samples(Index joint) const {
    double sum = 0;
    for (const GainBlock& s : sums_) sum += s.samples(joint);
    return sum;
  }
  double rms_torque(Index joint) const {
    return std::sqrt(product(joint, columns_.torque(), columns_.torque()) / std::max(1.0, samples(joint)));
  }

  /// Where each unknown of one joint and block is, and its column: that of the model's torque by it; last that of the
  /// residual.
  struct Local {
    std::vector<Index> place;
    MatrixXd columns;
  };
  Local local(Index j, const GainBlock& block, const VectorXd& x) const {
    const int payload = block.payload;
    const double k = std::exp(x(j));
    const Index spread = payload < 0 ? 0 : payloads_[static_cast<std::size_t>(payload)].spread.cols(),
                first_z = 1 + base_.size() + GainColumns::friction, count = first_z + spread;
    Local out{.place = {j}, .columns = MatrixXd::Zero(columns_.size(), count + 1)};
    const auto append = [&](const std::vector<Index>& more) {
      out.place.insert(out.place.end(), more.begin(), more.end());
    };
    append(range(joints(), base_.size()));
    append(friction_of(j, block.period));
    MatrixXd& T = out.columns;
    T.col(0).head(base_.size()) = k * x.segment(joints(), base_.size());
    T.block(0, 1, base_.size(), base_.size()).diagonal().setConstant(k);
    T.block(columns_.base, 1 + base_.size(), GainColumns::friction, GainColumns::friction).setIdentity();
    if (payload >= 0) {
      const auto p = static_cast<std::size_t>(payload);
      T.col(0).tail(GainColumns::carried) = k * payload_parameters(p, x);
      T.block(columns_.payload(), first_z, GainColumns::carried, spread) = k * payloads_[p].spread;
      append(range(first_z_[p], spread));
    }
    T.col(count) = -T.col(0);
    T.col(count).segment(columns_.base, GainColumns::friction) = -x(friction_of(j, block.period));
    T(columns_.torque(), count) = 1;
    return out;
  }

  void add(const GainBlock& block, const VectorXd& x, GainSystem& system) const {
    for (Index j = 0; j < joints(); ++j) {
      if (block.samples(j) == 0) continue;
      const Local own = local(j, block, x);
      const Index n = own.columns.cols() - 1;
      const double weight = weights_(j) * weights_(j);
      const MatrixXd all = weight * own.columns.transpose() * block.normal[static_cast<std::size_t>(j)] * own.columns;
      system.N(own.place, own.place) += all.topLeftCorner(n, n);
      system.g(own.place) += all.col(n).head(n);
      system.squares += all(n, n);
    }
  }

  GainSystem system(const VectorXd& x) const {
    GainSystem out(unknowns_);
    for (const GainBlock& sum : sums_) add(sum, x, out);
    const VectorXd off = prior_ - x;
    out.N.diagonal() += precision_;
    out.g += precision_.cwiseProduct(off);
    out.squares += off.dot(precision_.cwiseProduct(off));
    return out;
  }

  /// Of every joint by its residuals at x, as a share of its torque at least.
  void weigh(const VectorXd& x) {
    weights_.setOnes();
    for (Index j = 0; j < joints(); ++j) {
      double squares = 0;
      for (const GainBlock& sum : sums_) {
        const VectorXd residual = local(j, sum, x).columns.rightCols<1>();
        squares += residual.dot(sum.normal[static_cast<std::size_t>(j)] * residual);
      }
      const double least = std::pow(1e-9 * rms_torque(j), 2) + 1e-300;
      weights_(j) = samples(j) > 0 ? 1 / std::sqrt(std::max(squares / samples(j), least)) : 0;
    }
  }

  /// Recorded torque per torque of the model's masses with the payload, beside friction; by their sizes where that is
  /// none.
  double of_model(Index j) const {
    constexpr Index count = 1 + GainColumns::friction;
    GainSystem all(count);
    for (const GainBlock& sum : sums_) {
      MatrixXd T = MatrixXd::Zero(columns_.size(), count + 1);
      T.col(0) = local(j, sum, x_).columns.col(0) / std::exp(x_(j));
      T.block(columns_.base, 1, GainColumns::friction, GainColumns::friction).setIdentity();
      T(columns_.torque(), count) = 1;
      const MatrixXd own = T.transpose() * sum.normal[static_cast<std::size_t>(j)] * T;
      all.N += own.topLeftCorner(count, count), all.g += own.col(count).head(count), all.squares += own(count, count);
    }
    if (!(all.squares > 0) || !(all.N(0, 0) > 0)) return 1;
    const double by_size = std::sqrt(all.squares / all.N(0, 0));
    all.N.diagonal() *= 1 + 1e-9;
    const double k = all.step()(0);
    return k > 0.01 * by_size && k <= by_size ? k : by_size;
  }

  /// Start values of the gains; the prior.
  void start() {
    for (Index j = 0; j < joints(); ++j) x_(j) = std::log(of_model(j));
    prior_ = x_;
    precision_ = VectorXd::Ones(unknowns_);
    precision_.head(joints()).setConstant(1 / (wide_log * wide_log));
    const VectorXd size = (base_.from_all * inertial_scale(regressor_).asDiagonal()).rowwise().norm();
    precision_.segment(joints(), base_.size()) = (wide_base * size).cwiseMax(1e-12).cwiseAbs2().cwiseInverse();
    for (Index j = 0; j < joints(); ++j)
      for (const GainBlock& sum : sums_) {
        const std::vector<Index> places = friction_of(j, sum.period);
        for (Index f = 0; f < GainColumns::friction; ++f) {
          const double effect = product(j, columns_.base + f, columns_.base + f) / std::max(1.0, samples(j)),
                       torque = std::max(rms_torque(j), 1e-12);
          precision_(places[static_cast<std::size_t>(f)]) =
              std::max(effect, 1e-12) / std::pow(wide_friction * torque, 2);
        }
      }
  }

  /// What the payload's effect on each joint alone says: y_j = Y_j b_j + F_j theta_j + k_j P_j phi, linear.
  void find_alone() {
    alone_ = alone_sigma_ = VectorXd::Constant(joints(), unknown);
    for (Index j = 0; j < joints(); ++j)
      if (samples(j) > 0) find_alone(j);
  }

  void find_alone(Index j) {
    const Index fixed = columns_.torque(), k_at = fixed, count = fixed + 1 + unknowns_ - first_of_payloads_;
    const double k_start = std::exp(x_(j));
    double variance = std::pow(0.1 * rms_torque(j), 2);
    VectorXd solution = VectorXd::Zero(count);
    for (int pass = 0; pass < 3; ++pass) {
      GainSystem all(count);
      std::vector<GainSystem> groups;
      for (const GainBlock& b : blocks_) {
        if (b.samples(j) == 0) continue;
        MatrixXd T = MatrixXd::Zero(columns_.size(), count + 1);
        T.topLeftCorner(fixed, fixed).setIdentity();
        T(columns_.torque(), count) = 1;
        T.col(count).head(fixed) = -solution.head(fixed);
        if (b.payload >= 0) {
          const auto p = static_cast<std::size_t>(b.payload);
          const Index z_at = k_at + 1 + first_z_[p] - first_of_payloads_, spread = payloads_[p].spread.cols();
          T.col(k_at).tail(GainColumns::carried) = payloads_[p].body.parameters;
          T.block(columns_.payload(), z_at, GainColumns::carried, spread) = payloads_[p].spread;
          T.col(count) -= T.middleCols(k_at, count - k_at) * solution.tail(count - k_at);
        }
        const MatrixXd own = T.transpose() * b.normal[static_cast<std::size_t>(j)] * T / variance;
        GainSystem& group = groups.emplace_back(count);
        group.N = own.topLeftCorner(count, count), group.g = own.col(count).head(count);
        group.squares = own(count, count);
        all.N += group.N, all.g += group.g, all.squares += group.squares;
      }
      VectorXd precision = 1e-9 * all.N.diagonal();
      for (double& p : precision)
        if (p <= 0) p = 1;
      precision.tail(count - k_at - 1).setConstant(1 / (k_start * k_start));
      precision(k_at) = 1 / std::pow(10 * k_start, 2);
      all.N.diagonal() += precision;
      all.g -= precision.cwiseProduct(solution);
      if (pass == 2) {
        const GroupCovariance found = group_covariance(all, precision, groups);
        alone_(j) = solution(k_at), alone_sigma_(j) = std::sqrt(found.covariance(k_at, k_at));
        return;
      }
      solution += all.step();
      variance = residual_variance(j, solution, k_at);
    }
  }

  double residual_variance(Index j, const VectorXd& solution, Index k_at) const {
    double squares = 0;
    for (const GainBlock& sum : sums_) {
      VectorXd r = VectorXd::Zero(columns_.size());
      r.head(columns_.torque()) = -solution.head(columns_.torque());
      r(columns_.torque()) = 1;
      if (sum.payload >= 0) {
        const auto p = static_cast<std::size_t>(sum.payload);
        const Index z_at = k_at + 1 + first_z_[p] - first_of_payloads_;
        r.tail(GainColumns::carried) = -(solution(k_at) * payloads_[p].body.parameters +
                                         payloads_[p].spread * solution.segment(z_at, payloads_[p].spread.cols()));
      }
      squares += r.dot(sum.normal[static_cast<std::size_t>(j)] * r);
    }
    return std::max(squares / samples(j), std::pow(1e-9 * rms_torque(j), 2) + 1e-300);
  }

  Result<void> refuse_wrong_signs() const {
    for (Index j = 0; j < joints(); ++j)
      if (alone_(j) < -4 * alone_sigma_(j))
        return tl::unexpected(
            Error(fmt::format("the payload moves the torque of {} the wrong way: has its current or torque the other "
                              "sign, or is the payload not where --payload says, or in another recording?",
                              regressor_.joint_name(j))));
    return {};
  }

  bool alone_is_good(Index j) const { return alone_sigma_(j) < 0.2 * alone_(j); }

  /// Better start values of gains, then of everything else at these gains.
  void from_alone() {
    for (Index j = 0; j < joints(); ++j)
      if (alone_is_good(j)) x_(j) = std::log(alone_(j));
    prior_.head(joints()) = x_.head(joints());
    weigh(x_);
    for (int pass = 0; pass < 2; ++pass) x_ = at_gains(x_), weigh(x_);
  }

  /// The minimum over everything else at given gains, which is linear.
  VectorXd at_gains(const VectorXd& x) const {
    const std::vector<Index> rest = range(joints(), unknowns_ - joints());
    const GainSystem all = system(x);
    GainSystem inner(std::ssize(rest));
    inner.N = all.N(rest, rest), inner.g = all.g(rest);
    VectorXd out = x;
    out(rest) += inner.step();
    return out;
  }

  /// Steps of the gains with everything else at its minimum: a gain that the data do not tell would else be followed
  /// along a curved valley. The number of steps; 0: too many.
  int converge() {
    constexpr int most = 60;
    constexpr double longest = 1, shortest = 1e-6;
    for (int k = 0; k < most; ++k) {
      const GainSystem now = system(x_);
      const VectorXd step = now.step();
      const VectorXd by = step.head(joints());
      for (double share = std::min(1.0, longest / by.cwiseAbs().maxCoeff());; share /= 4) {
        VectorXd next = x_;
        next.head(joints()) += share * by;
        next = at_gains(next);
        if (system(next).squares <= now.squares * (1 + 1e-9) || share < shortest) {
          x_ = next;
          break;
        }
      }
      weigh(x_);
      if (step.dot(now.g) < 1e-3) return k + 1;
    }
    return 0;
  }

  void conclude() {
    std::vector<GainSystem> groups;
    for (const GainBlock& b : blocks_) add(b, x_, groups.emplace_back(unknowns_));
    const GainSystem all = system(x_);
    const GroupCovariance found = group_covariance(all, precision_, groups);
    out_.covariance = found.covariance.topLeftCorner(joints(), joints());
    for (Index j = 0; j < joints(); ++j)
      out_.factors.push_back(gain(j, found)), out_.per_load.push_back(loss(j, found));
    out_.base_covariance = added_to_base(all, found.covariance);
    for (std::size_t p = 0; p < payloads_.size(); ++p) {
      const MatrixXd& spread = payloads_[p].spread;
      const std::vector<Index> z = range(first_z_[p], spread.cols());
      out_.payload.push_back(payload_parameters(p, x_));
      out_.payload_covariance.push_back(spread * found.covariance(z, z) * spread.transpose());
    }
    judge();
  }

  Estimate gain(Index j, const GroupCovariance& found) const {
    const std::string& name = regressor_.joint_name(j);
    if (samples(j) == 0) return without_sigma(name, "1", 1, Status::held);
    const double value = std::exp(-x_(j)), sigma = std::sqrt(found.covariance(j, j)),
                 t = interval_sigmas(found.freedom(j));
    return {
        name, "1", value, value * sigma, value * std::exp(-t * sigma), value * std::exp(t * sigma), Status::estimated};
  }

  /// Friction per load, of a joint's torque in its true unit.
  Estimate loss(Index j, const GroupCovariance& found) const {
    const std::string& name = regressor_.joint_name(j);
    if (samples(j) == 0) return without_sigma(name, "1", 0, Status::held);
    const std::vector<Index> both{j, friction_at(j)};
    const double g = std::exp(-x_(j)), value = x_(friction_at(j)) * g;
    const Eigen::Vector2d by(-value, g);
    return estimate(name, "1", value, by.dot(found.covariance(both, both) * by),
                    interval_sigmas(found.freedom(friction_at(j))));
  }

  /// By how much base parameters of a fit at these gains and payloads move with them.
  MatrixXd added_to_base(const GainSystem& all, const MatrixXd& covariance) const {
    std::vector<Index> side = range(0, joints());
    const std::vector<Index> z = range(first_of_payloads_, unknowns_ - first_of_payloads_),
                             rest = range(joints(), first_of_payloads_ - joints());
    side.insert(side.end(), z.begin(), z.end());
    GainSystem inner(std::ssize(rest));
    inner.N = all.N(rest, rest);
    const MatrixXd by = (inner.inverse() * all.N(rest, side)).topRows(base_.size());
    return by * covariance(side, side) * by.transpose();
  }

  void judge() {
    Evidence evidence;
    for (Index j = 0; j < joints(); ++j) evidence.unseen.push_back(samples(j) > 0 ? "" : "its torque was not recorded");
    evidence.parameters = out_.factors;
    out_.lacking = lacking(evidence, [](const Estimate& e, Lack) {
      return fmt::format(
          "record the same motion with a heavier payload whose centre of mass is off the axis of {}, and move it fast",
          e.name);
    });
  }

  const Regressor& regressor_;
  const BaseParameters& base_;
  JointMotion motion_;  ///< with the torque of the present payloads
  std::span<const PlacedPayload> payloads_;
  std::span<const int> payload_of_file_;
  unsigned threads_;
  std::vector<GainStretch> stretches_;
  GainColumns columns_;
  Index unknowns_ = 0, first_of_payloads_ = 0;
  std::vector<Index> first_z_;            ///< per payload
  std::vector<GainBlock> blocks_, sums_;  ///< of stretches, of periods
  VectorXd weights_;                      ///< per joint
  VectorXd x_, prior_, precision_;        ///< per unknown
  VectorXd alone_, alone_sigma_;          ///< k by the payload's effect on the joint alone
  DriveGains out_;
};

}  // namespace

bool DriveGains::known(std::size_t joint) const {
  return std::ranges::none_of(lacking,
                              [&](const Lacking& l) { return l.withheld && l.parameter == factors[joint].name; });
}

Result<DriveGains> identify_drive_gains(const Regressor& regressor, const BaseParameters& base,
                                        const JointMotion& motion, std::span<const PlacedPayload> payloads,
                                        std::span<const int> payload_of_file, unsigned threads) {
  if (!regressor.motors().empty())
    return tl::unexpected(
        Error(fmt::format("drive gains of coupled motors are not identified, and motor {} turns with several joints: "
                          "leave its coupling out (--coupling none) or --drive-gains",
                          regressor.motors().front().name)));
  std::set<int> different;
  for (const std::size_t file : motion.file) different.insert(payload_of_file[file]);
  if (different.size() < 2)
    return tl::unexpected(Error(
        payloads.empty()
            ? "no recording has a payload (--payload): links and rotors alone do not tell torque constants, as twice "
              "the "
              "masses give twice the torques. Record the same motions once more with a payload of known mass at the "
              "flange, and give both"
            : "all recordings have the same payload, which the masses of the last link cannot be told from: record the "
              "same motions once more without it, or with another, and give both"));
  return GainFit(regressor, base, motion, payloads, payload_of_file, threads).run();
}

std::vector<std::string> doubtful_centres(const Regressor& regressor, const BaseParameters& base,
                                          const JointMotion& motion, std::span<const KnownPayload> payloads,
                                          std::span<const int> payload_of_file, unsigned threads) {
  constexpr double clearly = 4, least_m = 0.005;
  std::vector<PlacedPayload> loose;
  if (std::ranges::none_of(payloads, [](const KnownPayload& p) { return p.centre_m.has_value(); })) return {};
  for (const KnownPayload& p : payloads) {
    KnownPayload mass_only{.file = p.file, .text = p.text, .mass_kg = p.mass_kg};
    mass_only.on = p.on;
    const auto one = placed(mass_only, regressor);
    if (!one) return {};
    loose.push_back(*one);
  }
  const auto found = identify_drive_gains(regressor, base, motion, loose, payload_of_file, threads);
  if (!found) return {};
  std::vector<std::string> out;
  for (std::size_t p = 0; p < payloads.size(); ++p) {
    if (!payloads[p].centre_m) continue;
    const Centre centre = centre_of(loose[p], found->payload[p], found->payload_covariance[p]);
    const Eigen::Vector3d off = centre.position_m - *payloads[p].centre_m;
    bool apart = false;
    for (Index k = 0; k < 3; ++k)
      apart |=
          std::abs(off(k)) > std::max(least_m, clearly * std::hypot(centre.sigma_m(k), payloads[p].centre_sigma_m));
    if (!apart) continue;
    out.push_back(fmt::format(
        "by the torques the centre of mass of the payload \"{}\" is at {:.3f} {:.3f} {:.3f} +- {:.3f} {:.3f} {:.3f} m, "
        "in axes of the site: which place is right? The gains rest on the given one",
        payloads[p].text, centre.position_m(0), centre.position_m(1), centre.position_m(2), centre.sigma_m(0),
        centre.sigma_m(1), centre.sigma_m(2)));
  }
  return out;
}

void count_gains(const DriveGains& gains, DynamicsFit& fit) {
  const auto widen = [](Estimate& e, double variance) {
    if (std::isnan(e.sigma)) return;
    const double wider = std::sqrt(e.sigma * e.sigma + variance) / std::max(e.sigma, 1e-300);
    e.low = e.value - wider * (e.value - e.low), e.high = e.value + wider * (e.high - e.value);
    e.sigma *= wider;
  };
  std::vector<Index> estimated;
  for (std::size_t k = 0; k < fit.base.size(); ++k) {
    const auto at = static_cast<Index>(k);
    if (!std::isnan(fit.base[k].sigma)) estimated.push_back(at);
    widen(fit.base[k], gains.base_covariance(at, at));
  }
  const MatrixXd conditional = symmetric_inverse(fit.information(estimated, estimated));
  fit.information(estimated, estimated) = symmetric_inverse(conditional + gains.base_covariance(estimated, estimated));
  for (std::size_t j = 0; j < gains.factors.size(); ++j) {
    if (!gains.known(j)) continue;
    const auto at = static_cast<Index>(j);
    VectorXd torques = VectorXd::Zero(std::ssize(fit.friction[j]));  // what grows with the gain
    for (std::size_t p = 0; p < fit.friction[j].size(); ++p)
      if (fit.friction[j][p].unit.starts_with("N")) torques(static_cast<Index>(p)) = fit.friction[j][p].value;
    const MatrixXd added = gains.covariance(at, at) * torques * torques.transpose();
    for (std::size_t p = 0; p < fit.friction[j].size(); ++p)
      widen(fit.friction[j][p], added(static_cast<Index>(p), static_cast<Index>(p)));
    fit.friction_covariance[j] += added;
  }
}

}  // namespace tribotwin::twin::identification
