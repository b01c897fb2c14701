#pragma once

#include <string>

#include <Eigen/Dense>

#include <tribotwin/twin/io/input.hpp>

/// Internal, not installed: matrices in the YAML files of identification and diagnosis.
namespace tribotwin::twin::identification {

/// The list of `rows` lists of `columns` finite numbers at `key`. Throws InputError.
Eigen::MatrixXd read_matrix(Mapping& in, const std::string& key, Eigen::Index rows, Eigen::Index columns);

/// A flow sequence of flow sequences, one row each, which reads back as the same numbers.
std::string yaml_of(const Eigen::MatrixXd& matrix);

}  // namespace tribotwin::twin::identification
