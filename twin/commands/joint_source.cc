#include <algorithm>
#include <cctype>
#include <filesystem>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/commands/joint_source.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::program {
namespace {

SourcedJoint of_model(const JointSource& source) {
  const auto model = mujoco::load_file(given_or_shipped(source.file, ".xml"));
  if (!model) throw InputError(model.error().message);
  const auto drives = (*model)->drives();
  const std::vector<std::string> joints = joint_names(**model);
  const auto sourced = [&](std::size_t i) {
    return SourcedJoint{drives[i].drive, is_slide((*model)->get(), drives[i])};
  };
  if (source.torque_max_nm > 0 || source.gear_ratio > 0)
    throw InputError(
        fmt::format("{}: --tau-max and --gear-ratio belong to PARAMS.yaml; a model has its own", source.file));
  if (drives.empty())
    throw InputError(
        fmt::format("{}: has no tribotwin.drive; `tribotwin add-drives` gives a robot drives", source.file));
  if (source.joint.empty()) {
    if (drives.size() != 1)
      throw InputError(fmt::format("{}: has the joints {}; --joint says which", source.file, joined(joints)));
    return sourced(0);
  }
  const auto found = std::ranges::find(joints, source.joint);
  if (found == joints.end())
    throw InputError(fmt::format("{}: --joint {}: no such joint has a drive; those are {}", source.file, source.joint,
                                 joined(joints)));
  return sourced(static_cast<std::size_t>(found - joints.begin()));
}

drive::Drive of_parameters(const JointSource& source, const std::string& name) {
  if (!source.joint.empty())
    throw InputError(
        fmt::format("--joint {}: {} holds one joint; the option belongs to MODEL.xml", source.joint, source.file));
  if (const auto law = load_yaml(source.file)["law"]; law && law.IsScalar() && law.Scalar() == "bouc_wen")
    throw InputError(
        fmt::format("{}: law bouc_wen is a spring between two bodies, no joint with friction", source.file));
  auto parameters = or_wrong_input(identification::read_parameters(source.file));
  if (source.torque_max_nm > 0) parameters.torque_max_nm = source.torque_max_nm;
  if (source.gear_ratio > 0) parameters.gear_ratio = source.gear_ratio;
  const auto drive = identification::drive_of(parameters, name);
  if (!drive) throw InputError(fmt::format("{}: {}", source.file, drive.error().message));
  // Parameters that a model would refuse are refused here, with the same reason.
  if (const auto loaded = drive::make_drive(name, drive::configuration_of(*drive)); !loaded)
    throw std::runtime_error(fmt::format("{}: {}", source.file, loaded.error().message));
  return *drive;
}

}  // namespace

SourcedJoint joint_of(const JointSource& source, const std::string& name) {
  if (std::filesystem::path(source.file).extension() == ".xml") return of_model(source);
  return {of_parameters(source, name), false};
}

std::string c_name(const std::string& joint) {
  std::string name = joint;
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  return name.empty() || !std::isalpha(static_cast<unsigned char>(name[0])) ? "joint_" + name : name;
}

}  // namespace tribotwin::twin::program
