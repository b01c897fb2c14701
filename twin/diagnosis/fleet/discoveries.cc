#include <algorithm>
#include <cmath>
#include <numeric>

#include <tribotwin/twin/diagnosis/fleet/discoveries.hpp>
#include <tribotwin/twin/diagnosis/sequence.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

constexpr double width = 0.05;             // of the chain's states
constexpr std::size_t states = 400;        // up to c = 20, where 1e-9 is left
constexpr std::size_t steady_after = 120;  // steps, from when on the distribution no longer changes

}  // namespace

std::vector<double> adjusted(std::span<const double> p, std::size_t tests) {
  std::vector<std::size_t> order(p.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::sort(order, std::greater{}, [&](std::size_t i) { return p[i]; });
  std::vector<double> out(p.size());
  double smallest = 1;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const auto rank = static_cast<double>(order.size() - k);
    smallest = std::min(smallest, p[order[k]] * static_cast<double>(tests) / rank);
    out[order[k]] = smallest;
  }
  return out;
}

CusumTail::CusumTail() {
  // State 0: C = 0; state i: C in ((i - 1) width, i width], taken as its upper end. The last one holds all beyond.
  std::vector<double> step(2 * states + 1);  // P(z - allowance in the cell), by cells from -states to states
  for (std::size_t i = 0; i < step.size(); ++i) {
    const double upper = (static_cast<double>(i) - static_cast<double>(states)) * width + cusum_allowance;
    step[i] = normal_below(upper) - normal_below(upper - width);
  }
  std::vector<double> now(states, 0.0);
  now[0] = 1;
  for (std::size_t n = 0; n < steady_after; ++n) {
    std::vector<double> next(states, 0.0);
    for (std::size_t from = 0; from < states; ++from) {
      if (now[from] < 1e-14) continue;
      next[0] += now[from] * normal_below(cusum_allowance - static_cast<double>(from) * width);
      for (std::size_t to = 1; to < states; ++to) next[to] += now[from] * step[states + to - from];
    }
    now.swap(next);
    std::vector<double> above(states);
    double sum = 0;
    for (std::size_t i = states; i-- > 0;) above[i] = sum += now[i];
    above_.push_back(std::move(above));
  }
}

double CusumTail::operator()(std::size_t n, double c) const {
  if (!(c > 0)) return 1;
  const auto& above = above_[std::min(n, above_.size()) - 1];
  const auto cell = static_cast<std::size_t>(std::ceil(c / width - 1e-9));  // mass that may be at c or more
  if (cell < states - 1) return std::min(1.0, above[cell]);
  // Beyond the chain the tail falls as e^(-2 allowance c).
  return above[states - 2] * std::exp(-2 * cusum_allowance * (c - static_cast<double>(states - 2) * width));
}

}  // namespace tribotwin::twin::diagnosis::fleet
