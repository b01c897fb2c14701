#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/hil/drives/drive_parameters.hpp>
#include <tribotwin/hil/shadow/listener.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// Drives of other makers: where their files say that positions and torques are.
namespace tribotwin::hil {

/// What a user says of them, as on the command line.
struct ForeignDrives {
  std::vector<std::string> maps;     ///< "FILE" for all joints or "JOINT=FILE": DBC, EDS or DCF, by the file's name
  std::vector<std::string> signals;  ///< of DBC files: signal_syntax
  std::optional<double> increments;  ///< of 6064h per motor turn, for an EDS without 608Fh
  std::function<void(const std::string&)> note;  ///< called with what of a file is left out
  bool mean_torque = false;                      ///< torques are means since the SYNC or the frame before

  /// The files of `maps`.
  std::vector<std::filesystem::path> files() const;
};

inline constexpr const char* signal_syntax =
    "[JOINT.]QUANTITY=MESSAGE.SIGNAL: position, torque, statusword or enabled. {joint}, {node} and {number} stand for "
    "the "
    "joint's. *X and /X behind it, X a number or 'gear', scale to rad or Nm of the joint. enabled=MESSAGE.SIGNAL==1,2 "
    "names its values, enabled=always is a drive without a state";

/// One listener per drive; null: a drive of the chosen profile. Fails with file and line, or with the option, where
/// something is wrong, missing or named twice.
Result<std::vector<std::unique_ptr<Listener>>> foreign_listeners(const ForeignDrives& foreign,
                                                                 std::span<const DriveParameters> drives);

}  // namespace tribotwin::hil
