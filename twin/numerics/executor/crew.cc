#include <algorithm>
#include <exception>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/numerics/executor/crew.hpp>

namespace tribotwin::twin {

Crew::Crew(unsigned threads, Work work, const std::atomic<bool>* stop) : work_(std::move(work)), stop_(stop) {
  for (unsigned i = 0; i < std::max(1u, threads); ++i) threads_.emplace_back([this] { run(); });
}

Crew::~Crew() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  more_.notify_all();
  threads_.clear();
}

void Crew::add(std::vector<Job> jobs) {
  if (jobs.empty()) return;
  {
    const std::lock_guard lock(mutex_);
    for (Job& job : jobs) todo_.push_back(std::move(job));
  }
  more_.notify_all();
}

std::vector<Crew::Done> Crew::take(std::chrono::microseconds at_most) {
  std::unique_lock lock(mutex_);
  finished_.wait_for(lock, at_most, [this] { return !done_.empty(); });
  return std::exchange(done_, {});
}

std::size_t Crew::waiting() const {
  const std::lock_guard lock(mutex_);
  return todo_.size();
}

Crew::Done Crew::perform(const Job& job) const {
  if (stop_ && *stop_) return {.task = job.task, .result = {}, .stopped = true};
  const auto started = std::chrono::steady_clock::now();
  Done done{.task = job.task, .result = {}};
  try {
    done.result = work_(job.task, job.input);
  } catch (const std::exception& e) {
    done.result = work_failed(e.what());
  } catch (...) {
    done.result = work_failed("ended with an exception of an unknown kind");
  }
  done.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  done.stopped = !done.result && stop_ && *stop_;
  return done;
}

void Crew::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    more_.wait(lock, [this] { return closing_ || !todo_.empty(); });
    if (closing_) return;
    const Job job = std::move(todo_.front());
    todo_.pop_front();
    lock.unlock();
    Done done = perform(job);
    lock.lock();
    done_.push_back(std::move(done));
    finished_.notify_one();
  }
}

}  // namespace tribotwin::twin
