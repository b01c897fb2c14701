#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/canopen/sync.hpp>
#include <tribotwin/hil/cia402/node.hpp>

namespace tribotwin::hil {

/// A joint without gravity behind the loops of a drive: inertia, viscous friction, torque limit, brake.
class SimulatedJoint {
 public:
  void step(BusDrive& drive, double dt_s) {
    using Mode = twin::DriveCommand::Mode;
    const twin::DriveCommand c = drive.command(dt_s);
    if (drive.brake_engaged()) robot_.velocity_rad_s = 0;
    const double speed =
        c.velocity_rad_s + (c.mode == Mode::position ? 30 * (c.position_rad - robot_.position_rad) : 0);
    double torque = c.torque_nm;
    if (c.mode != Mode::torque) torque += 200 * inertia_kgm2 * (speed - robot_.velocity_rad_s);
    if (c.mode == Mode::off) torque = 0;
    const double limit = std::min(c.torque_limit_nm, 1000.0);
    robot_.torque_nm = std::clamp(torque, -limit, limit);
    robot_.limited = robot_.torque_nm != torque;
    if (!drive.brake_engaged()) {
      robot_.velocity_rad_s += dt_s * (robot_.torque_nm - 2 * robot_.velocity_rad_s) / inertia_kgm2;
      robot_.position_rad += dt_s * robot_.velocity_rad_s;
    }
    drive.feedback(robot_, dt_s);
  }

 private:
  static constexpr double inertia_kgm2 = 10;  // arm side
  Feedback robot_;
};

/// The master's end of a bus in this process with one node on it. Time is simulated: it goes on while the master waits.
class OneDriveBus final : public Transport {
 public:
  explicit OneDriveBus(const DriveParameters& parameters)
      : Transport("memory:conform"),
        master_(open_memory("conform", {})),
        slave_(open_memory("conform", {})),
        node_(parameters, [this](const Frame& frame) { return slave_->send(frame); }) {
    node_.start(now_ns_);
  }

  Sent send(const Frame& frame) override {
    const Sent sent = master_->send(frame);
    deliver();
    return sent;
  }
  bool receive(Frame& frame) override { return master_->receive(frame); }
  /// Returns at the next frame of the node, to 100 us.
  void wait(std::int64_t deadline_ns) override {
    const auto before = slave_->counters().sent;
    while (now_ns_ < deadline_ns && slave_->counters().sent == before) {
      now_ns_ = std::min(deadline_ns, now_ns_ + 100'000);
      for (; stepped_ns_ + step_ns <= now_ns_; stepped_ns_ += step_ns) joint_.step(node_, 1e-9 * step_ns);
      deliver();
    }
  }
  bool up() const override { return true; }
  std::string state() const override { return "simulated"; }

  std::int64_t now_ns() const { return now_ns_; }
  Node& node() { return node_; }

 private:
  static constexpr std::int64_t step_ns = 1'000'000;

  void deliver() {
    Frame frame;
    while (slave_->receive(frame)) {
      if (is_sync(frame))
        node_.sync(now_ns_);
      else
        node_.receive(frame, now_ns_);
    }
    node_.tick(now_ns_);
  }

  std::unique_ptr<Transport> master_, slave_;
  std::int64_t now_ns_ = 1'000'000'000, stepped_ns_ = now_ns_;
  SimulatedJoint joint_;
  Node node_;
};

inline DriveParameters test_drive() {
  return {.node = 5, .name = "joint5", .gear_ratio = 100, .rated_torque_nm = 10, .cycle_us = 2000};
}

}  // namespace tribotwin::hil
