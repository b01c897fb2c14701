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
#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/hil/session/drive.hpp>
#include <tribotwin/hil/session/faulty_bus.hpp>
#include <tribotwin/twin/io/file.hpp>

namespace tribotwin::hil {
namespace {

using Status = Result<void>;

constexpr std::int64_t s_ns = 1'000'000'000, longest_wait_ns = 20'000'000;

/// Whole microseconds, the resolution of a log, so that a replay sees the same times.
std::int64_t now_us_ns() { return clock_ns() / 1000 * 1000; }

/// Histogram of the lateness of a periodic task [us], in powers of two.
struct Lateness {
  std::array<std::uint64_t, 20> count{};
  std::int64_t max_ns = 0;
  void add(std::int64_t ns) {
    max_ns = std::max(max_ns, ns);
    std::size_t bin = 0;
    for (std::int64_t us = ns / 1000; us > 0 && bin + 1 < count.size(); us /= 2) ++bin;
    ++count[bin];
  }
  std::int64_t median_us() const {
    std::uint64_t all = 0, sum = 0;
    for (const auto n : count) all += n;
    for (std::size_t i = 0; i < count.size(); ++i)
      if ((sum += count[i]) * 2 >= all) return i ? 1LL << (i - 1) : 0;
    return 0;
  }
};

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
        step_ns_(std::llround(1e9 * scenario.model->get()->opt.timestep)),
        bus_(bus, o.faults, scenario.seed, [this] { return running_ ? time_s() : 0.0; }),
        bench_(scenario,
               {.profile = o.profile,
                .first_node = o.first_node,
                .cycle_us = o.cycle_us,
                .lockstep = !o.realtime,
                .nodes = o.nodes,
                .stop = o.stop},
               [this](const Frame& frame) {
                 record(frame);
                 return bus_.send(frame);
               }) {
    running_ = true;
  }

  Status run() {
    if (auto ok = open(); !ok) return ok;
    if (o_.realtime) become_real_time(o_.note);
    bench_.start(now_ns_);
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
      auto writer = LogWriter::create(o_.record, "can0", {.replace = o_.existing == twin::Existing::replace});
      if (!writer) return work_failed(writer.error().message);
      log_.emplace(std::move(*writer));
    }
    return o_.output.empty() ? Status{} : bench_.plant().record(o_.output, o_.existing);
  }

  void record(Frame frame) {
    if (!log_) return;
    frame.time_ns = now_ns_ + to_realtime_ns_;
    keep_log(log_->write(frame));
  }
  /// The robot must not fall because a disk is full: the log ends, the drives continue.
  void keep_log(const Status& written) {
    if (written) return;
    log_.reset();
    lose(written.error().message);
  }
  void lose(const std::string& what) {
    lost_.push_back(fmt::format("{}; recorded up to {:.3f} s", what, time_s()));
    note(lost_.back() + "; the drives go on");
  }

  /// Waits once and handles all that arrived.
  Status turn() {
    const std::int64_t due_ns = o_.realtime ? deadline_ns_ : std::numeric_limits<std::int64_t>::max();
    bus_.wait(std::min({now_ns_ + longest_wait_ns, std::max<std::int64_t>(bench_.next_ns(), now_ns_), due_ns}));
    // One time for all frames of a turn: a clock call per frame would cost more than the answer. Each turn has a time
    // of its own, so that a replay runs the timers as often.
    now_ns_ = std::max(now_ns_ + 1000, now_us_ns());
    if (auto ok = bench_.tick(now_ns_); !ok) return ok;
    if (auto ok = take_frames(); !ok) return ok;
    if (o_.realtime)
      if (auto ok = follow_clock(); !ok) return ok;
    follow_link();
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
      record(frame);
      if (auto ok = bench_.receive(frame, now_ns_); !ok) return ok;
      bus_.apply(bench_.plant(), o_.first_node);
    }
    return {};
  }

  Status follow_clock() {
    const std::int64_t late_ns = clock_ns() - deadline_ns_;
    if (late_ns >= 0) {
      lateness_.add(late_ns);
      if (late_ns > step_ns_) ++overruns_;
      // After a long pause of the machine the robot continues from now; it does not catch up.
      if (late_ns > 200 * step_ns_) deadline_ns_ += late_ns;
      for (; deadline_ns_ <= clock_ns() && !finished(); deadline_ns_ += step_ns_)
        if (auto ok = bench_.plant().step(bench_.drives()); !ok) return ok;
    }
    bus_.apply(bench_.plant(), o_.first_node);
    return {};
  }

  void follow_link() {
    if (bus_.up() == was_up_) return;
    note(bus_.state());
    was_up_ = bus_.up();
    if (was_up_) bench_.recovered(now_ns_);
  }

  void report() {
    const double bits = bench_.counters().bits;
    const double load = status_ns_ ? (bits - bits_before_) / (1e-3 * static_cast<double>(now_ns_ - status_ns_)) : 0;
    bits_before_ = bits;
    status_ns_ = now_ns_;
    if (log_) keep_log(log_->flush());
    if (o_.status) o_.status({time_s(), wall_s(), load, &bench_, &bus_});
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
    if (log_) check(log_->finish());
    if (ran)
      if (auto ok = bench_.plant().finish(wall_s(), cut_short); !telemetry_lost_) check(ok);
    if (!o_.statistics.empty()) check(twin::write_file(o_.statistics, statistics(), o_.existing));
    if (problems.empty()) return {};
    return work_failed(fmt::format("{}", fmt::join(problems, "; ")));
  }

  std::string statistics() {
    std::vector<std::pair<std::string, double>> more;
    if (o_.realtime) {
      more = {{"overruns", static_cast<double>(overruns_)},
              {"lateness_median_us", static_cast<double>(lateness_.median_us())},
              {"lateness_max_us", 1e-3 * static_cast<double>(lateness_.max_ns)}};
      for (std::size_t i = 0; i < lateness_.count.size(); ++i)
        if (lateness_.count[i])
          more.emplace_back(fmt::format("lateness_below_{}_us", 1LL << i), static_cast<double>(lateness_.count[i]));
    }
    return statistics_json(bench_, bus_.counters(), wall_s(), more);
  }

  const DriveOptions& o_;
  const std::int64_t start_ns_ = now_us_ns(), to_realtime_ns_ = clock_ns(CLOCK_REALTIME) / 1000 * 1000 - start_ns_,
                     step_ns_;
  std::int64_t now_ns_ = start_ns_, deadline_ns_ = start_ns_ + step_ns_, status_ns_ = 0;
  bool running_ = false;  // the bench exists and has a time
  std::optional<LogWriter> log_;
  FaultyBus bus_;
  Bench bench_;
  Lateness lateness_;
  std::uint64_t overruns_ = 0;
  double bits_before_ = 0;
  bool was_up_ = true, telemetry_lost_ = false;
  std::vector<std::string> lost_;
};

}  // namespace

Result<void> drive(const twin::Scenario& scenario, Transport& bus, const DriveOptions& options) {
  return Session(scenario, bus, options).run();
}

}  // namespace tribotwin::hil
