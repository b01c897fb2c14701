#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sched.h>
#include <sys/mman.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/canopen/sync.hpp>
#include <tribotwin/hil/faults/faulty_bus.hpp>
#include <tribotwin/hil/session/drive.hpp>
#include <tribotwin/hil/session/session_record.hpp>
#include <tribotwin/hil/session/statistics.hpp>
#include <tribotwin/hil/timing/pace.hpp>
#include <tribotwin/hil/timing/sync_timing.hpp>
#include <tribotwin/twin/io/file.hpp>

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

/// A session of drives on a live bus.
class Session {
 public:
  Session(const twin::Scenario& scenario, Transport& bus, const DriveOptions& o)
      : o_(o),
        pace_(std::llround(1e9 * scenario.model->get()->opt.timestep)),
        bus_(bus, o.faults, scenario.seed, [this] { return running_ ? time_s() : 0.0; }),
        bench_(scenario,
               {.profile = o.profile,
                .first_node = o.first_node,
                .cycle_us = o.cycle_us,
                .lockstep = !o.realtime,
                .nodes = o.nodes,
                .kept =
                    [this](bool done) {
                      if (record_) record_->keep(done);
                      return done;
                    },
                .stop = o.stop,
                .answered = [this] { sync_.answered(clock_ns(CLOCK_REALTIME)); }},
               [this](const Frame& frame) {
                 record(frame, true);
                 return bus_.send(frame);
               }) {
    running_ = true;
  }

  Status run() {
    start_ns_ = now_ns_ = now_us_ns();
    if (auto ok = open(); !ok) return ok;
    if (o_.realtime) become_real_time(o_.note);
    bench_.start(now_ns_);
    if (record_) keep_record(record_->end());
    pace_.start(clock_ns());
    Status ran;
    while (ran && !finished()) ran = turn();
    return close(ran);
  }

 private:
  double time_s() const { return bench_.plant().twin().time_s(); }
  double wall_s() const { return 1e-9 * static_cast<double>(now_ns_ - start_ns_); }
  bool over() const { return o_.duration_s && time_s() >= *o_.duration_s - 1e-9; }
  bool finished() const { return (o_.stop && o_.stop()) || over(); }
  void note(const std::string& what) const {
    if (o_.note) o_.note(what);
  }

  Status open() {
    if (!o_.record.empty()) {
      const SessionHead head{o_.realtime, o_.cycle_us, now_ns_ + to_realtime_ns_,
                             scenario_checksum(bench_.plant().scenario()), o_.conditions};
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

  void record(const Frame& frame, bool ours) {
    if (record_) keep_record(record_->frame(frame, bench_.sender(frame).has_value() != ours));
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
    bus_.wait(std::min({now_ns_ + longest_wait_ns, std::max<std::int64_t>(bench_.next_ns(), now_ns_), due_ns}));
    // One time for all frames of a turn: a clock call per frame would cost more than the answer. Each turn has a time
    // of its own, so that a replay runs the timers as often.
    now_ns_ = std::max(now_ns_ + 1000, now_us_ns());
    if (record_) record_->begin(now_ns_ + to_realtime_ns_);
    if (auto ok = bench_.tick(now_ns_); !ok) return ok;
    if (auto ok = take_frames(); !ok) return ok;
    if (o_.realtime)
      if (auto ok = follow_clock(); !ok) return ok;
    follow_link();
    if (record_) keep_record(record_->end());
    if (const auto& failure = bench_.plant().record_failure();
        !failure.empty() && !std::exchange(telemetry_lost_, true))
      lose(failure);
    if (now_ns_ - status_ns_ >= s_ns / 4) report();
    return {};
  }

  Status take_frames() {
    Frame frame;
    // Bounded, so that a flooded bus cannot keep the clock from being served.
    for (int i = 0; i < 256 && !finished() && bus_.receive(frame); ++i) {
      record(frame, false);
      if (is_sync(frame)) sync_.sync(frame.time_ns > 0 ? frame.time_ns : clock_ns(CLOCK_REALTIME), bench_.cycle_us());
      if (auto ok = bench_.receive(frame, now_ns_); !ok) return ok;
      impose_faults();
    }
    return {};
  }

  /// Bounded, so that a robot that cannot keep up with the clock does not keep the bus from being served.
  Status follow_clock() {
    for (int k = 0; k < 256 && !finished() && pace_.take(clock_ns()); ++k) {
      if (auto ok = bench_.plant().step(bench_.drives()); !ok) return ok;
      if (record_) record_->step();
    }
    impose_faults();
    return {};
  }

  void impose_faults() {
    for (const DriveFault& fault : bus_.changed(o_.first_node)) {
      bench_.plant().impose(fault);
      if (record_) record_->fault(fault);
    }
  }

  void follow_link() {
    if (bus_.up() == was_up_) return;
    note(bus_.state());
    was_up_ = bus_.up();
    if (!was_up_) return;
    bench_.recovered(now_ns_);
    if (record_) record_->recovered();
  }

  void report() {
    const double bits = bench_.counters().bits;
    const double per_s = status_ns_ ? 1e9 * (bits - bits_before_) / static_cast<double>(now_ns_ - status_ns_) : 0;
    bits_before_ = bits;
    status_ns_ = now_ns_;
    if (record_) keep_record(record_->flush());
    tell_slow_motion();
    tell_waiting();
    if (o_.status) o_.status({time_s(), wall_s(), per_s, o_.bit_rate, pace_.overruns(), &bench_, &bus_});
  }

  /// In lockstep a slow SYNC is a slow robot. Said once.
  void tell_slow_motion() {
    if (o_.realtime || told_slow_motion_) return;
    const auto slow = sync_.slow_motion();
    if (!slow) return;
    told_slow_motion_ = true;
    note(*slow);
  }

  /// In lockstep nothing moves without a SYNC. Said once.
  void tell_waiting() {
    if (o_.realtime || told_waiting_ || bench_.counters().syncs > 0 || wall_s() < patience_s) return;
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
    const auto slow = o_.realtime ? std::nullopt : sync_.slow_motion();
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
    if (problems.empty()) return {};
    return work_failed(fmt::format("{}", fmt::join(problems, "; ")));
  }

  std::string statistics() {
    return statistics_json(
        bench_, bus_.counters(),
        {.wall_s = wall_s(), .bit_rate = o_.bit_rate, .sync = &sync_, .pace = o_.realtime ? &pace_ : nullptr});
  }

  const DriveOptions& o_;
  std::int64_t start_ns_ = now_us_ns(), now_ns_ = start_ns_, status_ns_ = 0;
  const std::int64_t to_realtime_ns_ = clock_ns(CLOCK_REALTIME) / 1000 * 1000 - start_ns_;
  Pace pace_;
  SyncTiming sync_;
  bool running_ = false;  // the bench exists and has a time
  std::optional<SessionRecord> record_;
  FaultyBus bus_;
  Bench bench_;
  double bits_before_ = 0;
  bool was_up_ = true, telemetry_lost_ = false, told_slow_motion_ = false, told_waiting_ = false;
  std::vector<std::string> lost_;
};

}  // namespace

Result<void> drive(const twin::Scenario& scenario, Transport& bus, const DriveOptions& options) {
  return Session(scenario, bus, options).run();
}

}  // namespace tribotwin::hil
