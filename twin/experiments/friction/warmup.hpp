#pragma once

#include <functional>
#include <span>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/twin/robot/motion.hpp>

/// Hours of warming up and cooling without a simulation: friction power of the law at constant speed and the exact step
/// of the thermal model, over intervals in which the power changes little.
namespace tribotwin::twin {

/// Temperature rise of the lubricant after `duration_s` at a steady |speed| [rad/s, arm side; 0: at rest], |load| over
/// torque_max_nm and an ambient temperature `ambient_offset_K` above the drive's T_amb.
thermal::Rise after_steady_work(const drive::Drive& drive, thermal::Rise rise, double ambient_offset_K,
                                double speed_rad_s, double load_norm, double duration_s);

/// The same after one pass of a motion. `load_nm`: load at a position [rad] of the joint.
thermal::Rise after_motion(const drive::Drive& drive, thermal::Rise rise, double ambient_offset_K, const Motion& motion,
                           std::size_t joint, const std::function<double(double)>& load_nm);

}  // namespace tribotwin::twin
