#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/basis.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>

namespace tribotwin::twin::identification {

Result<double> cross_validate(const friction::LawInfo& law, const Samples& samples, const FitOptions& options,
                              unsigned folds) {
  const bool by_curve = samples.curves() >= folds;
  double squares = 0;
  for (unsigned fold = 0; fold < folds; ++fold) {
    std::vector<std::size_t> learn, test;
    for (std::size_t i = 0; i < samples.size(); ++i)
      ((by_curve ? samples.curve[i] : i) % folds == fold ? test : learn).push_back(i);
    if (learn.empty() || test.empty())
      return tl::unexpected(fmt::format("{} samples are too few for {} folds", samples.size(), folds));
    const Samples learned = samples.subset(learn), tested = samples.subset(test);
    const auto found = fit(law, learned, options);
    if (!found) return tl::unexpected(fmt::format("without fold {}: {}", fold + 1, found.error().message));
    for (const double r : residuals(tested, Placement(law), found->law.general_law, options.threads)) squares += r * r;
  }
  return std::sqrt(squares / static_cast<double>(samples.size()));
}

}  // namespace tribotwin::twin::identification
