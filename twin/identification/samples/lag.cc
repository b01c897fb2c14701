#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/samples/lag.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin {
namespace {

constexpr double longest_s = 0.1, earliest_s = -0.02;  // lags that are looked for
constexpr std::size_t max_samples = 100000;
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

/// All tracks after one filter, and how fast and how steeply the joint moves in them.
struct FilteredMotion {
  std::vector<Track> tracks;
  std::vector<std::vector<double>> acceleration;  ///< per track
  double period_s = 0, width_s = 0;               ///< width of the filter
  double fastest = 0, steepest = 0;               ///< largest speed; 99.5 % quantile of the acceleration
};

double median_period_s(const JointRecording& r) {
  std::vector<double> periods;
  for (std::size_t i = 1; i < r.size(); ++i) periods.push_back(r.time_s[i] - r.time_s[i - 1]);
  std::ranges::nth_element(periods, periods.begin() + static_cast<std::ptrdiff_t>(periods.size() / 2));
  return periods[periods.size() / 2];
}

/// Nothing where the joint hardly moves.
std::optional<FilteredMotion> filtered_motion(const std::vector<Track>& raw, double period, double width_s) {
  FilteredMotion m{.period_s = period, .width_s = width_s};
  std::vector<double> kernel, magnitudes;
  for (double t = 0; t <= 3 * width_s; t += period) kernel.push_back(std::exp(-0.5 * t * t / (width_s * width_s)));
  for (const Track& track : raw) {
    m.tracks.push_back({filtered(track.q, kernel), filtered(track.torque, kernel)});
    const auto& q = m.tracks.back().q;
    auto& a = m.acceleration.emplace_back(q.size());
    for (std::size_t i = 1; i + 1 < q.size(); ++i) {
      a[i] = (q[i + 1] - 2 * q[i] + q[i - 1]) / (period * period);
      magnitudes.push_back(std::abs(a[i]));
      m.fastest = std::max(m.fastest, std::abs(q[i + 1] - q[i - 1]) / (2 * period));
    }
  }
  if (magnitudes.empty() || m.fastest < 1e-4) return std::nullopt;
  const auto high = magnitudes.begin() + static_cast<std::ptrdiff_t>(0.995 * static_cast<double>(magnitudes.size()));
  std::ranges::nth_element(magnitudes, high);
  m.steepest = *high;
  return m;
}

/// The motion under the narrowest filter that leaves the acceleration above its noise; nothing where none does.
std::optional<FilteredMotion> motion_of(const JointRecording& r, double period, double position_error_rad) {
  const std::vector<Track> raw = tracks_of(r, period);
  for (double width_s = std::max(0.01, 2 * period);; width_s *= 1.5) {
    auto motion = filtered_motion(raw, period, width_s);
    if (!motion) return std::nullopt;
    const double noise = position_error_rad * std::sqrt(0.212 * period / width_s) /
                         (width_s * width_s);  // of a Gaussian's second derivative
    if (noise < 0.02 * motion->steepest) return motion;
    if (width_s > 0.05) return std::nullopt;
  }
}

/// The samples at which the joint has long been moving in one direction, with room for every lag that is looked for.
std::vector<Sample> moving_samples(const FilteredMotion& m, double position_error_rad) {
  const auto margin = static_cast<std::size_t>(std::ceil(3 * m.width_s / m.period_s)),
             late = static_cast<std::size_t>(std::ceil(longest_s / m.period_s)) + 2;
  std::vector<Sample> samples;
  for (std::size_t k = 0; k < m.tracks.size(); ++k) {
    const auto& q = m.tracks[k].q;
    if (q.size() < 2 * (margin + late)) continue;
    std::vector<double> v(q.size());
    for (std::size_t i = 1; i + 1 < q.size(); ++i) v[i] = (q[i + 1] - q[i - 1]) / (2 * m.period_s);
    // Friction is no function of speed at standstill, nor within the filter's reach of it.
    const double slow =
        std::max(2e-4 * m.fastest, 3 * position_error_rad * std::sqrt(m.period_s / m.width_s) / m.width_s);
    std::size_t since = 0;
    std::vector<bool> moves(q.size());
    for (std::size_t i = 1; i + 1 < q.size(); ++i) {
      since = std::abs(v[i]) > slow && v[i] * v[i - 1] >= 0 ? since + 1 : 0;
      if (since > 2 * margin) moves[i - margin] = true;
    }
    for (std::size_t i = margin + late; i + margin + late < q.size(); ++i)
      if (moves[i]) samples.push_back({.track = k, .at = i});
  }
  // Minutes of data are enough: runs of 1000 samples out of a long recording.
  if (const std::size_t stride = 1 + samples.size() / max_samples; stride > 1) {
    std::size_t k = 0;
    std::erase_if(samples, [&](const Sample&) { return (k++ / 1000) % stride != 0; });
  }
  return samples;
}

/// Sets what explains the torque: acceleration, gravity as harmonics of the position, friction as functions of speed.
void explain(const FilteredMotion& m, std::vector<Sample>& samples) {
  for (Sample& sample : samples) {
    const auto& q = m.tracks[sample.track].q;
    const std::size_t i = sample.at;
    const double v = (q[i + 1] - q[i - 1]) / (2 * m.period_s), s = v > 0 ? 1 : -1, speed = std::abs(v) / m.fastest,
                 a = m.acceleration[sample.track][i];
    sample.explains << a, s * a, 1, std::sin(q[i]), std::cos(q[i]), std::sin(2 * q[i]), std::cos(2 * q[i]), s,
        s * speed, s * speed * speed, s * std::exp(-speed / 0.01), s * std::exp(-speed / 0.04),
        s * std::exp(-speed / 0.15), s * std::exp(-speed / 0.5), 0, 0;
  }
}

/// Least squares of the torque at a lag over all samples.
class Regression {
 public:
  Regression(const FilteredMotion& motion, std::vector<Sample> samples) : m_(motion), samples_(std::move(samples)) {
    explain(m_, samples_);
    prepare();
  }

  /// Sum of squares that is left at a lag. Keeps the coefficients.
  double left(double lag_s) {
    Vector right = Vector::Zero();
    double square = 0;
    for (const Sample& s : samples_) {
      const double u = torque(s, lag_s);
      right += u * s.explains;
      square += u * u;
    }
    coefficients_ = Vector((*solver_)(right.cwiseQuotient(scale_))).cwiseQuotient(scale_);
    return square - right.dot(coefficients_);
  }

  /// Lets friction grow with |load|, most at low speed: the load, all that does not change sign with the direction, is
  /// known from the last coefficients.
  void add_load_terms() {
    for (Sample& s : samples_) {
      double load = 0;
      for (const Eigen::Index c : load_columns) load += s.explains[c] * coefficients_[c];
      s.explains[by_load] = s.explains[7] * std::abs(load);
      s.explains[by_load + 1] = s.explains[by_load] * std::exp(-std::abs(s.explains[8]) / 0.04);
    }
    prepare();
  }

  /// Lag with the least squares; nothing where it lies at an end of the range searched.
  std::optional<double> best_lag_s() {
    const double step = std::max(m_.period_s, 0.002);
    double best = 0, min_rest = 1e300;
    for (double lag = earliest_s; lag <= longest_s; lag += step)
      if (const double rest = left(lag); rest < min_rest) min_rest = rest, best = lag;
    if (best - step < earliest_s || best + step > longest_s) return std::nullopt;
    for (int round = 0; round < 2; ++round) {
      for (double h = step; h > 0.02 * m_.period_s; h /= 2) {  // the squares are a parabola near their minimum
        const double before = left(best - h), here = left(best), after = left(best + h),
                     bend = before - 2 * here + after;
        if (bend > 0) best += std::clamp(0.5 * h * (before - after) / bend, -h, h);
      }
      left(best);
      if (round == 0) add_load_terms();
    }
    return best;
  }

  /// Whether ramps explain the torque beyond its noise. Without ramps there is only gravity, which friction's growth
  /// with the load can pass for.
  bool has_ramps(double lag_s) {
    const double rest = std::max(0.0, left(lag_s)) / static_cast<double>(samples_.size());
    return coefficients_[0] * m_.steepest >= 5 * std::sqrt(rest);
  }

  /// Standard error of the lag from how far each part of the recording alone would move it; nothing where none can.
  std::optional<double> stderr_s(double lag_s) const {
    constexpr std::size_t parts = 12;
    std::array<double, parts> square{}, product{};
    const auto modelled = [&](std::size_t k) { return samples_[k].explains.dot(coefficients_); };
    for (std::size_t k = 1; k + 1 < samples_.size(); ++k) {
      if (samples_[k + 1].at != samples_[k - 1].at + 2 || samples_[k + 1].track != samples_[k - 1].track) continue;
      const double slope = (modelled(k + 1) - modelled(k - 1)) / (2 * m_.period_s);
      const std::size_t part = k * parts / samples_.size();
      square[part] += slope * slope;
      product[part] += slope * (torque(samples_[k], lag_s) - modelled(k));
    }
    double total = 0, scatter = 0;
    for (std::size_t p = 0; p < parts; ++p) total += square[p], scatter += product[p] * product[p];
    if (!(total > 0)) return std::nullopt;
    const double error = std::sqrt(scatter * parts / (parts - 1.0)) / total;
    return std::max(error, 0.1 * m_.period_s);  // when within its period a controller reads which column is unknown
  }

 private:
  using Vector = Eigen::Matrix<double, columns, 1>;
  using Square = Eigen::Matrix<double, columns, columns>;

  double torque(const Sample& s, double lag_s) const {
    const double shift = lag_s / m_.period_s, whole = std::floor(shift), w = shift - whole;
    const auto& u = m_.tracks[s.track].torque;
    const auto i = static_cast<std::size_t>(static_cast<double>(s.at) + whole);
    return (1 - w) * u[i] + w * u[i + 1];
  }
  void prepare() {
    Square gram = Square::Zero();
    for (const Sample& s : samples_) gram.selfadjointView<Eigen::Lower>().rankUpdate(s.explains);
    gram = Square(gram.selfadjointView<Eigen::Lower>());
    scale_ = gram.diagonal().cwiseMax(1e-300).cwiseSqrt();
    solver_.emplace(scale_.cwiseInverse().asDiagonal() * gram * scale_.cwiseInverse().asDiagonal());
  }

  const FilteredMotion& m_;
  std::vector<Sample> samples_;
  Vector scale_, coefficients_;
  std::optional<ShortestSolution> solver_;
};

}  // namespace

std::optional<Lag> lag_of_torque(const JointRecording& r, double position_error_rad) {
  if (r.size() < 200) return std::nullopt;
  const double period = median_period_s(r);
  if (period > 0.02) return std::nullopt;
  const auto motion = motion_of(r, period, position_error_rad);
  if (!motion) return std::nullopt;
  std::vector<Sample> samples = moving_samples(*motion, position_error_rad);
  if (static_cast<double>(samples.size()) * period < 1) return std::nullopt;
  Regression regression(*motion, std::move(samples));
  const auto lag_s = regression.best_lag_s();
  if (!lag_s || !regression.has_ramps(*lag_s)) return std::nullopt;
  const auto stderr_s = regression.stderr_s(*lag_s);
  if (!stderr_s) return std::nullopt;
  return Lag{*lag_s, *stderr_s};
}

}  // namespace tribotwin::twin
