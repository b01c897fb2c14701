#pragma once

#include <array>
#include <span>
#include <vector>

#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::hil {

/// The torques that the drives should have for a measured motion: rigid-body dynamics for the gear torques, the law for
/// friction, its heat for the temperature. Speeds and accelerations are those of a parabola through the last `window`
/// samples, so the result holds for the middle one, `half` samples ago.
class Expectation {
 public:
  static constexpr int half = 5, window = 2 * half + 1;

  Expectation(const twin::Scenario& scenario, double cycle_s);

  /// The next positions [rad], per drive; false while there are too few for a result.
  bool add(std::span<const double> position_rad);
  /// The expected torque [Nm, arm side]: one value while the joint slides; while it stands, the range of stiction.
  double low_nm(std::size_t drive) const { return drives_[drive].low_nm; }
  double high_nm(std::size_t drive) const { return drives_[drive].high_nm; }
  /// Lubricant temperature.
  double temperature_degC(std::size_t drive) const;

 private:
  struct Drive {
    std::array<double, window> q{};
    thermal::Decay decay;
    thermal::Rise rise;
    double ambient_offset_K = 0, low_nm = 0, high_nm = 0;
  };
  /// Position, speed and acceleration of the parabola, into mjData.
  void fit_motion();
  void expect(std::size_t drive);

  const mujoco::Model& model_;
  mujoco::DataPtr data_;
  double cycle_s_;
  int samples_ = 0;
  std::vector<Drive> drives_;
  std::vector<double> gear_nm_;
};

}  // namespace tribotwin::hil
