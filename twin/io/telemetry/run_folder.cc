#include <algorithm>
#include <array>

#include <fmt/format.h>

#include <tribotwin/twin/io/telemetry/run_folder.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Status = Result<void>;

/// What a run consists of, and what is made from its record.
constexpr std::array names{"telemetry.h5",  "summary.json", "scenario.yaml",
                           "telemetry.csv", "cycles.csv",   "telemetry.h5.original"};

bool present(const fs::path& file) {
  std::error_code error;
  return fs::symlink_status(file, error).type() != fs::file_type::not_found;
}

}  // namespace

Status RunFolder::open(const fs::path& directory, Existing existing) {
  std::error_code error;
  created_ = fs::create_directories(directory, error);
  if (error) return work_failed(fmt::format("{}: cannot be created ({})", directory.string(), error.message()));
  directory_ = directory;
  if (auto ok = lock_.take(directory); !ok) return work_failed(ok.error().message);
  const auto found = std::ranges::find_if(names, [&](const char* name) { return present(directory / name); });
  if (found == names.end()) return {};
  if (existing == Existing::refuse)
    return tl::unexpected(
        fmt::format("{}: holds a run already ({}); choose another folder with -o, or replace it with --force",
                    directory.string(), *found));
  return set_aside();
}

Status RunFolder::set_aside() {
  const fs::path aside = free_name(directory_ / "replaced");
  std::error_code error;
  fs::create_directory(aside, error);
  if (error) return work_failed(fmt::format("{}: cannot be created ({})", aside.string(), error.message()));
  aside_ = aside;
  for (const char* name : names) {
    if (!present(directory_ / name)) continue;
    fs::rename(directory_ / name, aside_ / name, error);
    if (error)
      return work_failed(fmt::format("{}: cannot be set aside ({})", (directory_ / name).string(), error.message()));
  }
  for (const fs::path& folder : {aside_, directory_})
    if (auto ok = sync_folder(folder); !ok) return work_failed(ok.error().message);
  return {};
}

void RunFolder::commit() {
  restore_ = false;
  std::error_code ignored;
  if (!aside_.empty()) fs::remove_all(std::exchange(aside_, {}), ignored);
}

RunFolder::~RunFolder() {
  if (!restore_) return;
  std::error_code ignored;
  for (const char* name : names)
    if (!aside_.empty() && present(aside_ / name) && !present(directory_ / name))
      fs::rename(aside_ / name, directory_ / name, ignored);
  if (!aside_.empty()) fs::remove(aside_, ignored);
  lock_.release();
  if (created_) fs::remove(directory_, ignored);  // succeeds only while it is empty
}

}  // namespace tribotwin::twin
