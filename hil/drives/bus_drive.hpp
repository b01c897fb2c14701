#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/twin/control/servo.hpp>

namespace tribotwin::hil {

/// State of a drive in the simulation. Arm side; SI.
struct Feedback {
  double position_rad = 0, velocity_rad_s = 0, torque_nm = 0;
  double friction_nm = 0, load_nm = 0, temperature_degC = 25;
  std::optional<double> winding_degC{};  ///< of a drive with a winding
  bool limited = false;                  ///< the torque was cut to a limit
  bool safe_torque_off = false;          ///< the safety circuit keeps the torque off, whatever the drive asks for
};

using Send = std::function<Sent(const Frame&)>;

/// One drive between a bus and a robot, for any protocol; free of sockets and clocks. `now_ns`: CLOCK_MONOTONIC.
class BusDrive {
 public:
  virtual ~BusDrive() = default;

  virtual void start(std::int64_t now_ns) = 0;
  /// Any frame of others. `sync` follows if it is the SYNC.
  virtual void receive(const Frame& frame, std::int64_t now_ns) = 0;
  /// The SYNC: sends what is due with the last feedback, then applies the set points that came before it.
  virtual void sync(std::int64_t now_ns) = 0;
  /// Timers. Call at least every few milliseconds of wall time.
  virtual void tick(std::int64_t now_ns) = 0;
  /// The bus is back after a link loss.
  virtual void recovered(std::int64_t now_ns) { (void)now_ns; }
  /// Next time at which `tick` has something to do.
  virtual std::int64_t next_ns() const = 0;
  /// Whether this drive sends frames with the identifier `id`.
  virtual bool sends(std::uint32_t id) const = 0;
  /// Whether this drive is meant by this frame of another that is no SYNC, in whichever state it is now.
  virtual bool takes(const Frame& frame) const = 0;

  /// The set point for the next simulation step of dt [s].
  virtual twin::DriveCommand command(double dt_s) = 0;
  /// The state after that step.
  virtual void feedback(const Feedback& feedback, double dt_s) = 0;
  virtual bool brake_engaged() const = 0;
  /// Gains of the loops that follow the set points.
  virtual twin::LoopGains gains() const = 0;
  /// The drive lost its commands and is not at rest yet. In lockstep the robot moves on with the clock for it, if no
  /// SYNC does.
  virtual bool stops_alone() const = 0;
  /// A temperature [degC] that a bench measured; it replaces the thermal model.
  virtual std::optional<double> measured_temperature_degC() const { return std::nullopt; }

  /// For status lines and statistics.
  virtual std::string state_name() const = 0;
  virtual bool enabled() const = 0;
  virtual bool failed() const = 0;
  virtual std::vector<std::pair<std::string, std::uint64_t>> counts() const = 0;
};

}  // namespace tribotwin::hil
