#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <deque>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sched.h>
#include <sys/mman.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/wait_any.hpp>
#include <tribotwin/hil/canopen/sync.hpp>
#include <tribotwin/hil/faults/faulty_bus.hpp>
#include <tribotwin/hil/session/drive.hpp>
#include <tribotwin/hil/session/session_record.hpp>
#include <tribotwin/hil/session/statistics.hpp>
#include <tribotwin/hil/timing/pace.hpp>
#include <tribotwin/hil/timing/sync_timing.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::hil {
namespace {

using Status = Result<void>;

constexpr double patience_s = 3;  // for the first SYNC, before its absence is said
constexpr std::int64_t s_ns = 1'000'000'000, longest_wait_ns = 20'000'000;

/// Whole microseconds, the resolution of a log, so that a replay sees the same times.
std::int64_t now_us_ns() { return clock_ns() / 1000 * 1000; }

void become_real_time(const std::function<void(const std::string&)>& note) {
  const sched_param priority{.sched_priority = 50};
  if (sched_setscheduler(0, SCHED_FIFO, &priority) != 0 && note)
    note(fmt::format("no real-time priority (SCHED_FIFO: {}); run as root or with CAP_SYS_NICE to have it",
                     std::strerror(errno)));
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0 && note)
    note(fmt::format("memory is not locked (mlockall: {}); deadlines may slip when the machine swaps",
                     std::strerror(errno)));
}

/// One live bus of a session.
struct LiveBus {
  LiveBus(Transport& transport, std::vector<Fault> faults, std::uint64_t seed, std::function<double()> time_s)
      : bus(transport, std::move(faults), seed, std::move(time_s)) {}
  FaultyBus bus;
  std::optional<double> bit_rate;
  SyncTiming sync;
  bool was_up = true;
  double bits_before = 0;
};

/// The faults of one bus.
std::vector<Fault> faults_on(std::size_t bus, std::vector<Fault> faults) {
  std::erase_if(faults, [bus](const Fault& f) { return f.bus.value_or(bus) != bus; });
  return faults;
}

/// A session of drives on live buses.
class Session : SessionControl {
 public:
  Session(const twin::Scenario& scenario, std::span<Transport* const> buses, const DriveOptions& o)
      : o_(o),
        pace_(std::llround(1e9 * scenario.model->get()->opt.timestep)),
        bench_(scenario,
               {.profile = o.profile,
                .first_node = o.first_node,
                .wiring = o.wiring,
                .cycle_us = o.cycle_us,
                .lockstep = !o.realtime,
                .nodes = o.nodes,
                .kept =
                    [this](bool done) {
                      if (record_) record_->keep(done);
                      return done;
                    },
                .stop = o.stop,
                .emcy =
                    [this](std::size_t drive, std::uint16_t code) {
                      if (o_.events.emcy) o_.events.emcy(time_s(), drive, code);
                    },
                .answered = [this](std::size_t bus) { buses_[bus].sync.answered(clock_ns(CLOCK_REALTIME)); }},
               [this](std::size_t bus, const Frame& frame) {
                 record(bus, frame, true);
                 return buses_[bus].bus.send(frame);
               }) {
    assert(buses.size() == bench_.buses());
    for (std::size_t i = 0; i < buses.size(); ++i) {
      LiveBus& live =
          buses_.emplace_back(*buses[i], faults_on(i, o.faults), scenario.seed + i, [this] { return time_s(); });
      live.bit_rate = o.bit_rate ? o.bit_rate : buses[i]->bit_rate();
      transports_.push_back(&live.bus);
    }
  }

  Status run() {
    now_ns_ = now_us_ns();
    if (auto ok = open(); !ok) return ok;
    bench_.plant().watch(o_.sample);
    if (o_.realtime) become_real_time(o_.note);
    bench_.start(now_ns_);
    if (record_) keep_record(record_->end());
    pace_.start(clock_ns());
    start_ns_ = now_us_ns();
    Status ran;
    while (ran && !finished()) ran = turn();
    return close(ran);
  }

 private:
  double time_s() const { return bench_.plant().twin().time_s(); }
  /// Since the robot's clock began: opening files and locking memory are not in it.
  double wall_s() const { return 1e-9 * static_cast<double>(std::max<std::int64_t>(0, now_ns_ - start_ns_)); }
  bool over() const { return o_.duration_s && time_s() >= *o_.duration_s - 1e-9; }
  bool finished() const { return (o_.stop && o_.stop()) || over(); }
  void note(const std::string& what) const {
    if (o_.note) o_.note(what);
  }

  void require_repeats(const std::string& what) const {
    if (record_ && !record_->repeats())
      throw twin::InputError(what + ": the record is no regular file, so a replay could not repeat it");
  }

  bool happen(YAML::Node event) override {
    require_repeats(event["type"].as<std::string>());
    bench_.plant().happen(event);
    if (record_) record_->event(twin::to_text(event));
    return record_ || !o_.output.empty();
  }

  void hold(std::optional<std::int64_t> cycles) override {
    require_repeats(cycles ? "pause" : "resume");
    bench_.hold(cycles);
    if (record_) record_->hold(cycles);
  }

  void inject(twin::Mapping& keys) override {
    require_repeats("fault");
    const Fault fault = read_fault(keys, bench_.joints(), o_.first_node, o_.wiring);
    if (std::ranges::any_of(buses_, [](LiveBus& live) { return live.bus.is_full(); }))
      throw twin::InputError("fault: 64 are at work, which is the most");
    for (std::size_t bus = 0; bus < buses_.size(); ++bus)
      if (fault.bus.value_or(bus) == bus) buses_[bus].bus.inject(fault);
  }

  Status open() {
    if (!o_.record.empty()) {
      const SessionHead head{
          o_.realtime,   o_.cycle_us, now_ns_ + to_realtime_ns_, scenario_checksum(bench_.plant().scenario()),
          o_.conditions, o_.wiring};
      auto record = SessionRecord::create(o_.record, head, o_.existing == twin::Existing::replace);
      if (!record) return work_failed(record.error().message);
      record_.emplace(std::move(*record));
      if (!record_->repeats() && (o_.realtime || !o_.faults.empty()) && !std::filesystem::is_character_file(o_.record))
        note(fmt::format(
            "{}: the log will not repeat: what it does not say is in a file beside it, which a pipe has not",
            o_.record.string()));
    }
    return o_.output.empty() ? Status{} : bench_.plant().record(o_.output, o_.existing);
  }

  void record(std::size_t bus, const Frame& frame, bool ours) {
    if (record_) keep_record(record_->frame(bus, frame, bench_.sender(bus, frame).has_value() != ours));
  }
  /// The robot must not fall because a disk is full: the record ends, the drives continue.
  void keep_record(const Status& written) {
    if (written) return;
    record_.reset();
    lose(written.error().message);
  }
  void lose(const std::string& what) {
    lost_.push_back(fmt::format("{}; recorded up to {:.3f} s", what, time_s()));
    note(lost_.back() + "; the drives go on");
  }

  /// Waits once and handles all that arrived.
  Status turn() {
    const std::int64_t due_ns = o_.realtime ? pace_.due_ns() : std::numeric_limits<std::int64_t>::max();
    wait(std::min({now_ns_ + longest_wait_ns, std::max<std::int64_t>(bench_.next_ns(), now_ns_), due_ns}));
    // One time for all frames of a turn: a clock call per frame would cost more than the answer. Each turn has a time
    // of its own, so that a replay runs the timers as often.
    now_ns_ = std::max(now_ns_ + 1000, now_us_ns());
    if (record_) record_->begin(now_ns_ + to_realtime_ns_);
    if (auto ok = bench_.tick(now_ns_); !ok) return ok;
    for (std::size_t bus = 0; bus < buses_.size(); ++bus)
      if (auto ok = take_frames(bus); !ok) return ok;
    if (o_.realtime)
      if (auto ok = follow_clock(); !ok) return ok;
    for (std::size_t bus = 0; bus < buses_.size(); ++bus) follow_link(bus);
    if (record_) keep_record(record_->end());
    if (const auto& failure = bench_.plant().record_failure();
        !failure.empty() && !std::exchange(telemetry_lost_, true))
      lose(failure);
    if (now_ns_ - status_ns_ >= s_ns / 5) report();
    return {};
  }

  void wait(std::int64_t deadline_ns) {
    if (transports_.size() == 1) return transports_[0]->wait(deadline_ns);
    wait_any(transports_, deadline_ns);
  }

  Status take_frames(std::size_t bus) {
    LiveBus& live = buses_[bus];
    Frame frame;
    // Bounded, so that a flooded bus cannot keep the clock from being served.
    for (int i = 0; i < 256 && !finished() && live.bus.receive(frame); ++i) {
      record(bus, frame, false);
      if (is_sync(frame))
        live.sync.sync(frame.time_ns > 0 ? frame.time_ns : clock_ns(CLOCK_REALTIME), bench_.cycle_us());
      if (auto ok = bench_.receive(bus, frame, now_ns_); !ok) return ok;
      impose_faults();
    }
    return {};
  }

  /// Bounded, so that a robot that cannot keep up with the clock does not keep the bus from being served.
  Status follow_clock() {
    for (int k = 0; k < 256 && !finished() && pace_.take(clock_ns()); ++k) {
      const auto moved = bench_.step();
      if (!moved) return tl::unexpected(moved.error());
      if (*moved && record_) record_->step();
    }
    impose_faults();
    return {};
  }

  void impose_faults() {
    for (std::size_t bus = 0; bus < buses_.size(); ++bus)
      for (DriveFault fault : buses_[bus].bus.changed(o_.first_node)) {
        if (!o_.wiring.empty()) fault.drive = o_.wiring[bus][fault.drive];
        bench_.plant().impose(fault);
        if (record_) record_->fault(fault);
      }
  }

  void follow_link(std::size_t bus) {
    LiveBus& live = buses_[bus];
    if (live.bus.up() == live.was_up) return;
    note(live.bus.state());
    live.was_up = live.bus.up();
    if (!live.was_up) return;
    bench_.recovered(bus, now_ns_);
    if (record_) record_->recovered(bus);
  }

  void report() {
    std::vector<SessionStatus::Bus> loads;
    for (std::size_t i = 0; i < buses_.size(); ++i) {
      const double bits = bench_.counters(i).bits - std::exchange(buses_[i].bits_before, bench_.counters(i).bits);
      const double per_s = status_ns_ ? 1e9 * bits / static_cast<double>(now_ns_ - status_ns_) : 0;
      loads.push_back({&buses_[i].bus, per_s, buses_[i].bit_rate, &buses_[i].sync});
    }
    status_ns_ = now_ns_;
    if (record_) keep_record(record_->flush());
    tell_slow_motion();
    tell_waiting();
    if (o_.status) o_.status({time_s(), wall_s(), pace_.overruns(), &bench_, std::move(loads), this});
  }

  /// Of the bus with the fastest SYNC, which the others follow.
  std::optional<std::string> slow_motion() const {
    const auto scale = [](const LiveBus& live) { return live.sync.time_scale().value_or(0); };
    return std::ranges::max_element(buses_, {}, scale)->sync.slow_motion();
  }

  /// In lockstep a slow SYNC is a slow robot. Said once.
  void tell_slow_motion() {
    if (o_.realtime || told_slow_motion_) return;
    const auto slow = slow_motion();
    if (!slow) return;
    told_slow_motion_ = true;
    note(*slow);
  }

  bool any_sync() const {
    for (std::size_t bus = 0; bus < bench_.buses(); ++bus)
      if (bench_.counters(bus).syncs > 0) return true;
    return false;
  }

  /// In lockstep nothing moves without a SYNC. Said once.
  void tell_waiting() {
    if (o_.realtime || told_waiting_ || any_sync() || wall_s() < patience_s) return;
    told_waiting_ = true;
    note("no SYNC yet: the robot stands until a master sends SYNCs; --realtime moves it with the clock");
  }

  /// What summary.json warns of.
  std::vector<std::string> warnings() const {
    if (o_.realtime && pace_.overruns() > 0)
      return {
          fmt::format("{} of {} steps began more than a step late, the worst {:.3g} ms; the robot stood still for "
                      "{:.3g} s in pauses that it did not catch up",
                      pace_.overruns(), pace_.lateness().count(), 1e-6 * static_cast<double>(pace_.lateness().max_ns()),
                      1e-9 * static_cast<double>(pace_.skipped_ns()))};
    const auto slow = o_.realtime ? std::nullopt : slow_motion();
    return slow ? std::vector{*slow} : std::vector<std::string>{};
  }

  /// Closes all that was written, however the session ended.
  Status close(const Status& ran) {
    std::vector<std::string> problems;
    const auto check = [&](const Status& status) {
      if (!status) problems.push_back(status.error().message);
    };
    check(ran);
    const bool cut_short = ran && o_.duration_s && !over();
    if (cut_short)
      problems.push_back(fmt::format("interrupted at {:.3f} s of {} s", time_s(), *o_.duration_s));
    else if (ran && !over())
      note(fmt::format("interrupted at {:.3f} s", time_s()));
    problems.insert(problems.end(), lost_.begin(), lost_.end());
    tell_slow_motion();
    if (record_) check(record_->finish());
    if (ran)
      if (auto ok = bench_.plant().finish(wall_s(), cut_short, warnings()); !telemetry_lost_) check(ok);
    if (!o_.statistics.empty()) check(twin::write_file(o_.statistics, statistics(), o_.existing));
    if (o_.show_statistics) o_.show_statistics(statistics());
    if (problems.empty()) return {};
    return work_failed(fmt::format("{}", fmt::join(problems, "; ")));
  }

  std::string statistics() {
    std::vector<MeasuredBus> all;
    for (const LiveBus& live : buses_) all.push_back({live.bus.name(), live.bus.counters(), live.bit_rate, &live.sync});
    return statistics_json(bench_, all, wall_s(), o_.realtime ? &pace_ : nullptr);
  }

  const DriveOptions& o_;
  std::int64_t start_ns_ = now_us_ns(), now_ns_ = start_ns_, status_ns_ = 0;
  const std::int64_t to_realtime_ns_ = clock_ns(CLOCK_REALTIME) / 1000 * 1000 - start_ns_;
  Pace pace_;
  std::optional<SessionRecord> record_;
  std::deque<LiveBus> buses_;
  std::vector<Transport*> transports_;  // the same
  Bench bench_;
  bool telemetry_lost_ = false, told_slow_motion_ = false, told_waiting_ = false;
  std::vector<std::string> lost_;
};

}  // namespace

Result<void> drive(const twin::Scenario& scenario, Transport& bus, const DriveOptions& options) {
  Transport* const one[] = {&bus};
  return drive(scenario, one, options);
}

Result<void> drive(const twin::Scenario& scenario, std::span<Transport* const> buses, const DriveOptions& options) {
  return Session(scenario, buses, options).run();
}

}  // namespace tribotwin::hil
