#pragma once

#include <cmath>
#include <string>
#include <vector>

#include <tribotwin/plugins/drive/drive.hpp>

/// Internal to portable/: the variables of an FMU, by their value references.
namespace tribotwin::twin {

enum class FmuKind { independent, input, tunable, fixed, output, local };

struct FmuVariable {
  std::string name, unit, meaning;  ///< unit as in our tables; empty: the one Boolean, which comes last
  FmuKind kind;
  double start = 0;                                ///< of inputs and parameters
  double minimum = -HUGE_VAL, maximum = HUGE_VAL;  ///< of parameters
  std::string member;                              ///< of fmu_state in the C
};

std::vector<FmuVariable> fmu_variables(const drive::Drive& drive);

/// Whether the FMU has a temperature of its own; without, it is an input.
bool has_heat(const drive::Drive& drive);

/// A unit in FMI's spelling ("N.m.s/rad", for "Nm s/rad") and its powers of kg, m, s, K, rad.
struct FmuUnit {
  std::string name;
  bool known = true;  ///< false: a power of it is a parameter
  int kg = 0, m = 0, s = 0, K = 0, rad = 0;
  double offset = 0;  ///< degC
};
FmuUnit fmu_unit(const std::string& unit);

/// modelDescription.xml, the token left open; and, for FMI 3, sources/buildDescription.xml.
std::string fmu_description(const drive::Drive& drive, const std::string& name, int version);
std::string fmu_build_description(const std::string& name);

/// documentation/index.html: variables and limits.
std::string fmu_page(const drive::Drive& drive, const std::string& name);

}  // namespace tribotwin::twin
