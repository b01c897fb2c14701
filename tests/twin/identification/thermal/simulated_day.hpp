#pragma once

#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <numbers>
#include <random>
#include <vector>

#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>

/// A joint's day with noise, drift and heat that nobody recorded.
namespace tribotwin::twin::identification {

/// The six joints of the ER3A (mjcf/er3a_c60.xml): c1, c2 [K/J], t1, t2 [s].
inline const std::vector<std::vector<double>> er3a = {{0.00813, 0.00131, 147.3, 2126}, {0.1318, 0.00545, 18.02, 1021},
                                                      {0.07548, 0.00681, 55.03, 1423}, {0.01510, 0.00484, 199.2, 1443},
                                                      {0.2318, 0.00871, 19.91, 1239},  {0.00775, 0.00438, 475.4, 1954}};

inline thermal::Model model_of(const std::vector<double>& parameters, double ambient_degC = 20) {
  return thermal::make_model(thermal::Order::second, ambient_degC, parameters);
}

/// What is measured and what disturbs it, beyond the model.
struct Disturbance {
  double white_K = 0.03;
  double slow_K = 0, correlation_s = 1;  ///< Ornstein-Uhlenbeck
  double power_ripple = 0;               ///< of the true power, not of the recorded one
};

struct Day {
  double length_s, step_s = 10;
  std::vector<double> power_w{2};  ///< one after the other, 40 min each
  bool rested = true;
};

inline HeatSession recorded(const thermal::Model& model, const Day& day, const Disturbance& d,
                            std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> share(0, 1);
  const double phase = 2 * std::numbers::pi * share(random), period_s = 100 * std::pow(20, share(random));
  const thermal::Decay decay = thermal::decay(model, day.step_s);
  thermal::Rise rise;
  if (!day.rested) rise.node_K[0] = 1, rise.node_K[1] = 3;
  HeatSession s;
  double slow = d.slow_K * normal(random);
  for (double t = 0; t <= day.length_s; t += day.step_s) {
    const double power = day.power_w[static_cast<std::size_t>(t / 2400) % day.power_w.size()];
    if (t > 0)
      thermal::step(model, decay, power * (1 + d.power_ripple * std::sin(2 * std::numbers::pi * t / period_s + phase)),
                    0, rise);
    const double kept = std::exp(-day.step_s / d.correlation_s);
    slow = kept * slow + std::sqrt(1 - kept * kept) * d.slow_K * normal(random);
    s.time_s.push_back(t);
    s.power_w.push_back(t > 0 ? power : 0);
    s.temperature_degC.push_back(model.T_amb_degC + rise.total_K() + slow + d.white_K * normal(random));
  }
  return s;
}

/// By hand: TRIBOTWIN_REPEATS=200.
inline int repeats_or(int usual) {
  const char* text = std::getenv("TRIBOTWIN_REPEATS");
  return text ? std::atoi(text) : usual;
}

}  // namespace tribotwin::twin::identification
