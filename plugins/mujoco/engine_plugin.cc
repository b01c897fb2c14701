// tribotwin.drive as an engine plugin of MuJoCo 3.x. Configuration comes from the keys, memory lives in the actuator's
// activations, everything else in plugin_state.
#include <cstring>
#include <memory>
#include <string>

#include <mujoco/mjplugin.h>
#include <mujoco/mujoco.h>

#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>

namespace tribotwin::mujoco {
namespace {

Binding* binding_of(const mjData* d, int instance) { return reinterpret_cast<Binding*>(d->plugin_data[instance]); }

/// The instance's drive tied to its actuator, or why not. Nothing for an instance that no actuator uses.
tl::expected<std::unique_ptr<Binding>, std::string> connect(const mjModel* m, int instance) {
  const char* given = mj_id2name(m, mjOBJ_PLUGIN, instance);
  const std::string name = given ? given : "unnamed";
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(std::string(plugin_name) + ", instance '" + name + "': " + why);
  };
  drive::Configuration configuration;
  for (const char* key : drive::all_keys())
    if (const char* value = mj_getPluginConfig(m, instance, key); value && *value) configuration.emplace_back(key, value);
  auto drive = drive::make_drive(name, configuration);
  if (!drive) return fail(drive.error());
  int actuator = -1;
  for (int i = 0; i < engine::actuator_count(m); ++i)
    if (m->actuator_plugin[i] == instance) {
      if (actuator >= 0) return fail("serves two actuators; each drive needs its own");
      actuator = i;
    }
  if (actuator < 0) return nullptr;
  if (m->actuator_actnum[actuator] != static_cast<int>(drive::memory_size))
    return fail("its actuator needs actdim=\"" + std::to_string(drive::memory_size) + "\"");
  auto binding = bind(m, std::move(*drive), actuator);
  if (!binding) return tl::unexpected(std::string(plugin_name) + ": " + binding.error());
  binding->memory_address = m->actuator_actadr[actuator];
  binding->scratch_address = m->plugin_stateadr[instance];
  return std::make_unique<Binding>(std::move(*binding));
}

int init(const mjModel* m, mjData* d, int instance) {
  // mju_error does not return; nothing with a destructor may be alive then.
  static thread_local char message[1000];
  message[0] = '\0';
  {
    auto binding = connect(m, instance);
    if (binding)
      d->plugin_data[instance] = reinterpret_cast<uintptr_t>(binding->release());
    else
      std::strncpy(message, binding.error().c_str(), sizeof message - 1);
  }
  if (message[0]) mju_error("%s", message);
  return 0;
}

void compute(const mjModel* m, mjData* d, int instance, int) {
  if (!binding_of(d, instance)) return;
  const Binding& b = *binding_of(d, instance);
  mjtNum torque = d->ctrl[b.control];
  if (m->actuator_ctrllimited[b.control] && !(m->opt.disableflags & mjDSBL_CLAMPCTRL)) {
    const mjtNum* range = m->actuator_ctrlrange + 2 * b.control;
    torque = mju_clip(torque, range[0], range[1]);
  }
  d->actuator_force[b.force] = torque;
  limit_friction(m, d, b);
}

__attribute__((constructor)) void register_plugin() {
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = plugin_name;
  plugin.capabilityflags = mjPLUGIN_ACTUATOR;
  plugin.nattribute = static_cast<int>(drive::all_keys().size());
  plugin.attributes = drive::all_keys().data();
  plugin.nstate = [](const mjModel*, int) { return static_cast<int>(drive::scratch_size); };
  plugin.init = init;
  plugin.destroy = [](mjData* d, int instance) {
    delete binding_of(d, instance);
    d->plugin_data[instance] = 0;
  };
  plugin.copy = [](mjData* to, const mjModel*, const mjData* from, int instance) {
    delete binding_of(to, instance);
    const Binding* original = binding_of(from, instance);
    to->plugin_data[instance] = reinterpret_cast<uintptr_t>(original ? new Binding(*original) : nullptr);
  };
  plugin.reset = [](const mjModel*, mjtNum* plugin_state, void*, int) {
    std::memset(plugin_state, 0, sizeof(drive::Scratch));
  };
  plugin.compute = compute;
  // The memory moves once per step, in `advance`, not with the integrator's act_dot, which the engine zeroes.
  plugin.advance = [](const mjModel* m, mjData* d, int instance) {
    if (const Binding* b = binding_of(d, instance)) book_friction(m, d, *b);
  };
  mjp_registerPlugin(&plugin);
}

}  // namespace
}  // namespace tribotwin::mujoco
