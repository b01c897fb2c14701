#pragma once

#include <algorithm>
#include <cmath>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/plugins/friction/uncertainty.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>

/// Our own functions, compiled for browsers: a page that lets its reader change a value computes by them, never by a
/// second formula. This header is shared by the program, which puts a law into a page, and by the module in the page.
namespace tribotwin::render::kernel {

/// A law as the page carries it: numbers without padding, little-endian, alike in both programs.
struct Numbers {
  friction::GeneralLaw law;
  friction::Range range;
  double extrapolates = 0;                               ///< 1: Validity::extrapolate
  double temperature_dependent = 0, load_dependent = 0;  ///< 1: yes
};
static_assert(sizeof(Numbers) % sizeof(double) == 0 && alignof(Numbers) == alignof(double));

static_assert(sizeof(friction::Uncertainty) % sizeof(double) == 0 && alignof(friction::Uncertainty) == alignof(double));

inline Numbers numbers_of(const friction::Law& law) {
  return {.law = law.general_law,
          .range = law.range,
          .extrapolates = law.validity == friction::Validity::extrapolate ? 1.0 : 0.0,
          .temperature_dependent = law.info->temperature_dependent ? 1.0 : 0.0,
          .load_dependent = law.info->load_dependent ? 1.0 : 0.0};
}

/// A joint that repeats its work cycle, as the page of a run carries it: numbers like those of a law.
struct WarmUp {
  static constexpr int levels = 256;
  double order = 0, T_amb_degC = 0;  ///< these and the next two: of its thermal::Model
  double t_s[thermal::max_nodes] = {0, 0};
  double gain_K_J[thermal::max_nodes] = {0, 0};
  double starts_at_ambient = 0;  ///< 1: whatever the ambient temperature is; 0: at start_degC
  double start_degC = 0;
  double cycle_s = 0;
  double power_from_degC = 0, power_to_degC = 0;
  double power_W[levels] = {};  ///< mean friction power of a cycle that begins at these temperatures, evenly apart
};
static_assert(sizeof(WarmUp) == (11 + WarmUp::levels) * sizeof(double));

/// Linear between the levels, held beyond them.
inline double power_W(const WarmUp& joint, double temperature_degC) {
  const double share = (temperature_degC - joint.power_from_degC) / (joint.power_to_degC - joint.power_from_degC),
               place = std::clamp(share, 0.0, 1.0) * (WarmUp::levels - 1);
  const int below = std::min(static_cast<int>(place), WarmUp::levels - 2);
  return std::lerp(joint.power_W[below], joint.power_W[below + 1], place - below);
}

/// A prediction under way.
struct Warming {
  thermal::Model model{};
  thermal::Decay cycle{};
  thermal::Rise rise{};
  double ambient_offset_K = 0, working_share = 1;

  double temperature_degC() const { return model.T_amb_degC + rise.total_K(); }
};

/// The start at an ambient temperature, for a joint that stands still between its cycles for so many minutes of an hour
/// (0 .. 60), evenly spread.
inline Warming begin(const WarmUp& joint, double ambient_degC, double standing_min_h) {
  Warming w{.model = {.order = static_cast<thermal::Order>(static_cast<int>(joint.order)),
                      .T_amb_degC = joint.T_amb_degC,
                      .t_s = {joint.t_s[0], joint.t_s[1]},
                      .gain_K_J = {joint.gain_K_J[0], joint.gain_K_J[1]}},
            .ambient_offset_K = ambient_degC - joint.T_amb_degC,
            .working_share = 1 - standing_min_h / 60};
  w.cycle = thermal::decay(w.model, joint.cycle_s);
  const double start_degC = joint.starts_at_ambient != 0 ? ambient_degC : joint.start_degC;
  w.rise = thermal::steady_rise(w.model, start_degC - joint.T_amb_degC);
  return w;
}

/// Advances by `count` times the duration of a cycle.
inline void work(const WarmUp& joint, int count, Warming& w) {
  for (int i = 0; i < count; ++i)
    thermal::step(w.model, w.cycle, w.working_share * power_W(joint, w.temperature_degC()), w.ambient_offset_K, w.rise);
}

}  // namespace tribotwin::render::kernel
