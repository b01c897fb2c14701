#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

/// The channels of telemetry.h5. Each is one row of a table in channels.cc: name, unit, description and getter;
/// readers, CSV export and reports take names and units from the file.
namespace tribotwin::twin {

/// Per drive, per sample. A model with transmissions has more of them.
std::vector<Channel> channels(const mujoco::Model& model);

/// The units of channels(model) of one of its drives: those of a slide are m, m/s and N.
std::vector<std::string> units(const mujoco::Model& model, const mujoco::Binding& drive);

/// All channels of all drives at the last step, drive by drive, into `row`. NaN where a drive has no transmission.
void read_channels(const Twin& twin, std::span<double> row);

/// A drive over one work cycle.
struct CycleSample {
  double temperature_degC;  ///< at the end
  double friction_power_w;  ///< mean
};

/// Per drive, per work cycle.
std::vector<Channel> cycle_channels();

/// Appends the values of the cycle channels to `row`.
void add_channels(const CycleSample& sample, std::vector<double>& row);

}  // namespace tribotwin::twin
