#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <optional>
#include <sstream>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/folder_lock.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Status = Result<void>;

std::optional<std::string> text_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return std::nullopt;
  return std::string(std::istreambuf_iterator<char>(stream), {});
}

/// Throws InputError where a campaign has no business.
void require_free(const std::string& resolved_yaml, const std::string& folder, const fs::path& directory) {
  std::error_code error;
  if (!fs::exists(directory, error)) return;
  if (!fs::is_directory(directory, error))
    throw InputError(fmt::format("{}: is a file, not a folder", directory.string()));
  if (const auto text = text_of(directory / "campaign.yaml")) {
    if (*text == resolved_yaml) return;
    const auto first_line = [](const std::string& t) { return t.substr(0, t.find('\n')); };
    const bool same_text =
        text->substr(std::min(text->size(), text->find('\n'))) == resolved_yaml.substr(resolved_yaml.find('\n'));
    throw InputError(fmt::format("{}: holds {}; choose another folder with -o, or remove this one", directory.string(),
                                 same_text ? fmt::format("this campaign with another engine or model ('{}', now '{}')",
                                                         first_line(*text), first_line(resolved_yaml))
                                           : "another campaign (its campaign.yaml differs)"));
  }
  // A run that was killed at its very start leaves these.
  for (const auto& entry : fs::directory_iterator(directory, error)) {
    const std::string name = entry.path().filename().string();
    if (name == "run.lock" || name.starts_with(".campaign.yaml.partial-") ||
        (name == folder && fs::is_empty(entry.path(), error)))
      continue;
    throw InputError(
        fmt::format("{}: holds {} and no campaign; choose another folder with -o", directory.string(), name));
  }
}

Status open(const fs::path& directory, const std::string& folder, const std::string& resolved_yaml, FolderLock& lock) {
  std::error_code error;
  fs::create_directories(directory / folder, error);
  if (error)
    return tl::unexpected(fmt::format("{}: cannot be created ({})", (directory / folder).string(), error.message()));
  if (auto ok = lock.take(directory); !ok) return ok;
  const fs::path file = directory / "campaign.yaml";
  if (text_of(file) == resolved_yaml) return {};
  return write_file(file, resolved_yaml, Existing::refuse);
}

/// The checksums of the parts, one line each: eight hexadecimal digits, a space, the name of the part.
class Checksums {
 public:
  explicit Checksums(fs::path file) : file_(std::move(file)) {
    std::istringstream lines(text_of(file_).value_or(""));
    for (std::string sum, name; lines >> sum >> name;) sums_[name] = sum;
  }
  bool match(const std::string& name, std::string_view text) const {
    const auto sum = sums_.find(name);
    return sum != sums_.end() && sum->second == sum_of(text);
  }
  Status add(const std::string& name, std::string_view text) {
    sums_[name] = sum_of(text);
    std::string all;
    for (const auto& [part, sum] : sums_) all += fmt::format("{} {}\n", sum, part);
    return write_file(file_, all, Existing::replace);
  }

 private:
  static std::string sum_of(std::string_view text) { return fmt::format("{:08x}", crc32(text)); }
  fs::path file_;
  std::map<std::string, std::string> sums_;
};

}  // namespace

std::string resolved_yaml(const mujoco::Model& model, const YAML::Node& campaign) {
  return fmt::format("# MuJoCo {}, model {:016x}\n{}", mj_versionString(), fingerprint(model), to_text(campaign));
}

Result<Completed> complete(const std::string& resolved_yaml, const ResumableJobs& parts, const LabOptions& options) {
  const auto started = std::chrono::steady_clock::now();
  require_free(resolved_yaml, parts.folder, options.directory);
  const auto lock = std::make_shared<FolderLock>();
  if (auto ok = open(options.directory, parts.folder, resolved_yaml, *lock); !ok) return tl::unexpected(ok.error());
  const auto file = [&](std::size_t i) { return options.directory / parts.folder / parts.files[i]; };

  Checksums sums(options.directory / "checksums");
  Completed out{.texts = std::vector<std::string>(parts.files.size()), .lock = lock};
  std::vector<std::size_t> missing;
  for (std::size_t i = 0; i < parts.files.size(); ++i) {
    auto present = text_of(file(i));
    if (present && sums.match(parts.files[i], *present) && parts.whole(i, *present)) {
      out.texts[i] = std::move(*present);
      continue;
    }
    missing.push_back(i);
  }
  out.present = parts.files.size() - missing.size();

  std::atomic<std::size_t> next = 0;
  std::atomic<bool> stop = false;
  std::mutex mutex;  // guards what follows
  std::string error;
  std::size_t error_at = parts.files.size(), finished = 0;
  const auto work = [&] {
    for (std::size_t k; !stop && (k = next++) < missing.size();) {
      const std::size_t i = missing[k];
      auto made = parts.make(i);
      Status kept = made ? write_file(file(i), *made, Existing::replace) : Status(tl::unexpected(made.error()));
      const std::lock_guard guard(mutex);
      if (kept) kept = sums.add(parts.files[i], *made);
      if (!kept) {
        stop = true;
        if (i < error_at) error_at = i, error = kept.error().message;
        return;
      }
      out.texts[i] = std::move(*made);
      ++finished;
      if (options.progress)
        options.progress(static_cast<double>(out.present + finished) / static_cast<double>(parts.files.size()),
                         std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count() /
                             static_cast<double>(finished) * static_cast<double>(missing.size() - finished));
    }
  };
  const unsigned wanted = options.threads ? options.threads : std::max(1u, std::thread::hardware_concurrency());
  std::vector<std::thread> threads;
  for (unsigned t = 1; t < std::min<std::size_t>(wanted, missing.size()); ++t) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  if (error_at < parts.files.size()) return tl::unexpected(error);
  return out;
}

}  // namespace tribotwin::twin
