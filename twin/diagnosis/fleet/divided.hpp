#pragma once

#include <functional>
#include <string>
#include <vector>

#include <tribotwin/twin/diagnosis/fleet/judge.hpp>
#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>
#include <tribotwin/twin/numerics/executor/bytes.hpp>

/// Work on all curves or joints of a fleet on the threads and ranks of a job (numerics/executor), a chunk after the
/// other. Rank 0 alone has the store; the others get curves and rows from it and have none of the callbacks but `work`.
namespace tribotwin::twin::diagnosis::fleet {

struct ChunkWork {
  std::function<std::size_t()> prepare;                ///< the next chunk: how many tasks it is; 0 at the end
  std::function<std::string(std::size_t task)> input;  ///< what other ranks need for the task
  /// Any rank, several threads; `input` is empty on rank 0 where it is alone, which has the chunk itself.
  std::function<std::string(std::size_t task, const std::string& input)> work;
  std::function<void(const std::vector<std::string>& results)> finish;  ///< results in the order of the tasks
};
/// Collective. Throws InputError or std::runtime_error.
void divide(const ChunkWork& work, unsigned threads);

void put(BytesOut& out, const LevelCurve& curve);
LevelCurve get_curve(BytesIn& in);
/// What a store keeps of an observation.
void put(BytesOut& out, const Observation& observation);
Observation get_observation(BytesIn& in);
void put(BytesOut& out, const Rows& rows);
Rows get_rows(BytesIn& in);
void put(BytesOut& out, const ByChoice& numbers);
ByChoice get_by_choice(BytesIn& in);
void put(BytesOut& out, const Evidence& evidence);
Evidence get_evidence(BytesIn& in);

}  // namespace tribotwin::twin::diagnosis::fleet
