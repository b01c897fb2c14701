#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {

/// The threads of one rank that do tasks, the next one as soon as one is done.
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

  /// `work` is called by `threads` threads; an exception of it becomes an error of ErrorKind::work. Once *stop is true
  /// (may be nullptr), no task begins, and one that failed meanwhile counts as not done.
  Crew(unsigned threads, Work work, const std::atomic<bool>* stop);
  /// Waits for the tasks under way; the others do not begin.
  ~Crew();

  void add(std::vector<Job> jobs);
  /// What was finished since the last call; waits for something at most so long.
  std::vector<Done> take(std::chrono::microseconds at_most);
  /// Tasks that have not begun.
  std::size_t waiting() const;

 private:
  void run();
  Done perform(const Job& job) const;

  const Work work_;
  const std::atomic<bool>* const stop_;
  mutable std::mutex mutex_;  ///< guards all below
  std::condition_variable more_, finished_;
  std::deque<Job> todo_;
  std::vector<Done> done_;
  bool closing_ = false;
  std::vector<std::jthread> threads_;
};

}  // namespace tribotwin::twin
