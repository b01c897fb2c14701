#include <algorithm>
#include <limits>
#include <utility>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/sync.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/session/bench.hpp>

namespace tribotwin::hil {

namespace {

Bench::SendOn on_one_bus(Send send) {
  return [send = std::move(send)](std::size_t, const Frame& frame) { return send(frame); };
}

/// The error code of a frame of a CANopen drive that is an EMCY.
std::optional<std::uint16_t> emcy_of(const BusDrive& drive, const Frame& frame) {
  if (frame.id != cob::emcy + static_cast<const Node&>(drive).id()) return std::nullopt;
  return static_cast<std::uint16_t>(frame.data[0] | frame.data[1] << 8);
}

}  // namespace

Bench::Bench(const twin::Scenario& scenario, const BenchOptions& options, Send send)
    : Bench(scenario, options, on_one_bus(std::move(send))) {}

Bench::Bench(const twin::Scenario& scenario, const BenchOptions& options, SendOn send)
    : plant_(scenario), options_(options), buses_(bus_count(options.wiring)), rendezvous_(bus_count(options.wiring)) {
  for (const auto& p : drive_parameters(scenario, options.first_node, options.cycle_us, options.wiring)) {
    const std::size_t number = drives_.size(), bus = bus_of(number);
    const Send send_counted = [this, number, send](const Frame& frame) { return counted(number, frame, send); };
    joints_.push_back(p.name);
    if (options.profile != Profile::cia402) {
      drives_.push_back(std::make_unique<MirrorDrive>(p, send_counted, mirror_format(options.profile)));
    } else {
      auto node = std::make_unique<Node>(
          p, send_counted,
          with_rules_of_the_bench(number < options.nodes.size() ? options.nodes[number] : NodeSetup{}));
      if (!first_) first_ = node.get();
      drives_.push_back(std::move(node));
    }
    buses_[bus].drives.push_back(drives_.back().get());
  }
  plant_.show(drives_);
}

void Bench::start(std::int64_t now_ns) {
  for (const auto& drive : drives_) drive->start(now_ns);
}

Sent Bench::counted(std::size_t drive, const Frame& frame, const SendOn& send) {
  const std::size_t bus = bus_of(drive);
  Bus& b = buses_[bus];
  if (const auto code = options_.emcy && first_ ? emcy_of(*drives_[drive], frame) : std::nullopt)
    options_.emcy(drive, *code);
  // Drives that answer an LSS master alike do so at once, which makes one frame on a wire; fastscan rests on that.
  if (frame.id == cob::lss_to_master && std::exchange(b.lss_answer, frame) == frame) return Sent::done;
  const Sent sent = send(bus, frame);
  if (sent != Sent::done) return sent;
  const Bits bits = bits_of(frame);
  b.counters.bits += 0.5 * (bits.min + bits.max);
  ++b.counters.frames_out;
  return sent;
}

void Bench::count(Bus& bus, const Frame& frame, std::int64_t now_ns) {
  ++bus.counters.frames_in;
  const Bits bits = bits_of(frame);
  bus.counters.bits += 0.5 * (bits.min + bits.max);
  const auto takes = [&](const BusDrive* drive) { return drive->takes(frame); };
  bus.counters.foreign += !frame.error && !is_sync(frame) && std::ranges::none_of(bus.drives, takes);
  if (!is_sync(frame)) return;
  ++bus.counters.syncs;
  if (bus.last_sync_ns >= 0 && now_ns - bus.last_sync_ns < 500 * cycle_us()) ++bus.counters.sync_fast;
  bus.last_sync_ns = now_ns;
}

Result<void> Bench::receive(std::size_t bus, const Frame& frame, std::int64_t now_ns) {
  constexpr std::size_t most_kept = 4096;
  Bus& b = buses_[bus];
  count(b, frame, now_ns);
  const bool sync = is_sync(frame);
  const bool waits = options_.lockstep && (!b.kept.empty() || (sync && rendezvous_.waits(bus)));
  if (!waits) {
    if (auto ok = handle(bus, frame, now_ns, now_ns); !ok) return ok;
    return release(now_ns);
  }
  b.kept.push_back({frame, now_ns});
  b.syncs_kept += sync;
  if (b.syncs_kept < 2 && b.kept.size() < most_kept) return {};
  return abandon_cycle(now_ns);
}

Result<void> Bench::handle(std::size_t bus, const Frame& frame, std::int64_t came_ns, std::int64_t now_ns) {
  Bus& b = buses_[bus];
  b.lss_answer.reset();
  // All drives answer with their state at this SYNC; then the robot moves on to the next.
  const std::uint64_t sent_before = b.counters.frames_out;
  for (BusDrive* drive : b.drives) drive->receive(frame, now_ns);
  if (is_sync(frame)) {
    for (BusDrive* drive : b.drives) drive->sync(now_ns);
    if (options_.answered && b.counters.frames_out > sent_before) options_.answered(bus);
    if (!options_.lockstep) return {};
    if (rendezvous_.arrive(bus, came_ns))
      if (auto ok = advance(now_ns); !ok) return ok;
  }
  start_clock(now_ns);
  return {};
}

Result<void> Bench::advance(std::int64_t now_ns) {
  for (std::size_t bus = 0; bus < buses_.size(); ++bus) buses_[bus].counters.sync_alone += !rendezvous_.waits(bus);
  rendezvous_.end_cycle();
  moved_to_ns_ = -1;
  last_cycle_ns_ = now_ns;
  if (stands()) return {};
  moved(cycle_us());
  return plant_.advance(drives_, cycle_us(), options_.stop);
}

void Bench::hold(std::optional<std::int64_t> cycles) {
  stood_ = stood_ || stands();
  left_us_ = cycles;
  if (left_us_) *left_us_ *= cycle_us();
}

std::optional<std::int64_t> Bench::left() const {
  if (!left_us_) return std::nullopt;
  return std::max<std::int64_t>(0, (*left_us_ + cycle_us() - 1) / cycle_us());
}

Result<bool> Bench::step() {
  if (stands()) return false;
  moved(plant_.step_ns() / 1000);
  if (auto ok = plant_.step(drives_); !ok) return tl::unexpected(ok.error());
  return true;
}

/// The robot moves on without the SYNCs that are missing.
Result<void> Bench::abandon_cycle(std::int64_t now_ns) {
  if (auto ok = advance(now_ns); !ok) return ok;
  return release(now_ns);
}

/// Handles the frames that were kept, up to the next SYNC that has to wait.
Result<void> Bench::release(std::int64_t now_ns) {
  for (bool again = any_kept(); again;) {
    again = false;
    for (std::size_t bus = 0; bus < buses_.size(); ++bus)
      for (Bus& b = buses_[bus]; !b.kept.empty() && !(is_sync(b.kept.front().frame) && rendezvous_.waits(bus));
           again = true) {
        const Bus::Kept kept = b.kept.front();
        b.kept.pop_front();
        b.syncs_kept -= is_sync(kept.frame);
        if (auto ok = handle(bus, kept.frame, kept.came_ns, now_ns); !ok) return ok;
      }
  }
  return {};
}

bool Bench::any_kept() const {
  return std::ranges::any_of(buses_, [](const Bus& bus) { return !bus.kept.empty(); });
}

/// Half the time after which drives miss what is kept.
std::int64_t Bench::patience_ns() const {
  const std::int64_t cycle = cycle_us();
  return (first_ ? sync_patience_ns(default_sync_deadline_ms * ns_per_ms, cycle) : MirrorDrive::patience_ns(cycle)) / 2;
}

std::int64_t Bench::cycle_us() const {
  return std::max<std::int64_t>(1,
                                first_ ? first_->dictionary().get(od::communication_cycle_period) : options_.cycle_us);
}

Result<void> Bench::tick(std::int64_t now_ns) {
  // The robot first: what the drives say at a time then depends on that time alone, not on how often this is called. A
  // replay calls it only at the times of recorded frames.
  if (auto ok = follow_clock(now_ns); !ok) return ok;
  if (any_kept() && now_ns - rendezvous_.missing_since_ns() > patience_ns()) {
    rendezvous_.give_up();
    if (auto ok = abandon_cycle(now_ns); !ok) return ok;
  }
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

/// Where a drive has to stop alone, the clock begins to move the robot when no SYNC has moved it for their deadline.
void Bench::start_clock(std::int64_t now_ns) {
  if (!options_.lockstep) return;
  if (!any_stops_alone()) {
    moved_to_ns_ = -1;
    return;
  }
  if (moved_to_ns_ >= 0) return;
  const std::int64_t patience_ns = sync_patience_ns(default_sync_deadline_ms * ns_per_ms, cycle_us());
  moved_to_ns_ = last_cycle_ns_ < 0 ? now_ns : std::max(now_ns, last_cycle_ns_ + patience_ns);
}

Result<void> Bench::follow_clock(std::int64_t now_ns) {
  constexpr int ask_stop_steps = 256;
  // By the time of this call alone, which a replay has too: it has fewer calls while the robot stands.
  if (!stands() && std::exchange(stood_, false) && moved_to_ns_ >= 0) moved_to_ns_ = std::max(moved_to_ns_, now_ns);
  for (int k = 1; !stands() && moved_to_ns_ >= 0 && moved_to_ns_ + plant_.step_ns() <= now_ns; ++k) {
    if (auto ok = step(); !ok) return tl::unexpected(ok.error());
    rendezvous_.end_cycle();
    moved_to_ns_ = any_stops_alone() ? moved_to_ns_ + plant_.step_ns() : -1;
    if (k % ask_stop_steps == 0 && options_.stop && options_.stop()) break;
  }
  return {};
}

void Bench::recovered(std::size_t bus, std::int64_t now_ns) {
  for (BusDrive* drive : buses_[bus].drives) drive->recovered(now_ns);
}

std::int64_t Bench::next_ns() const {
  std::int64_t next = std::numeric_limits<std::int64_t>::max();
  for (const auto& drive : drives_) next = std::min(next, drive->next_ns());
  if (any_kept()) next = std::min(next, rendezvous_.missing_since_ns() + patience_ns() + 1);
  return moved_to_ns_ < 0 || stands() ? next : std::min(next, moved_to_ns_ + plant_.step_ns());
}

std::optional<std::size_t> Bench::sender(std::size_t bus, const Frame& frame) const {
  if (frame.extended || frame.error || frame.remote) return std::nullopt;
  for (std::size_t i = 0; i < drives_.size(); ++i)
    if (bus_of(i) == bus && drives_[i]->sends(frame.id)) return i;
  return std::nullopt;
}

}  // namespace tribotwin::hil
