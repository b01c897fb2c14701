/// The module of what_if.js: clang compiles this file, level.cc and uncertainty.cc of plugins/friction, and
/// plugins/thermal/rise.cc for the browser.
#include <array>
#include <bit>

#include <tribotwin/render/page/kernel.hpp>

namespace {

using namespace tribotwin;

render::kernel::Numbers numbers;
/// Of friction::Uncertainty, as zeros: its own defaults would be 7 kB of the module.
std::array<double, sizeof(friction::Uncertainty) / sizeof(double)> uncertainty;

render::kernel::WarmUp joint;
render::kernel::Warming warming;

friction::LawInfo info{};

friction::Law law() {
  info.temperature_dependent = numbers.temperature_dependent != 0;
  info.load_dependent = numbers.load_dependent != 0;
  const auto validity = numbers.extrapolates != 0 ? friction::Validity::extrapolate : friction::Validity::clamp;
  return {.info = &info, .range = numbers.range, .validity = validity, .general_law = numbers.law};
}

friction::Level level(double speed_rad_s, double load_norm, double temperature_degC) {
  return friction::level(law(), friction::at_temperature(law(), temperature_degC), speed_rad_s, load_norm);
}

}  // namespace

extern "C" {

/// Where the page writes the law, and how many bytes it has.
void* law_numbers() { return &numbers; }
int law_size() { return sizeof numbers; }

/// Friction [unit of the law] at a speed on the law's side [rad/s], a load [-] and a temperature [degC]; at speed 0 the
/// breakaway level. Finite for every input.
double friction_level(double speed_rad_s, double load_norm, double temperature_degC) {
  return level(speed_rad_s, load_norm, temperature_degC).total();
}

/// Where the page writes how sure the law is, and how many bytes that has.
void* uncertainty_numbers() { return &uncertainty; }
int uncertainty_size() { return sizeof uncertainty; }

/// Half the width of its band there [unit of the law].
double friction_half_width(double speed_rad_s, double load_norm, double temperature_degC) {
  return friction::half_width(law(), std::bit_cast<friction::Uncertainty>(uncertainty), speed_rad_s, load_norm,
                              temperature_degC);
}

/// Where the page writes a joint that repeats its work cycle, and how many bytes it has.
void* warm_up_numbers() { return &joint; }
int warm_up_size() { return sizeof joint; }

/// Begins its warm-up.
void warm_up_begin(double ambient_degC, double standing_min_h) {
  warming = render::kernel::begin(joint, ambient_degC, standing_min_h);
}
/// Advances it by `cycles` times the duration of a cycle; its temperature then [degC].
double warm_up_work(int cycles) {
  render::kernel::work(joint, cycles, warming);
  return warming.temperature_degC();
}
}
