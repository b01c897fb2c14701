#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/identification/dynamics_choice/dynamics_choice.hpp>
#include <tribotwin/twin/identification/dynamics_choice/torque_lag.hpp>
#include <tribotwin/twin/identification/rigid_body/consistency.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/coupling/coupling.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::VectorXd;

/// Cut-offs as shares of the widest, widest first; those behind the first four where the fourth predicts best.
constexpr double narrower[] = {0.7, 0.5, 0.35, 0.25, 0.18, 0.125, 0.1};
constexpr std::size_t first_offered = 4;
/// Settings that better the error by less are not worth their complexity.
constexpr double least_gain = 0.003;
/// ... or by fewer standard errors, as many settings are compared.
constexpr double enough_sigmas = 2.5;
/// A prior that worsens it by less is taken.
constexpr double as_good = 0.02;
/// Priors that are tried, as multiples of the most probable one; and by how much the taken one may be worse than the
/// best of them, which is the best by chance too.
constexpr double prior_widths[] = {1, 2, 5, 20}, near_best = 0.04;
/// Real bodies that worsen it by more than `as_good` and by so many standard errors are not taken.
constexpr double real_sigmas = 1;
/// Settings that worsen it by so much and so many standard errors are not tried again after another was taken.
constexpr double hopeless = 0.1, hopeless_sigmas = 4;
/// A coupled motor is a claim about the robot's mechanics, and several are tried: only where much speaks for it.
constexpr double coupled_gain = 0.02, coupled_sigmas = 4;
/// A lag is a claim about the recordings that its own sigmas prove first, then, less strictly, the held-out error.
constexpr double lag_sigmas = 3, lag_enough = 1;
constexpr int most_lags = 2;
constexpr unsigned most_folds = 10, folds_of_time = 12;
constexpr Index stretch_count = 40;
constexpr double most_samples = 4000;
/// Of the top speed of each joint, within which friction may fall.
constexpr double stribeck_shares[] = {0.02, 0.05, 0.1, 0.2, 0.4};
constexpr double enough_samples = 8;
/// When friction turns; the longest of a period of the cut-off, beyond which the filter hides it.
constexpr double turn_step_s = 0.004, longest_lead = 0.25;

class Chooser {
 public:
  Chooser(const mujoco::Model& model, const Regressor& regressor, const BaseParameters& base,
          std::span<const RobotRecording> recordings, const Decided& decided, std::span<const double> torque_max_nm,
          unsigned threads, const std::function<void(double)>& progress, std::span<const double> offered)
      : offered_(offered),
        model_(model),
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
    search();
    if (choose_position()) search();
    choose_lags();
    if (refine_turns()) search();
    if (take_prior()) search();
    if (out_.setting.by_position.empty() && choose_position()) search();
    refine_stribeck();
    refine_position();
    simplify();
    judge_bodies();
    // The fit itself takes as many samples, up to ends and rests, as its own cut-off allows.
    Preparation& signals = out_.setting.signals;
    signals.widest_hz = signals.narrowest_hz = signals.longest_hole_s = 0;
    out_.fit = std::move(best_.fit);
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
    s.by_position = decided_.by_position.value_or(std::vector<std::string>{});
    s.robust = decided_.robust.value_or(Robust::none);
    s.rotor_inertia = decided_.rotor_inertia.value_or(true);
    s.prior = decided_.prior.value_or(0);
    s.signals = {.cutoff_hz = decided_.cutoff_hz.value_or(0),
                 .decimation = decided_.decimation.value_or(0),
                 .lag_s = decided_.lag_s};
    auto widest = prepare(recordings_, regressor_, s.signals);
    if (!widest) return tl::unexpected(widest.error());
    // Where a joint moves for so short that only samples near its reversals would count, it is named instead.
    s.signals.reversals = true;
    for (Index j = 0; j < regressor_.joints(); ++j)
      if (!widest->is_left_out(j) && !widest->moving.row(j).any()) s.signals.reversals = false;
    set_cutoffs(widest->cutoff_hz);
    s.signals.cutoff_hz = widest_hz();
    s.signals.longest_hole_s = hole_periods / widest_hz();  // the same stretches for all cut-offs
    // Samples of long recordings are thinned: a choice needs fewer than the fit.
    s.signals.widest_hz = widest_hz() * std::min(1.0, most_samples / static_cast<double>(widest->size()));
    s.signals.narrowest_hz = cutoffs_.back();
    auto target = target_of(s.signals);
    if (!target) return tl::unexpected(target.error());
    auto first_motion = prepare(recordings_, regressor_, s.signals);
    if (!first_motion) return tl::unexpected(first_motion.error());
    out_.target_hz = widest_hz();
    target_ = {.motion = *std::move(target), .stretches = {}};
    const Index size = target_.motion.size();
    for (Index k = 0; k < std::min(stretch_count, size); ++k)
      target_.stretches.emplace_back(size * k / stretch_count, size * (k + 1) / stretch_count);
    motion_ = *std::move(first_motion);
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

  /// Narrower ones as long as ends and rests leave half of the samples; of the first four also as long as reversals do,
  /// though samples near them may count: in a narrow band what a lag spoils hardly shows, and it would not be found.
  void set_cutoffs(double widest_hz) {
    cutoffs_ = {widest_hz};
    if (decided_.cutoff_hz) return;
    const auto moving = [&](double cutoff_hz) {
      Preparation signals = out_.setting.signals;
      signals.cutoff_hz = cutoff_hz, signals.widest_hz = widest_hz;
      signals.reversals = signals.reversals && offered_.size() > first_offered;
      const auto motion = prepare(recordings_, regressor_, signals);
      return motion ? static_cast<double>(motion->moving.count()) : 0.0;
    };
    const double all = moving(widest_hz);
    for (const double share : offered_) {
      if (const double left = moving(share * widest_hz); left == 0 || left < 0.5 * all) return;
      cutoffs_.push_back(share * widest_hz);
    }
  }

  Result<HeldOut> error_of(const Setting& s, const JointMotion& motion) const {
    const auto friction = friction_of(model_, regressor_, s, torque_max_nm_, target_.motion);
    if (!friction) return tl::unexpected(friction.error());
    const bool alike = best_.fit.base.size() == static_cast<std::size_t>(base_.size()) &&
                       best_.fit.friction.size() == static_cast<std::size_t>(regressor_.rotors());
    return held_out(regressor_, base_, *friction, motion, s, target_, out_.folds, alike ? &best_.fit : nullptr,
                    best_.fit.folds.empty() ? nullptr : &best_.fit.folds, threads_);
  }

  /// A setting to try.
  struct Candidate {
    std::string what;
    Setting setting;
  };
  /// One that was tried: its place in the table of trials, and what it takes to go on from it.
  struct Tried {
    Candidate candidate;
    std::size_t trial;
    JointMotion motion;
    HeldOut found;
    Comparison comparison;
  };

  /// Nothing where it failed.
  std::optional<Tried> tried(Candidate candidate) {
    ++done_;
    if (progress_) progress_(std::min(0.99, 1 - std::exp(-done_ / 25.0)));
    Trial trial{.what = candidate.what, .change = std::nan(""), .rms = {}, .failure = {}, .remark = {}};
    auto motion = motion_of(candidate.setting.signals);
    auto found = motion ? error_of(candidate.setting, *motion) : tl::unexpected(motion.error());
    if (!found)
      trial.failure = found.error().message;
    else
      trial.failure = driving(found->fit);
    Comparison c;
    if (trial.failure.empty()) {
      c = compared(*found, best_);
      trial.change = c.change, trial.sigma = c.sigma, trial.rms = found->rms;
      trial.remark = remark_of(candidate.setting, out_.setting, c);
    }
    out_.trials.push_back(std::move(trial));
    if (!out_.trials.back().failure.empty()) return std::nullopt;
    return Tried{std::move(candidate), out_.trials.size() - 1, *std::move(motion), *std::move(found), c};
  }

  /// What is impossible in a fit: friction near rest that drives the motion, by more than its sigma, or that falls with
  /// load, by more than three; else empty.
  std::string driving(const DynamicsFit& fit) const {
    for (Index r = 0; r < regressor_.rotors(); ++r) {
      double level = 0, variance = 0;
      for (const Estimate& e : fit.friction[static_cast<std::size_t>(r)])
        if (e.name == "Fc" || e.name == "Fs")
          level += e.value, variance += e.sigma * e.sigma;
        else if (e.name == "Fcl" && e.value < -3 * e.sigma)
          return fmt::format("friction of {} would fall with load", regressor_.rotor_name(r));
      if (level < -std::sqrt(variance)) return fmt::format("friction of {} would drive it", regressor_.rotor_name(r));
    }
    return {};
  }

  /// Errors are compared over all samples in which a joint slides, a period of the narrowest cut-off beside rests, also
  /// where a fit leaves those near reversals out.
  static Preparation compared_in(Preparation signals) {
    signals.reversals = true, signals.rest_periods = signals.cutoff_hz / signals.narrowest_hz;
    return signals;
  }

  bool have_velocity() const {
    return std::ranges::all_of(recordings_, [](const auto& r) { return r.velocity.size() > 0; });
  }

  /// Of speeds from positions and recorded ones those whose noise hides fewer of the slow samples.
  Result<JointMotion> target_of(const Preparation& signals) const {
    Preparation compared = compared_in(signals);
    auto by_position = prepare(recordings_, regressor_, compared);
    if (!by_position || !have_velocity()) return by_position;
    compared.recorded_velocity = true;
    auto by_velocity = prepare(recordings_, regressor_, compared);
    if (!by_velocity || by_velocity->moving.count() < by_position->moving.count()) return by_position;
    return by_velocity;
  }

  Result<JointMotion> motion_of(const Preparation& signals) const {
    if (signals == out_.setting.signals && motion_.direction.rows() == regressor_.rotors()) return motion_;
    auto motion = prepared(signals);
    if (!motion) return motion;
    if (motion->reversals != signals.reversals)
      return tl::unexpected(Error("leaves hardly any samples of a joint that turns often"));
    if (motion->time_s != target_.motion.time_s)
      return tl::unexpected(Error("leaves other samples than those that errors are compared in"));
    return motion;
  }

  /// Searches come back to the same signals.
  Result<JointMotion> prepared(const Preparation& signals) const {
    for (const auto& [known, motion] : prepared_)
      if (known == signals) return motion;
    auto motion = prepare(recordings_, regressor_, signals);
    if (motion) prepared_.emplace_back(signals, *motion);
    return motion;
  }

  void take(Tried&& t) {
    since_.clear();
    out_.trials[t.trial].taken = true;
    out_.setting = std::move(t.candidate.setting);
    motion_ = std::move(t.motion);
    best_ = std::move(t.found);
  }

  static bool is_better(const Comparison& c, double gain = least_gain, double sigmas = enough_sigmas) {
    return c.change < -std::max(gain, sigmas * c.sigma);
  }

  /// Takes the setting where it is better.
  bool attempt(Candidate candidate) {
    auto t = tried(std::move(candidate));
    if (!t || !is_better(t->comparison)) return false;
    take(*std::move(t));
    return true;
  }

  /// Steps to the candidate that is better by the most, until none is. After a step those are tried first that were the
  /// best before it; the end is where all have been tried since the last step.
  void search() {
    for (bool all = true;;) {
      std::vector<Candidate> open = candidates();
      const auto change_of = [&](const Candidate& c) {
        const auto at = last_.find(c.what);
        return at == last_.end() ? -std::numeric_limits<double>::infinity() : at->second;
      };
      std::ranges::stable_sort(open, {}, change_of);
      std::optional<Tried> best;
      for (Candidate& candidate : open) {
        const double before = change_of(candidate);
        if (before == std::numeric_limits<double>::infinity() || since_.contains(candidate.what)) continue;
        if (!all && (before > -least_gain || (best && before > best->comparison.change))) break;
        const std::string what = candidate.what;
        auto t = tried(std::move(candidate));
        last_[what] = worth_of(t);
        since_.insert_or_assign(what, out_.trials.back().rms);
        if (t && is_better(t->comparison) && (!best || t->comparison.change < best->comparison.change))
          best = std::move(t);
      }
      if (!best && all) return;
      all = !best;
      if (!best) continue;
      last_.erase(best->candidate.what);
      take(*std::move(best));
    }
  }

  /// The change that it brought; infinite where it need not be tried again.
  static double worth_of(const std::optional<Tried>& t) {
    if (!t) return std::numeric_limits<double>::infinity();
    const Comparison& c = t->comparison;
    return c.change > std::max(hopeless, hopeless_sigmas * c.sigma) ? std::numeric_limits<double>::infinity()
                                                                    : c.change;
  }

  /// All settings one step from the present one.
  std::vector<Candidate> candidates() const {
    std::vector<Candidate> out;
    add_signals(out);
    add_rigid(out);
    add_friction(out);
    return out;
  }

  void add(std::vector<Candidate>& out, std::string what, const auto& change) const {
    Setting s = out_.setting;
    change(s);
    out.push_back({std::move(what), std::move(s)});
  }

  static void without_reversals(Setting& s) {
    s.signals.reversals = false, s.signals.rest_periods = 1, s.signals.turn_lead_s = 0;
  }

  void add_signals(std::vector<Candidate>& out) const {
    const Preparation& now = out_.setting.signals;
    for (const double cutoff : cutoffs_)
      if (cutoff != now.cutoff_hz)
        add(out, fmt::format("cut-off {:.3g} Hz", cutoff), [&](Setting& s) { s.signals.cutoff_hz = cutoff; });
    if (!now.recorded_velocity && have_velocity())
      add(out, "recorded velocity", [](Setting& s) { s.signals.recorded_velocity = true; });
    if (now.reversals) add(out, "no reversals", without_reversals);
    for (const double periods : {1.0, 0.5})
      if (!now.reversals || now.rest_periods != periods)
        add(out, fmt::format("reversals, from {:g} periods of it off rests", periods),
            [&](Setting& s) { s.signals.reversals = true, s.signals.rest_periods = periods; });
  }

  void add_rigid(std::vector<Candidate>& out) const {
    if (rotors_open()) add(out, "no rotor inertias", [](Setting& s) { s.rotor_inertia = false; });
    if (const double prior = new_prior()) add_prior(out, prior);
  }

  bool rotors_open() const { return !decided_.rotor_inertia && out_.setting.rotor_inertia; }

  void add_prior(std::vector<Candidate>& out, double prior) const {
    add(out, prior_text(prior), [&](Setting& s) { s.prior = prior; });
    if (rotors_open())
      add(out, prior_text(prior) + ", no rotor inertias",
          [&](Setting& s) { s.prior = prior, s.rotor_inertia = false; });
  }

  static std::string prior_text(double prior) { return fmt::format("prior of {:.2g} % about the model", 100 * prior); }

  /// The most probable one, where it differs from the present one; else 0.
  double new_prior() const {
    const double found = best_.fit.prior_by_evidence, now = out_.setting.prior;
    if (decided_.prior || found == 0 || (now > 0 && std::abs(std::log(found / now)) < 0.3)) return 0;
    return found;
  }

  void add_friction(std::vector<Candidate>& out) const {
    if (!decided_.law) add_laws(out);
    if (!decided_.asymmetry && !out_.setting.directional.asymmetry)
      add(out, "asymmetry", [](Setting& s) { s.directional.asymmetry = true; });
    if (!decided_.robust)
      for (const Robust robust : {Robust::huber, Robust::tukey})
        if (robust != out_.setting.robust)
          add(out, fmt::format("outliers {}", name_of(robust)), [&](Setting& s) { s.robust = robust; });
  }

  /// Laws that are linear: those with shapes of their own (stribeck, load, extended, ...) have more than one minimum in
  /// a motion of the whole robot; they are for friction curves, or for those who ask for them.
  void add_laws(std::vector<Candidate>& out) const {
    const friction::LawInfo& now = *out_.setting.law;
    const auto add_law = [&](const friction::LawInfo* law) {
      if (law && law != &now) add(out, fmt::format("friction {}", law->name), [&](Setting& s) { s.law = law; });
    };
    if (!decided_.instruments) add_law(with_load(now));
    if (!with_stribeck(now)) return;
    std::vector<double> before;
    for (const double share : stribeck_shares)
      if (const auto shares = shown_shares(share); std::exchange(before, shares) != shares)
        add(out, stribeck_text(shares), [&](Setting& s) {
          s.law = with_stribeck(*s.law);
          s.stribeck_share = shares;
        });
    // A cubic of the speed goes astray beyond the speeds of the recordings; it is worth that for its temperature.
    if (target_.motion.has_temperature && !decided_.instruments) add_law(friction::find_law("polynomial"));
  }

  static std::string stribeck_text(const std::vector<double>& shares) {
    const auto [least, most] = std::ranges::minmax(shares);
    return fmt::format("friction that falls within {:g}{} % of the top speed", 100 * least,
                       least == most ? "" : fmt::format(" to {:g}", 100 * most));
  }

  /// Per rotor, the share of its top speed or the smallest wider one within which enough samples lie to tell friction.
  std::vector<double> shown_shares(double share) const {
    std::vector<double> out;
    for (Index r = 0; r < regressor_.rotors(); ++r) {
      const double* wider = std::ranges::find_if(
          stribeck_shares, [&](double s) { return s >= share && independent_samples(r, s) >= enough_samples; });
      out.push_back(wider == std::ranges::end(stribeck_shares) ? *std::prev(wider) : *wider);
    }
    return out;
  }

  /// Samples that count within this share of the rotor's top speed, two per period of the cut-off. Where those near
  /// reversals count, of stays that are shorter than a period the filter leaves too little.
  double independent_samples(Index rotor, double share) const {
    const Index j = regressor_.joint_of(rotor);
    VectorXd speed(motion_.size());
    for (Index i = 0; i < motion_.size(); ++i) speed(i) = std::abs(regressor_.speed(rotor, motion_.qd.col(i)));
    const double within = share * speed.maxCoeff(), per_period = 1 / (motion_.cutoff_hz * motion_.period_s),
                 shortest = motion_.reversals ? per_period : 1;
    double count = 0, stay = 0;
    for (Index i = 0; i <= motion_.size(); ++i)
      if (i < motion_.size() && motion_.moving(j, i) && speed(i) < within)
        ++stay;
      else
        count += stay >= shortest ? stay : 0, stay = 0;
    return count * std::min(1.0, 2 / per_period);
  }

  /// The narrowest prior, from the most probable one on, that is as good as none and near the best of them: what the
  /// recordings hardly show does not matter to their held-out error, but it does to other motions. What no body gives
  /// (a counterweight, a wrong model) makes the most probable one too narrow, and a wider one better.
  bool take_prior() {
    const double now = out_.setting.prior, probable = now > 0 ? now : new_prior();
    if (probable == 0 || decided_.prior) return false;
    std::vector<Tried> widths;
    double least = 0;  // change of the held-out error
    for (const double wider : prior_widths) {
      if (now > 0 && wider == 1) continue;
      if (auto t = tried_prior(wider * probable)) {
        least = std::min(least, t->comparison.change);
        widths.push_back(*std::move(t));
      }
    }
    const auto good = [&](double change) {
      return (now > 0 || change <= as_good) && (1 + change) / (1 + least) - 1 <= near_best;
    };
    if (now > 0 && good(0)) return false;
    const auto narrowest = std::ranges::find_if(widths, [&](const Tried& t) { return good(t.comparison.change); });
    if (narrowest == widths.end()) return false;
    take(std::move(*narrowest));
    return true;
  }

  /// With rotor inertias or without, whichever is better.
  std::optional<Tried> tried_prior(double prior) {
    std::vector<Candidate> open;
    add_prior(open, prior);
    std::optional<Tried> best;
    for (Candidate& candidate : open)
      if (auto t = tried(std::move(candidate)); t && (!best || t->comparison.change < best->comparison.change))
        best = std::move(t);
    return best;
  }

  /// Steps back to what is simpler where that is hardly worse.
  void simplify() {
    std::vector<Candidate> simpler;
    const Setting& now = out_.setting;
    if (now.signals.reversals) add(simpler, "no reversals", without_reversals);
    if (now.signals.recorded_velocity)
      add(simpler, "no recorded velocity", [](Setting& s) { s.signals.recorded_velocity = false; });
    if (!decided_.asymmetry && now.directional.asymmetry)
      add(simpler, "no asymmetry", [](Setting& s) { s.directional.asymmetry = false; });
    if (!decided_.robust && now.robust != Robust::none)
      add(simpler, "outliers none", [](Setting& s) { s.robust = Robust::none; });
    for (Candidate& candidate : simpler)
      if (auto t = tried(std::move(candidate)); t && t->comparison.change < least_gain) {
        take(*std::move(t));
        return simplify();
      }
  }

  /// Bodies are real before anything is recorded; what makes them predict worse is a part of the torque that no real
  /// body gives. They are kept unless least squares is clearly better.
  void judge_bodies() {
    const auto friction = friction_of(model_, regressor_, out_.setting, torque_max_nm_, target_.motion);
    if (!friction) return;
    const auto real = errors_of(
        regressor_, held_out_of_real_bodies(regressor_, base_, *friction, best_.fit, motion_, threads_), target_);
    out_.real_bodies = real.has_value();
    if (!real) return;
    const Comparison c = compared(*real, best_);
    // Judged by how much better least squares is, whose standard error also holds where bodies are far worse.
    const Comparison gain = compared(best_, *real);
    out_.real_bodies = !is_better(gain, as_good, real_sigmas);
    out_.trials.push_back({.what = "bodies that are real",
                           .change = c.change,
                           .sigma = c.sigma,
                           .rms = real->rms,
                           .taken = out_.real_bodies,
                           .failure = {},
                           .remark = out_.real_bodies ? ""
                                                      : fmt::format("least squares against them {:+.2f} % +- {:.2f}",
                                                                    100 * gain.change, 100 * gain.sigma)});
  }

  /// Torque that depends on the joint's own position, C cos q + S sin q: of springs, cables and sensors, which no rigid
  /// body explains. A claim about the mechanics, as a coupling is. Tried in all hinges, then in those that gained.
  bool choose_position() {
    constexpr double gained = 0.9;
    if (decided_.law || decided_.by_position) return false;
    std::vector<std::string> hinges, better;
    for (Index r = 0; r < regressor_.rotors(); ++r)
      if (may_depend_on_position(regressor_, r) && row_of(regressor_.joint_of(r)) >= 0)
        hinges.push_back(regressor_.rotor_name(r));
    auto all = tried(by_position(hinges));
    if (!all) return false;
    for (Index j = 0; j < regressor_.joints(); ++j)
      if (const Index row = row_of(j); row >= 0 && all->found.rms(row) < gained * best_.rms(row) &&
                                       std::ranges::find(hinges, regressor_.joint_name(j)) != hinges.end())
        better.push_back(regressor_.joint_name(j));
    if (!better.empty() && better.size() < hinges.size())
      if (auto some = tried(by_position(better)); some && some->comparison.change < all->comparison.change)
        all = std::move(some);
    if (!is_better(all->comparison, coupled_gain, coupled_sigmas)) return false;
    take(*std::move(all));
    return true;
  }

  Candidate by_position(const std::vector<std::string>& joints) const {
    Setting s = out_.setting;
    s.by_position = joints;
    return {"torque by position of " + joined(joints), std::move(s)};
  }

  /// Without it in joints that it hardly helps.
  void refine_position() {
    if (decided_.by_position) return;
    for (const std::string& joint : std::vector(out_.setting.by_position)) {
      std::vector<std::string> fewer = out_.setting.by_position;
      std::erase(fewer, joint);
      Setting s = out_.setting;
      s.by_position = std::move(fewer);
      if (auto t = tried({fmt::format("torque of {} not by position", joint), std::move(s)});
          t && t->comparison.change < least_gain)
        take(*std::move(t));
    }
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
      Setting s = out_.setting;
      s.motors = std::move(motors);
      auto t = tried({what, std::move(s)});
      if (t && is_better(t->comparison, coupled_gain, coupled_sigmas))
        take(*std::move(t));
      else
        regressor_ = before, base_ = base_before;
      prepared_.clear();  // a motor's direction is a part of the motion
    }
  }

  /// A lag is found by a law and a cut-off; where others are chosen with it, they may find it better.
  void choose_lags() {
    for (int lags = 0; !decided_.lag && lags < most_lags; ++lags) {
      const Setting before = out_.setting;
      if (!choose_lag()) return;
      search();
      const Setting& now = out_.setting;
      if (now.law == before.law && now.signals.cutoff_hz == before.signals.cutoff_hz &&
          now.signals.recorded_velocity == before.signals.recorded_velocity)
        return;
    }
  }

  /// Errors are counted against torques without the lag, in the setting's own band, those of the setting with it and
  /// without: in the widest one the noise hides what a lag changes (servo 4 of cases_test.py: its lag is not
  /// taken, 1.58 of the best by hand instead of 1.12).
  bool choose_lag() {
    for (const Setting& s : {out_.setting, with_next_wider(out_.setting)})
      if (std::vector<Candidate> open = proven_lags(s); !open.empty()) return take_lag(s, std::move(open));
    return false;
  }

  /// What a lag spoils is least in a narrow band, in which it hardly shows.
  Setting with_next_wider(Setting s) const {
    const auto now = std::ranges::find(cutoffs_, s.signals.cutoff_hz);
    if (now != cutoffs_.begin() && now != cutoffs_.end()) s.signals.cutoff_hz = *std::prev(now);
    return s;
  }

  bool take_lag(const Setting& without, std::vector<Candidate> open) {
    const auto motion = motion_of(without.signals), late = prepared(compared_in(without.signals));
    if (!motion || !late || late->time_s != target_.motion.time_s) return false;
    JointMotion before = std::exchange(target_.motion, *late);
    auto in_own_band = error_of(without, *motion);
    if (!in_own_band) {
      target_.motion = std::move(before);
      return false;
    }
    HeldOut best_before = std::exchange(best_, *std::move(in_own_band));
    std::optional<Late> best = best_of(std::move(open));
    const bool taken = best && (decided_.take_lag || is_better(best->tried.comparison, least_gain, lag_enough));
    target_.motion = taken ? std::move(best->compared) : std::move(before);
    if (taken)
      take(std::move(best->tried)), out_.lag_target_hz = out_.setting.signals.cutoff_hz;
    else
      best_ = std::move(best_before);
    return taken;
  }

  /// Each joint's own, and one for the robot, as far as their sigmas prove them.
  std::vector<Candidate> proven_lags(const Setting& s) const {
    Preparation every_sample = s.signals;  // thinned samples are too coarse for their slopes by time
    every_sample.narrowest_hz = every_sample.widest_hz = 0;
    Setting without_outliers = s;  // which look like steps, and a step like a lag
    without_outliers.robust = decided_.robust.value_or(Robust::tukey);
    DynamicsFit start = best_.fit;
    const auto found = torque_lag(recordings_, regressor_, std::move(every_sample), [&](JointMotion& motion) {
      auto fit = fit_with(without_outliers, motion, start);
      if (fit) start = *fit;
      return fit;
    });
    if (!found) return {};
    const auto proven = [](const Estimate& e) {
      return e.status == Status::estimated && std::abs(e.value) > lag_sigmas * e.sigma;
    };
    std::vector<Candidate> out;
    if (std::ranges::any_of(found->lag, proven)) {
      out.push_back({"lag of torques:" + text_of(found->lag), s});
      out.back().setting.signals.lag_s = found->lag_s(), out.back().setting.lag_of = LagOf::joint;
    }
    if (found->alike && proven(*found->alike)) {
      out.push_back({fmt::format("lag of all torques: {:.2g} ms", 1e3 * found->alike->value), s});
      out.back().setting.signals.lag_s.assign(found->lag.size(), found->alike->value);
      out.back().setting.lag_of = LagOf::robot;
    }
    return out;
  }

  struct Late {
    Tried tried;
    JointMotion compared;  ///< the target without its lag
  };

  /// The last, unless one before it is better by enough.
  std::optional<Late> best_of(std::vector<Candidate> lags) {
    std::optional<Late> best;
    for (Candidate& candidate : lags) {
      auto motion = prepare(recordings_, regressor_, compared_in(candidate.setting.signals));
      if (!motion || motion->time_s != target_.motion.time_s) continue;
      target_.motion = *motion;
      auto t = tried(std::move(candidate));
      if (t && !(best && is_better(compared(best->tried.found, t->found)))) best = {*std::move(t), *std::move(motion)};
    }
    return best;
  }

  Result<DynamicsFit> fit_with(const Setting& s, const JointMotion& motion, const DynamicsFit& start) const {
    const auto friction = friction_of(model_, regressor_, s, torque_max_nm_, target_.motion);
    if (!friction) return tl::unexpected(friction.error());
    DynamicsOptions options = options_of(s, threads_);
    options.lag = true;
    options.start = &start;
    return fit_dynamics(regressor_, base_, *friction, motion, options);
  }

  static std::string text_of(const std::vector<Estimate>& lag) {
    std::string out;
    for (const Estimate& e : lag) out += fmt::format(" {:.2g}", 1e3 * e.value);
    return out + " ms";
  }

  /// The share of the top speed within which friction falls, joint by joint: each takes the one with which its own
  /// torque is predicted best, as another joint's friction hardly matters to it.
  void refine_stribeck() {
    if (decided_.law || with_stribeck(*out_.setting.law) != out_.setting.law) return;
    std::vector<Shares> of_all;
    for (const double share : stribeck_shares)
      if (const auto shares = shown_shares(share); of_all.empty() || shares != of_all.back().share) {
        const auto known = since_.find(stribeck_text(shares));
        if (known != since_.end())
          of_all.push_back({shares, known->second});
        else
          try_shares(stribeck_text(shares), shares, of_all);
      }
    try_shares("... of each joint's own", best_of(of_all), of_all);
    for (const double step : {1.4, 1.18}) {
      const std::vector<double> middle = out_.setting.stribeck_share;
      for (const double factor : {1 / step, step}) {
        std::vector<double> scaled = middle;
        for (double& share : scaled) share *= factor;
        try_shares(fmt::format("... {:.2f} of that", factor), scaled, of_all);
      }
      if (const auto own = best_of(of_all); own != out_.setting.stribeck_share)
        try_shares("... of each joint's own", own, of_all);
    }
  }

  /// When friction turns, against the speed: step by step, as long as it is better.
  bool refine_turns() {
    bool any = false;
    for (const double step_s : {turn_step_s, turn_step_s / 2})
      for (const double sign : {1.0, -1.0}) {
        bool further = true;
        while (further && out_.setting.signals.reversals) {
          const double lead_s = out_.setting.signals.turn_lead_s + sign * step_s;
          if (std::abs(lead_s) > longest_lead / out_.setting.signals.cutoff_hz) break;
          std::vector<Candidate> one;
          add(one, turn_text(lead_s), [&](Setting& s) { s.signals.turn_lead_s = lead_s; });
          further = attempt(std::move(one.front()));
          any |= further;
        }
      }
    return any;
  }

  struct Shares {
    std::vector<double> share;  ///< per rotor
    VectorXd rms;               ///< held out, per joint with torque; empty where it failed
  };

  void try_shares(std::string what, const std::vector<double>& share, std::vector<Shares>& of_all) {
    std::vector<Candidate> one;
    add(one, std::move(what), [&](Setting& s) { s.stribeck_share = share; });
    attempt(std::move(one.front()));
    of_all.push_back({share, out_.trials.back().rms});
  }

  /// Per rotor, the share of the trial in which its joint was predicted best.
  std::vector<double> best_of(const std::vector<Shares>& tried) const {
    std::vector<double> out = tried.front().share;
    std::vector<double> least(out.size(), std::numeric_limits<double>::infinity());
    for (const Shares& t : tried)
      for (std::size_t r = 0; r < out.size(); ++r) {
        const Index row = row_of(regressor_.joint_of(static_cast<Index>(r)));
        if (row < 0 || t.rms.size() == 0 || !(t.rms(row) < least[r])) continue;
        least[r] = t.rms(row), out[r] = t.share[r];
      }
    return out;
  }

  /// The joint's place among those with torque; -1: it is left out.
  Index row_of(Index joint) const {
    if (motion_.is_left_out(joint)) return -1;
    Index row = 0;
    for (Index j = 0; j < joint; ++j) row += !motion_.is_left_out(j);
    return row;
  }

  const std::span<const double> offered_;  ///< cut-offs, as shares of the widest
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
  mutable std::vector<std::pair<Preparation, JointMotion>> prepared_;  ///< with the present motors
  std::map<std::string, double> last_;     ///< change of every candidate of a search when it was last tried
  std::map<std::string, VectorXd> since_;  ///< Trial::rms of those tried since the last step
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
  Decided all = decided;
  if (all.instruments)
    all.asymmetry = false, all.by_position.emplace(), all.robust = Robust::none, all.prior = 0, all.lag = true;
  const auto run = [&](std::span<const double> offered) {
    return Chooser(model, regressor, base, recordings, all, torque_max_nm, threads, progress, offered).run();
  };
  const std::span<const double> every(narrower), first = every.first(first_offered);
  auto choice = run(first);
  if (!choice || all.cutoff_hz) return choice;
  // Narrower ones need longer distances from rests and ends in what is compared: all is compared once more.
  const auto at_edge = [&](const DynamicsChoice& c) {
    return c.setting.signals.cutoff_hz <= 1.01 * first.back() * c.target_hz;
  };
  if (!at_edge(*choice)) return choice;
  auto wider = run(every);
  return wider && at_edge(*wider) ? std::move(wider) : std::move(choice);
}

}  // namespace tribotwin::twin::identification
