#include <memory>
#include <vector>

#include <fmt/format.h>
#include <pugixml.hpp>

#include <tribotwin/plugins/mujoco/includes.hpp>

namespace tribotwin::mujoco {

Result<void> merge_includes(pugi::xml_document& document, const std::filesystem::path& folder,
                            const IncludedDocument& included, const Copied& copied) {
  while (const pugi::xml_node include = document.select_node("//include").node()) {
    const std::filesystem::path file = folder / include.attribute("file").value();
    const auto part = included(file);
    if (!part) return tl::unexpected(part.error());
    for (const pugi::xml_node child : (*part)->document_element()) {
      const pugi::xml_node copy = include.parent().insert_copy_before(child, include);
      if (copied) copied(file, child, copy);
    }
    include.parent().remove_child(include);
  }
  return {};
}

Result<void> merge_includes(pugi::xml_document& document, const std::filesystem::path& folder) {
  pugi::xml_document part;
  return merge_includes(document, folder, [&](const std::filesystem::path& file) -> Result<const pugi::xml_document*> {
    if (const auto read = part.load_file(file.c_str()); !read)
      return tl::unexpected(fmt::format("{}: cannot be read ({})", file.string(), read.description()));
    return &part;
  });
}

}  // namespace tribotwin::mujoco
