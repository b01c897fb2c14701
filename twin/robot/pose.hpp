#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>

/// Arm poses that give a joint a wanted load (Bittencourt 2012, section 3.1.1).
namespace tribotwin::twin {

struct Pose {
  std::vector<double> position_rad;  ///< per drive
  double width_rad;  ///< the joint's travel around the pose in which the load stays within 1 % of torque_max_nm
};

/// Gravity's load on one joint over its own angle and that of the next driven joint outward, within their ranges. Keeps
/// a reference to the arm; one thread at a time.
class Gravity {
 public:
  /// `start_rad` per drive: what the other joints do.
  Gravity(const mujoco::Model& arm, std::size_t drive, std::vector<double> start_rad);

  /// A pose that gives `load_nm`: the one in which the load changes least while the joint moves.
  /// Fails with the range of possible loads.
  Result<Pose> pose_for(double load_nm) const;
  /// Load [Nm] with the joint at q [rad], the others as in `pose_rad`.
  double load_nm(std::span<const double> pose_rad, double q_rad) const;
  /// The start itself as a pose.
  Pose start() const { return with_width(start_); }
  double min_nm() const { return min_nm_; }
  double max_nm() const { return max_nm_; }

 private:
  Pose with_width(std::vector<double> pose_rad) const;
  const mujoco::Model& arm_;
  std::size_t drive_;
  std::vector<double> start_;
  int outer_ = -1;  ///< drive of the next joint outward
  mujoco::DataPtr data_;
  std::vector<double> inner_grid_, outer_grid_, load_;  ///< load by inner, then outer
  double min_nm_, max_nm_;
};

}  // namespace tribotwin::twin
