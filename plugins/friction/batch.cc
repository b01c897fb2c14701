#include <cassert>

#include <tribotwin/plugins/friction/batch.hpp>
#include <tribotwin/plugins/friction/batch_kernel.hpp>

namespace tribotwin::friction {

VectorWidth best_vector_width() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return VectorWidth::avx2;
#endif
  return VectorWidth::baseline;
}

Eigen::ArrayXd torque(const Law& law, const Eigen::Ref<const Eigen::ArrayXd>& speed_rad_s,
                      const Eigen::Ref<const Eigen::ArrayXd>& load_norm,
                      const Eigen::Ref<const Eigen::ArrayXd>& temperature_degC, VectorWidth width) {
  assert(speed_rad_s.size() == load_norm.size() && speed_rad_s.size() == temperature_degC.size());
  const GeneralLaw& f = law.family;
  const Range held = held_range(law);
  // Without a load term vl is a mere default; its power would send exp down libmvec's slow path for tiny results.
  const double vl_pow = f.C_l == 0 ? 0 : std::pow(f.vl, -f.alpha);
  const KernelFamily k{.A = f.A,
                       .A_T = f.A_T,
                       .A_TT = f.A_TT,
                       .A_l = f.A_l,
                       .B = f.B,
                       .B_T = f.B_T,
                       .B_TT = f.B_TT,
                       .B_l = f.B_l,
                       .vs = f.vs,
                       .vs_T = f.vs_T,
                       .vs_TT = f.vs_TT,
                       .vs_pow = std::pow(std::abs(f.vs), -f.alpha),
                       .C_l = f.C_l,
                       .vl_pow = vl_pow,
                       .alpha = f.alpha,
                       .F1 = f.F1,
                       .F1_t = f.F1_t,
                       .F1_tt = f.F1_tt,
                       .F1_T = f.F1_T,
                       .minus_inverse_T_V = -1 / f.T_V,
                       .F2 = f.F2,
                       .F3 = f.F3,
                       .Fb = f.Fb,
                       .Fb_T = f.Fb_T,
                       .beta = f.beta,
                       .beta_T = f.beta_T,
                       .beta_min = exponent_min,
                       .beta_max = exponent_max,
                       .s_T = f.s_T,
                       .s_T0 = f.s_T0,
                       .speed_max = held.speed_max_rad_s,
                       .load_max = held.load_max,
                       .temperature_min = held.temperature_min_degC,
                       .temperature_max = held.temperature_max_degC,
                       .load_dependent = law.info->load_dependent,
                       .temperature_dependent = law.info->temperature_dependent};
  Eigen::ArrayXd torque(speed_rad_s.size());
  (width == VectorWidth::avx2 ? torque_avx2 : torque_baseline)(k, speed_rad_s.data(), load_norm.data(),
                                                               temperature_degC.data(), torque.data(),
                                                               static_cast<unsigned long>(torque.size()));
  return torque;
}

}  // namespace tribotwin::friction
