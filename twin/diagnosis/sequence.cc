#include <algorithm>
#include <cmath>

#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/diagnosis/sequence.hpp>
#include <tribotwin/twin/io/table.hpp>

namespace tribotwin::twin::diagnosis {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
constexpr double score_most = 8;  ///< a normal score beyond which probabilities underflow

double cumulative(double z) { return boost::math::cdf(boost::math::normal(), z); }

/// When a straight line plus `side` times its standard error first reaches a level, from now on; none within a thousand
/// times what was observed.
struct Line {
  Eigen::Vector2d coefficients;
  Eigen::Matrix2d covariance;
  double at(double t) const { return coefficients(0) + coefficients(1) * t; }
  double error(double t) const { return std::sqrt(Eigen::Vector2d(1, t).dot(covariance * Eigen::Vector2d(1, t))); }

  std::optional<double> reaches(double level, double side, double now) const {
    const auto missing = [&](double t) { return at(t) + side * error(t) - level; };
    if (missing(now) >= 0) return 0;
    const double end = now + 1000 * std::max(now, 1.0);
    double from = now, to = now + 1;
    for (; missing(to) < 0; to = now + 2 * (to - now)) {
      if (to > end) return std::nullopt;
      from = to;
    }
    for (int i = 0; i < 60; ++i) (missing((from + to) / 2) < 0 ? from : to) = (from + to) / 2;
    return to - now;
  }
};

std::optional<Margin> margin_of(const HealthyState& h, std::span<const Observation> observations) {
  const auto n = static_cast<Index>(observations.size());
  if (n < 3) return std::nullopt;
  MatrixXd x(n, 2);
  VectorXd y(n);
  for (Index i = 0; i < n; ++i) {
    x.row(i) << 1, static_cast<double>(i);
    y(i) = equivalent_load(h, observations[static_cast<std::size_t>(i)]).load_norm;
  }
  const Eigen::Matrix2d inverse = (x.transpose() * x).inverse();
  Line line{.coefficients = inverse * x.transpose() * y};
  const double freedom = static_cast<double>(n - 2);
  line.covariance = inverse * (y - x * line.coefficients).squaredNorm() / freedom;
  const double t = boost::math::quantile(boost::math::students_t(freedom), 0.975), now = static_cast<double>(n - 1),
               threshold = h.wear_load();
  const double left = threshold - line.at(now), width = t * line.error(now);
  return Margin{.load_norm = {left, left - width, left + width},
                .observations = line.reaches(threshold, 0, now),
                .earliest = line.reaches(threshold, t, now),
                .latest = line.reaches(threshold, -t, now)};
}

}  // namespace

double average_run_length(double h) {
  constexpr Index n = 100;
  const double width = 2 * h / (2 * n - 1);  // state i holds sums around i width, state 0 all that end at 0
  MatrixXd stay(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index k = 0; k < n; ++k) {
      const double step = static_cast<double>(k - i) * width + cusum_allowance;
      stay(i, k) = cumulative(step + width / 2) - (k == 0 ? 0 : cumulative(step - width / 2));
    }
  return (MatrixXd::Identity(n, n) - stay).partialPivLu().solve(VectorXd::Ones(n))(0);
}

double cusum_threshold(double false_alarm) {
  double low = 0, high = 20;
  for (int i = 0; i < 30; ++i) (average_run_length((low + high) / 2) < 1 / false_alarm ? low : high) = (low + high) / 2;
  return high;
}

Cusum::Step Cusum::take(const VectorXd& y, const VectorXd& x, double scatter, double threshold) {
  Baseline& b = baseline_;
  const VectorXd e = y - b.predicted(x);
  const double variance = b.variance(x, scatter);
  const double chance = b.exceeded_by_chance(e.dot(b.covariance.ldlt().solve(e)) / variance);
  const double score = chance > 0
                           ? std::clamp(-boost::math::quantile(boost::math::normal(), std::min(chance, 1 - 1e-15)),
                                        -score_most, score_most)
                           : score_most;
  sum_ = std::max(0.0, sum_ + score - cusum_allowance);
  sounded_ |= sum_ > threshold;
  if (!sounded_) {  // recursive least squares
    const VectorXd gain = b.inverse_gram * x / variance;
    b.coefficients += gain * e.transpose();
    b.inverse_gram -= gain * gain.transpose() * variance;
    b.covariance = (b.covariance * b.freedom + e * e.transpose() / variance) / (b.freedom + 1);
    ++b.freedom;
  }
  return {.score = score, .sum = sum_};
}

Watch watch(const HealthyState& h, std::span<const Observation> observations, double false_alarm) {
  Watch w{.threshold = cusum_threshold(false_alarm / static_cast<double>(regions.size()))};
  std::array<Cusum, 2> charts{Cusum(h.region[0]), Cusum(h.region[1])};
  for (const auto& o : observations) {
    WatchStep step;
    for (std::size_t r = 0; r < regions.size(); ++r) {
      step.region[r] = charts[r].take(o.logarithmic().segment(regions[r].first, regions[r].count),
                                      h.regressors(o.temperature_degC), h.scatter_of(o, r), w.threshold);
      step.alarm[r] = step.region[r].sum > w.threshold;
      if (step.alarm[r] && !w.first_alarm) w.first_alarm = w.steps.size();
    }
    w.steps.push_back(step);
  }
  w.margin = margin_of(h, observations);
  return w;
}

Result<ResidualWatch> watch_residuals(const std::filesystem::path& file, const ResidualOptions& o) {
  constexpr std::string_view ending = ".residual_nm";
  const auto header = read_numbers(file, {});
  if (!header) return tl::unexpected(header.error());
  std::vector<std::string> joints;
  for (const auto& name : header->names)
    if (name.ends_with(ending)) joints.push_back(name.substr(0, name.size() - ending.size()));
  if (joints.empty())
    return tl::unexpected(
        fmt::format("{}:1: no column JOINT{}, as tribotwin-hil shadow --csv writes them; the header names {}",
                    file.string(), ending, fmt::join(header->names, ", ")));
  ResidualWatch w{.joint = o.joint};
  if (w.joint.empty() && joints.size() == 1) w.joint = joints.front();
  if (std::ranges::find(joints, w.joint) == joints.end())
    return tl::unexpected(
        fmt::format("{}: --joint '{}': its joints are {}", file.string(), w.joint, fmt::join(joints, ", ")));
  const auto table = read_numbers(file, {"time_s", w.joint + std::string(ending), w.joint + ".temperature_degC"});
  if (!table) return tl::unexpected(table.error());
  const auto &time = table->columns[0], &residual = table->columns[1], &temperature = table->columns[2];
  if (const auto problem = not_increasing(*table, time)) return tl::unexpected(*problem);
  if (time.empty() || residual.empty())
    return tl::unexpected(fmt::format("{}: no row with time_s and {}{}", file.string(), w.joint, ending));

  std::vector<double> level, warmth;  // of the windows: ln rms, mean temperature
  double squares = 0, degrees = 0, end = time.front() + o.window_s;
  std::size_t count = 0;
  for (std::size_t i = 0; i < time.size(); ++i) {
    if (time[i] >= end) {
      if (count && squares > 0) {
        w.windows.push_back({.time_s = end, .rms_nm = std::sqrt(squares / static_cast<double>(count))});
        level.push_back(std::log(w.windows.back().rms_nm));
        warmth.push_back(degrees / static_cast<double>(count));
      }
      end += o.window_s * (std::floor((time[i] - end) / o.window_s) + 1);  // across a gap of any length at once
      squares = degrees = 0, count = 0;
    }
    squares += residual[i] * residual[i], ++count;
    if (!temperature.empty()) degrees += temperature[i];
  }
  const std::size_t learn = std::max(o.learn, observations_least);
  if (level.size() <= learn)
    return tl::unexpected(fmt::format(
        "{}: {} whole windows of {:g} s, of which {} are learned from: record {:g} s or more, or shorten --window",
        file.string(), level.size(), o.window_s, learn, static_cast<double>(learn + 2) * o.window_s));

  const auto n = static_cast<Index>(learn);
  const auto [low, high] = std::minmax_element(warmth.begin(), warmth.begin() + n);
  const bool warms = *high - *low >= temperature_span_K;
  const double middle = (*low + *high) / 2;
  const auto regressors = [&](std::size_t i) {
    VectorXd x = VectorXd::Ones(warms ? 2 : 1);
    if (warms) x(1) = warmth[i] - middle;
    return x;
  };
  MatrixXd x(n, warms ? 2 : 1);
  for (Index i = 0; i < n; ++i) x.row(i) = regressors(static_cast<std::size_t>(i));
  const VectorXd y = Eigen::Map<const VectorXd>(level.data(), n);
  const Baseline baseline = regression(x, y, VectorXd::Ones(n));
  const VectorXd e = y - x * baseline.coefficients;
  w.correlation = e.head(n - 1).dot(e.tail(n - 1)) / std::max(e.squaredNorm(), 1e-300);
  if (!(baseline.covariance(0, 0) > 0))
    return tl::unexpected(fmt::format("{}: the residuals of the first {} windows are all alike; this is no measurement",
                                      file.string(), learn));
  w.threshold = cusum_threshold(o.false_alarm);
  Cusum chart(baseline);
  for (std::size_t i = learn; i < level.size(); ++i) {
    w.windows[i].cusum = chart.take(VectorXd::Constant(1, level[i]), regressors(i), 1, w.threshold);
    w.windows[i].alarm = w.windows[i].cusum.sum > w.threshold;
    if (w.windows[i].alarm && !w.first_alarm) w.first_alarm = i;
  }
  return w;
}

}  // namespace tribotwin::twin::diagnosis
