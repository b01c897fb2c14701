#pragma once

#include <Eigen/Core>

#include <tribotwin/plugins/friction/law.hpp>

namespace tribotwin::friction {

/// `torque()` over whole arrays, for everything offline: identification, curves, reports.
/// speed_rad_s [n, law's side], load_norm [n], temperature_degC [n] -> torque [n, unit of the law], odd in speed.
/// The vector width is chosen when the program runs; results agree with the scalar evaluation to 1e-12 relative,
/// and with another vector width to the same. Sizes must be equal (asserted).
Eigen::ArrayXd torque(const Law& law, const Eigen::Ref<const Eigen::ArrayXd>& speed_rad_s,
                      const Eigen::Ref<const Eigen::ArrayXd>& load_norm,
                      const Eigen::Ref<const Eigen::ArrayXd>& temperature_degC);

}  // namespace tribotwin::friction
