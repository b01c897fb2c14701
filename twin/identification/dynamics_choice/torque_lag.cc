#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/identification/dynamics_choice/torque_lag.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index;

constexpr int max_rounds = 6;
/// Of its sigma: a step that small is none.
constexpr double at_rest = 0.05;
/// Of a period of the cut-off.
constexpr double too_wide = 0.25, longest_step = 0.5;
/// Noise of the slopes makes steps too short. A fit that finds less than this part of a lag does not show it.
constexpr double least_part = 0.05;
/// Of sigma: between lags that are closer the part that a step finds is not measured, so the first is not shorter.
constexpr double apart = 0.5;
/// A delay is the same at all frequencies: with this part of the cut-off it differs by fewer of its sigmas.
constexpr double slower = 0.5, alike_sigmas = 3;
constexpr double sigmas_of_95 = 1.96;

class Search {
 public:
  Search(std::span<const RobotRecording> recordings, const Regressor& regressor, Preparation preparation,
         const LagFit& fit)
      : recordings_(recordings),
        regressor_(regressor),
        preparation_(std::move(preparation)),
        reversals_(preparation_.reversals),
        fit_(fit) {
    preparation_.lag_s.resize(joints(), 0);
    held_.resize(joints(), false);
    steps_.resize(joints());
    preparation_.reversals = false;
  }

  Result<TorqueLag> run(LagOf of) && {
    if (auto ok = settle(); !ok) return tl::unexpected(ok.error());
    if (hold_where_slower_differs())
      if (auto ok = settle(); !ok) return tl::unexpected(ok.error());
    name_lags();
    out_.alike = alike();
    const bool one = of == LagOf::robot && out_.alike;
    if (one) share(*out_.alike);
    if (std::exchange(preparation_.reversals, reversals_) == reversals_ && !one) return std::move(out_);
    if (auto ok = fit(); !ok) return tl::unexpected(ok.error());
    return std::move(out_);
  }

 private:
  std::size_t joints() const { return static_cast<std::size_t>(regressor_.joints()); }
  double period_s() const { return 1 / out_.motion.cutoff_hz; }

  Result<void> fit() {
    auto motion = prepare(recordings_, regressor_, preparation_);
    if (!motion) return tl::unexpected(motion.error());
    out_.motion = *std::move(motion);
    auto fit = fit_(out_.motion);
    if (!fit) return tl::unexpected(fit.error());
    out_.fit = *std::move(fit);
    return {};
  }

  Result<void> settle() {
    for (int round = 0;; ++round) {
      if (auto ok = fit(); !ok) return ok;
      if (!advance(round)) return {};
    }
  }

  /// Whether a lag is held as slower motion shows another one: elasticity, or friction that the law does not know.
  /// Where slower motion does not show it, it stands as it is.
  bool hold_where_slower_differs() {
    if (std::ranges::all_of(held_, std::identity{})) return false;
    Search slow(recordings_, regressor_, preparation_, fit_);
    slow.preparation_.cutoff_hz = slower * out_.motion.cutoff_hz;
    slow.held_ = held_;
    if (!slow.settle()) return false;
    bool any = false;
    for (std::size_t j = 0; j < joints(); ++j) {
      if (held_[j] || slow.held_[j]) continue;
      const auto [lag, sigma] = lag_and_sigma(j);
      const auto [slow_lag, slow_sigma] = slow.lag_and_sigma(j);
      // The slower one sees a part of the same data: by Hausman its variance less the other's is that of the
      // difference.
      const double apart_s = std::sqrt(std::max(slow_sigma * slow_sigma - sigma * sigma, sigma * sigma));
      if (std::abs(slow_lag - lag) <= alike_sigmas * apart_s) continue;
      hold(j, fmt::format("it would be {:.2g} ms up to {:.3g} Hz and {:.2g} ms up to {:.3g} Hz, and a delay is the "
                          "same at all frequencies",
                          1e3 * lag, out_.motion.cutoff_hz, 1e3 * slow_lag, slow.out_.motion.cutoff_hz));
      any = true;
    }
    return any;
  }

  std::pair<double, double> lag_and_sigma(std::size_t j) const {
    return {preparation_.lag_s[j], out_.fit.lag[j].sigma / steps_[j].part};
  }

  /// Shifts by what the last fit found; false where nothing moves any more.
  bool advance(int round) {
    bool moves = false;
    for (std::size_t j = 0; j < joints(); ++j) {
      const Estimate& found = out_.fit.lag[j];
      double& lag = preparation_.lag_s[j];
      if (held_[j]) continue;
      Steps& steps = steps_[j];
      steps.add(lag, found.value - lag, found.sigma);
      const double sigma = found.sigma / steps.part, step = steps.next_s(sigma);
      if (found.status != Status::estimated)
        hold(j, "its torque does not show it");
      else if (!(sigma <= too_wide * period_s()) || steps.part < least_part)
        hold(j, fmt::format("its sigma is {:.2g} ms", 1e3 * sigma));
      else if (std::abs(step) <= at_rest * sigma)
        continue;
      else if (round >= max_rounds)
        hold(j, fmt::format("it still moves by {:.2g} ms after {} steps", 1e3 * step, max_rounds));
      else
        lag += std::clamp(step, -longest_step * period_s(), longest_step * period_s()), moves = true;
      moves = moves || held_[j];
    }
    return moves;
  }

  /// At 0.
  void hold(std::size_t j, const std::string& why) {
    held_[j] = true;
    preparation_.lag_s[j] = 0;
    out_.notes.push_back(fmt::format("the lag of torque_{}_{} is not identifiable from these data and taken as 0: {}",
                                     regressor_.joint_name(static_cast<Index>(j)),
                                     regressor_.is_slide(static_cast<Index>(j)) ? "n" : "nm", why));
  }

  void name_lags() {
    constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    for (std::size_t j = 0; j < joints(); ++j) {
      Estimate e = out_.fit.lag[j];
      const double rest = preparation_.lag_s[j] - e.value,
                   wider = spread_of(out_.fit.lag_of_files, static_cast<Index>(j)).factor() / steps_[j].part;
      e.value += rest, e.sigma *= wider;
      e.low = e.value + (e.low + rest - e.value) * wider;
      e.high = e.value + (e.high + rest - e.value) * wider;
      if (held_[j]) e.sigma = e.low = e.high = unknown, e.status = Status::held;
      out_.lag.push_back(e);
    }
  }

  std::optional<Estimate> alike() const {
    double weights = 0, sum = 0, squares = 0;
    int estimated = 0;
    for (const Estimate& e : out_.lag) {
      if (e.status != Status::estimated) continue;
      const double weight = 1 / (e.sigma * e.sigma);
      weights += weight, sum += weight * e.value, squares += weight * e.value * e.value, ++estimated;
    }
    if (estimated == 0 || joints() < 2) return std::nullopt;
    const double mean = sum / weights, sigma = 1 / std::sqrt(weights);
    if (estimated > 1 && squares - weights * mean * mean > chi_squared_quantile(estimated - 1, 0.95))
      return std::nullopt;
    return Estimate{"", "s", mean, sigma, mean - sigmas_of_95 * sigma, mean + sigmas_of_95 * sigma, Status::estimated};
  }

  void share(const Estimate& lag) {
    for (std::size_t j = 0; j < joints(); ++j) {
      const std::string name = out_.lag[j].name;
      out_.lag[j] = lag, out_.lag[j].name = name;
      preparation_.lag_s[j] = lag.value;
    }
    out_.notes.clear();  // of joints that do not show theirs
  }

  /// The last two lags that were tried and what the fits made of them.
  struct Steps {
    double lag_s = 0, step_s = 0;
    double part = 1;  ///< of what the lag is off that a step finds, by these two
    bool any = false, measured = false;

    void add(double lag, double step, double sigma) {
      if (any && std::abs(lag - lag_s) >= apart * sigma)
        part = std::clamp((step_s - step) / (lag - lag_s), 0.0, 1.0), measured = true;
      lag_s = lag, step_s = step, any = true;
    }
    double next_s(double sigma) const {
      const double step = step_s / part;
      return measured || std::abs(step) > 2 * apart * sigma ? step : std::copysign(2 * apart * sigma, step);
    }
  };

  std::span<const RobotRecording> recordings_;
  const Regressor& regressor_;
  Preparation preparation_;
  bool reversals_;  ///< as asked for
  const LagFit& fit_;
  std::vector<bool> held_;
  std::vector<Steps> steps_;
  TorqueLag out_;
};

}  // namespace

std::vector<double> TorqueLag::lag_s() const {
  std::vector<double> out;
  for (const Estimate& e : lag) out.push_back(e.value);
  return out;
}

Result<TorqueLag> torque_lag(std::span<const RobotRecording> recordings, const Regressor& regressor,
                             Preparation preparation, const LagFit& fit, LagOf of) {
  return Search(recordings, regressor, std::move(preparation), fit).run(of);
}

}  // namespace tribotwin::twin::identification
