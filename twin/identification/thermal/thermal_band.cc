#include <algorithm>
#include <cmath>

#include <tribotwin/twin/identification/thermal/thermal_band.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

Eigen::Map<const VectorXd> vector_of(const std::vector<double>& v) { return {v.data(), std::ssize(v)}; }

/// Of a function's vector by central differences, values x parameters.
template <class Function>
MatrixXd derivatives(const Function& f, const VectorXd& at) {
  MatrixXd out;
  for (Index k = 0; k < at.size(); ++k) {
    const double h = std::max(1e-4 * std::abs(at(k)), 1e-9);
    VectorXd up = at, down = at;
    up(k) += h, down(k) -= h;
    const VectorXd slope = (f(up) - f(down)) / (2 * h);
    if (k == 0) out.resize(slope.size(), at.size());
    out.col(k) = slope;
  }
  return out;
}

/// g' C g for each row g.
VectorXd propagated(const MatrixXd& g, const MatrixXd& covariance) {
  return (g * covariance).cwiseProduct(g).rowwise().sum().cwiseMax(0);
}

WarmBodies bodies_of(const thermal::Model& model) {
  WarmBodies out{.t_s = {}, .gain_K_J = {}, .ambient_degC = model.T_amb_degC};
  for (int i = 0; i < thermal::info(model.order).nodes; ++i) {
    out.t_s.push_back(model.t_s[i]);
    out.gain_K_J.push_back(model.gain_K_J[i]);
  }
  return out;
}

/// Shares of a rise that the bodies have after long constant power.
VectorXd steady_shares(const WarmBodies& bodies) {
  const VectorXd rise = vector_of(bodies.gain_K_J).cwiseProduct(vector_of(bodies.t_s));
  return rise.sum() > 0 ? VectorXd(rise / rise.sum()) : VectorXd::Unit(rise.size(), 0);
}

/// Temperatures [degC] of a session from `first_degC`, of which each body has its share.
VectorXd temperatures(const WarmBodies& bodies, const HeatSession& session, double first_degC, const VectorXd& shares) {
  const auto t_s = vector_of(bodies.t_s), gain = vector_of(bodies.gain_K_J);
  VectorXd rise = shares * (first_degC - bodies.ambient_degC), out(std::ssize(session.time_s));
  out(0) = first_degC;
  for (std::size_t i = 1; i < session.time_s.size(); ++i) {
    const double dt_s = session.time_s[i] - session.time_s[i - 1];
    const VectorXd loss = t_s.unaryExpr([&](double t) { return -std::expm1(-dt_s / t); });
    rise += loss.cwiseProduct(gain.cwiseProduct(t_s) * session.power_w[i] - rise);
    out(static_cast<Index>(i)) = bodies.ambient_degC + rise.sum();
  }
  return out;
}

VectorXd temperatures(const WarmBodies& bodies, const HeatSession& session) {
  return temperatures(bodies, session, session.temperature_degC.front(), steady_shares(bodies));
}

/// Variance of the difference to recorded temperatures by their noise. `kept`: by how much a prediction changes with
/// its first temperature.
VectorXd noise_variance(const CorrelatedNoise& noise, const std::vector<double>& time_s, const VectorXd& kept) {
  VectorXd out(kept.size());
  for (Index i = 0; i < kept.size(); ++i) {
    const double since_s = time_s[static_cast<std::size_t>(i)] - time_s.front();
    const double common =
        noise.correlation_s > 0 ? noise.slow * noise.slow * std::exp(-since_s / noise.correlation_s) : 0;
    out(i) = (1 + kept(i) * kept(i)) * noise.variance() - 2 * kept(i) * common;
  }
  return out;
}

/// The numbers of PARAMS.yaml: thermal::values, then T_amb.
VectorXd numbers_of(const thermal::Model& model) {
  const std::vector<double> values = thermal::values(model);
  VectorXd out(std::ssize(values) + 1);
  out << vector_of(values), model.T_amb_degC;
  return out;
}

thermal::Model with_numbers(const thermal::Model& model, const VectorXd& numbers) {
  return thermal::make_model(model.order, numbers(numbers.size() - 1),
                             {numbers.data(), static_cast<std::size_t>(numbers.size() - 1)});
}

ThermalChain with_numbers(ThermalChain chain, const VectorXd& numbers) {
  chain.exchange_1_s = numbers(0);
  for (std::size_t j = 0; j < chain.joints.size(); ++j) {
    const auto own = numbers.segment(1 + 3 * static_cast<Index>(j), 3);
    chain.gain_K_J[j] = own(0), chain.t_s[j] = own(1), chain.ambient_degC[j] = own(2);
  }
  return chain;
}

/// One session of all joints, without copies of the others.
std::vector<JointHeat> only(std::span<const JointHeat> joints, std::size_t session) {
  std::vector<JointHeat> out;
  for (const auto& joint : joints) out.push_back({joint.name, {joint.sessions[session]}});
  return out;
}

/// By how much the temperatures of a chain change with the first ones, squared and summed.
VectorXd kept_squares(const ThermalChain& chain, std::vector<JointHeat> joints) {
  const VectorXd base = predicted_temperatures(chain, joints, 0).reshaped();
  VectorXd out = VectorXd::Zero(base.size());
  for (auto& joint : joints) {
    double& first = joint.sessions[0].temperature_degC.front();
    first += 1;
    out += (VectorXd(predicted_temperatures(chain, joints, 0).reshaped()) - base).cwiseAbs2();
    first -= 1;
  }
  return out;
}

}  // namespace

std::vector<double> half_width_K(const thermal::Model& model, const ThermalUncertainty& u, const HeatSession& session,
                                 bool seen) {
  const WarmBodies bodies = bodies_of(model);
  const double first_degC = session.temperature_degC.front();
  const VectorXd own = temperatures(bodies, session),
                 kept = temperatures(bodies, session, first_degC + 1, steady_shares(bodies)) - own;
  const MatrixXd g = derivatives(
      [&](const VectorXd& at) { return temperatures(bodies_of(with_numbers(model, at)), session); }, numbers_of(model));
  VectorXd variance = propagated(g, u.covariance) + noise_variance(u.noise, session.time_s, kept) +
                      g.rightCols(1).cwiseAbs2() * u.surroundings.variance(seen);
  if (bodies.t_s.size() == 2)
    variance += (temperatures(bodies, session, first_degC, VectorXd::Unit(2, 0)) -
                 temperatures(bodies, session, first_degC, VectorXd::Unit(2, 1)))
                    .cwiseAbs2() /
                12;  // of a uniform distribution between both
  VectorXd slower = VectorXd::Zero(own.size());
  for (const WarmBodies& other : u.slower) slower = slower.cwiseMax((temperatures(other, session) - own).cwiseAbs());
  VectorXd half = (u.sigmas * u.sigmas * variance + slower.cwiseAbs2()).cwiseSqrt();
  half(0) = 0;
  return {half.begin(), half.end()};
}

MatrixXd half_widths_K(const ThermalChain& chain, const ThermalUncertainty& u, std::span<const JointHeat> joints,
                       std::size_t session, bool seen) {
  const std::vector<JointHeat> own = only(joints, session);
  const MatrixXd g = derivatives(
      [&](const VectorXd& at) { return VectorXd(predicted_temperatures(with_numbers(chain, at), own, 0).reshaped()); },
      numbers_of(chain));
  VectorXd by_surroundings = VectorXd::Zero(g.rows());  // which are warmer for all joints
  for (Index k = 3; k < g.cols(); k += 3) by_surroundings += g.col(k);
  const VectorXd variance = propagated(g, u.covariance) +
                            u.noise.variance() * (kept_squares(chain, own) + VectorXd::Ones(g.rows())) +
                            by_surroundings.cwiseAbs2() * u.surroundings.variance(seen);
  MatrixXd half = u.sigmas * variance.cwiseSqrt().reshaped(std::ssize(own), g.rows() / std::ssize(own));
  half.col(0).setZero();
  return half;
}

}  // namespace tribotwin::twin::identification
