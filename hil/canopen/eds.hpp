#pragma once

#include <string>

#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/drives/drive_parameters.hpp>

namespace tribotwin::hil {

/// Electronic data sheet of one drive (CiA 306), from its dictionary as it is now.
std::string eds(const Dictionary& dictionary, const DriveParameters& parameters);

}  // namespace tribotwin::hil
