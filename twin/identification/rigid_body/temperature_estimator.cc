#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/identification/rigid_body/temperature_estimator.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd;

/// One segment of motion with the ends that the filter took, where the first and last sample hold on.
struct Stretch {
  Index first, last;  ///< past the last sample
  double begin_s, end_s;
};

/// Advances by `duration_s` at the mean power of a stretch, linearised in the temperature.
void bridge(TemperatureEstimator& joint, const Stretch& stretch, const JointMotion& motion, Index j,
            const MatrixXd& load, double duration_s) {
  const auto mean_power = [&](double temperature) {
    double work = 0;
    for (Index i = stretch.first; i < stretch.last; ++i) {
      const double begin = i == stretch.first ? stretch.begin_s : motion.time_s[static_cast<std::size_t>(i)],
                   end = i + 1 == stretch.last ? stretch.end_s : motion.time_s[static_cast<std::size_t>(i) + 1];
      work += joint.friction_at(motion.qd(j, i), load(j, i), temperature) * motion.qd(j, i) * (end - begin);
    }
    return work / (stretch.end_s - stretch.begin_s);
  };
  const double T = joint.temperature_degC(), power = mean_power(T), slope = mean_power(T + 1) - power;
  const thermal::Model& model = joint.model();
  const double steps = std::ceil(4 * duration_s / model.fastest_s());
  for (double k = 0; k < steps; ++k)
    joint.heat(std::max(0.0, power + slope * (joint.temperature_degC() - T)), duration_s / steps);
}

}  // namespace

TemperatureEstimator::TemperatureEstimator(JointFriction friction, std::vector<double> parameters,
                                           const thermal::Model& model, double start_degC)
    : friction_(std::move(friction)),
      parameters_(std::move(parameters)),
      model_(model),
      rise_(thermal::steady_rise(model, start_degC - model.T_amb_degC)) {}

double TemperatureEstimator::friction_at(double speed, double load, double temperature_degC) const {
  return speed == 0 ? 0 : friction_.torque(parameters_, speed, load, temperature_degC) - friction_.offset(parameters_);
}

void TemperatureEstimator::heat(double power_w, double dt_s) {
  if (dt_s != decay_.dt_s) decay_ = thermal::decay(model_, dt_s);
  thermal::step(model_, decay_, power_w, 0, rise_);
}

void estimate_temperatures(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                           const RobotParameters& parameters, std::span<const thermal::Model> models,
                           std::span<const double> start_degC, JointMotion& motion, unsigned threads) {
  const MatrixXd load = gear_load(regressor, base, parameters.base, motion, threads);
  for (Index j = 0; j < regressor.joints(); ++j) {
    const auto at = static_cast<std::size_t>(j);
    const TemperatureEstimator cold(friction[at], parameters.friction[at], models[at], start_degC[at]);
    TemperatureEstimator joint = cold;
    for (std::size_t s = 0; s < motion.segments.size(); ++s) {
      const auto stretch_of = [&](std::size_t k) {
        const auto& [first, last] = motion.segments[k];
        return Stretch{first, last, motion.time_s[static_cast<std::size_t>(first)] - motion.edge_s[k],
                       motion.time_s[static_cast<std::size_t>(last) - 1] + motion.edge_s[k]};
      };
      const Stretch now = stretch_of(s);
      if (s == 0 || motion.file[s] != motion.file[s - 1])
        joint = cold;
      else if (const Stretch before = stretch_of(s - 1); now.begin_s > before.end_s)
        bridge(joint, before, motion, j, load, now.begin_s - before.end_s);
      joint.update(motion.qd(j, now.first), load(j, now.first), motion.edge_s[s]);
      for (Index i = now.first; i < now.last; ++i) {
        motion.temperature_degC(j, i) = joint.temperature_degC();
        const double end = i + 1 == now.last ? now.end_s : motion.time_s[static_cast<std::size_t>(i) + 1];
        joint.update(motion.qd(j, i), load(j, i), end - motion.time_s[static_cast<std::size_t>(i)]);
      }
    }
  }
}

Result<DynamicsFit> fit_warming_dynamics(const Regressor& regressor, const BaseParameters& base,
                                         const RobotFriction& friction, std::span<const thermal::Model> models,
                                         JointMotion& motion, const DynamicsOptions& options) {
  constexpr int max_rounds = 10;
  constexpr double agree_K = 0.1;
  std::vector<double> start_degC;
  for (const auto& m : models) start_degC.push_back(m.T_amb_degC);
  motion.temperature_degC.colwise() =
      Eigen::Map<const Eigen::VectorXd>(start_degC.data(), static_cast<Index>(start_degC.size()));
  for (int round = 0;; ++round) {
    auto fit = fit_dynamics(regressor, base, friction, motion, options);
    if (!fit) return fit;
    const MatrixXd before = motion.temperature_degC;
    estimate_temperatures(regressor, base, friction, fit->parameters, models, start_degC, motion, options.threads);
    const double change = (motion.temperature_degC - before).cwiseAbs().maxCoeff();
    if (change < agree_K) return fit;
    if (round == max_rounds) {
      fit->notes.push_back(fmt::format("temperatures still move by {:.2g} K after {} rounds", change, max_rounds));
      return fit;
    }
  }
}

}  // namespace tribotwin::twin::identification
