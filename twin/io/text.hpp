#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>

/// All text files are opened here, but no folders and devices. `kind` completes "FILE: is a folder, not a YAML file".
namespace tribotwin::twin {

Result<std::ifstream> open_text(const std::filesystem::path& file, std::string_view kind);

/// The whole content in UTF-8 (to_utf8), at most limits::text_bytes. Fails with file and line.
Result<std::string> read_text(const std::filesystem::path& file, std::string_view kind);

/// Without blanks, tabs and carriage returns at both ends.
std::string_view trimmed(std::string_view text);
/// For messages and ASCII formats: every byte but printable ASCII becomes '?'.
std::string printable(std::string_view text);

/// "a, b, c"; numbers with the digits that identify them. Functions because fmt::join instantiates fmt's formatters, 1
/// s of compilation in every source.
std::string joined(std::span<const std::string> texts, std::string_view separator = ", ");
std::string joined(std::span<const std::string_view> texts, std::string_view separator = ", ");
std::string joined(std::span<const double> numbers, std::string_view separator = ", ");

/// Seconds since 1970-01-01 of 2026-11-23, 2026-11-23T08:17 or 2026-11-23 08:17:21 (UTC, also with Z); and back, with
/// the time of the day where it is not midnight.
std::optional<std::int64_t> to_time(std::string_view text);
std::string date_of(std::int64_t time_s);

/// Why `name` cannot name a new file or folder; nothing where it can. A name is one component of a path, of 1 to 200
/// bytes, neither "." nor "..", without control characters. Every name that a user's file gives to a file is checked
/// here.
std::optional<std::string> unfit_file_name(std::string_view name);

/// "; did you mean 'drive'?", where a name has at most two typing errors to `given`, and fewer than half its letters;
/// else empty. Of equal ones the first.
std::string did_you_mean(std::string_view given, std::span<const std::string> names);

}  // namespace tribotwin::twin
