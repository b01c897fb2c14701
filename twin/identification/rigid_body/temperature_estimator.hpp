#pragma once

#include <span>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>

namespace tribotwin::twin::identification {

/// Lubricant temperature and friction of a joint that has no thermometer, P5 Algorithm 1: friction at the temperature
/// so far makes the heat that the thermal model, P5 (3), turns into the next temperature. The model's step is the exact
/// one for a heat that is constant over it (plugins/thermal). control/temperature_observer.hpp corrects such a
/// temperature by measured torque.
class TemperatureEstimator {
 public:
  /// A law that depends on temperature with its parameters, a thermal model of first or second order, and the
  /// temperature at the beginning, on the nodes as a long warm-up would leave it.
  TemperatureEstimator(JointFriction friction, std::vector<double> parameters, const thermal::Model& model,
                       double start_degC);

  /// Friction [Nm; N], arm side, at the temperature of now; 0 at rest. Speed of the joint [rad/s; m/s], load of the
  /// gear [Nm; N].
  double friction(double speed, double load) const { return friction_at(speed, load, temperature_degC()); }
  /// Keeps that speed and load for dt_s >= 0.
  void update(double speed, double load, double dt_s) { heat(friction(speed, load) * speed, dt_s); }
  void heat(double power_w, double dt_s);

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

/// Sets the motion's temperatures by TemperatureEstimator; `models` per joint. Each file begins at `start_degC`, per
/// joint; in a gap between its samples the robot is taken to go on as in the stretch before.
void estimate_temperatures(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                           const RobotParameters& parameters, std::span<const thermal::Model> models,
                           std::span<const double> start_degC, JointMotion& motion, unsigned threads);

/// fit_dynamics of a motion whose temperatures nobody recorded: friction makes temperatures, and these the friction,
/// until they agree. Each file begins at the models' T_amb. Leaves the temperatures in `motion`. `friction` depends on
/// temperature.
Result<DynamicsFit> fit_warming_dynamics(const Regressor& regressor, const BaseParameters& base,
                                         const RobotFriction& friction, std::span<const thermal::Model> models,
                                         JointMotion& motion, const DynamicsOptions& options = {});

}  // namespace tribotwin::twin::identification
