#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/experiment_design/dynamics_information.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>

/// The next experiment on a robot: the motion that tells most about its base parameters and the friction of its joints
/// beside what is known already, D-optimal (Swevers 1997; Atkinson 2007).
namespace tribotwin::twin::identification {

struct DesignInput {
  const friction::LawInfo* law = nullptr;
  std::vector<std::optional<double>> noise;  ///< per joint, of the filtered torque [Nm; N]; empty: none is given
  const DynamicsFile* known = nullptr;       ///< estimates from earlier recordings
  const JointMotion* recorded = nullptr;     ///< earlier recordings
};

/// How to record a law that depends on temperature: the motion cold, then over and over, then once more, warm.
struct WarmUp {
  double duration_s = 0;      ///< of the repetitions; 0: the motion does not heat, or nobody knows by how much
  Eigen::VectorXd cold_degC;  ///< per joint
  Eigen::VectorXd warm_degC;
  std::string lacking;  ///< why no duration is known; empty: it is
};

struct ExperimentDesign {
  Excitation motion;
  RobotFriction friction = {};  ///< the law in the units of each joint
  std::vector<DesignParameter> parameters = {};
  Eigen::VectorXd before = {},
                  after = {};  ///< expected sigmas in units of the parameters' scales; infinite: not identifiable
  Eigen::VectorXd noise = {};  ///< that was assumed, per joint [Nm; N]
  std::string noise_source = {};
  double cutoff_hz = 0;
  std::optional<WarmUp> warm_up = {};  ///< of laws that depend on temperature
  /// Of laws that depend on load, per rotor: the lowest and highest load of the motion, gear torque over torque_max.
  std::vector<std::pair<double, double>> loads = {};
  std::vector<std::string> notes = {};

  /// Whether the 95 % interval, 3.92 sigma, is narrower than the parameter's scale.
  static bool is_told(double sigma) { return 3.92 * sigma < 1; }
};

/// Searches as excite() does. The expected sigmas are those of the noise alone: errors of a model that does not fit add
/// to them. Fails as excite() and robot_friction() do.
Result<ExperimentDesign> design_experiment(const mujoco::Model& model, const Regressor& regressor,
                                           const BaseParameters& base, const DesignInput& input,
                                           ExcitationOptions options);

}  // namespace tribotwin::twin::identification
