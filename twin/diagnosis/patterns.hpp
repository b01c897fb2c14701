#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/twin/diagnosis/healthy.hpp>

/// Which cause moves friction the way it has moved: paper 2's Table IV and further faults, as directions in the
/// logarithmic features and the indicators, one severity s each.
namespace tribotwin::twin::diagnosis {

/// What a cause of severity s does to a healthy joint.
struct Footprint {
  Features features = Features::Zero();       ///< change of ln Fc, ln Fs, ln Vs, ln Fv, beta
  double ripple_nm = 0, lost_motion_rad = 0;  ///< added
  double load_factor = 1;                     ///< of load_norm
  bool load_free = false;                     ///< load_norm rises, by how much is not foretold
};

struct Pattern {
  std::string_view name;
  std::string_view meaning;  ///< for a sentence: "looks like MEANING"
  std::string_view advice;   ///< what to do next
  double least, most;        ///< of the severity s
  std::string_view unit;     ///< of s; "1": relative
  Footprint (*footprint)(const HealthyState&, double s);
};

/// In the order of the table in twin/README.md; `healthy` and `unknown` are no footprints and not among them.
std::span<const Pattern> patterns();

struct Candidate {
  const Pattern* pattern = nullptr;  ///< null: healthy
  double severity = 0;               ///< the likeliest
  double probability = 0;
  double misfit = 0;  ///< T^2 of the features at that severity
};

/// Healthy and all patterns, likeliest first. Probabilities: the likelihood of features and indicators under the
/// learned scatter (Student's, as covariance and mean are estimates), averaged over severities that are all as likely
/// on a logarithmic scale; `prior_healthy` beforehand, the patterns alike.
std::vector<Candidate> candidates(const HealthyState& healthy, const Observation& o, double prior_healthy);

}  // namespace tribotwin::twin::diagnosis
