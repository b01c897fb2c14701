#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <span>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/samples/ripple.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::curves {

Ripple ripple_of(const Profile& profile, const Profile::Difference& both) {
  constexpr double false_alarm = 1e-4, min_periods = 3, min_samples_per_period = 5, max_per_turn = 1000;
  const auto n = static_cast<Eigen::Index>(both.x.size());
  const double travel = std::abs(profile.position(both.x.back()) - profile.position(both.x.front()));
  const double lowest = std::ceil(2 * std::numbers::pi * min_periods / travel);
  const double highest =
      std::min(max_per_turn, 2 * std::numbers::pi * static_cast<double>(n) / travel / min_samples_per_period);
  const double step = std::max(1.0, std::floor(std::numbers::pi / travel));
  if (!(highest > lowest + 10 * step)) return {};

  Eigen::MatrixXd slow(n, 5);  // polynomial in the position, and friction's share of the load
  for (Eigen::Index i = 0; i < n; ++i) {
    const double x = both.x[static_cast<std::size_t>(i)];
    slow.row(i) << 1, x, x * x, x * x * x, std::abs(profile.common_nm(x));
  }
  const Eigen::Map<const Eigen::VectorXd> all(both.friction_nm.data(), n);
  const Eigen::VectorXd rest = all - slow * ShortestSolution(slow)(all);
  Eigen::ArrayXcd turned(n), turn(n);  // e^(i k q), from one k to the next
  for (Eigen::Index i = 0; i < n; ++i) {
    const double q = profile.position(both.x[static_cast<std::size_t>(i)]);
    turned[i] = std::polar(1.0, lowest * q), turn[i] = std::polar(1.0, step * q);
  }
  std::vector<double> squares;
  Ripple strongest;
  for (double k = lowest; k <= highest; k += step, turned *= turn) {
    const std::complex<double> sum = (rest.array() * turned).sum() * (2 / static_cast<double>(n));
    const Ripple one{k, sum.real(), sum.imag(), step};
    if (one.amplitude_nm() > strongest.amplitude_nm()) strongest = one;
    squares.push_back(one.amplitude_nm() * one.amplitude_nm());
  }
  // Squared amplitudes of noise are exponentially distributed, with a median of ln 2 times their mean; that of the
  // neighbours, for noise need not be white.
  const double count = static_cast<double>(squares.size());
  constexpr std::size_t max_neighbours = 60;
  const auto place = static_cast<std::size_t>(std::lround((strongest.per_turn - lowest) / step)),
             wide = std::min(squares.size(), max_neighbours);
  const std::size_t from = std::min(place - std::min(place, wide / 2), squares.size() - wide);
  const std::span<double> neighbours(squares.data() + from, wide);
  std::ranges::nth_element(neighbours, neighbours.begin() + static_cast<std::ptrdiff_t>(wide / 2));
  const double noise = neighbours[wide / 2] / std::numbers::ln2;
  return std::pow(strongest.amplitude_nm(), 2) > noise * std::log(count / false_alarm) ? strongest : Ripple{};
}

}  // namespace tribotwin::twin::curves
