#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/dynamic_friction/bouc_wen.hpp>
#include <tribotwin/twin/identification/dynamic_friction/bristles.hpp>

/// PARAMS.yaml: an identified law with its uncertainty, range and origin.
namespace tribotwin::twin::identification {

struct ParameterFile {
  friction::Law law;         ///< its range is that of the data
  double torque_max_nm = 0;  ///< 0: not known
  double gear_ratio = 0;     ///< 0: not known
  Estimates found;           ///< in the law's order; after them `asymmetry` and `offset` where one of them is not 0
  std::vector<std::string> data;
  std::optional<drive::Bristles> bristles;
  double asymmetry = 0, offset = 0;  ///< of friction by direction (curves/fit.hpp): [-], unit of the law
};

ParameterFile parameter_file(const Fit& fit, std::vector<std::string> data, double torque_max_nm, double gear_ratio);
std::string to_yaml(const ParameterFile& file);
/// `of_law` with section `lugre`: the bristles over this law.
std::string to_yaml(const ParameterFile& of_law, const BristleFit& fit, const std::vector<std::string>& data);
std::string to_yaml(const HysteresisFit& fit, const std::vector<std::string>& data);

/// ErrorKind::work where a PARAMS.yaml of these estimates could not be read: a number is not finite or, with a law, the
/// law refuses its parameters.
Result<void> usable(const Estimates& found, const friction::LawInfo* law = nullptr);

/// A file of to_yaml(ParameterFile). ErrorKind::input with file, key and what would be right.
Result<ParameterFile> read_parameters(const std::filesystem::path& file);

/// The spring of a PARAMS.yaml with `law: bouc_wen`, on the drive instance `drive`. ErrorKind::input where the file is
/// wrong, ErrorKind::work where a model could not load the spring.
Result<transmission::Hysteresis> hysteresis_of(const std::filesystem::path& file, std::string name,
                                               const std::string& drive);

/// A drive with this law, bristles included. ErrorKind::input where torque_max_nm or gear_ratio are not known.
Result<drive::Drive> drive_of(const ParameterFile& file, std::string name);

}  // namespace tribotwin::twin::identification
