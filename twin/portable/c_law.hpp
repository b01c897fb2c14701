#pragma once

#include <string>
#include <utility>
#include <vector>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/portable/c_source.hpp>

/// Internal to portable/: the parts of the C file that follow the table of laws and the winding. Terms that are 0 are
/// left out.
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

/// The winding of a motor in the C file: what thermal/winding.hpp does, in the same order of operations. Words in
/// capital letters between two at signs are to be replaced (NAME, T_AMB, GEAR, OFFSET_NM), and each key of a winding by
/// its number. All parts are empty for a drive without a winding.
struct CWinding {
  std::string head;          ///< of the comment at its beginning
  std::string state;         ///< members of NAME_state
  std::string declarations;  ///< of functions
  std::string functions;
  std::string limit;  ///< lines of NAME_step that give the current limit of the step
  std::string step;   ///< lines of it that advance the winding and add to `power` what flows to the gear
};
CWinding c_winding(const drive::Drive& drive);

}  // namespace tribotwin::twin
