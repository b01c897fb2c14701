#pragma once

#include <memory>
#include <optional>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/drives/drive_parameters.hpp>
#include <tribotwin/hil/session/bench.hpp>

namespace tribotwin::hil {

/// Reads position and torque of one drive from the frames on a bus. Arm side.
class Listener {
 public:
  virtual ~Listener() = default;
  /// Whether the frame held a position of this drive.
  virtual bool hear(const Frame& frame) = 0;

  std::optional<double> position_rad, torque_nm;  ///< last heard
  bool torque_heard = false;                      ///< since the owner set it to false
};

std::unique_ptr<Listener> make_listener(Profile profile, const DriveParameters& parameters);

}  // namespace tribotwin::hil
