#pragma once

/// Private to batch.cc: what the kernels are given. No includes; see batch_kernel.inc.
namespace tribotwin::friction {

struct KernelFamily {
  double A, A_T, A_TT, A_l, B, B_T, B_TT, B_l, vs, vs_T, vs_TT, vs_pow, C_l, vl_pow, alpha, F1, F1_t, F1_tt, F1_T,
      minus_inverse_T_V, F2, F3;
  double Fb, Fb_T, beta, beta_T, beta_min, beta_max, s_T, s_T0;
  double speed_max, load_max, temperature_min, temperature_max;
  bool load_dependent, temperature_dependent;
};

using Kernel = void(const KernelFamily&, const double* speed, const double* load, const double* temperature,
                    double* out, unsigned long count);
Kernel torque_baseline, torque_avx2;

}  // namespace tribotwin::friction
