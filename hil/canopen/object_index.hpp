#pragma once

#include <cstdint>

/// Indices of the object dictionary under the names of CiA 301 and CiA 402: the only place in the code where they are
/// numbers.
namespace tribotwin::hil::od {

using Index = std::uint16_t;

// Areas (CiA 301, 7.4).
constexpr Index manufacturer_area = 0x2000, profile_area = 0x6000;
constexpr bool is_communication(Index index) { return index < manufacturer_area; }
constexpr bool is_manufacturer(Index index) { return index >= manufacturer_area && index < profile_area; }

// Communication (CiA 301, 7.5.2).
constexpr Index device_type = 0x1000;
constexpr Index error_register = 0x1001;
constexpr Index predefined_error_field = 0x1003;
constexpr Index cob_id_sync = 0x1005;
constexpr Index communication_cycle_period = 0x1006;
constexpr Index device_name = 0x1008;
constexpr Index hardware_version = 0x1009;
constexpr Index software_version = 0x100A;
constexpr Index guard_time = 0x100C;
constexpr Index life_time_factor = 0x100D;
constexpr Index store_parameters = 0x1010;
constexpr Index restore_default_parameters = 0x1011;
constexpr Index cob_id_time = 0x1012;
constexpr Index cob_id_emcy = 0x1014;
constexpr Index inhibit_time_emcy = 0x1015;
constexpr Index consumer_heartbeat_time = 0x1016;
constexpr Index producer_heartbeat_time = 0x1017;
constexpr Index identity = 0x1018;
constexpr Index synchronous_counter_overflow = 0x1019;
constexpr Index store_eds = 0x1021;
constexpr Index store_format = 0x1022;
constexpr Index error_behavior = 0x1029;
constexpr Index sdo_server_parameter = 0x1200;
constexpr Index rpdo_communication = 0x1400;  ///< of the first RPDO; the next ones follow
constexpr Index rpdo_mapping = 0x1600;
constexpr Index tpdo_communication = 0x1800;
constexpr Index tpdo_mapping = 0x1A00;
constexpr Index after_pdos = 0x1C00;

/// From a PDO's communication parameter to its mapping parameter, and back.
constexpr Index mapping_of(Index communication) {
  return static_cast<Index>(communication + (rpdo_mapping - rpdo_communication));
}
constexpr Index communication_of(Index mapping) {
  return static_cast<Index>(mapping - (rpdo_mapping - rpdo_communication));
}

// Manufacturer specific.
constexpr Index lubricant_temperature = 0x2100;
constexpr Index friction_torque = 0x2101;
constexpr Index load_torque = 0x2102;
constexpr Index measured_temperature = 0x2110;
constexpr Index temperature_limit = 0x2111;
constexpr Index sync_deadline = 0x2120;
constexpr Index set_point_deadline = 0x2121;
constexpr Index simulated_switches = 0x2130;
constexpr Index user_data = 0x2180;
constexpr Index time_of_day = 0x2181;

// Drive profile (CiA 402-2).
constexpr Index abort_connection_option_code = 0x6007;
constexpr Index error_code = 0x603F;
constexpr Index controlword = 0x6040;
constexpr Index statusword = 0x6041;
constexpr Index quick_stop_option_code = 0x605A;
constexpr Index shutdown_option_code = 0x605B;
constexpr Index disable_operation_option_code = 0x605C;
constexpr Index halt_option_code = 0x605D;
constexpr Index fault_reaction_option_code = 0x605E;
constexpr Index modes_of_operation = 0x6060;
constexpr Index modes_of_operation_display = 0x6061;
constexpr Index position_demand_value = 0x6062;
constexpr Index position_actual_value = 0x6064;
constexpr Index following_error_window = 0x6065;
constexpr Index following_error_time_out = 0x6066;
constexpr Index position_window = 0x6067;
constexpr Index position_window_time = 0x6068;
constexpr Index velocity_actual_value = 0x606C;
constexpr Index velocity_window = 0x606D;
constexpr Index velocity_window_time = 0x606E;
constexpr Index velocity_threshold = 0x606F;
constexpr Index velocity_threshold_time = 0x6070;
constexpr Index target_torque = 0x6071;
constexpr Index max_torque = 0x6072;
constexpr Index torque_demand = 0x6074;
constexpr Index motor_rated_torque = 0x6076;
constexpr Index torque_actual_value = 0x6077;
constexpr Index target_position = 0x607A;
constexpr Index home_offset = 0x607C;
constexpr Index software_position_limit = 0x607D;
constexpr Index max_profile_velocity = 0x607F;
constexpr Index max_motor_speed = 0x6080;
constexpr Index profile_velocity = 0x6081;
constexpr Index end_velocity = 0x6082;
constexpr Index profile_acceleration = 0x6083;
constexpr Index profile_deceleration = 0x6084;
constexpr Index quick_stop_deceleration = 0x6085;
constexpr Index motion_profile_type = 0x6086;
constexpr Index position_encoder_resolution = 0x608F;
constexpr Index gear_ratio = 0x6091;
constexpr Index homing_method = 0x6098;
constexpr Index homing_speeds = 0x6099;
constexpr Index homing_acceleration = 0x609A;
constexpr Index profile_jerk_use = 0x60A3;
constexpr Index profile_jerk = 0x60A4;
constexpr Index si_unit_velocity = 0x60A9;
constexpr Index velocity_offset = 0x60B1;
constexpr Index torque_offset = 0x60B2;
constexpr Index touch_probe_function = 0x60B8;
constexpr Index touch_probe_status = 0x60B9;
constexpr Index touch_probe_1_rising = 0x60BA;
constexpr Index touch_probe_1_falling = 0x60BB;
constexpr Index touch_probe_2_rising = 0x60BC;
constexpr Index touch_probe_2_falling = 0x60BD;
constexpr Index interpolation_submode = 0x60C0;
constexpr Index interpolation_data_record = 0x60C1;
constexpr Index interpolation_time_period = 0x60C2;
constexpr Index max_acceleration = 0x60C5;
constexpr Index max_deceleration = 0x60C6;
constexpr Index supported_homing_methods = 0x60E3;
constexpr Index following_error_actual_value = 0x60F4;
constexpr Index velocity_control = 0x60F9;
constexpr Index position_control = 0x60FB;
constexpr Index digital_inputs = 0x60FD;
constexpr Index digital_outputs = 0x60FE;
constexpr Index target_velocity = 0x60FF;
constexpr Index supported_drive_modes = 0x6502;
constexpr Index single_device_type = 0x67FF;

}  // namespace tribotwin::hil::od
