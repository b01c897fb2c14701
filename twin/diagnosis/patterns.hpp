#pragma once

#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/twin/diagnosis/healthy.hpp>

/// Which cause changes friction the way it has changed: Zhou 2024's Table IV and further faults, as directions in the
/// logarithmic features and the indicators, with one severity s each.
namespace tribotwin::twin::diagnosis {

/// The effect of a cause of severity s on a healthy joint.
struct Footprint {
  Features features = Features::Zero();       ///< change of ln Fc, ln Fs, ln Vs, ln Fv, beta
  double ripple_nm = 0, lost_motion_rad = 0;  ///< added
  double load_factor = 1;                     ///< of load_norm
  bool load_free = false;                     ///< load_norm rises by an unknown amount
};

struct Pattern {
  std::string_view name;              ///< of the fault, where there is one
  std::optional<drive::Fault> fault;  ///< none: a condition that is no fault of the drive
  std::string_view meaning;           ///< for a sentence: "looks like MEANING"
  std::string_view advice;            ///< what to do next
  double minimum, maximum;            ///< of the severity s
  std::string_view unit;              ///< of s; "1": relative
  Footprint (*footprint)(const HealthyState&, double s);
  /// Whether this observation can have the cause; null: any observation.
  bool (*possible)(const HealthyState&, const Observation&) = nullptr;
  bool both_signs = false;  ///< s may be negative, too
};

/// One pattern per fault of drive::faults() and one per other cause, in the order of the documentation. The verdicts
/// `healthy` and `unknown` have no footprint and are not among them.
std::span<const Pattern> patterns();

struct Candidate {
  const Pattern* pattern = nullptr;  ///< null: healthy
  double severity = 0;               ///< of maximum likelihood
  double probability = 0;
  double misfit = 0;  ///< T^2 of the features at that severity
};

/// Healthy and all possible patterns, by decreasing probability. Probabilities: the likelihood of features and
/// indicators under the learned scatter (Student's t, as mean and covariance are estimates), averaged over severities
/// with a uniform prior on a logarithmic scale. Prior of healthy: `prior_healthy`; the patterns share the rest equally.
std::vector<Candidate> candidates(const HealthyState& healthy, const Observation& o, double prior_healthy);

}  // namespace tribotwin::twin::diagnosis
