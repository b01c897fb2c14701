#pragma once

#include <span>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>

namespace tribotwin::twin::identification {

/// Lubricant temperature and friction of a joint without a temperature sensor, Pagani Algorithm 1: the thermal model,
/// Pagani (3), integrates the heat of the friction at the current temperature. The step is exact for constant heat
/// (plugins/thermal). control/temperature_observer.hpp also corrects by measured torque.
class TemperatureEstimator {
 public:
  /// A temperature-dependent law with its parameters, a thermal model of first or second order, and the start
  /// temperature, distributed over the nodes as after a long warm-up.
  TemperatureEstimator(JointFriction friction, std::vector<double> parameters, const thermal::Model& model,
                       double start_degC);

  /// Friction [Nm; N], arm side, at the current temperature; 0 at rest. Speed of the joint [rad/s; m/s], load of the
  /// gear [Nm; N].
  double friction(double speed, double load) const { return friction_at(speed, load, temperature_degC()); }
  /// Advances by dt_s >= 0 at constant speed and load, or at constant heat [W].
  void update(double speed, double load, double dt_s) { heat(friction(speed, load) * speed, dt_s); }
  void heat(double power_w, double dt_s);

  /// Without its offset, which heats nothing.
  double friction_at(double speed, double load, double temperature_degC) const;
  double temperature_degC() const { return model_.T_amb_degC + rise_.total_K(); }
  const thermal::Model& model() const { return model_; }

 private:
  JointFriction friction_;
  std::vector<double> parameters_;
  thermal::Model model_;
  thermal::Decay decay_;
  thermal::Rise rise_;
};

/// Sets the motion's temperatures by TemperatureEstimator; `models` and `start_degC` per joint. Each file begins at
/// `start_degC`; in a gap between samples the robot is assumed to move on as before the gap.
void estimate_temperatures(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                           const RobotParameters& parameters, std::span<const thermal::Model> models,
                           std::span<const double> start_degC, JointMotion& motion, unsigned threads);

/// fit_dynamics of a motion without recorded temperatures, by fixed-point iteration: friction determines temperatures,
/// temperatures determine friction. Each file begins at the models' T_amb. Leaves the temperatures in `motion`.
/// `friction` depends on temperature. Errors as in fit_dynamics.
Result<DynamicsFit> fit_warming_dynamics(const Regressor& regressor, const BaseParameters& base,
                                         const RobotFriction& friction, std::span<const thermal::Model> models,
                                         JointMotion& motion, const DynamicsOptions& options = {});

}  // namespace tribotwin::twin::identification
