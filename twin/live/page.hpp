#pragma once

#include <span>
#include <string_view>

namespace tribotwin::twin::live {

/// A file of the page. All are part of the program (embed.cmake): no path of the disk is ever served.
struct PageFile {
  std::string_view name, type, content;
};

std::span<const PageFile> page_files();

/// By the path of a request: "/" is index.html. nullptr: there is none.
inline const PageFile* page_file(std::string_view path) {
  if (!path.starts_with('/')) return nullptr;
  path.remove_prefix(1);
  if (path.empty()) path = "index.html";
  for (const PageFile& file : page_files())
    if (file.name == path) return &file;
  return nullptr;
}

}  // namespace tribotwin::twin::live
