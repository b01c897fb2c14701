#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/mujoco/loader.hpp>

/// The friction law of a joint as identified, drawn from its estimates and their covariance.
namespace tribotwin::twin::sweep {

/// Draws are normal with the correlations of the file. The standard deviation of a parameter is that of the file, or,
/// where it has a 95 % interval, half of it / 1.96: the interval of few samples is wider. A draw beyond the accepted
/// range of a parameter is set to its end.
struct ParameterSet {
  std::string joint;
  std::vector<std::pair<std::string, std::string>> fixed;  ///< settings that all runs share: key, value
  std::vector<std::string> keys;                           ///< of the drawn parameters, as drives.joint2.Fc0
  Eigen::VectorXd mean, deviation, low, high;              ///< of these
  Eigen::MatrixXd root;                                    ///< lower triangular, root root^T = correlation
  std::vector<std::string> notes;

  std::size_t size() const { return keys.size(); }
  /// Values at a point of (0, 1)^size().
  Eigen::VectorXd draw(std::span<const double> u) const;
  /// Whether the value of a parameter is an end of its accepted range, which the draw has exceeded.
  bool at_limit(std::size_t parameter, double value) const;
};

/// From PARAMS.yaml of `tribotwin identify`, for one joint of the model. ErrorKind::input with file and what would be
/// right.
Result<ParameterSet> law_parameters(const std::filesystem::path& file, const mujoco::Model& model,
                                    const std::string& joint);

/// From PARAMS.yaml of `tribotwin dynamics`, for every joint in it; joints do not correlate with each other.
Result<std::vector<ParameterSet>> robot_parameters(const std::filesystem::path& file, const mujoco::Model& model);

/// Whether a file is one of `tribotwin dynamics`. Throws InputError where it is no YAML.
bool is_of_dynamics(const std::filesystem::path& file);

}  // namespace tribotwin::twin::sweep
