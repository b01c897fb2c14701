#pragma once

#include <algorithm>
#include <cstddef>
#include <thread>
#include <vector>

namespace tribotwin::twin::identification {

/// Calls run(w) for every w < min(threads, count), each in a thread of its own, run(0) in the caller's. Returns when
/// all have. `run` must not throw.
template <class Run>
void in_team(std::size_t count, unsigned threads, const Run& run) {
  const std::size_t workers = std::min<std::size_t>(std::max(1u, threads), count);
  std::vector<std::jthread> team;
  for (std::size_t w = 1; w < workers; ++w) team.emplace_back(run, w);
  if (workers > 0) run(std::size_t{0});
}

/// Calls work(i) for every i < count; each worker has its own part of the range.
template <class Work>
void in_parallel(std::size_t count, unsigned threads, const Work& work) {
  const std::size_t workers = std::min<std::size_t>(std::max(1u, threads), count);
  in_team(count, threads, [&](std::size_t w) {
    for (std::size_t i = w; i < count; i += workers) work(i);
  });
}

}  // namespace tribotwin::twin::identification
