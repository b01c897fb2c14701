#pragma once

#include <map>
#include <memory>
#include <optional>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/drives/drive_parameters.hpp>
#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/hil/shadow/channel.hpp>

namespace tribotwin::hil {

/// What one frame says of one joint. Arm side.
struct Heard {
  std::optional<double> position_rad, torque_nm;
  bool mean_torque = false;     ///< the torque is the mean since the SYNC before, not that at the SYNC
  std::optional<bool> enabled;  ///< follows set points: not held by its brake, not stopping, no fault
  Sending sending = Sending::periodic;
  int every = 1;  ///< with SYNC: one frame per so many

  bool any() const { return position_rad || torque_nm || enabled; }
};

/// Reads position, torque and state of one drive from the frames on a bus.
class Listener {
 public:
  virtual ~Listener() = default;
  virtual Heard hear(const Frame& frame) = 0;
};

/// Whether a statusword (6041h) is that of a drive in operation enabled.
constexpr bool is_operation_enabled(std::uint16_t statusword) { return (statusword & 0x6F) == 0x27; }

/// A CANopen drive as a listener needs it: the parameters of its TPDOs (18xxh, 1Axxh) after a reset, and the size of
/// its counts.
struct CanopenDrive {
  int node = 1;
  std::map<std::pair<std::uint16_t, std::uint8_t>, std::int64_t> tpdo_objects;  ///< by index and sub-index
  double position_rad = 0;                                                      ///< of one count of 6064h, arm side
  bool mean_torque = false;  ///< 6077h is the mean since the SYNC before
  double torque_nm = 0;      ///< of one count of 6077h, arm side
};

/// A drive as this program simulates it.
CanopenDrive simulated_drive(const DriveParameters& parameters);

/// Follows the SDO writes of the master to the drive's TPDO parameters and resets by NMT, so it knows a mapping that
/// was changed while it listened.
std::unique_ptr<Listener> canopen_listener(CanopenDrive drive);
std::unique_ptr<Listener> mirror_listener(const DriveParameters& parameters);

}  // namespace tribotwin::hil
