#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>

#include <tribotwin/hil/can/frame.hpp>

/// The frames of the profile for benches without CANopen: per drive one command frame and one status frame,
/// little-endian. The set point counts in mNm, 1e-6 rad or 1e-6 rad/s, arm side.
///
///     classic  command 100h + node   bits 0..3 counter, 4..7 mode (0 off, 1 torque, 2 position, 3 velocity,
///                                    15 clear fault), 8..39 set point i32, 40..55 zero, 56..63 CRC
///              status  180h + node   bits 0..3 counter, 4..7 state (mode that is followed, 8 stopping, 15 fault),
///                                    8..31 position i24 [1e-5 rad], 32..43 torque i12 [0.001 torque_max_nm],
///                                    44..55 temperature u12 [0.1 degC from -50 degC], 56..63 CRC
///     FD       command, 12 bytes     as classic, with 40..71 feed-forward torque i32 [mNm], 72..87 zero, 88..95 CRC
///              status, 16 bytes      counter and state as classic, 8..39 position i32 [1e-6 rad], 40..71 velocity i32
///                                    [1e-6 rad/s], 72..95 torque i24 [1e-6 torque_max_nm], 96..111 temperature i16
///                                    [0.01 degC], 112..119 zero, 120..127 CRC
///
/// The CRC is SAE J1850 (polynomial 1Dh, start and final XOR FFh) over the identifier's two bytes, low first, and all
/// bytes before it, so that a frame of another drive is not mistaken for one of this drive. The counter goes up by one
/// with every frame.
namespace tribotwin::hil {

std::uint8_t crc8_j1850(std::span<const std::uint8_t> bytes, std::uint8_t crc = 0xFF);

enum class MirrorFormat : std::uint8_t { classic, fd };

enum class MirrorMode : std::uint8_t {
  off = 0,
  torque = 1,
  position = 2,
  velocity = 3,
  stopping = 8,
  clear_fault = 15,
  fault = 15
};

struct MirrorCommand {
  std::uint8_t counter = 0;
  MirrorMode mode = MirrorMode::off;
  double set_point = 0;        ///< Nm, rad, rad/s; arm side
  double feed_forward_nm = 0;  ///< FD only: added to the torque of the position and velocity loops, arm side
};
struct MirrorStatus {
  std::uint8_t counter = 0;
  MirrorMode state = MirrorMode::off;
  double position_rad = 0, torque_norm = 0, temperature_degC = 0;
  double velocity_rad_s = std::numeric_limits<double>::quiet_NaN();  ///< FD only
};

/// Values beyond the range of their bits saturate; what is not finite becomes 0.
Frame encode(const MirrorCommand& command, int node, MirrorFormat format = MirrorFormat::classic);
Frame encode(const MirrorStatus& status, int node, MirrorFormat format = MirrorFormat::classic);
/// None where the CRC or the length is wrong.
std::optional<MirrorCommand> decode_command(const Frame& frame);
std::optional<MirrorStatus> decode_status(const Frame& frame);
/// Identifiers of a drive's frames.
std::uint32_t mirror_command_id(int node);
std::uint32_t mirror_status_id(int node);

struct DescribedMirror {
  int node;
  std::string joint;
  double torque_max_nm;
};
std::string mirror_dbc(std::span<const DescribedMirror> drives, MirrorFormat format = MirrorFormat::classic);

}  // namespace tribotwin::hil
