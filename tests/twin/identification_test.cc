#include <tribotwin/twin/identification/fit.hpp>

#include <chrono>
#include <cmath>
#include <random>

#include <boost/math/distributions/binomial.hpp>
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/twin/identification/basis.hpp>

namespace tribotwin::twin::identification {
namespace {

using testing::Contains, testing::HasSubstr, testing::IsSupersetOf, testing::UnorderedElementsAre;

/// Paper 1's ranges: 12 speeds up to 280 rad/s, loads to 0.73, 38 .. 81.2 degC; friction of `law` with Gaussian noise.
Samples campaign(const friction::Law& law, std::size_t curves, double noise, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> load(0, 0.73), temperature(38, 81.2);
  std::normal_distribution<double> error(0, noise);
  Samples s;
  for (std::size_t c = 0; c < curves; ++c) {
    const double l = load(random), T = temperature(random);
    for (int k = 0; k < 12; ++k) {
      const double v = 1.5 * std::pow(280 / 1.5, k / 11.0);
      s.speed.push_back(v);
      s.load.push_back(l);
      s.temperature_degC.push_back(T);
      s.friction.push_back(friction::torque(law, v, l, T) + (noise > 0 ? error(random) : 0));
      s.curve.push_back(static_cast<std::uint32_t>(c));
    }
  }
  return s;
}

const friction::LawInfo& extended() { return *friction::find_law("extended"); }
friction::Law published() { return *friction::published_law("extended"); }

TEST(Identification, DISABLED_Look) {
  const auto truth = published();
  const auto s = campaign(truth, 484, 4.23e-3, 1);
  const auto begin = std::chrono::steady_clock::now();
  const auto f = fit(extended(), s);
  fmt::print("{} s\n", std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  ASSERT_TRUE(f) << f.error();
  for (std::size_t i = 0; i < f->parameters.size(); ++i) {
    const auto& e = f->parameters[i];
    fmt::print("{:6} {:12.5g} +- {:10.3g}  true {:10.4g}  z {:6.2f}\n", e.name, e.value, e.sigma, truth.parameters[i], (e.value - truth.parameters[i]) / e.sigma);
  }
  fmt::print("cost {} r2 {} cond {} std {}\n", f->cost, f->r_squared, f->condition_number, f->residual.std);
  for (const auto& n : f->notes) fmt::print("note: {}\n", n);
}

}  // namespace
}  // namespace tribotwin::twin::identification
