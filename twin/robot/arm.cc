#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin {

std::string joint_name(const mjModel* m, const mujoco::Binding& drive) {
  const char* name = mj_id2name(m, mjOBJ_JOINT, drive.joint);
  return name ? name : fmt::format("joint_{}", drive.joint);
}

std::vector<std::string> joint_names(const mujoco::Model& model) {
  std::vector<std::string> names;
  for (const auto& drive : model.drives()) names.push_back(joint_name(model.get(), drive));
  return names;
}

bool is_slide(const mjModel* m, const mujoco::Binding& drive) { return m->jnt_type[drive.joint] == mjJNT_SLIDE; }

std::string unit_of(std::string_view of_hinge, bool slide) {
  std::string unit(of_hinge);
  for (const auto& [hinge, linear] : {std::pair{std::string_view("Nm"), "N"}, {"rad", "m"}})
    for (std::size_t at = 0; slide && (at = unit.find(hinge, at)) != unit.npos;) unit.replace(at, hinge.size(), linear);
  return unit;
}

Result<std::size_t> find_drive(const mujoco::Model& model, std::string_view joint) {
  const std::vector<std::string> names = joint_names(model);
  const auto found = std::ranges::find(names, joint);
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  if (names.empty()) return tl::unexpected(std::string("the model has no tribotwin.drive"));
  const std::vector<std::string_view> views(names.begin(), names.end());
  return tl::unexpected(
      fmt::format("'{}': did you mean '{}'? Joints with drives: {}", joint, nearest(joint, views), joined(names)));
}

std::size_t drive_of(const mujoco::Model& model, const mujoco::Spring& spring) {
  return static_cast<std::size_t>(std::ranges::find(model.drives(), spring.drive.actuator, &mujoco::Binding::actuator) -
                                  model.drives().begin());
}

double ratio_of(const mujoco::Spring& spring) {
  for (const auto& part : spring.torsion)
    if (part.position == spring.drive.position) return 1 / part.coefficient;
  return 1;
}

std::optional<double> joint_speed_max_rad_s(const mujoco::Model& model, std::size_t drive) {
  const mjModel* m = model.get();
  const int id = mj_name2id(m, mjOBJ_NUMERIC, "joint_speed_max_rad_s");
  if (id < 0 || static_cast<std::size_t>(m->numeric_size[id]) != model.drives().size()) return {};
  return m->numeric_data[m->numeric_adr[id] + static_cast<int>(drive)];
}

int position_address(const mjModel* m, const mujoco::Binding& drive) { return m->jnt_qposadr[drive.joint]; }

double gravity_torque_nm(const mjModel* m, const mjData* d, int dof) {
  if (m->opt.disableflags & mjDSBL_GRAVITY) return 0;
  const int joint = m->dof_jntid[dof], body = m->dof_bodyid[dof];
  const Eigen::Map<const Eigen::Vector3d> axis(d->xaxis + 3 * joint), anchor(d->xanchor + 3 * joint),
      com(d->subtree_com + 3 * body), gravity(m->opt.gravity);
  const Eigen::Vector3d direction =
      m->jnt_type[joint] == mjJNT_SLIDE ? Eigen::Vector3d(axis) : axis.cross(com - anchor);
  return -m->body_subtreemass[body] * direction.dot(gravity);
}

double inertia_kg_m2(const mjModel* m, const mjData* d, int dof) {
  Eigen::VectorXd unit = Eigen::VectorXd::Unit(m->nv, dof), column(m->nv);
  mj_mulM(m, d, column.data(), unit.data());
  return column[dof];
}

Result<std::shared_ptr<const mujoco::Model>> with_payload(const mujoco::Model& arm, const Payload& payload) {
  if (!(payload.mass_kg >= 0) || !std::isfinite(payload.mass_kg))
    return tl::unexpected(fmt::format("payload mass {} kg must be 0 or more", payload.mass_kg));
  if (arm.drives().empty()) return tl::unexpected(std::string("the model has no drive, so nothing to carry a payload"));
  return mujoco::variant(arm, [&p = payload](mjModel* m) {
    int body = -1;
    Eigen::Vector3d com(p.com_m[0], p.com_m[1], p.com_m[2]);
    if (const int site = mj_name2id(m, mjOBJ_SITE, "flange"); site >= 0) {
      body = m->site_bodyid[site];
      com += Eigen::Map<const Eigen::Vector3d>(m->site_pos + 3 * site);
    } else {
      for (int i = 0; i < m->njnt; ++i) body = std::max(body, m->jnt_bodyid[i]);
    }
    const double radius = std::cbrt(3 * p.mass_kg / (4 * std::numbers::pi * 7850));
    const double mass = m->body_mass[body], total = mass + p.mass_kg;
    if (total <= 0) return;
    Eigen::Map<Eigen::Vector3d> position(m->body_ipos + 3 * body), inertia(m->body_inertia + 3 * body);
    mjtNum rotation[9];
    mju_quat2Mat(rotation, m->body_iquat + 4 * body);
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(rotation);
    const auto shifted = [](double at, const Eigen::Vector3d& r) {
      return Eigen::Matrix3d(at * (r.squaredNorm() * Eigen::Matrix3d::Identity() - r * r.transpose()));
    };
    const Eigen::Vector3d centre = (mass * position + p.mass_kg * com) / total;
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> sum =
        R * inertia.asDiagonal() * R.transpose() + shifted(mass, position - centre) + shifted(p.mass_kg, com - centre);
    sum += 0.4 * p.mass_kg * radius * radius * Eigen::Matrix3d::Identity();
    mjtNum values[3], vectors[9], quaternion[4];
    mju_eig3(values, vectors, quaternion, sum.data());
    position = centre;
    for (int i = 0; i < 3; ++i) inertia[i] = values[i];
    for (int i = 0; i < 4; ++i) m->body_iquat[4 * body + i] = quaternion[i];
    m->body_mass[body] = total;
    // The engine skips rotations it believes to be identities.
    m->body_sameframe[body] = 0;
    m->body_simple[body] = 0;
    for (int i = 0; i < m->body_dofnum[body]; ++i) m->dof_simplenum[m->body_dofadr[body] + i] = 0;
  });
}

}  // namespace tribotwin::twin
