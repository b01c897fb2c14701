#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include <fmt/format.h>

#include <tribotwin/twin/identification/samples/recording.hpp>
#include <tribotwin/twin/numerics/interpolation.hpp>

namespace tribotwin::twin {

Result<void> check(const JointRecording& r) {
  const struct {
    const char* name;
    const std::vector<double>& values;
    bool required;
  } columns[] = {{"time_s", r.time_s, true},
                 {"position_rad", r.position_rad, true},
                 {"velocity_rad_s", r.velocity_rad_s, false},
                 {"torque_nm", r.torque_nm, true},
                 {"load_nm", r.load_nm, false},
                 {"temperature_degC", r.temperature_degC, false}};
  if (r.time_s.empty()) return tl::unexpected(std::string("the recording is empty"));
  for (const auto& c : columns) {
    if (c.values.empty() && !c.required) continue;
    if (c.values.size() != r.size())
      return tl::unexpected(fmt::format("{} has {} samples, time_s {}", c.name, c.values.size(), r.size()));
    for (std::size_t i = 0; i < r.size(); ++i)
      if (!std::isfinite(c.values[i])) return tl::unexpected(fmt::format("{} is not finite at sample {}", c.name, i));
  }
  for (std::size_t i = 1; i < r.size(); ++i)
    if (r.time_s[i] <= r.time_s[i - 1])
      return tl::unexpected(
          fmt::format("time_s {} at sample {} does not come after {}", r.time_s[i], i, r.time_s[i - 1]));
  return {};
}

JointRecording sensed(const JointRecording& s, const Sensors& sensors, std::uint64_t seed) {
  JointRecording out;
  std::seed_seq sequence{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)};
  std::mt19937_64 random(sequence);
  std::normal_distribution<double> noise(0, 1);
  const double period = 1 / sensors.sampling_hz;
  const double increment =
      sensors.encoder_increments_per_turn > 0 ? 2 * std::numbers::pi / sensors.encoder_increments_per_turn : 0;
  const auto at = [&s](const std::vector<double>& values, double time_s) {
    return between_samples(s.time_s, values, time_s);
  };
  for (std::size_t k = 0;; ++k) {
    const double t = s.time_s.front() + static_cast<double>(k) * period;
    if (t > s.time_s.back() + 1e-9) break;
    const double q = at(s.position_rad, t);
    out.time_s.push_back(t);
    out.position_rad.push_back(increment > 0 ? increment * std::floor(q / increment) : q);
    if (increment > 0)
      out.velocity_rad_s.push_back(k ? (out.position_rad[k] - out.position_rad[k - 1]) / period : 0);
    else if (!s.velocity_rad_s.empty())
      out.velocity_rad_s.push_back(at(s.velocity_rad_s, t));
    out.torque_nm.push_back(at(s.torque_nm, t - sensors.lag_s) +
                            (sensors.torque_noise_nm > 0 ? sensors.torque_noise_nm * noise(random) : 0));
    if (!s.load_nm.empty()) out.load_nm.push_back(at(s.load_nm, t));
    if (!s.temperature_degC.empty()) out.temperature_degC.push_back(at(s.temperature_degC, t));
  }
  return out;
}

}  // namespace tribotwin::twin
