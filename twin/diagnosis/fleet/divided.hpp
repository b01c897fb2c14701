#pragma once

#include <functional>
#include <string>
#include <vector>

#include <tribotwin/twin/diagnosis/fleet/judge.hpp>
#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>

/// Work on all curves or joints of a fleet on the cores and ranks of a job (numerics/executor), a chunk after the
/// other. Rank 0 alone has the store; the others get curves and rows from it and have none of the callbacks but `work`.
namespace tribotwin::twin::diagnosis::fleet {

/// An item is a curve, a joint or a type of joint.
struct ChunkWork {
  std::function<std::size_t()> prepare;  ///< the next chunk: how many items it has; 0 at the end
  std::function<void(std::size_t item, BytesOut& out)> input;
  std::function<void(BytesIn& input, BytesOut& out)> work;  ///< on any rank, in a process of its own
  /// By item, empty where `failures` (`task`: the item, in rising order) says why.
  std::function<void(const std::vector<std::string>& results, const std::vector<TaskFailure>& failures)> finish;
  std::size_t batch = 64;  ///< items of a task
};
/// Collective. Items are done by the batch, in processes that are forked once for all chunks. Of a batch that failed (a
/// crash, an exception) each item is done again in a task of its own, with `retries` further attempts of both: what
/// fails then has failed for good, alone. Throws InputError or std::runtime_error, the latter also when interrupted().
void divide(const ChunkWork& work, unsigned threads, int retries);
/// "INPUT: MESSAGE (2 attempts)"
std::string failure_text(const std::string& input, const TaskFailure& failure);

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
void put(BytesOut& out, const Finding& finding);
Finding get_finding(BytesIn& in);

}  // namespace tribotwin::twin::diagnosis::fleet
