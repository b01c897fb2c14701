#include <algorithm>
#include <deque>
#include <map>
#include <utility>

#include <fmt/format.h>
#include <time.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/hil/session/replay.hpp>

namespace tribotwin::hil {
namespace {

using Status = Result<void>;

constexpr std::int64_t s_ns = 1'000'000'000;

/// Sleeps until CLOCK_MONOTONIC `at_ns`, or until `stop`.
void sleep_until(std::int64_t at_ns, const std::function<bool()>& stop) {
  constexpr std::int64_t ask_stop_ns = s_ns / 10;
  for (std::int64_t now = clock_ns(); now < at_ns && !(stop && stop()); now = clock_ns()) {
    const std::int64_t wake_ns = std::min(at_ns, now + ask_stop_ns);
    const timespec until{wake_ns / s_ns, wake_ns % s_ns};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
  }
}

/// Sends a log through the drives of a bench. Their frames go into queues and are compared with those of the log.
class Replay {
 public:
  Replay(const twin::Scenario& scenario, const std::filesystem::path& file, const ReplayOptions& o)
      : file_(file),
        o_(o),
        bench_(scenario,
               {.profile = o.profile,
                .first_node = o.first_node,
                .cycle_us = o.cycle_us,
                .nodes = o.nodes,
                .stop = o.stop},
               [this](const Frame& frame) {
                 said_[frame.id].push_back(frame);
                 return Sent::done;
               }),
        compared_(bench_.drives().size()) {}

  Result<ReplayResult> run() {
    auto log = LogReader::open(file_, o_.stop);
    if (!log) return work_failed(log.error().message);
    Frame frame;
    auto more = log->next(frame);
    if (more && *more && !o_.output.empty())  // an empty log leaves no record
      if (auto ok = bench_.plant().record(o_.output, o_.existing); !ok) return tl::unexpected(ok.error());
    for (; more && *more && !stopped(); more = log->next(frame))
      if (auto ok = take(frame, log->line()); !ok) return work_failed(ok.error().message);
    if (!more) return work_failed(more.error().message);
    result_.interrupted = stopped();
    if (!result_.interrupted) judge_the_end();
    if (auto ok = bench_.plant().finish(1e-9 * static_cast<double>(clock_ns() - began_ns_), result_.interrupted); !ok)
      return work_failed(ok.error().message);
    return result_;
  }

 private:
  bool stopped() const { return o_.stop && o_.stop(); }

  Status take(const Frame& frame, std::size_t line) {
    if (result_.frames++ == 0) {
      first_ns_ = frame.time_ns;
      bench_.start(frame.time_ns);
    }
    if (o_.rate > 0) {  // absolute deadlines: nothing drifts
      constexpr double longest_ns = 1e18;
      sleep_until(began_ns_ + static_cast<std::int64_t>(
                                  std::min(static_cast<double>(frame.time_ns - first_ns_) / o_.rate, longest_ns)),
                  o_.stop);
    }
    if (frame.time_ns > ticked_ns_)
      if (auto ok = bench_.tick(ticked_ns_ = frame.time_ns); !ok) return ok;
    if (const auto sender = bench_.sender(frame)) {
      ++compared_[*sender];
      compare(frame, line);
    } else if (auto ok = bench_.receive(frame, frame.time_ns); !ok) {
      return ok;
    }
    if (const auto& failure = bench_.plant().record_failure(); !failure.empty()) return work_failed(failure);
    return {};
  }

  void compare(const Frame& frame, std::size_t line) {
    ++result_.compared;
    auto& queue = said_[frame.id];
    if (queue.empty()) {
      ++result_.missing;
      differs(fmt::format("{}:{}: {} was recorded, nothing now", file_.string(), line, text(frame)));
      return;
    }
    if (!(queue.front() == frame)) {
      ++result_.differing;
      differs(fmt::format("{}:{}: {} was recorded, {} now", file_.string(), line, text(frame), text(queue.front())));
    }
    queue.pop_front();
  }

  /// Counts what the drives said and the log does not have.
  void judge_the_end() {
    for (std::size_t i = 0; i < compared_.size(); ++i)
      if (compared_[i] == 0) result_.silent.push_back(bench_.joints()[i]);
    for (const auto& [id, queue] : said_) {
      if (queue.empty()) continue;
      const auto sender = bench_.sender(queue.front());
      if (sender && compared_[*sender] == 0) continue;
      result_.added += queue.size();
      differs(
          fmt::format("{}: {} frames {:03X} are sent now that were not recorded, {} the last of them; was the log cut?",
                      file_.string(), queue.size(), id, text(queue.back())));
    }
  }

  void differs(std::string how) {
    if (result_.first_difference.empty()) result_.first_difference = std::move(how);
  }

  const std::filesystem::path& file_;
  const ReplayOptions& o_;
  /// Frames of the drives, per identifier, that the log has not reached yet.
  std::map<std::uint32_t, std::deque<Frame>> said_;
  Bench bench_;
  std::vector<std::uint64_t> compared_;  // per drive
  std::int64_t first_ns_ = 0, ticked_ns_ = -1;
  const std::int64_t began_ns_ = clock_ns();
  ReplayResult result_;
};

}  // namespace

Result<ReplayResult> replay(const twin::Scenario& scenario, const std::filesystem::path& log,
                            const ReplayOptions& options) {
  return Replay(scenario, log, options).run();
}

}  // namespace tribotwin::hil
