#pragma once

#include <algorithm>

#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/drives/drive_parameters.hpp>
#include <tribotwin/hil/motion/motion_profile.hpp>

namespace tribotwin::hil {

inline constexpr int increments_per_turn = 65536;  ///< 608Fh, motor side

/// The object dictionary of a drive after a reset: CiA 301, CiA 402 and our own objects.
Dictionary drive_dictionary(const DriveParameters& parameters);

/// The objects that a drive reads and writes in each step, found once, and their values on the joint side in SI.
/// Objects count at the motor: increments [1/65536 turn], 0.001 rpm, 0.001 of the rated torque.
class DriveObjects {
 public:
  static constexpr std::int64_t window_off = 0xffffffff;  ///< 6065h, 6067h: not watched
  static constexpr double bandwidth_count_rad_s = 0.1, integral_count_s = 1e-4, position_gain_count_1_s = 0.01;
  enum ProfileType : std::int64_t { linear_ramp = 0, jerk_limited_ramp = 3 };  ///< 6086h

  DriveObjects(Dictionary& dictionary, double gear_ratio);

  // Size of one count, joint side.
  double increment_rad, milli_rpm_rad_s, per_mille_nm;
  double zero_rad = 0;  ///< angle of the joint at position 0; homing moves it

  Object *controlword, *statusword, *error_code;
  Object *mode, *mode_display;
  Object *target_position, *target_velocity, *target_torque;
  Object *position_demand, *position_actual, *velocity_actual, *torque_actual, *torque_demand;
  Object *following_error, *following_error_window, *following_error_time_out;
  Object *position_window, *position_window_time;
  Object *velocity_window, *velocity_window_time, *velocity_threshold, *velocity_threshold_time;
  Object *velocity_offset, *torque_offset, *max_torque, *max_motor_speed;
  Object *halt_option, *profile_deceleration, *quick_stop_deceleration;
  Object *profile_velocity, *max_profile_velocity, *end_velocity, *profile_acceleration;
  Object *motion_profile_type, *profile_jerk, *max_acceleration, *max_deceleration;
  Object *home_offset, *homing_method, *homing_speed_switch, *homing_speed_zero, *homing_acceleration;
  Object *digital_outputs, *output_mask;
  Object *touch_probe_function, *touch_probe_status;
  Object *probe_1_rising, *probe_1_falling, *probe_2_rising, *probe_2_falling;
  Object *digital_inputs, *home_switch, *probe_2_switch;
  Object *speed_bandwidth, *integral_time, *position_gain;
  Object *position_limit_low, *position_limit_high;
  Object *interpolated_position, *interpolation_time, *interpolation_exponent;
  Object *lubricant_temperature, *friction_torque, *load_torque, *measured_temperature, *temperature_limit;
  Object *winding_temperature, *winding_warning, *winding_limit;  ///< null without a winding

  /// Any other object that must exist.
  const Object* object(std::uint16_t index, std::uint8_t sub = 0) const { return dictionary_.find(index, sub); }

  double position_rad(std::int64_t increments) const { return static_cast<double>(increments) * increment_rad; }
  double position_rad(const Object* object) const { return position_rad(object->value); }
  double velocity_rad_s(const Object* object) const { return static_cast<double>(object->value) * milli_rpm_rad_s; }
  double torque_nm(const Object* object) const { return static_cast<double>(object->value) * per_mille_nm; }
  /// 607Dh; where its limits are in the wrong order, the lower one.
  double within_position_limits(double rad) const {
    return std::max(position_rad(position_limit_low), std::min(rad, position_rad(position_limit_high)));
  }
  /// 6080h, which counts in rpm.
  double speed_max_rad_s() const { return static_cast<double>(max_motor_speed->value) * 1e3 * milli_rpm_rad_s; }
  /// The lower one of 607Fh and 6080h: for ramps of the profile modes.
  double profile_speed_max_rad_s() const;
  /// Ramps by 6083h, 6084h, 6086h and 60A4h within 60C5h and 60C6h, up to a speed.
  MotionLimits profile_limits(double speed_rad_s) const;
  twin::LoopGains gains() const;
  /// 60C2h: time from one set point to the next.
  double interpolation_s() const;

 private:
  const Dictionary& dictionary_;
};

}  // namespace tribotwin::hil
