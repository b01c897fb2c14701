// The executor on ranks that are threads of this process: queues in place of MPI. And the manager alone, on a clock of
// its own.
#include <atomic>
#include <barrier>
#include <deque>
#include <latch>
#include <map>
#include <mutex>
#include <numeric>
#include <queue>
#include <set>
#include <thread>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/twin/numerics/executor/bytes.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>
#include <tribotwin/twin/numerics/executor/mpi.hpp>

namespace tribotwin::twin {
namespace {

using testing::ElementsAre, testing::HasSubstr, testing::IsEmpty, testing::SizeIs;

class Queues {
 public:
  explicit Queues(int size) : inbox_(static_cast<std::size_t>(size)), end_(size) {}

  class Rank final : public Transport {
   public:
    Rank(Queues& all, int rank) : all_(all), rank_(rank) {}
    int rank() const override { return rank_; }
    int size() const override { return static_cast<int>(all_.inbox_.size()); }
    void send(int to, const std::string& bytes) override {
      const std::lock_guard lock(all_.mutex_);
      all_.inbox_[static_cast<std::size_t>(to)].push_back({rank_, bytes});
    }
    std::optional<Message> receive() override {
      const std::lock_guard lock(all_.mutex_);
      auto& mine = all_.inbox_[static_cast<std::size_t>(rank_)];
      if (mine.empty()) return std::nullopt;
      Message message = std::move(mine.front());
      mine.pop_front();
      return message;
    }
    void close() override { all_.end_.arrive_and_wait(); }

   private:
    Queues& all_;
    const int rank_;
  };

 private:
  std::mutex mutex_;
  std::vector<std::deque<Transport::Message>> inbox_;
  std::barrier<> end_;
};

/// Calls program(ranks) on every rank of a job, as mpirun does; what each returns.
template <class Program>
auto on_ranks(int size, const Program& program, const std::string& arguments = "same") {
  Queues queues(size);
  std::vector<decltype(program(std::declval<Ranks&>()))> results(static_cast<std::size_t>(size));
  std::vector<std::jthread> processes;
  for (int rank = 0; rank < size; ++rank)
    processes.emplace_back([&, rank] {
      Ranks ranks(std::make_unique<Queues::Rank>(queues, rank));
      EXPECT_EQ(ranks.join(arguments, fmt::format("host{}", rank)), size > 1);
      results[static_cast<std::size_t>(rank)] = program(ranks);
      ranks.leave(0, "");
    });
  processes.clear();
  return results;
}

std::string square(std::size_t i) { return fmt::format("{} squared is {}", i, i * i); }

TEST(Executor, GivesTheSameResultsOnThreadsAndRanks) {
  std::vector<std::string> expected;
  for (std::size_t i = 0; i < 300; ++i) expected.push_back(square(i));
  const Tasks tasks{.count = 300, .work = [](std::size_t i, const std::string&) { return square(i); }};
  for (const unsigned threads : {1u, 8u}) {
    Ranks alone;
    const auto outcome = carry_out(tasks, {.threads = threads}, alone);
    ASSERT_TRUE(outcome);
    EXPECT_EQ(outcome->results, expected);
  }
  for (const int size : {2, 4, 7}) {
    const auto outcomes = on_ranks(size, [&](Ranks& ranks) { return carry_out(tasks, {.threads = 1}, ranks); });
    for (const auto& outcome : outcomes) {
      ASSERT_TRUE(outcome) << outcome.error().message;
      EXPECT_EQ(outcome->results, expected) << size;
    }
  }
}

TEST(Executor, EveryRankWorksAndEachTaskIsDoneOnceAndKeptOnRank0) {
  std::mutex mutex;
  std::map<std::size_t, int> done, kept;
  std::set<int> workers;
  std::latch all_at_work(3);  // no rank does a second task before each has one
  const auto outcomes = on_ranks(3, [&](Ranks& ranks) {
    const Tasks tasks{.count = 60,
                      .work =
                          [&](std::size_t i, const std::string&) {
                            const bool first = [&] {
                              const std::lock_guard lock(mutex);
                              ++done[i];
                              return workers.insert(ranks.rank()).second;
                            }();
                            if (first) all_at_work.arrive_and_wait();
                            return square(i);
                          },
                      .keep = [&](std::size_t i, const std::string& result) -> Result<void> {
                        EXPECT_EQ(ranks.rank(), 0);
                        EXPECT_EQ(result, square(i));
                        ++kept[i];
                        return {};
                      }};
    return carry_out(tasks, {}, ranks);
  });
  EXPECT_THAT(workers, ElementsAre(0, 1, 2));
  EXPECT_THAT(done, SizeIs(60));
  EXPECT_EQ(done, kept);
  for (const auto& [task, times] : done) EXPECT_EQ(times, 1) << task;
}

TEST(Executor, RecordsFailuresAndCompletesTheRest) {
  std::atomic<int> wrong = 0, failing = 0, throwing = 0, recovering = 0;
  const Tasks tasks{.count = 20, .work = [&](std::size_t i, const std::string&) -> Result<std::string> {
                      if (i == 3) return ++failing, work_failed("diverged");
                      if (i == 5) return ++wrong, tl::unexpected(Error("wrong key"));
                      if (i == 7) ++throwing, throw std::runtime_error("no memory");
                      if (i == 9 && ++recovering < 3) return work_failed("not yet");
                      return square(i);
                    }};
  for (const int size : {1, 3}) {
    wrong = failing = throwing = recovering = 0;
    const auto outcomes = on_ranks(size, [&](Ranks& ranks) { return carry_out(tasks, {.retries = 2}, ranks); });
    for (const auto& outcome : outcomes) {
      ASSERT_TRUE(outcome);
      ASSERT_THAT(outcome->failures, SizeIs(3));
      EXPECT_EQ(text_of(outcome->failures, [](std::size_t i) { return fmt::format("run {}", i); }),
                "run 3: diverged (3 attempts); run 5: wrong key; run 7: no memory (3 attempts)");
      for (std::size_t i = 0; i < 20; ++i) EXPECT_EQ(outcome->results[i], i == 3 || i == 5 || i == 7 ? "" : square(i));
    }
    EXPECT_EQ(failing, 3);
    EXPECT_EQ(wrong, 1);  // wrong input stays wrong
    EXPECT_EQ(throwing, 3);
    EXPECT_EQ(recovering, 3);
  }
}

TEST(Executor, DoesNotRepeatWhatIsThere) {
  std::atomic<int> done = 0;
  const auto outcomes = on_ranks(2, [&](Ranks& ranks) {
    const Tasks tasks{.count = 10,
                      .work = [&](std::size_t i, const std::string&) { return ++done, square(i); },
                      .present = [&](std::size_t i) -> std::optional<std::string> {
                        EXPECT_TRUE(ranks.root());
                        return i % 2 ? std::optional(square(i)) : std::nullopt;
                      }};
    return carry_out(tasks, {}, ranks);
  });
  EXPECT_EQ(done, 5);
  for (const auto& outcome : outcomes) {
    EXPECT_EQ(outcome->present, 5u);
    for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(outcome->results[i], square(i));
  }
}

TEST(Executor, ResultsLeadToFurtherTasks) {
  // Collatz: each result is the input of the next task of its chain, until 1; what follows a failure is not done.
  for (const int size : {1, 3}) {
    std::vector<std::string> inputs{"6", "7", "-1"};
    std::map<std::string, int> kept;
    std::vector<std::size_t> lost;
    const auto outcomes = on_ranks(size, [&](Ranks& ranks) {
      const Tasks tasks{.work = [](std::size_t, const std::string& input) -> Result<std::string> {
                          const int n = std::stoi(input);
                          if (n < 0) return work_failed("no");
                          return std::to_string(n % 2 ? 3 * n + 1 : n / 2);
                        },
                        .keep = [&](std::size_t, const std::string& result) -> Result<void> {
                          ++kept[result];
                          if (result != "1") inputs.push_back(result);
                          return {};
                        },
                        .failed = [&](const TaskFailure& failure) { lost.push_back(failure.task); },
                        .input = [&](std::size_t i) { return inputs[i]; },
                        .grown = [&] { return inputs.size(); }};
      return carry_out(tasks, {.retries = 1}, ranks);
    });
    for (const auto& outcome : outcomes) {
      ASSERT_TRUE(outcome);
      EXPECT_THAT(outcome->results, IsEmpty());
      ASSERT_THAT(outcome->failures, SizeIs(1));
      EXPECT_EQ(outcome->failures[0].task, 2u);
      EXPECT_EQ(outcome->failures[0].attempts, 2);
    }
    EXPECT_THAT(lost, ElementsAre(2u));
    EXPECT_EQ(inputs.size(), 3u + 8 - 1 + 16 - 1);  // 6 gets to 1 in 8 steps, 7 in 16
    EXPECT_EQ(kept["1"], 2);
    EXPECT_EQ(kept["10"], 2);
  }
}

TEST(Executor, AResultThatCannotBeKeptEndsAllRanks) {
  const Tasks tasks{.count = 1000,
                    .work = [](std::size_t i, const std::string&) { return square(i); },
                    .keep = [](std::size_t i, const std::string&) -> Result<void> {
                      if (i < 20) return {};
                      return work_failed("no space left");
                    }};
  for (const auto& outcome : on_ranks(3, [&](Ranks& ranks) { return carry_out(tasks, {}, ranks); })) {
    ASSERT_FALSE(outcome);
    EXPECT_EQ(outcome.error().message, "no space left");
    EXPECT_EQ(outcome.error().kind, ErrorKind::work);
  }
}

TEST(Executor, StopsWhereOneRankIsToldTo) {
  const auto outcomes = on_ranks(3, [&](Ranks& ranks) {
    std::atomic<bool> stop = false;
    const Tasks tasks{.count = 100000, .work = [&](std::size_t i, const std::string&) {
                        if (ranks.rank() == 1) stop = true;
                        std::this_thread::sleep_for(std::chrono::microseconds(100));
                        return square(i);
                      }};
    return carry_out(tasks, {.stop = &stop}, ranks);
  });
  for (const auto& outcome : outcomes) {
    EXPECT_TRUE(outcome->stopped);
    EXPECT_THAT(outcome->failures, IsEmpty());
  }
}

TEST(Executor, ARankWithOtherInputIsNotUsed) {
  std::atomic<int> by_stranger = 0;
  std::latch stranger_here(1);
  testing::internal::CaptureStderr();
  const auto outcomes = on_ranks(3, [&](Ranks& ranks) {
    const bool stranger = ranks.rank() == 2;
    if (stranger) stranger_here.count_down();
    const Tasks tasks{.count = 40,
                      .identity = stranger ? "old model" : "model",
                      .work = [&, stranger](std::size_t i, const std::string&) {
                        by_stranger += stranger;
                        stranger_here.wait();
                        std::this_thread::sleep_for(std::chrono::milliseconds(5));
                        return square(i);
                      }};
    return carry_out(tasks, {}, ranks);
  });
  EXPECT_THAT(testing::internal::GetCapturedStderr(), HasSubstr("rank 2 (host2) has other input than rank 0"));
  EXPECT_EQ(by_stranger, 0);
  EXPECT_THAT(outcomes[0]->results, SizeIs(40));
}

TEST(Ranks, GetWhatRank0Has) {
  for (const int size : {1, 2, 3, 6, 8}) {
    const auto got = on_ranks(size, [](Ranks& ranks) {
      std::string all;
      for (const std::string part : {"a", "b", "c"})
        all += *ranks.from_root([&] {
          EXPECT_TRUE(ranks.root());
          return Result<std::string>(part);
        });
      const auto failed = ranks.on_root([]() -> Result<void> { return tl::unexpected(Error("wrong")); });
      return all + failed.error().message;
    });
    for (const auto& one : got) EXPECT_EQ(one, "abcwrong");
  }
}

TEST(Ranks, ThatFailAreNamedAndTheOthersGoOn) {
  testing::internal::CaptureStderr();
  Queues queues(3);
  std::vector<std::string> results;
  {
    std::vector<std::jthread> processes;
    for (int rank = 0; rank < 3; ++rank)
      processes.emplace_back([&, rank] {
        Ranks ranks(std::make_unique<Queues::Rank>(queues, rank));
        ranks.join("same", "node");
        if (rank == 1) return ranks.leave(2, "model.xml: does not exist");
        const Tasks tasks{.count = 30, .work = [](std::size_t i, const std::string&) { return square(i); }};
        const auto outcome = carry_out(tasks, {}, ranks);
        if (rank == 0) results = outcome->results;
        ranks.leave(0, "");
      });
  }
  EXPECT_THAT(results, SizeIs(30));
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              HasSubstr("warning: rank 1 (node) failed and rank 0 did not: model.xml: does not exist"));
}

TEST(Ranks, AreToldWhenRank0EndsBefore) {
  testing::internal::CaptureStderr();
  const auto got = on_ranks(3, [](Ranks& ranks) -> std::string {
    if (ranks.root()) return "left";
    const Tasks tasks{.count = 30, .work = [](std::size_t i, const std::string&) { return square(i); }};
    return carry_out(tasks, {}, ranks).error().message;
  });
  EXPECT_THAT(got, ElementsAre("left", "rank 0 has ended", "rank 0 has ended"));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(Ranks, WithOtherArgumentsAreProgramsOfTheirOwn) {
  Queues queues(2);
  std::vector<std::jthread> processes;
  for (int rank = 0; rank < 2; ++rank)
    processes.emplace_back([&, rank] {
      Ranks ranks(std::make_unique<Queues::Rank>(queues, rank));
      EXPECT_FALSE(ranks.join(fmt::format("seed {}", rank), "node"));
      EXPECT_EQ(ranks.size(), 1);
    });
}

TEST(Launch, IsRecognisedByItsVariables) {
  using Variables = std::map<std::string, std::string>;
  struct Case {
    Variables variables;
    std::string expected;
  };
  const std::vector<Case> cases{
      {{}, "none"},
      {{{"OMPI_COMM_WORLD_SIZE", "4"}}, "mpirun 4 true"},
      {{{"PMI_SIZE", "8"}, {"PMI_RANK", "1"}}, "mpiexec 8 true"},
      {{{"SLURM_NTASKS", "4"}, {"SLURM_PROCID", "0"}}, "none"},  // a batch script
      {{{"SLURM_STEP_NUM_TASKS", "4"}, {"SLURM_PROCID", "0"}, {"PMIX_RANK", "0"}}, "srun 4 true"},
      {{{"SLURM_STEP_NUM_TASKS", "4"}, {"SLURM_PROCID", "0"}}, "srun 4 false"},
      // mpirun inside a Slurm job: its daemons are the tasks of a step.
      {{{"SLURM_STEP_NUM_TASKS", "2"}, {"SLURM_PROCID", "0"}, {"OMPI_COMM_WORLD_SIZE", "64"}}, "mpirun 64 true"},
      {{{"OMPI_COMM_WORLD_SIZE", "4"}, {"TRIBOTWIN_RANKS", "alone"}}, "none"}};
  for (const auto& [variables, expected] : cases) {
    const auto found = launch([&](const char* name) {
      const auto one = variables.find(name);
      return one == variables.end() ? nullptr : one->second.c_str();
    });
    EXPECT_EQ(found ? fmt::format("{} {} {}", found->launcher, found->ranks, found->reachable) : "none", expected);
  }
}

TEST(Bytes, AreReadAsTheyWereWritten) {
  const std::vector<double> numbers{0.1, -std::numeric_limits<double>::infinity(), 1e-310};
  const std::string bytes =
      BytesOut().put(7).put(std::string_view("a\0b", 3)).put(std::span<const double>(numbers)).put(true).take();
  BytesIn in(bytes);
  EXPECT_EQ(in.get<int>(), 7);
  EXPECT_EQ(in.text(), std::string("a\0b", 3));
  EXPECT_EQ(in.numbers<double>(), numbers);
  EXPECT_TRUE(in.get<bool>());
  EXPECT_TRUE(in.empty());
  for (std::size_t cut = 0; cut < bytes.size(); ++cut) {
    BytesIn part(std::string_view(bytes).substr(0, cut));
    EXPECT_THROW((part.get<int>(), part.text(), part.numbers<double>(), part.get<bool>()), std::runtime_error) << cut;
  }
}

TEST(Manager, TriesAFailedTaskOnAnotherRank) {
  Manager manager({0}, 1, 0.1);
  manager.enroll(0, 1);
  manager.enroll(1, 1);
  EXPECT_THAT(manager.grant(1), ElementsAre(0));
  manager.failed(1, 0, Error("no", ErrorKind::work), 1);
  EXPECT_THAT(manager.grant(1), IsEmpty());
  EXPECT_THAT(manager.grant(0), ElementsAre(0));
  manager.failed(0, 0, Error("no", ErrorKind::work), 1);
  EXPECT_TRUE(manager.complete());
  EXPECT_THAT(manager.failures(), SizeIs(1));
}

/// A job on a clock of its own: ranks of one thread, a manager that takes `message_s` for a message in or out and
/// `keep_s` for a result, messages that are `latency_s` on their way.
struct Simulation {
  int ranks = 2;
  std::size_t tasks = 100;
  double task_s = 1, message_s = 2e-5, keep_s = 0, latency_s = 1e-3, lead_s = 0.1;
};
struct Simulated {
  double efficiency, manager_busy;
};

Simulated simulated(const Simulation& s) {
  std::deque<std::size_t> all(s.tasks);
  std::iota(all.begin(), all.end(), std::size_t{0});
  Manager manager(std::move(all), 1, s.lead_s);
  struct Rank {
    double free_at = 0;                                ///< when its last task ends
    std::vector<std::pair<std::size_t, double>> ends;  ///< of tasks whose results it has not sent
  };
  std::vector<Rank> ranks(static_cast<std::size_t>(s.ranks));
  using Event = std::pair<double, int>;  // a message from a rank arrives
  std::priority_queue<Event, std::vector<Event>, std::greater<>> events;
  for (int r = 0; r < s.ranks; ++r) manager.enroll(r, 1), events.push({0, r});
  double manager_at = 0, busy = 0, last = 0;
  while (!events.empty()) {
    const auto [at, r] = events.top();
    events.pop();
    Rank& rank = ranks[static_cast<std::size_t>(r)];
    double cost = s.message_s;
    const double sent = at - s.latency_s;
    std::erase_if(rank.ends, [&](const auto& one) {
      if (one.second > sent + 1e-12) return false;
      manager.succeeded(r, one.first, s.task_s);
      cost += s.keep_s;
      return true;
    });
    const auto granted = manager.grant(r);
    if (!granted.empty()) cost += s.message_s;
    manager_at = std::max(manager_at, at) + cost;
    busy += cost;
    for (const std::size_t task : granted) {
      rank.free_at = std::max(rank.free_at, manager_at + s.latency_s) + s.task_s;
      rank.ends.push_back({task, rank.free_at});
      last = std::max(last, rank.free_at);
    }
    if (rank.ends.empty()) continue;
    // As in executor.cc: results are held for a quarter of the lead, or until no task waits.
    const double due =
        std::max(rank.ends.front().second, std::min(rank.free_at - s.task_s, rank.ends.front().second + s.lead_s / 4));
    const auto next = std::ranges::find_if(rank.ends, [&](const auto& one) { return one.second >= due - 1e-12; });
    events.push({(next == rank.ends.end() ? rank.free_at : next->second) + s.latency_s, r});
  }
  const double ideal = static_cast<double>(s.tasks) * s.task_s / s.ranks;
  return {ideal / std::max(last, manager_at), busy / std::max(last, manager_at)};
}

TEST(Manager, KeepsATwoCoreJobBusy) {
  EXPECT_GT(simulated({.ranks = 2, .tasks = 100, .task_s = 1}).efficiency, 0.99);
  EXPECT_GT(simulated({.ranks = 2, .tasks = 10000, .task_s = 0.01}).efficiency, 0.97);
}

/// The table of tests/README.md, "Ranks". Message cost as measured there.
TEST(Manager, On1024Ranks) {
  struct Case {
    double task_s, keep_s, least, most;
  };
  const Case cases[] = {
      {1, 0, 0.95, 1},
      {1, 2.5e-4, 0.9, 1},
      {0.01, 0, 0.9, 1},
      {0.01, 2.5e-4, 0.02, 0.06},
  };
  for (const auto& [task_s, keep_s, least, most] : cases) {
    const auto [efficiency, busy] =
        simulated({.ranks = 1024,
                   .tasks = static_cast<std::size_t>(1024 * std::min(100.0, 4 / task_s) * 5),
                   .task_s = task_s,
                   .keep_s = keep_s,
                   .lead_s = 0.41});
    RecordProperty(fmt::format("task_{:g}_keep_{:g}", task_s, keep_s), fmt::format("{:.3f} {:.3f}", efficiency, busy));
    std::printf("1024 ranks, tasks of %g s, %g s per kept result: efficiency %.3f, manager busy %.3f\n", task_s, keep_s,
                efficiency, busy);
    EXPECT_GT(efficiency, least);
    EXPECT_LE(efficiency, most);
  }
}

}  // namespace
}  // namespace tribotwin::twin
