#include <algorithm>
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
  const Range held = held_range(law);
  const bool rare_term = std::ranges::any_of(
      formula::terms, [&](const formula::Term& term) { return term.rare && law.general_law.*term.number != 0; });
  // The exponent beta alone has no effect without its term.
  const bool rare_number = std::ranges::any_of(formula::shape_numbers, [&](const formula::ShapeNumber& row) {
    return row.rare && row.quantity != formula::power_exponent && law.general_law.*row.number != 0;
  });
  const KernelLaw kernel{.numbers = law.general_law,
                         .coefficients = at_temperature(law, 0).coefficients,
                         .speed_max = held.speed_max_rad_s,
                         .load_max = held.load_max,
                         .temperature_min = held.temperature_min_degC,
                         .temperature_max = held.temperature_max_degC,
                         .load_dependent = law.info->load_dependent,
                         .temperature_dependent = law.info->temperature_dependent,
                         .all_terms = rare_term || rare_number};
  Eigen::ArrayXd torque(speed_rad_s.size());
  (width == VectorWidth::avx2 ? torque_avx2 : torque_baseline)(kernel, speed_rad_s.data(), load_norm.data(),
                                                               temperature_degC.data(), torque.data(),
                                                               static_cast<unsigned long>(torque.size()));
  return torque;
}

}  // namespace tribotwin::friction
