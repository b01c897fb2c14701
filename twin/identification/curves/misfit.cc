#include <algorithm>
#include <cmath>
#include <numeric>

#include <tribotwin/twin/identification/curves/misfit.hpp>
#include <tribotwin/twin/numerics/correlated_noise.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Samples in the order of one axis.
struct Axis {
  std::string_view name;
  std::vector<Index> order;
  std::vector<double> at;       ///< ascending within a series
  std::vector<Index> first{0};  ///< of each series
  double extent = 0;            ///< of the longest series
};

Axis axis_of(std::string_view name, const std::vector<double>& value, const std::vector<std::uint32_t>* curve) {
  Axis axis{.name = name, .order = std::vector<Index>(value.size()), .at = {}};
  std::iota(axis.order.begin(), axis.order.end(), Index{0});
  const auto series = [&](Index i) { return curve ? (*curve)[static_cast<std::size_t>(i)] : 0u; };
  std::ranges::stable_sort(axis.order, {},
                           [&](Index i) { return std::pair(series(i), value[static_cast<std::size_t>(i)]); });
  for (std::size_t k = 0; k < axis.order.size(); ++k) {
    axis.at.push_back(value[static_cast<std::size_t>(axis.order[k])]);
    if (k > 0 && series(axis.order[k]) != series(axis.order[k - 1])) axis.first.push_back(static_cast<Index>(k));
    axis.extent = std::max(axis.extent, axis.at.back() - axis.at[static_cast<std::size_t>(axis.first.back())]);
  }
  return axis;
}

std::vector<Axis> axes_of(const Samples& s) {
  std::vector<double> log_speed(s.size());
  std::ranges::transform(s.speed, log_speed.begin(), [](double v) { return std::log(std::max(v, 1e-12)); });
  std::vector<Axis> axes{axis_of("speed", log_speed, nullptr), axis_of("load", s.load, nullptr),
                         axis_of("temperature", s.temperature_degC, nullptr)};
  if (s.curves() > 1) axes.push_back(axis_of("speed, differently in each curve", log_speed, &s.curve));
  std::erase_if(axes, [](const Axis& a) { return !(a.extent > 1e-6 * (1 + std::abs(a.at.back()))); });
  return axes;
}

/// Correlation of neighbours, by pairs.
double neighbours(const Axis& axis, const VectorXd& r) {
  double products = 0, squares = 0;
  for (std::size_t k = 1; k < axis.order.size(); ++k)
    products += r(axis.order[k]) * r(axis.order[k - 1]), squares += r(axis.order[k]) * r(axis.order[k]);
  return squares > 0 ? products / squares : 0;
}

/// Probability that noise makes the means of bins vary as much. Equal values are in one bin.
double chance_of_means(const Axis& axis, const VectorXd& r, std::size_t per_bin) {
  double between = 0, all = 0, sum = 0, count = 0, bins = 0;
  const std::size_t n = axis.order.size();
  for (std::size_t k = 0; k < n; ++k) {
    sum += r(axis.order[k]), ++count, all += r(axis.order[k]) * r(axis.order[k]);
    const bool last = k + 1 == n;
    if (!last && (count < static_cast<double>(per_bin) || axis.at[k + 1] == axis.at[k])) continue;
    between += sum * sum / count, ++bins, sum = count = 0;
  }
  const double below = static_cast<double>(n) - bins;
  if (below < 1 || !(all > between)) return 1;
  return fisher_f_above(bins, below, between / bins / ((all - between) / below));
}

/// Whether it is worth looking for arcs: what noise does once in a thousand times.
bool suspicious(const Axis& axis, const VectorXd& r) {
  constexpr std::size_t bins = 24, fewest = 8;
  const auto n = static_cast<double>(r.size());
  if (neighbours(axis, r) > 3 / std::sqrt(n)) return true;
  return axis.first.size() == 1 && axis.order.size() >= bins * fewest &&
         chance_of_means(axis, r, axis.order.size() / bins) < 1e-3;
}

/// Rows `every` apart of the axis' order, or all.
struct Rows {
  VectorXd residual;
  MatrixXd jacobian;
  std::vector<double> at;
  std::vector<Index> first;
};
Rows rows_of(const Axis& axis, const VectorXd& r, const MatrixXd& J, std::size_t every) {
  std::vector<Index> kept;
  Rows rows;
  std::size_t series = 0;
  for (std::size_t k = 0; k < axis.order.size(); k += every) {
    while (series < axis.first.size() && static_cast<std::size_t>(axis.first[series]) <= k) {
      if (rows.first.empty() || rows.first.back() != static_cast<Index>(kept.size()))
        rows.first.push_back(static_cast<Index>(kept.size()));
      ++series;
    }
    kept.push_back(axis.order[k]), rows.at.push_back(axis.at[k]);
  }
  rows.residual = r(kept), rows.jacobian = J(kept, Eigen::all);
  return rows;
}

double size_of(const MatrixXd& covariance) { return covariance.diagonal().cwiseMax(1e-300).array().log().sum(); }

}  // namespace

std::optional<Misfit> misfit_of(const Samples& samples, const VectorXd& residual, const MatrixXd& jacobian) {
  constexpr Index fewest = 8, enough = 3000;
  std::optional<Misfit> worst;
  if (jacobian.cols() == 0 || residual.size() < jacobian.cols() + fewest) return worst;
  for (const Axis& axis : axes_of(samples)) {
    if (!suspicious(axis, residual)) continue;
    const Rows some = rows_of(axis, residual, jacobian, static_cast<std::size_t>(1 + residual.size() / enough));
    const CorrelatedNoise noise =
        correlated_noise(some.residual, some.jacobian, {.time_s = some.at, .first = some.first});
    const double share = noise.slow * noise.slow / std::max(1e-300, noise.variance());
    if (noise.correlation_s <= 0) continue;
    const Rows all = rows_of(axis, residual, jacobian, 1);
    Misfit found{.along = axis.name,
                 .share = share,
                 .freedom = std::max(3.0, axis.extent / (2 * noise.correlation_s)),
                 .covariance = least_squares_covariance(all.jacobian, noise, {.time_s = all.at, .first = all.first})};
    // Arcs that curves share weigh more than as many in each by itself: the larger variances hold in both cases.
    if (!worst || size_of(found.covariance) > size_of(worst->covariance)) worst = std::move(found);
  }
  return worst;
}

}  // namespace tribotwin::twin::identification
