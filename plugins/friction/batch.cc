// Compiled once per vector width; the width is chosen when the program runs. Sums that may cancel are written without
// fused multiply-add, so that they round like the scalar evaluation.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tribotwin/plugins/friction/batch.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>
#include <hwy/contrib/math/math-inl.h>

#include <algorithm>
#include <cassert>

#include <tribotwin/plugins/friction/batch.hpp>

HWY_BEFORE_NAMESPACE();
namespace tribotwin::friction::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void torque_block(const Family& f, const Range& held, bool load_dependent, const double* speed, const double* load,
                  const double* temperature, double* out, std::size_t count) {
  const hn::ScalableTag<double> d;
  using V = hn::Vec<decltype(d)>;
  const auto set = [&](double x) { return hn::Set(d, x); };
  const V zero = hn::Zero(d), one = set(1), alpha = set(f.alpha);
  const V minus_alpha_log_vl = set(-f.alpha * std::log(f.vl));
  const V minus_alpha_log_vs = set(f.vs == 0 ? 0 : -f.alpha * std::log(std::abs(f.vs)));
  const bool temperature_free = f.B_T == 0 && f.vs_T == 0 && f.F1_T == 0 && f.s_T == 0;

  const auto evaluate = [&](V v_signed, V l, V T) HWY_ATTR {
    const auto number = [&](V x) HWY_ATTR { return hn::IfThenZeroElse(hn::IsNaN(x), x); };
    const V v = hn::Min(hn::Abs(number(v_signed)), set(held.speed_max_rad_s));
    T = hn::Min(hn::Max(number(T), set(held.temperature_min_degC)), set(held.temperature_max_degC));
    const V log_v = hn::Log(d, hn::Max(v, set(1e-300)));

    V total = set(f.A);
    V B = set(f.B);
    V exponent = hn::MulAdd(alpha, log_v, minus_alpha_log_vs);
    auto vanishes = hn::Eq(set(f.vs), zero);
    if (f.B_T != 0) B = hn::MulAdd(set(f.B_T), T, B);
    if (f.vs_T != 0) {
      const V vs = hn::Abs(hn::MulAdd(set(f.vs_T), T, set(f.vs)));
      vanishes = hn::Eq(vs, zero);
      exponent = hn::Mul(alpha, hn::Sub(log_v, hn::Log(d, hn::IfThenElse(vanishes, one, vs))));
    }
    const auto fading = [&](V log_x) HWY_ATTR {
      return hn::Exp(d, hn::Neg(hn::Min(hn::Exp(d, hn::Min(log_x, set(700))), set(750))));
    };
    if (load_dependent) {
      l = hn::Min(hn::Abs(number(l)), set(held.load_max));
      total = hn::MulAdd(set(f.A_l), l, total);
      B = hn::MulAdd(set(f.B_l), l, B);
      if (f.C_l != 0)
        total = hn::MulAdd(hn::Mul(set(f.C_l), l), fading(hn::MulAdd(alpha, log_v, minus_alpha_log_vl)), total);
    }
    if (f.B != 0 || f.B_T != 0 || f.B_l != 0)
      total = hn::MulAdd(B, hn::IfThenZeroElse(vanishes, fading(exponent)), total);
    V slope = set(f.F1);
    if (f.F1_T != 0) slope = hn::MulAdd(set(f.F1_T), hn::Exp(d, hn::Mul(T, set(-1 / f.T_V))), slope);
    slope = hn::Add(hn::Mul(v, hn::Add(hn::Mul(v, set(f.F3)), set(f.F2))), slope);
    total = hn::MulAdd(v, slope, total);
    if (f.Fb != 0) total = hn::MulAdd(set(f.Fb), hn::Exp(d, hn::Mul(set(f.beta), log_v)), total);
    if (f.s_T != 0) total = hn::Mul(total, hn::Max(zero, hn::Add(hn::Mul(set(f.s_T), hn::Sub(T, set(f.s_T0))), one)));
    total = hn::Max(total, zero);
    return hn::IfThenElseZero(hn::Gt(v, zero), hn::CopySign(total, v_signed));
  };

  const std::size_t lanes = hn::Lanes(d);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes)
    hn::StoreU(evaluate(hn::LoadU(d, speed + i), load_dependent ? hn::LoadU(d, load + i) : zero,
                        temperature_free ? zero : hn::LoadU(d, temperature + i)),
               d, out + i);
  if (i == count) return;
  HWY_ALIGN double v[HWY_MAX_BYTES / sizeof(double)] = {}, l[HWY_MAX_BYTES / sizeof(double)] = {},
                   T[HWY_MAX_BYTES / sizeof(double)] = {};
  std::copy(speed + i, speed + count, v);
  std::copy(load + i, load + count, l);
  std::copy(temperature + i, temperature + count, T);
  hn::Store(evaluate(hn::Load(d, v), hn::Load(d, l), hn::Load(d, T)), d, v);
  std::copy(v, v + (count - i), out + i);
}

}  // namespace tribotwin::friction::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace tribotwin::friction {

HWY_EXPORT(torque_block);

Eigen::ArrayXd torque(const Law& law, const Eigen::Ref<const Eigen::ArrayXd>& speed_rad_s,
                      const Eigen::Ref<const Eigen::ArrayXd>& load_norm,
                      const Eigen::Ref<const Eigen::ArrayXd>& temperature_degC) {
  assert(speed_rad_s.size() == load_norm.size() && speed_rad_s.size() == temperature_degC.size());
  Eigen::ArrayXd torque(speed_rad_s.size());
  HWY_DYNAMIC_DISPATCH(torque_block)
  (law.family, held_range(law), law.info->load_dependent, speed_rad_s.data(), load_norm.data(), temperature_degC.data(),
   torque.data(), static_cast<std::size_t>(torque.size()));
  return torque;
}

}  // namespace tribotwin::friction
#endif
