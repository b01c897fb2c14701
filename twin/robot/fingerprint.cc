#include <string>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>

namespace tribotwin::twin {

void Fingerprint::add(std::string_view bytes) {
  for (const char byte : bytes) hash_ = (hash_ ^ static_cast<unsigned char>(byte)) * 1099511628211ULL;
}

void Fingerprint::add(std::span<const double> values) {
  add(std::string_view(reinterpret_cast<const char*>(values.data()), values.size_bytes()));
}

std::uint64_t fingerprint(const mujoco::Model& model) {
  Fingerprint all;
  const mjModel* m = model.get();
  for (const auto& binding : model.drives())
    for (const auto& [key, value] : drive::configuration_of(binding.drive)) all.add(key), all.add(value);
  const auto array = [&](const mjtNum* values, auto count) {
    all.add(std::span<const double>(values, static_cast<std::size_t>(count)));
  };
  array(m->body_pos, 3 * m->nbody), array(m->body_quat, 4 * m->nbody), array(m->body_ipos, 3 * m->nbody),
      array(m->body_iquat, 4 * m->nbody);
  array(m->body_mass, m->nbody), array(m->body_inertia, 3 * m->nbody), array(m->jnt_pos, 3 * m->njnt),
      array(m->jnt_axis, 3 * m->njnt);
  array(m->jnt_range, 2 * m->njnt), array(m->qpos0, m->nq), array(m->dof_armature, m->nv), array(m->dof_damping, m->nv);
  array(m->dof_solref, mjNREF * m->nv), array(m->dof_solimp, mjNIMP * m->nv), array(m->opt.gravity, 3),
      array(&m->opt.timestep, 1), array(&m->opt.tolerance, 1);
  for (const int choice : {m->opt.integrator, m->opt.solver, m->opt.iterations}) all.add(std::to_string(choice));
  return all.value();
}

}  // namespace tribotwin::twin
