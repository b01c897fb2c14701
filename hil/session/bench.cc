#include <algorithm>
#include <limits>
#include <utility>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/sync.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/session/bench.hpp>

namespace tribotwin::hil {

Bench::Bench(const twin::Scenario& scenario, const BenchOptions& options, Send send)
    : plant_(scenario), options_(options) {
  const auto counted = [this, send = std::move(send)](const Frame& frame) {
    // Drives that answer an LSS master alike do so at once, which makes one frame on a wire; fastscan rests on that.
    if (frame.id == cob::lss_to_master && std::exchange(lss_answer_, frame) == frame) return Sent::done;
    const Sent sent = send(frame);
    if (sent == Sent::done) {
      const Bits bits = bits_of(frame);
      counters_.bits += 0.5 * (bits.min + bits.max);
      ++counters_.frames_out;
    }
    return sent;
  };
  for (const auto& p : drive_parameters(scenario, options.first_node, options.cycle_us)) {
    joints_.push_back(p.name);
    if (options.profile != Profile::cia402) {
      drives_.push_back(std::make_unique<MirrorDrive>(p, counted, mirror_format(options.profile)));
      continue;
    }
    const std::size_t number = drives_.size();
    auto node = std::make_unique<Node>(
        p, counted, with_rules_of_the_bench(number < options.nodes.size() ? options.nodes[number] : NodeSetup{}));
    if (!first_) first_ = node.get();
    drives_.push_back(std::move(node));
  }
  plant_.show(drives_);
}

void Bench::start(std::int64_t now_ns) {
  for (const auto& drive : drives_) drive->start(now_ns);
}

Result<void> Bench::receive(const Frame& frame, std::int64_t now_ns) {
  ++counters_.frames_in;
  lss_answer_.reset();
  const Bits bits = bits_of(frame);
  counters_.bits += 0.5 * (bits.min + bits.max);
  if (!is_sync(frame)) {
    for (const auto& drive : drives_) drive->receive(frame, now_ns);
    start_clock(now_ns);
    return {};
  }
  const std::int64_t cycle = cycle_us();
  ++counters_.syncs;
  if (last_sync_ns_ >= 0 && now_ns - last_sync_ns_ < 500 * cycle) ++counters_.sync_fast;
  last_sync_ns_ = now_ns;
  // All drives answer with their state at this SYNC; then the robot moves on to the next.
  const std::uint64_t sent_before = counters_.frames_out;
  for (const auto& drive : drives_) drive->receive(frame, now_ns);
  for (const auto& drive : drives_) drive->sync(now_ns);
  if (options_.answered && counters_.frames_out > sent_before) options_.answered();
  if (!options_.lockstep) return {};
  moved_to_ns_ = -1;
  if (auto ok = plant_.advance(drives_, cycle, options_.stop); !ok) return ok;
  start_clock(now_ns);
  return {};
}

std::int64_t Bench::cycle_us() const {
  return std::max<std::int64_t>(1,
                                first_ ? first_->dictionary().get(od::communication_cycle_period) : options_.cycle_us);
}

Result<void> Bench::tick(std::int64_t now_ns) {
  // The robot first: what the drives say at a time then depends on that time alone, not on how often this is called. A
  // replay calls it only at the times of recorded frames.
  if (auto ok = follow_clock(now_ns); !ok) return ok;
  for (const auto& drive : drives_) drive->tick(now_ns);
  start_clock(now_ns);
  return {};
}

/// A file is written and forced to disk within the turn, which takes tens of milliseconds: then no drive may need its
/// set points.
NodeSetup Bench::with_rules_of_the_bench(NodeSetup setup) const {
  setup.may_keep = [this] { return !any_has_power(); };
  if (setup.keep && options_.kept)
    setup.keep = [this, keep = std::move(setup.keep)](const KeptParameters& parameters) {
      return options_.kept(keep(parameters));
    };
  return setup;
}

bool Bench::any_has_power() const {
  return std::ranges::any_of(drives_, [](const auto& drive) { return drive->enabled() || !drive->brake_engaged(); });
}

bool Bench::any_stops_alone() const {
  return std::ranges::any_of(drives_, [](const auto& drive) { return drive->stops_alone(); });
}

/// Where a drive has to stop alone, the clock begins to move the robot when the SYNC has been silent for its deadline.
void Bench::start_clock(std::int64_t now_ns) {
  if (!options_.lockstep) return;
  if (!any_stops_alone()) {
    moved_to_ns_ = -1;
    return;
  }
  if (moved_to_ns_ >= 0) return;
  const std::int64_t patience_ns = sync_patience_ns(default_sync_deadline_ms * ns_per_ms, cycle_us());
  moved_to_ns_ = last_sync_ns_ < 0 ? now_ns : std::max(now_ns, last_sync_ns_ + patience_ns);
}

Result<void> Bench::follow_clock(std::int64_t now_ns) {
  constexpr int ask_stop_steps = 256;
  for (int k = 1; moved_to_ns_ >= 0 && moved_to_ns_ + plant_.step_ns() <= now_ns; ++k) {
    if (auto ok = plant_.step(drives_); !ok) return ok;
    moved_to_ns_ = any_stops_alone() ? moved_to_ns_ + plant_.step_ns() : -1;
    if (k % ask_stop_steps == 0 && options_.stop && options_.stop()) break;
  }
  return {};
}

void Bench::recovered(std::int64_t now_ns) {
  for (const auto& drive : drives_) drive->recovered(now_ns);
}

std::int64_t Bench::next_ns() const {
  std::int64_t next = std::numeric_limits<std::int64_t>::max();
  for (const auto& drive : drives_) next = std::min(next, drive->next_ns());
  return moved_to_ns_ < 0 ? next : std::min(next, moved_to_ns_ + plant_.step_ns());
}

std::optional<std::size_t> Bench::sender(const Frame& frame) const {
  if (frame.extended || frame.error || frame.remote) return std::nullopt;
  const auto found = std::ranges::find_if(drives_, [&](const auto& drive) { return drive->sends(frame.id); });
  if (found == drives_.end()) return std::nullopt;
  return static_cast<std::size_t>(found - drives_.begin());
}

}  // namespace tribotwin::hil
