#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/identification/dynamics_choice/held_out.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

std::string turn_text(double lead_s) {
  return fmt::format("friction that turns {:.3g} ms {} the speed", 1e3 * std::abs(lead_s),
                     lead_s < 0 ? "after" : "before");
}

DynamicsOptions options_of(const Setting& setting, unsigned threads) {
  return {.robust = setting.robust, .rotor_inertia = setting.rotor_inertia, .prior = setting.prior, .threads = threads};
}

Result<RobotFriction> friction_of(const mujoco::Model& model, const Regressor& regressor, const Setting& setting,
                                  std::span<const double> torque_max_nm, const JointMotion& motion) {
  auto friction = robot_friction(model, regressor, *setting.law, setting.directional, torque_max_nm);
  if (friction)
    for (std::size_t r = 0; r < friction->size(); ++r) {
      double fastest = 0;
      for (Index i = 0; i < motion.size(); ++i)
        fastest = std::max(fastest, std::abs(regressor.speed(static_cast<Index>(r), motion.qd.col(i))));
      if (may_depend_on_position(regressor, static_cast<Index>(r)) &&
          std::ranges::find(setting.by_position, regressor.rotor_name(static_cast<Index>(r))) !=
              setting.by_position.end())
        (*friction)[r].depend_on_position();
      (*friction)[r].hold_stribeck_speed((setting.stribeck_share.empty() ? 0.1 : setting.stribeck_share[r]) * fastest);
    }
  return friction;
}

Result<HeldOut> held_out(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                         const JointMotion& motion, const Setting& setting, const Target& target, unsigned folds,
                         const DynamicsFit* start, const std::vector<Fold>* known, unsigned threads) {
  DynamicsOptions options = options_of(setting, threads);
  options.folds = folds;
  options.trial = true;
  options.start = start;
  options.known_folds = known;
  options.evidence = true;
  auto fit = fit_dynamics(regressor, base, friction, motion, options);
  if (!fit) return tl::unexpected(fit.error());
  auto errors = errors_of(regressor, fit->held_out, target);
  if (!errors) return tl::unexpected(errors.error());
  HeldOut out{*std::move(errors), {}};
  fit->held_out.resize(0, 0);
  out.fit = *std::move(fit);
  return out;
}

Result<Errors> errors_of(const Regressor& regressor, const MatrixXd& predicted, const Target& target) {
  std::vector<Index> measured;
  for (Index j = 0; j < predicted.rows(); ++j)
    if (!target.motion.is_left_out(j)) measured.push_back(j);
  const Index joints = static_cast<Index>(measured.size()), stretches = static_cast<Index>(target.stretches.size());
  Errors out{.rms = VectorXd::Zero(joints), .mean = MatrixXd::Zero(joints, stretches)};
  for (Index k = 0; k < joints; ++k) {
    const Index j = measured[static_cast<std::size_t>(k)];
    double all = 0, samples = 0;
    for (Index s = 0; s < stretches; ++s) {
      const auto [first, last] = target.stretches[static_cast<std::size_t>(s)];
      double squares = 0, count = 0;
      for (Index i = first; i < last; ++i)
        if (target.motion.moving(j, i)) squares += std::pow(target.motion.torque(j, i) - predicted(j, i), 2), ++count;
      all += squares, samples += count;
      out.mean(k, s) = count > 0 ? squares / count : std::nan("");
    }
    if (samples == 0)
      return tl::unexpected(
          Error(fmt::format("{} moves nowhere for long enough to compare its torque: it is slow or beside a rest in "
                            "every sample; record longer motion of it",
                            regressor.joint_name(j))));
    out.rms(k) = std::sqrt(all / samples);
    if (!std::isfinite(out.rms(k)))
      return tl::unexpected(Error(fmt::format("no finite prediction of {}", regressor.joint_name(j))));
  }
  return out;
}

Comparison compared(const Errors& a, const Errors& b) {
  const double change = (a.rms.array() / b.rms.array()).log().mean();
  // Half the differences of mean squares in units of b's, averaged over joints: to first order those of log rms.
  std::vector<double> own;
  for (Index s = 0; s < a.mean.cols(); ++s) {
    double sum = 0;
    Index joints = 0;
    for (Index j = 0; j < a.mean.rows(); ++j)
      if (!std::isnan(a.mean(j, s)) && !std::isnan(b.mean(j, s)))
        sum += (a.mean(j, s) - b.mean(j, s)) / (2 * b.rms(j) * b.rms(j)), ++joints;
    if (joints) own.push_back(sum / static_cast<double>(joints));
  }
  const auto n = static_cast<double>(own.size());
  double mean = 0, squares = 0;
  for (const double x : own) mean += x / n;
  for (const double x : own) squares += (x - mean) * (x - mean);
  return {.change = std::expm1(change), .sigma = n > 1 ? std::sqrt(squares / (n - 1) / n) : 0};
}

}  // namespace tribotwin::twin::identification
