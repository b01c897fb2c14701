#pragma once

#include <string>

#include <tribotwin/plugins/drive/drive.hpp>

/// Internal to portable/: the winding of a motor in the C file, with words between two @ to be replaced: @NAME@,
/// @T_AMB@, @GEAR@, @OFFSET_NM@, and each key of a winding between two @ for its number. It does what
/// thermal/winding.hpp does, in the same order of operations.
namespace tribotwin::twin {

/// The parts of the file; all empty for a drive without a winding.
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
