#pragma once

#include <string>

#include <pugixml.hpp>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/transmission/hysteresis.hpp>

/// The MJCF elements that make a joint one with a drive: `add-drives` puts them into a model, `export --mjcf` prints
/// them.
namespace tribotwin::twin {

/// For text_of(): what begins with <mujoco>.
inline constexpr unsigned no_declaration = pugi::format_default | pugi::format_no_declaration;

/// <instance name=""> with its keys, appended to `plugin`.
pugi::xml_node append_instance(pugi::xml_node plugin, const std::string& name, const drive::Configuration& keys);

/// Turns `element` into <plugin plugin="tribotwin.drive"> on the joint: motor torque as control, gear 1. Attributes
/// that a default class could set otherwise are written.
void make_drive_actuator(pugi::xml_node element, const std::string& name, const std::string& joint,
                         const std::string& instance, std::size_t state_size);

/// What the joint of a drive needs: a friction row whose stiction does not creep, no other damping. Writes every
/// attribute, whatever the joint's default class says.
void make_drive_joint(pugi::xml_node joint);

/// Sets an attribute, which is appended where it does not exist.
void set_attribute(pugi::xml_node element, const char* attribute, const std::string& value);

/// The complete element set of a drive on joint `name`, in a <mujoco> of which a model takes the parts.
std::string drive_elements(const std::string& name, const drive::Drive& drive);
/// The same of an elastic gear whose spring takes its temperature from the drive instance `on_drive`.
std::string spring_elements(const std::string& name, const transmission::Hysteresis& spring);

}  // namespace tribotwin::twin
