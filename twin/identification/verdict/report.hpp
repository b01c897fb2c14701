#pragma once

#include <span>
#include <string>

#include <nlohmann/json.hpp>

#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/identification/verdict/joint_verdict.hpp>

/// Verdicts as commands print them.
namespace tribotwin::twin::identification {

/// [{parameter, withheld, reason, record_next}].
nlohmann::ordered_json json_of(std::span<const Lacking> lacking);

/// {badly_explained, relative_error, of_variation, dependence: {speed: {share, chance, growth, bins}, ...}, octaves,
/// half_below_hz, white_half_hz}; relative_error null where the joint rests.
nlohmann::ordered_json json_of(const JointVerdict& verdict);

/// A row per joint: what is unexplained, and which share of that goes with speed, load, position, time (and
/// temperature); a dash where noise would do as much.
std::string table_of(std::span<const JointVerdict> verdicts);

}  // namespace tribotwin::twin::identification
