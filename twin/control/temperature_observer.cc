#include <algorithm>
#include <cmath>

#include <tribotwin/twin/control/temperature_observer.hpp>

namespace tribotwin::twin {

TemperatureObserver::TemperatureObserver(drive::Drive drive, const TemperatureObserverOptions& options)
    : drive_(std::move(drive)), options_(options) {
  const thermal::Rise start = thermal::steady_rise(drive_.thermal, options.start_degC - drive_.thermal.T_amb_degC);
  state_ = {start.node_K[0], start.node_K[1], 1};
  // An error of the start is the same in all nodes.
  const Eigen::Vector3d nodes(drive_.thermal.share(0), drive_.thermal.share(1), 0);
  covariance_ = options.start_sigma_K * options.start_sigma_K * nodes * nodes.transpose();
  covariance_(2, 2) = options.model_error * options.model_error;
}

double TemperatureObserver::sigma_K() const {
  return std::sqrt(std::max(0.0, covariance_.topLeftCorner<2, 2>().sum()));
}

double TemperatureObserver::friction_nm(const Input& in, double temperature) const {
  const double w = in.speed_rad_s * drive_.speed_scale();
  const double level =
      drive::level(drive_, friction::at_temperature(drive_.law, temperature), w, in.load_nm / drive_.torque_max_nm)
          .total();
  return std::copysign(level * drive_.torque_scale_nm(), w) + drive_.offset_nm;
}

void TemperatureObserver::update(const Input& in, double dt_s) {
  // Prediction: nodes relax, heat enters with its factor.
  const thermal::Model& model = drive_.thermal;
  const thermal::Decay decay = thermal::decay(model, dt_s);
  const double power_W = (in.friction_nm - drive_.offset_nm) * in.speed_rad_s;
  Eigen::Matrix3d ahead = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 2; ++i) {
    ahead(i, i) = 1 - decay.one_minus_keep[i];
    ahead(i, 2) = decay.one_minus_keep[i] * model.gain_K_J[i] * model.t_s[i] * power_W;
  }
  Eigen::Vector3d ambient(model.share(0) * decay.one_minus_keep[0], model.share(1) * decay.one_minus_keep[1], 0);
  ambient *= in.ambient_degC - model.T_amb_degC;
  // The factor drifts by model_error within the longest time constant, because ambient, cooling and grease change.
  state_ = (ahead * state_ + ambient).eval();
  covariance_ = (ahead * covariance_ * ahead.transpose()).eval();
  covariance_(2, 2) += options_.model_error * options_.model_error * dt_s / model.slowest_s();

  if (!(std::abs(in.speed_rad_s) >= options_.speed_min_rad_s)) return;
  constexpr double step_K = 0.5;
  const double T = temperature_degC(),
               slope = (friction_nm(in, T + step_K) - friction_nm(in, T - step_K)) / (2 * step_K);
  if (slope == 0) return;
  const Eigen::RowVector3d seen(slope, slope, 0);
  // Errors that stay correlated for longer than a step carry less information.
  const double variance =
      options_.friction_sigma_nm * options_.friction_sigma_nm * std::max(1.0, options_.correlation_s / dt_s);
  const Eigen::Vector3d gain = covariance_ * seen.transpose() / (seen * covariance_ * seen.transpose() + variance);
  state_ += gain * (in.friction_nm - friction_nm(in, T));
  const Eigen::Matrix3d rest = Eigen::Matrix3d::Identity() - gain * seen;
  covariance_ = (rest * covariance_ * rest.transpose() + variance * gain * gain.transpose()).eval();
}

}  // namespace tribotwin::twin
