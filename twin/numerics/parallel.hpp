#pragma once

#include <algorithm>
#include <cstddef>
#include <thread>
#include <vector>

namespace tribotwin::twin::identification {

/// Calls work(i) for every i < count; each worker has its own part of the range.
template <class Work>
void in_parallel(std::size_t count, unsigned threads, const Work& work) {
  const std::size_t workers = std::min<std::size_t>(std::max(1u, threads), count);
  const auto run = [&](std::size_t w) {
    for (std::size_t i = w; i < count; i += workers) work(i);
  };
  std::vector<std::jthread> team;
  for (std::size_t w = 1; w < workers; ++w) team.emplace_back(run, w);
  run(0);
}

}  // namespace tribotwin::twin::identification
