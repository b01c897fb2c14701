#pragma once

#include <memory>

#include <tribotwin/plugins/mujoco/loader.hpp>

/// Robots for benchmarks: IRB 6620s with drives, and the same robots in an engine without plugins for comparison.
namespace tribotwin::bench {

struct RobotOptions {
  const char* integrator = "Euler";  ///< as in MJCF
  bool lugre = false;                ///< bristles in every drive
  bool damping = false;              ///< the robot without plugins has joint damping besides frictionloss
  int count = 1;                     ///< robots in one model
  bool one_instance = false;         ///< of the plugin for all drives of the model
};

struct Rivals {
  std::shared_ptr<const mujoco::Model> ours;
  /// The same file without any plugin: motors, frictionloss (the law's at 0.5 rad/s, a load of 0.1 and 50 degC).
  mujoco::ModelPtr native;
};
Rivals rivals(const RobotOptions& options);

/// Steps both arms alike: gravity of the step before, and a swing of a fifth of the rated torque about one pose.
class Swing {
 public:
  explicit Swing(const Rivals& rivals);
  void step_ours(int steps);
  void step_native(int steps);

 private:
  void command(mjData* d, int step) const;

  const Rivals& rivals_;
  mujoco::DataPtr ours_, native_;
  int ours_steps_ = 0, native_steps_ = 0;
};

}  // namespace tribotwin::bench
