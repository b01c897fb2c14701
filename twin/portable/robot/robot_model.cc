#include <fmt/format.h>
#include <pugixml.hpp>

#include <tribotwin/plugins/mujoco/source.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/portable/robot/robot_model.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

/// The last value of a compiler's attribute, as the engine has it.
std::string compiler_value(pugi::xml_node root, const char* attribute, const std::string& otherwise) {
  std::string value = otherwise;
  for (const pugi::xml_node compiler : root.children("compiler"))
    if (compiler.attribute(attribute)) value = compiler.attribute(attribute).value();
  return value;
}

/// Whether the attribute names a file of an asset: file, and of a texture fileright and the other sides.
bool names_file(pugi::xml_node element, const pugi::xml_attribute& attribute) {
  const std::string_view name = attribute.name();
  return name == "file" || (name.starts_with("file") && std::string_view(element.name()) == "texture");
}

}  // namespace

Result<std::vector<FmuFile>> model_files(const fs::path& file, const std::string& folder) {
  auto document = mujoco::load_merged(file);
  if (!document) return tl::unexpected(document.error());
  pugi::xml_node root = (*document)->document_element();
  const std::string both = compiler_value(root, "assetdir", "");
  const std::string meshes = compiler_value(root, "meshdir", both), textures = compiler_value(root, "texturedir", both);
  const bool bare = compiler_value(root, "strippath", "false") == "true";
  std::vector<FmuFile> files;
  for (const auto& match : root.select_nodes("//*[@*[starts-with(name(), 'file')]]")) {
    pugi::xml_node element = match.node();
    const std::string_view kind = element.name();
    const bool known = kind == "mesh" || kind == "hfield" || kind == "texture" || kind == "skin";
    for (pugi::xml_attribute attribute : element.attributes()) {
      if (!names_file(element, attribute)) continue;
      const fs::path given = bare ? fs::path(attribute.value()).filename() : fs::path(attribute.value());
      if (!known)
        return tl::unexpected(
            fmt::format("{}: <{} {}=\"{}\">: a file that cannot be part of an FMU; assets that can "
                        "are meshes, height fields, textures and skins",
                        file.string(), kind, attribute.name(), attribute.value()));
      const fs::path from = fs::absolute(file).parent_path() / (kind == "texture" ? textures : meshes) / given;
      auto bytes = read_bytes(from);
      if (!bytes) return tl::unexpected(fmt::format("{}: {}", file.string(), bytes.error().message));
      // A folder of its own: names of assets without a name follow from those of their files.
      const std::string name = fmt::format("assets/{}/{}", files.size(), given.filename().string());
      files.push_back({fmt::format("{}/{}", folder, name), std::move(*bytes)});
      attribute = name.c_str();
    }
  }
  for (pugi::xml_node compiler : root.children("compiler"))
    for (const char* gone : {"assetdir", "meshdir", "texturedir", "strippath"}) compiler.remove_attribute(gone);
  files.push_back({folder + "/model.xml", mujoco::text_of(**document)});
  return files;
}

}  // namespace tribotwin::twin
