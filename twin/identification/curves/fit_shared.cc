#include <algorithm>
#include <cmath>

#include <boost/math/tools/minima.hpp>
#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/curves/separable.hpp>

namespace tribotwin::twin::identification {

using Eigen::VectorXd;

Result<Shared> fit_shared(const friction::LawInfo& law, const Samples& samples, const std::string& parameter,
                          const FitOptions& options) {
  const auto found = std::ranges::find(law.parameters, parameter, &friction::Parameter::name);
  if (found == law.parameters.end())
    return tl::unexpected(fmt::format("law '{}' has no parameter '{}'", law.name, parameter));
  const auto shared = static_cast<std::size_t>(found - law.parameters.begin());
  std::vector<std::vector<std::size_t>> rows(samples.curves());
  for (std::size_t i = 0; i < samples.size(); ++i) rows[samples.curve[i]].push_back(i);
  const Placement place(law);
  std::size_t nonlinear = 0, linear = 0;
  for (std::size_t i = 0; i < law.parameters.size(); ++i) (place.is_linear(i) ? linear : nonlinear) += 1;
  std::vector<Samples> curves;
  Shared result;
  for (const auto& of_curve : rows) {
    if (of_curve.size() <= law.parameters.size()) continue;
    curves.push_back(samples.subset(of_curve));
    result.samples += of_curve.size();
  }
  result.curves = curves.size();
  if (curves.size() < rows.size())
    result.notes.push_back(
        fmt::format("{} curves with no more samples than parameters were left out", rows.size() - curves.size()));
  if (curves.empty())
    return tl::unexpected(
        fmt::format("no curve has more samples than law '{}' parameters ({})", law.name, law.parameters.size()));
  std::vector<Separable> problems;
  std::vector<VectorXd> at(curves.size());
  for (const Samples& curve : curves) {
    Separable& problem =
        problems.emplace_back(law, curve, options.weigh ? weights_of(curve) : std::vector<double>{}, 1u);
    for (const auto& [name, value] : options.fixed)
      if (const auto p = std::ranges::find(law.parameters, name, &friction::Parameter::name); p != law.parameters.end())
        problem.hold(static_cast<std::size_t>(p - law.parameters.begin()), value);
  }
  const auto cost = [&](double value) {
    double sum = 0;
    for (std::size_t c = 0; c < curves.size(); ++c) {
      problems[c].hold(shared, value);
      const Point p = at[c].size() ? problems[c].refine(at[c]) : problems[c].minimise();
      at[c] = p.values;
      sum += p.cost;
    }
    return sum;
  };
  const double low = std::max(found->minimum, 0.3), high = std::min(found->maximum, 4.0);
  const auto [best, min_cost] = boost::math::tools::brent_find_minima(cost, low, high, 14);
  result.value = best;
  // Curvature from a parabola wide enough for costs to differ clearly.
  const double h = 0.05 * best, curvature = (cost(best + h) - 2 * min_cost + cost(best - h)) / (h * h);
  const double freedom = static_cast<double>(result.samples) -
                         static_cast<double>(curves.size() * (law.parameters.size() - 1 - options.fixed.size())) - 1;
  result.sigma = std::sqrt(2 * min_cost / std::max(1.0, freedom) / curvature);
  for (int i = -8; i <= 8; ++i)
    if (const double v = best * (1 + 0.05 * i); v > low && v < high)
      result.profile.emplace_back(v, cost(v) / min_cost - 1);
  if (best < low * 1.01 || best > high * 0.99)
    result.notes.push_back(
        fmt::format("{} = {:.3g} is at the end of the searched range {} .. {}", parameter, best, low, high));
  return result;
}

}  // namespace tribotwin::twin::identification
