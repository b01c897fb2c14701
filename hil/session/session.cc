#include <tribotwin/hil/session/session.hpp>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <deque>
#include <map>

#include <fmt/format.h>
#include <sched.h>
#include <sys/mman.h>
#include <time.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/twin/output/file.hpp>
#include <tribotwin/twin/output/output.hpp>

namespace tribotwin::hil {
namespace {

using Status = tl::expected<void, std::string>;

constexpr std::int64_t s_ns = 1'000'000'000, longest_wait_ns = 20'000'000;

/// Whole microseconds: what a log can hold, so that a replay sees the same times.
std::int64_t now_us_ns() { return clock_ns() / 1000 * 1000; }

/// Lateness of a periodic task [us]: powers of two.
struct Lateness {
  std::array<std::uint64_t, 20> count{};
  std::int64_t most_ns = 0;
  void add(std::int64_t ns) {
    most_ns = std::max(most_ns, ns);
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
    note(fmt::format("no real-time priority (SCHED_FIFO: {}); run as root or with CAP_SYS_NICE to have it", std::strerror(errno)));
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0 && note) note(fmt::format("memory is not locked (mlockall: {}); deadlines may slip when the machine swaps", std::strerror(errno)));
}

}  // namespace

tl::expected<void, std::string> drive(const twin::Scenario& scenario, Transport& real_bus, const DriveOptions& o) {
  std::optional<LogWriter> log;
  if (!o.record.empty()) {
    auto writer = LogWriter::create(o.record, "can0");
    if (!writer) return tl::unexpected(writer.error());
    log.emplace(std::move(*writer));
  }
  const std::int64_t start_ns = now_us_ns(), to_realtime_ns = clock_ns(CLOCK_REALTIME) / 1000 * 1000 - start_ns;
  std::int64_t now_ns = start_ns;
  Status written;
  const auto record = [&](Frame frame) {
    if (!log || !written) return;
    frame.time_ns = now_ns + to_realtime_ns;
    written = log->write(frame);
  };
  const Bench* running = nullptr;
  FaultyBus bus(real_bus, o.faults, scenario.seed, [&] { return running ? running->plant().twin().time_s() : 0.0; });
  Bench bench(scenario, {.profile = o.profile, .first_node = o.first_node, .cycle_us = o.cycle_us, .lockstep = !o.realtime}, [&](const Frame& frame) {
    record(frame);
    return bus.send(frame);
  });
  running = &bench;
  if (!o.output.empty())
    if (auto ok = bench.plant().record(o.output); !ok) return ok;
  if (o.realtime) become_real_time(o.note);
  bench.start(now_ns);

  const std::int64_t step_ns = std::llround(1e9 * scenario.model->get()->opt.timestep);
  std::int64_t deadline_ns = start_ns + step_ns, status_ns = 0;
  Lateness lateness;
  std::uint64_t overruns = 0;
  double bits_before = 0, load = 0;
  bool was_up = true;
  const auto finished = [&] { return (o.stop && o.stop()) || (o.duration_s && bench.plant().twin().time_s() >= *o.duration_s - 1e-9); };
  while (!finished()) {
    if (!written) return written;
    const std::int64_t wake_ns = std::min({now_ns + longest_wait_ns, std::max<std::int64_t>(bench.next_ns(), now_ns), o.realtime ? deadline_ns : std::numeric_limits<std::int64_t>::max()});
    bus.wait(wake_ns);
    Frame frame;
    // One time for all that waited here: asking the clock for each would cost more than the answer. No two turns share a
    // time, so that a replay can tell them apart and lets the timers run as often.
    now_ns = std::max(now_ns + 1000, now_us_ns());
    bench.tick(now_ns);
    // Bounded, so that a flooded bus cannot keep the clock from being served.
    for (int i = 0; i < 256 && bus.receive(frame); ++i) {
      record(frame);
      if (auto ok = bench.receive(frame, now_ns); !ok) return ok;
      bus.apply(bench.plant(), o.first_node);
      if (finished()) break;
    }
    if (o.realtime) {
      const std::int64_t late_ns = clock_ns() - deadline_ns;
      if (late_ns >= 0) {
        lateness.add(late_ns);
        if (late_ns > step_ns) ++overruns;
        // A machine that was away for long goes on from now; the robot does not jump ahead.
        if (late_ns > 200 * step_ns) deadline_ns += late_ns;
        for (; deadline_ns <= clock_ns() && !finished(); deadline_ns += step_ns)
          if (auto ok = bench.plant().step(bench.drives()); !ok) return ok;
      }
    }
    if (o.realtime) bus.apply(bench.plant(), o.first_node);
    if (bus.up() != was_up) {
      if (o.note) o.note(bus.state());
      was_up = bus.up();
      if (was_up) bench.recovered(now_ns);
    }
    if (now_ns - status_ns >= s_ns / 4) {
      load = status_ns ? (bench.counters().bits - bits_before) / (1e-3 * static_cast<double>(now_ns - status_ns)) : 0;
      bits_before = bench.counters().bits;
      status_ns = now_ns;
      if (log && written) written = log->flush();
      if (o.status) o.status({bench.plant().twin().time_s(), 1e-9 * static_cast<double>(now_ns - start_ns), load, &bench, &bus});
    }
  }
  const double wall_s = 1e-9 * static_cast<double>(now_ns - start_ns);
  if (log && written) written = log->flush();
  if (!written) return written;
  if (auto ok = bench.plant().finish(wall_s); !ok) return ok;
  if (!o.statistics.empty()) {
    std::vector<std::pair<std::string, double>> more;
    if (o.realtime) {
      more = {{"overruns", static_cast<double>(overruns)}, {"lateness_median_us", static_cast<double>(lateness.median_us())}, {"lateness_max_us", 1e-3 * static_cast<double>(lateness.most_ns)}};
      for (std::size_t i = 0; i < lateness.count.size(); ++i)
        if (lateness.count[i]) more.emplace_back(fmt::format("lateness_below_{}_us", 1LL << i), static_cast<double>(lateness.count[i]));
    }
    if (auto ok = twin::write_file(o.statistics, statistics_json(bench, bus.counters(), wall_s, more), twin::Existing::replace); !ok) return ok;
  }
  return {};
}

tl::expected<ReplayResult, std::string> replay(const twin::Scenario& scenario, const std::filesystem::path& file, const ReplayOptions& o) {
  auto log = LogReader::open(file);
  if (!log) return tl::unexpected(log.error());
  ReplayResult result;
  // What the drives say now, per identifier, until the log has said it too.
  std::map<std::uint32_t, std::deque<Frame>> said;
  Bench bench(scenario, {.profile = o.profile, .first_node = o.first_node, .cycle_us = o.cycle_us}, [&](const Frame& frame) {
    said[frame.id].push_back(frame);
    return Sent::done;
  });
  if (!o.output.empty())
    if (auto ok = bench.plant().record(o.output); !ok) return tl::unexpected(ok.error());
  std::int64_t first_ns = -1, ticked_ns = -1;
  const std::int64_t began_ns = clock_ns();
  Frame frame;
  while (!(o.stop && o.stop())) {
    auto more = log->next(frame);
    if (!more) return tl::unexpected(more.error());
    if (!*more) break;
    ++result.frames;
    if (first_ns < 0) {
      first_ns = frame.time_ns;
      bench.start(frame.time_ns);
    }
    if (o.rate > 0) {   // absolute deadlines: nothing drifts
      const std::int64_t at_ns = began_ns + static_cast<std::int64_t>(static_cast<double>(frame.time_ns - first_ns) / o.rate);
      const timespec until{at_ns / s_ns, at_ns % s_ns};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
    }
    if (frame.time_ns > ticked_ns) bench.tick(ticked_ns = frame.time_ns);
    if (!bench.is_ours(frame)) {
      if (auto ok = bench.receive(frame, frame.time_ns); !ok) return tl::unexpected(ok.error());
      continue;
    }
    ++result.compared;
    auto& queue = said[frame.id];
    if (queue.empty()) {
      ++result.missing;
      if (result.first_difference.empty()) result.first_difference = fmt::format("{}:{}: {} was recorded, nothing now", file.string(), log->line(), text(frame));
      continue;
    }
    if (!(queue.front() == frame)) {
      ++result.differing;
      if (result.first_difference.empty()) result.first_difference = fmt::format("{}:{}: {} was recorded, {} now", file.string(), log->line(), text(frame), text(queue.front()));
    }
    queue.pop_front();
  }
  if (auto ok = bench.plant().finish(1e-9 * static_cast<double>(clock_ns() - began_ns)); !ok) return tl::unexpected(ok.error());
  return result;
}

}  // namespace tribotwin::hil
