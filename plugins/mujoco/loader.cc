#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <map>

#include <fmt/format.h>
#include <pugixml.hpp>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/plugins/mujoco/memory.hpp>
#include <tribotwin/plugins/mujoco/source.hpp>

namespace tribotwin::mujoco {
namespace {

using Loaded = Result<std::shared_ptr<const Model>>;

struct DriveElement {
  std::string where;
  std::string actuator, instance;
  drive::Drive drive;
};

using Element = std::pair<const Source*, pugi::xml_node>;

tl::unexpected<Error> no_instance(const std::string& where, const std::string& name, const char* plugin) {
  return tl::unexpected<Error>(
      fmt::format("{}: no <instance name=\"{}\"> under <extension><plugin plugin=\"{}\">", where, name, plugin));
}

/// The <instance> of a plugin that `where` names, in any file.
Result<Element> find_instance(const std::vector<Source>& sources, const std::string& where, const std::string& name,
                              const char* plugin) {
  Element found{};
  for (const Source& source : sources)
    for (const auto& match :
         source.document->select_nodes(fmt::format("//extension/plugin[@plugin='{}']/instance", plugin).c_str()))
      if (match.node().attribute("name").value() == name) found = {&source, match.node()};
  if (!found.first) return no_instance(where, name, plugin);
  return found;
}

/// The keys of an <instance>.
Result<drive::Configuration> keys_of(const Element& instance) {
  drive::Configuration configuration;
  for (const pugi::xml_node config : instance.second.children("config")) {
    if (!config.attribute("key") || !config.attribute("value"))
      return tl::unexpected(at(*instance.first, config) + ": needs key and value");
    configuration.emplace_back(config.attribute("key").value(), config.attribute("value").value());
  }
  return configuration;
}

/// The instances of the drives by their names.
Result<std::map<std::string, Element>> drive_instances(const std::vector<Source>& sources) {
  std::map<std::string, Element> instances;
  for (const Source& source : sources)
    for (const auto& match : source.document->select_nodes("//extension/plugin[@plugin='tribotwin.drive']/instance")) {
      const pugi::xml_node element = match.node();
      if (!element.attribute("name")) return tl::unexpected(at(source, element) + ": lacks its name");
      if (!instances.emplace(element.attribute("name").value(), Element{&source, element}).second)
        return tl::unexpected(at(source, element) + ": a second instance of this name");
    }
  return instances;
}

/// The actuators that are drives, by their instances. Those of one instance stand in one file, whose order is theirs.
Result<std::map<std::string, std::vector<Element>>> drive_actuators(const std::vector<Source>& sources) {
  std::map<std::string, std::vector<Element>> of_instance;
  std::map<std::string, std::string> joints;  // joint -> place of its drive in the file
  for (const Source& source : sources)
    for (const auto& match : source.document->select_nodes("//actuator/plugin[@plugin='tribotwin.drive']")) {
      const pugi::xml_node element = match.node();
      const std::string where = at(source, element), joint = element.attribute("joint").value(),
                        instance = element.attribute("instance").value();
      if (element.attribute("tendon"))
        return tl::unexpected(fmt::format(
            "{}: a drive acts on a joint (joint=\"...\"), not on a tendon: friction of a motor that turns with "
            "several joints is not simulated; give each of them a drive, or the tendon a <motor>",
            where));
      if (!*element.attribute("name").value() || joint.empty() || instance.empty())
        return tl::unexpected(fmt::format("{}: needs name, joint and instance", where));
      if (const auto [first, fresh] = joints.emplace(joint, where); !fresh)
        return tl::unexpected(fmt::format("{}: joint '{}' has a drive already at {}", where, joint, first->second));
      auto& actuators = of_instance[instance];
      if (!actuators.empty() && actuators.front().first != &source)
        return tl::unexpected(fmt::format(
            "{}: instance '{}' serves an actuator of another file already ({}); actuators of one instance stand in one "
            "file",
            where, instance, at(*actuators.front().first, actuators.front().second)));
      actuators.emplace_back(&source, element);
    }
  return of_instance;
}

/// Reads every drive of the model and checks what only the text shows.
Result<std::vector<DriveElement>> read_drives(const std::vector<Source>& sources) {
  const auto instances = drive_instances(sources);
  if (!instances) return tl::unexpected(instances.error());
  const auto actuators = drive_actuators(sources);
  if (!actuators) return tl::unexpected(actuators.error());
  std::vector<DriveElement> drives;
  for (const auto& [instance, served] : *actuators)
    for (std::size_t k = 0; k < served.size(); ++k) {
      const pugi::xml_node element = served[k].second;
      const std::string where = at(*served[k].first, element);
      const auto found = instances->find(instance);
      if (found == instances->end()) return no_instance(where, instance, plugin_name);
      const auto keys = keys_of(found->second);
      if (!keys) return tl::unexpected(keys.error());
      auto drive = drive::make_shared_drive(instance, element.attribute("joint").value(), *keys, k, served.size());
      if (!drive)
        return tl::unexpected(
            fmt::format("{}: {}", at(*found->second.first, found->second.second), drive.error().message));
      if (element.attribute("actdim").as_int(-1) != static_cast<int>(drive::state_size(*drive)))
        return tl::unexpected(fmt::format("{}: needs {}", where, actdim_message(*drive)));
      drives.push_back({where, element.attribute("name").value(), instance, std::move(*drive)});
    }
  return drives;
}

struct SpringElement {
  std::string where;
  std::string actuator;
  transmission::Hysteresis hysteresis;
};

/// Reads every elastic transmission of the model.
Result<std::vector<SpringElement>> read_springs(const std::vector<Source>& sources,
                                                const std::vector<DriveElement>& drives) {
  std::vector<SpringElement> springs;
  for (const Source& source : sources)
    for (const auto& match : source.document->select_nodes("//actuator/plugin[@plugin='tribotwin.hysteresis']")) {
      const pugi::xml_node element = match.node();
      const std::string where = at(source, element), name = element.attribute("name").value(),
                        instance = element.attribute("instance").value();
      if (name.empty() || !element.attribute("tendon") || instance.empty())
        return tl::unexpected(fmt::format("{}: needs name, tendon and instance", where));
      if (element.attribute("actdim").as_int(-1) != static_cast<int>(spring_state_size))
        return tl::unexpected(
            fmt::format("{}: needs actdim=\"{}\", the state of the hysteresis", where, spring_state_size));
      if (std::ranges::any_of(springs, [&](const SpringElement& s) { return s.hysteresis.name == instance; }))
        return tl::unexpected(fmt::format(
            "{}: instance '{}' serves another actuator already; each transmission needs its own", where, instance));
      const auto found = find_instance(sources, where, instance, spring_plugin_name);
      if (!found) return tl::unexpected(found.error());
      const std::string where_keys = at(*found->first, found->second);
      const auto keys = keys_of(*found);
      if (!keys) return tl::unexpected(keys.error());
      auto hysteresis = transmission::make_hysteresis(instance, *keys);
      if (!hysteresis) return tl::unexpected(fmt::format("{}: {}", where_keys, hysteresis.error().message));
      if (!hysteresis->drive.empty() &&
          std::ranges::find(drives, hysteresis->drive, &DriveElement::instance) == drives.end())
        return tl::unexpected(fmt::format("{}: key 'drive' is '{}', which is no instance of {} that an actuator uses",
                                          where_keys, hysteresis->drive, plugin_name));
      springs.push_back({where, name, std::move(*hysteresis)});
    }
  return springs;
}

struct SensorElement {
  std::string where;
  std::string name, actuator;
  Sensor sensor;
};

/// The value of the key `quantity`, which stands in the sensor or in the instance that it names.
Result<std::string> quantity_of(const std::vector<Source>& sources, const Source& source, pugi::xml_node sensor) {
  Element holder{&source, sensor};
  if (const std::string instance = sensor.attribute("instance").value(); !instance.empty()) {
    const auto found = find_instance(sources, at(source, sensor), instance, sensor_plugin_name);
    if (!found) return tl::unexpected(found.error());
    holder = *found;
  }
  std::string quantity;
  for (const pugi::xml_node config : holder.second.children("config")) {
    if (std::string_view(config.attribute("key").value()) != "quantity")
      return tl::unexpected(fmt::format("{}: key '{}' is not known; the only key is 'quantity'",
                                        at(*holder.first, config), config.attribute("key").value()));
    quantity = config.attribute("value").value();
  }
  return quantity;
}

/// Reads every sensor of a drive.
Result<std::vector<SensorElement>> read_sensors(const std::vector<Source>& sources,
                                                const std::vector<DriveElement>& drives) {
  std::vector<SensorElement> sensors;
  for (const Source& source : sources)
    for (const auto& match : source.document->select_nodes("//sensor/plugin[@plugin='tribotwin.sensor']")) {
      const pugi::xml_node element = match.node();
      const std::string where = at(source, element), name = element.attribute("name").value(),
                        actuator = element.attribute("objname").value();
      if (name.empty() || std::string_view(element.attribute("objtype").value()) != "actuator" || actuator.empty())
        return tl::unexpected(fmt::format("{}: needs name, objtype=\"actuator\" and objname", where));
      if (std::ranges::find(drives, actuator, &DriveElement::actuator) == drives.end())
        return tl::unexpected(fmt::format("{}: '{}' is no actuator with plugin=\"{}\"", where, actuator, plugin_name));
      const auto quantity = quantity_of(sources, source, element);
      if (!quantity) return tl::unexpected(quantity.error());
      const auto sensor = make_sensor(*quantity);
      if (!sensor) return tl::unexpected(fmt::format("{}: {}", where, sensor.error().message));
      sensors.push_back({where, name, actuator, *sensor});
    }
  return sensors;
}

/// Room of drives and transmissions in userdata.
[[maybe_unused]] int user_size(const std::vector<DriveElement>& drives, const std::vector<SpringElement>& springs) {
  std::size_t size = springs.size() * (spring_state_size + spring_workspace_size);
  for (const DriveElement& d : drives) size += drive::state_size(d.drive) + drive::workspace_size;
  return static_cast<int>(size);
}

/// The text of a model, one element per line.
std::string saved(const pugi::xml_document& document, Origins& origins) {
  std::string text = text_of(document);
  origins.saved_as(text, document);
  return text;
}

#if !TRIBOTWIN_ENGINE_PLUGINS
/// Merges includes and turns drives into what 2.2.2 knows, torque actuators and room in userdata, and their sensors
/// into user sensors.
std::string lower(const std::vector<Source>& sources, const std::filesystem::path& folder, int user_size,
                  const std::vector<DriveElement>& drives, const std::vector<SensorElement>& sensors,
                  Origins& origins) {
  merge_includes(sources, folder, &origins);
  pugi::xml_document& main = *sources.front().document;
  remove_extensions(main);
  for (const auto& match : main.select_nodes("//actuator/plugin[starts-with(@plugin, 'tribotwin.')]")) {
    const std::string name = match.node().attribute("name").value();
    const auto read = std::ranges::find(drives, name, &DriveElement::actuator);
    make_native(match.node(), read != drives.end() ? read->drive : drive::Drive{});
  }
  for (const auto& match : main.select_nodes("//sensor/plugin[@plugin='tribotwin.sensor']")) {
    pugi::xml_node sensor = match.node();
    const auto read = std::ranges::find(sensors, std::string(sensor.attribute("name").value()), &SensorElement::name);
    sensor.set_name("user");
    for (const char* attribute : {"plugin", "instance"}) sensor.remove_attribute(attribute);
    sensor.remove_children();
    sensor.append_attribute("dim") = static_cast<unsigned>(read->sensor.count);
    sensor.append_attribute("datatype") = "real";
    sensor.append_attribute("needstage") = "acc";
  }

  pugi::xml_node root = main.document_element();
  int user = 0;
  for (pugi::xml_node size : root.children("size")) {
    user = std::max(user, size.attribute("nuserdata").as_int());
    size.remove_attribute("nuserdata");
  }
  root.append_child("size").append_attribute("nuserdata") = user + user_size;

  make_asset_folders_absolute(main, folder);  // the text is read from memory
  return saved(main, origins);
}

Result<ModelPtr> compile(const std::string& mjcf, const std::string&, const std::filesystem::path&) {
  const auto vfs = std::make_unique<mjVFS>();
  mj_defaultVFS(vfs.get());
  const char* name = "tribotwin_lowered.xml";
  if (mj_makeEmptyFileVFS(vfs.get(), name, static_cast<int>(mjcf.size())) != 0)
    return tl::unexpected(std::string("the model text is too large"));
  std::memcpy(vfs->filedata[mj_findFileVFS(vfs.get(), name)], mjcf.data(), mjcf.size());
  char error[1000] = "";
  ModelPtr model(mj_loadXML(name, vfs.get(), error, sizeof error));
  mj_deleteVFS(vfs.get());
  if (!model) return tl::unexpected(std::string(error));
  return model;
}
#else
Result<ModelPtr> compile(const std::string& text, const std::string& file, const std::filesystem::path& folder) {
  char error[1000] = "";
  if (!file.empty()) {
    ModelPtr model(mj_loadXML(file.c_str(), nullptr, error, sizeof error));
    if (!model) return tl::unexpected(std::string(error));
    return model;
  }
  const auto vfs = std::make_unique<mjVFS>();
  mj_defaultVFS(vfs.get());
  const std::string name = (folder / "model.xml").string();
  mj_addBufferVFS(vfs.get(), name.c_str(), text.data(), static_cast<int>(text.size()));
  ModelPtr model(mj_loadXML(name.c_str(), vfs.get(), error, sizeof error));
  mj_deleteVFS(vfs.get());
  if (!model) return tl::unexpected(std::string(error));
  return model;
}

/// An error of the engine with the user's line. The engine says line 0 for included files, and a line may hold several
/// elements. The model is therefore compiled again with includes merged and one element per line. Changes `sources`.
std::string located(const std::string& error, const std::vector<Source>& sources, const std::string& name,
                    const std::filesystem::path& folder) {
  const Origins as_written(sources);
  Origins merged(sources);
  merge_includes(sources, folder, &merged);
  const auto again = compile(saved(*sources.front().document, merged), "", folder);
  const bool same = !again && without_position(again.error().message) == without_position(error);
  return same ? merged.located(again.error().message, name) : as_written.located(error, name);
}
#endif

/// The engine's number of an integrator. The engine is asked, because newer ones have more of them.
Result<int> integrator_of(const std::string& name) {
  const bool word = std::ranges::all_of(name, [](unsigned char c) { return std::isalnum(c) != 0; });
  if (word)
    if (const auto probe = compile(fmt::format("<mujoco><option integrator=\"{}\"/></mujoco>", name), "", "."))
      return (*probe)->opt.integrator;
  return tl::unexpected<Error>(
      fmt::format("integrator '{}' is not known to MuJoCo {}; Euler, implicit and RK4 are in every version, "
                  "implicitfast in 3.x, discrete from 3.13 on",
                  name, mj_versionString()));
}

Result<int> solver_of(const std::string& name) {
  constexpr std::pair<std::string_view, int> solvers[] = {
      {"Newton", mjSOL_NEWTON}, {"CG", mjSOL_CG}, {"PGS", mjSOL_PGS}};
  for (const auto& [known, solver] : solvers)
    if (known == name) return solver;
  return tl::unexpected<Error>(fmt::format("solver '{}' is not known; one of Newton, CG, PGS", name));
}

Result<void> apply(const Options& options, mjModel* m) {
  if (options.timestep_s) {
    if (!(*options.timestep_s >= shortest_timestep_s && *options.timestep_s <= longest_timestep_s))
      return tl::unexpected(fmt::format("time step {} s must be within {:g} .. {:g} s", *options.timestep_s,
                                        shortest_timestep_s, longest_timestep_s));
    m->opt.timestep = *options.timestep_s;
  }
  if (options.integrator) {
    const auto integrator = integrator_of(*options.integrator);
    if (!integrator) return tl::unexpected(integrator.error());
    m->opt.integrator = *integrator;
  }
  if (options.solver) {
    const auto solver = solver_of(*options.solver);
    if (!solver) return tl::unexpected(solver.error());
    m->opt.solver = *solver;
  }
  // A solver chosen here brings the accuracy that keeps a stuck joint still; one chosen in the file is checked instead.
  if (options.solver) {
    m->opt.tolerance = std::min(m->opt.tolerance, needed_tolerance(m->opt.solver));
    m->opt.iterations = std::max(m->opt.iterations, needed_iterations(m->opt.solver));
  }
  return {};
}

/// The engine accepts NaN in a model; a simulation must not start from it.
Result<void> require_finite(const mjModel* m) {
  const auto check =
      [m](int type, int count, const char* what,
          std::initializer_list<std::pair<const char*, std::span<const mjtNum>>> fields) -> Result<void> {
    for (int i = 0; i < count; ++i)
      for (const auto& [field, values] : fields) {
        const std::size_t width = values.size() / static_cast<std::size_t>(count);
        const auto own = values.subspan(static_cast<std::size_t>(i) * width, width);
        if (std::ranges::all_of(own, [](mjtNum x) { return std::isfinite(x); })) continue;
        const char* name = type >= 0 ? mj_id2name(m, type, i) : nullptr;
        return tl::unexpected(fmt::format("{} '{}': its {} is not finite ({})", what,
                                          name && *name ? name : std::to_string(i), field, fmt::join(own, " ")));
      }
    return {};
  };
  const auto span = [](const mjtNum* first, auto count) {
    return std::span<const mjtNum>(first, static_cast<std::size_t>(count));
  };
  if (auto ok = check(mjOBJ_BODY, static_cast<int>(m->nbody), "body",
                      {{"mass", span(m->body_mass, m->nbody)},
                       {"inertia", span(m->body_inertia, 3 * m->nbody)},
                       {"position", span(m->body_pos, 3 * m->nbody)},
                       {"centre of mass", span(m->body_ipos, 3 * m->nbody)},
                       {"orientation", span(m->body_quat, 4 * m->nbody)}});
      !ok)
    return ok;
  if (m->njnt > 0)
    if (auto ok = check(mjOBJ_JOINT, static_cast<int>(m->njnt), "joint",
                        {{"axis", span(m->jnt_axis, 3 * m->njnt)},
                         {"anchor", span(m->jnt_pos, 3 * m->njnt)},
                         {"range", span(m->jnt_range, 2 * m->njnt)},
                         {"stiffness", span(m->jnt_stiffness, m->njnt)}});
        !ok)
      return ok;
  if (m->nv > 0)
    if (auto ok = check(-1, static_cast<int>(m->nv), "dof",
                        {{"armature", span(m->dof_armature, m->nv)},
                         {"damping", span(m->dof_damping, m->nv)},
                         {"frictionloss", span(m->dof_frictionloss, m->nv)},
                         {"solreffriction", span(m->dof_solref, mjNREF * m->nv)},
                         {"solimpfriction", span(m->dof_solimp, mjNIMP * m->nv)}});
        !ok)
      return ok;
  if (const int actuators = engine::actuator_count(m); actuators > 0)
    if (auto ok = check(mjOBJ_ACTUATOR, actuators, "actuator", {{"gear", span(m->actuator_gear, 6 * actuators)}}); !ok)
      return ok;
  if (m->nkey > 0)
    if (auto ok = check(mjOBJ_KEY, static_cast<int>(m->nkey), "keyframe",
                        {{"qpos", span(m->key_qpos, m->nkey * m->nq)}, {"qvel", span(m->key_qvel, m->nkey * m->nv)}});
        !ok)
      return ok;
  return check(-1, 1, "option",
               {{"gravity", span(m->opt.gravity, 3)},
                {"timestep", span(&m->opt.timestep, 1)},
                {"tolerance", span(&m->opt.tolerance, 1)}});
}

Loaded compile_and_bind(const std::string& name, const std::string& text, const std::string& file,
                        const std::filesystem::path& folder, const Options& options) {
  auto sources = read_sources(name, text, folder);
  if (!sources) return tl::unexpected(sources.error());
  if (auto ok = check_extensions(*sources); !ok) return tl::unexpected(ok.error());
  auto drives = read_drives(*sources);
  if (!drives) return tl::unexpected(drives.error());
  auto springs = read_springs(*sources, *drives);
  if (!springs) return tl::unexpected(springs.error());
  auto sensors = read_sensors(*sources, *drives);
  if (!sensors) return tl::unexpected(sensors.error());
#if TRIBOTWIN_ENGINE_PLUGINS
  auto compiled = compile(text, file, folder);
  if (!compiled) return tl::unexpected(located(compiled.error().message, *sources, name, folder));
#else
  Origins origins(*sources);
  auto compiled =
      compile(lower(*sources, folder, user_size(*drives, *springs), *drives, *sensors, origins), file, folder);
  if (!compiled) return tl::unexpected(origins.located(compiled.error().message, name));
#endif
  mjModel* m = compiled->get();
  if (auto ok = require_finite(m); !ok) return tl::unexpected(fmt::format("{}: {}", name, ok.error().message));
  if (auto ok = apply(options, m); !ok) return tl::unexpected(fmt::format("{}: {}", name, ok.error().message));

  std::vector<Binding> bindings;
  std::map<int, std::string> instance_of;  // by actuator
  [[maybe_unused]] int address = static_cast<int>(m->nuserdata) - user_size(*drives, *springs);
  for (DriveElement& element : *drives) {
    const int actuator = mj_name2id(m, mjOBJ_ACTUATOR, element.actuator.c_str());
    auto binding = bind(m, std::move(element.drive), actuator);
    if (!binding) return tl::unexpected(fmt::format("{}: {}", element.where, binding.error().message));
#if TRIBOTWIN_ENGINE_PLUGINS
    binding->state_address = m->actuator_actadr[actuator];
    const auto before = std::count(m->actuator_plugin, m->actuator_plugin + actuator, m->actuator_plugin[actuator]);
    binding->workspace_address = m->plugin_stateadr[m->actuator_plugin[actuator]] +
                                 static_cast<int>(before) * static_cast<int>(drive::workspace_size);
#else
    binding->state_address = address;
    binding->workspace_address = address + static_cast<int>(drive::state_size(binding->drive));
    address = binding->workspace_address + static_cast<int>(drive::workspace_size);
#endif
    instance_of[actuator] = element.instance;
    bindings.push_back(std::move(*binding));
  }
  std::ranges::sort(bindings, {}, &Binding::actuator);

  std::vector<NamedDrive> named;
  for (const Binding& b : bindings) named.push_back({instance_of.at(b.actuator), b.joint});
  std::vector<Spring> bound_springs;
  for (SpringElement& element : *springs) {
    const int actuator = mj_name2id(m, mjOBJ_ACTUATOR, element.actuator.c_str());
    const auto drive = drive_of(m, element.hysteresis, actuator, named);
    if (!drive) return tl::unexpected(fmt::format("{}: {}", element.where, drive.error().message));
    auto spring = bind_spring(m, std::move(element.hysteresis), bindings[*drive], actuator);
    if (!spring) return tl::unexpected(fmt::format("{}: {}", element.where, spring.error().message));
#if TRIBOTWIN_ENGINE_PLUGINS
    spring->state_address = m->actuator_actadr[actuator];
    spring->workspace_address = m->plugin_stateadr[m->actuator_plugin[actuator]];
#else
    spring->state_address = address;
    spring->workspace_address = address + static_cast<int>(spring_state_size);
    address = spring->workspace_address + static_cast<int>(spring_workspace_size);
#endif
    bound_springs.push_back(std::move(*spring));
  }
  std::vector<Sensor> bound_sensors;
  for (const SensorElement& element : *sensors) {
    Sensor sensor = element.sensor;
    sensor.address = m->sensor_adr[mj_name2id(m, mjOBJ_SENSOR, element.name.c_str())];
    const int actuator = mj_name2id(m, mjOBJ_ACTUATOR, element.actuator.c_str());
    sensor.drive = static_cast<int>(std::ranges::find(bindings, actuator, &Binding::actuator) - bindings.begin());
    bound_sensors.push_back(sensor);
  }
  return std::make_shared<const Model>(std::move(*compiled), std::move(bindings), std::move(bound_springs),
                                       std::move(bound_sensors));
}

Loaded load(const std::string& name, const std::string& text, const std::string& file,
            const std::filesystem::path& folder, const Options& options) {
  const MemoryCheck memory;
  auto loaded = compile_and_bind(name, text, file, folder, options);
  memory.pass();
  return loaded;
}

}  // namespace

Model::Model(ModelPtr model, std::vector<Binding> drives, std::vector<Spring> springs, std::vector<Sensor> sensors)
    : model_(std::move(model)),
      drives_(std::move(drives)),
      springs_(std::move(springs)),
      sensors_(std::move(sensors)),
      registration_(model_.get(), drives_, springs_, sensors_) {}

DataPtr Model::make_data() const { return DataPtr(mj_makeData(model_.get())); }

Loaded load_file(const std::filesystem::path& file, const Options& options) {
  const auto text = read_text(file);
  if (!text) return tl::unexpected(text.error());
  return load(file.string(), *text, file.string(), file.has_parent_path() ? file.parent_path() : ".", options);
}

Loaded load_string(std::string_view mjcf, const Options& options, const std::filesystem::path& folder) {
  return load("model", std::string(mjcf), "", folder, options);
}

Loaded variant(const Model& model, const std::function<void(mjModel*)>& change) {
  ModelPtr copy(mj_copyModel(nullptr, model.get()));
  change(copy.get());
  const DataPtr scratch_data(mj_makeData(copy.get()));
  mj_setConst(copy.get(), scratch_data.get());
  std::vector<Binding> bindings;
  for (const Binding& original : model.drives()) {
    auto binding = bind(copy.get(), original.drive, original.actuator);
    if (!binding) return tl::unexpected(binding.error());
    binding->state_address = original.state_address;
    binding->workspace_address = original.workspace_address;
    bindings.push_back(std::move(*binding));
  }
  std::vector<Spring> springs;
  for (const Spring& original : model.springs()) {
    const Binding drive = *std::ranges::find(bindings, original.drive.actuator, &Binding::actuator);
    auto spring = bind_spring(copy.get(), original.hysteresis, drive, original.actuator);
    if (!spring) return tl::unexpected(spring.error());
    spring->state_address = original.state_address;
    spring->workspace_address = original.workspace_address;
    springs.push_back(std::move(*spring));
  }
  return std::make_shared<const Model>(std::move(copy), std::move(bindings), std::move(springs),
                                       std::vector(model.sensors().begin(), model.sensors().end()));
}

}  // namespace tribotwin::mujoco
