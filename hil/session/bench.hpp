#pragma once

#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/hil/mirror/mirror_frames.hpp>
#include <tribotwin/hil/session/plant.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// Drives and robot on one bus, the same for live sessions and replays: frames and times in, frames out.
namespace tribotwin::hil {

/// Counts of a session.
struct BenchCounters {
  std::uint64_t syncs = 0;
  std::uint64_t sync_fast =
      0;  ///< less than half a period after the last one, by the wall clock: a second master, or a wrong rate
  std::uint64_t frames_in = 0, frames_out = 0;
  double bits = 0;  ///< on a classic bus, mean of minimum and maximum stuffing
};

enum class Profile { cia402, mirror, mirror_fd };
constexpr MirrorFormat mirror_format(Profile profile) {
  return profile == Profile::mirror_fd ? MirrorFormat::fd : MirrorFormat::classic;
}

struct BenchOptions {
  Profile profile = Profile::cia402;
  int first_node = 1;
  std::uint32_t cycle_us = 2000;
  /// Each SYNC advances the robot by the cycle (1006h), and without a SYNC the clock does while drives stop that lost
  /// their commands. Else the owner steps the plant.
  bool lockstep = true;
  std::vector<NodeSetup> nodes;  ///< of a CANopen bench: how they start; those that are not named here as usual
  /// Asked about each command to store, after its file was written or could not be: what the drive answers.
  std::function<bool(bool done)> kept;
  std::function<bool()> stop;      ///< polled in a cycle of many steps: true ends it
  std::function<void()> answered;  ///< the drives have sent their answer to a SYNC; the robot has not moved yet
};

class Bench {
 public:
  /// `send` puts frames of the drives on the bus.
  Bench(const twin::Scenario& scenario, const BenchOptions& options, Send send);

  void start(std::int64_t now_ns);
  /// Fails when the simulation does.
  Result<void> receive(const Frame& frame, std::int64_t now_ns);
  /// Timers. Fails when the simulation does.
  Result<void> tick(std::int64_t now_ns);
  /// The bus is back after a link loss.
  void recovered(std::int64_t now_ns);
  std::int64_t next_ns() const;
  /// Which drive sends frames with this identifier, if any does.
  std::optional<std::size_t> sender(const Frame& frame) const;

  Plant& plant() { return plant_; }
  const Plant& plant() const { return plant_; }
  std::span<const std::unique_ptr<BusDrive>> drives() const { return drives_; }
  const std::vector<std::string>& joints() const { return joints_; }
  const BenchCounters& counters() const { return counters_; }
  /// Length of a cycle: 1006h of the first drive.
  std::int64_t cycle_us() const;

 private:
  NodeSetup with_rules_of_the_bench(NodeSetup setup) const;
  bool any_has_power() const;
  bool any_stops_alone() const;
  void start_clock(std::int64_t now_ns);
  Result<void> follow_clock(std::int64_t now_ns);

  Plant plant_;
  BenchOptions options_;
  std::vector<std::unique_ptr<BusDrive>> drives_;
  std::vector<std::string> joints_;
  Node* first_ = nullptr;  // of a CANopen bench: its 1006h is the length of a cycle
  BenchCounters counters_;
  std::optional<Frame> lss_answer_;  // to the frame that is being received
  std::int64_t last_sync_ns_ = -1;
  std::int64_t moved_to_ns_ = -1;  // to this time the clock has moved the robot; -1: it does not
};

}  // namespace tribotwin::hil
