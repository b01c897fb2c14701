#include <fmt/format.h>

#include <tribotwin/hil/drives/identifier.hpp>
#include <tribotwin/hil/ros2/bus.hpp>
#include <tribotwin/hil/ros2/readme.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::string_view intro = R"(# {folder}: simulated drives for ros2_canopen

`bus.yml` and one EDS per drive, for [ros2_canopen](https://github.com/ros-industrial/ros2_canopen). They were made by
`tribotwin-hil ros2`, with a SYNC of {cycle_ms:.6g} ms.
{bus_load}

| drive | node | rated torque at the joint [Nm] | speed limit [rad/s] |
|---|---|---|---|
)";

constexpr std::string_view use = R"(
## Start
Once, the configuration in a package of your workspace; this folder is copied to its `config/`:

    ros2 pkg create {package} --build-type ament_cmake --dependencies lely_core_libraries
    mkdir {package}/config && cp -r {folder} {package}/config/{configuration}
    sed -i '/^ament_package/i generate_dcf({configuration})' {package}/CMakeLists.txt
    colcon build --packages-select {package} && . install/setup.bash

Then the drives, and in another terminal the master:

    tribotwin-hil drive{arguments}
    config=$(ros2 pkg prefix --share {package})/config/{configuration}
    ros2 launch canopen_core canopen.launch.py can_interface_name:=vcan0 bus_config:=$config/bus.yml \
      master_config:=$config/master.dcf master_bin:=$config/master.bin

A virtual bus: `ip link add dev vcan0 type vcan && ip link set dev vcan0 up`.

## Move
Of each drive, here {first}; targets are radians and radians per second of the joint:

    ros2 service call /{first}/init std_srvs/srv/Trigger
    ros2 service call /{first}/position_mode std_srvs/srv/Trigger
    ros2 topic echo --once /{first}/joint_states
    ros2 service call /{first}/target canopen_interfaces/srv/COTargetDouble "{{target: 0.1}}"

`init` releases the brake, and the drive holds where it is. `position_mode` (profile position) moves to a target along
the ramps 6081h, 6083h and 6084h of `bus.yml`. In `cyclic_position_mode` a target is reached within one SYNC where speed
(6080h) and torque suffice, so a jump becomes a motion with all that the joint can give: send a trajectory, best through
`canopen_ros2_control`, for which `bus.yml` names the cyclic modes. When the drive lags too far behind (6065h) it is in
fault 8611h, and `recover` resets it. Targets of `cyclic_torque_mode` are per mille of the rated torque, because
ros2_canopen scales those of position and speed only.

## What is simulated
- The drives answer as CANopen nodes with CiA 402. Behind them are the robot's joints with friction, load and heat.
- Only the master's SYNC and PDOs count. If they end, the drives stop, engage their brakes and go to fault.
- Not simulated: bit timing and bus errors, the firmware of a certain drive, calibration of encoders. Vendor number 0.

## Change something
`bus.yml` may be edited; `colcon build` runs dcfgen on it. Another SYNC: make the folder again with `--cycle`, because
`sync_period`, `period`, 1006h and 60C2h belong together.
)";

/// A name for a ROS package and a CMake target: lower case.
std::string lower_case(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c + ('a' - 'A'));
  return text;
}

/// A word of a shell's command line.
std::string word(std::string_view text) {
  constexpr std::string_view plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=.,:/@%";
  if (!text.empty() && text.find_first_not_of(plain) == std::string_view::npos) return std::string(text);
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

}  // namespace

std::string ros2_readme(std::span<const DescribedDrive> drives, const Ros2Readme& r) {
  const auto names = ros2_names(drives);
  const std::string configuration = lower_case(identifier(r.folder));
  std::string s = fmt::format(intro, fmt::arg("folder", r.folder), fmt::arg("cycle_ms", 1e-3 * r.cycle_us),
                              fmt::arg("bus_load", r.bus_load));
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const DriveParameters& p = *drives[i].parameters;
    s += fmt::format("| {} | {} | {:.4g} | {:.4g} |\n", names[i], p.node, p.rated_torque_nm * p.gear_ratio,
                     p.speed_max_rad_s / p.gear_ratio);
  }
  std::string arguments;
  for (const auto& argument : r.arguments) arguments += " " + word(argument);
  return s + fmt::format(use, fmt::arg("folder", word(r.folder)), fmt::arg("configuration", configuration),
                         fmt::arg("package", "canopen_" + configuration), fmt::arg("arguments", arguments),
                         fmt::arg("first", names.front()));
}

}  // namespace tribotwin::hil
