#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/identification/dynamics_choice/torque_lag.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index;

constexpr int max_rounds = 10;
/// Of its sigma: a step that small is none.
constexpr double at_rest = 0.05;
/// Of a period of the cut-off.
constexpr double too_wide = 0.25, longest_step = 0.5;

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
    preparation_.reversals = false;
  }

  Result<TorqueLag> run() && {
    for (int round = 0;; ++round) {
      if (auto ok = fit(); !ok) return tl::unexpected(ok.error());
      if (!advance(round)) break;
    }
    name_lags();
    if (std::exchange(preparation_.reversals, reversals_) == reversals_) return std::move(out_);
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

  /// Shifts by what the last fit found; false where nothing moves any more.
  bool advance(int round) {
    bool moves = false;
    for (std::size_t j = 0; j < joints(); ++j) {
      const Estimate& found = out_.fit.lag[j];
      double& lag = preparation_.lag_s[j];
      if (held_[j]) continue;
      const double step = found.value - lag;
      if (found.status != Status::estimated)
        hold(j, "its torque does not show it");
      else if (!(found.sigma <= too_wide * period_s()))
        hold(j, fmt::format("its sigma is {:.2g} ms", 1e3 * found.sigma));
      else if (std::abs(step) <= at_rest * found.sigma)
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
      const double rest = preparation_.lag_s[j] - e.value;
      e.value += rest, e.low += rest, e.high += rest;
      if (held_[j]) e.sigma = e.low = e.high = unknown, e.status = Status::held;
      out_.lag.push_back(e);
    }
  }

  std::span<const RobotRecording> recordings_;
  const Regressor& regressor_;
  Preparation preparation_;
  bool reversals_;  ///< as asked for
  const LagFit& fit_;
  std::vector<bool> held_;
  TorqueLag out_;
};

}  // namespace

std::vector<double> TorqueLag::lag_s() const {
  std::vector<double> out;
  for (const Estimate& e : lag) out.push_back(e.value);
  return out;
}

Result<TorqueLag> torque_lag(std::span<const RobotRecording> recordings, const Regressor& regressor,
                             Preparation preparation, const LagFit& fit) {
  return Search(recordings, regressor, std::move(preparation), fit).run();
}

}  // namespace tribotwin::twin::identification
