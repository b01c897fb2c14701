#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <numeric>
#include <span>
#include <tuple>

#include <Eigen/Dense>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/identification/curves/lag.hpp>
#include <tribotwin/twin/identification/curves/levels.hpp>
#include <tribotwin/twin/numerics/correlation.hpp>

namespace tribotwin::twin {
namespace {

constexpr double standstill_rad_s = 5e-5;  // a stuck joint may creep below this
constexpr double same_speed = 0.03;        // relative
constexpr double steady = 0.02;            // relative, between parts of a pass
// Unsteadiness this small moves no torque worth speaking of: late by 10 us while settling at 15 rad/s is a speed off by
// 0.015 %.
constexpr double finest_s = 1e-5, finest_rad = 1e-6;
constexpr std::size_t least_samples = 12;

/// A stretch of constant speed. q = at + speed (t - time of begin).
struct Pass {
  std::size_t begin, end;
  double speed, at;
  double low, high;
  double magnitude() const { return std::abs(speed); }
};

struct Line {
  double slope = 0, at = 0;  ///< at: value at t of `begin`
};

Line line(const JointRecording& r, std::size_t begin, std::size_t end) {
  const double n = static_cast<double>(end - begin), t0 = r.time_s[begin], q0 = r.position_rad[begin];
  double t = 0, q = 0;
  for (std::size_t i = begin; i < end; ++i) t += r.time_s[i] - t0, q += r.position_rad[i] - q0;
  t /= n, q /= n;
  double tt = 0, tq = 0;
  for (std::size_t i = begin; i < end; ++i) {
    const double d = r.time_s[i] - t0 - t;
    tt += d * d;
    tq += d * (r.position_rad[i] - q0 - q);
  }
  const double slope = tt > 0 ? tq / tt : 0;
  return {slope, q0 + q - slope * t};
}

/// Standard deviation of the position's error: quantisation or noise, whichever shows.
double position_error(const std::vector<double>& q) {
  std::vector<double> steps, bends;
  for (std::size_t i = 1; i < q.size(); ++i)
    if (q[i] != q[i - 1]) steps.push_back(std::abs(q[i] - q[i - 1]));
  for (std::size_t i = 2; i < q.size(); ++i) bends.push_back(std::abs(q[i] - 2 * q[i - 1] + q[i - 2]));
  double error = 0;
  if (!bends.empty()) {
    std::ranges::nth_element(bends, bends.begin() + static_cast<std::ptrdiff_t>(bends.size() / 2));
    error = bends[bends.size() / 2] / (0.6745 * std::sqrt(6.0));
  }
  if (steps.empty()) return error;
  std::ranges::sort(steps);
  // An increment is what nearly all steps are multiples of; the least one may be a stray.
  for (const double share : {0.0, 0.01, 0.05}) {
    const double increment = steps[static_cast<std::size_t>(share * static_cast<double>(steps.size() - 1))];
    const auto multiples = std::ranges::count_if(steps, [&](double s) {
      const double ratio = s / increment;
      return ratio < 1e6 && std::abs(ratio - std::round(ratio)) < 0.1;
    });
    if (static_cast<double>(multiples) > 0.9 * static_cast<double>(steps.size()))
      return std::max(error, increment / std::sqrt(12.0));
  }
  return error;
}

/// Finds the passes of one recording.
class Segmentation {
 public:
  Segmentation(const JointRecording& r, std::vector<std::string>& left_out)
      : r_(r), error_(position_error(r.position_rad)), left_out_(left_out) {}

  std::vector<Pass> passes() {
    std::vector<double> periods;
    for (std::size_t i = 1; i < r_.size(); ++i) periods.push_back(r_.time_s[i] - r_.time_s[i - 1]);
    if (periods.empty()) return {};
    std::ranges::nth_element(periods, periods.begin() + static_cast<std::ptrdiff_t>(periods.size() / 2));
    const double gap = 5 * periods[periods.size() / 2];
    for (std::size_t begin = 0, i = 1; i <= r_.size(); ++i)
      if (i == r_.size() || r_.time_s[i] - r_.time_s[i - 1] > gap) {
        stretch(begin, i);
        begin = i;
      }
    // Ramps are unsteady as they should be; what is as long as a pass was meant to be one.
    double shortest_s = 0;
    const auto duration = [&](const Pass& p) { return r_.time_s[p.end - 1] - r_.time_s[p.begin]; };
    for (const Pass& p : passes_) shortest_s = shortest_s == 0 ? duration(p) : std::min(shortest_s, duration(p));
    for (const Pass& p : unsteady_)
      if (duration(p) >= shortest_s)
        left_out_.push_back(fmt::format("the speed of {:.3g} rad/s is not steady from {:.2f} to {:.2f} s",
                                        p.magnitude(), r_.time_s[p.begin], r_.time_s[p.end - 1]));
    return std::move(passes_);
  }

 private:
  /// One part of the recording without gaps, cut into chunks that a line fits.
  void stretch(std::size_t begin, std::size_t end) {
    sums_.assign(1, {});
    origin_ = begin;
    for (std::size_t i = begin; i < end; ++i) {
      const long double t = r_.time_s[i] - r_.time_s[begin], q = r_.position_rad[i] - r_.position_rad[begin];
      const auto& s = sums_.back();
      sums_.push_back({s[0] + t, s[1] + q, s[2] + t * t, s[3] + t * q, s[4] + q * q});
    }
    constexpr std::size_t seed = 8;
    for (std::size_t i = begin; i + seed <= end;) {
      if (!straight(i, i + seed)) {
        i += seed / 4;
        continue;
      }
      std::size_t good = i + seed, step = seed, bad = end + 1;
      while (good < end && bad > end) {
        const std::size_t next = std::min(end, good + step);
        if (straight(i, next))
          good = next, step *= 2;
        else
          bad = next;
      }
      while (bad <= end && bad - good > 1) {
        const std::size_t middle = good + (bad - good) / 2;
        (straight(i, middle) ? good : bad) = middle;
      }
      keep(i, good);
      i = good;
    }
  }

  /// Whether the joint was nowhere far from constant speed: by 10 ms, or 0.3 % of the time, or the error of the
  /// position.
  bool straight(std::size_t begin, std::size_t end) const {
    const auto &a = sums_[begin - origin_], &b = sums_[end - origin_];
    const long double n = static_cast<long double>(end - begin), t = b[0] - a[0], q = b[1] - a[1];
    const long double tt = b[2] - a[2] - t * t / n, tq = b[3] - a[3] - t * q / n, qq = b[4] - a[4] - q * q / n;
    const double slope = static_cast<double>(tq / tt), square = static_cast<double>((qq - tq * tq / tt) / n);
    const double late = slope * std::max(0.01, 0.003 * (r_.time_s[end - 1] - r_.time_s[begin]));
    return square <= late * late + 9 * error_ * error_;
  }

  /// Cuts a chunk to where the joint has settled on its speed, and keeps it if that makes a pass.
  void keep(std::size_t begin, std::size_t end) {
    for (int round = 0; round < 3; ++round) {
      const std::size_t n = end - begin, block = std::max<std::size_t>(3, n / 40), quarter = n / 4;
      if (n < 2 * least_samples) break;
      const std::size_t first = begin + quarter, last = end - quarter;
      const Line middle = line(r_, first, last);
      const auto off = [&](std::size_t i) {  // mean distance of a block from the line through the middle
        double sum = 0;
        for (std::size_t k = i; k < i + block; ++k)
          sum += r_.position_rad[k] - middle.at - middle.slope * (r_.time_s[k] - r_.time_s[first]);
        return sum / static_cast<double>(block);
      };
      double square = 0;
      std::size_t blocks = 0;
      for (std::size_t i = first; i + block <= last; i += block, ++blocks) square += off(i) * off(i);
      const double limit =
          5 * std::sqrt(square / static_cast<double>(blocks)) + finest_s * std::abs(middle.slope) + finest_rad;
      std::size_t from = first, to = last;
      while (from >= begin + block && std::abs(off(from - block)) <= limit) from -= block;
      while (to + block <= end && std::abs(off(to)) <= limit) to += block;
      if (from == begin && to == end) break;
      begin = from, end = to;
    }
    if (end - begin < least_samples) return;
    const Line whole = line(r_, begin, end);
    const double speed = std::abs(whole.slope), duration = r_.time_s[end - 1] - r_.time_s[begin],
                 travel = speed * duration;
    if (speed < standstill_rad_s || travel < 20 * error_) return;
    constexpr std::size_t parts = 4;
    const double n = static_cast<double>(end - begin),
                 sigma = error_ * std::sqrt(12 / (n / parts)) / (duration / parts);
    for (std::size_t p = 0; p < parts; ++p) {
      const double part = line(r_, begin + (end - begin) * p / parts, begin + (end - begin) * (p + 1) / parts).slope;
      if (std::abs(part - whole.slope) > steady * speed + 4 * sigma) {
        unsteady_.push_back({begin, end, whole.slope, 0, 0, 0});
        return;
      }
    }
    const double far = whole.at + whole.slope * duration;
    passes_.push_back({begin, end, whole.slope, whole.at, std::min(whole.at, far), std::max(whole.at, far)});
  }

  const JointRecording& r_;
  double error_;
  std::vector<std::string>& left_out_;
  std::vector<std::array<long double, 5>> sums_;
  std::size_t origin_ = 0;
  std::vector<Pass> passes_, unsteady_;
};

struct Pair {
  Pass forward, reverse;
  double low, high;  ///< common positions
  double speed() const { return 0.5 * (forward.speed - reverse.speed); }
  std::size_t begin() const { return std::min(forward.begin, reverse.begin); }
};

bool alike(double a, double b) { return std::abs(a - b) <= same_speed * std::max(a, b); }

/// A recording may repeat a level hundreds of times while it warms up: neighbours in time belong together, those that
/// cover the same positions first.
std::vector<Pair> paired(const JointRecording& r, const std::vector<Pass>& passes, std::vector<std::string>& left_out) {
  struct Candidate {
    std::size_t a, b;
    int apart;    ///< tenths of the longer travel that are not common
    int further;  ///< how many others come between
  };
  std::vector<Candidate> candidates;
  for (std::size_t a = 0; a < passes.size(); ++a)
    for (std::size_t b = a + 1, further = 0; b < passes.size() && further < 4; ++b) {
      const Pass &p = passes[a], &q = passes[b];
      if (p.speed * q.speed > 0 || !alike(p.magnitude(), q.magnitude())) continue;
      const double common = std::min(p.high, q.high) - std::max(p.low, q.low);
      if (common < 0.2 * std::min(p.high - p.low, q.high - q.low)) continue;
      candidates.push_back({a, b, static_cast<int>(10 * (1 - common / std::max(p.high - p.low, q.high - q.low))),
                            static_cast<int>(further++)});
    }
  std::ranges::stable_sort(candidates, {}, [](const Candidate& c) { return std::pair(c.apart, c.further); });
  std::vector<bool> used(passes.size());
  std::vector<Pair> pairs;
  for (const Candidate& c : candidates) {
    if (used[c.a] || used[c.b]) continue;
    used[c.a] = used[c.b] = true;
    const Pass &a = passes[c.a], &b = passes[c.b];
    pairs.push_back({a.speed > 0 ? a : b, a.speed > 0 ? b : a, std::max(a.low, b.low), std::min(a.high, b.high)});
  }
  std::ranges::sort(pairs, {}, &Pair::begin);
  for (std::size_t i = 0; i < passes.size(); ++i)
    if (!used[i])
      left_out.push_back(fmt::format(
          "no {} pass at {:.3g} rad/s over the positions of the {} one from {:.2f} to {:.2f} s",
          passes[i].speed > 0 ? "reverse" : "forward", passes[i].magnitude(),
          passes[i].speed > 0 ? "forward" : "reverse", r.time_s[passes[i].begin], r.time_s[passes[i].end - 1]));
  return pairs;
}

/// Mean and its standard error of samples in order of time that may be correlated, `fitted` as there.
struct Mean {
  double value, stderr_;  // stderr is a macro
};
Mean mean_of(std::span<const double> x, double fitted = 1) {
  const double n = static_cast<double>(x.size());
  double mean = 0, variance = 0;
  for (const double v : x) mean += v / n;
  for (const double v : x) variance += (v - mean) * (v - mean) / n;
  if (!(variance > 0)) return {mean, 0};
  return {mean, std::sqrt(variance / std::max(1.0, n - fitted) * samples_per_independent(x, fitted))};
}

/// Both directions of a level, their torques as functions of the position.
class Profile {
 public:
  Profile(const JointRecording& r, const Pair& pair) : r_(r), pair_(pair) {
    centre_ = 0.5 * (pair.low + pair.high);
    half_ = std::max(0.5 * (pair.high - pair.low), 1e-12);
    take(pair.forward, +1);
    take(pair.reverse, -1);
    const auto n = static_cast<double>(rows_.size());
    // Enough for a sine over the travel; gravity has no more, gears have.
    degree_ = static_cast<int>(std::min({3 + std::ceil(3.2 * half_), 20.0, n / 12}));
  }

  struct Row {
    std::size_t sample;
    double x, sign;  ///< position within -1 .. 1
  };
  std::span<const Row> rows() const { return rows_; }
  bool too_short() const { return forward_ < least_samples || rows_.size() - forward_ < least_samples; }
  double position(double x) const { return centre_ + half_ * x; }
  double scaled(double q) const { return (q - centre_) / half_; }

  /// Torque [Nm] of a row, the column being late by `lag_s`; linear between samples.
  double torque(const Row& row, double lag_s) const {
    if (lag_s == 0) return r_.torque_nm[row.sample];
    const double t = r_.time_s[row.sample] + lag_s;
    std::size_t i = row.sample;
    while (i + 2 < r_.size() && r_.time_s[i + 1] < t) ++i;
    while (i > 0 && r_.time_s[i] > t) --i;
    const std::size_t k = std::min(i + 1, r_.size() - 1);
    if (i == k) return r_.torque_nm[i];
    const double w = std::clamp((t - r_.time_s[i]) / (r_.time_s[k] - r_.time_s[i]), 0.0, 1.0);
    return (1 - w) * r_.torque_nm[i] + w * r_.torque_nm[k];
  }

  /// What is common to both directions and what changes sign, by least squares.
  void fit(double lag_s) {
    const Eigen::Index columns = degree_ + 2;
    Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(columns, columns);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(columns), basis(columns);
    for (const Row& row : rows_) {
      legendre(row.x, basis);
      basis[columns - 1] = row.sign;
      gram.selfadjointView<Eigen::Lower>().rankUpdate(basis);
      right += torque(row, lag_s) * basis;
    }
    const Eigen::VectorXd solution = gram.selfadjointView<Eigen::Lower>().ldlt().solve(right);
    common_ = solution.head(columns - 1);
    friction_ = solution[columns - 1];
  }

  double common_nm(double x) const { return evaluate(x).first; }
  double common_slope_nm_rad(double x) const { return evaluate(x).second / half_; }

  /// (u+ - u-) / 2 at equal positions (paper 2 (6)): at the forward samples, the reverse ones interpolated. Taken
  /// beyond the common part, which cancels.
  struct Difference {
    std::vector<double> x, friction_nm;
  };
  Difference difference(double lag_s) const {
    Difference d;
    const auto beyond = [&](std::size_t i) { return torque(rows_[i], lag_s) - common_nm(rows_[i].x); };
    std::size_t k = rows_.size() - 1;  // reverse positions fall with time
    double after = beyond(k), before = beyond(k - 1);
    for (std::size_t i = 0; i < forward_; ++i) {
      while (k > forward_ + 1 && rows_[k - 1].x < rows_[i].x) {
        --k;
        after = before;
        before = beyond(k - 1);
      }
      const double w = std::clamp((rows_[i].x - rows_[k].x) / (rows_[k - 1].x - rows_[k].x), 0.0, 1.0);
      d.x.push_back(rows_[i].x);
      d.friction_nm.push_back(0.5 * (beyond(i) - (w * before + (1 - w) * after)));
    }
    return d;
  }

  /// Information on a change of the lag: the difference = friction, free to change with |load|, + change x its
  /// derivative by the lag. Nothing where the common part does not rise above the noise.
  struct Information {
    double square = 0, product = 0;
    double variance = 0, count = 0;  ///< of the noise, per sample as a mean sees it, correlation included
  };
  Information information(double lag_s) const {
    const Difference d = difference(lag_s);
    const auto n = static_cast<Eigen::Index>(d.x.size());
    Eigen::MatrixXd known(n, 3);
    double square = 0, sum = 0;
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto [common, slope] = evaluate(d.x[static_cast<std::size_t>(i)]);
      known.row(i) << 1, std::abs(common), -pair_.speed() * slope / half_;
      square += common * common;
      sum += common;
    }
    const double count = static_cast<double>(n), spread = square - sum * sum / count;
    if (spread < 1e-6 * count * friction_ * friction_) return {};
    const Eigen::Map<const Eigen::VectorXd> y(d.friction_nm.data(), n);
    const auto free = known.leftCols(2).completeOrthogonalDecomposition();
    const Eigen::VectorXd by_lag = known.col(2) - known.leftCols(2) * free.solve(known.col(2)),
                          rest = y - known.leftCols(2) * free.solve(y);
    const double length = by_lag.squaredNorm();
    if (!(length > 0)) return {};
    const double change = by_lag.dot(rest) / length;
    const Eigen::VectorXd noise = rest - change * by_lag;
    const double variance = std::pow(mean_of({noise.data(), d.x.size()}, 3).stderr_, 2) * count;
    if (!(spread > 10 * static_cast<double>(degree_) * variance)) return {};
    return {length, length * change, std::max(variance, 1e-12 * square / count), count};
  }

 private:
  void take(const Pass& pass, double sign) {
    for (std::size_t i = pass.begin; i < pass.end; ++i) {
      const double q = pass.at + pass.speed * (r_.time_s[i] - r_.time_s[pass.begin]);  // free of quantisation
      if (q >= pair_.low && q <= pair_.high) rows_.push_back({i, scaled(q), sign});
    }
    if (sign > 0) forward_ = rows_.size();
  }
  static void legendre(double x, Eigen::Ref<Eigen::VectorXd> out) {
    out[0] = 1;
    if (out.size() > 1) out[1] = x;
    for (Eigen::Index k = 2; k < out.size(); ++k) {
      const auto n = static_cast<double>(k);
      out[k] = ((2 * n - 1) * x * out[k - 1] - (n - 1) * out[k - 2]) / n;
    }
  }
  /// Common part and its derivative by x.
  std::pair<double, double> evaluate(double x) const {
    double p0 = 1, p1 = x, d0 = 0, d1 = 1, value = common_[0], slope = 0;
    for (Eigen::Index k = 1; k < common_.size(); ++k) {
      value += common_[k] * p1;
      slope += common_[k] * d1;
      const auto n = static_cast<double>(k);
      const double p2 = ((2 * n + 1) * x * p1 - n * p0) / (n + 1), d2 = d0 + (2 * n + 1) * p1;
      p0 = p1, p1 = p2, d0 = d1, d1 = d2;
    }
    return {value, slope};
  }

  const JointRecording& r_;
  const Pair& pair_;
  std::vector<Row> rows_;
  std::size_t forward_ = 0;
  double centre_, half_;
  int degree_ = 0;
  Eigen::VectorXd common_;
  double friction_ = 0;
};

/// A part of the friction that is periodic in the joint's angle.
struct Ripple {
  double per_turn = 0, cosine_nm = 0, sine_nm = 0;
  double resolution = 0;   ///< of per_turn, half of what the travel can tell apart
  double friction_nm = 0;  ///< of the level that it was found in
  double amplitude_nm() const { return std::hypot(cosine_nm, sine_nm); }
  double operator()(double q_rad) const {
    return cosine_nm * std::cos(per_turn * q_rad) + sine_nm * std::sin(per_turn * q_rad);
  }
};

/// Of the samples' Fourier amplitudes over the angle, beyond what a slow trend explains, the largest.
Ripple ripple_of(const Profile& profile, const Profile::Difference& both) {
  constexpr double false_alarm = 1e-4, least_periods = 3, least_samples_per_period = 5, most_per_turn = 1000;
  const auto n = static_cast<Eigen::Index>(both.x.size());
  const double travel = std::abs(profile.position(both.x.back()) - profile.position(both.x.front()));
  const double lowest = std::ceil(2 * std::numbers::pi * least_periods / travel);
  const double highest =
      std::min(most_per_turn, 2 * std::numbers::pi * static_cast<double>(n) / travel / least_samples_per_period);
  const double step = std::max(1.0, std::floor(std::numbers::pi / travel));
  if (!(highest > lowest + 10 * step)) return {};

  Eigen::MatrixXd slow(n, 5);  // polynomial in the position, and friction's share of the load
  for (Eigen::Index i = 0; i < n; ++i) {
    const double x = both.x[static_cast<std::size_t>(i)];
    slow.row(i) << 1, x, x * x, x * x * x, std::abs(profile.common_nm(x));
  }
  const Eigen::Map<const Eigen::VectorXd> all(both.friction_nm.data(), n);
  const Eigen::VectorXd rest = all - slow * slow.completeOrthogonalDecomposition().solve(all);
  Eigen::ArrayXcd turned(n), turn(n);  // e^(i k q), from one k to the next
  for (Eigen::Index i = 0; i < n; ++i) {
    const double q = profile.position(both.x[static_cast<std::size_t>(i)]);
    turned[i] = std::polar(1.0, lowest * q), turn[i] = std::polar(1.0, step * q);
  }
  std::vector<double> squares;
  Ripple strongest;
  for (double k = lowest; k <= highest; k += step, turned *= turn) {
    const std::complex<double> sum = (rest.array() * turned).sum() * (2 / static_cast<double>(n));
    const Ripple one{k, sum.real(), sum.imag(), step};
    if (one.amplitude_nm() > strongest.amplitude_nm()) strongest = one;
    squares.push_back(one.amplitude_nm() * one.amplitude_nm());
  }
  // Squared amplitudes of noise are exponentially distributed, with a median of ln 2 times their mean; that of the
  // neighbours, for noise need not be white.
  const double count = static_cast<double>(squares.size());
  constexpr std::size_t most_neighbours = 60;
  const auto place = static_cast<std::size_t>(std::lround((strongest.per_turn - lowest) / step)),
             wide = std::min(squares.size(), most_neighbours);
  const std::size_t from = std::min(place - std::min(place, wide / 2), squares.size() - wide);
  const std::span<double> neighbours(squares.data() + from, wide);
  std::ranges::nth_element(neighbours, neighbours.begin() + static_cast<std::ptrdiff_t>(wide / 2));
  const double noise = neighbours[wide / 2] / std::numbers::ln2;
  return std::pow(strongest.amplitude_nm(), 2) > noise * std::log(count / false_alarm) ? strongest : Ripple{};
}

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

/// `known` is a ripple that other levels show; a pass too short to have its mean in it gets rid of it.
Level measured(const JointRecording& r, const Pair& pair, const Profile& profile, const LevelOptions& options,
               double lag_s, double lag_stderr_s, Ripple& ripple, const Ripple& known = {}) {
  const auto inside = [&](double x) {
    return std::abs(profile.position(x) - options.centre_rad) <= 0.5 * options.width_rad;
  };
  std::array<std::vector<double>, 2> beyond_load;
  double load = 0, load_magnitude = 0, temperature = 0, count = 0, slope = 0;
  for (const Profile::Row& row : profile.rows()) {
    if (!inside(row.x)) continue;
    const double l = r.load_nm.empty() ? profile.common_nm(row.x) : r.load_nm[row.sample];
    if (!r.load_nm.empty()) beyond_load[row.sign > 0 ? 0 : 1].push_back(profile.torque(row, lag_s) - l);
    load += l;
    load_magnitude += std::abs(l);
    slope += profile.common_slope_nm_rad(row.x);
    if (!r.temperature_degC.empty()) temperature += r.temperature_degC[row.sample];
    ++count;
  }
  const double v = pair.speed(), by_lag = v * slope / count * lag_stderr_s;
  Profile::Difference both = profile.difference(lag_s);
  ripple = ripple_of(profile, both);
  if (known.per_turn > 0 && ripple.per_turn == 0) {
    const double share = std::accumulate(both.friction_nm.begin(), both.friction_nm.end(), 0.0) /
                         static_cast<double>(both.x.size()) / known.friction_nm;
    for (std::size_t i = 0; i < both.x.size(); ++i) both.friction_nm[i] -= share * known(profile.position(both.x[i]));
  }
  std::vector<double> difference;
  for (std::size_t i = 0; i < both.x.size(); ++i)
    if (inside(both.x[i])) difference.push_back(both.friction_nm[i]);
  double friction = 0;
  for (const double f : difference) friction += f / static_cast<double>(difference.size());
  // What scatters beyond the trend with |load|, which is no error; of all samples, for a narrow window has few.
  const auto n = static_cast<Eigen::Index>(both.x.size());
  Eigen::MatrixXd trend(n, 2);
  for (Eigen::Index i = 0; i < n; ++i)
    trend.row(i) << 1, std::abs(profile.common_nm(both.x[static_cast<std::size_t>(i)]));
  const Eigen::Map<const Eigen::VectorXd> all(both.friction_nm.data(), n);
  const Eigen::VectorXd noise = all - trend * trend.completeOrthogonalDecomposition().solve(all);
  const double scatter = mean_of({noise.data(), both.x.size()}, 2).stderr_ *
                         std::sqrt(static_cast<double>(n) / static_cast<double>(difference.size()));
  Level level{.speed_rad_s = v,
              .friction_nm = friction,
              .stderr_nm = std::hypot(scatter, by_lag),
              .forward = {},
              .backward = {},
              .load_nm = std::copysign(load_magnitude / count, load),
              .temperature_degC = r.temperature_degC.empty() ? std::nan("") : temperature / count,
              .samples = static_cast<std::size_t>(count),
              .offset_s = 0,
              .begin_s = r.time_s[pair.begin()],
              .end_s = r.time_s[std::max(pair.forward.end, pair.reverse.end) - 1]};
  if (!r.load_nm.empty()) {
    const Mean up = mean_of(beyond_load[0]), down = mean_of(beyond_load[1]);
    level.forward = {up.value, std::hypot(up.stderr_, by_lag)};
    level.backward = {-down.value, std::hypot(down.stderr_, by_lag)};
  }
  ripple.friction_nm = friction;
  level.ripple_nm = ripple.amplitude_nm();
  level.lost_motion_rad = lost_motion_rad(r, pair, profile, friction, lag_s);
  // The reverse pass is the mirror image of the forward one: last sample against first.
  const std::size_t mirrored = std::min(pair.forward.end - pair.forward.begin, pair.reverse.end - pair.reverse.begin);
  for (std::size_t i = 0; i < mirrored; ++i)
    level.offset_s += std::abs(r.position_rad[pair.forward.end - 1 - i] - r.position_rad[pair.reverse.begin + i]) /
                      (v * static_cast<double>(mirrored));
  return level;
}

}  // namespace

Result<Levels> levels_of(const JointRecording& r, const LevelOptions& options) {
  if (auto ok = check(r); !ok) return tl::unexpected(ok.error());
  Levels result;
  auto passes = Segmentation(r, result.left_out).passes();
  if (passes.empty()) {
    std::string why = "no stretch of constant speed in the recording";
    if (!result.left_out.empty()) why += fmt::format(": {}", result.left_out.front());
    return tl::unexpected(why);
  }
  if (!r.velocity_rad_s.empty()) {
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
  }
  std::vector<Pair> pairs = paired(r, passes, result.left_out);
  if (!options.speeds_rad_s.empty()) {
    std::vector<Pair> wanted;
    std::vector<bool> used(pairs.size());
    for (const double v : options.speeds_rad_s) {
      // The nearest in speed, then the longest, then the first: approaches may run at the speed of a level.
      const auto rank = [&](const Pair& p) {
        const double duration = r.time_s[p.forward.end - 1] - r.time_s[p.forward.begin];
        return std::tuple(std::lround(std::abs(p.speed() - v) / v / 0.005), -std::lround(4 * std::log2(duration)));
      };
      std::size_t best = pairs.size();
      for (std::size_t i = 0; i < pairs.size(); ++i)
        if (!used[i] && alike(pairs[i].speed(), v) && (best == pairs.size() || rank(pairs[i]) < rank(pairs[best])))
          best = i;
      if (best == pairs.size()) {
        bool forward = false, reverse = false;
        for (const Pass& p : passes)
          if (alike(p.magnitude(), v)) (p.speed > 0 ? forward : reverse) = true;
        const char* which = !forward && !reverse ? "no pass"
                            : !reverse           ? "no reverse pass"
                            : !forward           ? "no forward pass"
                                                 : "no pair of passes over the same positions";
        std::string why = fmt::format("{} at {:.3g} rad/s", which, v);
        if (!result.left_out.empty())
          why += fmt::format(
              " ({})", fmt::join(result.left_out.begin(),
                                 result.left_out.begin() +
                                     static_cast<std::ptrdiff_t>(std::min<std::size_t>(3, result.left_out.size())),
                                 "; "));
        return tl::unexpected(why);
      }
      used[best] = true;
      wanted.push_back(pairs[best]);
    }
    pairs = std::move(wanted);
  }
  if (pairs.empty()) return tl::unexpected(result.left_out.front());

  std::vector<Profile> profiles;
  for (const Pair& pair : pairs) profiles.emplace_back(r, pair);
  const auto fit = [&] {
    for (Profile& p : profiles)
      if (!p.too_short()) p.fit(result.lag_s);
  };
  const std::optional<Lag> ramps =
      options.lag_s ? Lag{*options.lag_s, 0} : lag_of_torque(r, position_error(r.position_rad));
  if (ramps) {
    result.lag_s = ramps->lag_s;
    result.lag_stderr_s = ramps->stderr_s;
  }
  fit();
  if (!ramps) {
    // Constant speeds alone: a lag of a few control cycles either way is as likely as none, and gravity may tell more.
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
      fit();
      if (std::abs(change) < 0.01 * result.lag_stderr_s) break;
    }
  }
  std::vector<Ripple> ripples;
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const bool window = std::isfinite(options.width_rad);
    std::size_t inside[2] = {0, 0};
    for (const auto& row : profiles[i].rows())
      if (std::abs(profiles[i].position(row.x) - options.centre_rad) <= 0.5 * options.width_rad) ++inside[row.sign > 0];
    if (profiles[i].too_short() || std::min(inside[0], inside[1]) < 3) {
      const std::string why = fmt::format(
          "the passes at {:.3g} rad/s share {:.4g} .. {:.4g} rad, too little{}", pairs[i].speed(), pairs[i].low,
          pairs[i].high,
          window ? fmt::format(" of {:.4g} +- {:.2g} rad", options.centre_rad, 0.5 * options.width_rad) : "");
      if (!options.speeds_rad_s.empty()) return tl::unexpected(why);
      result.left_out.push_back(why);
      continue;
    }
    kept.push_back(i);
    result.levels.push_back(
        measured(r, pairs[i], profiles[i], options, result.lag_s, result.lag_stderr_s, ripples.emplace_back()));
  }
  if (result.levels.empty()) return tl::unexpected(result.left_out.front());
  // What is periodic in the angle is so at every speed; what is seen at one speed alone may be periodic in time.
  const auto confirmed = [&](std::size_t k) {
    for (std::size_t j = 0; j < kept.size(); ++j)
      if (ripples[j].per_turn > 0 && !alike(result.levels[j].speed_rad_s, result.levels[k].speed_rad_s) &&
          std::abs(ripples[j].per_turn - ripples[k].per_turn) <= ripples[j].resolution + ripples[k].resolution)
        return true;
    return false;
  };
  for (std::size_t k = 0; k < kept.size(); ++k)
    if (result.levels[k].ripple_nm > 0 && !confirmed(k)) result.levels[k].ripple_nm = 0;
  for (std::size_t k = 0; k < kept.size(); ++k)
    if (result.levels[k].ripple_nm == 0) ripples[k] = {};
  if (const Ripple known = *std::ranges::max_element(ripples, {}, &Ripple::amplitude_nm); known.per_turn > 0) {
    // Its phase is known best where it was found slowest; slower levels are those that are too short for it.
    Ripple slowest = known, ignored;
    double speed = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < kept.size(); ++k)
      if (ripples[k].per_turn > 0 &&
          std::abs(ripples[k].per_turn - known.per_turn) <= ripples[k].resolution + known.resolution &&
          result.levels[k].speed_rad_s < speed)
        slowest = ripples[k], speed = result.levels[k].speed_rad_s;
    for (std::size_t k = 0; k < kept.size(); ++k)
      if (result.levels[k].speed_rad_s < speed)
        result.levels[k] = measured(r, pairs[kept[k]], profiles[kept[k]], options, result.lag_s, result.lag_stderr_s,
                                    ignored, slowest);
  }
  return result;
}

}  // namespace tribotwin::twin
