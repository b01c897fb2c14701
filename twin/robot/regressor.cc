#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/twin/robot/regressor.hpp>

namespace tribotwin::twin {
namespace {

using Eigen::Index, Eigen::Matrix3d, Eigen::MatrixXd, Eigen::Vector3d, Eigen::VectorXd;

constexpr Index per_body = 10;
constexpr struct {
  const char *name, *unit;
} body_parameters[per_body] = {{"Ixx", "kg m^2"}, {"Ixy", "kg m^2"}, {"Ixz", "kg m^2"}, {"Iyy", "kg m^2"},
                               {"Iyz", "kg m^2"}, {"Izz", "kg m^2"}, {"mx", "kg m"},    {"my", "kg m"},
                               {"mz", "kg m"},    {"m", "kg"}};
constexpr int tensor[6][2] = {{0, 0}, {0, 1}, {0, 2}, {1, 1}, {1, 2}, {2, 2}};

Vector3d vector(const mjtNum* v) { return {v[0], v[1], v[2]}; }
Matrix3d rotation(const mjtNum* q) { return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix(); }
Matrix3d cross_matrix(const Vector3d& v) {
  Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}
/// tensor -> product with v, as a matrix on the six elements.
Eigen::Matrix<double, 3, 6> product(const Vector3d& v) {
  Eigen::Matrix<double, 3, 6> m;
  m << v.x(), v.y(), v.z(), 0, 0, 0, 0, v.x(), 0, v.y(), v.z(), 0, 0, 0, v.x(), 0, v.y(), v.z();
  return m;
}

std::string name_of(const mjModel* m, int type, int id, const char* kind) {
  const char* name = mj_id2name(m, type, id);
  return name ? name : fmt::format("{}_{}", kind, id);
}

}  // namespace

Result<Regressor> Regressor::create(const mjModel* m, std::vector<CoupledMotor> motors) {
  for (int j = 0; j < m->njnt; ++j)
    if (m->jnt_type[j] != mjJNT_HINGE && m->jnt_type[j] != mjJNT_SLIDE)
      return tl::unexpected(
          fmt::format("joint '{}' is a {} joint; the dynamics of trees of hinges and slides can be identified",
                      name_of(m, mjOBJ_JOINT, j, "joint"), m->jnt_type[j] == mjJNT_FREE ? "free" : "ball"));
  if (m->njnt == 0) return tl::unexpected(std::string("the model has no joint"));
  Regressor r(m);
  r.gravity_ = m->opt.disableflags & mjDSBL_GRAVITY ? Vector3d::Zero() : vector(m->opt.gravity);
  r.first_column_.assign(static_cast<std::size_t>(m->nbody), -1);
  r.moved_by_.resize(static_cast<std::size_t>(m->nbody));
  for (int b = 1; b < m->nbody; ++b) {
    auto& joints = r.moved_by_[static_cast<std::size_t>(b)];
    joints = r.moved_by_[static_cast<std::size_t>(m->body_parentid[b])];
    for (int j = 0; j < m->body_jntnum[b]; ++j) joints.push_back(m->body_jntadr[b] + j);
    if (joints.empty()) continue;
    r.first_column_[static_cast<std::size_t>(b)] = static_cast<Index>(r.columns_.size());
    for (const auto& p : body_parameters)
      r.columns_.push_back({.name = name_of(m, mjOBJ_BODY, b, "body") + "." + p.name, .unit = p.unit, .body = b});
  }
  for (int j = 0; j < m->njnt; ++j) {
    r.joint_names_.push_back(name_of(m, mjOBJ_JOINT, j, "joint"));
    r.columns_.push_back(
        {.name = r.joint_names_.back() + ".Ia", .unit = m->jnt_type[j] == mjJNT_SLIDE ? "kg" : "kg m^2", .rotor = j});
  }
  if (auto ok = r.couple(std::move(motors)); !ok) return tl::unexpected(ok.error());
  r.frames_.resize(static_cast<std::size_t>(m->nbody));
  r.axis_.resize(static_cast<std::size_t>(m->njnt));
  r.anchor_.resize(static_cast<std::size_t>(m->njnt));
  r.Y_.setZero(m->nv, static_cast<Index>(r.columns_.size()));
  return r;
}

/// Takes the motors, whose joints' places in the transmission they have.
Result<void> Regressor::couple(std::vector<CoupledMotor> motors) {
  const Index n = joints(), count = static_cast<Index>(motors.size());
  armature_.resize(n + count);
  for (Index j = 0; j < n; ++j) armature_(j) = model_->dof_armature[j];
  if (motors.empty()) return {};
  MatrixXd speeds = MatrixXd::Identity(n, n);
  for (Index k = 0; k < count; ++k) {
    const CoupledMotor& motor = motors[static_cast<std::size_t>(k)];
    for (Index other = 0; other < k; ++other)
      if (motors[static_cast<std::size_t>(other)].joint == motor.joint)
        return tl::unexpected(fmt::format("joint '{}' has two coupled motors; each joint has one",
                                          joint_names_[static_cast<std::size_t>(motor.joint)]));
    speeds.row(motor.joint) = motor.turns_with.transpose();
    armature_(n + k) = motor.rotor_inertia;
    columns_.push_back({.name = motor.name + ".Ia",
                        .unit = is_slide(motor.joint) ? "kg" : "kg m^2",
                        .rotor = static_cast<int>(n + k)});
  }
  const Eigen::FullPivLU<MatrixXd> lu(speeds.transpose());
  if (!lu.isInvertible())
    return tl::unexpected(
        std::string("the motors do not determine the joints: what one of them turns with follows from the others"));
  transmission_ = speeds.transpose();
  const MatrixXd motor_torques = lu.inverse();
  loads_.resize(count, n);
  for (Index k = 0; k < count; ++k) loads_.row(k) = motor_torques.row(motors[static_cast<std::size_t>(k)].joint);
  motors_ = std::move(motors);
  return {};
}

const std::string& Regressor::rotor_name(Index rotor) const {
  return is_coupled(rotor) ? motors_[static_cast<std::size_t>(rotor - joints())].name : joint_name(rotor);
}

Index Regressor::joint_of(Index rotor) const {
  return is_coupled(rotor) ? motors_[static_cast<std::size_t>(rotor - joints())].joint : rotor;
}

double Regressor::load(Index rotor, const Eigen::Ref<const VectorXd>& rigid,
                       const Eigen::Ref<const VectorXd>& qdd) const {
  const auto of_joint = [&](Index j) {
    double torque = rigid(j) - armature_(j) * qdd(j);
    for (Index r = joints(); r < rotors(); ++r) torque -= turns(r, j) * armature_(r) * speed(r, qdd);
    return torque;
  };
  if (!is_coupled(rotor)) return of_joint(rotor);
  double torque = 0;
  for (Index j = 0; j < joints(); ++j) torque += loads_(rotor - joints(), j) * of_joint(j);
  return torque;
}

MatrixXd Regressor::joint_torque(const MatrixXd& motor_torque) const { return transmission_ * motor_torque; }

bool Regressor::acts(std::size_t column, Index dof) const {
  const Column& c = columns_[column];
  return c.body < 0 ? turns(c.rotor, dof) != 0
                    : std::ranges::count(moved_by_[static_cast<std::size_t>(c.body)], static_cast<int>(dof)) > 0;
}

const MatrixXd& Regressor::at(const Eigen::Ref<const VectorXd>& q, const Eigen::Ref<const VectorXd>& qd,
                              const Eigen::Ref<const VectorXd>& qdd) {
  const mjModel* m = model_;
  frames_[0].a = -gravity_;
  for (int b = 1; b < m->nbody; ++b) {
    const Frame& parent = frames_[static_cast<std::size_t>(m->body_parentid[b])];
    Frame f = parent;
    const Vector3d offset = parent.R * vector(m->body_pos + 3 * b);
    f.R = parent.R * rotation(m->body_quat + 4 * b);
    f.origin += offset;
    f.a = parent.acceleration(offset);
    for (int j = m->body_jntadr[b]; j < m->body_jntadr[b] + m->body_jntnum[b]; ++j) {
      const auto at = static_cast<std::size_t>(j);
      const Vector3d own_axis = vector(m->jnt_axis + 3 * j), axis = f.R * own_axis;
      const double travel = q(j) - m->qpos0[j];
      axis_[at] = axis;
      if (m->jnt_type[j] == mjJNT_SLIDE) {
        f.a = f.acceleration(travel * axis) + qdd(j) * axis + 2 * qd(j) * f.w.cross(axis);
        f.origin += travel * axis;
      } else {
        const Vector3d own_anchor = vector(m->jnt_pos + 3 * j), to_anchor = f.R * own_anchor;
        anchor_[at] = f.origin + to_anchor;
        f.a = f.acceleration(to_anchor);  // of the anchor, the same on both sides of the hinge
        f.dw += qdd(j) * axis + qd(j) * f.w.cross(axis);
        f.w += qd(j) * axis;
        f.R = f.R * Eigen::AngleAxisd(travel, own_axis).toRotationMatrix();
        const Vector3d back = -(f.R * own_anchor);
        f.a = f.acceleration(back);
        f.origin = anchor_[at] + back;
      }
    }
    frames_[static_cast<std::size_t>(b)] = f;
    const Index first = first_column_[static_cast<std::size_t>(b)];
    if (first < 0) continue;
    const Vector3d a = f.R.transpose() * f.a, w = f.R.transpose() * f.w, dw = f.R.transpose() * f.dw;
    Eigen::Matrix<double, 3, per_body> force, torque;
    const Matrix3d W = cross_matrix(w);
    force << Eigen::Matrix<double, 3, 6>::Zero(), cross_matrix(dw) + W * W, a;
    torque << product(dw) + W * product(w), -cross_matrix(a), Vector3d::Zero();
    for (const int j : moved_by_[static_cast<std::size_t>(b)]) {
      const Vector3d u = f.R.transpose() * axis_[static_cast<std::size_t>(j)];
      auto row = Y_.block<1, per_body>(j, first);
      if (m->jnt_type[j] == mjJNT_SLIDE)
        row = u.transpose() * force;
      else
        row = u.transpose() * torque +
              u.cross(f.R.transpose() * (f.origin - anchor_[static_cast<std::size_t>(j)])).transpose() * force;
    }
  }
  const Index first_rotor = static_cast<Index>(columns_.size()) - rotors();
  for (int j = 0; j < m->nv; ++j) Y_(j, first_rotor + j) = qdd(j);
  for (Index r = joints(); r < rotors(); ++r) Y_.col(first_rotor + r) = turns_with(r) * speed(r, qdd);
  return Y_;
}

VectorXd Regressor::model_parameters() const {
  const mjModel* m = model_;
  VectorXd phi(static_cast<Index>(columns_.size()));
  for (std::size_t c = 0; c < columns_.size(); ++c) {
    const int b = columns_[c].body;
    if (b < 0) {
      phi(static_cast<Index>(c)) = armature_(columns_[c].rotor);
      continue;
    }
    const Vector3d centre = vector(m->body_ipos + 3 * b);
    const Matrix3d R = rotation(m->body_iquat + 4 * b), S = cross_matrix(centre);
    const Matrix3d I = R * vector(m->body_inertia + 3 * b).asDiagonal() * R.transpose() - m->body_mass[b] * S * S;
    const Index k = static_cast<Index>(c) - first_column_[static_cast<std::size_t>(b)];
    phi(static_cast<Index>(c)) = k < 6   ? I(tensor[k][0], tensor[k][1])
                                 : k < 9 ? m->body_mass[b] * centre(k - 6)
                                         : m->body_mass[b];
  }
  return phi;
}

}  // namespace tribotwin::twin
