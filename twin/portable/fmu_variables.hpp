#pragma once

#include <cmath>
#include <string>
#include <vector>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/twin/portable/fmu.hpp>

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

/// GUID and instantiation token: of the same content, the same (RFC 4122, version 5).
std::string fmu_token(const std::vector<FmuFile>& files);
/// License and origin; `of`: whose the numbers are.
std::string fmu_license(const std::string& of);

/// A unit in FMI's spelling ("N.m.s/rad", for "Nm s/rad") and its powers of kg, m, s, K, rad, A.
struct FmuUnit {
  std::string name;
  bool known = true;  ///< false: a power of it is a parameter
  int kg = 0, m = 0, s = 0, K = 0, rad = 0, A = 0;
  double offset = 0;  ///< degC
};
FmuUnit fmu_unit(const std::string& unit);

/// What modelDescription.xml says of an FMU beside its variables.
struct FmuAbout {
  std::string name, text;
  bool sources = true, states = true;  ///< with C; with states that are saved
  double stop_s = 1, step_s = 1e-3;    ///< of the default experiment
  double fixed_step_s = 0;             ///< steps are multiples of it; 0: of any length
};

/// modelDescription.xml, the token left open; and, for FMI 3, sources/buildDescription.xml.
std::string fmu_description(const FmuAbout& about, const std::vector<FmuVariable>& variables, int version);
std::string fmu_description(const drive::Drive& drive, const std::string& name, int version);
/// Rows of an HTML table.
std::string fmu_variable_rows(const std::vector<FmuVariable>& variables);
std::string fmu_build_description(const std::string& name);

/// documentation/index.html: variables and limits.
std::string fmu_page(const drive::Drive& drive, const std::string& name);

}  // namespace tribotwin::twin
