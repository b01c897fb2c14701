#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/source.hpp>
#include <tribotwin/twin/gears/drive_elements.hpp>

namespace tribotwin::twin {
namespace {

pugi::xml_node append_comment(pugi::xml_node parent, const std::string& text) {
  pugi::xml_node comment = parent.append_child(pugi::node_comment);
  comment.set_value((" " + text + " ").c_str());
  return comment;
}

}  // namespace

void set_attribute(pugi::xml_node element, const char* attribute, const std::string& value) {
  pugi::xml_attribute a = element.attribute(attribute);
  if (!a) a = element.append_attribute(attribute);
  a = value.c_str();
}

pugi::xml_node append_instance(pugi::xml_node plugin, const std::string& name, const drive::Configuration& keys) {
  pugi::xml_node instance = plugin.append_child("instance");
  set_attribute(instance, "name", name);
  for (const auto& [key, value] : keys) {
    pugi::xml_node config = instance.append_child("config");
    set_attribute(config, "key", key);
    set_attribute(config, "value", value);
  }
  return instance;
}

void make_drive_actuator(pugi::xml_node element, const std::string& name, const std::string& joint,
                         const std::string& instance, std::size_t state_size) {
  const std::string group = element.attribute("group").value(), user = element.attribute("user").value();
  element.set_name("plugin");
  element.remove_attributes();
  element.remove_children();
  set_attribute(element, "name", name);
  if (!group.empty()) set_attribute(element, "group", group);
  if (!user.empty()) set_attribute(element, "user", user);
  set_attribute(element, "joint", joint);
  set_attribute(element, "plugin", "tribotwin.drive");
  set_attribute(element, "instance", instance);
  set_attribute(element, "actdim", std::to_string(state_size));
  set_attribute(element, "dyntype", "user");
}

void make_drive_joint(pugi::xml_node joint) {
  set_attribute(joint, "damping", "0");
  set_attribute(joint, "frictionloss", "1");
  set_attribute(joint, "solreffriction", ".001 1");
  set_attribute(joint, "solimpfriction", ".9999 .9999 .001 .5 2");
}

std::string drive_elements(const std::string& name, const drive::Drive& drive) {
  pugi::xml_document document;
  pugi::xml_node root = document.append_child("mujoco");
  append_comment(root, "A drive for the joint '" + name + "': take these elements into the model.");
  set_attribute(root.append_child("option"), "tolerance", "1e-10");
  pugi::xml_node plugin = root.append_child("extension").append_child("plugin");
  set_attribute(plugin, "plugin", "tribotwin.drive");
  append_instance(plugin, name, drive::configuration_of(drive));
  pugi::xml_node body = root.append_child("worldbody").append_child("body");
  append_comment(body,
                 "The joint keeps its axis and range; armature is the rotor inertia times gear_ratio squared. "
                 "frictionloss is any value above 0: the drive replaces it every step.");
  pugi::xml_node joint = body.append_child("joint");
  set_attribute(joint, "name", name);
  make_drive_joint(joint);
  pugi::xml_node actuator = root.append_child("actuator");
  append_comment(actuator, "In place of the joint's actuator. The control is the motor torque [Nm, arm side].");
  make_drive_actuator(actuator.append_child("plugin"), name, name, name, drive::state_size(drive));
  set_attribute(actuator.last_child(), "ctrllimited", "true");
  set_attribute(actuator.last_child(), "ctrlrange",
                fmt::format("{0:g} {1:g}", -drive.torque_max_nm, drive.torque_max_nm));
  return mujoco::text_of(document, no_declaration);
}

std::string spring_elements(const std::string& name, const transmission::Hysteresis& spring) {
  pugi::xml_document document;
  pugi::xml_node root = document.append_child("mujoco");
  append_comment(root, "An elastic gear between a motor hinge and an arm hinge: take these elements into the model.");
  pugi::xml_node plugin = root.append_child("extension").append_child("plugin");
  set_attribute(plugin, "plugin", "tribotwin.hysteresis");
  append_instance(plugin, name, transmission::configuration_of(spring));
  pugi::xml_node tendon = root.append_child("tendon");
  append_comment(tendon, "Its length is the torsion, motor angle / gear ratio - arm angle: put in joints and ratio.");
  pugi::xml_node fixed = tendon.append_child("fixed");
  set_attribute(fixed, "name", name);
  for (const auto& [joint, coefficient] : {std::pair{"motor", "0.01"}, {"output", "-1"}}) {
    pugi::xml_node end = fixed.append_child("joint");
    set_attribute(end, "joint", joint);
    set_attribute(end, "coef", coefficient);
  }
  pugi::xml_node element = root.append_child("actuator").append_child("plugin");
  for (const auto& [attribute, value] : {std::pair<const char*, std::string>{"name", name},
                                         {"tendon", name},
                                         {"plugin", "tribotwin.hysteresis"},
                                         {"instance", name},
                                         {"actdim", "1"},
                                         {"dyntype", "user"}})
    set_attribute(element, attribute, value);
  return mujoco::text_of(document, no_declaration);
}

}  // namespace tribotwin::twin
