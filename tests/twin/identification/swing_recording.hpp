#pragma once

#include <random>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/tests/twin/identification/multisine.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>

/// What a test's arm records on a Multisine, at 100 Hz.
namespace tribotwin::twin::identification {

/// `torque(state, random)`: of all joints [Nm], with noise from `random`.
template <class Torque>
RobotRecording swing_recording(unsigned seed, Eigen::Index joints, Eigen::Index samples, const Torque& torque) {
  constexpr double rate_hz = 100;
  std::mt19937_64 random(seed);
  const Multisine swing(joints, random);
  RobotRecording r{.file = fmt::format("{}.csv", seed)};
  r.position.resize(joints, samples), r.torque.resize(joints, samples);
  for (Eigen::Index i = 0; i < samples; ++i) {
    r.time_s.push_back(static_cast<double>(i) / rate_hz);
    const Multisine::State state = swing.at(r.time_s.back());
    r.torque.col(i) = torque(state, random);
    r.position.col(i) = state.q;
  }
  return r;
}

}  // namespace tribotwin::twin::identification
