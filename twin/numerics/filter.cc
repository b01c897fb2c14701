#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

#include <tribotwin/twin/numerics/filter.hpp>

namespace tribotwin::twin::identification {
namespace {

/// Second-order section in transposed direct form II, with the state in which a constant input of 1 leaves it.
struct Section {
  double b0, b1, b2, a1, a2;

  void run(std::vector<double>& x) const {
    // Gain 1 at standstill: a constant passes unchanged from the first sample on.
    double s2 = (b2 - a2) * x.front(), s1 = (b1 - a1) * x.front() + s2;
    for (double& value : x) {
      const double in = value;
      value = b0 * in + s1;
      s1 = b1 * in - a1 * value + s2;
      s2 = b2 * in - a2 * value;
    }
  }
};

Section section(double warped, double damping) {
  const double w2 = warped * warped, norm = 1 / (1 + 2 * damping * warped + w2);
  return {.b0 = w2 * norm,
          .b1 = 2 * w2 * norm,
          .b2 = w2 * norm,
          .a1 = 2 * (w2 - 1) * norm,
          .a2 = (1 - 2 * damping * warped + w2) * norm};
}

/// Weights of central differences over `reach` samples on either side, exact for polynomials of degree 2 reach:
/// of x[i + k] - x[i - k], k = 1 .. reach, in the first derivative; of x[i + k] + x[i - k] - 2 x[i], times 2 / k, in
/// the second.
std::vector<double> central_weights(std::size_t reach) {
  std::vector<double> weights;
  double binomials = -1;
  for (std::size_t k = 1; k <= reach; ++k) {
    binomials *= -static_cast<double>(reach - k + 1) / static_cast<double>(reach + k);
    weights.push_back(binomials / static_cast<double>(k));
  }
  return weights;
}

/// `term(weight, k, ahead, behind)` of the samples k ahead and k behind, summed with the widest weights that fit.
std::vector<double> differentiated(std::span<const double> x, const auto& term) {
  constexpr std::size_t widest = 8;
  assert(x.size() >= 3);
  std::vector<std::vector<double>> weights;
  for (std::size_t reach = 0; reach <= widest; ++reach) weights.push_back(central_weights(reach));
  const std::size_t last = x.size() - 1;
  std::vector<double> out(x.size());
  for (std::size_t i = 1; i < last; ++i)
    for (std::size_t k = 1; const double w : weights[std::min({widest, i, last - i})])
      out[i] += term(w, static_cast<double>(k), x[i + k] - x[i], x[i - k] - x[i]), ++k;
  out.front() = out[1], out.back() = out[last - 1];
  return out;
}

}  // namespace

std::vector<double> first_derivative(std::span<const double> signal, double sampling_hz) {
  return differentiated(
      signal, [=](double w, double, double ahead, double behind) { return w * sampling_hz * (ahead - behind); });
}

std::vector<double> second_derivative(std::span<const double> signal, double sampling_hz) {
  return differentiated(signal, [=](double w, double k, double ahead, double behind) {
    return 2 * w / k * sampling_hz * sampling_hz * (ahead + behind);
  });
}

std::vector<double> low_passed(std::span<const double> signal, double sampling_hz, double cutoff_hz) {
  assert(cutoff_hz > 0 && cutoff_hz < sampling_hz / 2);
  const std::size_t n = signal.size();
  if (n < 2) return {signal.begin(), signal.end()};
  const double pi = std::numbers::pi, warped = std::tan(pi * cutoff_hz / sampling_hz);
  const Section sections[] = {section(warped, std::sin(pi / 8)), section(warped, std::sin(3 * pi / 8))};
  const std::size_t pad = std::min(n - 1, static_cast<std::size_t>(std::ceil(3 * sampling_hz / cutoff_hz)));
  std::vector<double> x;
  x.reserve(n + 2 * pad);
  for (std::size_t k = pad; k > 0; --k) x.push_back(2 * signal.front() - signal[k]);
  x.insert(x.end(), signal.begin(), signal.end());
  for (std::size_t k = 1; k <= pad; ++k) x.push_back(2 * signal.back() - signal[n - 1 - k]);
  for (int pass = 0; pass < 2; ++pass) {
    for (const Section& s : sections) s.run(x);
    std::ranges::reverse(x);
  }
  const auto first = x.begin() + static_cast<std::ptrdiff_t>(pad);
  return {first, first + static_cast<std::ptrdiff_t>(n)};
}

}  // namespace tribotwin::twin::identification
