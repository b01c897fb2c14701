#include <algorithm>
#include <utility>

#include <tribotwin/twin/numerics/executor/manager.hpp>

namespace tribotwin::twin {

void Manager::add(std::size_t task) {
  todo_.push_back(task);
  ++open_;
}

void Manager::enroll(int rank, unsigned threads) {
  members_[rank] = {.threads = std::max(1u, threads)};
  threads_ += members_[rank].threads;
}

/// Takes the next task for this rank off the lists.
bool Manager::next(int rank, std::size_t& task) {
  // What failed comes first, as it may need several attempts; on the rank where it failed only if that is alone.
  const auto other = std::ranges::find_if(
      again_, [&](std::size_t t) { return members_.size() == 1 || attempts_[t].last_rank != rank; });
  if (other != again_.end()) {
    task = *other;
    again_.erase(other);
    return true;
  }
  if (todo_.empty()) return false;
  task = todo_.front();
  todo_.pop_front();
  return true;
}

std::vector<std::size_t> Manager::grant(int rank) {
  std::vector<std::size_t> tasks;
  const auto found = members_.find(rank);
  if (stopped_ || found == members_.end()) return tasks;
  Member& member = found->second;
  const double mean = mean_s();
  const auto fair = static_cast<double>(todo_.size()) / (2.0 * static_cast<double>(threads_));
  const auto ahead =
      static_cast<std::size_t>(member.threads * (done_ ? std::min(fair, lead_s_ / std::max(mean, 1e-9)) : 0.0));
  if (member.has >= member.threads + ahead / 2 && member.has > 0) return tasks;
  for (std::size_t task; member.has < member.threads + ahead && next(rank, task);) {
    tasks.push_back(task);
    ++member.has, ++under_way_;
  }
  return tasks;
}

void Manager::over(int rank, double seconds) {
  --members_.at(rank).has, --under_way_;
  ++done_;
  total_s_ += seconds;
}

void Manager::succeeded(int rank, std::size_t task, double seconds) {
  over(rank, seconds);
  attempts_.erase(task);
  --open_;
}

const TaskFailure* Manager::failed(int rank, std::size_t task, Error error, double seconds) {
  over(rank, seconds);
  Attempt& attempt = attempts_[task];
  attempt.last_rank = rank;
  if (++attempt.number <= retries_ && error.kind == ErrorKind::work) {
    again_.push_back(task);
    return nullptr;
  }
  --open_;
  return &*failures_.insert(std::ranges::upper_bound(failures_, task, {}, &TaskFailure::task),
                            {task, attempt.number, std::move(error)});
}

void Manager::returned(int rank, std::size_t task) {
  --members_.at(rank).has, --under_way_;
  todo_.push_front(task);
  stopped_ = true;
}

}  // namespace tribotwin::twin
