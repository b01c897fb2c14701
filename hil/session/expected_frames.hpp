#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>

#include <tribotwin/hil/can/frame.hpp>

namespace tribotwin::hil {

/// Frames that the drives send in a replay, per identifier, until the log brings them. A log without the frames of a
/// drive never does: of each identifier only the newest are kept, and the older ones counted.
class ExpectedFrames {
 public:
  /// Kept of one identifier; a session records each frame within its turn, so a whole log is never this far behind.
  static constexpr std::size_t longest = 1024;

  struct Rest {
    std::uint64_t count = 0;
    Frame last;
  };

  void push(const Frame& frame) {
    Queue& queue = queues_[frame.id];
    queue.frames.push_back(frame);
    if (queue.frames.size() <= longest) return;
    queue.frames.pop_front();
    ++queue.dropped;
  }
  /// The oldest kept frame of an identifier; none: nothing is expected.
  std::optional<Frame> pop(std::uint32_t id) {
    auto& frames = queues_[id].frames;
    if (frames.empty()) return std::nullopt;
    const Frame frame = frames.front();
    frames.pop_front();
    return frame;
  }
  /// What the log did not bring, by identifier.
  std::map<std::uint32_t, Rest> left() const {
    std::map<std::uint32_t, Rest> all;
    for (const auto& [id, queue] : queues_) {
      const std::uint64_t count = queue.dropped + queue.frames.size();
      if (count > 0) all[id] = {count, queue.frames.empty() ? Frame{.id = id} : queue.frames.back()};
    }
    return all;
  }
  bool empty() const { return queues_.empty(); }
  /// Kept now, of all identifiers.
  std::size_t size() const {
    std::size_t kept = 0;
    for (const auto& [id, queue] : queues_) kept += queue.frames.size();
    return kept;
  }

 private:
  struct Queue {
    std::deque<Frame> frames;
    std::uint64_t dropped = 0;
  };
  std::map<std::uint32_t, Queue> queues_;
};

}  // namespace tribotwin::hil
