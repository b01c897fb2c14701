#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include <tribotwin/twin/identification/drive_gains/drive_gains.hpp>
#include <tribotwin/twin/identification/drive_gains/efficiency.hpp>

/// Drive gains as commands print and keep them.
namespace tribotwin::twin::identification {

/// What the recorded torque of a joint was before its gain was identified.
struct AssumedGain {
  bool of_current = false;         ///< a current; else a torque
  std::optional<double> nm_per_a;  ///< that was said [Nm/A; N/A]; none: the current was taken at 1
  bool slide = false;
};

/// Per joint, torque at the arm per ampere [Nm/A; N/A] (torque constant x gear ratio), or of torque columns the factor
/// that corrects them [1]; NaN without a sigma where it is not identifiable.
std::vector<Estimate> drive_constants(const DriveGains& gains, std::span<const AssumedGain> assumed);

/// A row per joint, what is not identifiable, and under which condition sigmas hold: `payloads` as the user gave them.
std::string table_of(const DriveGains& gains, std::span<const AssumedGain> assumed,
                     std::span<const KnownPayload> payloads);
/// {JOINT: {value, sigma, low, high, unit, of_assumed}}; value null where it is not identifiable, with `reason` and
/// `record_next`.
nlohmann::ordered_json json_of(const DriveGains& gains, std::span<const AssumedGain> assumed);

/// Where all gains are off by the same factor: a wrong mass of the payload would do that too.
std::vector<std::string> doubtful_mass(const DriveGains& gains, std::span<const AssumedGain> assumed);

/// Empty without any.
std::string table_of(std::span<const Efficiency> efficiencies);
/// {JOINT: {per_load: {value, sigma}, driving: ..., backdriven: ...}}.
nlohmann::ordered_json json_of(std::span<const Efficiency> efficiencies);

}  // namespace tribotwin::twin::identification
