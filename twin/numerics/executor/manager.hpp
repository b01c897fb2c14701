#pragma once

#include <cstddef>
#include <deque>
#include <map>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

/// Who does which of many independent tasks; no threads, no messages, no clock.
namespace tribotwin::twin {

/// A task that failed as often as it may.
struct TaskFailure {
  std::size_t task = 0;
  int attempts = 0;
  Error error;  ///< of the last attempt
};

/// Dynamic scheduling: a rank that has room gets the next tasks in their order. Short tasks go out in batches, so that
/// a rank has work for lead_s while its messages travel; towards the end batches shrink (guided self-scheduling,
/// Polychronopoulos, Kuck 1987). A task whose work fails is tried again, by another rank where there is one; wrong
/// input (ErrorKind::input) stays wrong and is not.
class Manager {
 public:
  /// `retries`: further attempts of a failed task.
  Manager(std::deque<std::size_t> tasks, int retries, double lead_s)
      : todo_(std::move(tasks)), retries_(retries), lead_s_(lead_s), open_(todo_.size()) {}

  /// A further task, behind the others.
  void add(std::size_t task);
  /// A rank with this many threads takes part from now on.
  void enroll(int rank, unsigned threads);
  /// The tasks that the rank shall have in addition to those it has; none while it has enough.
  std::vector<std::size_t> grant(int rank);
  /// A task was done in this time [s].
  void succeeded(int rank, std::size_t task, double seconds);
  /// The failure where the task is not tried again; else null.
  const TaskFailure* failed(int rank, std::size_t task, Error error, double seconds);
  /// A rank gives a task back: it was told to stop.
  void returned(int rank, std::size_t task);
  /// No further task begins.
  void stop() { stopped_ = true; }

  bool stopped() const { return stopped_; }
  /// Every task has succeeded or failed, or those under way have after a stop.
  bool complete() const { return stopped_ ? under_way_ == 0 : open_ == 0; }
  /// In the order of the tasks.
  const std::vector<TaskFailure>& failures() const { return failures_; }
  /// Mean time of a task so far [s]; 0 before the first.
  double mean_s() const { return done_ ? total_s_ / static_cast<double>(done_) : 0; }

 private:
  struct Member {
    unsigned threads = 1;
    std::size_t has = 0;
  };
  struct Attempt {
    int number = 0, last_rank = -1;
  };
  void over(int rank, double seconds);
  bool next(int rank, std::size_t& task);

  std::deque<std::size_t> todo_;
  std::deque<std::size_t> again_;  ///< failed before
  std::map<std::size_t, Attempt> attempts_;
  std::map<int, Member> members_;
  std::vector<TaskFailure> failures_;
  int retries_;
  double lead_s_;
  std::size_t open_, under_way_ = 0, done_ = 0, threads_ = 0;
  double total_s_ = 0;
  bool stopped_ = false;
};

}  // namespace tribotwin::twin
