#include <algorithm>
#include <cmath>
#include <numbers>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/communication_objects.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/sync.hpp>
#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/cia402/homing.hpp>
#include <tribotwin/hil/cia402/modes.hpp>
#include <tribotwin/hil/motion/inputs.hpp>

namespace tribotwin::hil {
namespace {

using T = Type;
constexpr Access ro = Access::read_only, rw = Access::read_write, constant = Access::constant;
constexpr std::uint32_t servo_drive = 0x00020192;  ///< device type: profile 402, servo drive

/// PDO 1 to 3 as CiA 402-2 has them; 4 and 5 do not exist until the master switches them on.
DefaultPdos default_pdos(std::uint8_t node) {
  const MappingEntry control{od::controlword, 0, 16}, status{od::statusword, 0, 16};
  const auto rpdo = [&](int n) { return cob::rpdo(n) + node; };
  const auto tpdo = [&](int n) { return cob::no_rtr | (cob::tpdo(n) + node); };
  return {.receive = {{{rpdo(0), 255, {control}},
                       {rpdo(1), 255, {control, {od::modes_of_operation, 0, 8}}},
                       {rpdo(2), 1, {control, {od::target_position, 0, 32}}},
                       {cob::off | rpdo(3), 1, {control, {od::target_velocity, 0, 32}}},
                       {cob::off, 1, {control, {od::target_torque, 0, 16}}}}},
          .transmit = {{{tpdo(0), 255, {status}},
                        {tpdo(1), 255, {status, {od::modes_of_operation_display, 0, 8}}},
                        {tpdo(2), 1, {status, {od::position_actual_value, 0, 32}}},
                        {cob::off | tpdo(3), 1, {status, {od::velocity_actual_value, 0, 32}}},
                        {cob::off | cob::no_rtr, 1, {status, {od::torque_actual_value, 0, 16}}}}}};
}

/// Adds the objects of the drive profile, group by group.
class Builder {
 public:
  Builder(std::vector<Object>& objects, const DriveParameters& parameters) : o_(objects), p_(parameters) {}

  void state() {
    add(o_, {od::abort_connection_option_code, 0, "abort connection option", T::i16, rw, false, 3, 1, 3},
        {.meaning = "lost commands: 1 fault reaction (605Eh), 2 no voltage, 3 quick stop (605Ah); then fault"});
    add(o_, {od::error_code, 0, "error code", T::u16, ro, true});
    add(o_, {od::controlword, 0, "controlword", T::u16, rw, true});
    add(o_, {od::statusword, 0, "statusword", T::u16, ro, true, 0x50});
    add(o_, {od::quick_stop_option_code, 0, "quick stop option", T::i16, rw, false, 2, 0, 6},
        {.meaning = "0 no voltage; 1, 2 ramp, then switch on disabled; 5, 6 ramp, then hold"});
    add(o_, {od::shutdown_option_code, 0, "shutdown option", T::i16, rw, false, 0, 0, 1},
        {.meaning = "0 no voltage, 1 ramp first"});
    add(o_, {od::disable_operation_option_code, 0, "disable operation option", T::i16, rw, false, 1, 0, 1},
        {.meaning = "0 no voltage, 1 ramp first"});
    add(o_, {od::halt_option_code, 0, "halt option", T::i16, rw, false, 1, 1, 2},
        {.meaning = "bit 8 of 6040h, every mode: 1 ramp 6084h, 2 ramp 6085h, then hold, enabled"});
    add(o_, {od::fault_reaction_option_code, 0, "fault reaction option", T::i16, rw, false, 2, 0, 2},
        {.meaning = "0 no voltage; 1, 2 ramp first"});
  }

  void modes() {
    const std::int64_t last = std::ranges::max(modes_of_operation(), {}, &ModeOfOperation::number).number;
    add(o_, {od::modes_of_operation, 0, "mode of operation", T::i8, rw, true, default_mode, no_mode, last},
        {.meaning = mode_numbers()});
    add(o_, {od::modes_of_operation_display, 0, "mode of operation display", T::i8, ro, true, default_mode});
    add(o_, {od::supported_drive_modes, 0, "supported modes", T::u32, constant, false, supported_modes()},
        {.meaning = mode_names()});
  }

  void position() {
    position(od::position_demand_value, 0, "position demand", ro, true, 0);
    position(od::position_actual_value, 0, "position actual", ro, true, 0, "motor side");
    add(o_, {od::following_error_window, 0, "following error window", T::u32, rw, false, increments(0.05)},
        {.scale = increment_rad, .unit = "rad", .meaning = "FFFFFFFFh: not watched"});
    add(o_, {od::following_error_time_out, 0, "following error time", T::u16, rw, false, 100},
        {.scale = 1e-3, .unit = "s"});
    add(o_, {od::following_error_actual_value, 0, "following error", T::i32, ro, true},
        {.scale = increment_rad, .unit = "rad"});
    add(o_, {od::position_window, 0, "position window", T::u32, rw, false, increments(0.001)},
        {.scale = increment_rad,
         .unit = "rad",
         .meaning = "PP: target reached within it for 6068h; FFFFFFFFh: at the end of the ramp"});
    add(o_, {od::position_window_time, 0, "position window time", T::u16, rw, false, 10}, {.scale = 1e-3, .unit = "s"});
    position(od::target_position, 0, "target position", rw, true, 0, modes_with_target(od::target_position));
    highest_sub_index(od::software_position_limit, 2);
    const Limits all = limits_of(T::i32);
    position(od::software_position_limit, 1, "min position limit", rw, false,
             p_.limited ? increments(p_.position_low_rad) : all.low);
    position(od::software_position_limit, 2, "max position limit", rw, false,
             p_.limited ? increments(p_.position_high_rad) : all.high);
    add(o_, {od::interpolation_submode, 0, "interpolation submode", T::i16, rw, false, 0}, {.meaning = "IP: 0 linear"});
    highest_sub_index(od::interpolation_data_record, 1);
    position(od::interpolation_data_record, 1, "interpolated position", rw, true, 0,
             modes_with_target(od::interpolation_data_record));
    highest_sub_index(od::interpolation_time_period, 2);
    add(o_,
        {od::interpolation_time_period, 1, "interpolation time", T::u8, rw, false,
         std::max<std::int64_t>(1, std::llround(p_.cycle_us / 1e3)), 1, 255},
        {.meaning = "CSP, IP: set points are joined by straight lines over this time"});
    add(o_, {od::interpolation_time_period, 2, "interpolation time exponent", T::i8, rw, false, -3, -6, 0},
        {.meaning = "of ten, seconds"});
  }

  void velocity() {
    velocity(od::velocity_actual_value, "velocity actual", ro, "motor side");
    velocity(od::velocity_offset, "velocity offset", rw, modes_that_add(od::velocity_offset));
    velocity(od::target_velocity, "target velocity", rw, modes_with_target(od::target_velocity));
    add(o_, {od::velocity_window, 0, "velocity window", T::u16, rw, false, 10000},
        {.scale = milli_rpm_rad_s, .unit = "rad/s", .meaning = "PV: target reached within it for 606Eh"});
    add(o_, {od::velocity_window_time, 0, "velocity window time", T::u16, rw, false, 10}, {.scale = 1e-3, .unit = "s"});
    add(o_, {od::velocity_threshold, 0, "velocity threshold", T::u16, rw, false, 5000},
        {.scale = milli_rpm_rad_s, .unit = "rad/s", .meaning = "PV: above it for 6070h, bit 12 of 6041h is 0"});
    add(o_, {od::velocity_threshold_time, 0, "velocity threshold time", T::u16, rw, false, 10},
        {.scale = 1e-3, .unit = "s"});
    add(o_,
        {od::max_motor_speed, 0, "max motor speed", T::u32, rw, false,
         std::llround(p_.speed_max_rad_s * 30 / std::numbers::pi), 1, 1000000},
        {.scale = std::numbers::pi / 30, .unit = "rad/s", .meaning = "rpm"});
    acceleration(od::profile_deceleration, "profile deceleration", 1, "profile modes, and halt with 605Dh = 1");
    acceleration(od::quick_stop_deceleration, "quick stop deceleration", 0.25, "every other ramp");
  }

  void profile() {
    speed(od::max_profile_velocity, "max profile velocity", p_.speed_max_rad_s, 1, "profile modes");
    speed(od::profile_velocity, "profile velocity", p_.speed_max_rad_s / 4, 1, "PP");
    speed(od::end_velocity, "end velocity", 0, 0, "PP: at the target, for the set point that waits; else it stops");
    acceleration(od::profile_acceleration, "profile acceleration", 1, "profile modes");
    add(o_, {od::motion_profile_type, 0, "motion profile type", T::i16, rw, false, DriveObjects::linear_ramp, 0, 3},
        {.meaning = "profile modes: 0 linear ramps, 3 jerk-limited (60A4h)"});
    add(o_, {od::profile_jerk_use, 0, "profile jerk use", T::u8, constant, false, 1}, {.meaning = "one for all ramps"});
    highest_sub_index(od::profile_jerk, 1);
    add(o_, {od::profile_jerk, 1, "profile jerk", T::u32, rw, false, counts(p_.speed_max_rad_s / 0.1), 1, 0xffffffffLL},
        {.scale = milli_rpm_rad_s, .unit = "rad/s3", .meaning = "6086h = 3"});
    acceleration(od::max_acceleration, "max acceleration", 0.25, "limits 6083h");
    acceleration(od::max_deceleration, "max deceleration", 0.25, "limits 6084h in the profile modes");
  }

  void homing() {
    position(od::home_offset, 0, "home offset", rw, false, 0, "homing puts the home position at minus this");
    add(o_, {od::homing_method, 0, "homing method", T::i8, rw, false, 0}, {.meaning = homing_method_names()});
    highest_sub_index(od::homing_speeds, 2);
    speed(od::homing_speeds, "homing speed to a switch", p_.speed_max_rad_s / 10, 1, "HM", 1);
    speed(od::homing_speeds, "homing speed to zero", p_.speed_max_rad_s / 100, 1, "HM: off the switch, to the index",
          2);
    acceleration(od::homing_acceleration, "homing acceleration", 0.25, "HM");
    const auto all = methods_of(p_);
    highest_sub_index(od::supported_homing_methods, static_cast<int>(all.size()));
    for (std::size_t i = 0; i < all.size(); ++i)
      add(o_, {od::supported_homing_methods, static_cast<std::uint8_t>(i + 1),
               "supported homing method " + std::to_string(i + 1), T::i8, constant, false, all[i]->number});
  }

  void inputs_and_outputs() {
    add(o_, {od::digital_inputs, 0, "digital inputs", T::u32, ro, true},
        {.meaning = "bits: 0 negative limit, 1 positive limit, 2 home switch, 3 interlock (safe torque off), "
                    "16 second probe (2130h), 17 brake released"});
    highest_sub_index(od::digital_outputs, 2);
    add(o_, {od::digital_outputs, 1, "physical outputs", T::u32, rw, true}, {.meaning = "bit 0: set the brake"});
    add(o_, {od::digital_outputs, 2, "output mask", T::u32, rw},
        {.meaning = "bit 0: 60FEh:01 may set the brake; it never releases the one that the state machine has set"});
    add(o_, {od::touch_probe_function, 0, "touch probe function", T::u16, rw, true},
        {.meaning = "low byte probe 1, high byte 2: bits 0 on, 1 each event, 2 index pulse instead of the switch, "
                    "4 rising, 5 falling edge"});
    add(o_, {od::touch_probe_status, 0, "touch probe status", T::u16, ro, true},
        {.meaning = "per byte: bits 0 on, 1 rising, 2 falling edge stored"});
    position(od::touch_probe_1_rising, 0, "touch probe 1 rising edge", ro, true, 0);
    position(od::touch_probe_1_falling, 0, "touch probe 1 falling edge", ro, true, 0);
    position(od::touch_probe_2_rising, 0, "touch probe 2 rising edge", ro, true, 0);
    position(od::touch_probe_2_falling, 0, "touch probe 2 falling edge", ro, true, 0);
  }

  /// CiA 402 leaves the entries of these records to the manufacturer.
  void loops() {
    using O = DriveObjects;
    const auto gain = [&](od::Index index, std::uint8_t sub, const char* name, double value, double count, Limits range,
                          const char* unit, std::string meaning) {
      const std::int64_t counts = std::clamp<std::int64_t>(std::llround(value / count), range.low, range.high);
      add(o_, {index, sub, name, T::u16, rw, false, counts, range.low, range.high},
          {.scale = count, .unit = unit, .meaning = std::move(meaning)});
    };
    const Limits any = limits_of(T::u16);
    const auto bandwidth_max = static_cast<std::int64_t>(p_.speed_bandwidth_max_rad_s / O::bandwidth_count_rad_s);
    highest_sub_index(od::velocity_control, 2);
    gain(od::velocity_control, 1, "speed bandwidth", p_.gains.speed_bandwidth_rad_s, O::bandwidth_count_rad_s,
         {1, std::min(any.high, bandwidth_max)}, "rad/s", "speed gain over the joint's inertia at the start");
    gain(od::velocity_control, 2, "speed integral time", p_.gains.integral_time_s, O::integral_count_s, any, "s",
         "0: no integral part");
    highest_sub_index(od::position_control, 1);
    gain(od::position_control, 1, "position gain", p_.gains.position_gain_1_s, O::position_gain_count_1_s, any, "1/s",
         "speed per position error");
  }

  void torque() {
    torque(od::target_torque, "target torque", T::i16, rw, 0, modes_with_target(od::target_torque));
    torque(od::max_torque, "max torque", T::u16, rw, 1000);
    torque(od::torque_demand, "torque demand", T::i16, ro, 0, "at this moment");
    add(o_, {od::motor_rated_torque, 0, "motor rated torque", T::u32, ro, false, rated_torque_mnm_},
        {.scale = 1e-3, .unit = "Nm", .meaning = "torque_max_nm / gear_ratio; 1000 of 6071h, 6072h, 6077h"});
    torque(od::torque_actual_value, "torque actual", T::i16, ro, 0, "motor side; mean since the last SYNC");
    torque(od::torque_offset, "torque offset", T::i16, rw, 0, modes_that_add(od::torque_offset));
  }

  void motor_and_gear() {
    highest_sub_index(od::position_encoder_resolution, 2);
    add(o_, {od::position_encoder_resolution, 1, "encoder increments", T::u32, constant, false, increments_per_turn});
    add(o_, {od::position_encoder_resolution, 2, "motor revolutions", T::u32, constant, false, 1});
    highest_sub_index(od::gear_ratio, 2);
    add(o_,
        {od::gear_ratio, 1, "gear: motor revolutions", T::u32, constant, false, std::llround(1000 * p_.gear_ratio)});
    add(o_, {od::gear_ratio, 2, "gear: joint revolutions", T::u32, constant, false, 1000});
    add(o_, {od::si_unit_velocity, 0, "velocity unit", T::u32, constant, false, 0xFDB44700},
        {.meaning = "10^-3 revolutions per minute"});
    add(o_, {od::single_device_type, 0, "single device type", T::u32, constant, false, servo_drive});
  }

  void manufacturer() {
    const auto only = [&](Object object, Extra extra) {
      highest_sub_index(object.index, 1);
      add(o_, std::move(object), std::move(extra));
    };
    temperature(od::lubricant_temperature, 1, "lubricant temperature", ro, p_.start_degC, "", p_.winding ? 2 : 1);
    if (const auto& w = p_.winding)
      temperature(od::lubricant_temperature, 2, "winding temperature", ro, w->start_degC, "of the motor");
    only({od::friction_torque, 1, "friction torque", T::i32, ro, true},
         {.scale = 1e-3, .unit = "Nm", .meaning = "arm side, positive when it opposes positive motion"});
    only({od::load_torque, 1, "load torque", T::i32, ro, true},
         {.scale = 1e-3, .unit = "Nm", .meaning = "arm side: what the gear carries"});
    only({od::measured_temperature, 1, "measured temperature", T::i16, rw, true, limits_of(T::i16).low},
         {.scale = 0.1, .unit = "degC", .meaning = "of a bench; overrides the thermal model; 8000h: none"});
    temperature(od::temperature_limit, 1, "temperature limit", rw, 120, "above: fault 4310h; a warning 10 K before",
                p_.winding ? 3 : 1);
    if (const auto& w = p_.winding) {
      temperature(od::temperature_limit, 2, "winding limit", rw, w->limit_degC, "above: fault 4310h");
      temperature(od::temperature_limit, 3, "winding warning", rw, w->warning_degC,
                  "above: bit 7 of 6041h; the model derates from its own winding_warning_degC on");
    }
    highest_sub_index(od::simulated_switches, 2);
    const std::int64_t none = limits_of(T::i32).high;
    position(od::simulated_switches, 1, "home switch", rw, false, none, "closed from here on; not moved by homing");
    position(od::simulated_switches, 2, "second probe", rw, false, none, "closed from here on; not moved by homing");
    only({od::sync_deadline, 1, "SYNC deadline", T::u16, rw, false, default_sync_deadline_ms, 0, 60000},
         {.scale = 1e-3,
          .unit = "s",
          .meaning = "enabled, without SYNC for so long and for three cycles (1006h): abort connection (6007h); "
                     "0: not watched"});
    only({od::set_point_deadline, 1, "set point deadline", T::u16, rw, false, 20},
         {.unit = "cycle",
          .meaning = "enabled, without the mode's set point for so long after an RPDO brought one: "
                     "abort connection (6007h); 0: not watched"});
  }

 private:
  static constexpr double increment_rad = 2 * std::numbers::pi / increments_per_turn,
                          milli_rpm_rad_s = 2e-3 * std::numbers::pi / 60;

  std::int64_t increments(double joint_rad) const {
    return saturated(T::i32, std::llround(joint_rad * p_.gear_ratio / increment_rad));
  }
  void highest_sub_index(od::Index index, int highest) {
    add(o_, {index, 0, "highest sub-index", T::u8, constant, false, highest});
  }
  /// `highest`: sub-index 0 where this is the first of the record.
  void temperature(od::Index index, std::uint8_t sub, const char* name, Access access, double degC, std::string meaning,
                   int highest = 0) {
    if (highest != 0) highest_sub_index(index, highest);
    add(o_, {index, sub, name, T::i16, access, access == ro, saturated(T::i16, std::llround(10 * degC))},
        {.scale = 0.1, .unit = "degC", .meaning = std::move(meaning)});
  }
  void position(od::Index index, std::uint8_t sub, const char* name, Access access, bool mappable, std::int64_t value,
                std::string meaning = "") {
    add(o_, {index, sub, name, T::i32, access, mappable, value},
        {.scale = increment_rad, .unit = "rad", .meaning = std::move(meaning)});
  }
  void velocity(od::Index index, const char* name, Access access, std::string meaning) {
    add(o_, {index, 0, name, T::i32, access, true},
        {.scale = milli_rpm_rad_s, .unit = "rad/s", .meaning = std::move(meaning)});
  }
  /// Counts of a speed, acceleration or jerk of the motor.
  static std::int64_t counts(double rad_s) { return std::llround(std::min(rad_s / milli_rpm_rad_s, 4e9)); }
  void speed(od::Index index, const char* name, double rad_s, std::int64_t low, std::string meaning,
             std::uint8_t sub = 0) {
    add(o_, {index, sub, name, T::u32, rw, sub == 0, counts(rad_s), low, 0xffffffffLL},
        {.scale = milli_rpm_rad_s, .unit = "rad/s", .meaning = std::move(meaning)});
  }
  /// `ramp_s`: between standstill and the maximum speed.
  void acceleration(od::Index index, const char* name, double ramp_s, std::string meaning) {
    add(o_, {index, 0, name, T::u32, rw, false, counts(p_.speed_max_rad_s / ramp_s), 1, 0xffffffffLL},
        {.scale = milli_rpm_rad_s, .unit = "rad/s2", .meaning = std::move(meaning)});
  }
  void torque(od::Index index, const char* name, Type type, Access access, std::int64_t value,
              std::string meaning = "") {
    add(o_, {index, 0, name, type, access, true, value},
        {.scale = per_mille_nm_, .unit = "Nm", .meaning = std::move(meaning)});
  }

  std::vector<Object>& o_;
  const DriveParameters& p_;
  std::int64_t rated_torque_mnm_ = std::max<std::int64_t>(1, std::llround(1e3 * p_.rated_torque_nm));
  double per_mille_nm_ = static_cast<double>(rated_torque_mnm_) * 1e-6;
};

}  // namespace

Dictionary drive_dictionary(const DriveParameters& parameters) {
  std::vector<Object> objects;
  add_communication_objects(objects, parameters, servo_drive, default_pdos(parameters.node));
  Builder drive(objects, parameters);
  drive.state();
  drive.modes();
  drive.position();
  drive.velocity();
  drive.profile();
  drive.homing();
  drive.loops();
  drive.inputs_and_outputs();
  drive.torque();
  drive.motor_and_gear();
  drive.manufacturer();
  return Dictionary(std::move(objects));
}

DriveObjects::DriveObjects(Dictionary& dictionary, double gear_ratio) : dictionary_(dictionary) {
  // One line per object.
  increment_rad = 2 * std::numbers::pi / increments_per_turn / gear_ratio;
  milli_rpm_rad_s = 2e-3 * std::numbers::pi / 60 / gear_ratio;
  per_mille_nm = static_cast<double>(dictionary.get(od::motor_rated_torque)) * 1e-6 * gear_ratio;

  const auto object = [&](od::Index index, std::uint8_t sub = 0) { return dictionary.find(index, sub); };
  controlword = object(od::controlword);
  statusword = object(od::statusword);
  error_code = object(od::error_code);
  mode = object(od::modes_of_operation);
  mode_display = object(od::modes_of_operation_display);
  target_position = object(od::target_position);
  target_velocity = object(od::target_velocity);
  target_torque = object(od::target_torque);
  position_demand = object(od::position_demand_value);
  position_actual = object(od::position_actual_value);
  velocity_actual = object(od::velocity_actual_value);
  torque_actual = object(od::torque_actual_value);
  torque_demand = object(od::torque_demand);
  following_error = object(od::following_error_actual_value);
  following_error_window = object(od::following_error_window);
  following_error_time_out = object(od::following_error_time_out);
  position_window = object(od::position_window);
  position_window_time = object(od::position_window_time);
  velocity_window = object(od::velocity_window);
  velocity_window_time = object(od::velocity_window_time);
  velocity_threshold = object(od::velocity_threshold);
  velocity_threshold_time = object(od::velocity_threshold_time);
  velocity_offset = object(od::velocity_offset);
  torque_offset = object(od::torque_offset);
  max_torque = object(od::max_torque);
  max_motor_speed = object(od::max_motor_speed);
  halt_option = object(od::halt_option_code);
  profile_deceleration = object(od::profile_deceleration);
  quick_stop_deceleration = object(od::quick_stop_deceleration);
  profile_velocity = object(od::profile_velocity);
  max_profile_velocity = object(od::max_profile_velocity);
  end_velocity = object(od::end_velocity);
  profile_acceleration = object(od::profile_acceleration);
  motion_profile_type = object(od::motion_profile_type);
  profile_jerk = object(od::profile_jerk, 1);
  max_acceleration = object(od::max_acceleration);
  max_deceleration = object(od::max_deceleration);
  home_offset = object(od::home_offset);
  homing_method = object(od::homing_method);
  homing_speed_switch = object(od::homing_speeds, 1);
  homing_speed_zero = object(od::homing_speeds, 2);
  homing_acceleration = object(od::homing_acceleration);
  digital_inputs = object(od::digital_inputs);
  digital_outputs = object(od::digital_outputs, 1);
  output_mask = object(od::digital_outputs, 2);
  touch_probe_function = object(od::touch_probe_function);
  touch_probe_status = object(od::touch_probe_status);
  probe_1_rising = object(od::touch_probe_1_rising);
  probe_1_falling = object(od::touch_probe_1_falling);
  probe_2_rising = object(od::touch_probe_2_rising);
  probe_2_falling = object(od::touch_probe_2_falling);
  home_switch = object(od::simulated_switches, 1);
  probe_2_switch = object(od::simulated_switches, 2);
  speed_bandwidth = object(od::velocity_control, 1);
  integral_time = object(od::velocity_control, 2);
  position_gain = object(od::position_control, 1);
  position_limit_low = object(od::software_position_limit, 1);
  position_limit_high = object(od::software_position_limit, 2);
  interpolated_position = object(od::interpolation_data_record, 1);
  interpolation_time = object(od::interpolation_time_period, 1);
  interpolation_exponent = object(od::interpolation_time_period, 2);
  lubricant_temperature = object(od::lubricant_temperature, 1);
  friction_torque = object(od::friction_torque, 1);
  load_torque = object(od::load_torque, 1);
  measured_temperature = object(od::measured_temperature, 1);
  temperature_limit = object(od::temperature_limit, 1);
  winding_temperature = object(od::lubricant_temperature, 2);
  winding_limit = object(od::temperature_limit, 2);
  winding_warning = object(od::temperature_limit, 3);
}

double DriveObjects::profile_speed_max_rad_s() const {
  return std::min(velocity_rad_s(max_profile_velocity), speed_max_rad_s());
}

MotionLimits DriveObjects::profile_limits(double speed_rad_s) const {
  const bool smooth = motion_profile_type->value == jerk_limited_ramp;
  return {.speed_rad_s = speed_rad_s,
          .acceleration_rad_s2 = std::min(velocity_rad_s(profile_acceleration), velocity_rad_s(max_acceleration)),
          .deceleration_rad_s2 = std::min(velocity_rad_s(profile_deceleration), velocity_rad_s(max_deceleration)),
          .jerk_rad_s3 = smooth ? velocity_rad_s(profile_jerk) : MotionLimits::unlimited};
}

twin::LoopGains DriveObjects::gains() const {
  return {.position_gain_1_s = position_gain_count_1_s * static_cast<double>(position_gain->value),
          .speed_bandwidth_rad_s = bandwidth_count_rad_s * static_cast<double>(speed_bandwidth->value),
          .integral_time_s = integral_count_s * static_cast<double>(integral_time->value)};
}

double DriveObjects::interpolation_s() const {
  return static_cast<double>(interpolation_time->value) *
         std::pow(10.0, static_cast<double>(interpolation_exponent->value));
}

}  // namespace tribotwin::hil
