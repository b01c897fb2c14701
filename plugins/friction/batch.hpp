#pragma once

#include <Eigen/Core>

#include <tribotwin/plugins/friction/law.hpp>

namespace tribotwin::friction {

enum class VectorWidth { baseline, avx2 };

/// The widest vectors that this machine supports.
VectorWidth best_vector_width();

/// `torque()` over whole arrays, for everything offline: identification, curves, reports. speed_rad_s [n, law's side],
/// load_norm [n], temperature_degC [n] -> torque [n, unit of the law], odd in speed. Agrees with the scalar evaluation
/// to 1e-12 relative at every width. Sizes must be equal (asserted), and the machine must support `width`.
Eigen::ArrayXd torque(const Law& law, const Eigen::Ref<const Eigen::ArrayXd>& speed_rad_s,
                      const Eigen::Ref<const Eigen::ArrayXd>& load_norm,
                      const Eigen::Ref<const Eigen::ArrayXd>& temperature_degC,
                      VectorWidth width = best_vector_width());

}  // namespace tribotwin::friction
