#pragma once

#include <cmath>
#include <filesystem>
#include <string>

#include <fmt/format.h>

/// Numbers and names as pages say them.
namespace tribotwin::render {

/// "4.2 %" of 0.042, "31 %" of 0.31, "less than 0.1 %" of less; a dash where there is no number.
inline std::string percent(double share) {
  if (std::isnan(share)) return "–";
  return share < 1e-3 ? "less than 0.1 %" : fmt::format("{:.{}f} %", 100 * share, share < 0.1 ? 1 : 0);
}

/// "slow" of "runs/slow/", "robot.yaml" of "laws/robot.yaml".
inline std::string without_folder(const std::filesystem::path& file) {
  return (file.has_filename() ? file : file.parent_path()).filename().string();
}

}  // namespace tribotwin::render
