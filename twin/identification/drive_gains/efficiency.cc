#include <algorithm>
#include <cmath>

#include <tribotwin/twin/identification/drive_gains/efficiency.hpp>

namespace tribotwin::twin::identification {

std::vector<Efficiency> transmission_efficiency(const RobotFriction& friction, const DynamicsFit& fit) {
  std::vector<Efficiency> out;
  for (std::size_t j = 0; j < fit.joints.size(); ++j) {
    const JointFriction& f = friction[j];
    if (!f.law().load_dependent || !JointFriction::is_linear(f.law()) || fit.joints[j].samples == 0) continue;
    const auto found = std::ranges::find(fit.friction[j], "Fcl", &Estimate::name);
    if (found == fit.friction[j].end() || std::isnan(found->sigma)) continue;
    const double load = f.scales().torque_max_nm, mu = found->value / load, sigma = found->sigma / load,
                 low = found->low / load, high = found->high / load;
    Efficiency e{.joint = fit.joints[j].name,
                 .per_load = {"per_load", "1", mu, sigma, low, high, Status::estimated},
                 .driving = {},
                 .backdriven = {"backdriven", "1", 1 - mu, sigma, 1 - high, 1 - low, Status::estimated}};
    // 1 / (1 + mu) is one only while mu is above -1: less is no friction at all.
    if (low <= -1) continue;
    e.driving = {"driving",      "1",           1 / (1 + mu),     sigma / std::pow(1 + mu, 2),
                 1 / (1 + high), 1 / (1 + low), Status::estimated};
    out.push_back(std::move(e));
  }
  return out;
}

}  // namespace tribotwin::twin::identification
