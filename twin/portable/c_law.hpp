#pragma once

#include <string>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/portable/c_source.hpp>

/// Internal to portable/: the part of the C file that follows the table of laws. Terms that are 0 are left out.
namespace tribotwin::twin {

/// A double that reads back as itself, as a literal of C.
std::string c_number(double x);

/// A text in capital letters, and one with words replaced, one after the other.
std::string c_upper(std::string text);
std::string filled(std::string text, const std::vector<std::pair<std::string, std::string>>& words);

/// The coefficients of a law at a temperature, and its two parts at a speed and a load, as C: the type
/// NAME_coefficients and the functions NAME_at and NAME_law.
std::string c_law(const friction::Law& law, const std::string& name, JointNumbers numbers);

/// Of JointNumbers::members: the members of NAME_numbers that hold the general law, and the lines of NAME_changed that
/// set them from the law's parameters.
std::string c_law_members();
std::string c_law_changed(const friction::LawInfo& law);

}  // namespace tribotwin::twin
