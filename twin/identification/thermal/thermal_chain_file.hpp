#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain.hpp>

/// PARAMS.yaml of `tribotwin thermal --chain`.
namespace tribotwin::twin::identification {

std::string to_yaml(const ThermalChainFit& fit, const std::vector<std::string>& data);

struct KnownThermalChain {
  ThermalChain chain;
  std::optional<ThermalUncertainty> uncertainty = {};  ///< none of files of earlier versions
};
/// A file of to_yaml. ErrorKind::input with file, key and what would be right.
Result<KnownThermalChain> read_thermal_chain(const std::filesystem::path& file);

}  // namespace tribotwin::twin::identification
