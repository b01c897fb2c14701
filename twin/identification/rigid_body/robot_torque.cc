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
  for (Index r = 0; r < regressor.rotors(); ++r) {
    const Index j = regressor.joint_of(r);
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
    Directional beside = directional;
    if (regressor.is_coupled(r)) beside.offset = false;
    beside.position = directional.position && may_depend_on_position(regressor, r);
    out.emplace_back(law, scales, beside);
  }
  return out;
}

bool may_depend_on_position(const Regressor& regressor, Index rotor) {
  return !regressor.is_coupled(rotor) && !regressor.is_slide(regressor.joint_of(rotor));
}

double friction_of(const Regressor& regressor, const RobotFriction& friction, const RobotParameters& parameters,
                   const JointMotion& motion, Index rotor, Index sample, const VectorXd& rigid, double* derivatives) {
  const auto at = static_cast<std::size_t>(rotor);
  const double speed = regressor.speed(rotor, motion.qd.col(sample));
  const Index joint = regressor.joint_of(rotor);
  if (speed == 0 && !derivatives)  // at rest friction is not known, what depends on speed is 0
    return friction[at].offset(parameters.friction[at]) +
           friction[at].position_torque(parameters.friction[at], motion.q(joint, sample), nullptr);
  return friction[at].filtered_torque(parameters.friction[at], speed, motion.direction(rotor, sample),
                                      regressor.load(rotor, rigid, motion.qdd.col(sample)),
                                      motion.temperature_degC(joint, sample), derivatives) +
         friction[at].position_torque(parameters.friction[at], motion.q(joint, sample), derivatives);
}

Index first_column(const Regressor& regressor, int body) {
  const auto& columns = regressor.columns();
  const auto found = std::ranges::find(columns, body, &Regressor::Column::body);
  return found == columns.end() ? -1 : found - columns.begin();
}

MatrixXd carried_torque(const Regressor& regressor, std::span<const std::optional<CarriedBody>> carried,
                        const JointMotion& motion) {
  if (std::ranges::none_of(carried, [](const auto& body) { return body.has_value(); })) return {};
  MatrixXd out = MatrixXd::Zero(regressor.joints(), motion.size());
  Regressor own = regressor;
  for (std::size_t s = 0; s < motion.segments.size(); ++s) {
    const auto& body = carried[motion.file[s]];
    if (!body) continue;
    const Index first = first_column(regressor, body->body);
    for (Index i = motion.segments[s].first; i < motion.segments[s].second; ++i)
      out.col(i) =
          own.at(motion.q.col(i), motion.qd.col(i), motion.qdd.col(i)).middleCols(first, body->parameters.size()) *
          body->parameters;
  }
  return out;
}

MatrixXd predicted_torque(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                          const RobotParameters& parameters, const JointMotion& motion, unsigned threads) {
  constexpr Index chunk = 4096;
  MatrixXd torque(regressor.joints(), motion.size());
  in_parallel(static_cast<std::size_t>((motion.size() + chunk - 1) / chunk), threads, [&](std::size_t part) {
    Regressor own = regressor;
    const Index first = static_cast<Index>(part) * chunk;
    VectorXd rigid;
    for (Index i = first; i < std::min(first + chunk, motion.size()); ++i) {
      rigid =
          own.at(motion.q.col(i), motion.qd.col(i), motion.qdd.col(i))(Eigen::all, base.independent) * parameters.base;
      if (motion.carried_torque.size() > 0) rigid += motion.carried_torque.col(i);
      torque.col(i) = rigid;
      for (Index r = 0; r < regressor.rotors(); ++r) {
        const double f = friction_of(regressor, friction, parameters, motion, r, i, rigid);
        for (Index j = 0; j < regressor.joints(); ++j)
          if (const double turns = regressor.turns(r, j); turns != 0) torque(j, i) += turns * f;
      }
    }
  });
  return torque;
}

MatrixXd gear_load(const Regressor& regressor, const BaseParameters& base, const VectorXd& parameters,
                   const JointMotion& motion, unsigned threads) {
  RobotFriction none;
  for (Index r = 0; r < regressor.rotors(); ++r) none.emplace_back(coulomb_viscous(), JointFriction::Scales{});
  const MatrixXd rigid = predicted_torque(
      regressor, base, none, {.base = parameters, .friction = std::vector<std::vector<double>>(none.size(), {0, 0})},
      motion, threads);
  MatrixXd load(rigid.rows(), rigid.cols());
  for (Index i = 0; i < load.cols(); ++i)
    for (Index j = 0; j < load.rows(); ++j) load(j, i) = regressor.load(j, rigid.col(i), motion.qdd.col(i));
  return load;
}

}  // namespace tribotwin::twin::identification
