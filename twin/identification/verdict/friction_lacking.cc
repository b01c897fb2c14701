#include <algorithm>
#include <cmath>
#include <iterator>

#include <tribotwin/twin/identification/curves/identifiability.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/identification/verdict/friction_lacking.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index;

/// A joint in motion as its law sees it, thinned.
Samples seen_by_law(const JointFriction& f, const std::vector<double>& parameters, const JointMotion& motion,
                    const Eigen::MatrixXd& gear_load, Index joint) {
  constexpr Index enough = 1000;
  const Index every = std::max<Index>(1, motion.moving.row(joint).count() / enough);
  const double offset = f.offset(parameters);
  Samples s;
  Index seen = 0;
  for (Index i = 0; i < motion.size(); ++i) {
    if (!motion.moving(joint, i) || seen++ % every) continue;
    const double load_nm = gear_load(joint, i), T = motion.temperature_degC(joint, i);
    s.speed.push_back(std::abs(motion.qd(joint, i)) * f.scales().speed);
    s.load.push_back(std::abs(load_nm) / f.scales().torque_max_nm);
    s.temperature_degC.push_back(T);
    s.friction.push_back((f.torque(parameters, motion.qd(joint, i), load_nm, T) - offset) / f.scales().torque);
  }
  return s;
}

/// Of the torque by position of a joint: its parts are compared with the amplitude of both, as the phase is the zero
/// of the angle's.
std::vector<Lacking> lacking_position(const std::vector<Estimate>& parameters, const Eigen::MatrixXd& covariance) {
  const std::size_t first = parameters.size() - 2;
  Evidence evidence{.parameters = parameters, .covariance = covariance};
  evidence.scale.assign(parameters.size(), 0);
  evidence.scale[first] = evidence.scale[first + 1] = std::hypot(parameters[first].value, parameters[first + 1].value);
  std::vector<Lacking> out;
  for (Lacking& one : lacking(evidence, [](const Estimate&, Lack lack) -> std::string {
         return lack == Lack::no_effect ? "" : "record more of the joint's range";
       }))
    if (one.parameter == parameters[first].name || one.parameter == parameters[first + 1].name)
      out.push_back(std::move(one));
  return out;
}

}  // namespace

std::vector<Lacking> lacking_friction(const Regressor& regressor, const RobotFriction& friction,
                                      const JointMotion& motion, const Eigen::MatrixXd& gear_load,
                                      const DynamicsFit& fit) {
  std::vector<Lacking> all;
  for (Index j = 0; j < regressor.joints(); ++j) {
    const auto k = static_cast<std::size_t>(j);
    const JointFriction& f = friction[k];
    const Samples samples = seen_by_law(f, fit.parameters.friction[k], motion, gear_load, j);
    if (samples.size() == 0 || !std::isfinite(samples.friction.front())) continue;  // its friction is not known
    Estimates own{.parameters = fit.friction[k], .covariance = fit.friction_covariance[k]};
    if (f.directional().position) {  // no part of a curve over speed
      own.parameters.resize(own.parameters.size() - 2);
      own.covariance = own.covariance.topLeftCorner(f.size() - 2, f.size() - 2).eval();
    }
    own.r_squared = 1;
    for (const std::string_view convention : f.reference_temperatures())  // is no result
      for (Estimate& e : own.parameters)
        if (e.name == convention) e.status = Status::fixed;
    const bool slide = regressor.is_slide(j) && f.law().side == friction::Side::arm;
    std::vector<Lacking> of_joint = lacking_of(
        f.law(), samples, own, {}, {}, {.speed = slide ? "m/s" : "rad/s", .offset_per_torque = f.scales().torque});
    if (f.directional().position)
      std::ranges::move(lacking_position(fit.friction[k], fit.friction_covariance[k]), std::back_inserter(of_joint));
    for (Lacking& one : of_joint) {
      one.parameter = regressor.joint_name(j) + "." + one.parameter;
      all.push_back(std::move(one));
    }
  }
  return all;
}

BaseCount count_base(const DynamicsFit& fit) {
  BaseCount count;
  for (const Estimate& e : fit.base) {
    if (e.status != Status::estimated) {
      ++count.held;
      continue;
    }
    ++count.estimated;
    count.wide += !(e.high - e.low <= std::abs(e.value));
  }
  return count;
}

}  // namespace tribotwin::twin::identification
