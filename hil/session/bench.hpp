#pragma once

#include <deque>

#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/hil/mirror/mirror_frames.hpp>
#include <tribotwin/hil/session/plant.hpp>
#include <tribotwin/hil/session/rendezvous.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// Drives and robot on one bus or several, the same for live sessions and replays: frames and times in, frames out.
namespace tribotwin::hil {

/// Counts of one bus.
struct BenchCounters {
  std::uint64_t syncs = 0;
  std::uint64_t sync_fast =
      0;  ///< less than half a period after the last one, by the wall clock: a second master, or a wrong rate
  std::uint64_t sync_alone = 0;  ///< in lockstep: cycles of the robot without a SYNC of this bus
  std::uint64_t frames_in = 0, frames_out = 0;
  std::uint64_t foreign = 0;  ///< of frames_in: no drive of this bus is meant
  double bits = 0;            ///< on a classic bus, mean of minimum and maximum stuffing
};

enum class Profile { cia402, mirror, mirror_fd };
constexpr MirrorFormat mirror_format(Profile profile) {
  return profile == Profile::mirror_fd ? MirrorFormat::fd : MirrorFormat::classic;
}

struct BenchOptions {
  Profile profile = Profile::cia402;
  int first_node = 1;  ///< on each bus
  Wiring wiring;       ///< the drives on each bus; all on one without
  std::uint32_t cycle_us = 2000;
  /// Each SYNC advances the robot by the cycle (1006h), and without a SYNC the clock does while drives stop that lost
  /// their commands. Else the owner steps the plant.
  bool lockstep = true;
  std::vector<NodeSetup> nodes;  ///< of a CANopen bench: how they start; those that are not named here as usual
  /// Asked about each command to store, after its file was written or could not be: what the drive answers.
  std::function<bool(bool done)> kept;
  std::function<bool()> stop;  ///< polled in a cycle of many steps: true ends it
  /// A drive sends an EMCY with this error code (0: no error any more), also where its bus is down or a fault takes the
  /// frame.
  std::function<void(std::size_t drive, std::uint16_t code)> emcy;
  /// The drives of a bus have sent their answer to its SYNC; the robot has not moved yet.
  std::function<void(std::size_t bus)> answered;
};

/// In lockstep with several buses each SYNC is one of each bus: the robot moves on when all buses had theirs. A bus
/// that is ahead waits: from its second SYNC on its frames are kept until the other bus had its own. Where that is
/// silent, or the second SYNC is followed by a third, the cycle ends without it. A bus never waits for so long that its
/// drives react to it.
class Bench {
 public:
  /// `send` puts frames of the drives on the bus.
  Bench(const twin::Scenario& scenario, const BenchOptions& options, Send send);
  /// The same, on the bus that it is told.
  using SendOn = std::function<Sent(std::size_t bus, const Frame& frame)>;
  Bench(const twin::Scenario& scenario, const BenchOptions& options, SendOn send);

  void start(std::int64_t now_ns);
  /// A frame on `bus`. Fails when the simulation does.
  Result<void> receive(std::size_t bus, const Frame& frame, std::int64_t now_ns);
  Result<void> receive(const Frame& frame, std::int64_t now_ns) { return receive(0, frame, now_ns); }
  /// Timers. Fails when the simulation does.
  Result<void> tick(std::int64_t now_ns);
  /// The bus is back after a link loss.
  void recovered(std::size_t bus, std::int64_t now_ns);
  std::int64_t next_ns() const;
  /// The robot stands after `cycles` more cycles, whatever SYNC and clock say, and goes on without a value; from the
  /// next `tick` on. Its drives answer as ever. Their timers run by the clock, what they do with the robot does not.
  void hold(std::optional<std::int64_t> cycles);
  /// Cycles until the robot stands; without a value: it is not held.
  std::optional<std::int64_t> left() const;
  /// A step of the robot where the owner moves it; false: it stands.
  Result<bool> step();
  /// Which drive sends frames with this identifier on this bus, if any does.
  std::optional<std::size_t> sender(std::size_t bus, const Frame& frame) const;

  Plant& plant() { return plant_; }
  const Plant& plant() const { return plant_; }
  std::span<const std::unique_ptr<BusDrive>> drives() const { return drives_; }
  const std::vector<std::string>& joints() const { return joints_; }
  std::size_t buses() const { return buses_.size(); }
  std::size_t bus_of(std::size_t drive) const { return place_of(options_.wiring, drive).bus; }
  const BenchCounters& counters(std::size_t bus = 0) const { return buses_[bus].counters; }
  /// Length of a cycle: 1006h of the first drive.
  std::int64_t cycle_us() const;

 private:
  struct Bus {
    std::vector<BusDrive*> drives;
    BenchCounters counters;
    std::optional<Frame> lss_answer;  // to the frame that is being received
    std::int64_t last_sync_ns = -1;
    struct Kept {
      Frame frame;
      std::int64_t came_ns;
    };
    std::deque<Kept> kept;  // frames from a SYNC on that waits for another bus
    int syncs_kept = 0;
  };
  Sent counted(std::size_t drive, const Frame& frame, const SendOn& send);
  void count(Bus& bus, const Frame& frame, std::int64_t now_ns);
  Result<void> handle(std::size_t bus, const Frame& frame, std::int64_t came_ns, std::int64_t now_ns);
  Result<void> advance(std::int64_t now_ns);
  Result<void> abandon_cycle(std::int64_t now_ns);
  Result<void> release(std::int64_t now_ns);
  std::int64_t patience_ns() const;
  bool any_kept() const;
  NodeSetup with_rules_of_the_bench(NodeSetup setup) const;
  bool any_has_power() const;
  bool any_stops_alone() const;
  void start_clock(std::int64_t now_ns);
  Result<void> follow_clock(std::int64_t now_ns);
  bool stands() const { return left_us_ && *left_us_ <= 0; }
  void moved(std::int64_t us) {
    if (left_us_) *left_us_ -= us;
  }

  Plant plant_;
  BenchOptions options_;
  std::vector<std::unique_ptr<BusDrive>> drives_;
  std::vector<std::string> joints_;
  Node* first_ = nullptr;  // of a CANopen bench: its 1006h is the length of a cycle
  std::vector<Bus> buses_;
  Rendezvous rendezvous_;
  std::int64_t last_cycle_ns_ = -1;      // when a SYNC moved the robot on
  std::int64_t moved_to_ns_ = -1;        // to this time the clock has moved the robot; -1: it does not
  std::optional<std::int64_t> left_us_;  // until the robot stands
  bool stood_ = false;                   // when it was told to move; the clock has not moved it since
};

}  // namespace tribotwin::hil
