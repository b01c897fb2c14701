#include <algorithm>
#include <cmath>

#include <tribotwin/twin/control/loop.hpp>

namespace tribotwin::twin {

double HysteresisLoop::area_J() const {
  double twice = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const Point &a = points_[i], &b = points_[(i + 1) % points_.size()];
    twice += (a.torque_nm + b.torque_nm) * (b.torsion_rad - a.torsion_rad);
  }
  return 0.5 * std::abs(twice);  // the sum does not depend on where the ring begins
}

double HysteresisLoop::torque_max_nm() const {
  return std::abs(std::ranges::max(points_, {}, [](const Point& p) { return std::abs(p.torque_nm); }).torque_nm);
}

double HysteresisLoop::chord_nm_rad() const {
  const auto [low, high] = std::ranges::minmax(points_, {}, &Point::torsion_rad);
  return high.torsion_rad > low.torsion_rad ? (high.torque_nm - low.torque_nm) / (high.torsion_rad - low.torsion_rad)
                                            : 0;
}

}  // namespace tribotwin::twin
