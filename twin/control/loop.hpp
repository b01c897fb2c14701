#pragma once

#include <cstddef>
#include <vector>

namespace tribotwin::twin {

/// The last whole period of a transmission's torque [Nm] over its torsion [rad].
class HysteresisLoop {
 public:
  explicit HysteresisLoop(std::size_t samples_per_period) : points_(samples_per_period) {}
  void add(double torsion_rad, double torque_nm) { points_[count_++ % points_.size()] = {torsion_rad, torque_nm}; }
  bool whole() const { return count_ >= points_.size(); }
  double area_J() const;
  double torque_max_nm() const;
  /// Slope from the min. to the max. torsion.
  double chord_nm_rad() const;

 private:
  struct Point {
    double torsion_rad, torque_nm;
  };
  std::vector<Point> points_;
  std::size_t count_ = 0;
};

}  // namespace tribotwin::twin
