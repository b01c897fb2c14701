#include <cmath>

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

}  // namespace

Result<double> cross_validate(const friction::LawInfo& law, const Samples& samples, const FitOptions& options,
                              unsigned folds) {
  const bool by_curve = samples.curves() >= folds;
  double squares = 0;
  std::size_t count = 0;
  for (unsigned fold = 0; fold < folds; ++fold) {
    std::vector<std::size_t> learn, test;
    for (std::size_t i = 0; i < samples.size(); ++i)
      ((by_curve ? samples.curve[i] : i) % folds == fold ? test : learn).push_back(i);
    if (learn.empty() || test.empty())
      return tl::unexpected(fmt::format("{} samples are too few for {} folds", samples.size(), folds));
    const Samples learned = samples.subset(learn), tested = samples.subset(test);
    const auto found = fit(law, learned, options);
    if (!found) return tl::unexpected(fmt::format("without fold {}: {}", fold + 1, found.error().message));
    for (const double r : residuals_of(*found, tested, options.threads)) squares += r * r, ++count;
  }
  return std::sqrt(squares / static_cast<double>(count));
}

}  // namespace tribotwin::twin::identification
