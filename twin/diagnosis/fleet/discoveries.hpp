#pragma once

#include <span>
#include <vector>

/// Which of many tests are significant, so that of those listed a given share is expected to be false.
namespace tribotwin::twin::diagnosis::fleet {

/// Adjusted p-values (Benjamini 1995): a test is listed at false-discovery rate q where its number is <= q. `p` in
/// 0 .. 1. Tests may be independent or positively dependent. `tests` >= p.size() is their number where tests with p
/// above every rate of interest are left out of `p`.
std::vector<double> adjusted(std::span<const double> p, std::size_t tests);

/// Probabilities of a CUSUM of independent standard normal scores, C = max(0, C + z - cusum_allowance) from 0, to be
/// c or more after n steps (Li 2009: false discoveries among many charts). By a Markov chain; rounded up.
class CusumTail {
 public:
  CusumTail();
  /// n >= 1, c >= 0
  double operator()(std::size_t n, double c) const;

 private:
  std::vector<std::vector<double>> above_;  ///< by steps, by grid point
};

}  // namespace tribotwin::twin::diagnosis::fleet
