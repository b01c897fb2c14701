#include <algorithm>
#include <chrono>
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
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Status = Result<void>;

std::optional<std::string> text_of(const fs::path& file) {
  auto text = read_text(file, "a file");
  return text ? std::optional(std::move(*text)) : std::nullopt;
}

/// Whether the directory may be used for this campaign.
Status require_free(const std::string& resolved_yaml, const std::string& folder, const fs::path& directory) {
  const auto refused = [&](const std::string& why) {
    return tl::unexpected(Error(fmt::format("{}: {}", directory.string(), why)));
  };
  std::error_code error;
  if (!fs::exists(directory, error)) return {};
  if (!fs::is_directory(directory, error)) return refused("is a file, not a folder");
  if (const auto text = text_of(directory / "campaign.yaml")) {
    if (*text == resolved_yaml) return {};
    const auto first_line = [](const std::string& t) { return t.substr(0, t.find('\n')); };
    const bool same_text =
        text->substr(std::min(text->size(), text->find('\n'))) == resolved_yaml.substr(resolved_yaml.find('\n'));
    return refused(fmt::format("holds {}; choose another folder with -o, or remove this one",
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
    return refused(fmt::format("holds {} and no campaign; choose another folder with -o", name));
  }
  return {};
}

Status open(const fs::path& directory, const std::string& folder, const std::string& resolved_yaml, FolderLock& lock) {
  std::error_code error;
  fs::create_directories(directory / folder, error);
  if (error)
    return work_failed(fmt::format("{}: cannot be created ({})", (directory / folder).string(), error.message()));
  if (auto ok = lock.take(directory); !ok) return work_failed(ok.error().message);
  const fs::path file = directory / "campaign.yaml";
  if (text_of(file) == resolved_yaml) return {};
  if (auto ok = write_file(file, resolved_yaml, Existing::refuse); !ok) return work_failed(ok.error().message);
  return {};
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

/// The missing parts, made by several threads.
class Workers {
 public:
  Workers(const ResumableJobs& parts, const LabOptions& options, const std::vector<std::size_t>& missing,
          Checksums& sums, Completed& out)
      : parts_(parts), options_(options), missing_(missing), sums_(sums), out_(out) {}

  Status run() {
    const unsigned wanted = options_.threads ? options_.threads : std::max(1u, std::thread::hardware_concurrency());
    identification::in_parallel_until_failure(missing_.size(), wanted,
                                              [this](std::size_t k) { return complete(missing_[k]); });
    if (error_at_ < parts_.files.size()) return work_failed(error_);
    return {};
  }

 private:
  /// Makes part i and keeps it.
  bool complete(std::size_t i) {
    auto made = parts_.make(i);
    Status kept = made ? write_file(options_.directory / parts_.folder / parts_.files[i], *made, Existing::replace)
                       : Status(tl::unexpected(made.error()));
    const std::lock_guard guard(mutex_);
    if (kept) kept = sums_.add(parts_.files[i], *made);
    if (!kept) {
      if (i < error_at_) error_at_ = i, error_ = kept.error().message;
      return false;
    }
    out_.texts[i] = std::move(*made);
    ++finished_;
    report();
    return true;
  }

  void report() const {
    if (!options_.progress) return;
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - started_;
    options_.progress(
        static_cast<double>(out_.present + finished_) / static_cast<double>(parts_.files.size()),
        spent.count() / static_cast<double>(finished_) * static_cast<double>(missing_.size() - finished_));
  }

  const ResumableJobs& parts_;
  const LabOptions& options_;
  const std::vector<std::size_t>& missing_;
  const std::chrono::steady_clock::time_point started_ = std::chrono::steady_clock::now();
  std::mutex mutex_;  ///< guards all below
  Checksums& sums_;
  Completed& out_;
  std::string error_;
  std::size_t error_at_ = parts_.files.size(), finished_ = 0;  ///< the error of the first part
};

}  // namespace

std::string resolved_yaml(const mujoco::Model& model, const YAML::Node& campaign) {
  return fmt::format("# MuJoCo {}, model {:016x}\n{}", mj_versionString(), fingerprint(model), to_text(campaign));
}

Result<Completed> complete(const std::string& resolved_yaml, const ResumableJobs& parts, const LabOptions& options) {
  if (auto ok = require_free(resolved_yaml, parts.folder, options.directory); !ok) return tl::unexpected(ok.error());
  const auto lock = std::make_shared<FolderLock>();
  if (auto ok = open(options.directory, parts.folder, resolved_yaml, *lock); !ok) return tl::unexpected(ok.error());
  Checksums sums(options.directory / "checksums");
  Completed out{.texts = std::vector<std::string>(parts.files.size()), .lock = lock};
  std::vector<std::size_t> missing;
  for (std::size_t i = 0; i < parts.files.size(); ++i) {
    auto present = text_of(options.directory / parts.folder / parts.files[i]);
    if (present && sums.match(parts.files[i], *present) && parts.whole(i, *present))
      out.texts[i] = std::move(*present);
    else
      missing.push_back(i);
  }
  out.present = parts.files.size() - missing.size();
  if (auto ok = Workers(parts, options, missing, sums, out).run(); !ok) return tl::unexpected(ok.error());
  return out;
}

}  // namespace tribotwin::twin
