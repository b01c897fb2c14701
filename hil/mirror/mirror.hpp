#pragma once

#include <algorithm>

#include <tribotwin/hil/drives/bus_drive.hpp>
#include <tribotwin/hil/drives/drive_parameters.hpp>
#include <tribotwin/hil/mirror/mirror_frames.hpp>
#include <tribotwin/hil/motion/sync_mean.hpp>
#include <tribotwin/hil/motion/torque_limit.hpp>

namespace tribotwin::hil {

struct MirrorCounters {
  std::uint64_t received = 0, repeated = 0, lost = 0, damaged = 0, late = 0, sent = 0;
};

/// A drive with this profile. Its status goes out with every SYNC, or every cycle where there is no SYNC. A command
/// that is older than three cycles (at least 20 ms) stops the drive: ramp, brake, fault until mode 15.
class MirrorDrive final : public BusDrive {
 public:
  MirrorDrive(const DriveParameters& parameters, Send send, MirrorFormat format = MirrorFormat::classic);

  void start(std::int64_t now_ns) override;
  void receive(const Frame& frame, std::int64_t now_ns) override;
  void sync(std::int64_t now_ns) override;
  void tick(std::int64_t now_ns) override;
  std::int64_t next_ns() const override;
  bool sends(std::uint32_t id) const override;
  bool takes(const Frame& frame) const override;
  twin::DriveCommand command(double dt_s) override;
  void feedback(const Feedback& feedback, double dt_s) override;
  twin::LoopGains gains() const override { return parameters_.gains; }
  bool brake_engaged() const override { return state_ == MirrorMode::off || state_ == MirrorMode::fault; }
  std::string state_name() const override;
  bool enabled() const override {
    return state_ == MirrorMode::torque || state_ == MirrorMode::position || state_ == MirrorMode::velocity;
  }
  bool failed() const override { return state_ == MirrorMode::fault; }
  bool stops_alone() const override { return stops_alone_; }
  std::vector<std::pair<std::string, std::uint64_t>> counts() const override;
  const MirrorCounters& counters() const { return counters_; }
  /// Age [ns] at which a command is too old.
  static constexpr std::int64_t patience_ns(std::int64_t cycle_us) {
    return std::max<std::int64_t>(3000 * cycle_us, 20'000'000);
  }

 private:
  void send_status(std::int64_t now_ns);
  DriveParameters parameters_;
  Send send_;
  MirrorFormat format_;
  double torque_max_nm_, speed_max_rad_s_;
  std::int64_t cycle_ns_, deadline_ns_, commanded_ns_ = -1, sent_ns_ = 0, synced_ns_ = -1;
  std::optional<MirrorCommand> last_;
  MirrorMode state_ = MirrorMode::off;
  bool fault_next_ = false, stops_alone_ = false;
  std::uint8_t counter_ = 0;
  Feedback feedback_;
  SyncMean mean_torque_nm_;
  SpeedLimitedTorque torque_;
  double demand_rad_ = 0, step_rad_s_ = 0, left_s_ = 0, ramp_rad_s_ = 0, standing_s_ = 0;
  MirrorCounters counters_;
};

}  // namespace tribotwin::hil
