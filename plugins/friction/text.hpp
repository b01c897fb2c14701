#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>

/// Text that users write: its encoding, and names with typing errors.
namespace tribotwin {

/// The text as UTF-8. Lines that are not are taken as Windows-1252, which contains ISO 8859-1 (Latin-1): what programs
/// on Windows write. Either way numbers and ASCII stay as they are. A byte order mark is left out. Fails with "LINE:
/// byte 0x.. at N ..." where the text is neither, and where it is UTF-16. `line` is the number of the first line.
/// Source: Encoding Standard (WHATWG), windows-1252.
Result<std::string> to_utf8(std::string text, std::size_t line = 1);

/// Insertions, deletions, substitutions and swaps of neighbours that lead from one text to the other (restricted
/// Damerau-Levenshtein distance).
std::size_t typing_errors(std::string_view a, std::string_view b);

/// The accepted name nearest to a mistyped one, for messages; of equally near ones the first.
std::string_view nearest(std::string_view wrong, std::span<const std::string_view> accepted);

}  // namespace tribotwin
