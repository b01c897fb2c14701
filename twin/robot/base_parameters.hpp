#pragma once

#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/robot/regressor.hpp>

namespace tribotwin::twin {

/// The identifiable combinations of inertial parameters: beta = phi(independent) + groups phi(dependent), so
/// that Y phi = Y(:, independent) beta in every state (Gautier 1991). Columns are chosen from the base
/// outwards: what a link and its successor share belongs to the one nearer to the base, and rotors to links.
struct BaseParameters {
  struct Parameter {
    std::string name;   ///< of its leading parameter, "link2.Izz"
    std::string group;  ///< in full, "link2.Izz + joint2.Ia - 0.35 link3.mx + ..."
    std::string unit;
  };
  std::vector<Parameter> parameters;
  std::vector<Eigen::Index> independent;  ///< columns of the regressor, ascending
  Eigen::MatrixXd from_all;               ///< beta = from_all phi
  Eigen::Index numerical_rank = 0;        ///< of the regressor by column-pivoted QR, for comparison with their number

  Eigen::Index size() const { return static_cast<Eigen::Index>(parameters.size()); }
  /// Whether the leading parameter of the k-th is a rotor inertia.
  bool is_rotor_inertia(Eigen::Index k) const { return parameters[static_cast<std::size_t>(k)].name.ends_with(".Ia"); }
};

/// From the regressor at random states of all joints, the same for the same model.
BaseParameters base_parameters(Regressor regressor);

}  // namespace tribotwin::twin
