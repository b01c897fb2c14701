#pragma once

#include <string>

#include <tribotwin/twin/portable/fmu.hpp>

namespace tribotwin::twin {

/// Internal to portable/robot: the C of the standard's functions around robot_instance.h, for the library.
std::string robot_fmu_functions(FmiVersion version);

}  // namespace tribotwin::twin
