#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/numerics/executor/bytes.hpp>

namespace tribotwin::twin {

/// Those of one rank that do tasks, the next one as soon as one is done.
class Crew {
 public:
  struct Done {
    std::size_t task = 0;
    Result<std::string> result;
    double seconds = 0;
    bool stopped = false;  ///< not done: the user wants the program to end
  };
  struct Job {
    std::size_t task = 0;
    std::string input;
  };
  using Work = std::function<Result<std::string>(std::size_t task, const std::string& input)>;

  Crew() = default;
  Crew(const Crew&) = delete;
  /// Waits for the tasks under way; the others do not begin.
  virtual ~Crew() = default;

  virtual void add(std::vector<Job> jobs) = 0;
  /// What was finished since the last call; waits for something at most so long.
  virtual std::vector<Done> take(std::chrono::microseconds at_most) = 0;
  /// Tasks that have not begun.
  virtual std::size_t waiting() const = 0;
};

/// An exception of `work` becomes an error of ErrorKind::work. Once *stop is true (may be nullptr), no task begins, and
/// one that failed meanwhile counts as not done.
Crew::Done perform(const Crew::Work& work, const Crew::Job& job, const std::atomic<bool>* stop);

/// `work` is called by several threads of this process.
std::unique_ptr<Crew> crew_of_threads(unsigned threads, Crew::Work work, const std::atomic<bool>* stop);

/// `work` is called in copies of this process, made by fork(2): memory that it changes is its own. A task that ends its
/// process (a crash, exit(), kill -9) has failed with ErrorKind::work, the signal and what it wrote to stderr last; the
/// next task gets a new process. What tasks write to stderr appears after each. When this process ends, so do they.
std::unique_ptr<Crew> crew_of_processes(unsigned processes, Crew::Work work, const std::atomic<bool>* stop);

/// Between processes and ranks.
void put(BytesOut& out, const Crew::Done& done);
Crew::Done get_done(BytesIn& in);

}  // namespace tribotwin::twin
