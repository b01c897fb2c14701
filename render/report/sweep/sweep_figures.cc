#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <string_view>
#include <tuple>
#include <utility>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/report/sweep/sweep_figures.hpp>

namespace tribotwin::render {
namespace {

constexpr double no_value = std::numeric_limits<double>::quiet_NaN();

std::string last_words(const std::string& key) {
  const auto dot = key.rfind('.');
  return dot == key.npos ? key : key.substr(dot + 1);
}

std::string percent_text(double probability) { return fmt::format("{:g} %", 100 * probability); }

/// The runs that have both factors and the output.
struct Sampled {
  std::vector<double> x, y, z;
};
Sampled sampled(const SweepView& view, std::size_t output, std::size_t key, std::size_t other) {
  Sampled s;
  const auto z = view.shown(output);
  for (std::size_t r = 0; r < z.size(); ++r)
    if (std::isfinite(z[r]) && std::isfinite(view.factors[key][r]) && std::isfinite(view.factors[other][r]))
      s.x.push_back(view.factors[key][r]), s.y.push_back(view.factors[other][r]), s.z.push_back(z[r]);
  return s;
}

bool varies(const std::vector<double>& values) {
  return !values.empty() && std::ranges::min(values) < std::ranges::max(values);
}

/// The levels of a key: numbers ascending, or words as they come.
std::vector<std::string> levels_of(const SweepView& view, std::size_t key) {
  std::vector<std::string> levels;
  std::set<std::string_view> known;
  for (const auto& run : view.sweep.runs)
    if (known.insert(run.values[key]).second) levels.push_back(run.values[key]);
  const auto number = [](const std::string& text) { return to_number(text).value_or(no_value); };
  if (std::ranges::none_of(levels, [&](const auto& level) { return std::isnan(number(level)); }))
    std::ranges::sort(levels, {}, number);
  return levels;
}

Axis colour_axis(const Quantity& quantity, const std::vector<double>& values) {
  Axis axis = quantity.axis();
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const double v : values)
    if (std::isfinite(v)) low = std::min(low, v), high = std::max(high, v);
  if (!(low < high)) low -= 0.5, high += 0.5;
  axis.from = low, axis.to = high;
  return axis;
}

std::optional<Drawing> grid_map(const SweepView& view, std::size_t output, std::size_t key, std::size_t other) {
  HeatMap map{.columns = levels_of(view, key), .rows = levels_of(view, other), .values = {}};
  if (map.columns.size() < 2 || map.rows.size() < 2) return {};
  if (!std::isnan(view.factors[other][0])) std::ranges::reverse(map.rows);
  const auto shown = view.shown(output);
  std::size_t most = 0;
  std::vector<double> all;
  std::map<std::pair<std::string_view, std::string_view>, std::pair<double, std::size_t>> cells;  // sum, count
  for (std::size_t r = 0; r < shown.size(); ++r)
    if (std::isfinite(shown[r])) {
      auto& cell = cells[{view.sweep.runs[r].values[key], view.sweep.runs[r].values[other]}];
      cell.first += shown[r], ++cell.second;
    }
  for (const auto& row : map.rows) {
    auto& values = map.values.emplace_back();
    for (const auto& column : map.columns) {
      const auto found = cells.find({column, row});
      const double sum = found == cells.end() ? 0 : found->second.first;
      const std::size_t count = found == cells.end() ? 0 : found->second.second;
      values.push_back(count ? sum / static_cast<double>(count) : no_value);
      all.push_back(values.back());
      most = std::max(most, count);
    }
  }
  if (most == 0) return {};
  Figure f{.title = fmt::format("{}: {} and {}", view.quantities[output].name, last_words(view.sweep.keys[key]),
                                last_words(view.sweep.keys[other])),
           .x = view.axis_of_key(key),
           .y = view.axis_of_key(other),
           .colour = colour_axis(view.quantities[output], all)};
  const double span = *f.colour->to - *f.colour->from;
  map.decimals = static_cast<int>(std::clamp(2 - std::floor(std::log10(span)), 0.0, 6.0));
  f.heat_map = std::move(map);
  std::string caption = most > 1 ? fmt::format("Each cell: the mean over the other factors, of up to {} runs.", most)
                                 : "Each cell is one run.";
  if (std::ranges::any_of(all, [](double v) { return std::isnan(v); })) caption += " Grey: no run has a value there.";
  return Drawing{std::move(f), std::move(caption)};
}

}  // namespace

double Effect::size() const { return std::abs(number_in(value["value"])); }

SweepView::SweepView(const twin::sweep::StoredSweep& stored) : sweep(stored) {
  factors.resize(sweep.keys.size());
  outputs.resize(sweep.outputs.size());
  for (const auto& run : sweep.runs) {
    for (std::size_t k = 0; k < factors.size(); ++k) factors[k].push_back(to_number(run.values[k]).value_or(no_value));
    for (std::size_t o = 0; o < outputs.size(); ++o) outputs[o].push_back(run.outputs[o]);
  }
  for (std::size_t o = 0; o < outputs.size(); ++o) {
    const auto& [name, expression] = std::tie(sweep.outputs[o].name, sweep.outputs[o].expression);
    quantities.emplace_back(name == expression ? in_words(name) : name, unit_in(expression), outputs[o]);
  }
}

const nlohmann::json& SweepView::statistics(std::size_t output) const {
  static const nlohmann::json none = nlohmann::json::object();
  const auto& all = sweep.statistics["outputs"];
  return all.contains(sweep.outputs[output].name) ? all[sweep.outputs[output].name] : none;
}

bool SweepView::has_indices(std::size_t output) const {
  const auto& s = statistics(output);
  return s.contains("sobol_indices") &&
         std::ranges::any_of(s["sobol_indices"], [](const nlohmann::json& x) { return x.is_object(); });
}

std::vector<Effect> SweepView::effects(std::size_t output) const {
  std::vector<Effect> all;
  const bool indices = has_indices(output);
  const auto& s = statistics(output);
  if (!indices && !s.contains("rank_correlations")) return all;
  for (const auto& [name, one] : s[indices ? "sobol_indices" : "rank_correlations"].items()) {
    Effect e{.name = name, .value = indices ? one.value("total", nlohmann::json()) : one, .first = {}};
    if (indices && one.is_object()) e.first = one["first"];
    if (e.value.is_object() && std::isfinite(number_in(e.value["value"]))) all.push_back(std::move(e));
  }
  std::ranges::stable_sort(all, std::greater{}, &Effect::size);
  return all;
}

std::vector<std::size_t> SweepView::leading(std::size_t output) const {
  std::vector<std::pair<double, std::size_t>> found;
  const auto& s = statistics(output);
  for (std::size_t k = 0; k < sweep.keys.size(); ++k) {
    if (levels_of(*this, k).size() < 2) continue;
    double size = 0;
    for (const char* of : {"rank_correlations", "sobol_indices"}) {
      if (!s.contains(of) || !s[of].contains(sweep.keys[k]) || !s[of][sweep.keys[k]].is_object()) continue;
      const auto& one = s[of][sweep.keys[k]];
      size = std::abs(number_in(one.contains("total") ? one["total"]["value"] : one["value"]));
    }
    found.emplace_back(std::isfinite(size) ? size : 0, k);
  }
  std::ranges::stable_sort(found, std::greater{}, [](const auto& x) { return x.first; });
  std::vector<std::size_t> keys;
  for (const auto& [size, key] : found) keys.push_back(key);
  return keys;
}

Axis SweepView::axis_of_key(std::size_t key) const {
  return {.quantity = sweep.keys[key], .unit = unit_of_key(sweep.keys[key])};
}

std::vector<double> SweepView::shown(std::size_t output) const {
  std::vector<double> values = outputs[output];
  for (double& v : values) v *= quantities[output].factor;
  return values;
}

Drawing importance(const SweepView& view, std::size_t output) {
  const bool indices = view.has_indices(output);
  const auto all = view.effects(output);
  const std::size_t count = std::min(all.size(), ranked_effects);
  Ranking ranking{.names = {}, .bars = {{.label = indices ? "total" : "", .values = {}, .low = {}, .high = {}}}};
  if (indices) ranking.bars.push_back({.label = "first order", .values = {}, .low = {}, .high = {}});
  bool intervals = false;
  for (std::size_t i = 0; i < count; ++i) {
    ranking.names.push_back(all[i].name);
    for (std::size_t b = 0; b < ranking.bars.size(); ++b) {
      const auto& estimate = b ? all[i].first : all[i].value;
      const Limits limits = limits_in(estimate);
      intervals |= limits.there();
      ranking.bars[b].values.push_back(number_in(estimate["value"]));
      ranking.bars[b].low.push_back(limits.low), ranking.bars[b].high.push_back(limits.high);
    }
  }
  Figure f{
      .title = view.quantities[output].name, .x = {.quantity = indices ? "Sobol' index" : "rank correlation"}, .y = {}};
  if (!indices) f.x.from = -1, f.x.to = 1;
  f.ranking = std::move(ranking);
  std::string caption =
      indices ? "Share of the variance that a factor causes: alone (first order), and with all its interactions "
                "(total)."
              : "Spearman's rank correlation: +1 where the output always rises with the factor, -1 where it always "
                "falls; a factor whose effect turns around shows less than it does.";
  caption += intervals ? " Whiskers: 95 % intervals." : " Without intervals: a grid is no sample.";
  if (all.size() > count) caption += fmt::format(" The {} largest of {}.", count, all.size());
  return {std::move(f), std::move(caption)};
}

Drawing distribution_of(const SweepView& view, std::size_t output) {
  const Quantity& q = view.quantities[output];
  const auto& s = view.statistics(output);
  std::vector<double> values;
  for (std::size_t r = 0; r < view.sweep.runs.size(); ++r)
    if (view.sweep.runs[r].counts) values.push_back(q.factor * view.outputs[output][r]);
  std::vector<Marked> marked;
  std::string others;
  for (const auto& quantile : s["quantiles"]) {
    const double p = number_in(quantile["probability"]);
    if (p == 0.5) continue;
    others += (others.empty() ? "" : ", ") + percent_text(p);
  }
  for (const auto& quantile : s["quantiles"]) {
    const double at = q.factor * number_in(quantile["value"]);
    marked.push_back({number_in(quantile["probability"]) == 0.5 ? "median" : "quantiles", at});
  }
  const Limits mean = limits_in(s["mean"]);
  Drawing d{distribution(q.name, q.axis(), values, marked, "mean, 95 %", q.factor * mean.low, q.factor * mean.high),
            ""};
  d.caption = fmt::format("Mean {}.", q.estimated(s["mean"]));
  if (s.contains("deviation")) d.caption += fmt::format(" Standard deviation {}.", q.estimated(s["deviation"], true));
  if (!others.empty()) d.caption += fmt::format(" Quantiles: {}.", others);
  return d;
}

std::optional<Drawing> over_factor(const SweepView& view, std::size_t output, std::size_t key) {
  const auto shown = view.shown(output);
  std::size_t both = 0;
  for (std::size_t r = 0; r < shown.size(); ++r) both += std::isfinite(shown[r]) && std::isfinite(view.factors[key][r]);
  if (both < 2) return {};
  const auto& q = view.quantities[output];
  Drawing d{scatter(fmt::format("{} over {}", q.name, last_words(view.sweep.keys[key])), view.axis_of_key(key),
                    q.axis(), view.factors[key], shown),
            fmt::format("{} runs; the other factors vary as well.", both)};
  if (both > scatter_points)
    d.caption = fmt::format("{} of {} runs; the other factors vary as well.", scatter_points, both);
  if (d.figure.series.size() > 1) d.caption += " Lines: mean and standard deviation of classes of 30 runs or more.";
  if (both <= 100) d.figure.series[0].shape = Shape::circle;
  return d;
}

std::optional<Drawing> over_two(const SweepView& view, std::size_t output, std::size_t key, std::size_t other) {
  if (view.sweep.design == "grid") return grid_map(view, output, key, other);
  const Sampled s = sampled(view, output, key, other);
  if (s.z.size() < 2 || !varies(s.z)) return {};
  const Quantity& q = view.quantities[output];
  Figure f{.title = fmt::format("{}: {} and {}", q.name, last_words(view.sweep.keys[key]),
                                last_words(view.sweep.keys[other])),
           .x = view.axis_of_key(key),
           .y = view.axis_of_key(other),
           .colour = colour_axis(q, s.z)};
  Series points{.mark = Mark::points, .x = s.x, .y = s.y, .error = {}, .shade = s.z, .shape = Shape::disc};
  if (s.z.size() > 300) points.shape = Shape::dot;
  f.series.push_back(std::move(points));
  return Drawing{std::move(f), fmt::format("Each of {} runs, coloured by the output.", s.z.size())};
}

std::optional<Drawing> surface_over(const SweepView& view, std::size_t output, std::size_t key, std::size_t other) {
  const Sampled s = sampled(view, output, key, other);
  const auto n = static_cast<Eigen::Index>(s.z.size());
  if (view.sweep.design == "grid" || n < 12 || !varies(s.x) || !varies(s.y) || !varies(s.z)) return {};
  const auto x_ends = std::ranges::minmax(s.x), y_ends = std::ranges::minmax(s.y);
  const double x_low = x_ends.min, x_high = x_ends.max, y_low = y_ends.min, y_high = y_ends.max;
  const auto terms = [&](double x, double y) {
    const double a = 2 * (x - x_low) / (x_high - x_low) - 1, b = 2 * (y - y_low) / (y_high - y_low) - 1;
    return Eigen::Vector<double, 6>{1, a, b, a * a, a * b, b * b};
  };
  Eigen::MatrixXd design(n, 6);
  Eigen::VectorXd z(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    design.row(i) = terms(s.x[k], s.y[k]);
    z(i) = s.z[k];
  }
  const Eigen::VectorXd fitted = design.colPivHouseholderQr().solve(z);
  const double left = (z - design * fitted).squaredNorm() / static_cast<double>(n - 6),
               whole = (z.array() - z.mean()).matrix().squaredNorm() / static_cast<double>(n - 1);
  const double explained = 1 - left / whole;
  if (!(explained >= 0.5)) return {};
  Surface surface{.x = evenly(x_low, x_high, 30), .y = evenly(y_low, y_high, 30), .z = {}};
  double lowest = 0;
  for (const double y : surface.y) {
    auto& row = surface.z.emplace_back();
    for (const double x : surface.x) row.push_back(terms(x, y).dot(fitted));
    lowest = std::min(lowest, std::ranges::min(row));
  }
  // Times and heats well below zero: it is no quadratic.
  if (z.minCoeff() >= 0 && lowest < -0.05 * (z.maxCoeff() - z.minCoeff())) return {};
  const Quantity& q = view.quantities[output];
  Figure f{.title = fmt::format("{}, quadratic", q.name),
           .x = view.axis_of_key(key),
           .y = view.axis_of_key(other),
           .z = q.axis(),
           .surface = std::move(surface)};
  f.x.quantity = last_words(f.x.quantity), f.y.quantity = last_words(f.y.quantity);
  const double deviation = std::sqrt(left);
  const std::string rest = deviation < 1e-12 * z.cwiseAbs().maxCoeff()
                               ? "nothing but rounding"
                               : fmt::format(
                                     "a standard deviation of {}, of the other factors and of what is not "
                                     "quadratic",
                                     q.difference(deviation / q.factor, deviation / q.factor));
  return Drawing{std::move(f),
                 fmt::format("A quadratic in both factors, fitted to {} runs: it explains {} of the variance "
                             "(adjusted) and leaves {}.",
                             n, explained > 0.99 ? "more than 99 %" : fmt::format("{:.0f} %", 100 * explained), rest)};
}

std::optional<Drawing> band_over_time(const SweepView& view, std::size_t index) {
  const auto& sweep = view.sweep;
  const auto& band = sweep.bands[index];
  std::vector<std::size_t> known;
  double end = 0;
  for (std::size_t t = 0; t < sweep.times_s.size(); ++t)
    if (band.runs[t] > 0) known.push_back(t), end = sweep.times_s[t];
  if (known.size() < 2) return {};
  const auto [unit, seconds] = end > 7200  ? std::pair{"h", 3600.0}
                               : end > 180 ? std::pair{"min", 60.0}
                                           : std::pair{"s", 1.0};
  const auto quantile_at = [&](std::size_t q, double factor) {
    std::vector<double> values;
    for (const std::size_t t : known) values.push_back(factor * band.quantiles[q][t]);
    return values;
  };
  std::vector<double> all;
  for (const auto& values : band.quantiles)
    for (const std::size_t t : known) all.push_back(values[t]);
  const Quantity q(band.signal, unit_in(band.signal), all);
  Figure f{.title = band.signal, .x = {.quantity = "time", .symbol = "{/:Italic t}", .unit = unit}, .y = q.axis()};
  std::vector<double> time;
  for (const std::size_t t : known) time.push_back(sweep.times_s[t] / seconds);
  const std::size_t count = sweep.probabilities.size();
  for (std::size_t i = 0; i < count / 2; ++i) {
    const std::size_t mirror = count - 1 - i;
    Series area{.mark = Mark::area,
                .label = fmt::format("{} … {}", percent_text(sweep.probabilities[i]),
                                     percent_text(sweep.probabilities[mirror])),
                .x = time,
                .y = quantile_at(i, q.factor),
                .stroke = 0};
    const auto upper = quantile_at(mirror, q.factor);
    area.x.insert(area.x.end(), time.rbegin(), time.rend());
    area.y.insert(area.y.end(), upper.rbegin(), upper.rend());
    f.series.push_back(std::move(area));
  }
  if (count % 2)
    f.series.push_back(
        {.mark = Mark::line,
         .label = sweep.probabilities[count / 2] == 0.5 ? "median" : percent_text(sweep.probabilities[count / 2]),
         .x = time,
         .y = quantile_at(count / 2, q.factor),
         .stroke = 1});
  const auto [fewest, most] = std::ranges::minmax(band.runs);
  std::string caption =
      fmt::format("Quantiles over {} runs at each of {} times; a band is no run: none needs to stay at one quantile.",
                  fewest == most ? fmt::format("{:g}", most) : fmt::format("{:g} to {:g}", fewest, most), known.size());
  return Drawing{std::move(f), std::move(caption)};
}

}  // namespace tribotwin::render
