#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/curves/identifiability.hpp>

namespace tribotwin::twin::identification {

namespace {

using Eigen::Index;

/// The samples at the temperature that has the most loads, their temperatures replaced by the mean.
struct Isothermal {
  Samples samples;
  double temperature_degC;
  std::size_t loads;
};
Isothermal most_loads(const Samples& samples) {
  std::map<long, std::vector<std::size_t>> by_temperature;
  for (std::size_t i = 0; i < samples.size(); ++i)
    by_temperature[std::lround(5 * samples.temperature_degC[i])].push_back(i);
  const std::vector<std::size_t>* best = nullptr;
  std::size_t loads = 0;
  for (const auto& [T, rows] : by_temperature) {
    std::set<long> levels;
    for (const std::size_t i : rows) levels.insert(std::lround(samples.load[i] * 1000));
    if (levels.size() > loads) loads = levels.size(), best = &rows;
  }
  if (!best) return {};
  Samples still = samples.subset(*best);
  const double mean = std::accumulate(still.temperature_degC.begin(), still.temperature_degC.end(), 0.0) /
                      static_cast<double>(still.size());
  std::ranges::fill(still.temperature_degC, mean);
  return {std::move(still), mean, loads};
}

}  // namespace

Result<Fit> fit_staged(const friction::LawInfo& law, const Samples& samples, const FitOptions& options) {
  if (!law.load_dependent || !law.temperature_dependent)
    return tl::unexpected(fmt::format(
        "law '{}' does not depend on both load and temperature: there are no stages to identify it in", law.name));
  const auto [still, mean, loads] = most_loads(samples);
  if (loads < 3)
    return tl::unexpected(
        fmt::format("no temperature was measured at three loads or more (at most {}): the load terms cannot be found "
                    "first; fit all at once",
                    loads));
  const auto first = fit(law, still, options);
  if (!first) return tl::unexpected("load terms: " + first.error().message);
  const Placement place(law);
  FitOptions rest = options;
  std::vector<std::size_t> load_terms;
  for (std::size_t i = 0; i < law.parameters.size(); ++i)
    if (moves_load_terms_only(place, i) && first->parameters[i].status == Status::estimated) {
      load_terms.push_back(i);
      rest.fixed.emplace_back(law.parameters[i].name, first->parameters[i].value);
    }
  auto result = fit(law, samples, rest);
  if (!result) return result;
  for (const std::size_t i : load_terms) {
    result->parameters[i] = first->parameters[i];
    for (const std::size_t j : load_terms)
      result->covariance(static_cast<Index>(i), static_cast<Index>(j)) =
          first->covariance(static_cast<Index>(i), static_cast<Index>(j));
  }
  result->estimated += load_terms.size();
  result->notes.insert(result->notes.begin(),
                       fmt::format("in stages: the load terms from {} samples at {:.1f} degC and {} loads, the rest "
                                   "from all; the sigmas of the rest take the load terms as known",
                                   still.size(), mean, loads));
  return result;
}

}  // namespace tribotwin::twin::identification
