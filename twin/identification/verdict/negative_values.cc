#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/identification/verdict/negative_values.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Friction of a joint that coupled motors turn is what theirs leaves.
bool beside_coupled_motor(const Regressor& regressor, Index rotor) {
  return !regressor.is_coupled(rotor) && std::ranges::any_of(regressor.motors(), [&](const CoupledMotor& motor) {
    return motor.turns_with(rotor) != 0;
  });
}

/// A linear combination of a rotor's friction parameters, named after them.
struct Combination {
  const char* what;
  std::vector<std::pair<std::string, double>> of;
  std::string name, cause;
};

std::vector<Combination> combinations(const JointFriction& friction, double top_speed) {
  constexpr auto drives = "friction would drive the motion: is the torque late, of the wrong sign, or the joint slow?",
                 falls = "friction falls with speed in this motion (another law?), or the torque is late",
                 lighter = "friction falls with load in this motion: the load may not be what these joints feel";
  const double vs = friction.held(friction.law_size() - 1).value_or(0);
  std::vector<Combination> all;
  if (vs > 0) {
    const double rest = std::exp(-top_speed / vs);
    all.push_back({"friction at standstill", {{"Fc", 1}, {"Fs", 1}}, "Fc + Fs", drives});
    all.push_back({"slope of friction at top speed",
                   {{"Fv", 1}, {"Fs", -rest / vs}},
                   fmt::format("Fv - {:.2g} Fs", rest / vs),
                   falls});
  } else {
    all.push_back({"Coulomb friction", {{"Fc", 1}}, "Fc", drives});
    all.push_back({"viscous friction", {{"Fv", 1}}, "Fv", falls});
  }
  all.push_back({"growth of friction with load", {{"Fcl", 1}}, "Fcl", lighter});
  return all;
}

/// Its value, with the sigma of all its parameters together; `covariance` may be empty for a combination of one.
/// Nothing where a parameter is none of the law's.
bool evaluate(const Combination& one, const std::vector<Estimate>& estimates, const MatrixXd& covariance,
              Negative& out) {
  VectorXd by = VectorXd::Zero(std::ssize(estimates));
  for (const auto& [name, factor] : one.of) {
    const auto at = std::ranges::find(estimates, name, &Estimate::name);
    if (at == estimates.end()) return false;
    by(at - estimates.begin()) = factor;
    out.value += factor * at->value;
    if (factor == 1) out.unit = at->unit, out.sigma = at->sigma;
  }
  if (covariance.size() == 0) return one.of.size() == 1 || std::isnan(out.sigma);
  double variance = 0;
  for (Index r = 0; r < by.size(); ++r)
    for (Index c = 0; c < by.size(); ++c)
      if (by(r) != 0 && by(c) != 0) variance += by(r) * by(c) * covariance(r, c);
  out.sigma = std::sqrt(variance);
  return true;
}

/// Whether a rotor's friction was sought, in a law that tells its parts, and is all that acts beside its joint.
bool tells_friction(const Regressor& regressor, const RobotFriction& friction, const DynamicsFit& fit, Index rotor) {
  const auto at = static_cast<std::size_t>(rotor);
  const bool unknown = !regressor.is_coupled(rotor) && fit.joints[at].samples == 0;
  return !unknown && JointFriction::is_linear(friction[at].law()) && !beside_coupled_motor(regressor, rotor);
}

MatrixXd friction_covariance_of(const DynamicsFit& fit, std::size_t rotor) {
  return rotor < fit.friction_covariance.size() ? fit.friction_covariance[rotor] : MatrixXd();
}

double top_speed_of(const std::vector<JointRange>& ranges, Index joint) {
  const Span& speed = ranges[static_cast<std::size_t>(joint)][static_cast<std::size_t>(Ranged::speed)];
  return speed.known() ? std::max(std::abs(speed.low), std::abs(speed.high)) : 0;
}

}  // namespace

std::vector<Negative> negative_values(const Regressor& regressor, const RobotFriction& friction, const DynamicsFit& fit,
                                      const std::vector<JointRange>& ranges) {
  std::vector<Negative> all;
  for (const Estimate& e : fit.base)
    if (e.name.ends_with(".Ia") && e.value < 0)
      all.push_back({e.name, "rotor inertia", e.value, e.sigma, e.unit,
                     "were torques measured behind the gear (--no-rotor-inertia), or are they late?"});
  for (Index r = 0; r < regressor.rotors(); ++r) {
    const auto at = static_cast<std::size_t>(r);
    if (!tells_friction(regressor, friction, fit, r)) continue;
    const MatrixXd covariance = friction_covariance_of(fit, at);
    for (const Combination& one : combinations(friction[at], top_speed_of(ranges, regressor.joint_of(r)))) {
      Negative found{
          .parameter = regressor.rotor_name(r) + "." + one.name, .what = one.what, .unit = {}, .cause = one.cause};
      if (evaluate(one, fit.friction[at], covariance, found) && found.value < 0) all.push_back(std::move(found));
    }
  }
  return all;
}

double pooled_friction(const Regressor& regressor, const RobotFriction& friction, const DynamicsFit& fit) {
  constexpr double at_most = 5;
  double sum = 0;
  int count = 0;
  for (Index r = 0; r < regressor.rotors(); ++r) {
    if (!tells_friction(regressor, friction, fit, r)) continue;
    const auto at = static_cast<std::size_t>(r);
    const Combination standstill = combinations(friction[at], 0).front();
    Negative found{.parameter = {}, .what = {}, .unit = {}, .cause = {}};
    if (!evaluate(standstill, fit.friction[at], friction_covariance_of(fit, at), found) || !(found.sigma > 0)) continue;
    sum += std::clamp(found.value / found.sigma, -at_most, at_most);
    ++count;
  }
  return count ? sum / std::sqrt(count) : 0;
}

std::vector<std::string> warnings_of(std::span<const Negative> all) {
  std::vector<std::string> lines;
  for (const Negative& n : all) {
    std::string line = fmt::format("{} {} is {:.3g}", n.what, n.parameter, n.value);
    if (std::isnan(n.sigma))
      line += fmt::format(" {}, held: negative", n.unit);
    else if (n.significant())
      line += fmt::format(" +- {:.2g} {}: negative, {:.1f} sigma below 0; {}", n.sigma, n.unit, -n.value / n.sigma,
                          n.cause);
    else
      line += fmt::format(" +- {:.2g} {}: negative, but 0 within 2 sigma; these data do not tell it from 0", n.sigma,
                          n.unit);
    lines.push_back(std::move(line));
  }
  return lines;
}

}  // namespace tribotwin::twin::identification
