#include <algorithm>
#include <cmath>
#include <limits>

#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/channels.hpp>

namespace tribotwin::twin {
namespace {

struct DriveChannel {
  Channel channel;
  double (*value)(const Twin& twin, std::size_t drive);
};
const DriveChannel drive_channels[] = {
    {{"position_rad", "rad", "joint angle, arm side, at time_s"},
     [](const Twin& t, std::size_t i) { return t.position_rad(i); }},
    {{"velocity_rad_s", "rad/s", "joint speed, arm side, at time_s"},
     [](const Twin& t, std::size_t i) { return t.velocity_rad_s(i); }},
    {{"motor_torque_nm", "Nm", "motor torque, motor side, over the step from time_s (arm side: torque_nm)"},
     [](const Twin& t, std::size_t i) { return t.drive(i).torque_nm / t.model().drives()[i].drive.gear_ratio; }},
    {{"torque_nm", "Nm", "motor torque seen from the arm: motor_torque_nm x gear ratio"},
     [](const Twin& t, std::size_t i) { return t.drive(i).torque_nm; }},
    {{"friction_nm", "Nm",
      "transmitted friction, arm side, positive when it opposes positive motion, over the step from time_s"},
     [](const Twin& t, std::size_t i) { return t.drive(i).friction_nm; }},
    {{"load_nm", "Nm", "gear torque that friction was evaluated at, arm side, signed"},
     [](const Twin& t, std::size_t i) { return t.drive(i).load_used_nm; }},
    {{"temperature_degC", "degC", "lubricant temperature that friction was evaluated at"},
     [](const Twin& t, std::size_t i) { return t.drive(i).temperature_degC; }},
};

/// Of models in which a drive has a winding.
const DriveChannel winding_channels[] = {
    {{"winding_temperature_degC", "degC", "winding temperature, over the step from time_s"},
     [](const Twin& t, std::size_t i) { return t.drive(i).winding_degC; }},
    {{"motor_current_A", "A", "motor current, over the step from time_s"},
     [](const Twin& t, std::size_t i) { return t.drive(i).current_A; }},
    {{"motor_current_limit_A", "A",
      "largest current of the drive: derating and I^2 t protection, over the step from time_s"},
     [](const Twin& t, std::size_t i) { return t.drive(i).current_limit_A; }},
};

bool has_winding(const mujoco::Binding& binding) { return binding.drive.winding.present(); }

struct TransmissionChannel {
  Channel channel;
  double Twin::Transmission::*value;
};
const TransmissionChannel transmission_channels[] = {
    {{"torsion_rad", "rad", "torsion of the transmission, arm side, at time_s"}, &Twin::Transmission::torsion_rad},
    {{"transmission_torque_nm", "Nm", "torque of the transmission on the arm, at time_s"},
     &Twin::Transmission::torque_nm},
    {{"arm_position_rad", "rad", "angle behind the transmission, at time_s"}, &Twin::Transmission::arm_rad},
    {{"arm_set_point_rad", "rad", "set point of arm_position_rad, before any compensation, at time_s"},
     &Twin::Transmission::arm_set_point_rad},
};

struct CycleChannel {
  Channel channel;
  double CycleSample::*value;
};
const CycleChannel cycle_table[] = {
    {{"cycle_temperature_degC", "degC", "lubricant temperature at the end of a work cycle"},
     &CycleSample::temperature_degC},
    {{"cycle_friction_power_W", "W", "mean friction power over a work cycle"}, &CycleSample::friction_power_w},
};

}  // namespace

std::vector<Channel> channels(const mujoco::Model& model) {
  std::vector<Channel> all;
  for (const auto& row : drive_channels) all.push_back(row.channel);
  if (!model.springs().empty())
    for (const auto& row : transmission_channels) all.push_back(row.channel);
  if (std::ranges::any_of(model.drives(), has_winding))
    for (const auto& row : winding_channels) all.push_back(row.channel);
  return all;
}

std::vector<std::string> units(const mujoco::Model& model, const mujoco::Binding& drive) {
  const bool slide = is_slide(model.get(), drive);
  std::vector<std::string> all;
  for (const auto& channel : channels(model))  // the motor turns, whatever its joint does
    all.push_back(unit_of(channel.unit, slide && !channel.name.starts_with("motor_")));
  return all;
}

void read_channels(const Twin& twin, std::span<double> row) {
  const std::size_t drives = twin.model().drives().size(), width = row.size() / drives;
  std::ranges::fill(row, std::numeric_limits<double>::quiet_NaN());
  for (std::size_t i = 0; i < drives; ++i)
    for (std::size_t c = 0; c < std::size(drive_channels); ++c) row[i * width + c] = drive_channels[c].value(twin, i);
  for (const auto& spring : twin.model().springs()) {
    const auto transmission = twin.transmission(spring);
    const auto values = row.subspan(transmission.drive * width + std::size(drive_channels));
    for (std::size_t c = 0; c < std::size(transmission_channels); ++c)
      values[c] = transmission.*transmission_channels[c].value;
  }
  for (std::size_t i = 0; i < drives; ++i)
    if (has_winding(twin.model().drives()[i]))
      for (std::size_t c = 0; c < std::size(winding_channels); ++c)
        row[(i + 1) * width - std::size(winding_channels) + c] = winding_channels[c].value(twin, i);
}

std::vector<Channel> cycle_channels() {
  std::vector<Channel> all;
  for (const auto& row : cycle_table) all.push_back(row.channel);
  return all;
}

void add_channels(const CycleSample& sample, std::vector<double>& row) {
  for (const auto& channel : cycle_table) row.push_back(sample.*channel.value);
}

}  // namespace tribotwin::twin
