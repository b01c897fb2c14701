#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/rigid_body/consistency.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/identification/rigid_body/training_range.hpp>

/// PARAMS.yaml of a whole robot: its base parameters and the friction of its joints, with their uncertainties.
namespace tribotwin::twin::identification {

/// What a fit was made from, beside its numbers.
struct DynamicsOrigin {
  std::string model;
  std::vector<std::string> data;
  Preparation signals;                  ///< cut-off and source of speeds; predictions take the same
  std::vector<double> torque_max_nm;    ///< per joint, as for robot_friction; empty: of the model's drives
  std::vector<thermal::Model> thermal;  ///< per joint, or none
  std::vector<std::string> left_out;    ///< per joint, why its torque was left out; "": it was not. Empty: none
  std::vector<Estimate> drive_gains;    ///< per joint, NaN where not identified (drive_constants); empty: none
  std::vector<Estimate> lag;            ///< per joint, of the torques in the recordings [s]; empty: none
  std::vector<JointRange> ranges;       ///< per joint, of the samples of the fit; empty: not kept
  Eigen::VectorXd band;                 ///< per joint, as of band_of; empty: not kept
  Eigen::VectorXd band_independent;     ///< per joint, as of independent_of_band; empty: not kept
  std::optional<ConsistentDynamics> consistent;  ///< none: not kept
};

std::string to_yaml(const DynamicsFit& fit, const BaseParameters& base, const friction::LawInfo& law,
                    const Regressor& regressor, const Consistency& consistency, const DynamicsOrigin& origin);

struct DynamicsFile {
  const friction::LawInfo* law = nullptr;
  Directional directional;        ///< of all joints; what depends on the position is per joint
  std::vector<bool> by_position;  ///< per rotor, whether its friction has a part by position
  RobotParameters parameters;
  RobotParameters sigma;              ///< one standard deviation of each; NaN where it was held
  std::vector<double> noise;          ///< per joint [Nm; N], NaN where it was left out; empty where the file names none
  Preparation signals;                ///< of the fit; lag_s is that of its recordings
  std::vector<double> torque_max_nm;  ///< per joint; empty: of the model's drives
  std::vector<thermal::Model> thermal;  ///< per joint; empty: not known
  std::vector<std::string> left_out;  ///< per joint, why its torque was left out, its friction being 0; "": it was not
  std::vector<Estimate> drive_gains;  ///< per joint, with value, sigma and unit; NaN where unknown. Empty: torques are
                                      ///< as recorded
  std::vector<JointRange> ranges;     ///< per joint; empty: not known, as of files of earlier versions
  std::vector<double> band;  ///< per joint [Nm; N], band_of the least-squares parameters; NaN where it was left
                             ///< out. Empty: not known, as of files of earlier versions
  std::vector<double> band_independent;          ///< per joint, independent_of_band; NaN and empty as `band`
  bool possible = true;                          ///< Consistency::possible
  bool contradicted = false;                     ///< contradicted() of the distance
  double distance_sigma = 0, chance = 1;         ///< Consistency; NaN where the file does not say
  std::optional<ConsistentDynamics> consistent;  ///< without `bodies`; none in files of earlier versions
};

/// A file of to_yaml. ErrorKind::input with file, key and what would be right, also where it describes another robot.
Result<DynamicsFile> read_dynamics(const std::filesystem::path& file, const Regressor& regressor,
                                   const BaseParameters& base);

/// The friction of one joint in a file of to_yaml.
struct FrictionEstimates {
  std::string joint, law;
  double torque_max_nm = 0;         ///< 0: the file does not say, being one of a model with drives
  std::vector<Estimate> estimates;  ///< sigma NaN where not estimated
  Eigen::MatrixXd covariance;       ///< of these; NaN rows where not estimated
  bool correlated = true;  ///< false: a file of an earlier version, without correlations; the covariance is diagonal
};

/// The friction of all joints that a file of to_yaml has, without the model and without coupled motors.
/// ErrorKind::input with file, key and what would be right.
Result<std::vector<FrictionEstimates>> read_friction(const std::filesystem::path& file);

/// The coupled motors of a file of to_yaml, which the regressor needs before the rest can be read; `robot`: the
/// model's, with motors or without. ErrorKind::input with file, key and what would be right.
Result<std::vector<CoupledMotor>> read_coupling(const std::filesystem::path& file, const Regressor& robot);

/// coulomb_viscous or a law of friction::laws(). ErrorKind::input: "WHERE 'NAME': ..." with the names there are.
Result<const friction::LawInfo*> dynamics_law(const std::string& name, const std::string& where,
                                              std::string_view also = {});

}  // namespace tribotwin::twin::identification
