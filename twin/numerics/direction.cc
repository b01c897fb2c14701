#include <algorithm>
#include <cmath>

#include <tribotwin/twin/numerics/direction.hpp>

namespace tribotwin::twin::identification {
namespace {

double direction_of(double speed) { return std::copysign(1, speed); }

/// Fills the turn [first, last) between samples in motion or ends.
void turn(std::span<const double> speed, std::size_t first, std::size_t last, std::vector<double>& direction) {
  const double before = first > 0 ? direction[first - 1] : direction_of(speed.front()),
               after = direction_of(last < speed.size() ? speed[last] : speed.back());
  std::size_t change = first;
  if (before != after) {
    std::size_t left = first, back = last;  // where `before` ends for the first time, and for the last
    while (left < last && direction_of(speed[left]) == before) ++left;
    while (back > first && direction_of(speed[back - 1]) == after) --back;
    change = (left + back) / 2;
  }
  for (std::size_t i = first; i < last; ++i) direction[i] = i < change ? before : after;
}

/// As a turn between two motions; at an end as the motion beside it, 0 where there is none.
void rest(std::span<const double> speed, std::size_t first, std::size_t last, Sliding& out) {
  for (std::size_t i = first; i < last; ++i) out.rest[i] = true;
  if (first > 0 && last < speed.size()) return turn(speed, first, last, out.direction);
  const double beside = first > 0 ? out.direction[first - 1] : last < speed.size() ? direction_of(speed[last]) : 0;
  std::ranges::fill(std::span(out.direction).subspan(first, last - first), beside);
}

std::vector<bool> moving(std::span<const double> speed, double slow, double far) {
  std::vector<bool> out(speed.size());
  for (std::size_t i = 0; i < speed.size();) {
    const std::size_t first = i;
    double travel = 0;
    for (; i < speed.size() && std::abs(speed[i]) >= slow && speed[i] * speed[first] > 0; ++i)
      travel += std::abs(speed[i]);
    for (std::size_t k = first; k < i; ++k) out[k] = travel >= far;
    i = std::max(i, first + 1);
  }
  return out;
}

}  // namespace

Sliding sliding_of(std::span<const double> speed, double slow, double far, std::size_t longest_turn) {
  Sliding out{.direction = std::vector<double>(speed.size()), .rest = std::vector<bool>(speed.size())};
  const std::vector<bool> moves = moving(speed, slow, far);
  for (std::size_t i = 0; i < speed.size();) {
    if (moves[i]) {
      out.direction[i] = direction_of(speed[i]);
      ++i;
      continue;
    }
    const std::size_t first = i;
    while (i < speed.size() && !moves[i]) ++i;
    if (i - first > longest_turn)
      rest(speed, first, i, out);
    else
      turn(speed, first, i, out.direction);
  }
  return out;
}

std::vector<bool> widened(const std::vector<bool>& signal, std::size_t reach) {
  const std::size_t n = signal.size();
  std::vector<bool> out(n);
  std::size_t end = 0;  // before it all is decided
  for (std::size_t i = 0; i < n; ++i)
    if (signal[i])
      for (end = std::max(end, i - std::min(i, reach)); end < std::min(n, i + reach + 1); ++end) out[end] = true;
  return out;
}

}  // namespace tribotwin::twin::identification
