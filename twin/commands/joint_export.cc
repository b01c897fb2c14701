#include <cctype>
#include <filesystem>

#include <fmt/format.h>

#include <tribotwin/twin/commands/joint_export.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/portable/bam.hpp>
#include <tribotwin/twin/portable/c_source.hpp>
#include <tribotwin/twin/portable/fmu.hpp>
#include <tribotwin/twin/portable/friction_table.hpp>
#include <tribotwin/twin/portable/robot/robot_fmu.hpp>
#include <tribotwin/twin/robot/native_model.hpp>

namespace tribotwin::twin::program {
namespace {

/// What names in C begin with: --name, else the model's joint.
std::string prefix_of(const JointSource& source, const std::string& name) {
  return name.empty() ? c_name(source.joint.empty() ? "joint" : source.joint) : name;
}

SourcedJoint hinge_of(const JointSource& source, const std::string& name, const char* what) {
  SourcedJoint joint = joint_of(source, name);
  if (joint.slide)
    throw InputError(fmt::format("{}: {} is a slide; {} has the units of a hinge. --c writes its source", source.file,
                                 source.joint.empty() ? "the joint" : source.joint, what));
  return joint;
}

}  // namespace

Result<Exit> export_c(const JointSource& source, const std::string& name, const Destination& output) {
  const std::string prefix = prefix_of(source, name);
  const auto text = c_source(joint_of(source, prefix).drive, prefix);
  if (!text) throw InputError(fmt::format("--name {}", text.error().message));
  return deliver(*text, output);
}

Result<Exit> export_fmu(const JointSource& source, const std::string& name, int fmi_version,
                        const Destination& output) {
  const FmiVersion version = fmi_version == 2 ? FmiVersion::two : FmiVersion::three;
  const std::string prefix = prefix_of(source, name);
  const SourcedJoint joint = hinge_of(source, prefix, "an FMU");
  auto files = fmu_files(joint.drive, prefix, version);
  if (!files) throw InputError(fmt::format("--name {}", files.error().message));
  const std::string library_name = fmu_library_name(prefix, version);
  if (library_name.empty()) {
    note("FMI {} has no name for this machine: the FMU holds sources alone", fmi_version);
  } else {
    const auto library = fmu_library(*files, prefix, version);
    if (!library) return tl::unexpected(library.error());
    if (library->empty())
      note("no C compiler (cc, gcc or clang) is found: the FMU holds sources alone, {} is missing", library_name);
    else
      files->push_back({library_name, *library});
  }
  const auto bytes = zipped(*files);
  if (!bytes) return tl::unexpected(bytes.error());
  return deliver(*bytes, output);
}

Result<Exit> export_bam(const JointSource& source, const std::string& actuator, std::optional<double> temperature_degC,
                        std::optional<double> speed_max_rad_s, const Destination& output) {
  const auto bam = bam_friction(hinge_of(source, "joint", "BAM's model").drive, temperature_degC, speed_max_rad_s);
  if (!bam) throw InputError(fmt::format("{}: {}", source.file, bam.error().message));
  const std::string where =
      fmt::format("up to {:.6g} rad/s and {:.6g} Nm of load", bam->speed_max_rad_s, bam->load_max_nm);
  note("{} {}: friction {:.4g} .. {:.4g} Nm at {:g} degC, error {:.3g} Nm rms, {:.3g} Nm at most",
       bam->exact ? "BAM's m4 has the law exactly;" : "BAM's m4 as best fit", where, bam->friction_min_nm,
       bam->friction_max_nm, bam->temperature_degC, bam->rms_error_nm, bam->max_error_nm);
  note("lost: {}. Of the motor the file holds nothing: kt, R, armature and gains stay those of BAM's '{}'", bam->lost,
       actuator);
  return deliver(bam_json(*bam, actuator), output);
}

bool is_scenario(const std::string& file) {
  const std::filesystem::path given = given_or_shipped(file, ".yaml");
  std::error_code error;
  if (given.extension() != ".yaml" || !std::filesystem::is_regular_file(given, error)) return false;
  const YAML::Node tree = load_yaml(given);
  return tree.IsMap() && tree["model"];
}

Result<Exit> export_robot_fmu(const std::string& file, const std::string& name, const std::string& commanded,
                              int fmi_version, const Destination& output) {
  const std::filesystem::path given = given_or_shipped(file, ".yaml");
  if (load_yaml(given)["vary"])
    throw InputError(fmt::format("{}: lists several runs (vary); an FMU is one of them", given.string()));
  const auto scenario = load_scenario(given);
  if (!scenario) return tl::unexpected(scenario.error());
  const std::string prefix = name.empty() ? c_name(scenario->name) : name;
  if (prefix != c_name(prefix) || std::isdigit(static_cast<unsigned char>(prefix[0])))
    throw InputError(fmt::format("--name {}: must be letters, digits and _ and begin with no digit", prefix));
  const std::filesystem::path library = robot_fmu_library();
  if (library.empty())
    return work_failed("libtribotwin_robot_fmu.so, which the FMU of a robot holds, does not lie beside this program");
  const auto files = robot_fmu_files(*scenario, robot_commands(commanded).value(), prefix,
                                     fmi_version == 2 ? FmiVersion::two : FmiVersion::three, library);
  if (!files) return tl::unexpected(files.error());
  if (scenario->multirate.enabled)
    note("{}: multirate is on; the FMU computes every step, also those that `tribotwin run` skips", given.string());
  const auto bytes = zipped(*files);
  if (!bytes) return tl::unexpected(bytes.error());
  return deliver(*bytes, output);
}

Result<Exit> export_table(const JointSource& source, std::optional<double> temperature_degC,
                          std::optional<double> speed_max_rad_s, const Destination& output) {
  const auto table = friction_table(hinge_of(source, "joint", "a table").drive, temperature_degC, speed_max_rad_s);
  if (!table) throw InputError(fmt::format("{}: {}", source.file, table.error().message));
  note(
      "{} rows; in the centres between them linear interpolation misses friction by up to {:.3g} Nm; not in the table: "
      "speeds below {:.3g} rad/s, {}",
      table->rows, table->error_nm, table->slowest_rad_s, table->lost);
  return deliver(table->csv, output);
}

Result<Exit> export_urdf(const std::string& file, std::optional<double> temperature_degC,
                         std::optional<double> speed_max_rad_s, const Destination& output) {
  const auto native = native_model(file, temperature_degC, speed_max_rad_s);
  if (!native) return tl::unexpected(native.error());
  std::string text;
  for (const NativeFriction& n : native->joints)
    text += fmt::format(
        "<!-- {}: friction without load at {:g} degC, {:.4g} .. {:.4g} Nm up to {:.4g} rad/s; error {:.3g} Nm rms, "
        "{:.3g} Nm at most (for a slide N, m/s) -->\n<dynamics damping=\"{:.6g}\" friction=\"{:.6g}\"/>\n",
        n.joint, n.temperature_degC, n.friction_min_nm, n.friction_max_nm, n.speed_max_rad_s, n.rms_error_nm,
        n.max_error_nm, n.damping_nm_s_rad, n.frictionloss_nm);
  note(
      "lost: friction by load and temperature, the Stribeck effect, bristles, heat, the damping that joints have "
      "beside "
      "their drives");
  return deliver(text, output);
}

}  // namespace tribotwin::twin::program
