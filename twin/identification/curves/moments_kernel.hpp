#pragma once

/// The kernels of basis.cc, free of other headers for the reason given in plugins/friction/batch_kernel.inc.
namespace tribotwin::twin::identification {

/// Columns, one number per sample each. First the linear terms of the family, then their derivatives by its nonlinear
/// numbers; those that coincide are one column.
enum Column : int {
  col_A,
  col_A_T,
  col_A_TT,
  col_A_l,
  col_B,
  col_B_T,
  col_B_TT,
  col_B_l,
  col_C_l,
  col_F1,
  col_F1_t,
  col_F1_tt,
  col_F1_T,
  col_F2,
  col_F3,
  col_Fb,
  col_Fb_T,
  linear_columns,
  // e^-x of the Stribeck term by its velocity, times 1, T, l, T^2, T l, T^3, T^4, T^2 l
  col_u = linear_columns,
  col_uT,
  col_ul,
  col_uTT,
  col_uTl,
  col_uT3,
  col_uT4,
  col_uTTl,
  col_a,
  col_aT,
  col_al,
  col_aTT,  // ... by alpha, times 1, T, l, T^2
  col_vl,
  col_al2,  // the load term by vl and by alpha
  col_F1_TV,
  col_Fb_TV,  // by T_V
  col_beta,
  col_beta_eT,
  col_betaT,
  col_beta_eTT,
  col_scaled,  // the linear terms by s_T
  col_y = col_scaled + linear_columns,
  column_count
};

struct KernelNumbers {
  double vs, vs_T, vs_TT, vl, alpha, T_V, beta, beta_T, s_T, s_T0;
};

struct KernelSamples {
  const double *speed, *load, *temperature, *friction, *weight;  ///< weight may be null
  unsigned long count;
};

/// Adds the products of all pairs of the `used` columns (col_y last) to the lower triangle of sums[used_count *
/// used_count].
void moments_baseline(const KernelSamples&, const KernelNumbers&, const int* used, int used_count, double* sums);
void moments_avx2(const KernelSamples&, const KernelNumbers&, const int* used, int used_count, double* sums);
void moments_avx512(const KernelSamples&, const KernelNumbers&, const int* used, int used_count, double* sums);

/// out = friction - sum of linear[k] * column k.
void residuals_baseline(const KernelSamples&, const KernelNumbers&, const int* used, int used_count,
                        const double* linear, double* out);
void residuals_avx2(const KernelSamples&, const KernelNumbers&, const int* used, int used_count, const double* linear,
                    double* out);
void residuals_avx512(const KernelSamples&, const KernelNumbers&, const int* used, int used_count, const double* linear,
                      double* out);

}  // namespace tribotwin::twin::identification
