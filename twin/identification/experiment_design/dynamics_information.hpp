#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>
#include <tribotwin/twin/robot/excitation.hpp>

namespace tribotwin::twin::identification {

/// The largest speed of a rotor where each joint has its own.
double fastest_of(const Regressor& regressor, Eigen::Index rotor, const Eigen::VectorXd& speed);

/// A parameter of a robot's dynamics, and what its uncertainty is compared with.
struct DesignParameter {
  std::string name;    ///< "link2.Iyy", "joint1.Fc"
  Eigen::Index rotor;  ///< of friction, a joint's or a coupled motor's; -1: a base parameter
  double value,
      scale;  ///< scale > 0: |value| of friction, but what makes a tenth of it where that is about 0 and at least
              ///< that of an offset; of base parameters their size by the model's bodies (inertial_scale)
};

/// What motions tell about base parameters and friction together: the information matrix, sum of w^2 r r' over the rows
/// r of the linearised torque equations (dynamics.hpp), w = 1 / noise of the joint. The torques are filtered with
/// `cutoff_hz`, of which 2 cutoff_hz samples per second are independent. Rows that `dynamics` leaves out with a
/// given law have no information (SlowRows); where it lets rows near reversals count, there is more. Parameters count
/// in units of their scale.
class DynamicsInformation {
 public:
  struct Settings {
    RobotParameters parameters;  ///< about which friction is linearised
    Eigen::VectorXd noise;       ///< per joint [Nm; N], of the filtered torque
    double cutoff_hz = 20;
    Eigen::VectorXd speed;  ///< largest of each joint: below a hundredth of it a joint counts as at rest
  };
  DynamicsInformation(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                      Settings settings);

  const std::vector<DesignParameter>& parameters() const { return parameters_; }
  Eigen::Index size() const { return static_cast<Eigen::Index>(parameters_.size()); }

  /// Of a motion, run once with each of these sets of joint temperatures. Lower triangle.
  Eigen::MatrixXd of(const MotionStates& states, std::span<const Eigen::VectorXd> temperatures_degC) const;
  /// Of a recording.
  Eigen::MatrixXd of(const JointMotion& motion) const;
  /// Of estimates with these sigmas, NaN where a parameter was not estimated: as if they were independent.
  Eigen::MatrixXd of_sigmas(const RobotParameters& sigma) const;
  /// Knowledge so weak that it changes no parameter that a motion tells: sigmas of ten times the scales.
  Eigen::MatrixXd weak() const { return 0.01 * Eigen::MatrixXd::Identity(size(), size()); }

  /// Expected sigmas in units of the scales; infinite above 500.
  Eigen::VectorXd sigmas(const Eigen::MatrixXd& information) const;

 private:
  void add_friction(Eigen::Index rotor);
  /// Whether the row of each joint counts in each state.
  Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic> counting(const MotionStates& states) const;
  /// Derivatives of each rotor's friction [Nm; N] by its parameters, parameters x rotors.
  Eigen::MatrixXd by_friction(const Eigen::VectorXd& qd, const Eigen::VectorXd& qdd,
                              const Eigen::VectorXd& temperature_degC, const Eigen::MatrixXd& Y) const;
  void fill(Eigen::Index joint, double weight, const Eigen::MatrixXd& Y, const Eigen::MatrixXd& by,
            Eigen::Ref<Eigen::RowVectorXd> row) const;

  const Regressor& regressor_;
  const BaseParameters& base_;
  const RobotFriction& friction_;
  Settings settings_;
  std::vector<DesignParameter> parameters_;
  std::vector<std::vector<Eigen::Index>> place_;  ///< per rotor, of its friction parameters; -1: a convention
};

}  // namespace tribotwin::twin::identification
