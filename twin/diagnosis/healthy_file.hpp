#pragma once

#include <filesystem>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/healthy.hpp>

/// healthy.yaml of `tribotwin diagnose learn`.
namespace tribotwin::twin::diagnosis {

std::string to_yaml(const HealthyState& state);
/// A file of to_yaml. ErrorKind::input with file, key and what would be right.
Result<HealthyState> read_healthy(const std::filesystem::path& file);

}  // namespace tribotwin::twin::diagnosis
