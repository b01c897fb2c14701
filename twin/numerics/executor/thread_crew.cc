#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

#include <tribotwin/twin/numerics/executor/crew.hpp>

namespace tribotwin::twin {
namespace {

class ThreadCrew final : public Crew {
 public:
  ThreadCrew(unsigned threads, Work work, const std::atomic<bool>* stop) : work_(std::move(work)), stop_(stop) {
    for (unsigned i = 0; i < std::max(1u, threads); ++i) threads_.emplace_back([this] { run(); });
  }

  ~ThreadCrew() override {
    {
      const std::lock_guard lock(mutex_);
      closing_ = true;
    }
    more_.notify_all();
    threads_.clear();
  }

  void add(std::vector<Job> jobs) override {
    if (jobs.empty()) return;
    {
      const std::lock_guard lock(mutex_);
      for (Job& job : jobs) todo_.push_back(std::move(job));
    }
    more_.notify_all();
  }

  std::vector<Done> take(std::chrono::microseconds at_most) override {
    std::unique_lock lock(mutex_);
    finished_.wait_for(lock, at_most, [this] { return !done_.empty(); });
    return std::exchange(done_, {});
  }

  std::size_t waiting() const override {
    const std::lock_guard lock(mutex_);
    return todo_.size();
  }

 private:
  void run() {
    std::unique_lock lock(mutex_);
    for (;;) {
      more_.wait(lock, [this] { return closing_ || !todo_.empty(); });
      if (closing_) return;
      const Job job = std::move(todo_.front());
      todo_.pop_front();
      lock.unlock();
      Done done = perform(work_, job, stop_);
      lock.lock();
      done_.push_back(std::move(done));
      finished_.notify_one();
    }
  }

  const Work work_;
  const std::atomic<bool>* const stop_;
  mutable std::mutex mutex_;  ///< guards all below
  std::condition_variable more_, finished_;
  std::deque<Job> todo_;
  std::vector<Done> done_;
  bool closing_ = false;
  std::vector<std::jthread> threads_;
};

}  // namespace

std::unique_ptr<Crew> crew_of_threads(unsigned threads, Crew::Work work, const std::atomic<bool>* stop) {
  return std::make_unique<ThreadCrew>(threads, std::move(work), stop);
}

}  // namespace tribotwin::twin
