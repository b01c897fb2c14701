#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include <tribotwin/twin/simulation/summary.hpp>

namespace tribotwin::twin {

/// Compares a twin with the recording that it follows: the measured position of every recorded instant against the
/// twin's at that time. For scenarios with recording and baseline; otherwise it does nothing.
class RecordingComparison {
 public:
  explicit RecordingComparison(const Scenario& scenario) : scenario_(scenario) {}
  /// Called before each step.
  void add(const Twin& twin);
  /// Mean absolute errors of the twin and of the baseline over `steps` steps; nothing without compared samples.
  std::optional<Comparison> result(std::int64_t steps) const;

 private:
  double baseline_mae_mrad(std::int64_t steps) const;

  const Scenario& scenario_;
  std::size_t next_ = 0;
  std::int64_t samples_ = 0;
  double error_sum_rad_ = 0;
};

}  // namespace tribotwin::twin
