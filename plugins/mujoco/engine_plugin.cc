// tribotwin.drive and tribotwin.hysteresis as engine plugins of MuJoCo 3.x. Configuration comes from the keys, state
// lives in the actuator's activations, everything else in plugin_state.
#include <cstring>
#include <memory>
#include <string>

#include <mujoco/mjplugin.h>
#include <mujoco/mujoco.h>

#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/spring.hpp>

namespace tribotwin::mujoco {
namespace {

template <class Bound>
Bound* bound(const mjData* d, int instance) {
  return reinterpret_cast<Bound*>(d->plugin_data[instance]);
}

/// The options that a drive depends on. On these engines anybody may change them between steps.
struct Checked {
  double timestep, tolerance;
  int integrator, solver, iterations, disableflags;
  bool operator==(const Checked&) const = default;
};
Checked options_of(const mjModel* m) {
  return {m->opt.timestep, m->opt.tolerance, m->opt.integrator, m->opt.solver, m->opt.iterations, m->opt.disableflags};
}

/// A drive of one mjData.
struct BoundDrive : Binding {
  Checked checked;
  double passive_nm = 0;  ///< not in plugin_state: mj_setState restores that and leaves qfrc_passive as it is
};

std::string instance_name(const mjModel* m, int instance) {
  const char* given = mj_id2name(m, mjOBJ_PLUGIN, instance);
  return given ? given : "unnamed";
}

/// The one actuator of an instance, -1 for none, -2 for several.
int actuator_of(const mjModel* m, int instance) {
  int actuator = -1;
  for (int i = 0; i < engine::actuator_count(m); ++i)
    if (m->actuator_plugin[i] == instance) actuator = actuator == -1 ? i : -2;
  return actuator;
}

template <class Keys>
drive::Configuration configuration(const mjModel* m, int instance, const Keys& keys) {
  drive::Configuration all;
  for (const char* key : keys)
    if (const char* value = mj_getPluginConfig(m, instance, key); value && *value) all.emplace_back(key, value);
  return all;
}

/// The instance's drive tied to its actuator, or why not. Nothing for an instance that no actuator uses.
Result<std::unique_ptr<BoundDrive>> connect(const mjModel* m, int instance) {
  const std::string name = instance_name(m, instance);
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(std::string(plugin_name) + ", instance '" + name + "': " + why);
  };
  auto drive = drive::make_drive(name, configuration(m, instance, drive::all_keys()));
  if (!drive) return fail(drive.error().message);
  const int actuator = actuator_of(m, instance);
  if (actuator == -2) return fail("serves two actuators; each drive needs its own");
  if (actuator < 0) return nullptr;
  if (m->actuator_actnum[actuator] != static_cast<int>(drive::state_size(*drive)))
    return fail("its actuator needs " + actdim_message(*drive));
  auto binding = bind(m, std::move(*drive), actuator);
  if (!binding) return tl::unexpected(std::string(plugin_name) + ": " + binding.error().message);
  binding->state_address = m->actuator_actadr[actuator];
  binding->workspace_address = m->plugin_stateadr[instance];
  return std::make_unique<BoundDrive>(BoundDrive{std::move(*binding), options_of(m)});
}

/// The same for a transmission.
Result<std::unique_ptr<Spring>> connect_spring(const mjModel* m, int instance) {
  const std::string name = instance_name(m, instance);
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(std::string(spring_plugin_name) + ", instance '" + name + "': " + why);
  };
  auto hysteresis = transmission::make_hysteresis(name, configuration(m, instance, transmission::all_keys()));
  if (!hysteresis) return fail(hysteresis.error().message);
  const int actuator = actuator_of(m, instance);
  if (actuator == -2) return fail("serves two actuators; each transmission needs its own");
  if (actuator < 0) return nullptr;
  if (m->actuator_actnum[actuator] != static_cast<int>(spring_state_size))
    return fail("its actuator needs actdim=\"" + std::to_string(spring_state_size) + "\"");
  const int drive_instance = mj_name2id(m, mjOBJ_PLUGIN, hysteresis->drive.c_str());
  int slot = -1;
  mjp_getPlugin(plugin_name, &slot);
  if (drive_instance < 0 || m->plugin[drive_instance] != slot)
    return fail("key 'drive' is '" + hysteresis->drive + "', which is no instance of " + plugin_name);
  auto drive = connect(m, drive_instance);
  if (!drive) return fail(drive.error().message);
  if (!*drive) return fail("key 'drive' is '" + hysteresis->drive + "', which no actuator uses");
  auto spring = bind_spring(m, std::move(*hysteresis), std::move(**drive), actuator);
  if (!spring) return tl::unexpected(std::string(spring_plugin_name) + ": " + spring.error().message);
  spring->state_address = m->actuator_actadr[actuator];
  spring->workspace_address = m->plugin_stateadr[instance];
  return std::make_unique<Spring>(std::move(*spring));
}

template <auto connect_instance>
int init(const mjModel* m, mjData* d, int instance) {
  // mju_error does not return; nothing with a destructor may be alive then.
  static thread_local char message[1000];
  message[0] = '\0';
  {
    auto binding = connect_instance(m, instance);
    if (binding)
      d->plugin_data[instance] = reinterpret_cast<uintptr_t>(binding->release());
    else
      std::strncpy(message, binding.error().message.c_str(), sizeof message - 1);
  }
  if (message[0]) mju_error("%s", message);
  return 0;
}

/// Ends in the engine's error handler where the options have become such that friction would be wrong.
void check_again(const mjModel* m, BoundDrive& b) {
  if (b.checked == options_of(m)) return;
  static thread_local char message[1000];
  message[0] = '\0';
  if (const auto ok = check_options(m, b); !ok)
    std::strncpy(message, ok.error().message.c_str(), sizeof message - 1);
  else
    b.checked = options_of(m);
  if (message[0]) mju_error("%s: the options were changed after loading. %s", plugin_name, message);
}

void compute(const mjModel* m, mjData* d, int instance, int capability) {
  BoundDrive* b = bound<BoundDrive>(d, instance);
  if (!b) return;
  check_again(m, *b);
  if (capability == mjPLUGIN_ACTUATOR) d->actuator_force[b->force] = commanded_force(m, d, *b);
  limit_friction(m, d, *b, capability == mjPLUGIN_PASSIVE ? Stage::passive : Stage::actuation, b->passive_nm);
}

template <class Bound>
void destroy(mjData* d, int instance) {
  delete bound<Bound>(d, instance);
  d->plugin_data[instance] = 0;
}

template <class Bound>
void copy(mjData* to, const mjModel*, const mjData* from, int instance) {
  delete bound<Bound>(to, instance);
  const Bound* original = bound<Bound>(from, instance);
  to->plugin_data[instance] = reinterpret_cast<uintptr_t>(original ? new Bound(*original) : nullptr);
}

void register_spring() {
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = spring_plugin_name;
  plugin.capabilityflags = mjPLUGIN_ACTUATOR;
  plugin.nattribute = static_cast<int>(transmission::all_keys().size());
  plugin.attributes = transmission::all_keys().data();
  plugin.nstate = [](const mjModel*, int) { return static_cast<int>(spring_workspace_size); };
  plugin.init = init<connect_spring>;
  plugin.destroy = destroy<Spring>;
  plugin.copy = copy<Spring>;
  plugin.reset = [](const mjModel*, mjtNum* plugin_state, void*, int) {
    std::memset(plugin_state, 0, sizeof(SpringWorkspace));
  };
  plugin.compute = [](const mjModel* m, mjData* d, int instance, int) {
    if (const Spring* s = bound<Spring>(d, instance)) d->actuator_force[s->force] = -spring_torque(m, d, *s);
  };
  plugin.advance = [](const mjModel*, mjData* d, int instance) {
    if (const Spring* s = bound<Spring>(d, instance)) book_spring(d, *s);
  };
  mjp_registerPlugin(&plugin);
}

__attribute__((constructor)) void register_plugins() {
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = plugin_name;
  plugin.capabilityflags = mjPLUGIN_ACTUATOR | mjPLUGIN_PASSIVE;
  plugin.nattribute = static_cast<int>(drive::all_keys().size());
  plugin.attributes = drive::all_keys().data();
  plugin.nstate = [](const mjModel*, int) { return static_cast<int>(drive::workspace_size); };
  plugin.init = init<connect>;
  plugin.destroy = destroy<BoundDrive>;
  plugin.copy = copy<BoundDrive>;
  plugin.reset = [](const mjModel*, mjtNum* plugin_state, void* data, int) {
    std::memset(plugin_state, 0, sizeof(drive::Workspace));
    if (data) static_cast<BoundDrive*>(data)->passive_nm = 0;
  };
  plugin.compute = compute;
  // The state moves once per step, in `advance`, not with the integrator's act_dot, which the engine zeroes.
  plugin.advance = [](const mjModel* m, mjData* d, int instance) {
    if (const Binding* b = bound<BoundDrive>(d, instance)) book_friction(m, d, *b);
  };
  mjp_registerPlugin(&plugin);
  register_spring();
}

}  // namespace
}  // namespace tribotwin::mujoco
