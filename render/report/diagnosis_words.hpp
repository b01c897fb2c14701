#pragma once

#include <array>
#include <string>
#include <string_view>

#include <tribotwin/twin/diagnosis/check.hpp>

/// Verdicts in the words of a maintenance engineer: °C, shares of the maximum torque, no statistics.
namespace tribotwin::render {

/// What the features are.
constexpr std::array<std::string_view, twin::diagnosis::feature_count> feature_words{
    "Coulomb friction Fc", "standstill friction Fs", "speed Vs below which friction rises", "viscous friction Fv",
    "exponent beta of viscous friction"};

/// The name of a pattern or a fault, "lubricant loss".
std::string in_words(std::string_view name);

/// Of a pattern: "13 %", "8.3 % of the maximum torque", "0.0012 rad".
std::string severity_text(const twin::diagnosis::Pattern& pattern, double severity);

/// Of a verdict with a cause: "worn contact surfaces, 13 % (confidence > 99 %)".
std::string cause_text(const twin::diagnosis::Verdict& verdict);
/// The same of an anomaly with or without a cause, as a sentence.
std::string cause_sentence(const twin::diagnosis::Verdict& verdict);

/// An anomalous observation, which the sentence calls `name`: how far it is from healthy, its cause and its equivalent
/// load.
std::string plain_sentence(const twin::diagnosis::HealthyState& healthy,
                           const twin::diagnosis::Observation& observation, const twin::diagnosis::Verdict& verdict,
                           const std::string& name);

}  // namespace tribotwin::render
