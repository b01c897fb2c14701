#pragma once

#include <string>

#include <tribotwin/plugins/friction/law.hpp>

/// Internal to portable/: the part of the C file that follows the table of laws. Terms that are 0 are left out.
namespace tribotwin::twin {

/// A double that reads back as itself, as a literal of C.
std::string c_number(double x);

/// The coefficients of a law at a temperature, and its two parts at a speed and a load, as C: the type
/// NAME_coefficients and the functions NAME_at and NAME_law.
std::string c_law(const friction::Law& law, const std::string& name);

}  // namespace tribotwin::twin
