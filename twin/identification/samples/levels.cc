#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <tuple>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/twin/identification/samples/lag.hpp>
#include <tribotwin/twin/identification/samples/levels.hpp>
#include <tribotwin/twin/identification/samples/ripple.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin {
namespace {

using namespace curves;

/// Travel from the turn between two passes until the torque beyond the load is half the friction in the new direction.
double lost_motion_rad(const JointRecording& r, const Pair& pair, const Profile& profile, double friction_nm,
                       double lag_s) {
  const bool forward_first = pair.forward.begin < pair.reverse.begin;
  const Pass &before = forward_first ? pair.forward : pair.reverse,
             &after = forward_first ? pair.reverse : pair.forward;
  const double direction = forward_first ? -1 : 1;
  std::size_t turn = before.end - 1;
  for (std::size_t i = turn; i < after.begin; ++i)
    if (direction * r.position_rad[i] < direction * r.position_rad[turn]) turn = i;
  // The load is known over the common positions; this far beyond them it is nearly the same.
  constexpr double near_rad = 0.02;
  if (std::max(pair.low - r.position_rad[turn], r.position_rad[turn] - pair.high) > near_rad) return 0;
  const auto travelled = [&](std::size_t i) { return direction * (r.position_rad[i] - r.position_rad[turn]); };
  // Share of the friction that opposes the new direction, the mean of a few samples against the noise.
  constexpr std::size_t some = 5;
  const auto share = [&](std::size_t i) {
    double sum = 0;
    for (std::size_t k = i; k < i + some; ++k) {
      const double x = profile.scaled(r.position_rad[k]);
      sum += direction * (profile.torque({k, x, 0}, lag_s) - profile.common_nm(std::clamp(x, -1.0, 1.0)));
    }
    return sum / (static_cast<double>(some) * friction_nm);
  };
  // Inertia that takes a third of the friction off while the joint brakes hides what comes after the turn as well.
  for (std::size_t i = before.end - 1; i <= turn; ++i)
    if (i + some > after.begin || share(i) > -0.7) return 0;
  std::size_t end = turn;
  while (end + some < after.end && share(end) < 0.5) ++end;
  return std::max(0.0, travelled(end));
}

/// What a window of the positions of one level contains.
struct Window {
  std::array<std::vector<double>, 2> beyond_load;  ///< torque beyond the recorded load, forward and reverse
  double load = 0, load_magnitude = 0, temperature = 0, count = 0, slope = 0;  ///< sums over the samples
};
bool inside(const Profile& profile, const LevelOptions& options, double x) {
  return std::abs(profile.position(x) - options.centre_rad) <= 0.5 * options.width_rad;
}
Window window_of(const JointRecording& r, const Profile& profile, const LevelOptions& options, double lag_s) {
  Window w;
  for (const Profile::Row& row : profile.rows()) {
    if (!inside(profile, options, row.x)) continue;
    const double l = r.load_nm.empty() ? profile.common_nm(row.x) : r.load_nm[row.sample];
    if (!r.load_nm.empty()) w.beyond_load[row.sign > 0 ? 0 : 1].push_back(profile.torque(row, lag_s) - l);
    w.load += l;
    w.load_magnitude += std::abs(l);
    w.slope += profile.common_slope_nm_rad(row.x);
    if (!r.temperature_degC.empty()) w.temperature += r.temperature_degC[row.sample];
    ++w.count;
  }
  return w;
}

/// Standard error of a mean of `count` differences: their scatter beyond the trend with |load|, which is no error. Of
/// all samples, for a narrow window has few.
double scatter_nm(const Profile& profile, const Profile::Difference& both, std::size_t count) {
  const auto n = static_cast<Eigen::Index>(both.x.size());
  Eigen::MatrixXd trend(n, 2);
  for (Eigen::Index i = 0; i < n; ++i)
    trend.row(i) << 1, std::abs(profile.common_nm(both.x[static_cast<std::size_t>(i)]));
  const Eigen::Map<const Eigen::VectorXd> all(both.friction_nm.data(), n);
  const Eigen::VectorXd noise = all - trend * ShortestSolution(trend)(all);
  return mean_of({noise.data(), both.x.size()}, 2).stderr_ *
         std::sqrt(static_cast<double>(n) / static_cast<double>(count));
}

/// How far the mirror image of the reverse pass is from the forward one, in time [s]: last sample against first.
double offset_s(const JointRecording& r, const Pair& pair) {
  const std::size_t mirrored = std::min(pair.forward.end - pair.forward.begin, pair.reverse.end - pair.reverse.begin);
  double sum = 0;
  for (std::size_t i = 0; i < mirrored; ++i)
    sum += std::abs(r.position_rad[pair.forward.end - 1 - i] - r.position_rad[pair.reverse.begin + i]) /
           (pair.speed() * static_cast<double>(mirrored));
  return sum;
}

/// The level of a pair. Sets `ripple` to the ripple found in it. `known` is a ripple that other levels show; it is
/// removed from a pass too short to show it.
Level measured(const JointRecording& r, const Pair& pair, const Profile& profile, const LevelOptions& options,
               double lag_s, double lag_stderr_s, Ripple& ripple, const Ripple& known = {}) {
  const Window window = window_of(r, profile, options, lag_s);
  const double v = pair.speed(), by_lag = v * window.slope / window.count * lag_stderr_s;
  Profile::Difference both = profile.difference(lag_s);
  ripple = ripple_of(profile, both);
  if (known.per_turn > 0 && ripple.per_turn == 0) {
    const double share = std::accumulate(both.friction_nm.begin(), both.friction_nm.end(), 0.0) /
                         static_cast<double>(both.x.size()) / known.friction_nm;
    for (std::size_t i = 0; i < both.x.size(); ++i) both.friction_nm[i] -= share * known(profile.position(both.x[i]));
  }
  std::vector<double> difference;
  for (std::size_t i = 0; i < both.x.size(); ++i)
    if (inside(profile, options, both.x[i])) difference.push_back(both.friction_nm[i]);
  double friction = 0;
  for (const double f : difference) friction += f / static_cast<double>(difference.size());
  Level level{.speed_rad_s = v,
              .friction_nm = friction,
              .stderr_nm = std::hypot(scatter_nm(profile, both, difference.size()), by_lag),
              .forward = {},
              .backward = {},
              .load_nm = std::copysign(window.load_magnitude / window.count, window.load),
              .temperature_degC = r.temperature_degC.empty() ? std::nan("") : window.temperature / window.count,
              .samples = static_cast<std::size_t>(window.count),
              .offset_s = offset_s(r, pair),
              .begin_s = r.time_s[pair.begin()],
              .end_s = r.time_s[std::max(pair.forward.end, pair.reverse.end) - 1]};
  if (!r.load_nm.empty()) {
    const Mean up = mean_of(window.beyond_load[0]), down = mean_of(window.beyond_load[1]);
    level.forward = {up.value, std::hypot(up.stderr_, by_lag)};
    level.backward = {-down.value, std::hypot(down.stderr_, by_lag)};
  }
  ripple.friction_nm = friction;
  level.ripple_nm = ripple.amplitude_nm();
  level.lost_motion_rad = lost_motion_rad(r, pair, profile, friction, lag_s);
  return level;
}

/// Fails where the velocity column is not the slope of the positions.
Result<void> check_velocity(const JointRecording& r, const std::vector<Pass>& passes) {
  if (r.velocity_rad_s.empty()) return {};
  double given = 0, travelled = 0, samples = 0;
  for (const Pass& p : passes)
    for (std::size_t i = p.begin; i < p.end; ++i, ++samples) {
      given += std::copysign(r.velocity_rad_s[i], p.speed * r.velocity_rad_s[i]);
      travelled += p.magnitude();
    }
  if (std::abs(given - travelled) > 0.2 * travelled && samples > 50)
    return tl::unexpected(fmt::format(
        "velocity_rad_s is {:.3g} times as fast as position_rad moves; both must be of the joint, in radians",
        given / travelled));
  return {};
}

/// Why no pair has the speed v.
std::string missing(double v, const std::vector<Pass>& passes, const std::vector<std::string>& left_out) {
  bool forward = false, reverse = false;
  for (const Pass& p : passes)
    if (alike(p.magnitude(), v)) (p.speed > 0 ? forward : reverse) = true;
  const char* which = !forward && !reverse ? "no pass"
                      : !reverse           ? "no reverse pass"
                      : !forward           ? "no forward pass"
                                           : "no pair of passes over the same positions";
  std::string why = fmt::format("{} at {:.3g} rad/s", which, v);
  const auto some = static_cast<std::ptrdiff_t>(std::min<std::size_t>(3, left_out.size()));
  if (some) why += fmt::format(" ({})", joined(std::span(left_out).first(static_cast<std::size_t>(some)), "; "));
  return why;
}

/// One pair for each speed: the nearest in speed, then the longest, then the first, for approaches may run at the speed
/// of a level.
Result<std::vector<Pair>> pairs_at(const std::vector<double>& speeds_rad_s, const JointRecording& r,
                                   const std::vector<Pair>& pairs, const std::vector<Pass>& passes,
                                   const std::vector<std::string>& left_out) {
  std::vector<Pair> wanted;
  std::vector<bool> used(pairs.size());
  for (const double v : speeds_rad_s) {
    const auto rank = [&](const Pair& p) {
      const double duration = r.time_s[p.forward.end - 1] - r.time_s[p.forward.begin];
      return std::tuple(std::lround(std::abs(p.speed() - v) / v / 0.005), -std::lround(4 * std::log2(duration)));
    };
    std::size_t best = pairs.size();
    for (std::size_t i = 0; i < pairs.size(); ++i)
      if (!used[i] && alike(pairs[i].speed(), v) && (best == pairs.size() || rank(pairs[i]) < rank(pairs[best])))
        best = i;
    if (best == pairs.size()) return tl::unexpected(missing(v, passes, left_out));
    used[best] = true;
    wanted.push_back(pairs[best]);
  }
  return wanted;
}

void fit_all(std::vector<Profile>& profiles, double lag_s) {
  for (Profile& p : profiles)
    if (!p.too_short()) p.fit(lag_s);
}

/// The lag of the torque column from what constant speeds show of it. Where gravity shows nothing, a lag of a few
/// control cycles either way is as likely as none.
void estimate_lag(std::vector<Profile>& profiles, Levels& result) {
  constexpr double usual_s = 0.02;
  for (int round = 0; round < 20; ++round) {
    double square = 0, product = 0, variance = 0, count = 0;
    for (const Profile& p : profiles)
      if (!p.too_short()) {
        const auto i = p.information(result.lag_s);
        square += i.square;
        product += i.product;
        variance += i.variance * i.count;  // of all together: one level's own is too uncertain to weigh it by
        count += i.count;
      }
    if (count > 0) square /= variance / count, product /= variance / count;
    square += 1 / (usual_s * usual_s);
    product -= result.lag_s / (usual_s * usual_s);
    result.lag_stderr_s = 1 / std::sqrt(square);
    const double change = std::clamp(product / square, -0.05, 0.05);
    result.lag_s += change;
    fit_all(profiles, result.lag_s);
    if (std::abs(change) < 0.01 * result.lag_stderr_s) break;
  }
}

/// Fits the profiles at the lag that is given, that ramps show or that the profiles themselves show.
void fit_with_lag(const JointRecording& r, const LevelOptions& options, std::vector<Profile>& profiles,
                  Levels& result) {
  const std::optional<Lag> lag =
      options.lag_s ? Lag{*options.lag_s, 0} : lag_of_torque(r, position_error_rad(r.position_rad));
  if (lag) {
    result.lag_s = lag->lag_s;
    result.lag_stderr_s = lag->stderr_s;
  }
  fit_all(profiles, result.lag_s);
  if (!lag) estimate_lag(profiles, result);
}

/// Why a level cannot be measured; empty where it can.
std::string too_short(const Profile& profile, const Pair& pair, const LevelOptions& options) {
  std::size_t samples[2] = {0, 0};
  for (const auto& row : profile.rows())
    if (inside(profile, options, row.x)) ++samples[row.sign > 0];
  if (!profile.too_short() && std::min(samples[0], samples[1]) >= 3) return {};
  const bool window = std::isfinite(options.width_rad);
  return fmt::format(
      "the passes at {:.3g} rad/s share {:.4g} .. {:.4g} rad, too little{}", pair.speed(), pair.low, pair.high,
      window ? fmt::format(" of {:.4g} +- {:.2g} rad", options.centre_rad, 0.5 * options.width_rad) : "");
}

bool same_harmonic(const Ripple& a, const Ripple& b) {
  return a.per_turn > 0 && std::abs(a.per_turn - b.per_turn) <= a.resolution + b.resolution;
}

/// Keeps a ripple only where a level of another speed shows it too: a ripple over the angle appears at every speed, one
/// at a single speed may be periodic in time.
void confirm_ripples(std::vector<Level>& levels, std::vector<Ripple>& ripples) {
  const auto confirmed = [&](std::size_t k) {
    for (std::size_t j = 0; j < levels.size(); ++j)
      if (!alike(levels[j].speed_rad_s, levels[k].speed_rad_s) && same_harmonic(ripples[j], ripples[k])) return true;
    return false;
  };
  for (std::size_t k = 0; k < levels.size(); ++k)
    if (levels[k].ripple_nm > 0 && !confirmed(k)) levels[k].ripple_nm = 0;
  for (std::size_t k = 0; k < levels.size(); ++k)
    if (levels[k].ripple_nm == 0) ripples[k] = {};
}

/// The strongest ripple as the slowest level shows it, and the speed of that; its phase is known best there.
std::optional<std::pair<Ripple, double>> known_ripple(const std::vector<Level>& levels,
                                                      const std::vector<Ripple>& ripples) {
  const Ripple strongest = *std::ranges::max_element(ripples, {}, &Ripple::amplitude_nm);
  if (!(strongest.per_turn > 0)) return std::nullopt;
  std::pair<Ripple, double> slowest{strongest, std::numeric_limits<double>::infinity()};
  for (std::size_t k = 0; k < levels.size(); ++k)
    if (same_harmonic(ripples[k], strongest) && levels[k].speed_rad_s < slowest.second)
      slowest = {ripples[k], levels[k].speed_rad_s};
  return slowest;
}

/// Measures all levels, twice those too short for a ripple that others show. Fails where a speed that was asked for
/// cannot be measured, or none can.
Result<void> measure(const JointRecording& r, const LevelOptions& options, const std::vector<Pair>& pairs,
                     const std::vector<Profile>& profiles, Levels& result) {
  std::vector<Ripple> ripples;
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (const std::string why = too_short(profiles[i], pairs[i], options); !why.empty()) {
      if (!options.speeds_rad_s.empty()) return tl::unexpected(why);
      result.left_out.push_back(why);
      continue;
    }
    kept.push_back(i);
    result.levels.push_back(
        measured(r, pairs[i], profiles[i], options, result.lag_s, result.lag_stderr_s, ripples.emplace_back()));
  }
  if (result.levels.empty()) return tl::unexpected(result.left_out.front());
  confirm_ripples(result.levels, ripples);
  if (const auto known = known_ripple(result.levels, ripples))
    for (std::size_t k = 0; k < kept.size(); ++k)
      if (Ripple ignored; result.levels[k].speed_rad_s < known->second)
        result.levels[k] = measured(r, pairs[kept[k]], profiles[kept[k]], options, result.lag_s, result.lag_stderr_s,
                                    ignored, known->first);
  return {};
}

}  // namespace

Result<Levels> levels_of(const JointRecording& r, const LevelOptions& options) {
  if (auto ok = check(r); !ok) return tl::unexpected(ok.error());
  Levels result;
  const std::vector<Pass> passes = passes_of(r, result.left_out);
  if (passes.empty()) {
    std::string why = "no stretch of constant speed in the recording";
    if (!result.left_out.empty()) why += fmt::format(": {}", result.left_out.front());
    return tl::unexpected(why);
  }
  if (auto ok = check_velocity(r, passes); !ok) return tl::unexpected(ok.error());
  std::vector<Pair> pairs = paired(r, passes, result.left_out);
  if (!options.speeds_rad_s.empty()) {
    auto wanted = pairs_at(options.speeds_rad_s, r, pairs, passes, result.left_out);
    if (!wanted) return tl::unexpected(wanted.error());
    pairs = *std::move(wanted);
  }
  if (pairs.empty()) return tl::unexpected(result.left_out.front());
  std::vector<Profile> profiles;
  for (const Pair& pair : pairs) profiles.emplace_back(r, pair);
  fit_with_lag(r, options, profiles, result);
  if (auto ok = measure(r, options, pairs, profiles, result); !ok) return tl::unexpected(ok.error());
  return result;
}

}  // namespace tribotwin::twin
