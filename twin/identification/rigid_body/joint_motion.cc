#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>
#include <tribotwin/twin/identification/time_series.hpp>
#include <tribotwin/twin/numerics/direction.hpp>
#include <tribotwin/twin/numerics/filter.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Below this share of its largest speed a joint may stick: no sliding friction.
constexpr double slow = SlowRows::share;
/// Nor below this many standard deviations of the speed's noise, as long as that leaves speeds to look at.
constexpr double above_noise = 4, slow_with_noise = 0.1;
/// Of a joint's range in the recordings: less in one direction may be within the bristles of its friction, or the last
/// swing of a controller that has stopped it.
constexpr double far = 0.001;
/// Periods of the cut-off that are left out at the ends. The filter rings for two, as what comes before a record begins
/// is not known, and its accelerations are a step to the filter; but short records have their slow rows there.
constexpr double ringing = 0.5;
/// A joint that is slow for more of a period of the cut-off may have stuck; in less it has turned.
constexpr double longest_turn = 0.5;

struct Stretch {
  std::size_t first, last;  ///< inclusive
};

/// Cubic through the four samples around a time: linear interpolation would add steps to the accelerations.
double interpolated(const std::vector<double>& time, const MatrixXd& values, Index joint, const Stretch& s, double t) {
  const auto after = static_cast<std::size_t>(std::upper_bound(time.begin() + static_cast<std::ptrdiff_t>(s.first),
                                                               time.begin() + static_cast<std::ptrdiff_t>(s.last), t) -
                                              time.begin());
  const std::size_t first = std::clamp(after < 2 ? 0 : after - 2, s.first, s.last - 3);
  double sum = 0;
  for (std::size_t a = first; a < first + 4; ++a) {
    double basis = values(joint, static_cast<Index>(a));
    for (std::size_t b = first; b < first + 4; ++b)
      if (b != a) basis *= (t - time[b]) / (time[a] - time[b]);
    sum += basis;
  }
  return sum;
}

std::vector<double> equidistant(const RobotRecording& rec, const MatrixXd& values, Index joint, const Stretch& s,
                                double period, bool regular) {
  std::vector<double> out;
  if (regular) {
    out.reserve(s.last - s.first + 1);
    for (std::size_t i = s.first; i <= s.last; ++i) out.push_back(values(joint, static_cast<Index>(i)));
    return out;
  }
  const auto count = static_cast<std::size_t>((rec.time_s[s.last] - rec.time_s[s.first]) / period + 1e-6) + 1;
  for (std::size_t k = 0; k < count; ++k)
    out.push_back(interpolated(rec.time_s, values, joint, s, rec.time_s[s.first] + static_cast<double>(k) * period));
  return out;
}

/// The sampling of a recording: stretches without a gap, and whether their steps are equal.
struct Sampling {
  double typical_s = 0;
  std::vector<Stretch> stretches{{0, 0}};
  std::size_t gaps = 0, uneven = 0;
  bool regular() const { return uneven == 0; }
};

/// Where none is given.
double usual_cutoff_hz(double step_s) { return std::min(20.0, 0.2 / step_s); }

/// A hole in time that is short against the period of the cut-off is no gap: interpolation crosses it.
Sampling sampling_of(const RobotRecording& rec, const Preparation& preparation, std::vector<std::string>& notes) {
  const auto& time = rec.time_s;
  Sampling s{.typical_s = median_step(rec.time_s)};
  const double cutoff = preparation.cutoff_hz > 0 ? preparation.cutoff_hz : usual_cutoff_hz(s.typical_s);
  const double hole_s = preparation.longest_hole_s > 0 ? preparation.longest_hole_s : hole_periods / cutoff;
  const double longest_s = std::max(gap_steps * s.typical_s, hole_s);
  for (std::size_t i = 1; i < time.size(); ++i) {
    const double step_s = time[i] - time[i - 1];
    if (step_s > longest_s) {
      s.stretches.push_back({i, i});
      ++s.gaps;
    } else {
      s.stretches.back().last = i;
      s.uneven += std::abs(step_s - s.typical_s) > 0.02 * s.typical_s;
    }
  }
  if (s.gaps)
    notes.push_back(fmt::format("{}: {} gaps in time_s; the stretches between them are used one by one",
                                rec.file.string(), s.gaps));
  if (!s.regular())
    notes.push_back(
        fmt::format("{}: time_s is not equidistant ({} of {} steps differ from {:.4g} s); resampled at that period",
                    rec.file.string(), s.uneven, time.size() - 1, s.typical_s));
  return s;
}

bool is_long_enough(const RobotRecording& rec, const Stretch& s) {
  return rec.time_s[s.last] - rec.time_s[s.first] >= 1 && s.last - s.first >= 20;
}

/// How a stretch is filtered and decimated.
struct Filtering {
  double period_s, rate_hz, cutoff_hz;
  Index every;                      ///< samples per kept one
  Index edge;                       ///< samples left out at either end, where the filter rings or a lag reaches beyond
  Index beside_rest, longest_turn;  ///< samples
  Index beside_slow;                ///< kept samples; 0: those near reversals count
  double turn_lead;                 ///< samples
};

Result<Filtering> filtering_of(const RobotRecording& rec, const Stretch& s, const Sampling& sampling,
                               const Preparation& preparation) {
  const double length = rec.time_s[s.last] - rec.time_s[s.first];
  const double period = sampling.regular() ? length / static_cast<double>(s.last - s.first) : sampling.typical_s,
               rate = 1 / period;
  const double cutoff = preparation.cutoff_hz > 0 ? preparation.cutoff_hz : std::min(20.0, rate / 5);
  if (cutoff > 0.45 * rate)
    return tl::unexpected(
        Error(fmt::format("{}: is sampled at {:.4g} Hz; the cut-off must be below {:.4g} Hz, it is {:g}",
                          rec.file.string(), rate, 0.45 * rate, cutoff)));
  const double settling = preparation.narrowest_hz > 0 ? preparation.narrowest_hz : cutoff,
               widest = preparation.widest_hz > 0 ? preparation.widest_hz : cutoff,
               guard = SlowRows::periods * rate / cutoff;
  const Index every = preparation.decimation
                          ? preparation.decimation
                          : std::max<Index>(1, static_cast<Index>(std::floor(rate / (5 * widest) + 1e-6)));
  double longest_lag_s = 0;
  for (const double lag : preparation.lag_s) longest_lag_s = std::max(longest_lag_s, std::abs(lag));
  return Filtering{
      .period_s = period,
      .rate_hz = rate,
      .cutoff_hz = cutoff,
      .every = every,
      .edge = static_cast<Index>(std::ceil(std::max(ringing / settling, longest_lag_s) * rate)),
      .beside_rest = static_cast<Index>(std::ceil(preparation.rest_periods * rate / cutoff)),
      .longest_turn = static_cast<Index>(longest_turn * rate / std::max(cutoff, widest)),
      .beside_slow = preparation.reversals ? 0 : static_cast<Index>(std::ceil(guard / static_cast<double>(every))),
      .turn_lead = preparation.reversals ? preparation.turn_lead_s * rate : 0};
}

/// The samples of one joint in a stretch, filtered where they are noisy.
struct JointSamples {
  std::vector<double> q, speed, acceleration, torque, temperature;
  double speed_noise;  ///< standard deviation
};

/// A prepared stretch.
struct Part {
  MatrixXd q, qd, qdd, torque, temperature;
  std::vector<double> time;
  std::size_t file;
  Filtering filtering;
  std::vector<std::vector<double>> speed;  ///< per joint, of every sample
  std::vector<double> speed_noise;         ///< per joint
};

/// Of white noise, by what the filter takes from a signal; half of the samples may hold anything else.
double noise_of(const std::vector<double>& raw, const std::vector<double>& filtered, double passed) {
  std::vector<double> taken(raw.size());
  for (std::size_t i = 0; i < raw.size(); ++i) taken[i] = std::abs(raw[i] - filtered[i]);
  return 1.4826 * median_of(std::move(taken)) / std::sqrt(1 - passed);
}

/// A filtered signal that much later: cubic through four samples, constant beyond the ends.
std::vector<double> advanced(const std::vector<double>& signal, double samples) {
  const auto last = static_cast<std::ptrdiff_t>(signal.size()) - 1;
  const double whole = std::floor(samples), w = samples - whole;
  const double weights[] = {-w * (w - 1) * (w - 2) / 6, (w + 1) * (w - 1) * (w - 2) / 2, -(w + 1) * w * (w - 2) / 2,
                            (w + 1) * w * (w - 1) / 6};
  std::vector<double> out(signal.size());
  for (std::ptrdiff_t i = 0; i <= last; ++i)
    for (std::ptrdiff_t k = 0; k < 4; ++k)
      out[static_cast<std::size_t>(i)] += weights[k] * signal[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(
                                                           i + static_cast<std::ptrdiff_t>(whole) + k - 1, 0, last))];
  return out;
}

/// A joint's positions and speed in a stretch, all filtered alike: the slope of its positions, and as recorded.
struct Speeds {
  std::vector<double> q, slope, recorded;
  double rate_hz, noise;  ///< noise: standard deviation of that of `recorded`
  Index edge;             ///< samples at either end in which the filter rings
};

/// A filtered velocity that much earlier; at the end, where that is not recorded, the slope of the positions.
std::vector<double> on_time(const Speeds& x, double delay_s) {
  std::vector<double> out = advanced(x.recorded, delay_s * x.rate_hz);
  const auto beyond = std::min<std::ptrdiff_t>(
      std::ssize(out), static_cast<std::ptrdiff_t>(std::ceil(std::abs(delay_s) * x.rate_hz)) + 2);
  if (delay_s > 0)
    std::copy(x.slope.end() - beyond, x.slope.end(), out.end() - beyond);
  else if (delay_s < 0)
    std::copy(x.slope.begin(), x.slope.begin() + beyond, out.begin());
  return out;
}

/// d of v(t) = s(t - d) by Gauss-Newton, s being the slope of the positions: sum s' (s - v) over sum s' v', as the
/// noise of s in s'^2 would make each step too short. Sigma by the scatter between parts of the time, so that noise may
/// correlate. Without a sigma (infinite) where there is too little time or motion.
std::pair<double, double> delay_of(const std::vector<Speeds>& stretches) {
  constexpr int rounds = 4, least_parts = 8;
  constexpr double part_s = 0.5, longest_s = 0.1;
  const std::pair<double, double> not_measured{0, std::numeric_limits<double>::infinity()};
  double delay_s = 0;
  for (int round = 0;; ++round) {
    std::vector<double> parts;
    double all = 0, slopes = 0;
    for (const Speeds& x : stretches) {
      const std::vector<double> v = advanced(x.recorded, delay_s * x.rate_hz);
      const auto margin = static_cast<std::size_t>(x.edge) + static_cast<std::size_t>(longest_s * x.rate_hz) + 2,
                 length = std::max<std::size_t>(1, static_cast<std::size_t>(part_s * x.rate_hz));
      for (std::size_t i = margin; i + margin < v.size(); ++i) {
        if ((i - margin) % length == 0) parts.push_back(0);
        const double by_time = (x.slope[i + 1] - x.slope[i - 1]) * x.rate_hz / 2;
        parts.back() += by_time * (x.slope[i] - v[i]);
        slopes += by_time * (v[i + 1] - v[i - 1]) * x.rate_hz / 2;
      }
    }
    if (std::ssize(parts) < least_parts || !(slopes > 0)) return not_measured;
    double squares = 0;
    for (const double x : parts) all += x, squares += x * x;
    if (round == rounds) return {delay_s, std::sqrt(squares) / slopes};
    delay_s += all / slopes;
    if (!(std::abs(delay_s) < longest_s)) return not_measured;
  }
}

/// Per joint, of its long stretches; empty where speeds are slopes.
using RecordedSpeeds = std::vector<std::vector<Speeds>>;

/// Adds the delays of a recording's velocities, removes those that are significant and says which.
Result<RecordedSpeeds> speeds_on_time(const RobotRecording& rec, std::size_t file, const Regressor& r,
                                      const Sampling& sampling, const Preparation& preparation, JointMotion& out) {
  constexpr double enough_sigmas = 3, least_samples = 0.2;
  std::string text;
  RecordedSpeeds all;
  for (Index j = 0; j < r.joints(); ++j) {
    auto& stretches = all.emplace_back();
    for (const Stretch& s : sampling.stretches) {
      if (!is_long_enough(rec, s)) continue;
      const auto f = filtering_of(rec, s, sampling, preparation);
      if (!f) return tl::unexpected(f.error());
      const auto at = [&](const MatrixXd& values) {
        return equidistant(rec, values, j, s, f->period_s, sampling.regular());
      };
      const std::vector<double> raw = at(rec.velocity);
      const double passed = 2 * f->cutoff_hz / f->rate_hz;  // of the band
      Speeds x{.q = low_passed(at(rec.position), f->rate_hz, f->cutoff_hz),
               .slope = {},
               .recorded = low_passed(raw, f->rate_hz, f->cutoff_hz),
               .rate_hz = f->rate_hz,
               .noise = 0,
               .edge = f->edge};
      x.slope = first_derivative(x.q, f->rate_hz), x.noise = noise_of(raw, x.recorded, passed) * std::sqrt(passed);
      stretches.push_back(std::move(x));
    }
    const auto [value_s, sigma_s] = delay_of(stretches);
    const bool removed =
        std::abs(value_s) > enough_sigmas * sigma_s && std::abs(value_s) > least_samples * sampling.typical_s;
    out.velocity_delay.push_back({file, j, value_s, sigma_s, removed});
    if (!removed) continue;
    for (Speeds& x : stretches) x.recorded = on_time(x, value_s);
    text += fmt::format("{}{} {:.2g} +- {:.1g} ms", text.empty() ? "" : ", ", r.joint_name(j), 1e3 * value_s,
                        1e3 * sigma_s);
  }
  if (!text.empty())
    out.notes.push_back(fmt::format(
        "{}: recorded velocities are late against the slope of their positions (negative: early): {}; moved by that",
        rec.file.string(), text));
  return all;
}

/// `recorded`: null where speeds are slopes.
JointSamples samples_of(const RobotRecording& rec, Index j, const Stretch& s, const Filtering& f, bool regular,
                        bool thermal, const Speeds* recorded, const Preparation& preparation) {
  const auto at = [&](const MatrixXd& values) { return equidistant(rec, values, j, s, f.period_s, regular); };
  const auto filtered = [&](const std::vector<double>& raw) { return low_passed(raw, f.rate_hz, f.cutoff_hz); };
  JointSamples out{.torque = filtered(at(rec.torque)), .speed_noise = 0};
  if (recorded) {
    out.q = recorded->q, out.speed = recorded->recorded, out.speed_noise = recorded->noise;
    out.acceleration = first_derivative(out.speed, f.rate_hz);
  } else {
    const std::vector<double> raw = at(rec.position);
    const double passed = 2 * f.cutoff_hz / f.rate_hz;  // of the band
    out.q = filtered(raw), out.speed = first_derivative(out.q, f.rate_hz);
    out.acceleration = second_derivative(out.q, f.rate_hz);
    const double w = 2 * std::numbers::pi * f.cutoff_hz;
    out.speed_noise = noise_of(raw, out.q, passed) * w * std::sqrt(passed / 3);
  }
  if (!preparation.lag_s.empty())
    out.torque = advanced(out.torque, preparation.lag_s[static_cast<std::size_t>(j)] * f.rate_hz);
  out.temperature = thermal ? at(rec.temperature_degC) : std::vector<double>(out.q.size(), 20.0);
  return out;
}

/// Without samples where the stretch is shorter than its edges.
Part part_of(const RobotRecording& rec, std::size_t file, const Stretch& s, const Filtering& f, bool regular,
             const RecordedSpeeds& recorded, std::size_t stretch, bool thermal, const Preparation& preparation) {
  const auto recorded_of = [&](Index joint) {
    return recorded.empty() ? nullptr : &recorded[static_cast<std::size_t>(joint)][stretch];
  };
  const Index n = rec.position.rows();
  Part part{.file = file, .filtering = f};
  Index count = 0;
  for (Index j = 0; j < n; ++j) {
    JointSamples x = samples_of(rec, j, s, f, regular, thermal, recorded_of(j), preparation);
    if (j == 0) {
      count = (static_cast<Index>(x.q.size()) - 2 * f.edge + f.every - 1) / f.every;
      if (count < 1) return part;
      for (auto* m : {&part.q, &part.qd, &part.qdd, &part.torque, &part.temperature}) m->resize(n, count);
      for (Index k = 0; k < count; ++k)
        part.time.push_back(rec.time_s[s.first] + static_cast<double>(f.edge + k * f.every) * f.period_s);
    }
    for (Index k = 0; k < count; ++k) {
      const auto i = static_cast<std::size_t>(f.edge + k * f.every);
      part.q(j, k) = x.q[i];
      part.qd(j, k) = x.speed[i];
      part.qdd(j, k) = x.acceleration[i];
      part.torque(j, k) = x.torque[i];
      part.temperature(j, k) = x.temperature[i];
    }
    part.speed.push_back(std::move(x.speed));
    part.speed_noise.push_back(x.speed_noise);
  }
  return part;
}

/// Adds the stretches of a recording; cutoff_hz and period_s are those of the first one.
Result<void> add_parts(const RobotRecording& rec, std::size_t file, const Regressor& r, const Preparation& preparation,
                       JointMotion& out, std::vector<Part>& parts) {
  out.notes.insert(out.notes.end(), rec.notes.begin(), rec.notes.end());
  const Sampling sampling = sampling_of(rec, preparation, out.notes);
  RecordedSpeeds recorded;
  if (preparation.recorded_velocity && rec.velocity.size() > 0) {
    auto speeds = speeds_on_time(rec, file, r, sampling, preparation, out);
    if (!speeds) return tl::unexpected(speeds.error());
    recorded = *std::move(speeds);
  }
  std::size_t used = 0;
  for (const Stretch& s : sampling.stretches) {
    if (!is_long_enough(rec, s)) continue;
    const auto filtering = filtering_of(rec, s, sampling, preparation);
    if (!filtering) return tl::unexpected(filtering.error());
    if (out.period_s == 0)
      out.period_s = filtering->period_s * static_cast<double>(filtering->every), out.cutoff_hz = filtering->cutoff_hz;
    Part part =
        part_of(rec, file, s, *filtering, sampling.regular(), recorded, used++, out.has_temperature, preparation);
    if (part.q.cols() >= 1) parts.push_back(std::move(part));
  }
  if (used > 0) return {};
  return tl::unexpected(
      Error(fmt::format("{}: no stretch of a second with regular time_s (typical step {:.4g} s, {} gaps)",
                        rec.file.string(), sampling.typical_s, sampling.gaps)));
}

/// Speed of a rotor in every sample, and the standard deviation of its noise.
std::pair<std::vector<double>, double> speed_of(const Regressor& r, Index rotor, const Part& p) {
  if (!r.is_coupled(rotor))
    return {p.speed[static_cast<std::size_t>(rotor)], p.speed_noise[static_cast<std::size_t>(rotor)]};
  std::vector<double> speed(p.speed.front().size());
  double variance = 0;
  for (Index j = 0; j < r.joints(); ++j) {
    const auto at = static_cast<std::size_t>(j);
    for (std::size_t i = 0; i < speed.size(); ++i) speed[i] += r.turns(rotor, j) * p.speed[at][i];
    variance += std::pow(r.turns(rotor, j) * p.speed_noise[at], 2);
  }
  return {std::move(speed), std::sqrt(variance)};
}

/// Kept samples that are more than `beside_slow` of them from slow ones and from turns between two samples; neither is
/// assumed before the first and after the last.
std::vector<bool> fast(const std::vector<double>& speed, double slowest, Index beside_slow) {
  std::vector<bool> is_slow(speed.size());
  for (std::size_t k = 0; k < speed.size(); ++k)
    is_slow[k] = std::abs(speed[k]) < slowest || (k > 0 && speed[k] * speed[k - 1] < 0);
  std::vector<bool> out = widened(is_slow, static_cast<std::size_t>(beside_slow));
  out.flip();
  return out;
}

/// Where a rotor slides and which way, known for every sample, is filtered and decimated as torques are. Joints on
/// which its friction acts count as moving only where it slides, or where it is fast.
void mark_sliding(const Regressor& r, Index rotor, const Part& p, double fastest, double range, Index at,
                  JointMotion& out) {
  const auto [speed, noise] = speed_of(r, rotor, p);
  const Filtering& f = p.filtering;
  const double slowest = std::clamp(above_noise * noise, slow * fastest, slow_with_noise * fastest);
  const Sliding sliding = sliding_of(speed, slowest, far * range * f.rate_hz, static_cast<std::size_t>(f.longest_turn));
  const std::vector<double> direction = advanced(low_passed(sliding.direction, f.rate_hz, f.cutoff_hz), f.turn_lead);
  const std::vector<bool> at_rest = widened(sliding.rest, static_cast<std::size_t>(f.beside_rest));
  std::vector<double> kept;
  for (Index k = 0; k < p.q.cols(); ++k) kept.push_back(r.speed(rotor, p.qd.col(k)));
  const std::vector<bool> is_fast = f.beside_slow ? fast(kept, slow * fastest, f.beside_slow) : std::vector<bool>();
  for (Index k = 0; k < p.q.cols(); ++k) {
    const auto i = static_cast<std::size_t>(f.edge + k * f.every), at_k = static_cast<std::size_t>(k);
    const bool slides =
        fastest >= standstill_rad_s && (f.beside_slow ? is_fast[at_k] : std::abs(kept[at_k]) >= slowest && !at_rest[i]);
    out.direction(rotor, at + k) = f.beside_slow && slides ? std::copysign(1, kept[at_k]) : direction[i];
    for (Index j = 0; j < r.joints() && !slides; ++j)
      if (r.turns(rotor, j) != 0) out.moving(j, at + k) = false;
  }
}

/// `fastest`: speed of every rotor.
void join(const Regressor& r, const std::vector<Part>& parts, const VectorXd& fastest, JointMotion& out) {
  Index total = 0;
  constexpr double infinity = std::numeric_limits<double>::infinity();
  VectorXd lowest = VectorXd::Constant(r.rotors(), infinity), highest = -lowest;
  for (const Part& p : parts) {
    total += p.q.cols();
    for (Index rotor = 0; rotor < r.rotors(); ++rotor)
      for (Index k = 0; k < p.q.cols(); ++k) {
        const double x = r.speed(rotor, p.q.col(k));
        lowest(rotor) = std::min(lowest(rotor), x), highest(rotor) = std::max(highest(rotor), x);
      }
  }
  for (auto* m : {&out.q, &out.qd, &out.qdd, &out.torque, &out.temperature_degC}) m->resize(r.joints(), total);
  out.direction.resize(r.rotors(), total);
  out.moving.setConstant(r.joints(), total, true);
  Index at = 0;
  for (const Part& p : parts) {
    const Index count = p.q.cols();
    out.segments.emplace_back(at, at + count);
    out.file.push_back(p.file);
    out.edge_s.push_back(static_cast<double>(p.filtering.edge) * p.filtering.period_s);
    out.time_s.insert(out.time_s.end(), p.time.begin(), p.time.end());
    out.q.middleCols(at, count) = p.q, out.qd.middleCols(at, count) = p.qd, out.qdd.middleCols(at, count) = p.qdd;
    out.torque.middleCols(at, count) = p.torque, out.temperature_degC.middleCols(at, count) = p.temperature;
    for (Index rotor = 0; rotor < r.rotors(); ++rotor)
      mark_sliding(r, rotor, p, fastest(rotor), highest(rotor) - lowest(rotor), at, out);
    at += count;
  }
}

/// Torques that a recording does not have.
void leave_out_unrecorded(std::span<const RobotRecording> recordings, JointMotion& out) {
  for (Index j = 0; j < out.q.rows(); ++j) {
    const auto without = [&](const RobotRecording& rec) {
      return !rec.without_torque.empty() && rec.without_torque[static_cast<std::size_t>(j)];
    };
    for (std::size_t s = 0; s < out.segments.size(); ++s) {
      if (!without(recordings[out.file[s]])) continue;
      const Index first = out.segments[s].first, count = out.segments[s].second - first;
      out.moving.row(j).segment(first, count).setConstant(false);
      out.torque.row(j).segment(first, count).setConstant(std::numeric_limits<double>::quiet_NaN());
    }
    out.left_out.push_back(std::ranges::all_of(recordings, without));
  }
}

/// One cut-off for files of different rates, where none is given: the usual one of the slowest, which all can have.
/// Files whose own ones are as good as equal keep them.
Preparation with_one_cutoff(std::span<const RobotRecording> recordings, Preparation preparation,
                            std::vector<std::string>& notes) {
  constexpr double equal = 0.98;
  if (preparation.cutoff_hz > 0) return preparation;
  const RobotRecording* slowest = nullptr;
  double lowest_hz = std::numeric_limits<double>::infinity(), highest_hz = 0, rate_hz = 0;
  for (const RobotRecording& rec : recordings) {
    if (rec.time_s.size() < 2) continue;
    const double step_s = median_step(rec.time_s), cutoff_hz = usual_cutoff_hz(step_s);
    highest_hz = std::max(highest_hz, cutoff_hz);
    if (cutoff_hz < lowest_hz) lowest_hz = cutoff_hz, rate_hz = 1 / step_s, slowest = &rec;
  }
  if (!slowest || lowest_hz >= equal * highest_hz) return preparation;
  preparation.cutoff_hz = lowest_hz;
  notes.push_back(
      fmt::format("{}: is sampled at {:.4g} Hz; all files are filtered at a fifth of that, {:.3g} Hz, though {:.3g} Hz "
                  "suits the fastest: another cut-off, or leaving this file out, may tell more",
                  slowest->file.string(), rate_hz, lowest_hz, highest_hz));
  return preparation;
}

Result<JointMotion> prepare_as_asked(std::span<const RobotRecording> recordings, const Regressor& r,
                                     const Preparation& asked) {
  JointMotion out;
  const Preparation preparation = with_one_cutoff(recordings, asked, out.notes);
  out.lag_s = preparation.lag_s;
  out.reversals = preparation.reversals;
  out.has_temperature =
      std::ranges::all_of(recordings, [](const RobotRecording& rec) { return rec.temperature_degC.size() > 0; });
  std::vector<Part> parts;
  for (std::size_t f = 0; f < recordings.size(); ++f)
    if (auto ok = add_parts(recordings[f], f, r, preparation, out, parts); !ok) return tl::unexpected(ok.error());
  VectorXd fastest = VectorXd::Zero(r.rotors());
  for (const Part& p : parts)
    for (Index rotor = 0; rotor < r.rotors(); ++rotor)
      for (Index k = 0; k < p.qd.cols(); ++k)
        fastest(rotor) = std::max(fastest(rotor), std::abs(r.speed(rotor, p.qd.col(k))));
  for (Index j = 0; j < r.joints(); ++j)
    if (fastest(j) < standstill_rad_s && !preparation.still_joints)
      return tl::unexpected(
          Error(fmt::format("joint {} stands still in all recordings (it never exceeds {:.2g} {}/s); move every joint, "
                            "or weld it in the model",
                            r.joint_name(j), fastest(j), r.is_slide(j) ? "m" : "rad")));
  for (Index rotor = r.joints(); rotor < r.rotors(); ++rotor)
    if (fastest(rotor) < standstill_rad_s && !preparation.still_joints)
      return tl::unexpected(Error(fmt::format(
          "motor {} stands still in all recordings (it never exceeds {:.2g} rad/s): its joints move against "
          "each other as it says; move them one by one, or leave its coupling out",
          r.rotor_name(rotor), fastest(rotor))));
  join(r, parts, fastest, out);
  leave_out_unrecorded(recordings, out);
  std::vector<std::optional<CarriedBody>> carried;
  for (const RobotRecording& rec : recordings) carried.push_back(rec.carried);
  out.carried_torque = carried_torque(r, carried, out);
  return out;
}

}  // namespace

Result<JointMotion> prepare(std::span<const RobotRecording> recordings, const Regressor& r,
                            const Preparation& preparation) {
  constexpr Index least = 100;
  constexpr double least_share = 0.05;  // of all samples
  auto out = prepare_as_asked(recordings, r, preparation);
  if (!out || preparation.reversals) return out;
  const auto hardly = [&](Index j) {
    const Index enough = std::max(least, static_cast<Index>(least_share * static_cast<double>(out->size())));
    return !out->is_left_out(j) && out->moving.row(j).count() < enough;
  };
  const auto first_joint = [&](const auto& is_so) {
    Index j = 0;
    while (j < r.joints() && !is_so(j)) ++j;
    return j;
  };
  if (first_joint(hardly) == r.joints()) return out;
  Preparation with_reversals = preparation;
  with_reversals.reversals = true;
  auto more = prepare_as_asked(recordings, r, with_reversals);
  if (!more) return out;
  const auto turns_often = [&](Index j) {
    const Index all = more->moving.row(j).count();
    return hardly(j) && all >= std::max(least, 2 * out->moving.row(j).count());
  };
  const Index joint = first_joint(turns_often);
  if (joint == r.joints()) return out;
  more->notes.push_back(fmt::format(
      "joint {} turns so often that {} of {} samples are two periods of the cut-off ({:.3g} Hz) from its reversals; "
      "those near reversals count, too",
      r.joint_name(joint), out->moving.row(joint).count(), more->moving.row(joint).count(), out->cutoff_hz));
  return more;
}

AsRecorded as_recorded(const JointMotion& motion, const MatrixXd& torque) {
  AsRecorded out{.torque = torque, .known = std::vector(static_cast<std::size_t>(torque.cols()), true)};
  for (const auto& [first, last] : motion.segments) {
    const Index count = last - first;
    if (count < 2) continue;
    const double period_s =
        (motion.time_s[static_cast<std::size_t>(last - 1)] - motion.time_s[static_cast<std::size_t>(first)]) /
        static_cast<double>(count - 1);
    for (Index j = 0; j < torque.rows(); ++j) {
      const double late = motion.lag_s.empty() ? 0 : motion.lag_s[static_cast<std::size_t>(j)] / period_s;
      if (late == 0) continue;
      std::vector<double> row(static_cast<std::size_t>(count));
      for (Index i = 0; i < count; ++i) row[static_cast<std::size_t>(i)] = torque(j, first + i);
      row = advanced(row, -late);
      for (Index i = 0; i < count; ++i) {
        out.torque(j, first + i) = row[static_cast<std::size_t>(i)];
        const double from = static_cast<double>(i) - late;
        if (from < 0 || from > static_cast<double>(count - 1)) out.known[static_cast<std::size_t>(first + i)] = false;
      }
    }
  }
  return out;
}

}  // namespace tribotwin::twin::identification
