#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/sequence.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::diagnosis {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
constexpr double straight_refused = 0.01;  ///< share of straight trends that are not taken for one
constexpr double score_maximum = 8;        ///< normal scores are limited to this: beyond, probabilities underflow

/// When the line plus `side` times its half width first reaches a level, from now on; none within a thousand times the
/// observed range.
std::optional<double> reaches(const Margin& m, double level, double side, double now) {
  const auto missing = [&](double x) {
    const Interval line = m.at(x);
    return line.value + side * (line.high - line.value) - level;
  };
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

/// The columns of one joint. Residuals and times are not empty; temperatures are, where the file has none.
struct Residuals {
  std::string joint;
  std::vector<double> time_s, residual_nm, temperature_degC;
  std::vector<std::string> notes;
};

/// Joints of the columns residual_JOINT_nm or, where there is none, of predicted_JOINT_nm beside torque_JOINT_nm.
std::vector<std::string> joints_of(const Numbers& header, std::string_view quantity) {
  std::vector<std::string> joints;
  for (const auto& name : header.names)
    if (const auto column = parse_column(name); column && *column && (*column)->quantity->name == quantity)
      joints.push_back((*column)->joint);
  return joints;
}

Result<Residuals> read_residuals(const std::filesystem::path& file, const TableOptions& options) {
  auto opened = OpenTable::open(file, options);
  if (!opened) return tl::unexpected(opened.error());
  const auto header = opened->header();
  if (!header) return tl::unexpected(header.error());
  const auto residuals = joints_of(*header, "residual");
  const auto joints = residuals.empty() ? joints_of(*header, "predicted") : residuals;
  if (joints.empty())
    return tl::unexpected(fmt::format(
        "{}:1: no column residual_JOINT_nm, as tribotwin-hil shadow -o writes them, nor predicted_JOINT_nm with "
        "torque_JOINT_nm, as of tribotwin predict; the header names {}",
        file.string(), header->header));
  const std::string joint = options.joint.empty() && joints.size() == 1 ? joints.front() : options.joint;
  if (std::ranges::find(joints, joint) == joints.end())
    return tl::unexpected(fmt::format("{}: --joint {}: its joints are {}", file.string(), shown(joint), shown(joints)));
  const auto name = [&](std::string_view quantity, std::string_view unit) {
    return fmt::format("{}_{}{}{}", quantity, joint, joint.empty() ? "" : "_", unit);
  };
  const bool given = !residuals.empty();
  auto table = opened->read({"time_s", given ? name("residual", "nm") : name("torque", "nm"),
                             given ? "" : name("predicted", "nm"), name("temperature", "degC")});
  if (!table) return tl::unexpected(table.error());
  auto& columns = table->columns;
  if (const auto problem = not_increasing(*table, columns[0])) return tl::unexpected(*problem);
  if (columns[0].empty() || columns[1].empty())
    return tl::unexpected(fmt::format("{}: no row with time_s and {}", file.string(),
                                      given ? name("residual", "nm") : name("torque", "nm")));
  for (std::size_t i = 0; i < columns[2].size(); ++i) columns[1][i] -= columns[2][i];
  return Residuals{.joint = joint,
                   .time_s = std::move(columns[0]),
                   .residual_nm = std::move(columns[1]),
                   .temperature_degC = std::move(columns[3]),
                   .notes = std::move(table->notes)};
}

/// Per window with samples.
struct Windows {
  std::vector<double> end_s, rms_nm, temperature_degC;  ///< temperature: mean, 0 where none was recorded
};

Windows windows_of(const Residuals& r, double window_s) {
  Windows out;
  double squares = 0, degrees = 0, end = r.time_s.front() + window_s;
  std::size_t count = 0;
  for (std::size_t i = 0; i < r.time_s.size(); ++i) {
    if (r.time_s[i] >= end) {
      if (count && squares > 0) {
        out.end_s.push_back(end);
        out.rms_nm.push_back(std::sqrt(squares / static_cast<double>(count)));
        out.temperature_degC.push_back(degrees / static_cast<double>(count));
      }
      end += window_s * (std::floor((r.time_s[i] - end) / window_s) + 1);  // one step across a gap of any length
      squares = degrees = 0, count = 0;
    }
    squares += r.residual_nm[i] * r.residual_nm[i], ++count;
    if (!r.temperature_degC.empty()) degrees += r.temperature_degC[i];
  }
  return out;
}

/// Regressors of windows: 1 and, where the learned ones differ by temperature_span_K, temperature - middle.
struct WindowRegressors {
  bool warms;
  double middle_degC;

  WindowRegressors(const std::vector<double>& temperature_degC, std::size_t learned) {
    const auto [low, high] =
        std::minmax_element(temperature_degC.begin(), temperature_degC.begin() + static_cast<std::ptrdiff_t>(learned));
    warms = *high - *low >= temperature_span_K;
    middle_degC = (*low + *high) / 2;
  }
  VectorXd operator()(double temperature_degC) const {
    VectorXd x = VectorXd::Ones(warms ? 2 : 1);
    if (warms) x(1) = temperature_degC - middle_degC;
    return x;
  }
};

}  // namespace

Interval Margin::at(double x) const {
  const Eigen::Vector2d regressors(1, x);
  const double middle = regressors.dot(line), width = quantile * std::sqrt(regressors.dot(covariance * regressors));
  return {middle, middle - width, middle + width};
}

Interval left_to_wear(const EquivalentLoad& l) {
  const double left = l.threshold - l.load_norm, reach = normal_quantile(0.975) * l.sigma;
  return {left, left - reach, left + reach};
}

std::optional<Margin> margin(const HealthyState& h, std::span<const Observation> observations,
                             std::span<const double> at) {
  const auto n = static_cast<Index>(observations.size());
  if (n < 3) return std::nullopt;
  MatrixXd x(n, 2);
  VectorXd y(n), sigma(n);
  for (Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const EquivalentLoad load = equivalent_load(h, observations[k]);
    x.row(i) << 1, at[k];
    y(i) = load.load_norm;
    sigma(i) = load.sigma;
  }
  const Eigen::Matrix2d inverse_gram = inverse(x.transpose() * x);
  const double freedom = static_cast<double>(n - 2);
  Margin m{};
  m.line = inverse_gram * x.transpose() * y;
  const VectorXd e = y - x * m.line;
  m.covariance = inverse_gram * e.squaredNorm() / freedom;
  m.quantile = student_t_quantile(freedom, 0.975);
  m.straight = chi_squared_above(freedom, e.cwiseQuotient(sigma).squaredNorm()) > straight_refused;
  if (!m.straight) {
    m.load_norm = left_to_wear(equivalent_load(h, observations.back()));
    return m;
  }
  const double now = at.back(), threshold = h.wear_load();
  const Interval last = m.at(now);
  m.load_norm = {threshold - last.value, threshold - last.high, threshold - last.low};
  m.observations = reaches(m, threshold, 0, now);
  m.earliest = reaches(m, threshold, 1, now);
  m.latest = reaches(m, threshold, -1, now);
  return m;
}

double average_run_length(double h) {
  constexpr Index n = 100;
  const double width = 2 * h / (2 * n - 1);  // state i: sums around i width; state 0: a sum of 0
  MatrixXd stay(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index k = 0; k < n; ++k) {
      const double step = static_cast<double>(k - i) * width + cusum_allowance;
      stay(i, k) = normal_below(step + width / 2) - (k == 0 ? 0 : normal_below(step - width / 2));
    }
  return square_solution(MatrixXd::Identity(n, n) - stay, VectorXd::Ones(n))(0);
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
  const double chance = b.exceeded_by_chance(e.dot(symmetric_solution(b.covariance, e)) / variance);
  const double score = chance > 0
                           ? std::clamp(-normal_quantile(std::min(chance, 1 - 1e-15)), -score_maximum, score_maximum)
                           : score_maximum;
  sum_ = std::max(0.0, sum_ + score - cusum_allowance);
  alarmed_ |= sum_ > threshold;
  if (!alarmed_) {  // recursive least squares
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
  std::vector<double> numbers;
  for (std::size_t i = 0; i < observations.size(); ++i) numbers.push_back(static_cast<double>(i));
  w.margin = margin(h, observations, numbers);
  return w;
}

Result<ResidualWatch> watch_residuals(const std::filesystem::path& file, const ResidualOptions& o) {
  const auto residuals = read_residuals(file, o.table);
  if (!residuals) return tl::unexpected(residuals.error());
  const Windows windows = windows_of(*residuals, o.window_s);
  const std::size_t count = windows.rms_nm.size(), learn = std::max(o.learn, observations_minimum);
  if (count <= learn)
    return tl::unexpected(fmt::format(
        "{}: {} whole windows of {:g} s, of which {} are learned from: record {:g} s or more, or shorten --window",
        file.string(), count, o.window_s, learn, static_cast<double>(learn + 2) * o.window_s));

  VectorXd level(static_cast<Index>(count));  // ln rms
  for (std::size_t i = 0; i < count; ++i) level(static_cast<Index>(i)) = std::log(windows.rms_nm[i]);
  const WindowRegressors regressors(windows.temperature_degC, learn);
  const auto n = static_cast<Index>(learn);
  MatrixXd x(n, regressors.warms ? 2 : 1);
  for (Index i = 0; i < n; ++i) x.row(i) = regressors(windows.temperature_degC[static_cast<std::size_t>(i)]);
  const VectorXd y = level.head(n);
  const Baseline baseline = regression(x, y, VectorXd::Ones(n));
  const VectorXd e = y - x * baseline.coefficients;
  if (!(baseline.covariance(0, 0) > 0))
    return tl::unexpected(fmt::format("{}: the residuals of the first {} windows are all equal; this is no measurement",
                                      file.string(), learn));

  ResidualWatch w{.joint = residuals->joint,
                  .threshold = cusum_threshold(o.false_alarm),
                  .correlation = e.head(n - 1).dot(e.tail(n - 1)) / std::max(e.squaredNorm(), 1e-300)};
  w.notes = residuals->notes;
  Cusum chart(baseline);
  for (std::size_t i = 0; i < count; ++i) {
    auto& window = w.windows.emplace_back(
        ResidualWatch::Window{.time_s = windows.end_s[i], .rms_nm = windows.rms_nm[i], .cusum = {}});
    if (i < learn) continue;
    window.cusum = chart.take(VectorXd::Constant(1, level(static_cast<Index>(i))),
                              regressors(windows.temperature_degC[i]), 1, w.threshold);
    window.alarm = window.cusum.sum > w.threshold;
    if (window.alarm && !w.first_alarm) w.first_alarm = i;
  }
  return w;
}

}  // namespace tribotwin::twin::diagnosis
