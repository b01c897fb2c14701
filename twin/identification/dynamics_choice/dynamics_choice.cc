#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/identification/dynamics_choice/dynamics_choice.hpp>
#include <tribotwin/twin/robot/coupling/coupling.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::VectorXd;

/// Cut-offs as shares of the widest, widest first.
constexpr double narrower[] = {0.7, 0.5, 0.35, 0.25};
/// Settings that better the error by less are not worth their complexity.
constexpr double least_gain = 0.002;
/// A coupled motor is a claim about the robot's mechanics, and several are tried: only where much speaks for it.
constexpr double coupled_gain = 0.02, coupled_sigmas = 4;
constexpr unsigned most_folds = 10, folds_of_time = 12;
constexpr Index stretch_count = 40;

class Chooser {
 public:
  Chooser(const mujoco::Model& model, const Regressor& regressor, const BaseParameters& base,
          std::span<const RobotRecording> recordings, const Decided& decided, std::span<const double> torque_max_nm,
          unsigned threads, const std::function<void(double)>& progress)
      : model_(model),
        regressor_(regressor),
        base_(base),
        recordings_(recordings),
        decided_(decided),
        torque_max_nm_(torque_max_nm),
        threads_(threads),
        progress_(progress) {}

  Result<DynamicsChoice> run() && {
    if (auto ok = start(); !ok) return tl::unexpected(ok.error());
    if (!decided_.coupling && regressor_.motors().empty()) choose_coupling();
    choose_signals();
    choose_rigid();
    choose_friction();
    choose_rigid();  // again, under the friction that was found
    choose_cutoff();
    // The fit itself takes as many samples, up to ends and rests, as its own cut-off allows.
    out_.setting.signals.widest_hz = out_.setting.signals.narrowest_hz = 0;
    return std::move(out_);
  }

 private:
  double widest_hz() const { return cutoffs_.front(); }

  Result<void> start() {
    out_.by_file = recordings_.size() >= 3;
    out_.folds = out_.by_file ? std::min(most_folds, static_cast<unsigned>(recordings_.size())) : folds_of_time;
    Setting& s = out_.setting;
    s.law = decided_.law ? decided_.law : &coulomb_viscous();
    s.directional = {.offset = decided_.offset.value_or(true), .asymmetry = decided_.asymmetry.value_or(false)};
    s.robust = decided_.robust.value_or(Robust::none);
    s.rotor_inertia = decided_.rotor_inertia.value_or(true);
    s.prior = decided_.prior.value_or(0);
    s.signals = {.cutoff_hz = decided_.cutoff_hz.value_or(0), .decimation = decided_.decimation.value_or(0)};
    auto widest = prepare(recordings_, regressor_, s.signals);
    if (!widest) return tl::unexpected(widest.error());
    set_cutoffs(*widest);
    s.signals.cutoff_hz = s.signals.widest_hz = widest_hz();
    s.signals.narrowest_hz = cutoffs_.back();
    auto target = prepare(recordings_, regressor_, s.signals);
    if (!target) return tl::unexpected(target.error());
    out_.target_hz = widest_hz();
    target_ = {.motion = *std::move(target), .stretches = {}};
    const Index size = target_.motion.size();
    for (Index k = 0; k < std::min(stretch_count, size); ++k)
      target_.stretches.emplace_back(size * k / stretch_count, size * (k + 1) / stretch_count);
    motion_ = target_.motion;
    auto first = error_of(s, motion_);
    if (!first) return tl::unexpected(first.error());
    best_ = *std::move(first);
    out_.trials.push_back({.what = fmt::format("cut-off {:.3g} Hz, friction {}", widest_hz(), s.law->name),
                           .rms = best_.rms,
                           .taken = true,
                           .failure = {},
                           .remark = {}});
    return {};
  }

  /// Narrower ones as long as ends and rests leave half of the samples.
  void set_cutoffs(const JointMotion& widest) {
    cutoffs_ = {widest.cutoff_hz};
    if (decided_.cutoff_hz) return;
    const auto moving = [](const JointMotion& m) { return static_cast<double>(m.moving.count()); };
    for (const double share : narrower) {
      const double cutoff = share * widest.cutoff_hz;
      const auto motion = prepare(
          recordings_, regressor_,
          {.cutoff_hz = widest.cutoff_hz, .decimation = decided_.decimation.value_or(0), .narrowest_hz = cutoff});
      if (!motion || moving(*motion) < 0.5 * moving(widest)) return;
      cutoffs_.push_back(cutoff);
    }
  }

  Result<HeldOut> error_of(const Setting& s, const JointMotion& motion) const {
    const auto friction = friction_of(model_, regressor_, s, torque_max_nm_, target_.motion);
    if (!friction) return tl::unexpected(friction.error());
    return held_out(regressor_, base_, *friction, motion, s, target_, out_.folds, threads_);
  }

  /// Takes the setting where it is better by more than `gain` and so many standard errors.
  bool attempt(std::string what, const Setting& setting, const JointMotion& motion, double gain = least_gain,
               double sigmas = 2) {
    ++done_;
    if (progress_) progress_(std::min(0.99, done_ / 38.0));
    Trial trial{.what = std::move(what), .rms = {}, .failure = {}, .remark = {}};
    const auto found = error_of(setting, motion);
    if (!found) {
      trial.failure = found.error().message;
      trial.change = std::nan("");
    } else if (!found->rms.allFinite()) {
      trial.failure = "no finite prediction";
      trial.change = std::nan("");
    } else {
      const Comparison c = compared(*found, best_);
      trial.change = c.change, trial.sigma = c.sigma, trial.rms = found->rms;
      trial.taken = c.change < -std::max(gain, sigmas * c.sigma);
      trial.remark = remark_of(setting, out_.setting, c);
    }
    if (trial.taken) {
      best_ = *found;
      out_.setting = setting;
      if (&motion != &motion_) motion_ = motion;
    }
    out_.trials.push_back(std::move(trial));
    return out_.trials.back().taken;
  }

  bool attempt_signals(std::string what, const Preparation& signals) {
    auto motion = prepare(recordings_, regressor_, signals);
    if (!motion) return false;
    motion->moving = motion->moving || target_.motion.moving;  // errors are compared over the target's
    Setting s = out_.setting;
    s.signals = signals;
    return attempt(std::move(what), s, *motion);
  }

  void choose_coupling() {
    for (const CoupledMotor& motor : conceivable_motors(regressor_)) {
      std::vector<CoupledMotor> motors = regressor_.motors();
      motors.push_back(motor);
      auto coupled = Regressor::create(model_.get(), motors);
      if (!coupled) continue;  // the joint has another one already
      const std::string what =
          fmt::format("motor of {}: {}", regressor_.joint_name(motor.joint), sum_of(motor, regressor_));
      const Regressor before = std::exchange(regressor_, *std::move(coupled));
      const BaseParameters base_before = std::exchange(base_, base_parameters(regressor_));
      if (!attempt_coupled(what, std::move(motors))) regressor_ = before, base_ = base_before;
    }
  }

  bool attempt_coupled(const std::string& what, std::vector<CoupledMotor> motors) {
    Setting s = out_.setting;
    s.motors = std::move(motors);
    auto motion = prepare(recordings_, regressor_, s.signals);
    if (!motion) return false;  // the motor stands still
    motion->moving = motion->moving || target_.motion.moving;
    return attempt(what, s, *motion, coupled_gain, coupled_sigmas);
  }

  void choose_cutoff() {
    for (const double cutoff : cutoffs_) {
      if (cutoff == out_.setting.signals.cutoff_hz) continue;
      Preparation signals = out_.setting.signals;
      signals.cutoff_hz = cutoff;
      attempt_signals(fmt::format("cut-off {:.3g} Hz", cutoff), signals);
    }
  }

  void choose_signals() {
    choose_cutoff();
    choose_velocity();
    for (const double periods : {1.0, 0.5}) {
      Preparation signals = out_.setting.signals;
      signals.reversals = true;
      signals.rest_periods = periods;
      attempt_signals(fmt::format("reversals, from {:g} periods of it off rests", periods), signals);
    }
  }

  void choose_velocity() {
    if (!std::ranges::all_of(recordings_, [](const auto& r) { return r.velocity.size() > 0; })) return;
    Preparation signals = out_.setting.signals;
    signals.recorded_velocity = true;
    if (attempt_signals("recorded velocity", signals)) choose_cutoff();
  }

  bool attempt_with(std::string what, const auto& change) {
    Setting s = out_.setting;
    change(s);
    return attempt(std::move(what), s, motion_);
  }

  /// Laws that are linear: those with shapes of their own (stribeck, load, extended, ...) have more than one minimum in
  /// a motion of the whole robot; they are for friction curves, or for those who ask for them.
  void choose_law() {
    attempt_law(coulomb_viscous_load());
    for (const double share : {0.02, 0.05, 0.1, 0.2, 0.4}) attempt_stribeck(share);
    if (with_stribeck(*out_.setting.law) == out_.setting.law) refine_stribeck();
    // A cubic of the speed goes astray beyond the speeds of the recordings; it is worth that for its temperature.
    if (target_.motion.has_temperature) attempt_law(*friction::find_law("polynomial"));
  }

  void attempt_stribeck(double share) {
    attempt_with(fmt::format("friction that falls within {:g} % of the top speed", 100 * share), [&](Setting& s) {
      s.law = with_stribeck(*s.law);
      s.stribeck_share.assign(static_cast<std::size_t>(regressor_.rotors()), share);
    });
  }

  /// Joint by joint, coarse and fine.
  void refine_stribeck() {
    refine_stribeck_by(1.4);
    refine_stribeck_by(1.18);
  }
  void refine_stribeck_by(double step) {
    for (Index r = 0; r < regressor_.rotors(); ++r)
      for (const double factor : {1 / step, step}) {
        const double share = factor * out_.setting.stribeck_share[static_cast<std::size_t>(r)];
        if (attempt_with(fmt::format("... of {} within {:.3g} %", regressor_.rotor_name(r), 100 * share),
                         [&](Setting& s) { s.stribeck_share[static_cast<std::size_t>(r)] = share; }))
          break;
      }
  }

  void attempt_law(const friction::LawInfo& law) {
    attempt_with(fmt::format("friction {}", law.name), [&](Setting& s) { s.law = &law; });
  }

  void choose_friction() {
    if (!decided_.law) choose_law();
    if (!decided_.asymmetry) attempt_with("asymmetry", [](Setting& s) { s.directional.asymmetry = true; });
    if (!decided_.robust)
      for (const Robust robust : {Robust::huber, Robust::tukey})
        attempt_with(fmt::format("outliers {}", name_of(robust)), [&](Setting& s) { s.robust = robust; });
  }

  void choose_rigid() {
    if (!decided_.prior) choose_prior();
    if (!decided_.rotor_inertia && out_.setting.rotor_inertia)
      attempt_with("no rotor inertias", [](Setting& s) { s.rotor_inertia = false; });
  }

  /// From wide to narrow, until one does not help.
  void choose_prior() {
    for (const double prior : {3.0, 1.0, 0.3, 0.1})
      if ((out_.setting.prior == 0 || prior < out_.setting.prior) &&
          !attempt_with(fmt::format("prior of {:g} % about the model", 100 * prior),
                        [&](Setting& s) { s.prior = prior; }))
        return;
  }

  const mujoco::Model& model_;
  Regressor regressor_;  ///< with the coupled motors of the best setting, and its base parameters
  BaseParameters base_;
  std::span<const RobotRecording> recordings_;
  const Decided& decided_;
  std::span<const double> torque_max_nm_;
  unsigned threads_;
  const std::function<void(double)>& progress_;
  DynamicsChoice out_;
  std::vector<double> cutoffs_;
  Target target_;
  JointMotion motion_;  ///< with the signals of the best setting
  HeldOut best_;
  double done_ = 0;
};

}  // namespace

std::string remark_of(const Setting& setting, const Setting& narrower, const Comparison& comparison) {
  if (!(comparison.change > 2 * comparison.sigma)) return {};
  const bool more_terms = contains(*setting.law, *narrower.law) && setting.directional == narrower.directional;
  const bool asymmetry = setting.law == narrower.law && setting.directional.asymmetry &&
                         !narrower.directional.asymmetry && setting.directional.offset == narrower.directional.offset;
  if (!more_terms && !asymmetry) return {};
  return fmt::format("contains {}{}, yet worse: overfits or did not converge", narrower.law->name,
                     asymmetry ? " without asymmetry" : "");
}

Result<DynamicsChoice> choose_dynamics(const mujoco::Model& model, const Regressor& regressor,
                                       const BaseParameters& base, std::span<const RobotRecording> recordings,
                                       const Decided& decided, std::span<const double> torque_max_nm, unsigned threads,
                                       const std::function<void(double share)>& progress) {
  return Chooser(model, regressor, base, recordings, decided, torque_max_nm, threads, progress).run();
}

}  // namespace tribotwin::twin::identification
