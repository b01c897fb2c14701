#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

/// Several runs with a folder each, of which an interrupted command makes only those that are missing.
namespace tribotwin::twin {

class PartStore;

/// All that the results of these scenarios depend on: engine, models, the scenarios and the content of the files that
/// they name.
std::string identity_of(const std::vector<Scenario>& scenarios);

/// What is to be said of the runs that are complete, in DIRECTORY/.unfinished until all are. For rank 0.
class UnfinishedRuns {
 public:
  UnfinishedRuns();
  UnfinishedRuns(UnfinishedRuns&&) noexcept;
  UnfinishedRuns& operator=(UnfinishedRuns&&) noexcept;
  ~UnfinishedRuns();

  /// Goes on where an earlier command has left runs of this identity. Where none has, a folder of `runs` must not hold
  /// one yet, unless it may be replaced: ErrorKind::input.
  static Result<UnfinishedRuns> open(const std::filesystem::path& directory, const std::vector<std::string>& runs,
                                     const std::string& identity, bool replace);
  /// Whether folders of runs without a report are leftovers of that command, and may be replaced.
  bool resumed() const { return resumed_; }
  /// The report of a run whose record, summary and scenario are still there. A run that was whole when its command was
  /// killed, but not yet counted (keep), is counted.
  std::optional<std::string> find(const std::string& run);
  /// Before another attempt at a run in its folder: removes the unfinished files of one that was killed.
  static void clear(const std::filesystem::path& folder);
  /// On any rank, before the summary (its text) of a complete run is written: once that is there, the run is whole.
  static Result<void> announce(const std::filesystem::path& directory, const std::string& run,
                               const std::string& summary, const std::string& report);
  /// Call it when its run is complete.
  Result<void> keep(const std::string& run, const std::string& report);
  /// Call it when no further report comes.
  Result<void> close();
  /// Call it when the results of all are written: nothing is left to go on from.
  void forget();

 private:
  std::filesystem::path directory_, folder_;
  std::unique_ptr<PartStore> store_;
  bool resumed_ = false;
};

}  // namespace tribotwin::twin
