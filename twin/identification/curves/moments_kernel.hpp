#pragma once

#include <tribotwin/plugins/friction/formula.hpp>

/// The kernels of basis.cc, free of other headers for the reason given in plugins/friction/formula.hpp.
namespace tribotwin::twin::identification {

/// Columns, one number per sample each: those of friction::formula::columns (the terms of the general law, then their
/// slopes by its shape numbers), the terms by s_T, the measured friction.
inline constexpr int linear_columns = friction::formula::term_count, col_scaled = friction::formula::columns.count,
                     col_y = col_scaled + linear_columns, column_count = col_y + 1;

struct KernelSamples {
  const double *speed, *load, *temperature, *friction, *weight;  ///< weight may be null
  unsigned long count;
};

/// Adds the products of all pairs of the `used` columns (col_y last) to the lower triangle of sums[used_count *
/// used_count].
void moments_baseline(const KernelSamples&, const friction::GeneralLaw&, const int* used, int used_count, double* sums);
void moments_avx2(const KernelSamples&, const friction::GeneralLaw&, const int* used, int used_count, double* sums);
void moments_avx512(const KernelSamples&, const friction::GeneralLaw&, const int* used, int used_count, double* sums);

/// out = friction - sum of linear[k] * column k.
void residuals_baseline(const KernelSamples&, const friction::GeneralLaw&, const int* used, int used_count,
                        const double* linear, double* out);
void residuals_avx2(const KernelSamples&, const friction::GeneralLaw&, const int* used, int used_count,
                    const double* linear, double* out);
void residuals_avx512(const KernelSamples&, const friction::GeneralLaw&, const int* used, int used_count,
                      const double* linear, double* out);

}  // namespace tribotwin::twin::identification
