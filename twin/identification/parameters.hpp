#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/twin/identification/fit.hpp>

/// PARAMS.yaml: an identified law with its uncertainty, range and origin.
namespace tribotwin::twin::identification {

struct ParameterFile {
  friction::Law law;                    ///< its range is that of the data
  double torque_max_nm = 0;             ///< 0: not known
  double gear_ratio = 0;                ///< 0: not known
  std::vector<Estimate> estimates;      ///< in the law's order
  Eigen::MatrixXd correlation;          ///< NaN where not estimated
  double residual_mean = 0, residual_std = 0, residual_max_abs = 0, condition_number = 0, r_squared = 0;
  std::size_t samples = 0;
  std::vector<std::string> data, unidentifiable, notes;
};

ParameterFile parameter_file(const Fit& fit, std::vector<std::string> data, double torque_max_nm, double gear_ratio);
std::string to_yaml(const ParameterFile& file);

/// Throws InputError with file, key and what would be right.
ParameterFile read_parameters(const std::filesystem::path& file);

/// A drive with this law. Fails where torque_max_nm or gear_ratio are not known.
tl::expected<drive::Drive, std::string> drive_of(const ParameterFile& file, std::string name);

}  // namespace tribotwin::twin::identification
