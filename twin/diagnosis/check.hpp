#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/patterns.hpp>

/// Is this observation that of a healthy joint, and if not, what is it?
namespace tribotwin::twin::diagnosis {

struct RegionVerdict {
  double distance = 0;            ///< squared, paper 2 (15), over all temperatures
  bool beyond_two_sigma = false;  ///< distance > N^2 = 4, as paper 2 judges
  bool beyond_wear = false;       ///< distance > N^2 = 36
  double statistic = 0;           ///< T^2 at this temperature (healthy.hpp)
  double limit = 0;               ///< of T^2, at the false-alarm rate
  double by_chance = 1;           ///< probability that a healthy joint has this T^2 or more
  bool anomalous = false;         ///< T^2 > limit
};

struct IndicatorVerdict {
  double value = 0, limit = 0;
  bool anomalous = false;
};

struct EquivalentLoad {
  double load_norm = 0, sigma = 0;  ///< extra load that would change Fc, Fs, Vs alike, over torque_max
  double threshold = 0;             ///< at which paper 2's distance reaches the wear threshold
  std::optional<double> nm, kg;     ///< where torque_max, the lever are known
};

struct Verdict {
  std::array<RegionVerdict, 2> region;
  std::array<std::optional<IndicatorVerdict>, indicator_count>
      indicators;  ///< load_norm is none: a payload is no fault
  EquivalentLoad load;
  std::string_view pattern = "healthy";
  double severity = 0;
  double confidence = 0;              ///< probability of the pattern, among all; of an anomaly among the causes
  std::vector<Candidate> candidates;  ///< likeliest first; empty where `unknown`
  std::string sentence;
  bool anomalous = false;  ///< either region, or an indicator
};

struct CheckOptions {
  double false_alarm = two_sigma_false_alarm;  ///< per region and indicator
};

RegionVerdict judge(const HealthyState& healthy, const Observation& o, std::size_t region, double false_alarm);
/// By generalised least squares along the effect of load on Fc, Fs, Vs.
EquivalentLoad equivalent_load(const HealthyState& healthy, const Observation& o);

/// Fails on observations that this healthy state cannot judge: another joint, another unit, no temperature, features
/// that the curve does not tell. The sentence says what to record.
Result<std::vector<Verdict>> check(const HealthyState& healthy, const ObservationFile& file,
                                   const CheckOptions& options = {});

}  // namespace tribotwin::twin::diagnosis
