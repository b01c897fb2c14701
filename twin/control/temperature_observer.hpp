#pragma once

#include <Eigen/Core>

#include <tribotwin/plugins/drive/drive.hpp>

namespace tribotwin::twin {

struct TemperatureObserverOptions {
  double start_degC = 25;
  double start_sigma_K = 10;
  /// Relative error, 1 sigma, of the thermal model's heat and thus of its steady rise.
  double model_error = 0.1;
  double friction_sigma_nm = 1;   ///< error of a measured friction torque, arm side, 1 sigma
  double correlation_s = 1;       ///< errors this far apart count as independent
  double speed_min_rad_s = 0.01;  ///< of the joint; friction at lower speeds is not used
};

/// Lubricant temperature of a joint without a sensor: the thermal model of its drive, corrected by the difference
/// between measured friction and the law (an extended Kalman filter over the model's nodes and the factor of its heat).
/// Where the law does not depend on temperature, as beyond the edge of its range, the estimate is that of the model
/// alone, and sigma grows accordingly. The RH380-N study names such an observer as future work.
class TemperatureObserver {
 public:
  /// The drive's thermal model must be of first or second order.
  TemperatureObserver(drive::Drive drive, const TemperatureObserverOptions& options);

  struct Input {
    double speed_rad_s;  ///< of the joint
    double load_nm;      ///< gear torque, arm side, signed
    double friction_nm;  ///< measured: motor torque less rigid-body torque, arm side, signed
    double ambient_degC;
  };
  void update(const Input& input, double dt_s);

  double temperature_degC() const { return drive_.thermal.T_amb_degC + state_[0] + state_[1]; }
  double sigma_K() const;

 private:
  double friction_nm(const Input& input, double temperature_degC) const;

  drive::Drive drive_;
  TemperatureObserverOptions options_;
  Eigen::Vector3d state_;  ///< rise of the two nodes [K]; heat over what the model says [-]
  Eigen::Matrix3d covariance_;
};

}  // namespace tribotwin::twin
