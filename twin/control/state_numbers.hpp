#pragma once

#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

namespace tribotwin::twin {

/// Writes the numbers that something carries from step to step, or reads them back: one function names them for both,
/// so that their order is the same. Integers are exact up to 2^53.
class StateNumbers {
 public:
  /// Appends to `out`.
  explicit StateNumbers(std::vector<double>& out) : out_(&out) {}
  /// Takes from `in`; what it lacks is read as 0, and `whole` is then false.
  explicit StateNumbers(std::span<const double> in) : in_(in) {}

  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(T& x) {
    if (out_) {
      out_->push_back(static_cast<double>(x));
    } else {
      const double number = at_ < in_.size() ? in_[at_] : 0;
      ++at_;
      if constexpr (std::same_as<T, bool>)
        x = number != 0;
      else if constexpr (std::integral<T>)
        x = fits<T>(number) ? static_cast<T>(number) : T{};
      else
        x = number;
    }
  }
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(T* first, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) (*this)(first[i]);
  }
  /// A struct of doubles alone.
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void doubles(T& all) {
    static_assert(sizeof(T) % sizeof(double) == 0);
    (*this)(reinterpret_cast<double*>(&all), sizeof(T) / sizeof(double));
  }

  bool restores() const { return !out_; }
  /// Whether exactly what there was has been read.
  bool whole() const { return out_ || at_ == in_.size(); }

 private:
  template <class T>
  static bool fits(double number) {
    return std::abs(number) <= 0x1p53 && number >= static_cast<double>(std::numeric_limits<T>::min()) &&
           number <= static_cast<double>(std::numeric_limits<T>::max());
  }

  std::vector<double>* out_ = nullptr;
  std::span<const double> in_;
  std::size_t at_ = 0;
};

}  // namespace tribotwin::twin
