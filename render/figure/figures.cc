#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <numeric>
#include <random>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::render {
namespace {

Series law_series(const drive::Drive& drive, const LawAxes& axes, double speed_max, double load, double temperature) {
  constexpr int steps = 160;
  Series s;
  for (int i = 0; i <= steps; ++i) {
    const double share = static_cast<double>(i) / steps,
                 speed = speed_max * share * share;  // closer where friction bends
    s.x.push_back(speed * axes.per_joint_rad_s);
    s.y.push_back(mujoco::friction_nm(drive, speed, load, temperature) * axes.per_nm);
  }
  return s;
}

/// The band of 95 % around a line: there above it, back below it, of magnitudes not below 0. Only the first of a figure
/// has a label.
Series band_around(const Series& line, std::span<const double> half_width, bool magnitude, bool first) {
  const std::size_t n = line.x.size();
  Series band{.mark = Mark::band, .label = first ? "95 % band" : "", .shade = line.shade, .stroke = line.stroke};
  band.x.resize(2 * n), band.y.resize(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    const double low = line.y[i] - half_width[i];
    band.x[i] = band.x[2 * n - 1 - i] = line.x[i];
    band.y[i] = line.y[i] + half_width[i];
    band.y[2 * n - 1 - i] = magnitude ? std::max(0.0, low) : low;
  }
  return band;
}

/// One band per stretch in which both the line and its half width are known.
void add_bands(Figure& f, const Series& line, std::span<const double> half_width) {
  const auto known = [&](std::size_t i) { return i < line.y.size() && std::isfinite(line.y[i] + half_width[i]); };
  for (std::size_t from = 0, to = 0; from < line.y.size(); from = to + 1) {
    for (to = from; known(to);) ++to;
    if (to < from + 2) continue;
    const auto cut = [&](const std::vector<double>& v) {
      return std::vector(v.begin() + static_cast<std::ptrdiff_t>(from), v.begin() + static_cast<std::ptrdiff_t>(to));
    };
    const Series stretch{.x = cut(line.x), .y = cut(line.y), .stroke = line.stroke};
    f.series.push_back(band_around(stretch, half_width.subspan(from), false, f.series.empty()));
  }
}

/// A curve of the law and, below it, its band. `shade` is empty where the figure has no colour axis.
void add_law(Figure& f, const drive::Drive& drive, double speed_max, double load, double temperature,
             std::vector<double> shade, const friction::Uncertainty* uncertainty) {
  const LawAxes axes(drive);
  Series curve = law_series(drive, axes, speed_max, load, temperature);
  if (shade.empty()) curve.stroke = 0;
  curve.shade = std::move(shade);
  if (uncertainty) {
    std::vector<double> half;
    for (const double x : curve.x)
      half.push_back(
          axes.per_nm * drive.torque_scale_nm() *
          half_width(drive.law, *uncertainty, x / axes.per_joint_rad_s * drive.speed_scale(), load, temperature));
    f.series.push_back(band_around(curve, half, true, f.series.empty()));
    f.series.back().stroke = 0;
  }
  f.series.push_back(std::move(curve));
}

/// Adds one series of plain points and one with error bars, where there are such points. `shade` gives their place on
/// the colour axis.
void add_points(Figure& figure, const LawAxes& axes, std::span<const FrictionPoint> points,
                double FrictionPoint::*shade) {
  Series plain{.mark = Mark::points}, measured{.mark = Mark::error_bars};
  for (const auto& p : points) {
    Series& to = p.error_nm > 0 ? measured : plain;
    to.x.push_back(p.speed_rad_s * axes.per_joint_rad_s);
    to.y.push_back(p.friction_nm * axes.per_nm);
    to.error.push_back(p.error_nm * axes.per_nm);
    if (shade) to.shade.push_back(p.*shade);
  }
  for (Series* s : {&plain, &measured})
    if (!s->x.empty()) figure.series.push_back(std::move(*s));
}

/// Limits of a colour axis around all values, at least `span_min` apart.
void set_limits(Axis& axis, std::span<const double> values, double span_min) {
  const auto [low, high] = std::ranges::minmax(values);
  const double pad = std::max(0.0, (span_min - (high - low)) / 2);
  axis.from = low - pad;
  axis.to = high + pad;
}

/// The same for magnitudes: from 0 on.
void set_magnitudes(Axis& axis, std::span<const double> values, double span_min) {
  set_limits(axis, values, span_min);
  if (*axis.from < 0) axis.to = *axis.to - *axis.from, axis.from = 0;
}
constexpr double temperature_span_K = 2, load_span = 0.05;

/// Outline at this many standard deviations.
void set_ellipse(Series& s, const std::array<double, 2>& mean, const std::array<std::array<double, 2>, 2>& covariance,
                 double radius) {
  Eigen::Matrix2d c;
  c << covariance[0][0], covariance[0][1], covariance[1][0], covariance[1][1];
  const twin::SymmetricEigen axes = twin::symmetric_eigen(c);
  const Eigen::Matrix2d half = axes.vectors * axes.values.cwiseMax(0).cwiseSqrt().asDiagonal();
  for (int k = 0; k <= 120; ++k) {
    const double angle = 2 * std::numbers::pi * k / 120;
    const Eigen::Vector2d p =
        Eigen::Vector2d(mean[0], mean[1]) + radius * half * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    s.x.push_back(p.x());
    s.y.push_back(p.y());
  }
}

/// Bars of finite values by Rice's rule.
Series histogram_bars(std::span<const double> values) {
  auto [low, high] = std::ranges::minmax(values);
  if (!(low < high)) low -= 0.5, high += 0.5;
  const auto n = static_cast<double>(values.size());
  const int bins = std::clamp(static_cast<int>(std::lround(2 * std::cbrt(n))), 5, 80);
  const double width = (high - low) / bins;
  Series bars{.mark = Mark::bars, .x = {}, .y = std::vector<double>(static_cast<std::size_t>(bins))};
  for (int i = 0; i < bins; ++i) bars.x.push_back(low + width * (i + 0.5));
  for (const double v : values)
    ++bars.y[static_cast<std::size_t>(std::min(bins - 1, static_cast<int>((v - low) / width)))];
  return bars;
}
double bar_distance(const Series& bars) { return bars.x[1] - bars.x[0]; }

struct TimeUnit {
  const char* name;
  double seconds;
};
TimeUnit unit_of(double span_s) {
  if (span_s > 2 * 3600) return {"h", 3600};
  if (span_s > 3 * 60) return {"min", 60};
  return {"s", 1};
}

}  // namespace

LawAxes::LawAxes(const drive::Drive& drive) {
  const bool motor = drive.law.info->side == friction::Side::motor, parts = drive.law.info->normalised;
  speed = {.quantity = motor ? "motor speed" : "joint speed", .symbol = "{/:Italic v}", .unit = "rad/s", .from = 0};
  friction = parts ? Axis{.quantity = "friction torque", .symbol = "{/:Italic τ}_f / {/:Italic τ}_{max}", .unit = "-"}
                   : Axis{.quantity = "friction torque", .symbol = "{/:Italic τ}_f", .unit = "Nm"};
  load = {.quantity = "load", .symbol = "|{/:Italic τ}_l| / {/:Italic τ}_{max}", .unit = "-"};
  per_joint_rad_s = motor ? drive.gear_ratio : 1;
  per_nm = parts ? 1 / drive.torque_max_nm : 1;
}

Figure in_units_of(Figure law, bool slide) {
  for (Axis* axis : {&law.x, &law.y, law.z ? &*law.z : nullptr}) {
    if (!slide || !axis) continue;
    if (axis->unit == "Nm") axis->unit = "N", axis->quantity = "friction";
    if (axis->quantity == "joint speed") axis->unit = "m/s";
  }
  return law;
}

Figure friction_against_temperature(const drive::Drive& drive, const std::string& title, double speed_max,
                                    double load_norm, std::span<const double> temperatures,
                                    std::span<const FrictionPoint> points, const friction::Uncertainty* uncertainty) {
  const LawAxes axes(drive);
  Figure f{.title = title, .x = axes.speed, .y = axes.friction};
  f.colour = Axis{.quantity = "temperature", .symbol = "{/:Italic T}", .unit = "°C"};
  std::vector<double> all(temperatures.begin(), temperatures.end());
  for (const auto& p : points) all.push_back(p.temperature_degC);
  set_limits(*f.colour, all, temperature_span_K);
  for (const double t : temperatures) {
    add_law(f, drive, speed_max, load_norm, t, {t}, uncertainty);
  }
  add_points(f, axes, points, &FrictionPoint::temperature_degC);
  return f;
}

Figure friction_against_load(const drive::Drive& drive, const std::string& title, double speed_max, double temperature,
                             std::span<const double> loads, std::span<const FrictionPoint> points,
                             const friction::Uncertainty* uncertainty) {
  const LawAxes axes(drive);
  Figure f{.title = title, .x = axes.speed, .y = axes.friction};
  f.colour = axes.load;
  std::vector<double> all(loads.begin(), loads.end());
  for (const auto& p : points) all.push_back(p.load_norm);
  set_magnitudes(*f.colour, all, load_span);
  for (const double load : loads) {
    add_law(f, drive, speed_max, load, temperature, {load}, uncertainty);
  }
  add_points(f, axes, points, &FrictionPoint::load_norm);
  return f;
}

Figure friction_against_speed(const drive::Drive& drive, const std::string& title, double speed_max, double load_norm,
                              std::span<const FrictionPoint> points, const friction::Uncertainty* uncertainty) {
  const LawAxes axes(drive);
  Figure f{.title = title, .x = axes.speed, .y = axes.friction};
  add_law(f, drive, speed_max, load_norm, 0, {}, uncertainty);
  const std::size_t curves = f.series.size();
  add_points(f, axes, points, nullptr);
  for (auto& s : std::span(f.series).subspan(curves)) s.stroke = 1;
  return f;
}

Figure friction_surface(const drive::Drive& drive, const std::string& title, double speed_max, double load_norm,
                        double from, double to) {
  const LawAxes axes(drive);
  Figure f{.title = title,
           .x = axes.speed,
           .y = {.quantity = "temperature", .symbol = "{/:Italic T}", .unit = "°C"},
           .z = axes.friction};
  f.x.from.reset();
  constexpr int steps = 40;
  Surface s;
  for (int i = 0; i <= steps; ++i) s.x.push_back(speed_max * axes.per_joint_rad_s * i / steps);
  for (int i = 0; i <= steps; ++i) {
    s.y.push_back(from + (to - from) * i / steps);
    auto& row = s.z.emplace_back();
    for (int k = 0; k <= steps; ++k)
      row.push_back(mujoco::friction_nm(drive, speed_max * k / steps, load_norm, s.y.back()) * axes.per_nm);
  }
  f.surface = std::move(s);
  return f;
}

Figure history(const std::string& title, const Axis& quantity, std::span<const Trace> traces) {
  double span = 0;
  for (const auto& t : traces)
    for (const double at : t.time_s)
      if (std::isfinite(at)) span = std::max(span, std::abs(at));
  const TimeUnit unit = unit_of(span);
  Figure f{.title = title, .x = {.quantity = "time", .symbol = "{/:Italic t}", .unit = unit.name}, .y = quantity};
  std::vector<Series> lines;
  for (const auto& t : traces) {
    Series& s =
        lines.emplace_back(Series{.mark = t.mark, .label = t.label, .x = t.time_s, .y = t.values, .stroke = t.stroke});
    for (double& x : s.x) x /= unit.seconds;
    if (!t.half_width.empty()) add_bands(f, s, t.half_width);  // below all lines
  }
  std::ranges::move(lines, std::back_inserter(f.series));
  return f;
}

Figure tracking_error(const std::string& title, std::span<const Trace> errors_rad) {
  std::vector<Trace> traces(errors_rad.begin(), errors_rad.end());
  for (auto& trace : traces)
    for (double& v : trace.values) v *= 1e3;
  return history(title, {.quantity = "tracking error", .symbol = "{/:Italic q}_d − {/:Italic q}", .unit = "mrad"},
                 traces);
}

Figure residual_histogram(const std::string& title, const Axis& residual, std::span<const double> residuals) {
  std::vector<double> r;
  std::ranges::copy_if(residuals, std::back_inserter(r), [](double v) { return std::isfinite(v); });
  Figure f{.title = title, .x = residual, .y = {.quantity = "count", .unit = "-", .from = {}, .to = {}}};
  if (r.empty()) {
    f.series.push_back({.mark = Mark::bars, .x = {0}, .y = {std::nan("")}});  // draw() refuses it and names the figure
    return f;
  }
  const double n = static_cast<double>(r.size()), mean = std::accumulate(r.begin(), r.end(), 0.0) / n;
  double square = 0;
  for (const double v : r) square += (v - mean) * (v - mean);
  const double deviation = std::sqrt(square / std::max(n - 1, 1.0));
  Series bars = histogram_bars(r);
  const double width = bar_distance(bars), low = bars.x.front() - width / 2, high = bars.x.back() + width / 2;
  bars.label = fmt::format("n = {}", r.size());
  f.series.push_back(std::move(bars));
  if (deviation > 0) {
    Series normal{.label = fmt::format("normal, mean {:.3g}, std {:.3g}",
                                       std::abs(mean) < 5e-4 * deviation ? 0.0 : mean, deviation)};
    for (int i = 0; i <= 200; ++i) {
      const double x = low + (high - low) * i / 200, z = (x - mean) / deviation;
      normal.x.push_back(x);
      normal.y.push_back(n * width * std::exp(-z * z / 2) / (deviation * std::sqrt(2 * std::numbers::pi)));
    }
    f.series.push_back(std::move(normal));
  }
  return f;
}

Figure distribution(const std::string& title, const Axis& quantity, std::span<const double> values,
                    std::span<const Marked> marked, const std::string& strip, double low, double high) {
  std::vector<double> finite;
  std::ranges::copy_if(values, std::back_inserter(finite), [](double v) { return std::isfinite(v); });
  Figure f{.title = title, .x = quantity, .y = {.quantity = "runs", .unit = "", .from = 0, .whole = true}};
  if (finite.empty()) {
    f.series.push_back({.mark = Mark::bars, .x = {0}, .y = {std::nan("")}});  // draw() refuses it and names the figure
    return f;
  }
  Series bars = histogram_bars(finite);
  bars.label = fmt::format("n = {}", finite.size()), bars.stroke = 0;
  const double top = std::ranges::max(bars.y) * 1.05;
  f.y.to = top;
  f.series.push_back(std::move(bars));
  if (std::isfinite(low) && low < high)
    f.series.push_back(
        {.mark = Mark::area, .label = strip, .x = {low, low, high, high}, .y = {0, top, top, 0}, .stroke = 4});
  std::vector<std::string> labels;
  for (const Marked& m : marked) {
    if (!std::isfinite(m.at)) continue;
    auto known = std::ranges::find(labels, m.label);
    const bool again = known != labels.end();
    const auto stroke = 1 + 2 * static_cast<std::size_t>(known - labels.begin());
    f.series.push_back(
        {.mark = Mark::reference, .label = again ? "" : m.label, .x = {m.at, m.at}, .y = {0, top}, .stroke = stroke});
    if (!again) labels.push_back(m.label);
  }
  return f;
}

std::vector<double> evenly(double from, double to, int count) {
  if (count < 2) return {(from + to) / 2};
  if (!(from < to)) return {from};
  std::vector<double> v;
  for (int i = 0; i < count; ++i) v.push_back(from + (to - from) * i / (count - 1));
  return v;
}

std::vector<std::size_t> thinned(std::size_t count, std::size_t maximum) {
  std::vector<std::size_t> rows;
  std::mt19937_64 random(1);  // its numbers are fixed by the standard
  for (std::size_t k = 0; k < std::min(count, maximum); ++k) {
    const std::size_t begin = k * count / std::min(count, maximum), end = (k + 1) * count / std::min(count, maximum);
    rows.push_back(begin + random() % (end - begin));
  }
  return rows;
}

Figure scatter(const std::string& title, const Axis& x, const Axis& y, std::span<const double> xs,
               std::span<const double> ys, std::size_t points_max) {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < std::min(xs.size(), ys.size()); ++i)
    if (std::isfinite(xs[i]) && std::isfinite(ys[i])) rows.push_back(i);
  Figure f{.title = title, .x = x, .y = y};
  Series points{.mark = Mark::points, .stroke = 0};
  for (const std::size_t k : thinned(rows.size(), points_max))
    points.x.push_back(xs[rows[k]]), points.y.push_back(ys[rows[k]]);
  f.series.push_back(std::move(points));
  std::ranges::stable_sort(rows, {}, [&](std::size_t i) { return xs[i]; });
  Series mean{.label = "mean", .stroke = 1},
      above{.mark = Mark::reference, .label = "± standard deviation", .stroke = 1},
      below{.mark = Mark::reference, .stroke = 1};
  const std::size_t n = rows.size(), usual = std::max<std::size_t>(n / 24, 30);
  for (std::size_t begin = 0; begin < n;) {
    std::size_t end = std::min(n, begin + usual);
    if (n - end < usual / 2) end = n;
    while (end < n && xs[rows[end]] == xs[rows[end - 1]]) ++end;  // equal values stay in one class
    const double count = static_cast<double>(end - begin);
    double at = 0, level = 0, squares = 0;
    for (std::size_t k = begin; k < end; ++k) at += xs[rows[k]], level += ys[rows[k]];
    at /= count, level /= count;
    for (std::size_t k = begin; k < end; ++k) squares += (ys[rows[k]] - level) * (ys[rows[k]] - level);
    const double deviation = std::sqrt(squares / count);
    for (auto* s : {&mean, &above, &below}) s->x.push_back(at);
    mean.y.push_back(level), above.y.push_back(level + deviation), below.y.push_back(level - deviation);
    begin = end;
  }
  if (mean.x.size() > 1)
    for (auto* s : {&mean, &above, &below}) f.series.push_back(std::move(*s));
  return f;
}

Figure correlation_matrix(const std::string& title, Matrix correlation) {
  return {.title = title, .x = {.quantity = "correlation"}, .y = {}, .matrix = std::move(correlation)};
}

Figure confidence_ellipses(const std::string& title, const Axis& x, const Axis& y,
                           std::span<const Estimate> estimates) {
  Figure f{.title = title, .x = x, .y = y};
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    const Estimate& e = estimates[i];
    if (!e.samples.empty()) {
      Series s{.mark = Mark::points, .stroke = i};
      for (const auto& p : e.samples) s.x.push_back(p[0]), s.y.push_back(p[1]);
      f.series.push_back(std::move(s));
    }
    for (const double probability : {0.95, 0.99}) {
      // Quantile of the chi-squared distribution with 2 degrees of freedom, and of 2 F(2, n): both have closed forms.
      const double n = e.degrees_of_freedom,
                   radius = std::sqrt(n < 1e6 ? n * std::expm1(-2 / n * std::log1p(-probability))
                                              : -2 * std::log1p(-probability));
      Series s{.mark = probability < 0.99 ? Mark::area : Mark::reference,
               .label = probability < 0.99 ? e.label : "",
               .stroke = i};
      set_ellipse(s, e.mean, e.covariance, radius);
      f.series.push_back(std::move(s));
    }
  }
  return f;
}

Figure healthy_region(const std::string& title, const Axis& x, const Axis& y, const HealthyScatter& scatter) {
  Figure f{.title = title, .x = x, .y = y};
  Series inner{.mark = Mark::area, .label = fmt::format("{:g} sigma", scatter.inner_sigma), .stroke = 0},
      outer{.mark = Mark::reference, .label = fmt::format("{:g} sigma", scatter.outer_sigma), .stroke = 5};
  set_ellipse(inner, scatter.mean, scatter.covariance, scatter.inner_sigma);
  set_ellipse(outer, scatter.mean, scatter.covariance, scatter.outer_sigma);
  f.series = {std::move(inner), std::move(outer)};
  for (const auto& [label, points, shape, stroke] : {std::tuple{"learned", &scatter.learned, Shape::dot, 5},
                                                     {"healthy", &scatter.healthy, Shape::circle, 0},
                                                     {"anomalous", &scatter.anomalous, Shape::cross, 1}}) {
    if (points->empty()) continue;
    Series s{.mark = Mark::points, .label = label, .shape = shape, .stroke = static_cast<std::size_t>(stroke)};
    for (const auto& p : *points) s.x.push_back(p[0]), s.y.push_back(p[1]);
    f.series.push_back(std::move(s));
  }
  return f;
}

Figure hysteresis_loop(const std::string& title, const Axis& position, const Axis& torque,
                       std::span<const Loop> loops) {
  Figure f{.title = title, .x = position, .y = torque};
  for (const auto& loop : loops) f.series.push_back({.label = loop.label, .x = loop.position, .y = loop.torque});
  return f;
}

}  // namespace tribotwin::render
