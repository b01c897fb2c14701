#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/identification/rigid_body/model_agreement.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Of the actuator's limit, that torques of a recording hardly exceed, and exceed at least once.
constexpr double most_effort = 5, least_effort = 1e-3;
/// Of gravity. Masses of CAD are within some ten percent; a tool that the model has not may double a wrist's.
constexpr double most_scale = 3, least_scale = 1.0 / 3;
/// Of the torque's variance, that gravity must explain for its scale to mean something: wrists are mostly friction.
constexpr double least_share = 0.3;
/// Of the torque's variance, what no rigid model explains: a residual below it is as good as any other.
constexpr double never_explained = 0.05;
/// A zero is doubted where another one leaves this share of the variance, all joints multiplied.
constexpr double clearly_better = 0.25;
constexpr double quarter = 1.5707963267948966;

/// How the torque of a joint follows the model's rigid dynamics.
struct Following {
  double scale = 0;          ///< of gravity; 0 where it has no effect
  double share = 0;          ///< of the torque's variance, explained by the model beyond friction
  double left = 1;           ///< of the torque's variance; with a scale below 0 that of friction alone
  double left_opposite = 1;  ///< the same of the torque times -1
};

std::vector<Index> some_samples(const JointMotion& motion) {
  constexpr Index most = 400;
  std::vector<Index> samples;
  const Index every = std::max<Index>(1, motion.size() / most);
  for (Index i = 0; i < motion.size(); i += every) samples.push_back(i);
  return samples;
}

/// Gravity and rigid dynamics of the model's masses, joints x samples, with `zero` added to the positions.
struct RigidTorque {
  MatrixXd gravity, rigid;
};

RigidTorque rigid_torque(Regressor& regressor, const VectorXd& parameters, const JointMotion& motion,
                         const std::vector<Index>& samples, const VectorXd& zero) {
  const Index n = regressor.joints(), count = static_cast<Index>(samples.size());
  RigidTorque out{.gravity = MatrixXd(n, count), .rigid = MatrixXd(n, count)};
  const VectorXd still = VectorXd::Zero(n);
  for (Index k = 0; k < count; ++k) {
    const Index i = samples[static_cast<std::size_t>(k)];
    const VectorXd q = motion.q.col(i) + zero;
    out.gravity.col(k) = regressor.at(q, still, still) * parameters;
    out.rigid.col(k) = regressor.at(q, motion.qd.col(i), motion.qdd.col(i)) * parameters;
  }
  return out;
}

double variance_left(const MatrixXd& A, const VectorXd& b, VectorXd* x = nullptr) {
  const VectorXd solution = A.colPivHouseholderQr().solve(b);
  if (x) *x = solution;
  return (b - A * solution).squaredNorm();
}

Following following(const JointMotion& motion, const std::vector<Index>& samples, const RigidTorque& model, Index j) {
  std::vector<Index> moving;
  for (Index k = 0; k < static_cast<Index>(samples.size()); ++k)
    if (motion.moving(j, samples[static_cast<std::size_t>(k)])) moving.push_back(k);
  const auto count = static_cast<Index>(moving.size());
  if (count < 30) return {};
  MatrixXd A(count, 5);
  VectorXd torque(count);
  for (Index r = 0; r < count; ++r) {
    const Index k = moving[static_cast<std::size_t>(r)], i = samples[static_cast<std::size_t>(k)];
    A.row(r) << motion.direction(j, i), motion.qd(j, i), 1, model.rigid(j, k) - model.gravity(j, k),
        model.gravity(j, k);
    torque(r) = motion.torque(j, i);
  }
  const double gravity = (A.col(4).array() - A.col(4).mean()).matrix().norm();
  if (!(gravity > 0.05 * A.col(3).norm())) return {};
  VectorXd x;
  const double total = (torque.array() - torque.mean()).matrix().squaredNorm(),
               without = variance_left(A.leftCols(3), torque), with = variance_left(A, torque, &x);
  if (!(total > 0)) return {};
  return {.scale = x(4),
          .share = (without - with) / total,
          .left = (x(4) > 0 ? with : without) / total,
          .left_opposite = (x(4) > 0 ? without : with) / total};
}

/// Over all joints: the product of what is left, as a logarithm.
double misfit(const std::vector<Following>& all, double Following::*left = &Following::left) {
  double sum = 0;
  for (const Following& f : all) sum += std::log(f.*left + never_explained);
  return sum;
}

std::vector<Following> followings(Regressor& regressor, const VectorXd& parameters, const JointMotion& motion,
                                  const std::vector<Index>& samples, const VectorXd& zero) {
  const RigidTorque model = rigid_torque(regressor, parameters, motion, samples, zero);
  std::vector<Following> all;
  for (Index j = 0; j < regressor.joints(); ++j) all.push_back(following(motion, samples, model, j));
  return all;
}

std::string torque_column(const Regressor& r, Index j) {
  return fmt::format("torque_{}_{}", r.joint_name(j), r.is_slide(j) ? "n" : "nm");
}

/// A joint's other zero; without a joint none fits much better than that of the recording.
struct OtherZero {
  double misfit;
  Index joint = -1;
  int quarters = 0;
};

OtherZero best_zero(Regressor& r, const VectorXd& parameters, const JointMotion& motion,
                    const std::vector<Index>& samples, double now) {
  OtherZero best{.misfit = now + std::log(clearly_better)};
  for (Index j = 0; j < r.joints(); ++j)
    for (const int quarters : {1, 2, -1}) {
      if (r.is_slide(j)) continue;
      VectorXd zero = VectorXd::Zero(r.joints());
      zero(j) = quarters * quarter;
      const double other = misfit(followings(r, parameters, motion, samples, zero));
      if (other < best.misfit) best = {other, j, quarters};
    }
  return best;
}

std::string of_zero(const Regressor& r, const OtherZero& zero, double now) {
  return fmt::format("with {} degrees added to position_{}_rad (residual variance {:.2g} times as large)",
                     90 * zero.quarters, r.joint_name(zero.joint), std::exp(zero.misfit - now));
}

/// What fits gravity much better than the torques and positions as they are; no findings where nothing does.
DoubtfulGravity other_sign_or_zero(Regressor& r, const VectorXd& parameters, const JointMotion& motion,
                                   const std::vector<Index>& samples, const std::vector<Following>& now) {
  const double as_is = misfit(now), opposite = misfit(now, &Following::left_opposite);
  const OtherZero zero = best_zero(r, parameters, motion, samples, as_is);
  if (opposite < as_is + std::log(clearly_better) && opposite < zero.misfit - std::log(clearly_better))
    return {.findings = {fmt::format(
                "the torques fit the model's gravity much better with the other sign (residual variance {:.2g} times "
                "as large){}: do all torques have the wrong sign, does the robot hang where the model stands, or is a "
                "joint's zero another than the model's, or its sign? --columns maps columns with offset and sign",
                std::exp(opposite - as_is), zero.joint < 0 ? "" : ", or " + of_zero(r, zero, as_is))},
            .opposite = true};
  if (zero.joint < 0) return {};
  return {.findings = {fmt::format("the torques fit the model's gravity much better {}: is its zero another than the "
                                   "model's, or its sign? --columns maps it with offset and sign",
                                   of_zero(r, zero, as_is))}};
}

}  // namespace

std::vector<std::string> doubtful_sizes(const Regressor& regressor, const JointMotion& motion,
                                        const std::vector<double>& effort) {
  std::vector<std::string> findings;
  for (Index j = 0; j < regressor.joints(); ++j) {
    const double limit = effort[static_cast<std::size_t>(j)];
    std::vector<double> sizes;
    for (Index i = 0; i < motion.size(); ++i)
      if (!std::isnan(motion.torque(j, i))) sizes.push_back(std::abs(motion.torque(j, i)));
    if (!(limit > 0) || sizes.empty()) continue;
    const auto hardly = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() * 95 / 100);
    std::ranges::nth_element(sizes, hardly);
    const double often = *hardly, largest = *std::ranges::max_element(sizes);
    const char* unit = regressor.is_slide(j) ? "N" : "Nm";
    if (often > most_effort * limit)
      findings.push_back(
          fmt::format("{} exceeds {:.4g} {} in a twentieth of the time, its actuator gives {:.4g}: is its unit another "
                      "({}), or is it another robot?",
                      torque_column(regressor, j), often, unit, limit, regressor.is_slide(j) ? "mN" : "mNm, A, mA"));
    else if (largest < least_effort * limit)
      findings.push_back(
          fmt::format("{} never exceeds {:.3g} {}, its actuator gives {:.4g}: is its unit another "
                      "({}), or is the column empty?",
                      torque_column(regressor, j), largest, unit, limit,
                      regressor.is_slide(j) ? "kN" : "kNm, A, share of the rated torque"));
  }
  return findings;
}

DoubtfulGravity doubtful_gravity(const Regressor& regressor, const JointMotion& motion) {
  Regressor r = regressor;
  const VectorXd parameters = r.model_parameters();
  const auto samples = some_samples(motion);
  const auto now = followings(r, parameters, motion, samples, VectorXd::Zero(r.joints()));
  if (auto other = other_sign_or_zero(r, parameters, motion, samples, now); !other.findings.empty()) return other;
  std::string columns;
  double scale = 0;  // of the first
  for (Index j = 0; j < r.joints(); ++j) {
    const Following& f = now[static_cast<std::size_t>(j)];
    if (f.share < least_share || (f.scale >= least_scale && f.scale <= most_scale)) continue;
    columns += fmt::format("{}{} ({:.3g} times)", columns.empty() ? "" : ", ", torque_column(r, j), f.scale);
    if (scale == 0) scale = f.scale;
  }
  if (columns.empty()) return {};
  return {.findings = {fmt::format("{}: that is how the torque follows the gravity of the model's masses. Is its unit "
                                   "another ({}), or that of the positions, is the load another than the model's, or "
                                   "are the masses rough?",
                                   columns,
                                   scale < 0   ? "or its sign"
                                   : scale < 1 ? "A, kNm; --torque-constant makes torques of currents"
                                               : "mNm, mA")}};
}

}  // namespace tribotwin::twin::identification
