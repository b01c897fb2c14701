#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/curves/lag.hpp>

namespace tribotwin::twin {
namespace {

constexpr double longest_s = 0.1, earliest_s = -0.02;  // lags that are looked for
constexpr std::size_t most_samples = 100000;
constexpr Eigen::Index columns = 16;
constexpr Eigen::Index load_columns[] = {0, 2, 3, 4, 5, 6}, by_load = columns - 2;  // of Sample::explains

/// A part of the recording without gaps, on even times, filtered.
struct Track {
  std::vector<double> q, torque;
};

std::vector<double> filtered(const std::vector<double>& x, const std::vector<double>& kernel) {
  const auto n = static_cast<std::ptrdiff_t>(x.size()), half = static_cast<std::ptrdiff_t>(kernel.size()) - 1;
  std::vector<double> y(x.size());
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    double sum = 0, weight = 0;
    for (std::ptrdiff_t k = -half; k <= half; ++k)
      if (i + k >= 0 && i + k < n) {
        sum += kernel[static_cast<std::size_t>(std::abs(k))] * x[static_cast<std::size_t>(i + k)];
        weight += kernel[static_cast<std::size_t>(std::abs(k))];
      }
    y[static_cast<std::size_t>(i)] = sum / weight;
  }
  return y;
}

std::vector<Track> tracks_of(const JointRecording& r, double period) {
  std::vector<Track> tracks;
  for (std::size_t begin = 0, i = 1; i <= r.size(); ++i) {
    if (i < r.size() && r.time_s[i] - r.time_s[i - 1] <= 5 * period) continue;
    Track track;
    std::size_t k = begin;
    for (double t = r.time_s[begin]; t <= r.time_s[i - 1] + 1e-9 * period;
         t = r.time_s[begin] + period * static_cast<double>(track.q.size())) {
      while (k + 2 < i && r.time_s[k + 1] <= t) ++k;
      const std::size_t next = std::min(k + 1, i - 1);
      const double w = next == k ? 0 : std::clamp((t - r.time_s[k]) / (r.time_s[next] - r.time_s[k]), 0.0, 1.0);
      track.q.push_back((1 - w) * r.position_rad[k] + w * r.position_rad[next]);
      track.torque.push_back((1 - w) * r.torque_nm[k] + w * r.torque_nm[next]);
    }
    if (static_cast<double>(track.q.size()) * period > 0.5) tracks.push_back(std::move(track));
    begin = i;
  }
  return tracks;
}

/// Where the joint moves well away from standstill, and what explains its torque there.
struct Sample {
  std::size_t track, at;
  Eigen::Matrix<double, columns, 1> explains = Eigen::Matrix<double, columns, 1>::Zero();
};

}  // namespace

std::optional<Lag> lag_of_torque(const JointRecording& r, double position_error_rad) {
  if (r.size() < 200) return std::nullopt;
  std::vector<double> periods;
  for (std::size_t i = 1; i < r.size(); ++i) periods.push_back(r.time_s[i] - r.time_s[i - 1]);
  std::ranges::nth_element(periods, periods.begin() + static_cast<std::ptrdiff_t>(periods.size() / 2));
  const double period = periods[periods.size() / 2];
  if (period > 0.02) return std::nullopt;
  const std::vector<Track> raw = tracks_of(r, period);

  // The narrowest filter that leaves the acceleration above its noise.
  std::vector<Track> tracks;
  std::vector<std::vector<double>> acceleration;
  double width_s = std::max(0.01, 2 * period), fastest = 0, steepest = 0;
  for (;; width_s *= 1.5) {
    std::vector<double> kernel;
    for (double t = 0; t <= 3 * width_s; t += period) kernel.push_back(std::exp(-0.5 * t * t / (width_s * width_s)));
    tracks.clear();
    acceleration.clear();
    std::vector<double> magnitudes;
    fastest = 0;
    for (const Track& track : raw) {
      tracks.push_back({filtered(track.q, kernel), filtered(track.torque, kernel)});
      const auto& q = tracks.back().q;
      auto& a = acceleration.emplace_back(q.size());
      for (std::size_t i = 1; i + 1 < q.size(); ++i) {
        a[i] = (q[i + 1] - 2 * q[i] + q[i - 1]) / (period * period);
        magnitudes.push_back(std::abs(a[i]));
        fastest = std::max(fastest, std::abs(q[i + 1] - q[i - 1]) / (2 * period));
      }
    }
    if (magnitudes.empty() || fastest < 1e-4) return std::nullopt;
    const auto high = magnitudes.begin() + static_cast<std::ptrdiff_t>(0.995 * static_cast<double>(magnitudes.size()));
    std::ranges::nth_element(magnitudes, high);
    steepest = *high;
    const double noise = position_error_rad * std::sqrt(0.212 * period / width_s) /
                         (width_s * width_s);  // of a Gaussian's second derivative
    if (noise < 0.02 * steepest) break;
    if (width_s > 0.05) return std::nullopt;
  }

  const auto margin = static_cast<std::size_t>(std::ceil(3 * width_s / period)),
             late = static_cast<std::size_t>(std::ceil(longest_s / period)) + 2;
  std::vector<Sample> samples;
  for (std::size_t k = 0; k < tracks.size(); ++k) {
    const auto& q = tracks[k].q;
    if (q.size() < 2 * (margin + late)) continue;
    std::vector<double> v(q.size());
    for (std::size_t i = 1; i + 1 < q.size(); ++i) v[i] = (q[i + 1] - q[i - 1]) / (2 * period);
    // Friction is no function of speed at standstill, nor within the filter's reach of it.
    const double slow = std::max(2e-4 * fastest, 3 * position_error_rad * std::sqrt(period / width_s) / width_s);
    std::size_t since = 0;
    std::vector<bool> moves(q.size());
    for (std::size_t i = 1; i + 1 < q.size(); ++i) {
      since = std::abs(v[i]) > slow && v[i] * v[i - 1] >= 0 ? since + 1 : 0;
      if (since > 2 * margin) moves[i - margin] = true;
    }
    for (std::size_t i = margin + late; i + margin + late < q.size(); ++i)
      if (moves[i]) samples.push_back({.track = k, .at = i});
  }
  // Hours tell no more than minutes: runs of 1000 samples out of a long recording.
  if (const std::size_t stride = 1 + samples.size() / most_samples; stride > 1) {
    std::size_t k = 0;
    std::erase_if(samples, [&](const Sample&) { return (k++ / 1000) % stride != 0; });
  }
  for (Sample& sample : samples) {
    const auto& q = tracks[sample.track].q;
    const std::size_t i = sample.at;
    const double v = (q[i + 1] - q[i - 1]) / (2 * period), s = v > 0 ? 1 : -1, speed = std::abs(v) / fastest,
                 a = acceleration[sample.track][i];
    sample.explains << a, s * a, 1, std::sin(q[i]), std::cos(q[i]), std::sin(2 * q[i]), std::cos(2 * q[i]), s,
        s * speed, s * speed * speed, s * std::exp(-speed / 0.01), s * std::exp(-speed / 0.04),
        s * std::exp(-speed / 0.15), s * std::exp(-speed / 0.5), 0, 0;
  }
  if (static_cast<double>(samples.size()) * period < 1) return std::nullopt;

  using Vector = Eigen::Matrix<double, columns, 1>;
  using Square = Eigen::Matrix<double, columns, columns>;
  const auto torque = [&](const Sample& s, double lag_s) {
    const double shift = lag_s / period, whole = std::floor(shift), w = shift - whole;
    const auto& u = tracks[s.track].torque;
    const auto i = static_cast<std::size_t>(static_cast<double>(s.at) + whole);
    return (1 - w) * u[i] + w * u[i + 1];
  };
  Vector scale, solution;
  Eigen::CompleteOrthogonalDecomposition<Square> solver;
  const auto prepare = [&] {
    Square gram = Square::Zero();
    for (const Sample& s : samples) gram.selfadjointView<Eigen::Lower>().rankUpdate(s.explains);
    gram = Square(gram.selfadjointView<Eigen::Lower>());
    scale = gram.diagonal().cwiseMax(1e-300).cwiseSqrt();
    solver.compute(scale.cwiseInverse().asDiagonal() * gram * scale.cwiseInverse().asDiagonal());
  };
  const auto fit = [&](double lag_s) {  // sum of squares that is left
    Vector right = Vector::Zero();
    double square = 0;
    for (const Sample& s : samples) {
      const double u = torque(s, lag_s);
      right += u * s.explains;
      square += u * u;
    }
    solution = Vector(solver.solve(right.cwiseQuotient(scale))).cwiseQuotient(scale);
    return square - right.dot(solution);
  };
  prepare();
  const double step = std::max(period, 0.002);
  double best = 0, least = 1e300;
  for (double lag = earliest_s; lag <= longest_s; lag += step)
    if (const double left = fit(lag); left < least) least = left, best = lag;
  if (best - step < earliest_s || best + step > longest_s) return std::nullopt;
  for (int round = 0; round < 2; ++round) {
    for (double h = step; h > 0.02 * period; h /= 2) {  // least squares are a parabola near their least
      const double before = fit(best - h), here = fit(best), after = fit(best + h), bend = before - 2 * here + after;
      if (bend > 0) best += std::clamp(0.5 * h * (before - after) / bend, -h, h);
    }
    fit(best);
    if (round) break;
    // Friction grows with |load|, most so at low speed, and the load is known by now: all that does not change sign
    // with the direction.
    for (Sample& s : samples) {
      double load = 0;
      for (const Eigen::Index c : load_columns) load += s.explains[c] * solution[c];
      s.explains[by_load] = s.explains[7] * std::abs(load);
      s.explains[by_load + 1] = s.explains[by_load] * std::exp(-std::abs(s.explains[8]) / 0.04);
    }
    prepare();
  }

  // Without ramps there is only gravity, which friction's growth with the load can pass for.
  if (solution[0] * steepest < 5 * std::sqrt(std::max(0.0, fit(best)) / static_cast<double>(samples.size())))
    return std::nullopt;

  // Scatter: how far each part of the recording alone would move the lag.
  constexpr std::size_t parts = 12;
  std::array<double, parts> square{}, product{};
  const auto modelled = [&](std::size_t k) { return samples[k].explains.dot(solution); };
  for (std::size_t k = 1; k + 1 < samples.size(); ++k) {
    if (samples[k + 1].at != samples[k - 1].at + 2 || samples[k + 1].track != samples[k - 1].track) continue;
    const double slope = (modelled(k + 1) - modelled(k - 1)) / (2 * period);
    const std::size_t part = k * parts / samples.size();
    square[part] += slope * slope;
    product[part] += slope * (torque(samples[k], best) - modelled(k));
  }
  double total = 0, scatter = 0;
  for (std::size_t p = 0; p < parts; ++p) total += square[p], scatter += product[p] * product[p];
  if (!(total > 0)) return std::nullopt;
  const double error = std::sqrt(scatter * parts / (parts - 1.0)) / total;
  return Lag{best,
             std::max(error, 0.1 * period)};  // nobody says when within its period a controller reads which column
}

}  // namespace tribotwin::twin
