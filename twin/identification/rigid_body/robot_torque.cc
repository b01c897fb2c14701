#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

Result<RobotFriction> robot_friction(const mujoco::Model& model, const Regressor& regressor,
                                     const friction::LawInfo& law, Directional directional,
                                     std::span<const double> torque_max_nm) {
  RobotFriction out;
  for (Index j = 0; j < regressor.joints(); ++j) {
    JointFriction::Scales scales;
    const auto drive = std::ranges::find(model.drives(), static_cast<int>(j), &mujoco::Binding::dof);
    if (drive != model.drives().end()) {
      scales.torque_max_nm = drive->drive.torque_max_nm;
      if (law.side == friction::Side::motor) scales.speed = drive->drive.gear_ratio;
    } else if (!torque_max_nm.empty()) {
      scales.torque_max_nm = torque_max_nm[static_cast<std::size_t>(j)];
    } else if (law.normalised || law.load_dependent) {
      return tl::unexpected(
          fmt::format("law '{}' depends on load or normalised torque, but joint {} has no tribotwin.drive with "
                      "gear_ratio and torque_max_nm in the model",
                      law.name, regressor.joint_name(j)));
    }
    if (law.normalised) scales.torque = scales.torque_max_nm;
    out.emplace_back(law, scales, directional);
  }
  return out;
}

MatrixXd predicted_torque(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                          const RobotParameters& parameters, const JointMotion& motion, unsigned threads) {
  constexpr Index chunk = 4096;
  MatrixXd torque(regressor.joints(), motion.size());
  const VectorXd armature = regressor.model_parameters().tail(regressor.joints());
  in_parallel(static_cast<std::size_t>((motion.size() + chunk - 1) / chunk), threads, [&](std::size_t part) {
    Regressor own = regressor;
    const Index first = static_cast<Index>(part) * chunk;
    for (Index i = first; i < std::min(first + chunk, motion.size()); ++i) {
      torque.col(i) =
          own.at(motion.q.col(i), motion.qd.col(i), motion.qdd.col(i))(Eigen::all, base.independent) * parameters.base;
      for (Index j = 0; j < regressor.joints(); ++j)
        if (const auto at = static_cast<std::size_t>(j); motion.qd(j, i) != 0)
          torque(j, i) += friction[at].filtered_torque(parameters.friction[at], motion.qd(j, i), motion.direction(j, i),
                                                       torque(j, i) - armature(j) * motion.qdd(j, i),
                                                       motion.temperature_degC(j, i));
    }
  });
  return torque;
}

MatrixXd gear_load(const Regressor& regressor, const BaseParameters& base, const VectorXd& parameters,
                   const JointMotion& motion, unsigned threads) {
  RobotFriction none;
  for (Index j = 0; j < regressor.joints(); ++j) none.emplace_back(coulomb_viscous(), JointFriction::Scales{});
  MatrixXd load = predicted_torque(
      regressor, base, none, {.base = parameters, .friction = std::vector<std::vector<double>>(none.size(), {0, 0})},
      motion, threads);
  load -= regressor.model_parameters().tail(regressor.joints()).asDiagonal() * motion.qdd;
  return load;
}

}  // namespace tribotwin::twin::identification
