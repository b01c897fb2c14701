#pragma once

#include "formula.hpp"

/// Private to batch.cc: what the kernels are given. No other headers; see formula.hpp.
namespace tribotwin::friction {

struct KernelLaw {
  GeneralLaw numbers;
  formula::Coefficients coefficients;  ///< those that no temperature changes or, where none does, all
  double speed_max, load_max, temperature_min, temperature_max;
  bool load_dependent, temperature_dependent, all_terms;
};

using Kernel = void(const KernelLaw&, const double* speed, const double* load, const double* temperature, double* out,
                    unsigned long count);
Kernel torque_baseline, torque_avx2;

}  // namespace tribotwin::friction
