#pragma once

/// Internal to portable/: the C of an FMU around its joint, with words between two @ to be replaced. A version's source
/// is its `types`, the core, the functions of both, its own; the declarations follow the standard's lists of functions.
namespace tribotwin::twin {

extern const char* const fmu_core;
extern const char* const fmi_functions;
extern const char* const fmi2_types;
extern const char* const fmi2_functions;
extern const char* const fmi3_types;
extern const char* const fmi3_functions;

}  // namespace tribotwin::twin
