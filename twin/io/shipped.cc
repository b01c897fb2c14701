#include <algorithm>
#include <array>

#include <dlfcn.h>

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view models = "mjcf", scenarios = "twin/scenarios";

std::vector<fs::path> files_in(std::string_view folder, std::string_view ending) {
  std::vector<fs::path> found;
  for (const fs::directory_entry& entry :
       entries_of(shipped_folder() / folder).value_or(std::vector<fs::directory_entry>()))
    if (entry.path().extension() == ending) found.push_back(entry.path());
  std::ranges::sort(found);
  return found;
}

/// Throws InputError where something ships under nearly this name.
void suggest(const std::string& given, const fs::path& name) {
  std::vector<std::string> names;
  for (const auto& file : files_in(name.extension() == ".xml" ? models : scenarios, name.extension().string()))
    names.push_back(file.stem().string());
  if (const auto meant = did_you_mean(name.stem().string(), names); !meant.empty())
    throw InputError(given + ": does not exist" + meant);
}

/// The program, and the file of this code, which is another one where Python has loaded it.
std::array<fs::path, 2> own_files() {
  std::error_code error;
  Dl_info module{};
  const bool known = ::dladdr(reinterpret_cast<const void*>(&own_files), &module) != 0 && module.dli_fname != nullptr;
  return {fs::read_symlink("/proc/self/exe", error), known ? fs::canonical(module.dli_fname, error) : fs::path()};
}

}  // namespace

fs::path shipped_folder() {
  std::error_code error;
  const auto files = own_files();
  fs::path installed = files[0].parent_path().parent_path() / TRIBOTWIN_SHARED;
  if (fs::is_directory(installed / scenarios, error)) return installed;
  // A build folder has a link to the source tree: no path is compiled in.
  for (const fs::path& file : files)
    for (fs::path folder = file.parent_path(); folder != folder.parent_path(); folder = folder.parent_path())
      if (fs::path source = fs::read_symlink(folder / "include/tribotwin", error);
          !error && fs::is_directory(source / scenarios, error))
        return source;
  return {};
}

std::vector<fs::path> shipped_models() { return files_in(models, ".xml"); }
std::vector<fs::path> shipped_scenarios() { return files_in(scenarios, ".yaml"); }

std::vector<fs::path> shipped_scenarios(Purpose purpose) {
  auto files = shipped_scenarios();
  std::erase_if(files, [&](const fs::path& file) {
    const YAML::Node tree = load_yaml(file);
    const Purpose own = tree["procedure"]                        ? Purpose::campaign
                        : tree["recordings"] && tree["variants"] ? Purpose::fit
                        : tree["scenario"] && tree["design"]     ? Purpose::plan
                                                                 : Purpose::scenario;
    return own != purpose;
  });
  return files;
}

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
  suggest(given, name);
  return given;
}

std::optional<fs::path> named_file(const std::string& name, const fs::path& by) {
  std::error_code error;
  for (const fs::path& file : {fs::path(name), by.parent_path() / name})
    if (fs::exists(file, error)) return file;
  return std::nullopt;
}

}  // namespace tribotwin::twin
