#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace tribotwin::twin {

/// Insertions, deletions, substitutions and swaps of neighbours that lead from one text to the other (restricted
/// Damerau-Levenshtein distance).
std::size_t typing_errors(std::string_view a, std::string_view b);

/// "; did you mean 'drive'?", where a name has at most two typing errors to `given`, and fewer than half its letters;
/// else empty. Of equal ones the first.
std::string did_you_mean(std::string_view given, std::span<const std::string> names);

}  // namespace tribotwin::twin
