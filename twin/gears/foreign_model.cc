#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/mujoco/source.hpp>
#include <tribotwin/twin/gears/drive_elements.hpp>
#include <tribotwin/twin/gears/foreign_model.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

/// Words of MJCF with the version that knows them first, from MuJoCo's changelog.
constexpr std::pair<std::string_view, std::string_view> newer_words[] = {
    {"assetdir", "2.3.0"},
    {"cable", "2.3.0"},
    {"gravcomp", "2.3.1"},
    {"implicitfast", "2.3.3"},
    {"ellipsoidinertia", "2.3.4"},
    {"actuatorfrcrange", "2.3.7"},
    {"actuatorfrclimited", "2.3.7"},
    {"filterexact", "3.0.0"},
    {"actearly", "3.0.0"},
    {"flexcomp", "3.0.0"},
    {"sdf", "3.0.0"},
    {"actuatorgroupdisable", "3.0.1"},
    {"frame", "3.1.0"},
    {"kv", "3.1.0"},
    {"inheritrange", "3.1.3"},
    {"actuatorgravcomp", "3.1.4"},
    {"replicate", "3.1.5"},
    {"dampratio", "3.1.6"},
    {"timeconst", "3.1.6"},
    {"attach", "3.2.0"},
    {"resolution", "3.1.2"},
    {"dcmotor", "3.7.0"},
    {"discrete", "3.13.0"},
};

/// The engine's message, and which engine would read the model where this one is too old.
std::string with_version(const std::string& message) {
  const bool of_schema = message.find("nrecognized") != message.npos ||
                         message.find("invalid keyword") != message.npos ||
                         message.find("chema violation") != message.npos;
  if (!of_schema) return message;
  std::string hint = "a newer MuJoCo may know it";
  for (const auto& [word, version] : newer_words)
    if (message.find(fmt::format("'{}'", word)) != message.npos)
      hint = fmt::format("'{}' needs MuJoCo {} or newer", word, version);
  return fmt::format(
      "{}; this program has MuJoCo {}: {}. Build it with -Dmujoco_ROOT=FOLDER of MuJoCo 3, or take it "
      "out of the model",
      message, mj_versionString(), hint);
}

bool has_asset_files(const pugi::xml_document& document) {
  return static_cast<bool>(document.select_node("//asset/*[@*[starts-with(name(), 'file')]]"));
}

/// The model of a document whose folders are absolute. On engines before 3.0 limits are not automatic: a model of
/// today then needs autolimits.
Result<std::shared_ptr<const mujoco::Model>> compiled(ForeignModel& foreign, const fs::path& folder) {
  auto model = mujoco::load_string(mujoco::text_of(*foreign.document), {}, folder);
  if (model || model.error().message.find("autolimits") == std::string::npos) return model;
  set_attribute(foreign.document->document_element().append_child("compiler"), "autolimits", "true");
  model = mujoco::load_string(mujoco::text_of(*foreign.document), {}, folder);
  if (model)
    foreign.notes.emplace_back("limits follow from ranges (compiler autolimits=\"true\"), as newer engines do");
  return model;
}

Result<void> read_mjcf(ForeignModel& foreign, const fs::path& file) {
  auto merged = mujoco::load_merged(file);
  if (!merged) return tl::unexpected(merged.error());
  foreign.document = std::move(*merged);
  if (has_asset_files(*foreign.document)) mujoco::make_asset_folders_absolute(*foreign.document, file.parent_path());
  const auto direct = mujoco::load_file(file);
  if (direct) {
    foreign.model = *direct;
    return {};
  }
  auto model = compiled(foreign, file.has_parent_path() ? file.parent_path() : ".");
  if (!model) return tl::unexpected(with_version(direct.error().message));
  foreign.model = *model;
  return {};
}

// ---- URDF

std::map<std::string, UrdfLimit> limits_of(const pugi::xml_document& urdf) {
  std::map<std::string, UrdfLimit> limits;
  for (const auto& match : urdf.select_nodes("/robot/joint[limit]")) {
    const pugi::xml_node limit = match.node().child("limit");
    limits[match.node().attribute("name").value()] = {limit.attribute("effort").as_double(),
                                                      limit.attribute("velocity").as_double()};
  }
  return limits;
}

/// The engine ends the program on a type that it does not know.
Result<void> check_joint_types(const mujoco::Source& urdf) {
  static const std::vector<std::string> types{"revolute", "continuous", "prismatic", "fixed", "floating", "planar"};
  for (const auto& match : urdf.document->select_nodes("/robot/joint[@type]")) {
    const std::string type = match.node().attribute("type").value();
    if (std::ranges::find(types, type) == types.end())
      return tl::unexpected(fmt::format("{}: type '{}' of joint '{}' is not known: {}{}",
                                        mujoco::at(urdf, match.node()), type, match.node().attribute("name").value(),
                                        joined(types), did_you_mean(type, types)));
  }
  return {};
}

/// The file that a URDF means: package://NAME/PATH is looked up beside and above the URDF.
fs::path mesh_file(std::string name, const fs::path& folder, const fs::path& meshdir) {
  constexpr std::string_view package = "package://", plain = "file://";
  std::vector<fs::path> candidates;
  if (name.starts_with(package)) {
    const fs::path path = name.substr(package.size());
    fs::path below;
    for (auto part = path.begin(); part != path.end(); ++part)
      if (part != path.begin()) below /= *part;
    for (fs::path up = fs::absolute(folder).lexically_normal();; up = up.parent_path()) {
      candidates.insert(candidates.end(), {up / path, up / below});
      if (up == up.parent_path()) break;
    }
    name = path.filename();
  } else if (name.starts_with(plain)) {
    name = name.substr(plain.size());
  }
  candidates.insert(candidates.end(),
                    {folder / name, folder / meshdir / name, folder / meshdir / fs::path(name).filename(),
                     folder / fs::path(name).filename()});
  for (fs::path candidate : candidates)
    for (const char* extension : {"", ".stl", ".STL", ".obj"}) {
      if (*extension) candidate.replace_extension(extension);
      std::string ending = candidate.extension();
      std::ranges::transform(ending, ending.begin(),
                             [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
      std::error_code error;
      if ((ending == ".stl" || ending == ".obj" || ending == ".msh") && fs::is_regular_file(candidate, error))
        return fs::absolute(candidate).lexically_normal();
    }
  return {};
}

/// Meshes get absolute names; those that are not there are taken out. Fails where one is too long to be read.
Result<void> resolve_meshes(const mujoco::Source& source, const fs::path& folder, std::vector<std::string>& notes) {
  const pugi::xml_document& urdf = *source.document;
  const fs::path meshdir = urdf.select_node("/robot/mujoco/compiler[@meshdir]").node().attribute("meshdir").value();
  std::vector<std::string> missing;
  for (const auto& match : urdf.select_nodes("//geometry/mesh")) {
    pugi::xml_node mesh = match.node(), shape = mesh.parent().parent();
    const std::string given = mesh.attribute("filename").value();
    if (const fs::path found = mesh_file(given, folder, meshdir); !found.empty()) {
      if (const auto ok = check_input_file(found, "a file of a model", limits::asset_bytes, Pipes::refuse); !ok)
        return tl::unexpected(fmt::format("{}: {}", mujoco::at(source, mesh), ok.error().message));
      mesh.attribute("filename") = found.c_str();
      continue;
    }
    missing.push_back(given);
    shape.parent().remove_child(shape);
  }
  if (!missing.empty())
    notes.push_back(fmt::format("{} of its meshes left out, because the file does not exist or is no STL or OBJ: {}{}",
                                missing.size(), missing.front(), missing.size() > 1 ? ", ..." : ""));
  return {};
}

/// The engine's own MJCF of a URDF.
Result<std::string> converted(const pugi::xml_document& urdf) {
  const TemporaryFolder folder("tribotwin-urdf");
  const fs::path in = folder.path() / "urdf.xml", out = folder.path() / "mjcf.xml";
  if (folder.path().empty() || !urdf.save_file(in.c_str()))
    return work_failed(
        "the engine converts a URDF in the folder for temporary files, where nothing can be written; set TMPDIR to a "
        "folder where files can be");
  char error[1000] = "";
  const mujoco::ModelPtr model(mj_loadXML(in.c_str(), nullptr, error, sizeof error));
  if (!model) return tl::unexpected(std::string(error));
  if (!mj_saveLastXML(out.c_str(), model.get(), error, sizeof error)) return work_failed(error);
  return mujoco::read_text(out);
}

/// One line, without the engine's position, which is that of a file that the user never saw.
std::string plain(const std::string& message) {
  std::string text = mujoco::without_position(message);
  std::ranges::replace(text, '\n', ' ');
  return text.substr(0, text.find_last_not_of(' ') + 1);
}

Result<void> read_urdf(ForeignModel& foreign, const mujoco::Source& source, const fs::path& file) {
  if (const auto known = check_joint_types(source); !known) return known;
  pugi::xml_document& urdf = *source.document;
  foreign.limits = limits_of(urdf);
  const fs::path folder = file.has_parent_path() ? file.parent_path() : ".";
  if (const auto ok = resolve_meshes(source, folder, foreign.notes); !ok) return ok;
  pugi::xml_node robot = urdf.document_element();
  if (!robot.child("mujoco")) robot.append_child("mujoco");
  pugi::xml_node compiler = robot.child("mujoco").child("compiler");
  if (!compiler) compiler = robot.child("mujoco").append_child("compiler");
  set_attribute(compiler, "strippath", "false");
  compiler.remove_attribute("meshdir");
  if (!compiler.attribute("discardvisual")) set_attribute(compiler, "discardvisual", "false");
  auto mjcf = converted(urdf);
  if (!mjcf && mjcf.error().message.find("inertia") != std::string::npos && !compiler.attribute("balanceinertia")) {
    set_attribute(compiler, "balanceinertia", "true");
    const auto again = converted(urdf);
    if (again) {
      foreign.notes.emplace_back("an inertia that no body can have was replaced by its mean (balanceinertia)");
      mjcf = again;
    }
  }
  if (!mjcf)
    return tl::make_unexpected(
        Error(fmt::format("{}: {}", file.string(), plain(mjcf.error().message)), mjcf.error().kind));
  foreign.document = std::make_unique<pugi::xml_document>();
  foreign.document->load_string(mjcf->c_str());
  auto model = compiled(foreign, folder);
  if (!model) return tl::unexpected(fmt::format("{}: as MJCF: {}", file.string(), model.error().message));
  foreign.model = *model;
  return {};
}

void collect_joints(pugi::xml_node body, std::vector<pugi::xml_node>& joints) {
  for (const pugi::xml_node child : body)
    if (const std::string_view name = child.name(); name == "joint" || name == "freejoint") joints.push_back(child);
  for (const pugi::xml_node child : body)
    if (const std::string_view name = child.name(); name == "body" || name == "frame") collect_joints(child, joints);
}

}  // namespace

Result<ForeignModel> read_foreign_model(const fs::path& file) {
  const auto text = mujoco::read_text(file);
  if (!text) return tl::unexpected(text.error());
  auto sources = mujoco::read_sources(file.string(), *text, file.parent_path());
  if (!sources) return tl::unexpected(sources.error());
  ForeignModel foreign;
  for (const mujoco::Source& source : *sources) {
    foreign.files.emplace_back(source.name);
    if (const auto drive = source.document->select_node("//actuator/plugin[@plugin='tribotwin.drive']"))
      return tl::unexpected(fmt::format(
          "{}: the model has drives already; change the keys of their <instance>, or start from the model without them",
          mujoco::at(source, drive.node())));
  }
  const std::string_view root = sources->front().document->document_element().name();
  if (root != "mujoco" && root != "robot")
    return tl::unexpected(
        fmt::format("{}: is neither MJCF nor URDF: its root is <{}>, not <mujoco> or <robot>", file.string(), root));
  const auto read = root == "mujoco" ? read_mjcf(foreign, file) : read_urdf(foreign, sources->front(), file);
  if (!read) return tl::unexpected(read.error());
  return foreign;
}

std::vector<pugi::xml_node> joint_elements(const pugi::xml_document& document) {
  std::vector<pugi::xml_node> joints;
  for (const pugi::xml_node world : document.document_element().children("worldbody")) collect_joints(world, joints);
  return joints;
}

void make_assets_relative(pugi::xml_document& document, const fs::path& folder) {
  std::error_code unresolved;
  fs::path base = fs::weakly_canonical(fs::absolute(folder), unresolved);
  if (unresolved) base = fs::absolute(folder).lexically_normal();
  const auto change = [&](pugi::xml_attribute attribute) {
    const fs::path path = attribute.value();
    if (!path.is_absolute()) return;
    std::error_code error;
    const fs::path relative = fs::relative(path, base, error);
    if (!error && !relative.empty()) attribute = relative == "." ? "" : relative.c_str();
  };
  for (pugi::xml_node compiler : document.document_element().children("compiler"))
    for (const char* attribute : {"meshdir", "texturedir", "assetdir"})
      if (compiler.attribute(attribute)) change(compiler.attribute(attribute));
  const bool has_meshdir = static_cast<bool>(document.select_node("//compiler[@meshdir!='']"));
  if (!has_meshdir)
    for (const auto& match : document.select_nodes("//asset/mesh[@file]")) change(match.node().attribute("file"));
}

}  // namespace tribotwin::twin
