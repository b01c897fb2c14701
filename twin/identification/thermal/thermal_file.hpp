#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>
#include <tribotwin/twin/io/input.hpp>

/// PARAMS.yaml of `tribotwin thermal`: the thermal model of every joint that was recorded.
namespace tribotwin::twin::identification {

using NamedThermalFit = std::pair<std::string, ThermalFit>;  ///< joint, its fit

std::string to_yaml(const std::vector<NamedThermalFit>& joints, const std::vector<std::string>& data);

/// The keys of a model: thermal, T_amb and the parameters of its order.
void write(YAML::Emitter& out, const thermal::Model& model);

/// A model from such keys. Throws InputError; `beside` are other keys that may be there.
thermal::Model read_model(Mapping& in, std::vector<std::string_view> beside = {});

/// Joint, its model. Throws InputError with file, key and what would be right.
std::vector<std::pair<std::string, thermal::Model>> read_thermal(const std::filesystem::path& file);

}  // namespace tribotwin::twin::identification
