#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>

/// PARAMS.yaml of `tribotwin thermal`: the thermal model of every joint that was recorded.
namespace tribotwin::twin::identification {

using NamedThermalFit = std::pair<std::string, ThermalFit>;  ///< joint, its fit
struct NamedThermalModel {
  std::string joint;
  thermal::Model model;
  std::optional<ThermalUncertainty> uncertainty = {};  ///< none of files of earlier versions, and from torque
};

std::string to_yaml(const std::vector<NamedThermalFit>& joints, const std::vector<std::string>& data);

/// A file of to_yaml. ErrorKind::input with file, key and what would be right.
Result<std::vector<NamedThermalModel>> read_thermal(const std::filesystem::path& file);

}  // namespace tribotwin::twin::identification
