#include <algorithm>

#include <fmt/format.h>
#include <pugixml.hpp>

#include <tribotwin/plugins/mujoco/source.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/drive_change.hpp>

namespace tribotwin::twin {
namespace {

drive::Configuration changed(drive::Configuration configuration, const drive::Configuration& keys) {
  const auto drop = [&](const auto& parameters) {
    std::erase_if(configuration, [&](const auto& entry) {
      return std::ranges::any_of(parameters, [&](const auto& p) { return p.name == entry.first; });
    });
  };
  for (const auto& [key, value] : keys) {
    const auto old = std::ranges::find(configuration, key, &drive::Configuration::value_type::first);
    if (old == configuration.end()) {
      configuration.emplace_back(key, value);
      continue;
    }
    const std::string before = std::exchange(old->second, value);
    if (before == value) continue;
    if (key == "law")
      if (const auto* law = friction::find_law(before)) drop(law->parameters);
    if (key == "thermal")
      if (const auto* model = thermal::find_model(before)) drop(model->parameters);
  }
  return configuration;
}

/// The instance of a joint's drive, which serves no other joint.
Result<std::string> own_instance(const mujoco::Model& model, const std::filesystem::path& file,
                                 const std::string& joint) {
  const auto index = find_drive(model, joint);
  if (!index) return tl::unexpected(fmt::format("{}: {}", file.string(), index.error().message));
  const std::string& instance = model.drives()[*index].drive.name;
  if (instance.ends_with("/" + joint))
    return tl::unexpected(fmt::format(
        "{}: joint '{}' shares its instance with others; give it an <instance> of its own", file.string(), joint));
  return instance;
}

/// Replaces keys of an <instance>.
Result<void> change(pugi::xml_node element, const drive::Configuration& keys) {
  // Words first: a new law or thermal model removes the old parameters; those given here follow.
  drive::Configuration ordered = keys, present;
  std::stable_partition(ordered.begin(), ordered.end(),
                        [](const auto& entry) { return entry.first == "law" || entry.first == "thermal"; });
  while (const pugi::xml_node config = element.child("config")) {
    present.emplace_back(config.attribute("key").value(), config.attribute("value").value());
    element.remove_child(config);
  }
  const drive::Configuration configuration = changed(std::move(present), ordered);
  if (const auto drive = drive::make_drive(element.attribute("name").value(), configuration); !drive)
    return tl::unexpected(drive.error());
  for (const auto& [key, value] : configuration) {
    pugi::xml_node config = element.append_child("config");
    config.append_attribute("key") = key.c_str();
    config.append_attribute("value") = value.c_str();
  }
  return {};
}

}  // namespace

Result<std::shared_ptr<const mujoco::Model>> load_with_drives(const std::filesystem::path& file,
                                                              std::span<const DriveChange> changes,
                                                              const mujoco::Options& options) {
  auto model = mujoco::load_file(file, options);
  if (!model || std::ranges::all_of(changes, [](const DriveChange& c) { return c.keys.empty(); })) return model;
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  const auto document = mujoco::load_merged(file);
  if (!document) return tl::unexpected(document.error());
  for (const DriveChange& one : changes) {
    const auto instance = own_instance(**model, file, one.joint);
    if (!instance) return tl::unexpected(instance.error());
    for (const auto& match : (*document)->select_nodes("//extension/plugin[@plugin='tribotwin.drive']/instance"))
      if (match.node().attribute("name").value() == *instance)
        if (const auto ok = change(match.node(), one.keys); !ok) return tl::unexpected(ok.error());
  }
  return mujoco::load_string(mujoco::text_of(**document), options, folder);
}

Result<std::shared_ptr<const mujoco::Model>> load_with_drive(const std::filesystem::path& file,
                                                             const std::string& joint,
                                                             const drive::Configuration& keys) {
  const DriveChange change{joint, keys};
  return load_with_drives(file, {&change, 1});
}

}  // namespace tribotwin::twin
