#include <algorithm>
#include <cmath>
#include <numbers>

#include <tribotwin/twin/identification/curves/direction.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

bool has_difference(const Samples& s, std::size_t i) { return !s.difference.empty() && std::isfinite(s.difference[i]); }

}  // namespace

bool has_both_directions(const Samples& s) {
  return std::ranges::any_of(s.difference, [](double d) { return std::isfinite(d); }) ||
         (std::ranges::find(s.direction, 1.0) != s.direction.end() &&
          std::ranges::find(s.direction, -1.0) != s.direction.end());
}

Samples by_direction(const Samples& s) {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < s.size(); ++i) rows.insert(rows.end(), has_difference(s, i) ? 2 : 1, i);
  const bool paired = rows.size() > s.size();
  Samples all = s.subset(rows);
  all.left_out = s.left_out;
  all.notes = s.notes;
  all.direction.resize(rows.size(), 0);
  all.difference.clear();
  // A level is the mean of both directions, whose errors are sqrt 2 times as large.
  if (paired && all.standard_error.empty()) all.standard_error.assign(rows.size(), 1);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (!has_difference(s, rows[k])) continue;
    const double sign = k > 0 && rows[k - 1] == rows[k] ? -1 : 1;
    all.direction[k] = sign;
    all.friction[k] += sign * s.difference[rows[k]];
    all.standard_error[k] *= std::numbers::sqrt2;
  }
  return all;
}

std::vector<double> residuals(const Samples& rows, const Placement& place, const friction::GeneralLaw& general_law,
                              const Direction& direction, unsigned threads) {
  Samples seen = rows;
  std::vector<double> unused;
  make_symmetric(rows, {}, direction, seen, unused);
  std::vector<double> r = residuals(seen, place, general_law, threads);
  for (std::size_t i = 0; i < r.size(); ++i) r[i] *= direction.factor(rows.direction[i]);
  return r;
}

void make_symmetric(const Samples& rows, const std::vector<double>& weights, const Direction& direction, Samples& seen,
                    std::vector<double>& seen_weights) {
  seen_weights.resize(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double s = rows.direction[i], factor = direction.factor(s);
    seen.friction[i] = (rows.friction[i] - direction.offset * s) / factor;
    seen_weights[i] = (weights.empty() ? 1 : weights[i]) * factor * factor;
  }
}

DirectionMoments direction_moments(const Samples& rows, const std::vector<double>& weights, const Direction& direction,
                                   const Placement& place, const Point& point,
                                   const std::vector<std::size_t>& coordinates) {
  const auto count = static_cast<Index>(coordinates.size());
  const Index free = direction.asymmetry_free + direction.offset_free;
  DirectionMoments m{
      .own = MatrixXd::Zero(free, free), .cross = MatrixXd::Zero(count, free), .slope = VectorXd::Zero(free)};
  // The law's derivatives by the numbers of the general law; the chain to the coordinates follows once, at the end.
  const auto linear = static_cast<Index>(place.linear_used.size()),
             nonlinear = static_cast<Index>(place.nonlinear_used.size());
  MatrixXd cross = MatrixXd::Zero(linear + nonlinear, free);
  VectorXd by_numbers(linear + nonlinear), extra(free);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto g = friction::gradient(point.general_law, rows.speed[i], rows.load[i], rows.temperature_degC[i]);
    const double s = rows.direction[i], factor = direction.factor(s), w = weights.empty() ? 1 : weights[i];
    for (Index k = 0; k < linear; ++k) by_numbers(k) = g.by_terms[place.linear_used[k]];
    for (Index k = 0; k < nonlinear; ++k) by_numbers(linear + k) = g.by_shape_numbers[place.nonlinear_used[k]];
    if (direction.asymmetry_free) extra(0) = s * g.torque;
    if (direction.offset_free) extra(free - 1) = s;
    m.own += w * extra * extra.transpose();
    m.slope += w * (rows.friction[i] - direction.offset * s - factor * g.torque) * extra;
    cross += w * factor * by_numbers * extra.transpose();
  }
  MatrixXd chain(linear + nonlinear, count);
  chain << place.linear(Eigen::all, coordinates), place.nonlinear(Eigen::all, coordinates);
  m.cross = chain.transpose() * cross;
  return m;
}

}  // namespace tribotwin::twin::identification
