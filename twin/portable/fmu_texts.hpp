#pragma once

/// Internal to portable/: the C of an FMU around its joint or robot, with words between two @ to be replaced. A
/// version's source is its `types`, the modes, the head of what is simulated, the calls, what is simulated, the
/// functions of both versions, its own; the declarations follow the standard's lists of functions.
namespace tribotwin::twin {

extern const char* const fmu_modes;
extern const char* const fmu_calls;
extern const char* const fmu_joint_head;
extern const char* const fmu_joint;
extern const char* const fmi_functions;
extern const char* const fmi2_types;
extern const char* const fmi2_functions;
extern const char* const fmi3_types;
extern const char* const fmi3_functions;

}  // namespace tribotwin::twin
