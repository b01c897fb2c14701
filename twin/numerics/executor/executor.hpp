#pragma once

#include <atomic>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/numerics/executor/crew.hpp>
#include <tribotwin/twin/numerics/executor/manager.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>

/// Independent tasks on the threads of this process and on all ranks of an MPI job. The result of a task is a function
/// of its number alone, so the results are the same on any number of threads and ranks.
namespace tribotwin::twin {

struct Tasks {
  std::size_t count = 0;
  std::string identity;  ///< of what the tasks are made from: a rank that has another (an old file) is not used
  /// On any rank, from several threads; may throw. The result is a function of the task and of its input.
  Crew::Work work;
  /// `work` is called in processes of its own (crew_of_processes): a task that crashes fails alone. Otherwise in
  /// threads, and it ends the program.
  bool own_processes = false;
  /// Rank 0, before the first task: a result from an earlier run. May be empty.
  std::function<std::optional<std::string>(std::size_t task)> present;
  /// Rank 0, one call at a time, in the order in which tasks finish: the result is to be kept. An error (a full disk)
  /// ends all. May be empty.
  std::function<Result<void>(std::size_t task, const std::string& result)> keep;
  /// Rank 0: a task has failed for good. May be empty.
  std::function<void(const TaskFailure&)> failed;
  /// Rank 0, when a task is handed out: its input. Empty: "".
  std::function<std::string(std::size_t task)> input;
  /// Rank 0: how many tasks there are by now, where results lead to further ones; asked at the beginning and when a
  /// task is over. Then the outcome has no results, `keep` gets them. Empty: `count`.
  std::function<std::size_t()> grown;
  /// Rank 0: after each task that is over. May be empty.
  std::function<void(std::size_t over, std::size_t of)> progress;
  /// Rank 0: every second or more often, while tasks are under way. May be empty.
  std::function<void()> meanwhile;
};

struct ExecutorOptions {
  unsigned threads = 0;                     ///< per rank; 0: threads_of
  int retries = 1;                          ///< further attempts of a task whose work failed
  const std::atomic<bool>* stop = nullptr;  ///< when true, no further task begins
};

struct Outcome {
  std::vector<std::string> results;   ///< per task; empty where it failed or was not done
  std::vector<TaskFailure> failures;  ///< in the order of the tasks
  std::size_t present = 0;            ///< results from an earlier run
  bool stopped = false;               ///< before all tasks were over
};

/// Does all tasks; collective. Every rank gets the same outcome. A task that fails does not end the others. Fails with
/// the error of `keep`.
Result<Outcome> carry_out(const Tasks& tasks, const ExecutorOptions& options, Ranks& ranks = twin::ranks());

/// The number that the user asked for; where that is 0, all cores, and one on each of several ranks.
unsigned threads_of(unsigned wanted, int ranks = twin::ranks().size());

/// The first failures in one sentence each: "NAME: MESSAGE (2 attempts)". `name`: of a task.
std::string text_of(const std::vector<TaskFailure>& failures, const std::function<std::string(std::size_t)>& name);

/// FOLDER/failures.csv: each task that failed, with its name and what it was made from; no such file where none has. An
/// error (a full disk) also says what has failed.
Result<void> write_failures(const std::filesystem::path& folder, const std::vector<TaskFailure>& failures,
                            const std::function<std::string(std::size_t)>& name,
                            const std::function<std::string(std::size_t)>& input);

}  // namespace tribotwin::twin
