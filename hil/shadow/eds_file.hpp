#pragma once

#include <filesystem>
#include <optional>

#include <tribotwin/hil/drives/drive_parameters.hpp>
#include <tribotwin/hil/shadow/listener.hpp>
#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::hil {

/// A drive of another maker as its EDS or DCF describes it (CiA 306): the TPDOs (1800h.., 1A00h..) with $NODEID; the
/// size of 6064h from 608Fh, of 6077h from 6076h. A ParameterValue (DCF) counts before a DefaultValue, a NodeID of
/// [DeviceComissioning] before `parameters.node`. What the file does not have comes from `parameters`: gear ratio and
/// rated torque.
///
/// `increments`: of 6064h per motor turn; none: those of 608Fh. Fails with file and line where a number is none, a
/// mapping does not fit, 6091h contradicts the robot's gear, or with neither 608Fh nor `increments`.
Result<CanopenDrive> read_eds(const std::filesystem::path& file, const DriveParameters& parameters,
                              std::optional<double> increments);

}  // namespace tribotwin::hil
