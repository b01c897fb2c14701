#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <utility>

#include <fmt/format.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/can/wait_any.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

namespace tribotwin::hil {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;  // CLOCK_MONOTONIC

/// Frames that one end has not read yet. Guarded by the mutex of its bus.
struct Inbox {
  OpenOptions options;
  std::deque<Frame> frames;
  std::uint64_t lost = 0;
  twin::Descriptor event;  // readable while frames may be waiting; only of an end that is polled

  bool wants(const Frame& frame) const {
    if (frame.fd && !options.fd) return false;
    if (frame.error || options.identifiers.empty()) return true;
    return !frame.extended && !frame.remote &&
           std::ranges::find(options.identifiers, frame.id) != options.identifiers.end();
  }
};

struct Bus {
  std::mutex mutex;
  std::condition_variable filled;
  std::vector<Inbox*> ends;
};

/// The bus of that name; it exists as long as it has ends.
std::shared_ptr<Bus> bus_named(const std::string& name) {
  static std::mutex mutex;
  static std::map<std::string, std::weak_ptr<Bus>> buses;
  const std::lock_guard lock(mutex);
  std::erase_if(buses, [](const auto& entry) { return entry.second.expired(); });
  auto& known = buses[name];
  auto bus = known.lock();
  if (!bus) known = bus = std::make_shared<Bus>();
  return bus;
}

bool carriable(const Frame& frame, bool fd) {
  if (frame.fd && (!fd || frame.remote || frame.error)) return false;
  return valid_size(frame.fd, frame.size) && frame.id <= (frame.extended || frame.error ? 0x1FFFFFFFu : 0x7FFu);
}

class MemoryEnd final : public Transport, public Pollable {
 public:
  MemoryEnd(const std::string& name, const OpenOptions& options) : Transport(name), bus_(bus_named(name)) {
    inbox_.options = options;
    const std::lock_guard lock(bus_->mutex);
    bus_->ends.push_back(&inbox_);
  }

  ~MemoryEnd() override {
    const std::lock_guard lock(bus_->mutex);
    std::erase(bus_->ends, &inbox_);
  }

  MemoryEnd(const MemoryEnd&) = delete;
  MemoryEnd& operator=(const MemoryEnd&) = delete;

  Sent send(const Frame& frame) override {
    if (inbox_.options.listen_only || !carriable(frame, inbox_.options.fd)) {
      ++counters_.send_refused;
      return Sent::refused;
    }
    {
      const std::lock_guard lock(bus_->mutex);  // held until all ends have it, so that all see one order
      Frame stamped = frame;
      stamped.time_ns = std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
      for (Inbox* end : bus_->ends) {
        if (end == &inbox_ || !end->wants(stamped)) continue;
        if (end->frames.size() < max_queue)
          end->frames.push_back(stamped);
        else
          ++end->lost;
        if (end->event >= 0) ::eventfd_write(end->event, 1);
      }
    }
    bus_->filled.notify_all();
    ++counters_.sent;
    return Sent::done;
  }

  bool receive(Frame& frame) override {
    const std::lock_guard lock(bus_->mutex);
    counters_.receive_lost += std::exchange(inbox_.lost, 0);  // counters_ belong to the thread of this end
    if (inbox_.frames.empty()) return false;
    frame = inbox_.frames.front();
    inbox_.frames.pop_front();
    ++counters_.received;
    if (frame.error) ++counters_.error_frames;
    return true;
  }

  void wait(std::int64_t deadline_ns) override {
    const Clock::time_point deadline{std::chrono::nanoseconds(deadline_ns)};
    // A signal does not wake a condition variable. Returning early is allowed, so that the caller sees the effect of a
    // signal within 20 ms.
    const auto until = std::min(deadline, Clock::now() + 20ms);
    std::unique_lock lock(bus_->mutex);
    bus_->filled.wait_until(lock, until, [&] { return !inbox_.frames.empty(); });
  }

  std::int64_t watch(std::vector<pollfd>& polled, std::int64_t deadline_ns) override {
    const std::lock_guard lock(bus_->mutex);
    if (inbox_.event < 0) inbox_.event = twin::Descriptor(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
    eventfd_t waiting;
    ::eventfd_read(inbox_.event, &waiting);
    polled.push_back({.fd = inbox_.event.get(), .events = POLLIN, .revents = 0});
    return inbox_.frames.empty() ? deadline_ns : 0;
  }

  bool up() const override { return true; }
  std::string state() const override { return fmt::format("bus {} in this process", name_); }

 private:
  static constexpr std::size_t max_queue = 1 << 16;  // frames of an end that nobody reads: 7 MB

  std::shared_ptr<Bus> bus_;
  Inbox inbox_;
};

}  // namespace

std::unique_ptr<Transport> open_memory(const std::string& bus, const OpenOptions& options) {
  return std::make_unique<MemoryEnd>(bus, options);
}

}  // namespace tribotwin::hil
