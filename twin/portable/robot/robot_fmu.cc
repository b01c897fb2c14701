#include <utility>

#include <fmt/format.h>
#include <unistd.h>

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/portable/c_law.hpp>
#include <tribotwin/twin/portable/robot/robot_fmu.hpp>
#include <tribotwin/twin/portable/robot/robot_model.hpp>
#include <tribotwin/twin/portable/robot/robot_variables.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

/// Adds the files that a scenario names to `files` and makes the names relative.
class Packer {
 public:
  explicit Packer(std::vector<FmuFile>& files) : files_(files) {}

  Result<void> pack(YAML::Node node) {
    if (node.IsSequence())
      for (std::size_t i = 0; i < node.size(); ++i)
        if (auto ok = pack(node[i]); !ok) return ok;
    if (!node.IsMap()) return {};
    for (auto entry : node) {
      const std::string key = entry.first.Scalar();
      YAML::Node value = entry.second;
      if (!value.IsScalar() || (key != "model" && key != "file")) {
        if (auto ok = pack(value); !ok) return ok;
        continue;
      }
      auto packed = key == "model" ? model(value.Scalar()) : file(value.Scalar());
      if (!packed) return tl::unexpected(packed.error());
      entry.second = *packed;
    }
    return {};
  }

 private:
  Result<std::string> model(const fs::path& from) {
    const std::string folder = fmt::format("model{}", ++count_);
    auto made = model_files(from, "resources/" + folder);
    if (!made) return tl::unexpected(made.error());
    files_.insert(files_.end(), made->begin(), made->end());
    return folder + "/model.xml";
  }
  Result<std::string> file(const fs::path& from) {
    const std::string name = fmt::format("file{}/{}", ++count_, from.filename().string());
    std::error_code error;
    if (!fs::is_directory(from, error)) return add(from, name);
    const auto entries = entries_of(from);  // the folder of a run
    if (!entries) return tl::unexpected(entries.error());
    for (const fs::directory_entry& entry : *entries)
      if (entry.is_regular_file(error))
        if (auto ok = add(entry.path(), name + "/" + entry.path().filename().string()); !ok) return ok;
    return name;
  }
  Result<std::string> add(const fs::path& from, const std::string& name) {
    std::error_code error;
    if (!fs::is_regular_file(from, error)) return tl::unexpected(from.string() + ": is no file that can be read");
    auto bytes = read_bytes(from);
    if (!bytes) return tl::unexpected(bytes.error());
    files_.push_back({"resources/" + name, std::move(*bytes)});
    return name;
  }

  std::vector<FmuFile>& files_;
  int count_ = 0;
};

std::string needs() {
  return fmt::format(
      "The library in binaries/ holds tribotwin and, as shared libraries of the system, needs libmujoco {} and those "
      "that `ldd` lists: of Debian bookworm libhdf5, libmatio, libyaml-cpp, libfmt, libpugixml, libglog, libzip, "
      "liblz4, libzstd and the C++ runtime. It is for the processor and the system that it was built on. Nothing is "
      "read but resources/, and nothing is started.",
      mj_versionString());
}

std::string page(const Scenario& scenario, RobotCommands commands, const std::string& name) {
  return fmt::format(R"(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{0}</title></head><body>
<h1>{0}</h1>
<p>A robot: the twin of <code>resources/scenario.yaml</code> with MuJoCo {1} inside. Written by
<code>tribotwin export --fmu</code>.</p>
<p>Communication steps are multiples of the time step, {2} s; inputs are constant in them. Outputs are those at the end
of the step, friction and torques those of its last time step; before the first one they are 0. {3}</p>
<p>{4}</p>
<p>States are saved, restored and serialized. Work cycles are not skipped (<code>multirate</code>).</p>
<table border="1"><tr><th>name</th><th>unit</th><th>kind</th><th>meaning</th></tr>
{5}</table>
</body></html>
)",
                     name, mj_versionString(), (*scenario.model)->opt.timestep,
                     commands == RobotCommands::scenario
                         ? "The drives follow the scenario's motion and control; the run ends with the scenario."
                         : "The drives follow the inputs; the loops have the gains of the scenario's servo.",
                     needs(), fmu_variable_rows(robot_variables(scenario, commands)));
}

FmuAbout about(const Scenario& scenario, RobotCommands commands, const std::string& name) {
  const double timestep_s = (*scenario.model)->opt.timestep;
  return {.name = name,
          .text = fmt::format("a robot with friction and heat of its joints: the twin of scenario {}, commands: {}; "
                              "needs libmujoco {} and shared libraries of Debian, see documentation; steps are "
                              "multiples of {} s",
                              scenario.name, name_of(commands), mj_versionString(), timestep_s),
          .sources = false,
          .states = true,
          .stop_s = scenario.duration_s,
          .step_s = timestep_s * std::max(1.0, std::round(0.01 / timestep_s)),
          .fixed_step_s = timestep_s};
}

}  // namespace

fs::path robot_fmu_library() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  constexpr const char* name = "libtribotwin_robot_fmu.so";
  for (const fs::path& file : {folder / name, folder.parent_path() / TRIBOTWIN_LIBRARIES / name})
    if (fs::is_regular_file(file, error)) return file;
  return {};
}

Result<std::vector<FmuFile>> robot_fmu_files(const Scenario& scenario, RobotCommands commands, const std::string& name,
                                             FmiVersion version, const fs::path& library) {
  const std::string place = fmu_library_name(name, version);
  if (place.empty()) return work_failed(fmt::format("FMI {} has no name for this machine", static_cast<int>(version)));
  const auto variables = robot_variables(scenario, commands);
  std::vector<FmuFile> files{
      {"modelDescription.xml", fmu_description(about(scenario, commands, name), variables, static_cast<int>(version))}};
  YAML::Node tree = YAML::Load(scenario.resolved_yaml);
  if (auto ok = Packer(files).pack(tree); !ok) return tl::unexpected(ok.error());
  files.push_back({"resources/scenario.yaml", to_text(tree)});
  files.push_back({"resources/fmu.yaml", fmt::format("token: \"@TOKEN@\"\nmujoco: \"{}\"\ncommands: {}\n",
                                                     mj_versionString(), name_of(commands))});
  const std::string token = fmu_token(files);
  for (FmuFile& file : files)
    if (file.name == "modelDescription.xml" || file.name == "resources/fmu.yaml")
      file.content = filled(file.content, {{"@TOKEN@", token}});
  files.push_back({"documentation/index.html", page(scenario, commands, name)});
  files.push_back({"documentation/externalDependencies.txt", needs() + "\n"});
  files.push_back({"documentation/licenses/license.txt", fmu_license("scenario and the model in resources/")});
  auto bytes = read_bytes(library);
  if (!bytes) return tl::unexpected(bytes.error());
  files.push_back({place, std::move(*bytes)});
  if (files.back().content.empty()) return work_failed(fmt::format("{}: cannot be read", library.string()));
  return files;
}

}  // namespace tribotwin::twin
