#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/patterns.hpp>

/// Whether an observation is that of a healthy joint, and if not, the cause.
namespace tribotwin::twin::diagnosis {

struct RegionVerdict {
  double distance = 0;            ///< squared, Zhou 2024 (15), over all temperatures
  bool beyond_two_sigma = false;  ///< distance > N^2 = 4, as Zhou 2024 judges
  bool beyond_wear = false;       ///< distance > N^2 = 36
  double statistic = 0;           ///< T^2 at this temperature (healthy.hpp)
  double limit = 0;               ///< of T^2, at the false-alarm rate
  double by_chance = 1;           ///< probability that a healthy joint has at least this T^2
  bool anomalous = false;         ///< T^2 > limit
};

struct IndicatorVerdict {
  double value = 0, limit = 0;
  bool anomalous = false;
};

struct EquivalentLoad {
  double load_norm = 0, sigma = 0;  ///< extra load that would change Fc, Fs, Vs in the same way, over torque_max
  double threshold = 0;             ///< load_norm at which Zhou 2024's distance reaches the wear threshold
  std::optional<double> nm, kg;     ///< where torque_max and the lever are known
};

struct Verdict {
  std::array<RegionVerdict, 2> region;
  std::array<std::optional<IndicatorVerdict>, indicator_count>
      indicators;  ///< load_norm has no verdict: a payload is no fault
  EquivalentLoad load;
  const Pattern* cause = nullptr;        ///< null: healthy or unknown
  std::string_view pattern = "healthy";  ///< name of the cause, "healthy" or "unknown"
  double severity = 0;                   ///< in the unit of the cause
  double confidence = 0;                 ///< probability of the verdict, among `healthy` and all causes
  std::vector<Candidate> candidates;     ///< by decreasing probability
  std::string sentence;
  bool anomalous = false;  ///< a region or an indicator is
  /// Anomalous, but a healthy joint, of which some are beyond a limit by chance, is likelier than any cause.
  bool perhaps_healthy = false;
};

struct CheckOptions {
  double false_alarm = two_sigma_false_alarm;  ///< per region and indicator
};

/// A probability [1] as text; none is a certainty: "> 99 %".
std::string probability_text(double p);

/// Two significant digits, whole numbers from 100 on: "0.12", "1.2", "117".
std::string two_digits(double x);
/// An extra load (load_norm) in the most concrete unit that is known: "2.3 kg at the flange".
std::string load_text(const HealthyState& healthy, double load_norm);

/// Of region 0 or 1 (observation.hpp: regions); `false_alarm` in 0 .. 1.
RegionVerdict judge(const HealthyState& healthy, const Observation& o, std::size_t region, double false_alarm);
/// Generalised least squares along the effect of load on Fc, Fs, Vs.
EquivalentLoad equivalent_load(const HealthyState& healthy, const Observation& o);

/// One verdict per observation. ErrorKind::input on observations that this healthy state cannot judge: another joint,
/// another unit, no temperature, features that are not identifiable from the curve. The message says what to record.
Result<std::vector<Verdict>> check(const HealthyState& healthy, const ObservationFile& file,
                                   const CheckOptions& options = {});

}  // namespace tribotwin::twin::diagnosis
