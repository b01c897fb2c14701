#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/control/momentum_observer.hpp>

namespace tribotwin::twin {

/// The external torque on each joint of an arm without a force sensor, from motor torques, motion and the temperature
/// of each gear. A generalised-momentum observer per joint over the engine's rigid-body model, with the friction of the
/// drives' laws at the present speed, load and temperature.
class ExternalTorque {
 public:
  /// `gain_1_s`: 1 / time constant of the estimate. Every dof of the model must have a drive.
  /// Fails with the name of the joint that has none.
  static Result<ExternalTorque> make(std::shared_ptr<const mujoco::Model> model, double gain_1_s);

  /// One control period; spans per drive, arm side: position [rad], speed [rad/s], motor torque since the last call
  /// [Nm], lubricant temperature [degC].
  void update(std::span<const double> position_rad, std::span<const double> speed_rad_s,
              std::span<const double> torque_nm, std::span<const double> temperature_degC, double dt_s);

  /// Per drive [Nm], positive in the direction of the joint.
  std::span<const double> torque_nm() const { return external_nm_; }
  /// Whether the joint slides. At standstill friction balances any torque up to breakaway, and the estimate is
  /// uncertain by +- the breakaway torque.
  bool slides(std::size_t drive) const { return slides_[drive]; }
  /// Force [N] and torque [Nm] at a site, world axes, that explain the joints' torques best in the least-squares sense.
  std::array<double, 6> wrench(int site);

 private:
  ExternalTorque(std::shared_ptr<const mujoco::Model> model, double gain_1_s);
  std::shared_ptr<const mujoco::Model> model_;
  mujoco::DataPtr data_;
  std::vector<MomentumObserver> observers_;
  std::vector<double> external_nm_, momentum_, speed_, load_nm_;
  std::vector<double> step_, moved_;  ///< per dof
  std::vector<bool> slides_;
  bool fresh_ = true;
};

}  // namespace tribotwin::twin
