#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include <unistd.h>

namespace tribotwin::twin {

/// A YAML file of a name of its own, gone at the end.
struct TemporaryFile {
  std::filesystem::path path = [] {
    std::string name = (std::filesystem::temp_directory_path() / "tribotwin_XXXXXX.yaml").string();
    close(mkstemps(name.data(), 5));
    return std::filesystem::path(name);
  }();
  explicit TemporaryFile(const std::string& text) { std::ofstream(path) << text; }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile() { std::filesystem::remove(path); }
};

}  // namespace tribotwin::twin
