#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/identification/samples/passes.hpp>

namespace tribotwin::twin::curves {
namespace {

constexpr double standstill_rad_s = 5e-5;  // a stuck joint may creep below this
constexpr double steady = 0.02;            // relative, between parts of a pass
// Unsteadiness this small has no visible effect on the torque: 10 us late while approaching 15 rad/s is a speed error
// of 0.015 %.
constexpr double finest_s = 1e-5, finest_rad = 1e-6;

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

/// Finds the passes of one recording.
class Segmentation {
 public:
  Segmentation(const JointRecording& r, std::vector<std::string>& left_out)
      : r_(r), error_(position_error_rad(r.position_rad)), left_out_(left_out) {}

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
    // Ramps are unsteady by design; an unsteady stretch as long as a pass was meant to be a pass.
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

  /// Cuts a chunk to where the joint has reached its speed, and keeps it if that makes a pass.
  void keep(std::size_t begin, std::size_t end) {
    for (int round = 0; round < 3; ++round) {
      const std::size_t n = end - begin, block = std::max<std::size_t>(3, n / 40), quarter = n / 4;
      if (n < 2 * min_samples) break;
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
    if (end - begin < min_samples) return;
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

}  // namespace

double position_error_rad(const std::vector<double>& q) {
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
  // Nearly all steps are multiples of the increment; the smallest step may be an outlier.
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

std::vector<Pass> passes_of(const JointRecording& recording, std::vector<std::string>& left_out) {
  return Segmentation(recording, left_out).passes();
}

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

}  // namespace tribotwin::twin::curves
