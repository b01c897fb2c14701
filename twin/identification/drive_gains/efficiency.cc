#include <algorithm>
#include <cmath>

#include <tribotwin/twin/identification/drive_gains/efficiency.hpp>

namespace tribotwin::twin::identification {

namespace {

/// Adds the efficiencies of a joint with the loss mu. None where mu may be below -1: no friction is.
void add(const Estimate& mu, std::vector<Efficiency>& out) {
  if (std::isnan(mu.sigma) || mu.low <= -1) return;
  out.push_back({.joint = mu.name,
                 .per_load = mu,
                 .driving = {mu.name, "1", 1 / (1 + mu.value), mu.sigma / std::pow(1 + mu.value, 2), 1 / (1 + mu.high),
                             1 / (1 + mu.low), Status::estimated},
                 .backdriven = {mu.name, "1", 1 - mu.value, mu.sigma, 1 - mu.high, 1 - mu.low, Status::estimated}});
}

}  // namespace

std::vector<Efficiency> transmission_efficiency(const RobotFriction& friction, const DynamicsFit& fit) {
  std::vector<Efficiency> out;
  for (std::size_t j = 0; j < fit.joints.size(); ++j) {
    const JointFriction& f = friction[j];
    if (!f.law().load_dependent || !JointFriction::is_linear(f.law()) || fit.joints[j].samples == 0) continue;
    const auto found = std::ranges::find(fit.friction[j], "Fcl", &Estimate::name);
    if (found == fit.friction[j].end()) continue;
    Estimate mu = *found;
    mu.name = fit.joints[j].name, mu.unit = "1";
    for (double* x : {&mu.value, &mu.sigma, &mu.low, &mu.high}) *x /= f.scales().torque_max_nm;
    add(mu, out);
  }
  return out;
}

std::vector<Efficiency> transmission_efficiency(const DriveGains& gains) {
  std::vector<Efficiency> out;
  for (std::size_t j = 0; j < gains.per_load.size(); ++j)
    if (gains.known(j)) add(gains.per_load[j], out);
  return out;
}

}  // namespace tribotwin::twin::identification
