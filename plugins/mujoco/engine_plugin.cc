// tribotwin.drive and tribotwin.hysteresis as engine plugins of MuJoCo 3.x. Configuration comes from the keys, state
// lives in the actuator's activations, everything else in plugin_state.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <link.h>
#include <mujoco/mjplugin.h>
#include <mujoco/mujoco.h>

#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/sensor.hpp>
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
  double passive_nm = 0;  ///< not in plugin_state: mj_setState restores that and leaves qfrc_passive as it is
};

/// The drives of an instance in one mjData.
struct BoundDrives {
  std::vector<BoundDrive> drives;  ///< in the order of their actuators
  Checked checked;
};

std::string instance_name(const mjModel* m, int instance) {
  const char* given = mj_id2name(m, mjOBJ_PLUGIN, instance);
  return given ? given : "unnamed";
}

std::vector<int> actuators_of(const mjModel* m, int instance) {
  std::vector<int> actuators;
  for (int i = 0; i < engine::actuator_count(m); ++i)
    if (m->actuator_plugin[i] == instance) actuators.push_back(i);
  return actuators;
}

/// Whether an actuator is one of ours.
bool has_drive(const mjModel* m, int actuator) {
  int slot = -1;
  mjp_getPlugin(plugin_name, &slot);
  const int instance = m->actuator_plugin[actuator];
  return instance >= 0 && m->plugin[instance] == slot;
}

template <class Keys>
drive::Configuration configuration(const mjModel* m, int instance, const Keys& keys) {
  drive::Configuration all;
  for (const char* key : keys)
    if (const char* value = mj_getPluginConfig(m, instance, key); value && *value) all.emplace_back(key, value);
  return all;
}

/// The instance's drives tied to their actuators, or why not. Empty for an instance that no actuator uses.
Result<std::unique_ptr<BoundDrives>> connect(const mjModel* m, int instance) {
  const std::string name = instance_name(m, instance);
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(std::string(plugin_name) + ", instance '" + name + "': " + why);
  };
  const auto keys = configuration(m, instance, drive::all_keys());
  const auto actuators = actuators_of(m, instance);
  auto bound = std::make_unique<BoundDrives>();
  if (actuators.empty())
    if (const auto drive = drive::make_drive(name, keys); !drive) return fail(drive.error().message);
  for (std::size_t k = 0; k < actuators.size(); ++k) {
    const int actuator = actuators[k];
    const char* joint =
        m->actuator_trntype[actuator] == mjTRN_JOINT ? mj_id2name(m, mjOBJ_JOINT, m->actuator_trnid[2 * actuator]) : "";
    auto drive = drive::make_shared_drive(name, joint ? joint : "", keys, k, actuators.size());
    if (!drive) return fail(drive.error().message);
    if (m->actuator_actnum[actuator] != static_cast<int>(drive::state_size(*drive)))
      return fail("its actuator needs " + actdim_message(*drive));
    auto binding = bind(m, std::move(*drive), actuator);
    if (!binding) return tl::unexpected(std::string(plugin_name) + ": " + binding.error().message);
    binding->state_address = m->actuator_actadr[actuator];
    binding->workspace_address = m->plugin_stateadr[instance] + static_cast<int>(k * drive::workspace_size);
    bound->drives.push_back({std::move(*binding)});
  }
  bound->checked = options_of(m);
  return bound;
}

/// The same for a transmission.
Result<std::unique_ptr<Spring>> connect_spring(const mjModel* m, int instance) {
  const std::string name = instance_name(m, instance);
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(std::string(spring_plugin_name) + ", instance '" + name + "': " + why);
  };
  auto hysteresis = transmission::make_hysteresis(name, configuration(m, instance, transmission::all_keys()));
  if (!hysteresis) return fail(hysteresis.error().message);
  const auto actuators = actuators_of(m, instance);
  if (actuators.size() > 1) return fail("serves two actuators; each transmission needs its own");
  if (actuators.empty()) return nullptr;
  const int actuator = actuators.front();
  if (m->actuator_actnum[actuator] != static_cast<int>(spring_state_size))
    return fail("its actuator needs actdim=\"" + std::to_string(spring_state_size) + "\"");
  std::vector<NamedDrive> drives;
  std::vector<int> driven;
  for (int i = 0; i < engine::actuator_count(m); ++i)
    if (has_drive(m, i)) {
      driven.push_back(i);
      drives.push_back({instance_name(m, m->actuator_plugin[i]), m->actuator_trnid[2 * i]});
    }
  const auto chosen = drive_of(m, *hysteresis, actuator, drives);
  if (!chosen) return tl::unexpected(std::string(spring_plugin_name) + ": " + chosen.error().message);
  auto bound = connect(m, m->actuator_plugin[driven[*chosen]]);
  if (!bound) return fail(bound.error().message);
  auto& drive = *std::ranges::find((*bound)->drives, driven[*chosen], &BoundDrive::actuator);
  auto spring = bind_spring(m, std::move(*hysteresis), std::move(drive), actuator);
  if (!spring) return tl::unexpected(std::string(spring_plugin_name) + ": " + spring.error().message);
  spring->state_address = m->actuator_actadr[actuator];
  spring->workspace_address = m->plugin_stateadr[instance];
  return std::make_unique<Spring>(std::move(*spring));
}

/// What the sensors of an instance write.
Result<Sensor> sensor_of(const mjModel* m, int instance) {
  const char* quantity = mj_getPluginConfig(m, instance, "quantity");
  return make_sensor(quantity ? quantity : "");
}

/// The sensors of an instance, of mjData's drives by their instances.
Result<std::unique_ptr<std::vector<Sensor>>> connect_sensors(const mjModel* m, int instance) {
  auto sensors = std::make_unique<std::vector<Sensor>>();
  for (int i = 0; i < m->nsensor; ++i) {
    if (m->sensor_type[i] != mjSENS_PLUGIN || m->sensor_plugin[i] != instance) continue;
    const char* name = mj_id2name(m, mjOBJ_SENSOR, i);
    const auto fail = [&](const std::string& why) {
      return tl::unexpected(fmt::format("{}, sensor '{}': {}", sensor_plugin_name, name ? name : "unnamed", why));
    };
    auto sensor = sensor_of(m, instance);
    if (!sensor) return fail(sensor.error().message);
    if (m->sensor_objtype[i] != mjOBJ_ACTUATOR || !has_drive(m, m->sensor_objid[i]))
      return fail(fmt::format("needs objtype=\"actuator\" and in objname an actuator with plugin=\"{}\"", plugin_name));
    sensor->address = m->sensor_adr[i];
    sensor->drive = m->actuator_plugin[m->sensor_objid[i]];
    const auto served = actuators_of(m, sensor->drive);
    sensor->member = static_cast<std::size_t>(std::ranges::find(served, m->sensor_objid[i]) - served.begin());
    sensors->push_back(*sensor);
  }
  return sensors;
}

/// Does `work` and ends in the engine's error handler where it fails. mju_error does not return: nothing with a
/// destructor may be alive then.
template <class Work>
void or_engine_error(const Work& work) {
  static thread_local char message[1000];
  message[0] = '\0';
  if (const Result<void> done = work(); !done) std::strncpy(message, done.error().message.c_str(), sizeof message - 1);
  if (message[0]) mju_error("%s", message);
}

template <auto connect_instance>
int init(const mjModel* m, mjData* d, int instance) {
  or_engine_error([&]() -> Result<void> {
    auto binding = connect_instance(m, instance);
    if (!binding) return tl::unexpected(binding.error());
    d->plugin_data[instance] = reinterpret_cast<uintptr_t>(binding->release());
    return {};
  });
  return 0;
}

/// Fails where the options have become such that friction would be wrong.
void check_again(const mjModel* m, BoundDrives& b) {
  if (b.checked == options_of(m)) return;
  or_engine_error([&]() -> Result<void> {
    for (const BoundDrive& drive : b.drives)
      if (const auto ok = check_options(m, drive); !ok)
        return tl::unexpected(
            fmt::format("{}: the options were changed after loading. {}", plugin_name, ok.error().message));
    b.checked = options_of(m);
    return {};
  });
}

void compute(const mjModel* m, mjData* d, int instance, int capability) {
  BoundDrives* all = bound<BoundDrives>(d, instance);
  if (!all) return;
  check_again(m, *all);
  const Stage stage = capability == mjPLUGIN_PASSIVE ? Stage::passive : Stage::actuation;
  for (BoundDrive& b : all->drives) {
    limit_friction(m, d, b, stage, b.passive_nm);  // begins the step, which has the current limit
    if (stage == Stage::actuation) d->actuator_force[b.force] = commanded_force(m, d, b);
  }
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

void register_sensor() {
  static const char* const attributes[] = {"quantity"};
  using Sensors = std::vector<Sensor>;
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = sensor_plugin_name;
  plugin.capabilityflags = mjPLUGIN_SENSOR;
  plugin.needstage = mjSTAGE_ACC;
  plugin.nattribute = 1;
  plugin.attributes = attributes;
  plugin.nstate = [](const mjModel*, int) { return 0; };
  plugin.nsensordata = [](const mjModel* m, int instance, int) {
    const auto sensor = sensor_of(m, instance);
    return sensor ? static_cast<int>(sensor->count) : 1;  // `init` says what is wrong
  };
  plugin.init = init<connect_sensors>;
  plugin.destroy = destroy<Sensors>;
  plugin.copy = copy<Sensors>;
  plugin.compute = [](const mjModel* m, mjData* d, int instance, int) {
    if (const Sensors* sensors = bound<Sensors>(d, instance))
      for (const Sensor& s : *sensors)
        if (const BoundDrives* b = bound<BoundDrives>(d, s.drive)) measure(m, d, b->drives[s.member], s);
  };
  mjp_registerPlugin(&plugin);
}

/// As people write it: 3.12.0 for 3012000, 3.3.7 for 337.
std::string version_name(int version) {
  const int base = version >= 1000000 ? 1000 : 10;
  return fmt::format("{}.{}.{}", version / base / base, version / base % base, version % base);
}

/// The engines that are loaded in this process, by their files.
std::vector<std::string> loaded_engines() {
  std::vector<std::string> files;
  dl_iterate_phdr(
      [](dl_phdr_info* object, std::size_t, void* out) {
        const std::string file = object->dlpi_name;
        if (file.substr(file.rfind('/') + 1).starts_with("libmujoco."))
          static_cast<std::vector<std::string>*>(out)->push_back(file);
        return 0;
      },
      &files);
  return files;
}

/// Whether this library may serve the engine that it has found; says why not. Structures differ between versions, so
/// nothing of the engine but its version is touched before.
bool fits_the_engine() {
  if (const int version = mj_version(); version != mjVERSION_HEADER) {
    std::fprintf(stderr,
                 "%s: this library is built for MuJoCo %s and does not serve %s; load the library of that one\n",
                 plugin_name, version_name(mjVERSION_HEADER).c_str(), version_name(version).c_str());
    return false;
  }
  if (const auto engines = loaded_engines(); engines.size() > 1)
    std::fprintf(stderr,
                 "%s: %zu engines are loaded in this process (%s); if the plugin is not found, this library, which is "
                 "built for MuJoCo %s, has registered with another one than the program's\n",
                 plugin_name, engines.size(), fmt::format("{}", fmt::join(engines, ", ")).c_str(),
                 version_name(mjVERSION_HEADER).c_str());
  return true;
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
  if (!fits_the_engine()) return;
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = plugin_name;
  plugin.capabilityflags = mjPLUGIN_ACTUATOR | mjPLUGIN_PASSIVE;
  plugin.nattribute = static_cast<int>(drive::all_keys().size());
  plugin.attributes = drive::all_keys().data();
  plugin.nstate = [](const mjModel* m, int instance) {
    return static_cast<int>(actuators_of(m, instance).size() * drive::workspace_size);
  };
  plugin.init = init<connect>;
  plugin.destroy = destroy<BoundDrives>;
  plugin.copy = copy<BoundDrives>;
  plugin.reset = [](const mjModel* m, mjtNum* plugin_state, void* data, int instance) {
    std::fill_n(plugin_state, m->plugin_statenum[instance], 0);
    if (data)
      for (BoundDrive& b : static_cast<BoundDrives*>(data)->drives) b.passive_nm = 0;
  };
  plugin.compute = compute;
  // The state moves once per step, in `advance`, not with the integrator's act_dot, which the engine zeroes.
  plugin.advance = [](const mjModel* m, mjData* d, int instance) {
    if (const BoundDrives* all = bound<BoundDrives>(d, instance))
      for (const BoundDrive& b : all->drives) book_friction(m, d, b);
  };
  mjp_registerPlugin(&plugin);
  register_spring();
  register_sensor();
}

}  // namespace
}  // namespace tribotwin::mujoco
