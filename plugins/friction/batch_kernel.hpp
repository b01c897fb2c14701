#pragma once

#include "formula.hpp"

/// Private to batch.cc: the input of the kernels. Includes no other headers; formula.hpp says why.
namespace tribotwin::friction {

struct KernelLaw {
  GeneralLaw numbers;
  formula::Coefficients coefficients;  ///< those independent of temperature; all where the law is
  double speed_max, load_max, temperature_min, temperature_max;
  bool load_dependent, temperature_dependent, all_terms;
};

using Kernel = void(const KernelLaw&, const double* speed, const double* load, const double* temperature, double* out,
                    unsigned long count);
Kernel torque_baseline, torque_avx2;

}  // namespace tribotwin::friction
