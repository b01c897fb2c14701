#include <algorithm>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <time.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/hil/session/expected_frames.hpp>
#include <tribotwin/hil/session/replay.hpp>
#include <tribotwin/hil/session/session_file.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::hil {
namespace {

using Status = Result<void>;

constexpr std::int64_t s_ns = 1'000'000'000;

/// Sleeps until CLOCK_MONOTONIC `at_ns`, or until `stop`, which is asked ten times a second.
void sleep_until(std::int64_t at_ns, const std::function<bool()>& stop) {
  constexpr std::int64_t ask_stop_ns = s_ns / 10;
  for (std::int64_t now = clock_ns(); now < at_ns && !stop(); now = clock_ns()) {
    const std::int64_t wake_ns = std::min(at_ns, now + ask_stop_ns);
    const timespec until{wake_ns / s_ns, wake_ns % s_ns};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
  }
}

/// All frames of a log with one time.
struct Moment {
  std::int64_t time_ns = 0;
  struct Line {
    Frame frame;
    std::size_t number;  ///< in the log
    std::size_t bus;
  };
  std::vector<Line> lines;
};

/// Reads a log moment by moment.
class Moments {
 public:
  /// `channels`: names of several buses; none: all that the log has is one bus.
  Moments(LogReader log, std::vector<std::string> channels) : log_(std::move(log)), channels_(std::move(channels)) {}
  /// The next one; false at the end.
  Result<bool> next(Moment& moment) {
    if (!ahead_)
      if (auto more = look_ahead(); !more || !*more) return more;
    moment.time_ns = ahead_->frame.time_ns;
    moment.lines.clear();
    while (ahead_ && ahead_->frame.time_ns == moment.time_ns) {
      moment.lines.push_back(*std::exchange(ahead_, std::nullopt));
      if (auto more = look_ahead(); !more) return more;
    }
    return true;
  }
  /// Where the log has a frame on a channel that is none of the buses; empty if it has none up to here.
  const std::string& stranger() const { return stranger_; }

 private:
  Result<bool> look_ahead() {
    Frame frame;
    auto more = log_.next(frame);
    if (!more || !*more) return more;
    const auto channel = std::ranges::find(channels_, log_.bus());
    const auto bus = static_cast<std::size_t>(channel - channels_.begin());
    if (!channels_.empty() && bus == channels_.size() && stranger_.empty())
      stranger_ = fmt::format("line {}: a frame on {}; the buses are {}", log_.line(), log_.bus(),
                              fmt::join(channels_, " and "));
    ahead_ = Moment::Line{frame, log_.line(), bus};
    return more;
  }
  LogReader log_;
  std::vector<std::string> channels_;
  std::string stranger_;
  std::optional<Moment::Line> ahead_;
};

/// Sends a log through the drives of a bench. Their frames go into queues and are compared with those of the log.
class Replay {
 public:
  Replay(const twin::Scenario& scenario, const std::filesystem::path& file, const ReplayOptions& o,
         std::optional<SessionReader> session)
      : file_(file),
        o_(o),
        session_(std::move(session)),
        bench_(
            scenario,
            {.profile = o.profile,
             .first_node = o.first_node,
             .wiring = o.wiring,
             .cycle_us = o.cycle_us,
             .lockstep = !session_ || !session_->head().realtime,
             .nodes = o.nodes,
             .kept =
                 [this](bool) { return std::ranges::find(turn_now_.not_kept, keeps_++) == turn_now_.not_kept.end(); },
             .stop = o.stop,
             .emcy =
                 [this](std::size_t drive, std::uint16_t code) {
                   if (o_.events.emcy) o_.events.emcy(time_s(), drive, code);
                 }},
            [this](std::size_t bus, const Frame& frame) {
              said_[bus].push(frame);
              return Sent::done;
            }),
        compared_(bench_.drives().size()) {
    result_.session_file = session_.has_value();
  }

  Result<ReplayResult> run() {
    auto log = LogReader::open(file_, o_.stop);
    if (!log) return tl::unexpected(log.error());
    Moments moments(std::move(*log), channels());
    if (auto ok = start(moments); !ok) return tl::unexpected(ok.error());
    if (auto ok = follow(moments); !ok) return tl::unexpected(ok.error());
    result_.interrupted = stopped();
    if (!result_.interrupted && result_.cut.empty()) judge_the_end();
    if (auto ok = bench_.plant().finish(1e-9 * static_cast<double>(clock_ns() - began_ns_), result_.interrupted); !ok)
      return work_failed(ok.error().message);
    return result_;
  }

 private:
  double time_s() const { return bench_.plant().twin().time_s(); }
  bool stopped() const { return o_.stop && o_.stop(); }
  bool any_said() const {
    return std::ranges::any_of(said_, [](const ExpectedFrames& said) { return !said.empty(); });
  }
  std::vector<std::string> channels() const {
    std::vector<std::string> names = o_.channels;
    for (std::size_t bus = names.size(); bus < o_.wiring.size(); ++bus) names.push_back(channel_of(bus));
    return names.size() > 1 ? names : std::vector<std::string>{};
  }

  /// Reads the first moment and the first turn. An empty log leaves no record.
  Status start(Moments& moments) {
    if (auto ok = read(moments); !ok) return ok;
    if (!frames_left_) return {};
    first_ns_ = session_ ? session_->head().start_ns : moment_.time_ns;
    bench_.plant().watch(o_.sample);
    bench_.start(first_ns_);
    if (session_) {
      // What drives say at the start is in the log; those without a node number say nothing.
      if (moment_.time_ns < first_ns_ || (moment_.time_ns > first_ns_ && any_said()))
        return tl::unexpected(
            fmt::format("{}: does not belong to this log, or the log's beginning is missing; nothing was compared",
                        session_->file().string()));
      if (auto ok = read_turn(); !ok) return ok;
    }
    return o_.output.empty() ? Status{} : bench_.plant().record(o_.output, o_.existing);
  }

  Status read(Moments& moments) {
    auto more = moments.next(moment_);
    if (!more) return tl::unexpected(more.error());
    frames_left_ = *more;
    if (moments.stranger().empty()) return {};
    return tl::unexpected(
        fmt::format("{}: {}; give --can CHANNEL=JOINT,... for each", file_.string(), moments.stranger()));
  }
  Status read_turn() {
    auto more = session_->next(turn_);
    if (!more) return tl::unexpected(more.error());
    turns_left_ = *more;
    return {};
  }

  /// Frames and turns in the order of their times; both of one time are one turn.
  Status follow(Moments& moments) {
    while ((frames_left_ || turns_left_) && !stopped()) {
      const bool frames = frames_left_ && (!turns_left_ || moment_.time_ns <= turn_.time_ns);
      const bool turn = turns_left_ && (!frames_left_ || turn_.time_ns <= moment_.time_ns);
      const std::int64_t now_ns = frames ? moment_.time_ns : turn_.time_ns;
      if (frames && !turns_left_ && killed()) break;
      wait_for(now_ns);
      if (auto ok =
              take(now_ns, frames ? std::span<const Moment::Line>(moment_.lines) : std::span<const Moment::Line>(),
                   turn ? turn_ : Turn{});
          !ok)
        return ok;
      report();
      if (frames)
        if (auto ok = read(moments); !ok) return ok;
      if (turn)
        if (auto ok = read_turn(); !ok) return ok;
    }
    if (killed() && !turns_left_)
      result_.cut = fmt::format("{}: has no end, the session was killed; compared up to {:.3f} s",
                                session_->file().string(), time_s());
    return {};
  }
  /// Whether the session did not end in order, once all turns are read.
  bool killed() const { return session_ && !session_->complete(); }

  /// Absolute deadlines: nothing drifts.
  void wait_for(std::int64_t time_ns) {
    constexpr double longest_ns = 1e18;
    if (o_.rate <= 0) return;
    const double after_ns = std::min(static_cast<double>(time_ns - first_ns_) / o_.rate, longest_ns);
    sleep_until(began_ns_ + static_cast<std::int64_t>(after_ns), [this] {
      report();
      return stopped();
    });
  }

  /// By the wall clock. A log does not say what its buses could carry.
  void report() {
    const std::int64_t now_ns = clock_ns();
    if (!o_.status || now_ns - reported_ns_ < s_ns / 5) return;
    reported_ns_ = now_ns;
    o_.status({time_s(), 1e-9 * static_cast<double>(now_ns - began_ns_), 0, &bench_,
               std::vector<SessionStatus::Bus>(bench_.buses(), SessionStatus::Bus{nullptr, 0, std::nullopt})});
  }

  /// One turn as the session had it (drive.cc). The frames of the drives are compared at its end: some of them the
  /// steps have sent.
  Status take(std::int64_t now_ns, std::span<const Moment::Line> lines, Turn now) {
    turn_now_ = std::move(now);
    keeps_ = 0;
    const Turn& turn = turn_now_;
    if (auto ok = happen(turn); !ok) return ok;
    if (turn.hold) bench_.hold(*turn.hold == Turn::goes_on ? std::nullopt : turn.hold);
    if (now_ns > ticked_ns_)
      if (auto ok = work(bench_.tick(ticked_ns_ = now_ns)); !ok) return ok;
    if (auto ok = impose(turn, 0); !ok) return ok;
    to_compare_.clear();
    for (std::size_t i = 0; i < lines.size() && !stopped(); ++i) {
      ++result_.frames;
      const auto sender = bench_.sender(lines[i].bus, lines[i].frame);
      const bool misleading = std::ranges::find(turn.misleading, i) != turn.misleading.end();
      if (sender.has_value() != misleading)
        to_compare_.push_back({&lines[i], sender});
      else if (auto ok = work(bench_.receive(lines[i].bus, lines[i].frame, now_ns)); !ok)
        return ok;
      if (auto ok = impose(turn, i + 1); !ok) return ok;
    }
    for (std::int64_t k = 0; k < turn.steps && !stopped(); ++k)
      if (const auto moved = bench_.step(); !moved) return work_failed(moved.error().message);
    if (auto ok = impose(turn, Turn::at_end); !ok) return ok;
    for (const std::size_t bus : turn.recovered)
      if (bus < bench_.buses()) bench_.recovered(bus, now_ns);
    for (const auto& [line, sender] : to_compare_) compare(*line, sender);
    if (const auto& failure = bench_.plant().record_failure(); !failure.empty()) return work_failed(failure);
    return {};
  }

  static Status work(Status status) { return status ? status : work_failed(status.error().message); }

  Status happen(const Turn& turn) try {
    for (const std::string& text : turn.events) {
      const YAML::Node event = twin::parse_yaml(text, "an event");
      bench_.plant().happen(event);
      if (o_.events.happened) o_.events.happened(time_s(), event);
    }
    return {};
  } catch (const twin::InputError& wrong) {
    return tl::unexpected(
        fmt::format("{}: has an event that this scenario cannot have: {}", session_->file().string(), wrong.what()));
  }

  /// The faults of a turn after so many frames.
  Status impose(const Turn& turn, std::size_t after) {
    for (const auto& imposed : turn.faults) {
      if (imposed.after != after) continue;
      if (imposed.fault.drive >= compared_.size())
        return tl::unexpected(fmt::format("{}: has a fault of drive {}; the scenario has {}", session_->file().string(),
                                          imposed.fault.drive + 1, compared_.size()));
      bench_.plant().impose(imposed.fault);
      if (o_.events.imposed) o_.events.imposed(time_s(), imposed.fault);
    }
    return {};
  }

  void compare(const Moment::Line& line, std::optional<std::size_t> sender) {
    ++result_.compared;
    if (sender) ++compared_[*sender];
    const Frame& frame = line.frame;
    const auto said = said_[line.bus].pop(frame.id);
    if (!said) {
      ++result_.missing;
      differs(fmt::format("{}:{}: {} was recorded, nothing now", file_.string(), line.number, text(frame)));
    } else if (!(*said == frame)) {
      ++result_.differing;
      differs(fmt::format("{}:{}: {} was recorded, {} now", file_.string(), line.number, text(frame), text(*said)));
    }
  }

  /// Counts what the drives said and the log does not have.
  void judge_the_end() {
    for (std::size_t i = 0; i < compared_.size(); ++i)
      if (compared_[i] == 0) result_.silent.push_back(bench_.joints()[i]);
    for (std::size_t bus = 0; bus < said_.size(); ++bus) judge_rest(bus);
  }
  void judge_rest(std::size_t bus) {
    for (const auto& [id, rest] : said_[bus].left()) {
      const auto sender = bench_.sender(bus, rest.last);
      if (sender && compared_[*sender] == 0) continue;
      result_.added += rest.count;
      differs(
          fmt::format("{}: {} frames {:03X} are sent now that were not recorded, {} the last of them; was the log cut?",
                      file_.string(), rest.count, id, text(rest.last)));
    }
  }

  void differs(std::string how) {
    if (!result_.first_difference.empty()) return;
    result_.first_difference = std::move(how);
    if (session_ && session_->head().complete &&
        session_->head().scenario != scenario_checksum(bench_.plant().scenario()))
      result_.first_difference += "; the session had another scenario, --set, or folder of the model";
    if (o_.note) o_.note(result_.first_difference);
  }

  const std::filesystem::path& file_;
  const ReplayOptions& o_;
  std::optional<SessionReader> session_;
  Moment moment_;
  Turn turn_;
  bool frames_left_ = false, turns_left_ = false;  // moment_ and turn_ are still to come
  Turn turn_now_;                                  // the one that is taken
  std::size_t keeps_ = 0;                          // commands to store in it so far
  struct Own {
    const Moment::Line* line;
    std::optional<std::size_t> sender;
  };
  std::vector<Own> to_compare_;
  std::vector<ExpectedFrames> said_ = std::vector<ExpectedFrames>(bus_count(o_.wiring));  // by the drives, per bus
  Bench bench_;
  std::vector<std::uint64_t> compared_;  // per drive
  std::int64_t first_ns_ = 0, ticked_ns_ = -1, reported_ns_ = 0;
  const std::int64_t began_ns_ = clock_ns();
  ReplayResult result_;
};

/// The session file beside a log, where there is one that belongs to these options.
Result<std::optional<SessionReader>> session_of(const std::filesystem::path& log, const ReplayOptions& o) {
  const auto file = session_file_of(log);
  if (file.empty() || !std::filesystem::exists(file)) return std::nullopt;
  auto session = SessionReader::open(file);
  if (!session) return tl::unexpected(session.error());
  if (session->head().cycle_us != o.cycle_us)
    return tl::unexpected(fmt::format("{}: was recorded with --cycle {}, not with --cycle {}; nothing was compared",
                                      file.string(), 1e-3 * session->head().cycle_us, 1e-3 * o.cycle_us));
  if (!session->head().wiring.empty() && session->head().wiring != o.wiring)
    return tl::unexpected(
        fmt::format("{}: was recorded with other drives on its buses; nothing was compared", file.string()));
  return std::optional(std::move(*session));
}

}  // namespace

Result<ReplayResult> replay(const twin::Scenario& scenario, const std::filesystem::path& log,
                            const ReplayOptions& options) {
  auto session = session_of(log, options);
  if (!session) return tl::unexpected(session.error());
  return Replay(scenario, log, options, std::move(*session)).run();
}

}  // namespace tribotwin::hil
