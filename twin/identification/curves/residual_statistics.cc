#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/residual_statistics.hpp>
#include <tribotwin/twin/identification/curves/robust.hpp>

namespace tribotwin::twin::identification {
namespace {

/// Notes how many samples lie more than 5 sigma off the curve, if they are too many for noise.
void note_outliers(const std::vector<double>& r, const std::vector<double>& base, double scale, Loss loss,
                   Estimates& result) {
  const auto n = static_cast<double>(r.size());
  std::size_t far = 0;
  for (std::size_t i = 0; i < r.size(); ++i)
    far += std::abs(r[i]) * (base.empty() ? 1 : std::sqrt(base[i])) > 5 * scale;
  if (scale > 1e-9 * result.residual.max_abs && static_cast<double>(far) > 0.005 * n + 1)
    result.notes.push_back(
        loss == Loss::squares
            ? fmt::format("{:.1f} % of the samples lie more than 5 sigma off the curve: outliers distort this fit; a "
                          "robust loss (--robust cauchy) reduces their effect",
                          100 * static_cast<double>(far) / n)
            : fmt::format("{:.1f} % of the samples lie more than 5 sigma off the curve and have almost no weight",
                          100 * static_cast<double>(far) / n));
}

/// Share of the variance that the law explains, and Akaike's criterion corrected for few samples.
void judge_fit(const Samples& samples, const std::vector<double>& r, const std::vector<double>& base,
               Estimates& result) {
  double mean = 0, weight_sum = 0, spread = 0, squares = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const double w = base.empty() ? 1 : base[i];
    mean += w * samples.friction[i], weight_sum += w;
  }
  mean /= weight_sum;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const double w = base.empty() ? 1 : base[i];
    spread += w * std::pow(samples.friction[i] - mean, 2), squares += w * r[i] * r[i];
  }
  result.r_squared = spread > 0 ? 1 - squares / spread : 0;
  const double n = static_cast<double>(samples.size()),
               p = static_cast<double>(result.estimated) + 1;  // the variance is one
  result.aicc = n * std::log(std::max(squares, 1e-300) / n) + 2 * p +
                (n - p - 1 > 0 ? 2 * p * (p + 1) / (n - p - 1) : std::numeric_limits<double>::quiet_NaN());
}

}  // namespace

void describe_residuals(const Samples& samples, const std::vector<double>& r, const std::vector<double>& base,
                        Loss loss, const std::optional<Misfit>& misfit, Estimates& result) {
  const auto n = static_cast<double>(r.size());
  const double mean = std::reduce(r.begin(), r.end()) / n;
  double squares = 0;
  for (const double x : r)
    squares += (x - mean) * (x - mean), result.residual.max_abs = std::max(result.residual.max_abs, std::abs(x));
  result.residual.mean = mean;
  result.residual.std = std::sqrt(squares / n);
  judge_fit(samples, r, base, result);
  const double scale = robust_scale(r, base);
  note_outliers(r, base, scale, loss, result);
  result.residual.arcs = misfit ? misfit->share : 0;
  if (misfit)
    result.notes.push_back(
        fmt::format("{:.0f} % of the residuals' mean square are arcs along {}, no noise: the law does not follow these "
                    "data; sigmas count the arcs; compare other laws with --law A,B",
                    100 * misfit->share, misfit->along));
  std::set<double> speeds;
  for (std::size_t i = 0; i < samples.size() && speeds.size() < 5; ++i) speeds.insert(samples.speed[i]);
  if (speeds.size() > 4 && result.r_squared < 0.5)
    result.notes.push_back(fmt::format(
        "the law explains only {:.0f} % of how friction varies in these data: are the columns what their names say?",
        100 * std::max(0.0, result.r_squared)));
}

}  // namespace tribotwin::twin::identification
