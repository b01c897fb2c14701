#include <algorithm>

#include <tribotwin/twin/io/shipped.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view models = "mjcf", scenarios = "twin/scenarios";

std::vector<fs::path> files_in(std::string_view folder, std::string_view ending) {
  std::vector<fs::path> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(shipped_folder() / folder, error))
    if (entry.path().extension() == ending) found.push_back(entry.path());
  std::ranges::sort(found);
  return found;
}

}  // namespace

fs::path shipped_folder() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  const fs::path installed = program.parent_path().parent_path() / TRIBOTWIN_SHARED;
  for (const fs::path& folder : {installed, fs::path(TRIBOTWIN_SOURCE)})
    if (fs::is_directory(folder / scenarios, error)) return folder;
  return {};
}

std::vector<fs::path> shipped_models() { return files_in(models, ".xml"); }
std::vector<fs::path> shipped_scenarios() { return files_in(scenarios, ".yaml"); }

fs::path given_or_shipped(const std::string& given, std::string_view ending) {
  std::error_code error;
  if (given.empty() || fs::exists(given, error) || fs::path(given).is_absolute()) return given;
  const fs::path folder = shipped_folder();
  if (folder.empty()) return given;
  const fs::path name =
      fs::path(fs::path(given).has_extension() ? given : given + std::string(ending)).lexically_normal();
  if (*name.begin() == "..") return given;
  for (const fs::path& file : {folder / name, folder / models / name, folder / scenarios / name})
    if (fs::is_regular_file(file, error)) return file;
  return given;
}

}  // namespace tribotwin::twin
