#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/experiment_design/dynamics_information.hpp>
#include <tribotwin/twin/identification/experiment_design/typical_friction.hpp>
#include <tribotwin/twin/numerics/cma_es.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::VectorXd;

VectorXd typical_torque(Regressor regressor, const MotionLimits& limits) {
  constexpr int states = 200;
  const Index n = regressor.joints();
  const VectorXd phi = regressor.model_parameters();
  Gaussian gaussian(3);
  const auto within = [&](const VectorXd& low, const VectorXd& high) -> VectorXd {
    return low + gaussian(n)
                     .unaryExpr([](double z) { return 0.5 * std::erfc(-z / std::numbers::sqrt2); })
                     .cwiseProduct(high - low);
  };
  VectorXd squares = VectorXd::Zero(n);
  for (int s = 0; s < states; ++s) {
    const VectorXd q = within(limits.low, limits.high), qd = within(-limits.speed, limits.speed),
                   qdd = within(-limits.acceleration, limits.acceleration);
    squares += (regressor.at(q, qd, qdd) * phi).cwiseAbs2();
  }
  return (squares / states).cwiseSqrt().cwiseMax(1e-9);
}

namespace {

/// Friction [Nm; N] of a joint at speed as a share of its largest, load [-] and temperature.
double friction_at(const mujoco::Binding* drive, double speed, double fastest, double load, double degC,
                   double torque_nm) {
  if (drive) return mujoco::friction_nm(drive->drive, speed, load, degC);
  const double share = speed / fastest;
  return 0.1 * torque_nm *
         (1 + 0.5 * std::exp(-share / 0.05) + share * std::exp(-(degC - 20) / 40) +
          load * (1 + std::exp(-share / 0.1)));
}

Samples samples_of(const JointFriction& f, const mujoco::Binding* drive, double fastest, double torque_nm) {
  const auto& law = f.law();
  const std::vector<double> loads = law.load_dependent ? std::vector{0.05, 0.3, 0.6} : std::vector{0.2},
                            temperatures =
                                law.temperature_dependent ? std::vector{20.0, 30.0, 40.0, 50.0} : std::vector{20.0};
  Samples out;
  std::uint32_t curve = 0;
  for (const double degC : temperatures)
    for (const double load : loads) {
      for (double share = 0.01; share < 1.05; share *= 1.2) {
        out.speed.push_back(share * fastest * f.scales().speed);
        out.friction.push_back(friction_at(drive, share * fastest, fastest, load, degC, torque_nm) / f.scales().torque);
        out.load.push_back(load);
        out.temperature_degC.push_back(degC);
        out.curve.push_back(curve);
      }
      ++curve;
    }
  return out;
}

}  // namespace

Result<std::vector<std::vector<double>>> typical_friction(const mujoco::Model& model, const Regressor& regressor,
                                                          const RobotFriction& friction, const MotionLimits& limits,
                                                          const VectorXd& torque_nm) {
  std::vector<std::vector<double>> out;
  for (std::size_t j = 0; j < friction.size(); ++j) {
    const JointFriction& f = friction[j];
    const auto rotor = static_cast<Index>(j);
    const Index joint = regressor.joint_of(rotor);
    const auto found = std::ranges::find(model.drives(), static_cast<int>(joint), &mujoco::Binding::dof);
    const mujoco::Binding* drive = found == model.drives().end() || regressor.is_coupled(rotor) ? nullptr : &*found;
    auto& values = out.emplace_back(static_cast<std::size_t>(f.size()), 0.0);
    if (drive && drive->drive.law.info == &f.law()) {
      std::ranges::copy(drive->drive.law.values(), values.begin());
      continue;
    }
    const double fastest = fastest_of(regressor, rotor, limits.speed);
    FitOptions options;
    for (const std::string_view name : f.reference_temperatures()) options.fixed.emplace_back(name, 20);
    const auto fitted = fit(
        f.law(), samples_of(f, drive && drive->drive.law.info ? drive : nullptr, fastest, torque_nm(joint)), options);
    if (!fitted)
      return tl::unexpected(work_failed(fmt::format("law '{}' does not take the shape of typical friction: {}",
                                                    f.law().name, fitted.error().message)));
    for (std::size_t p = 0; p < f.law().parameters.size(); ++p) values[p] = fitted->parameters[p].value;
  }
  return out;
}

}  // namespace tribotwin::twin::identification
