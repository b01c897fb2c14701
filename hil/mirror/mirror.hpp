#pragma once

#include <array>
#include <span>

#include <tribotwin/hil/drives/bus_drive.hpp>
#include <tribotwin/hil/drives/drive_parameters.hpp>

/// The profile for benches without CANopen: per drive one command frame and one status frame, 8 bytes, little-endian.
///
///     command 100h + node   bits 0..3 counter, 4..7 mode (0 off, 1 torque, 2 position, 3 velocity, 15 clear fault),
///                           8..39 set point i32 [mNm, 1e-6 rad, 1e-6 rad/s, arm side], 40..55 zero, 56..63 CRC
///     status  180h + node   bits 0..3 counter, 4..7 state (mode that is followed, 8 stopping, 15 fault),
///                           8..31 position i24 [1e-5 rad], 32..43 torque i12 [0.001 torque_max_nm],
///                           44..55 temperature u12 [0.1 degC from -50 degC], 56..63 CRC
///
/// The CRC is SAE J1850 (polynomial 1Dh, start and final XOR FFh) over the identifier's two bytes, low first, and bytes
/// 0..6, so that a frame of another drive is not mistaken for one of this drive. The counter goes up by one with every
/// frame.
namespace tribotwin::hil {

std::uint8_t crc8_j1850(std::span<const std::uint8_t> bytes, std::uint8_t crc = 0xFF);

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
  double set_point = 0;  ///< Nm, rad, rad/s; arm side
};
struct MirrorStatus {
  std::uint8_t counter = 0;
  MirrorMode state = MirrorMode::off;
  double position_rad = 0, torque_norm = 0, temperature_degC = 0;
};

Frame encode(const MirrorCommand& command, int node);
Frame encode(const MirrorStatus& status, int node);
/// Identifier of a drive's status frame.
std::uint32_t mirror_status_id(int node);
/// None where the CRC or the length is wrong.
std::optional<MirrorCommand> decode_command(const Frame& frame);
std::optional<MirrorStatus> decode_status(const Frame& frame);

struct MirrorCounters {
  std::uint64_t received = 0, repeated = 0, lost = 0, damaged = 0, late = 0, sent = 0;
};

/// A drive with this profile. Its status goes out with every SYNC, or every cycle where there is no SYNC. A command
/// that is older than three cycles (at least 20 ms) stops the drive: ramp, brake, fault until mode 15.
class MirrorDrive final : public BusDrive {
 public:
  MirrorDrive(const DriveParameters& parameters, Send send);

  void start(std::int64_t now_ns) override;
  void receive(const Frame& frame, std::int64_t now_ns) override;
  void sync(std::int64_t now_ns) override;
  void tick(std::int64_t now_ns) override;
  std::int64_t next_ns() const override;
  bool sends(std::uint32_t id) const override;
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

 private:
  void send_status(std::int64_t now_ns);
  DriveParameters parameters_;
  Send send_;
  double torque_max_nm_, speed_max_rad_s_;
  std::int64_t cycle_ns_, deadline_ns_, commanded_ns_ = -1, sent_ns_ = 0, synced_ns_ = -1;
  std::optional<MirrorCommand> last_;
  MirrorMode state_ = MirrorMode::off;
  bool fault_next_ = false, stops_alone_ = false;
  std::uint8_t counter_ = 0;
  Feedback feedback_;
  double demand_rad_ = 0, step_rad_s_ = 0, left_s_ = 0, ramp_rad_s_ = 0, standing_s_ = 0;
  MirrorCounters counters_;
};

struct DescribedMirror {
  int node;
  std::string joint;
  double torque_max_nm;
};
std::string mirror_dbc(std::span<const DescribedMirror> drives);

}  // namespace tribotwin::hil
