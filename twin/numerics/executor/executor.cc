#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/numerics/executor/bytes.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>

namespace tribotwin::twin {
namespace {

using Clock = std::chrono::steady_clock;
using Kind = Ranks::Kind;

/// Work that a rank has in hand while messages travel: at 1,024 ranks, 0.4 s make 5,000 messages per second each way.
double lead_s(int ranks) { return std::max(0.1, 4e-4 * ranks); }
/// Results wait at most this share of the lead for others to go with.
constexpr double hold_share = 0.25;
constexpr std::size_t full_message = 1 << 20;

std::string packed(const Outcome& outcome) {
  BytesOut out;
  out.put<std::uint64_t>(outcome.results.size()).put<std::uint64_t>(outcome.present).put(outcome.stopped);
  for (const auto& result : outcome.results) out.put(std::string_view(result));
  for (const auto& f : outcome.failures)
    out.put<std::uint64_t>(f.task).put(f.attempts).put(f.error.kind).put(std::string_view(f.error.message));
  return out.take();
}

Outcome unpacked(const std::string& bytes) {
  BytesIn in(bytes);
  Outcome outcome{.results = std::vector<std::string>(in.get<std::uint64_t>())};
  outcome.present = in.get<std::uint64_t>();
  outcome.stopped = in.get<bool>();
  for (auto& result : outcome.results) result = in.text();
  while (!in.empty()) {
    const std::size_t task = in.get<std::uint64_t>();
    const int attempts = in.get<int>();
    const auto kind = in.get<ErrorKind>();
    outcome.failures.push_back({task, attempts, Error(in.text(), kind)});
  }
  return outcome;
}

std::unique_ptr<Crew> crew_of(unsigned threads, const Tasks& tasks, const ExecutorOptions& options) {
  return (tasks.own_processes ? crew_of_processes : crew_of_threads)(threads, tasks.work, options.stop);
}

/// What a rank must have in common with rank 0 to take part.
std::string same_for_all(const Tasks& tasks) { return fmt::format("{} {}", tasks.count, tasks.identity); }

/// Rank 0: hands out tasks, takes results, and works itself.
class Leader {
 public:
  Leader(const Tasks& tasks, const ExecutorOptions& options, Ranks& ranks)
      : tasks_(tasks),
        stop_(options.stop),
        ranks_(ranks),
        operation_(ranks.begin()),
        outcome_{.results = std::vector<std::string>(tasks.count)},
        manager_(missing(), options.retries, lead_s(ranks.size())),
        known_(tasks.count),
        threads_(threads_of(options.threads, ranks.size())),
        crew_(crew_of(threads_, tasks, options)) {}

  Result<Outcome> run() {
    grow();
    manager_.enroll(0, threads_);
    crew_->add(jobs(0));
    for (Pause pause; !manager_.complete();) {
      const auto wait =
          ranks_.several() ? std::chrono::microseconds(pause.next_us(longest_us())) : std::chrono::seconds(1);
      auto own = crew_->take(wait);
      if (receive() || !own.empty()) pause.something();
      for (auto& done : own) over(0, std::move(done));
      if (tasks_.meanwhile) tasks_.meanwhile();
      if (stop_ && *stop_) manager_.stop();
      crew_->add(jobs(0));
      // What failed on one rank may become another's at any time.
      for (const int rank : members_) grant(rank);
    }
    outcome_.failures = manager_.failures();
    outcome_.stopped = manager_.stopped();
    ranks_.share(operation_, kept_.map([&] { return ranks_.several() ? packed(outcome_) : std::string(); }));
    if (!kept_) return tl::unexpected(kept_.error());
    return std::move(outcome_);
  }

 private:
  std::deque<std::size_t> missing() {
    std::deque<std::size_t> all;
    for (std::size_t i = 0; i < tasks_.count; ++i) {
      auto present = tasks_.present ? tasks_.present(i) : std::nullopt;
      if (present)
        outcome_.results[i] = *std::move(present);
      else
        all.push_back(i);
    }
    outcome_.present = tasks_.count - all.size();
    over_ = outcome_.present;
    return all;
  }

  /// Tells the manager of further tasks.
  void grow() {
    for (const std::size_t count = tasks_.grown ? tasks_.grown() : known_; known_ < count; ++known_)
      manager_.add(known_);
  }

  /// What a rank gets now.
  std::vector<Crew::Job> jobs(int rank) {
    std::vector<Crew::Job> all;
    for (const std::size_t task : manager_.grant(rank))
      all.push_back({task, tasks_.input ? tasks_.input(task) : std::string()});
    return all;
  }

  void grant(int rank) {
    const auto granted = jobs(rank);
    if (granted.empty()) return;
    BytesOut out;
    out.put(operation_);
    for (const auto& job : granted) out.put<std::uint64_t>(job.task).put(std::string_view(job.input));
    ranks_.post(rank, Kind::tasks, out.take());
  }

  /// Other ranks wait for an answer at most 0.5 % of the time of a task; among few ranks, whose waiting costs less than
  /// to look for messages that often, as long as makes the sum of both least.
  long longest_us() const {
    constexpr double look_us = 50;  // with two changes of context
    const double task_us = manager_.mean_s() * 1e6;
    return static_cast<long>(
        std::clamp(std::max(0.005 * task_us, std::sqrt(2 * look_us * task_us / ranks_.size())), 1000.0, 10000.0));
  }

  /// Whether messages were there.
  bool receive() {
    if (!ranks_.several()) return false;
    bool any = false;
    while (const auto parcel = ranks_.poll()) {
      any = true;
      BytesIn in(parcel->bytes);
      if (in.get<std::uint64_t>() != operation_) continue;
      if (parcel->kind == Kind::ready) enroll(parcel->from, in);
      if (parcel->kind == Kind::results)
        while (!in.empty()) over(parcel->from, get_done(in));
    }
    ranks_.report_left(done);
    return any;
  }

  void enroll(int rank, BytesIn& in) {
    const auto threads = in.get<unsigned>();
    if (in.text() != same_for_all(tasks_)) {
      report_text(fmt::format("warning: {} has other input than rank 0 (another version of a file?) and is not used\n",
                              ranks_.name_of(rank)));
      return;
    }
    members_.push_back(rank);
    manager_.enroll(rank, threads);
  }

  void over(int rank, Crew::Done done) {
    if (done.stopped) return manager_.returned(rank, done.task);
    if (!done.result) {
      const TaskFailure* failure = manager_.failed(rank, done.task, std::move(done.result.error()), done.seconds);
      if (!failure) return;
      if (tasks_.failed) tasks_.failed(*failure);
      show();
      return grow();
    }
    manager_.succeeded(rank, done.task, done.seconds);
    if (kept_ && tasks_.keep) kept_ = tasks_.keep(done.task, *done.result);
    if (!kept_) return manager_.stop();
    if (!tasks_.grown) outcome_.results[done.task] = *std::move(done.result);
    show();
    grow();
  }

  void show() {
    ++over_;
    if (tasks_.progress) tasks_.progress(over_, known_);
  }

  const Tasks& tasks_;
  const std::atomic<bool>* const stop_;
  Ranks& ranks_;
  const std::uint64_t operation_;
  std::size_t over_ = 0;
  Outcome outcome_;
  Manager manager_;
  std::size_t known_;  ///< number of tasks
  const unsigned threads_;
  std::vector<int> members_;
  Result<void> kept_;
  const std::unique_ptr<Crew> crew_;
};

/// The other ranks: do what rank 0 says, until it has all results.
class Follower {
 public:
  Follower(const Tasks& tasks, const ExecutorOptions& options, Ranks& ranks)
      : ranks_(ranks),
        operation_(ranks.begin()),
        hold_(hold_share * lead_s(ranks.size())),
        threads_(threads_of(options.threads, ranks.size())),
        crew_(crew_of(threads_, tasks, options)) {
    BytesOut out;
    out.put(operation_).put(threads_).put(std::string_view(same_for_all(tasks)));
    ranks.post(0, Kind::ready, out.take());
  }

  Result<Outcome> run() {
    for (Pause pause;;) {
      auto done = crew_->take(std::chrono::microseconds(in_hand_ ? pause.next_us(busy_us) : pause.next_us()));
      if (!done.empty()) pause.something();
      in_hand_ -= done.size();
      for (const auto& one : done) add(one);
      while (const auto parcel = ranks_.poll()) {
        pause.something();
        BytesIn in(parcel->bytes);
        if (parcel->kind == Kind::tasks && in.get<std::uint64_t>() == operation_) crew_->add(jobs(in));
      }
      if (auto outcome = ranks_.shared(operation_)) return outcome->map(unpacked);
      send_when_due();
    }
  }

 private:
  /// A rank that works hears of a finished task at once; nothing else is urgent.
  static constexpr long busy_us = 20000;

  std::vector<Crew::Job> jobs(BytesIn& in) {
    std::vector<Crew::Job> all;
    while (!in.empty()) {
      const std::size_t task = in.get<std::uint64_t>();
      all.push_back({task, in.text()});
    }
    in_hand_ += all.size();
    return all;
  }

  void add(const Crew::Done& done) {
    if (!waiting_) oldest_ = Clock::now();
    waiting_ = true;
    put(results_, done);
  }

  /// Results of short tasks travel together, but before this rank runs out of tasks.
  void send_when_due() {
    if (!waiting_) return;
    const std::chrono::duration<double> held = Clock::now() - oldest_;
    if (crew_->waiting() >= threads_ && held.count() < hold_ && results_.size() < full_message) return;
    ranks_.post(0, Kind::results, BytesOut().put(operation_).take() + results_.take());
    results_ = {};
    waiting_ = false;
  }

  Ranks& ranks_;
  const std::uint64_t operation_;
  const double hold_;
  const unsigned threads_;
  std::size_t in_hand_ = 0;  ///< tasks that are not done
  BytesOut results_;
  bool waiting_ = false;
  Clock::time_point oldest_;
  const std::unique_ptr<Crew> crew_;
};

}  // namespace

Result<Outcome> carry_out(const Tasks& tasks, const ExecutorOptions& options, Ranks& ranks) {
  return ranks.root() ? Leader(tasks, options, ranks).run() : Follower(tasks, options, ranks).run();
}

unsigned threads_of(unsigned wanted, int ranks) {
  return wanted ? wanted : ranks > 1 ? 1 : std::max(1u, std::thread::hardware_concurrency());
}

std::string text_of(const std::vector<TaskFailure>& failures, const std::function<std::string(std::size_t)>& name) {
  constexpr std::size_t named = 3;
  std::string text;
  for (std::size_t i = 0; i < std::min(named, failures.size()); ++i)
    text += fmt::format("{}{}: {}{}", i ? "; " : "", name(failures[i].task), failures[i].error.message,
                        failures[i].attempts > 1 ? fmt::format(" ({} attempts)", failures[i].attempts) : "");
  if (failures.size() > named) text += fmt::format("; and {} more", failures.size() - named);
  return text;
}

Result<void> write_failures(const std::filesystem::path& folder, const std::vector<TaskFailure>& failures,
                            const std::function<std::string(std::size_t)>& name,
                            const std::function<std::string(std::size_t)>& input) {
  const std::filesystem::path file = folder / "failures.csv";
  if (failures.empty()) {
    std::error_code ignored;
    std::filesystem::remove(file, ignored);
    return {};
  }
  const auto quoted = [](std::string text) {
    for (std::size_t at = 0; (at = text.find('"', at)) != std::string::npos; at += 2) text.insert(at, 1, '"');
    return '"' + text + '"';
  };
  std::string text = "part,attempts,message,input\n";
  for (const TaskFailure& f : failures) {
    const std::string of = name(f.task);
    text += fmt::format("{},{},{},{}\n", of.find_first_of(",\"") == std::string::npos ? of : quoted(of), f.attempts,
                        quoted(f.error.message), quoted(input(f.task)));
  }
  return write_file(file, text, Existing::replace).map_error([&](Error error) {
    error.message = fmt::format("{}; {}", text_of(failures, name), error.message);
    return error;
  });
}

}  // namespace tribotwin::twin
