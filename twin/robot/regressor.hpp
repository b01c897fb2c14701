#pragma once

#include <iterator>
#include <string>
#include <vector>

#include <Eigen/Dense>
#include <mujoco/mujoco.h>

#include <tribotwin/plugins/friction/error.hpp>

/// Rigid-body dynamics, linear in the parameters to identify: tau = Y(q, qd, qdd) phi.
///
/// phi holds ten numbers per moving body, about the origin of the body's frame and in its axes: the inertia tensor's
/// elements Ixx Ixy Ixz Iyy Iyz Izz [kg m^2], the first moments mx my mz [kg m], the mass m [kg]; then one rotor
/// inertia (armature) per joint, Ia [kg m^2; kg for a slide]. With the acceleration a of the frame's origin less
/// gravity, the angular velocity w and acceleration w' of the body, all in its axes, the force and the torque about the
/// origin are
///
///   f = m a + w' x mc + w x (w x mc),     n = I w' + w x I w + mc x a
///
/// and a joint feels the part along its axis: Newton-Euler over mjModel's tree, exact. Equals mj_inverse without
/// constraints, passive forces and actuators.
///
/// A coupled motor adds a rotor inertia that acts on all joints it turns with: tau = c Ia (c . qdd).
namespace tribotwin::twin {

/// A motor that turns, behind its gear, with a sum of joints, as in wrists and differentials: its speed is
/// turns_with . qd, and its torque acts on joint j turns_with(j) times.
struct CoupledMotor {
  std::string name;
  int joint = -1;              ///< whose motor it is: none turns with that joint alone
  Eigen::VectorXd turns_with;  ///< per joint of the model
  double rotor_inertia = 0;    ///< of the model, behind the gear [kg m^2; kg]
};

class Regressor {
 public:
  /// The parameter that a column multiplies.
  struct Column {
    std::string name;  ///< "link2.Ixx", "joint2.Ia"
    std::string unit;
    int body = -1;   ///< of mjModel; -1 for a rotor
    int rotor = -1;  ///< -1 for a body
  };

  /// `model` must outlive the regressor. Fails where a joint is neither hinge nor slide, or none is, or the motors do
  /// not determine the joints: two of one joint, or sums of joints that depend on each other.
  static Result<Regressor> create(const mjModel* model, std::vector<CoupledMotor> motors = {});

  Eigen::Index joints() const { return model_->nv; }
  const std::vector<CoupledMotor>& motors() const { return motors_; }
  const std::vector<Column>& columns() const { return columns_; }
  const std::string& joint_name(Eigen::Index dof) const { return joint_names_[static_cast<std::size_t>(dof)]; }
  /// Whether a joint is a slide: its quantities are in m and N.
  bool is_slide(Eigen::Index dof) const { return model_->jnt_type[dof] == mjJNT_SLIDE; }
  const mjModel* model() const { return model_; }
  /// Whether a column can have an effect on the torque of a joint.
  bool acts(std::size_t column, Eigen::Index dof) const;

  /// Rotors, each with an inertia and friction: one per joint, which turns with it alone, then the coupled motors'.
  Eigen::Index rotors() const { return joints() + std::ssize(motors_); }
  bool is_coupled(Eigen::Index rotor) const { return rotor >= joints(); }
  /// Of its joint, or of the motor.
  const std::string& rotor_name(Eigen::Index rotor) const;
  Eigen::Index joint_of(Eigen::Index rotor) const;
  /// How often it turns per turn of a joint; its torque acts on the joint as often.
  double turns(Eigen::Index rotor, Eigen::Index joint) const {
    return is_coupled(rotor) ? turns_with(rotor)(joint) : rotor == joint ? 1 : 0;
  }
  /// Speed of a rotor [rad/s; m/s] at velocities of the joints.
  double speed(Eigen::Index rotor, const Eigen::Ref<const Eigen::VectorXd>& qd) const {
    return is_coupled(rotor) ? turns_with(rotor).dot(qd) : qd(rotor);
  }
  /// Torque [Nm; N] that the gear of a rotor transmits, of the joints' rigid torques less what the model's rotors need.
  double load(Eigen::Index rotor, const Eigen::Ref<const Eigen::VectorXd>& rigid,
              const Eigen::Ref<const Eigen::VectorXd>& qdd) const;
  /// Joint torques [Nm; N] of the torques that their motors give, coupled ones, of which there are some, in the place
  /// of their joint's.
  Eigen::MatrixXd joint_torque(const Eigen::MatrixXd& motor_torque) const;

  /// Y, joints x columns, at positions [rad; m], velocities and accelerations of the joints. Uses the object's own
  /// workspace: one object per thread.
  const Eigen::MatrixXd& at(const Eigen::Ref<const Eigen::VectorXd>& q, const Eigen::Ref<const Eigen::VectorXd>& qd,
                            const Eigen::Ref<const Eigen::VectorXd>& qdd);

  /// Y of the last call of `at`.
  const Eigen::MatrixXd& last() const { return Y_; }

  /// The phi of the model.
  Eigen::VectorXd model_parameters() const;

 private:
  struct Frame {
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    Eigen::Vector3d origin = Eigen::Vector3d::Zero(), w = Eigen::Vector3d::Zero(), dw = Eigen::Vector3d::Zero(),
                    a = Eigen::Vector3d::Zero();
    /// Acceleration of the point at `r` from the origin that moves with the frame.
    Eigen::Vector3d acceleration(const Eigen::Vector3d& r) const { return a + dw.cross(r) + w.cross(w.cross(r)); }
  };
  explicit Regressor(const mjModel* model) : model_(model) {}
  const Eigen::VectorXd& turns_with(Eigen::Index rotor) const {
    return motors_[static_cast<std::size_t>(rotor - joints())].turns_with;
  }
  Result<void> couple(std::vector<CoupledMotor> motors);

  const mjModel* model_;
  std::vector<CoupledMotor> motors_;
  Eigen::MatrixXd transmission_;  ///< joints x joints: joint torques of motor torques; empty without coupled motors
  Eigen::MatrixXd loads_;         ///< coupled motors x joints: their torques of joint torques
  Eigen::VectorXd armature_;      ///< of the model, per rotor
  std::vector<Column> columns_;
  std::vector<std::string> joint_names_;
  std::vector<Eigen::Index> first_column_;  ///< per body; -1 where it does not move
  std::vector<std::vector<int>> moved_by_;  ///< joints between a body and the world
  Eigen::Vector3d gravity_;
  std::vector<Frame> frames_;                   ///< per body
  std::vector<Eigen::Vector3d> axis_, anchor_;  ///< per joint, world
  Eigen::MatrixXd Y_;
};

}  // namespace tribotwin::twin
