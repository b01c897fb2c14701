/// Without text and tables, so that pages have it compiled for browsers too.
#include <algorithm>
#include <array>
#include <cmath>

#include <tribotwin/plugins/friction/uncertainty.hpp>

namespace tribotwin::friction {
namespace {

GeneralLaw changed(const Law& law, std::size_t parameter, double by) {
  auto values = law.parameters;
  values[parameter] += by;
  return law.info->general_law({values.data(), law.info->parameters.size()});
}

double friction(Law law, const GeneralLaw& numbers, double speed, double load, double temperature) {
  law.general_law = numbers;
  return level(law, at_temperature(law, temperature), speed, load).total();
}

}  // namespace

Uncertainty make_uncertainty(const Law& law, std::span<const std::vector<double>> covariance, double interval_sigmas) {
  Uncertainty u{.interval_sigmas = interval_sigmas};
  for (std::size_t i = 0; i < covariance.size(); ++i) {
    std::copy(covariance[i].begin(), covariance[i].end(), u.covariance[i]);
    const double sigma = std::sqrt(covariance[i][i]);
    if (!(sigma > 0)) continue;
    const double step = std::max(0.05 * sigma, 1e-6 * std::abs(law.parameters[i]));
    u.changes[i] = {.larger = changed(law, i, step), .smaller = changed(law, i, -step), .step = step};
  }
  return u;
}

double half_width(const Law& law, const Uncertainty& u, double speed, double load, double temperature) {
  std::array<double, max_parameters> slopes{};
  for (std::size_t i = 0; i < max_parameters; ++i) {
    const auto& [larger, smaller, step] = u.changes[i];
    if (step > 0)
      slopes[i] = (friction(law, larger, speed, load, temperature) - friction(law, smaller, speed, load, temperature)) /
                  (2 * step);
  }
  double variance = 0;
  for (std::size_t i = 0; i < max_parameters; ++i)
    for (std::size_t k = 0; k < max_parameters; ++k) variance += slopes[i] * u.covariance[i][k] * slopes[k];
  return u.interval_sigmas * std::sqrt(std::max(0.0, variance));
}

}  // namespace tribotwin::friction
