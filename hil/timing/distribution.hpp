#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <utility>
#include <vector>

namespace tribotwin::hil {

/// Durations of a session of any length, in 300 kB: counted in bins of at most 1/1024 of their value.
class Distribution {
 public:
  /// `ns` >= 0; less counts as 0, and five hours as the most.
  void add(std::int64_t ns, std::uint64_t times = 1) {
    ns = std::clamp<std::int64_t>(ns, 0, longest_ns);
    const int shift = shift_of(static_cast<std::uint64_t>(ns));
    const auto bin = static_cast<std::size_t>((shift << sub_bits) + (ns >> shift));
    counts_[bin] += times;
    first_ = std::min(first_, bin);
    end_ = std::max(end_, bin + 1);
    count_ += times;
    max_ns_ = std::max(max_ns_, ns);
  }
  std::uint64_t count() const { return count_; }
  /// Exact; 0 without any.
  std::int64_t max_ns() const { return max_ns_; }
  /// The value that a share of `q` (0..1) does not exceed; 0 without any.
  std::int64_t quantile_ns(double q) const {
    std::uint64_t sum = 0;
    for (std::size_t i = first_; i < end_; ++i)
      if (counts_[i] && static_cast<double>(sum += counts_[i]) >= q * static_cast<double>(count_))
        return std::min(value_of(i), max_ns_);
    return 0;
  }
  std::int64_t median_ns() const { return quantile_ns(0.5); }
  /// Calls `take(ns, times)` for every value, upwards.
  template <typename Take>
  void each(Take take) const {
    for (std::size_t i = first_; i < end_; ++i)
      if (counts_[i]) take(value_of(i), counts_[i]);
  }
  /// Of the distances from the median.
  Distribution around_median() const {
    Distribution distances;
    each([&, median = median_ns()](std::int64_t ns, std::uint64_t times) {
      distances.add(ns < median ? median - ns : ns - median, times);
    });
    return distances;
  }
  /// How many lie below each limit [us] and not below the one before: four steps from a power of two to the next, from
  /// the first that has any to the last.
  std::vector<std::pair<std::int64_t, std::uint64_t>> histogram_us() const {
    std::vector<std::pair<std::int64_t, std::uint64_t>> bins;
    each([&](std::int64_t ns, std::uint64_t times) {
      const std::int64_t us = ns / 1000, limit = us - us % step_us(us) + step_us(us);
      if (bins.empty()) bins.emplace_back(limit, 0);
      while (bins.back().first < limit) bins.emplace_back(bins.back().first + step_us(bins.back().first), 0);
      bins.back().second += times;
    });
    return bins;
  }

 private:
  static constexpr std::int64_t step_us(std::int64_t us) {
    return std::max<std::int64_t>(1, static_cast<std::int64_t>(std::bit_floor(static_cast<std::uint64_t>(us))) / 4);
  }
  static constexpr int sub_bits = 10;
  static constexpr std::int64_t longest_ns = std::int64_t{1} << 44;
  static constexpr int shift_of(std::uint64_t value) {
    return std::max(0, static_cast<int>(std::bit_width(value)) - sub_bits - 1);
  }
  /// The middle of a bin.
  static constexpr std::int64_t value_of(std::size_t bin) {
    const auto b = static_cast<std::int64_t>(bin);
    const std::int64_t shift = std::max<std::int64_t>(0, (b >> sub_bits) - 1);
    return ((b - (shift << sub_bits)) << shift) + ((std::int64_t{1} << shift) >> 1);
  }

  std::vector<std::uint64_t> counts_ = std::vector<std::uint64_t>(
      static_cast<std::size_t>((shift_of(static_cast<std::uint64_t>(longest_ns)) << sub_bits) + (2 << sub_bits)));
  std::size_t first_ = counts_.size(), end_ = 0;  // bins that have any
  std::uint64_t count_ = 0;
  std::int64_t max_ns_ = 0;
};

}  // namespace tribotwin::hil
