#pragma once

#include <tribotwin/plugins/friction/law.hpp>

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

inline Numbers numbers_of(const friction::Law& law) {
  return {.law = law.general_law,
          .range = law.range,
          .extrapolates = law.validity == friction::Validity::extrapolate ? 1.0 : 0.0,
          .temperature_dependent = law.info->temperature_dependent ? 1.0 : 0.0,
          .load_dependent = law.info->load_dependent ? 1.0 : 0.0};
}

}  // namespace tribotwin::render::kernel
