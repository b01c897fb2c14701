#pragma once

#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/working_days/campaign.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>

/// Internal to this folder, not installed: the simulated day of a robot as its controller records it.
namespace tribotwin::twin::repeatability {

/// A cycle.
struct Recorded {
  identification::RobotRecording measuring;  ///< sections of inertia and friction
  identification::RobotRecording heating;
};

struct SimulatedDay {
  std::vector<Recorded> cycles;       ///< the whole ones
  std::vector<std::string> warnings;  ///< of the health check
};

/// The cycles of a test. `ambient` [degC] is also the start temperature.
Result<SimulatedDay> simulated(const Campaign& campaign, const Excitation& excitation, std::size_t test,
                               const Individual& robot, double ambient, const Regressor& regressor);

}  // namespace tribotwin::twin::repeatability
