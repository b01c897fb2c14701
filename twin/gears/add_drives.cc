#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/source.hpp>
#include <tribotwin/twin/gears/add_drives.hpp>
#include <tribotwin/twin/gears/drive_elements.hpp>
#include <tribotwin/twin/gears/effort.hpp>
#include <tribotwin/twin/gears/gear_class.hpp>
#include <tribotwin/twin/gears/scene.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/starting_points.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

/// Time steps above it lose the energy balance at reversals [s].
constexpr double longest_useful_s = 0.002;
/// A class that is scaled by more, or by less than its inverse, says nothing about its joint.
constexpr double most_scale = 3;
/// A joint whose effort is this many times the torque of its gear would break it.
constexpr double too_small = 1.5;

/// A joint with what it gets, before anything is written.
struct Plan {
  int joint = -1;
  std::vector<int> actuators;  ///< the first becomes the drive, the others go
  Effort effort;
  double gravity_nm = 0;  ///< the largest in the joint's range
  double scale = 1;       ///< of the gear class
  std::string instance;
  drive::Drive drive;
  drive::Configuration keys;
  AddedDrive added;
};

std::string name_of(const mjModel* m, int type, int id) {
  const char* name = id >= 0 ? mj_id2name(m, type, id) : nullptr;
  return name ? name : "";
}

bool can_have_drive(const mjModel* m, int joint) {
  return m->jnt_type[joint] == mjJNT_HINGE || m->jnt_type[joint] == mjJNT_SLIDE;
}

std::string joint_names(const mjModel* m) {
  std::vector<std::string> names;
  for (int j = 0; j < m->njnt; ++j)
    if (can_have_drive(m, j)) names.push_back(name_of(m, mjOBJ_JOINT, j));
  return fmt::format("{}", fmt::join(names, ", "));
}

/// Why a joint cannot have a drive, or nothing.
std::string obstacle(const mjModel* m, int joint) {
  if (!can_have_drive(m, joint))
    return m->jnt_type[joint] == mjJNT_BALL
               ? "is a ball joint, but a drive needs a hinge or a slide; model it as three "
                 "hinges"
               : "is a free joint, but a drive needs a hinge or a slide";
  if (const int a = tendon_actuator_of(m, joint); a >= 0)
    return fmt::format(
        "is moved by actuator '{}' through a tendon; choose other joints, or give the joint an actuator "
        "of its own in the model",
        name_of(m, mjOBJ_ACTUATOR, a));
  return {};
}

/// Nameless joints get names in the document, which actuators need; both order by the engine's rules.
Result<void> name_joints(ForeignModel& foreign) {
  const mjModel* m = foreign.model->get();
  const auto elements = joint_elements(*foreign.document);
  bool changed = false;
  for (int j = 0; j < m->njnt; ++j) {
    if (!name_of(m, mjOBJ_JOINT, j).empty() || !can_have_drive(m, j)) continue;
    if (static_cast<int>(elements.size()) != m->njnt)
      return tl::unexpected(fmt::format("{}: joint {} has no name; give it one", foreign.files.front().string(), j));
    std::string name = fmt::format("joint{}", j + 1);
    while (mj_name2id(m, mjOBJ_JOINT, name.c_str()) >= 0) name += "_";
    pugi::xml_node element = elements[static_cast<std::size_t>(j)];
    set_attribute(element, "name", name);
    foreign.notes.push_back(fmt::format("joint {} had no name; it is '{}' now", j, name));
    changed = true;
  }
  if (!changed) return {};
  auto named = mujoco::load_string(mujoco::text_of(*foreign.document));
  if (!named) return tl::unexpected(named.error());
  foreign.model = *named;
  return {};
}

/// The joints that were asked for, or all that are moved; with the gear of each.
Result<std::vector<std::pair<int, std::string>>> chosen_joints(const ForeignModel& foreign, const AddDrives& choice) {
  const mjModel* m = foreign.model->get();
  const std::string file = foreign.files.front().string();
  std::vector<std::pair<int, std::string>> chosen;
  for (const JointChoice& c : choice.joints) {
    const int joint = mj_name2id(m, mjOBJ_JOINT, c.joint.c_str());
    if (joint < 0)
      return tl::unexpected(
          fmt::format("{}: has no joint '{}'; its hinges and slides are: {}", file, c.joint, joint_names(m)));
    if (const auto why = obstacle(m, joint); !why.empty())
      return tl::unexpected(fmt::format("{}: joint '{}' {}", file, c.joint, why));
    if (std::ranges::find(chosen, joint, &std::pair<int, std::string>::first) != chosen.end())
      return tl::unexpected(fmt::format("joint '{}' is chosen twice; choose it once", c.joint));
    chosen.emplace_back(joint, c.gear);
  }
  if (!choice.joints.empty()) return chosen;
  bool any_actuator = false;
  for (int j = 0; j < m->njnt; ++j)
    if (can_have_drive(m, j)) any_actuator = any_actuator || !actuators_of(m, j).empty();
  for (int j = 0; j < m->njnt; ++j)
    if (obstacle(m, j).empty() && (!any_actuator || !actuators_of(m, j).empty())) chosen.emplace_back(j, "");
  if (!chosen.empty()) return chosen;
  const bool none = joint_names(m).empty();
  return tl::unexpected(fmt::format(
      "{}: {}", file,
      m->njnt == 0 ? "has no joints, so there is nothing to drive"
      : none       ? "has neither hinges nor slides, and drives need one of them"
                   : "its joints are all moved through tendons; give joints an actuator of their own in the model"));
}

/// An effort must be of a joint that gets a drive.
Result<void> check_efforts(const mjModel* m, const std::vector<std::pair<int, std::string>>& chosen,
                           const AddDrives& choice) {
  std::vector<std::string> names;
  for (const auto& c : chosen) names.push_back(name_of(m, mjOBJ_JOINT, c.first));
  for (const auto& [joint, effort] : choice.effort_nm.named())
    if (std::ranges::find(names, joint) == names.end())
      return tl::unexpected(fmt::format("--effort {}={:g}: '{}' gets no drive; joints that get one: {}", joint, effort,
                                        joint, twin::joined(names)));
  return {};
}

/// Parameters must be of a hinge that gets a drive.
Result<void> check_identified(const mjModel* m, const std::vector<std::pair<int, std::string>>& chosen,
                              const AddDrives& choice) {
  for (const IdentifiedParameters& i : choice.identified) {
    if (i.joint.empty()) continue;
    const int joint = mj_name2id(m, mjOBJ_JOINT, i.joint.c_str());
    if (std::ranges::find(chosen, joint, &std::pair<int, std::string>::first) == chosen.end()) {
      std::vector<std::string> names;
      for (const auto& c : chosen) names.push_back(name_of(m, mjOBJ_JOINT, c.first));
      return tl::unexpected(fmt::format("--params {}={}: '{}' gets no drive; joints that get one: {}", i.joint, i.file,
                                        i.joint, twin::joined(names)));
    }
    if (m->jnt_type[joint] == mjJNT_SLIDE)
      return tl::unexpected(fmt::format(
          "--params {}={}: '{}' is a slide, and identified parameters are in Nm of a hinge", i.joint, i.file, i.joint));
  }
  return {};
}

/// The drive of a joint: identified parameters where the user gave them, else those of the class.
Result<void> choose_parameters(Plan& p, const GearClass& gear, double scale, const AddDrives& choice) {
  p.keys = configuration_of(gear, scale);
  p.added.parameters = description(gear, scale);
  p.added.source = gear.source;
  p.added.speed_max_rad_s = gear.speed_max_rad_s;
  auto starter = drive::make_drive(p.instance, p.keys);
  if (!starter) return tl::unexpected(fmt::format("gear class {}: {}", gear.name, starter.error().message));
  for (const IdentifiedParameters& i : choice.identified) {
    if (!i.joint.empty() && i.joint != p.added.joint) continue;
    if (i.joint.empty() && gear.linear) continue;  // identified in Nm, of a hinge
    auto parameters = i.parameters;
    if (!(parameters.torque_max_nm > 0)) parameters.torque_max_nm = starter->torque_max_nm;
    if (!(parameters.gear_ratio > 0)) parameters.gear_ratio = starter->gear_ratio;
    auto drive = identification::drive_of(parameters, p.instance);
    if (!drive) return tl::unexpected(fmt::format("{}: {}", i.file, drive.error().message));
    drive->thermal = starter->thermal;
    p.keys = drive::configuration_of(*drive);
    p.added.parameters = i.file + ", heat of " + std::string(gear.name);
    p.added.source = "identified";
    starter = drive::make_drive(p.instance, p.keys);
    if (!starter) return tl::unexpected(fmt::format("{}: {}", i.file, starter.error().message));
    if (!i.joint.empty()) break;
  }
  p.drive = *starter;
  return {};
}

Effort chosen_effort(const ForeignModel& foreign, int joint, const Loads& loads, const AddDrives& choice) {
  const auto given = choice.effort_nm.find(name_of(foreign.model->get(), mjOBJ_JOINT, joint));
  return given ? effort_given(*given) : effort_of(foreign, joint, loads);
}

Result<Plan> plan(const ForeignModel& foreign, int joint, const std::string& gear, const Loads& loads,
                  const AddDrives& choice) {
  const mjModel* m = foreign.model->get();
  const int dof = m->jnt_dofadr[joint];
  const bool floating = m->jnt_type[std::max(0, m->body_jntadr[m->body_rootid[m->jnt_bodyid[joint]]])] == mjJNT_FREE;
  Plan p{.joint = joint, .actuators = actuators_of(m, joint), .effort = chosen_effort(foreign, joint, loads, choice)};
  AddedDrive& a = p.added;
  a.joint = p.instance = name_of(m, mjOBJ_JOINT, joint);
  a.slide = m->jnt_type[joint] == mjJNT_SLIDE;
  a.effort_nm = p.effort.largest_nm();
  a.effort_source = p.effort.source;
  std::string name = !gear.empty() ? gear : choice.gear;
  if (name.empty() || (a.slide && gear.empty())) name = usual_family(a.effort_nm, a.slide, floating);
  const auto found = find_gear_class(name, a.effort_nm);
  if (!found) return tl::unexpected(fmt::format("joint '{}': {}", a.joint, found.error().message));
  const GearClass& g = **found;
  if (g.linear != a.slide)
    return tl::unexpected(
        fmt::format("joint '{}' is a {}, but gear class '{}' is for {}; `tribotwin list gears` shows "
                    "all",
                    a.joint, a.slide ? "slide" : "hinge", name, g.linear ? "slides" : "hinges"));
  p.scale = name == g.family ? a.effort_nm / g.torque_max_nm : 1;
  p.gravity_nm = loads.gravity_nm[static_cast<std::size_t>(dof)];
  if (const auto ok = choose_parameters(p, g, p.scale, choice); !ok) return tl::unexpected(ok.error());

  a.gear_ratio = p.drive.gear_ratio;
  const auto limit = foreign.limits.find(a.joint);
  if (limit != foreign.limits.end() && limit->second.speed_rad_s > 0)
    a.speed_max_rad_s = std::min(a.speed_max_rad_s, limit->second.speed_rad_s);
  a.armature_of_model = m->dof_armature[dof] > 0;
  a.armature = a.armature_of_model ? m->dof_armature[dof]
                                   : g.rotor_inertia_kg_m2 * p.scale * p.drive.gear_ratio * p.drive.gear_ratio;
  a.removed_damping = m->dof_damping[dof];
  a.removed_frictionloss = m->dof_frictionloss[dof];
  return p;
}

/// " of masses that are all 2 kg", which nobody measured; empty where they differ.
std::string equal_masses(const mjModel* m, int joint) {
  const int root = m->body_rootid[m->jnt_bodyid[joint]];
  double low = 1e300, high = 0;
  int count = 0;
  for (int body = 1; body < m->nbody; ++body)
    if (const double mass = m->body_mass[body]; m->body_rootid[body] == root && mass > 0)
      low = std::min(low, mass), high = std::max(high, mass), ++count;
  return count >= 3 && high - low < 1e-9 * high ? fmt::format(" of masses that are all {:.4g} kg", high) : "";
}

/// Efforts that nobody gave, one sentence for all joints.
void doubt_efforts(const mjModel* m, const std::vector<Plan>& plans, std::vector<std::string>& warnings) {
  std::vector<std::string> guesses;
  const Plan* first = nullptr;
  for (const Plan& p : plans) {
    if (!p.effort.estimated) continue;
    if (!first) first = &p;
    guesses.push_back(fmt::format("{} {:.4g} {}", p.added.joint, p.added.effort_nm, p.added.slide ? "N" : "Nm"));
  }
  if (!first) return;
  warnings.push_back(fmt::format(
      "the model gives no usable effort, and gear, friction and torque limits follow from a guess by gravity and "
      "inertia{}: {}; give the torques of the real drives: --effort {}={}",
      equal_masses(m, first->joint), twin::joined(guesses), first->added.joint, first->added.slide ? "N" : "NM"));
}

/// Classes that say nothing about joints of this size, one sentence for all joints.
void doubt_scales(const std::vector<Plan>& plans, std::vector<std::string>& warnings) {
  std::vector<std::string> far;
  const Plan* first = nullptr;
  for (const Plan& p : plans) {
    if (!p.added.is_starting_point() || (p.scale >= 1 / most_scale && p.scale <= most_scale)) continue;
    if (!first) first = &p;
    far.push_back(fmt::format("{} ({})", p.added.joint, p.added.parameters));
  }
  if (!first) return;
  warnings.push_back(
      fmt::format("no drive of this size is in the table, and friction that is scaled so far is hardly a guess: {}; "
                  "check the efforts, give them by --effort {}={}, or another class by --joint {}=CLASS",
                  twin::joined(far), first->added.joint, first->added.slide ? "N" : "NM", first->added.joint));
}

/// A gear that is too weak for its joint.
void doubt_gear(const Plan& p, std::vector<std::string>& warnings) {
  const AddedDrive& a = p.added;
  const char* unit = a.slide ? "N" : "Nm";
  const double torque = p.drive.torque_max_nm;
  if (torque * too_small < a.effort_nm)
    warnings.push_back(
        fmt::format("{}: {} is made for {:.4g} {}, but the joint's effort is {:.4g} {} ({}): the gear is too small; "
                    "choose a larger class, or its family, which is scaled",
                    a.joint, a.parameters, torque, unit, a.effort_nm, unit, a.effort_source));
  if (const double able = std::min(torque, a.effort_nm); p.gravity_nm > able)
    warnings.push_back(
        fmt::format("{}: gravity alone needs up to {:.4g} {} in the joint's range, but {} {:.4g} {}; choose a larger "
                    "class, or give the effort of the real drive by --effort {}={}",
                    a.joint, p.gravity_nm, unit, torque < a.effort_nm ? a.parameters + " has" : "its effort is", able,
                    unit, a.joint, a.slide ? "N" : "NM"));
}

/// The elements of all <actuator> sections, in the engine's order.
std::vector<pugi::xml_node> actuator_elements(const pugi::xml_document& document) {
  std::vector<pugi::xml_node> elements;
  for (const pugi::xml_node section : document.document_element().children("actuator"))
    for (const pugi::xml_node element : section.children())
      if (element.type() == pugi::node_element) elements.push_back(element);
  return elements;
}

/// A section that exists, or a new one at the end.
pugi::xml_node section(pugi::xml_document& document, const char* name) {
  pugi::xml_node root = document.document_element(), found = root.child(name);
  return found ? found : root.append_child(name);
}

pugi::xml_node last_section(pugi::xml_document& document, const char* name) {
  pugi::xml_node last;
  for (const pugi::xml_node s : document.document_element().children(name)) last = s;
  return last ? last : section(document, name);
}

/// An attribute that several sections may set: the engine takes the last.
void set_everywhere(pugi::xml_document& document, const char* name, const char* attribute, const std::string& value) {
  for (pugi::xml_node s : document.document_element().children(name)) s.remove_attribute(attribute);
  set_attribute(section(document, name), attribute, value);
}

std::string comment_of(const AddedDrive& a) {
  const std::string unit = unit_of("Nm", a.slide);
  std::string text = fmt::format(" {}: {}; effort {:.4g} {} ({}); armature {:.4g} {}. Source: {}. ", a.joint,
                                 a.parameters, a.effort_nm, unit, a.effort_source, a.armature,
                                 a.armature_of_model ? "of the model" : "from the rotor of the class", a.source);
  for (std::size_t at; (at = text.find("--")) != text.npos;) text.replace(at, 2, "- ");  // ends a comment
  return text;
}

void write_instances(pugi::xml_document& document, const std::vector<Plan>& plans) {
  pugi::xml_node root = document.document_element();
  pugi::xml_node extension = root.child("extension");
  if (!extension) extension = root.prepend_child("extension");
  pugi::xml_node plugin = extension.append_child("plugin");
  set_attribute(plugin, "plugin", "tribotwin.drive");
  for (const Plan& p : plans) {
    plugin.append_child(pugi::node_comment).set_value(comment_of(p.added).c_str());
    append_instance(plugin, p.instance, p.keys);
  }
}

Result<void> write_joints(pugi::xml_document& document, const mjModel* m, const std::vector<Plan>& plans) {
  const auto elements = joint_elements(document);
  for (const Plan& p : plans) {
    const auto named = std::ranges::find_if(
        elements, [&](const pugi::xml_node& e) { return p.added.joint == e.attribute("name").value(); });
    if (named == elements.end())
      return tl::unexpected(
          fmt::format("joint '{}' is not written as a <joint> of its own (replicated or attached); "
                      "save the model from the engine's viewer and take that file",
                      p.added.joint));
    pugi::xml_node element = *named;
    make_drive_joint(element);
    set_attribute(element, "armature", fmt::format("{:.6g}", p.added.armature));
    if (mujoco::engine::compensates_gravity(m, p.joint)) set_attribute(element, "actuatorgravcomp", "false");
  }
  return {};
}

/// Replaces the actuators; returns which of the old ones are gone.
Result<std::vector<bool>> write_actuators(pugi::xml_document& document, const mjModel* m, std::vector<Plan>& plans,
                                          std::vector<std::string>& notes) {
  const auto elements = actuator_elements(document);
  const auto count = static_cast<std::size_t>(mujoco::engine::actuator_count(m));
  if (elements.size() != count)
    return tl::unexpected(
        fmt::format("the model has {} actuators, but its text shows {}; save the model from the "
                    "engine's viewer and take that file",
                    count, elements.size()));
  std::vector<bool> gone(count);
  for (Plan& p : plans) {
    pugi::xml_node element;
    std::string name;
    if (p.actuators.empty()) {
      element = last_section(document, "actuator").append_child("plugin");
    } else {
      const auto first = static_cast<std::size_t>(p.actuators.front());
      element = elements[first];
      name = name_of(m, mjOBJ_ACTUATOR, p.actuators.front());
      p.added.replaced = element.name();
    }
    if (name.empty()) name = p.added.joint;
    if (p.actuators.empty() || name_of(m, mjOBJ_ACTUATOR, p.actuators.front()).empty())
      while (mj_name2id(m, mjOBJ_ACTUATOR, name.c_str()) >= 0) name += "_drive";
    p.added.actuator = name;
    make_drive_actuator(element, name, p.added.joint, p.instance, drive::state_size(p.drive));
    set_attribute(element, "gear", "1");
    set_attribute(element, "ctrllimited", "true");
    set_attribute(element, "ctrlrange", fmt::format("{:.6g} {:.6g}", p.effort.low_nm, p.effort.high_nm));
    set_attribute(element, "forcelimited", "false");
    for (std::size_t i = 1; i < p.actuators.size(); ++i) {
      const auto other = static_cast<std::size_t>(p.actuators[i]);
      gone[other] = true;
      notes.push_back(fmt::format("joint '{}': its {} '{}' is gone as well, a joint has one drive", p.added.joint,
                                  elements[other].name(), name_of(m, mjOBJ_ACTUATOR, p.actuators[i])));
      pugi::xml_node(elements[other]).parent().remove_child(elements[other]);
    }
  }
  return gone;
}

std::string numbers(const std::vector<double>& values) {
  std::string text;
  for (const double x : values) text += fmt::format("{}{:.10g}", text.empty() ? "" : " ", x);
  return text;
}

/// Free joints of the trees that have drives go; `freed` marks the places in qpos and in qvel that go with them.
struct Freed {
  std::vector<bool> position, speed;
  int count = 0;
};
Result<Freed> fix_bases(pugi::xml_document& document, const mjModel* m, const std::vector<Plan>& plans, bool fix) {
  Freed freed{.position = std::vector<bool>(m->nq), .speed = std::vector<bool>(m->nv)};
  if (!fix) return freed;
  const auto elements = joint_elements(document);
  if (static_cast<int>(elements.size()) != m->njnt)
    return tl::unexpected<Error>("--fix-base needs every joint as an element of its own in the file");
  for (int j = 0; j < m->njnt; ++j) {
    const bool base = m->jnt_type[j] == mjJNT_FREE && std::ranges::any_of(plans, [&](const Plan& p) {
                        return m->body_rootid[m->jnt_bodyid[p.joint]] == m->body_rootid[m->jnt_bodyid[j]];
                      });
    if (!base) continue;
    for (int k = 0; k < 7; ++k) freed.position[m->jnt_qposadr[j] + k] = true;
    for (int k = 0; k < 6; ++k) freed.speed[m->jnt_dofadr[j] + k] = true;
    pugi::xml_node element = elements[static_cast<std::size_t>(j)];
    element.parent().remove_child(element);
    ++freed.count;
  }
  return freed;
}

/// Keyframes keep poses; controls of drives become the torque that carries the pose. Activations go: those of drives
/// exist on one engine only.
void write_keyframes(pugi::xml_document& document, const mjModel* m, const std::vector<Plan>& plans,
                     const std::vector<bool>& gone, const Freed& freed, std::vector<std::string>& notes) {
  const mujoco::DataPtr data(mj_makeData(m));
  int id = 0;
  bool had_activations = false;
  for (const auto& match : document.select_nodes("/mujoco/keyframe/key")) {
    pugi::xml_node key = match.node();
    mju_copy(data->qpos, m->key_qpos + id * m->nq, static_cast<int>(m->nq));
    mju_zero(data->qvel, static_cast<int>(m->nv));
    mj_forward(m, data.get());
    std::vector<double> controls, positions, speeds;
    for (int a = 0; a < mujoco::engine::actuator_count(m); ++a) {
      if (gone[static_cast<std::size_t>(a)]) continue;
      const int address = mujoco::engine::control_address(m, a);
      double control = m->key_ctrl[id * m->nu + address];
      for (const Plan& p : plans)
        if (!p.actuators.empty() && p.actuators.front() == a) {
          const int dof = m->jnt_dofadr[p.joint];
          control =
              std::clamp<double>(data->qfrc_bias[dof] - data->qfrc_passive[dof], p.effort.low_nm, p.effort.high_nm);
        }
      controls.push_back(control);
    }
    for (const Plan& p : plans)
      if (p.actuators.empty()) {
        const int dof = m->jnt_dofadr[p.joint];
        controls.push_back(std::clamp<double>(data->qfrc_bias[dof], p.effort.low_nm, p.effort.high_nm));
      }
    for (int i = 0; i < m->nq; ++i)
      if (!freed.position[i]) positions.push_back(m->key_qpos[id * m->nq + i]);
    for (int i = 0; i < m->nv; ++i)
      if (!freed.speed[i]) speeds.push_back(m->key_qvel[id * m->nv + i]);
    set_attribute(key, "ctrl", numbers(controls));
    if (freed.count > 0) {
      if (key.attribute("qpos")) set_attribute(key, "qpos", numbers(positions));
      if (key.attribute("qvel")) set_attribute(key, "qvel", numbers(speeds));
    }
    had_activations = had_activations || key.attribute("act");
    key.remove_attribute("act");
    ++id;
  }
  if (had_activations)
    notes.emplace_back("keyframes start with activations of 0: those of drives exist on MuJoCo 3 only");
  if (id > 0) notes.emplace_back("keyframes: controls of drives are the torques that carry the pose");
}

/// Solver and flags as the loader of drives wants them.
void write_options(pugi::xml_document& document, const mjModel* m, std::vector<std::string>& notes) {
  const double tolerance = m->opt.solver == mjSOL_CG ? 1e-12 : 1e-10;
  if (m->opt.tolerance > tolerance) {
    set_everywhere(document, "option", "tolerance", fmt::format("{:g}", tolerance));
    notes.push_back(fmt::format("solver tolerance {:g} instead of {:g}, so that a stuck joint does not creep",
                                tolerance, m->opt.tolerance));
  }
  if (m->opt.iterations < 100) {
    set_everywhere(document, "option", "iterations", "100");
    notes.push_back(fmt::format("solver iterations 100 instead of {}", m->opt.iterations));
  }
  if (m->opt.timestep > longest_useful_s) {
    set_everywhere(document, "option", "timestep", fmt::format("{:g}", longest_useful_s));
    notes.push_back(fmt::format("time step {:g} s instead of {:g} s: friction is evaluated once per step",
                                longest_useful_s, m->opt.timestep));
  }
  constexpr std::pair<int, const char*> flags[] = {
      {mjDSBL_FRICTIONLOSS, "frictionloss"}, {mjDSBL_CONSTRAINT, "constraint"}, {mjDSBL_ACTUATION, "actuation"}};
  for (const auto& [bit, name] : flags) {
    if (!(m->opt.disableflags & bit)) continue;
    for (const auto& match : document.select_nodes("/mujoco/option/flag")) match.node().remove_attribute(name);
    notes.push_back(fmt::format("flag {} is enabled: friction needs it", name));
  }
}

void write_speeds(pugi::xml_document& document, const std::vector<Plan>& plans) {
  for (const auto& match : document.select_nodes("/mujoco/custom/numeric[@name='joint_speed_max_rad_s']"))
    match.node().parent().remove_child(match.node());
  std::vector<double> speeds;
  for (const Plan& p : plans) speeds.push_back(p.added.speed_max_rad_s);
  pugi::xml_node numeric = section(document, "custom").append_child("numeric");
  set_attribute(numeric, "name", "joint_speed_max_rad_s");
  set_attribute(numeric, "data", numbers(speeds));
}

/// So that a run can say that its friction is a guess.
void write_starting_points(pugi::xml_document& document, const std::vector<Plan>& plans) {
  for (const Plan& p : plans) {
    if (!p.added.is_starting_point()) continue;
    pugi::xml_node text = section(document, "custom").append_child("text");
    set_attribute(text, "name", starting_point_name(p.added.joint));
    set_attribute(text, "data", p.added.parameters);
  }
}

void write_title(pugi::xml_document& document, const fs::path& file, bool starters) {
  std::string text = fmt::format(" Drives added by tribotwin to {}.", file.filename().string());
  if (starters) text += fmt::format(" Attention: {}.", starting_points);
  pugi::xml_node root = document.document_element();
  root.prepend_child(pugi::node_comment).set_value((text + " ").c_str());
}

/// Stiction gets as stiff as the time step allows: the engine holds the time constant above two of them.
void stiffen(pugi::xml_document& document, const std::vector<Plan>& plans, double timestep_s) {
  if (timestep_s >= 5e-4) return;
  for (pugi::xml_node element : joint_elements(document))
    for (const Plan& p : plans)
      if (p.added.joint == element.attribute("name").value())
        set_attribute(element, "solreffriction", fmt::format("{:g} 1", 2 * timestep_s));
}

/// Loads the document; a time step that is too long for the friction of a light joint is halved until it is not.
Result<std::shared_ptr<const mujoco::Model>> checked(pugi::xml_document& document, const std::vector<Plan>& plans,
                                                     double timestep_s, const fs::path& folder,
                                                     std::vector<std::string>& notes, std::string& mjcf) {
  const double asked_s = timestep_s;
  for (;; timestep_s /= 2) {
    if (timestep_s < asked_s) {
      set_everywhere(document, "option", "timestep", fmt::format("{:g}", timestep_s));
      stiffen(document, plans, timestep_s);
    }
    mjcf = mujoco::text_of(document, no_declaration);
    auto model = mujoco::load_string(mjcf, {}, folder);
    const bool too_long = !model && model.error().message.find("time step") != std::string::npos;
    if (too_long && timestep_s > 5e-5) continue;
    if (model && timestep_s < asked_s)
      notes.push_back(fmt::format("time step {:g} s instead of {:g} s, for the friction of the lightest joint",
                                  timestep_s, asked_s));
    return model;
  }
}

}  // namespace

Result<RobotWithDrives> add_drives(const fs::path& file, const AddDrives& choice, const fs::path& folder) {
  auto foreign = read_foreign_model(file);
  if (!foreign) return tl::unexpected(foreign.error());
  if (const auto ok = name_joints(*foreign); !ok) return tl::unexpected(ok.error());
  const auto joints = chosen_joints(*foreign, choice);
  if (!joints) return tl::unexpected(joints.error());
  const mjModel* m = foreign->model->get();
  if (const auto ok = check_identified(m, *joints, choice); !ok) return tl::unexpected(ok.error());
  if (const auto ok = check_efforts(m, *joints, choice); !ok) return tl::unexpected(ok.error());
  pugi::xml_document& document = *foreign->document;
  const auto failed = [&](const Error& e) {
    return tl::unexpected(Error(fmt::format("{}: {}", file.string(), e.message), e.kind));
  };

  const Loads loads = loads_of(m);
  std::vector<Plan> plans;
  for (const auto& [joint, gear] : *joints) {
    auto p = plan(*foreign, joint, gear, loads, choice);
    if (!p) return failed(p.error());
    plans.push_back(std::move(*p));
  }
  // In the order of the controls: drives without an old actuator come after all others.
  std::ranges::stable_sort(plans, {},
                           [](const Plan& p) { return p.actuators.empty() ? 1 << 30 : p.actuators.front(); });

  RobotWithDrives robot{.notes = foreign->notes, .files = foreign->files};
  doubt_efforts(m, plans, robot.warnings);
  doubt_scales(plans, robot.warnings);
  for (const Plan& p : plans) doubt_gear(p, robot.warnings);
  if (const auto ok = write_joints(document, m, plans); !ok) return failed(ok.error());
  const auto freed = fix_bases(document, m, plans, choice.fix_base);
  if (!freed) return failed(freed.error());
  const auto gone = write_actuators(document, m, plans, robot.notes);
  if (!gone) return failed(gone.error());
  write_keyframes(document, m, plans, *gone, *freed, robot.notes);
  if (freed->count > 0) robot.notes.emplace_back("the floating base is fixed where the model puts it");
  write_instances(document, plans);
  write_options(document, m, robot.notes);
  write_speeds(document, plans);
  add_scene(document, m, choice.fix_base, robot.notes);
  write_starting_points(document, plans);
  const bool starters = std::ranges::any_of(plans, [](const Plan& p) { return p.added.is_starting_point(); });
  write_title(document, file, starters);
  make_assets_relative(document, folder);

  auto model =
      checked(document, plans, std::min<double>(m->opt.timestep, longest_useful_s), folder, robot.notes, robot.mjcf);
  // Bases that are fixed now belong to the world, next to which the engine lets neighbours collide.
  if (model && exclude_neighbours(document, (*model)->get(), robot.notes))
    model = checked(document, plans, (*model)->get()->opt.timestep, folder, robot.notes, robot.mjcf);
  if (!model) return failed({"with drives it is refused: " + model.error().message, ErrorKind::work});
  robot.model = *model;
  for (Plan& p : plans) robot.drives.push_back(std::move(p.added));
  return robot;
}

}  // namespace tribotwin::twin
