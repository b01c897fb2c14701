#pragma once

#include <string>
#include <string_view>

#include <tribotwin/plugins/mujoco/loader.hpp>

/// Drives whose parameters nobody measured: `add-drives` takes them from a table of gear classes and says so in the
/// model.
namespace tribotwin::twin {

/// Name of the <custom><text> with which a model says that the parameters of the drive on a joint are starting points
/// that nobody measured on the robot; its data say where they come from.
std::string starting_point_name(std::string_view joint);
/// Where the starting points of a drive come from, "harmonic_130, scaled by 1.15 from 130 Nm"; empty for a drive whose
/// parameters are no starting points. Valid as long as the model.
std::string_view starting_point(const mujoco::Model& model, const mujoco::Binding& drive);

}  // namespace tribotwin::twin
