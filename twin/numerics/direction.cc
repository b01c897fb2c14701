#include <algorithm>
#include <cmath>

#include <tribotwin/twin/numerics/direction.hpp>

namespace tribotwin::twin::identification {
namespace {

double direction_of(double speed) { return std::copysign(1, speed); }

/// Fills the turn [first, last) between faster samples or ends.
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

void rest(std::span<const double> speed, std::size_t first, std::size_t last, Sliding& out) {
  const bool between = first > 0 && last < speed.size();
  const double before = between ? out.direction[first - 1] : 0, after = between ? direction_of(speed[last]) : 0;
  for (std::size_t i = first; i < last; ++i) {
    out.rest[i] = true;
    out.direction[i] =
        before + (after - before) * (static_cast<double>(i - first) + 0.5) / static_cast<double>(last - first);
  }
}

}  // namespace

Sliding sliding_of(std::span<const double> speed, double slow, std::size_t longest_turn) {
  Sliding out{.direction = std::vector<double>(speed.size()), .rest = std::vector<bool>(speed.size())};
  for (std::size_t i = 0; i < speed.size();) {
    if (std::abs(speed[i]) >= slow) {
      out.direction[i] = direction_of(speed[i]);
      ++i;
      continue;
    }
    const std::size_t first = i;
    while (i < speed.size() && std::abs(speed[i]) < slow) ++i;
    if (i - first <= longest_turn)
      turn(speed, first, i, out.direction);
    else
      rest(speed, first, i, out);
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
