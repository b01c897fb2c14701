#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <vector>

/// Statistics of a sweep's outputs, with 95 % intervals.
namespace tribotwin::twin::sweep {

struct Interval {
  double low, high;
};

struct Estimated {
  double value;
  std::optional<Interval> interval;  ///< none where the data give none
};

/// What a quantity can be.
struct Range {
  double low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
};

/// Of independent values. The interval of `mean` is Student's t, cut to the range. Where values lie at an end of the
/// range and fewer than 20 elsewhere, as times above a threshold that few runs exceed, t is too narrow: then it is that
/// of Gaffke (2005), the generalisation of Clopper and Pearson's to any distribution on a range, and none where one end
/// of the range is infinite. `deviation` has the interval of Bonett (2006), which a heavy or light tail does not make
/// wrong; none below 5 values and where the mean's is not t.
struct Moments {
  std::size_t count = 0;
  Estimated mean{}, deviation{};
  double min = 0, max = 0;
};
Moments moments(std::span<const double> values, const Range& range = {});

/// The quantile of a sample, ascending: the p (n + 1)-th value, linear between neighbours, so that a further value is
/// below it with probability p. The interval is one of order statistics, of any distribution; none where n is too small
/// for the probability.
Estimated quantile(std::span<const double> ascending, double probability);

/// Spearman's rank correlation; interval by Fisher's transformation with the variance of Bonett, Wright (2000).
/// None where one of both does not vary, or with fewer than four pairs.
std::optional<Estimated> rank_correlation(std::span<const double> x, std::span<const double> y);

/// Shares of the variance that a group of factors causes alone, and with all its interactions.
struct SobolIndices {
  Estimated first, total;
};

/// Of a design by Saltelli (2010), its table 2 (b) for `first` and (f), Jansen's, for `total`. `values`: one per run,
/// NaN where it failed: its base point is left out. Intervals are of 500 bootstrap samples of base points, by
/// percentiles, cut to what an index can be: 0 to 1, in total 0 and more. The estimate of a small index may be
/// negative. None where fewer than eight base points are whole or the output does not vary.
std::vector<std::optional<SobolIndices>> saltelli_indices(std::span<const double> values, std::size_t groups,
                                                          std::uint64_t seed);

/// Of a full grid, the last factor varying fastest: exact for factors whose levels are equally probable, so without
/// intervals. None where a run is missing (NaN) or the output does not vary.
std::vector<std::optional<SobolIndices>> grid_indices(std::span<const double> values,
                                                      std::span<const std::size_t> levels);

}  // namespace tribotwin::twin::sweep
