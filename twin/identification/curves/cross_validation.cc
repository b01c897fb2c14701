#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/direction.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>

namespace tribotwin::twin::identification {
namespace {

/// Where directions differ, those of each direction.
std::vector<double> residuals_of(const Fit& fit, const Samples& samples, unsigned threads) {
  const Placement place(*fit.law.info);
  if (fit.asymmetry == 0 && fit.offset == 0) return residuals(samples, place, fit.law.general_law, threads);
  return residuals(by_direction(samples), place, fit.law.general_law,
                   {.asymmetry = fit.asymmetry, .offset = fit.offset}, threads);
}

bool has_term(const Placement& place, const friction::formula::Term& term) {
  namespace formula = friction::formula;
  return std::ranges::any_of(place.linear_used, [&](std::size_t k) {
    const auto& own = formula::terms[k];
    const bool shape = own.shape == term.shape || (own.shape == formula::power && term.shape == formula::linear);
    return shape && own.heat == term.heat && own.load == term.load;
  });
}

}  // namespace

bool contains(const friction::LawInfo& wide, const friction::LawInfo& narrow) {
  if (&wide == &narrow) return false;
  const Placement w(wide), n(narrow);
  return std::ranges::all_of(n.linear_used, [&](std::size_t k) { return has_term(w, friction::formula::terms[k]); }) &&
         std::ranges::all_of(n.nonlinear_used, [&](std::size_t k) {
           return std::ranges::find(w.nonlinear_used, k) != w.nonlinear_used.end();
         });
}

bool worse(const HeldOutErrors& wide, const HeldOutErrors& narrow) {
  const std::size_t count = wide.mean_squares.size();
  if (count < 2 || narrow.mean_squares.size() != count) return false;
  const auto n = static_cast<double>(count);
  double mean = 0, squares = 0;
  for (std::size_t i = 0; i < count; ++i) mean += (wide.mean_squares[i] - narrow.mean_squares[i]) / n;
  for (std::size_t i = 0; i < count; ++i) squares += std::pow(wide.mean_squares[i] - narrow.mean_squares[i] - mean, 2);
  return mean > 2 * std::sqrt(squares / (n - 1) / n);
}

Result<HeldOutErrors> cross_validate(const friction::LawInfo& law, const Samples& samples, const FitOptions& options,
                                     unsigned folds) {
  const bool by_curve = samples.curves() >= folds;
  const std::size_t parts = samples.curves() >= 5 ? samples.curves() : std::min<std::size_t>(10, samples.size());
  std::vector<double> sum(parts), count(parts);
  for (unsigned fold = 0; fold < folds; ++fold) {
    std::vector<std::size_t> learn, test;
    for (std::size_t i = 0; i < samples.size(); ++i)
      ((by_curve ? samples.curve[i] : i) % folds == fold ? test : learn).push_back(i);
    if (learn.empty() || test.empty())
      return tl::unexpected(fmt::format("{} samples are too few for {} folds", samples.size(), folds));
    const Samples learned = samples.subset(learn), tested = samples.subset(test);
    const auto found = fit(law, learned, options);
    if (!found) return tl::unexpected(fmt::format("without fold {}: {}", fold + 1, found.error().message));
    const std::vector<double> errors = residuals_of(*found, tested, options.threads);
    // Levels of both directions whose difference is known have two errors.
    for (std::size_t k = 0; k < errors.size(); ++k) {
      const std::size_t i = test[k * test.size() / errors.size()];
      const std::size_t part = parts == samples.curves() ? samples.curve[i] : i * parts / samples.size();
      sum[part] += errors[k] * errors[k], ++count[part];
    }
  }
  HeldOutErrors out{.rms = std::sqrt(std::reduce(sum.begin(), sum.end()) / std::reduce(count.begin(), count.end())),
                    .mean_squares = {}};
  for (std::size_t p = 0; p < parts; ++p)
    if (count[p] > 0) out.mean_squares.push_back(sum[p] / count[p]);
  return out;
}

}  // namespace tribotwin::twin::identification
