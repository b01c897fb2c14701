#include <algorithm>
#include <cctype>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/source.hpp>
#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/gears/add_drives.hpp>
#include <tribotwin/twin/gears/gear_class.hpp>
#include <tribotwin/twin/gears/starter_scenario.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::string model, scenario, gear;
  std::vector<std::string> joints, parameters, efforts;
  Destination output;
  bool fix_base = false, json = false, quiet = false;
};

/// NAME=VALUE; without "=" the whole is `first`.
std::pair<std::string, std::string> split(const std::string& text) {
  const auto at = text.find('=');
  return at == text.npos ? std::pair{text, std::string()} : std::pair{text.substr(0, at), text.substr(at + 1)};
}

AddDrives choice_of(const Arguments& a) {
  AddDrives choice{
      .gear = a.gear, .effort_nm = or_wrong_input(PerJoint::of("--effort", a.efforts)), .fix_base = a.fix_base};
  for (const auto& joint : a.joints) {
    const auto [name, gear] = split(joint);
    if (name.empty())
      throw InputError(fmt::format("--joint {}: needs a name before '='; write NAME or NAME=CLASS", joint));
    choice.joints.push_back({name, gear});
  }
  for (const auto& given : a.parameters) {
    const auto [joint, named] = split(given);
    const std::string& file = named.empty() ? joint : named;
    choice.identified.push_back(
        {named.empty() ? "" : joint, file, or_wrong_input(identification::read_parameters(file))});
  }
  // Those of one joint come before those of all.
  std::ranges::stable_sort(choice.identified, {}, [](const auto& i) { return i.joint.empty(); });
  for (const auto& i : choice.identified)
    if (const auto first = std::ranges::find(choice.identified, i.joint, &IdentifiedParameters::joint); &*first != &i)
      throw InputError(fmt::format("--params: {} and {} are both for {}; give one file each", first->file, i.file,
                                   i.joint.empty() ? "all joints" : "joint '" + i.joint + "'"));
  return choice;
}

void report(const RobotWithDrives& robot) {
  bool starters = false;
  for (const AddedDrive& d : robot.drives) {
    const std::string unit = unit_of("Nm", d.slide);
    starters = starters || d.is_starting_point();
    note("{}: {}; {:.4g} {} ({}); gear ratio {:.4g}{}; armature {:.4g} {} {}", d.joint, d.parameters, d.effort_nm, unit,
         d.effort_source, d.gear_ratio, d.slide ? " rad/m" : "", d.armature, d.slide ? "kg" : "kg m^2",
         d.armature_of_model ? "of the model" : "of the rotor");
    if (!d.replaced.empty()) note("{}: the drive '{}' replaces its {}", d.joint, d.actuator, d.replaced);
    if (d.removed_damping > 0 || d.removed_frictionloss > 0)
      note("{}: damping {:g} and frictionloss {:g} removed [{}, {}], the law has friction of its own", d.joint,
           d.removed_damping, d.removed_frictionloss, unit_of("Nm s/rad", d.slide), unit);
  }
  for (const auto& text : robot.notes) note("{}", text);
  if (starters) note("{}", starting_points);
  for (const auto& text : robot.warnings) report_text(fmt::format("warning: {}\n", text));
}

/// Both files or none, also where the work was interrupted between them and starts again: the scenario comes first, and
/// one that is the same already is left alone.
Result<Exit> write_both(const RobotWithDrives& robot, const Arguments& a, const fs::path& scenario) {
  const fs::path out = a.output.file, folder = fs::absolute(scenario).parent_path();
  const auto work = starter_scenario(robot, fs::relative(fs::absolute(out), folder).string());
  if (work) {
    const auto old = mujoco::read_text(scenario);
    if (!old || *old != *work) or_wrong_input(check_output(scenario, a.output.existing(), robot.files));
    if (const auto ok = write_derived(scenario, *work, a.output.existing()); !ok)
      return work_failed(ok.error().message);
  }
  if (auto written = deliver(robot.mjcf, a.output); !written) return written;
  std::vector<std::string> files{out.string()};
  if (work)
    files.push_back(scenario.string());
  else
    note("no scenario was written: {}", work.error().message);
  if (std::error_code error; !work && fs::exists(scenario, error))
    note("{} is of another call and may not fit this robot", scenario.string());
  if (a.json) print_text(files_json(files));
  if (!a.json) print("{}\n", joined(files, "\n"));
  return done;
}

/// Folders for new files, which go again while they are empty unless they are kept.
class NewFolders {
 public:
  NewFolders() = default;
  NewFolders(const NewFolders&) = delete;
  ~NewFolders() {
    std::error_code ignored;
    for (auto folder = made_.rbegin(); folder != made_.rend(); ++folder) fs::remove(*folder, ignored);
  }
  /// What cannot be created is missing, which the check of the file says.
  void make_for(const fs::path& file) {
    std::vector<fs::path> missing;
    std::error_code error;
    for (fs::path folder = fs::absolute(file).lexically_normal().parent_path(); !fs::exists(folder, error) && !error;
         folder = folder.parent_path())
      missing.push_back(folder);
    for (auto folder = missing.rbegin(); folder != missing.rend(); ++folder)
      if (fs::create_directory(*folder, error)) made_.push_back(*folder);
  }
  void keep() { made_.clear(); }

 private:
  std::vector<fs::path> made_;
};

/// The result is a file in a folder, and MJCF.
void check_kind(const fs::path& out) {
  std::error_code error;
  const fs::file_status status = fs::status(out, error);
  if (fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status))
    throw InputError(fmt::format(
        "-o {}: is no file, but paths of meshes are relative to the folder of the model; give a file, as OUT.xml",
        out.string()));
  std::string ending = out.extension();
  std::ranges::transform(ending, ending.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (ending == ".urdf" || ending == ".yaml")
    throw InputError(fmt::format("-o {}: the model with drives is MJCF{}; name it {}", out.string(),
                                 ending == ".urdf" ? ", because a URDF has no place for drives" : "",
                                 fs::path(out).replace_extension(".xml").string()));
}

Result<Exit> execute(const Arguments& a) {
  if (!a.output.named()) throw InputError("add-drives needs -o OUT.xml: paths of meshes are relative to its folder");
  const fs::path out = a.output.file;
  check_kind(out);
  const fs::path scenario = a.scenario.empty() ? fs::path(out).replace_extension(".yaml") : fs::path(a.scenario);
  NewFolders folders;
  for (const fs::path& file : {out, scenario}) folders.make_for(file);
  check(a.output, {a.model});
  or_wrong_input(check_output(scenario, Existing::replace, std::vector<fs::path>{a.model, out}));
  const auto robot = add_drives(a.model, choice_of(a), out.has_parent_path() ? out.parent_path() : ".");
  if (!robot) return tl::unexpected(robot.error());
  check(a.output, robot->files);
  if (!a.quiet) report(*robot);
  auto code = write_both(*robot, a, scenario);
  if (code) folders.keep();
  return code;
}

}  // namespace

void add_add_drives(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand(
      "add-drives",
      "Drives for a robot that has none: MJCF or URDF in, MJCF with tribotwin.drive and a first hour of "
      "work out");
  command->add_option("MODEL", a->model, "MODEL.xml (MJCF) or MODEL.urdf")->required();
  command
      ->add_option("--joint", a->joints,
                   "NAME or NAME=CLASS: only these joints get drives (default: those with an actuator, or all); CLASS "
                   "is a gear class or a family of them (tribotwin list gears)")
      ->allow_extra_args(false);
  command->add_option("--gear", a->gear, "Gear class or family of all hinges without one of their own");
  command
      ->add_option("--params", a->parameters,
                   "FILE or JOINT=FILE: identified parameters (tribotwin identify) instead of those of the class")
      ->allow_extra_args(false);
  command
      ->add_option("--effort", a->efforts,
                   "[JOINT=]NM (N of a slide): largest torque of the drive in place of the model's effort; may be "
                   "repeated")
      ->allow_extra_args(false);
  command->add_option("--scenario", a->scenario, "File for the first hour of work (default: OUT.yaml)");
  command->add_flag("--fix-base", a->fix_base, "Fix a floating base, as on a stand");
  command->add_flag("--quiet", a->quiet, "No notes");
  a->output.add_to(*command, "OUT.xml: the model with drives");
  command->add_flag("--json", a->json, "Print the names of the files written as JSON");
  command->footer(
      "The model is yours, robot.urdf say: MJCF or URDF with masses and limits. Friction and heat of a class are "
      "starting points: identify those of your robot and give them by --params. That takes measured friction, a table "
      "with speed_rad_s (motor side) and friction_nm or friction_norm, or a recording with time_s, position_rad and "
      "torque_nm (tribotwin identify --help).\n"
      "Example:\n  tribotwin add-drives robot.urdf --joint shoulder=harmonic_130 --joint elbow -o robot.xml\n"
      "  tribotwin run robot.yaml -o runs/robot");
  command->callback([a, &code] { code = or_throw(execute(*a)); });
}

}  // namespace tribotwin::twin::program
