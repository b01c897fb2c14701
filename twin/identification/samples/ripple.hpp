#pragma once

#include <cmath>

#include <tribotwin/twin/identification/samples/profile.hpp>

/// Private to levels.cc.
namespace tribotwin::twin::curves {

/// A part of the friction that is periodic in the joint's angle.
struct Ripple {
  double per_turn = 0, cosine_nm = 0, sine_nm = 0;
  double resolution = 0;   ///< of per_turn, half of what the travel can resolve
  double friction_nm = 0;  ///< of the level that it was found in
  double amplitude_nm() const { return std::hypot(cosine_nm, sine_nm); }
  double operator()(double q_rad) const {
    return cosine_nm * std::cos(per_turn * q_rad) + sine_nm * std::sin(per_turn * q_rad);
  }
};

/// The largest of the friction's Fourier amplitudes over the angle, beyond what a slow trend explains; all 0 where it
/// does not stand out of the noise.
Ripple ripple_of(const Profile& profile, const Profile::Difference& both);

}  // namespace tribotwin::twin::curves
