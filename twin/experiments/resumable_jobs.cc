#include <algorithm>
#include <chrono>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/part_store.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/folder_lock.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>
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
  const auto entries = entries_of(directory);
  if (!entries) return tl::unexpected(entries.error());
  for (const fs::directory_entry& entry : *entries) {
    const std::string name = entry.path().filename().string();
    if (name == "run.lock" || name.starts_with(".campaign.yaml.partial-") ||
        (name == folder && fs::is_empty(entry.path(), error)))
      continue;
    return refused(fmt::format("holds {} and no campaign; choose another folder with -o", name));
  }
  return {};
}

Status open(const fs::path& directory, const ResumableJobs& parts, const std::string& resolved_yaml, FolderLock& lock) {
  std::error_code error;
  fs::create_directories(directory / parts.folder, error);
  if (error)
    return work_failed(fmt::format("{}: cannot be created ({})", (directory / parts.folder).string(), error.message()));
  if (auto ok = lock.take(directory); !ok) return work_failed(ok.error().message);
  const fs::path file = directory / "campaign.yaml";
  if (text_of(file) != resolved_yaml)
    if (auto ok = write_file(file, resolved_yaml, Existing::refuse); !ok) return work_failed(ok.error().message);
  const auto& [name, text] = parts.origin;
  if (name.empty() || text_of(directory / name) == text) return {};
  if (auto ok = write_file(directory / name, text, Existing::replace); !ok) return work_failed(ok.error().message);
  return {};
}

/// Calls the progress of the user with the time left.
auto reporter(const LabOptions& options) {
  return [progress = options.progress, started = std::chrono::steady_clock::now(), first = std::size_t{0}](
             std::size_t over, std::size_t of) mutable {
    if (!progress) return;
    if (first == 0) first = over;  // those of earlier runs took no time
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - started;
    progress(static_cast<double>(over) / static_cast<double>(of),
             spent.count() / static_cast<double>(over - first + 1) * static_cast<double>(of - over));
  };
}

/// The error of a campaign that is not complete.
tl::unexpected<Error> incomplete(const Outcome& outcome, const ResumableJobs& parts, const LabOptions& options) {
  const std::size_t all = parts.files.size();
  if (outcome.failures.empty()) return work_failed(fmt::format("{}: interrupted", options.directory.string()));
  return work_failed(
      fmt::format("{}: {} of {} parts failed ({}/failures.csv): {}", options.directory.string(),
                  outcome.failures.size(), all, options.directory.string(),
                  text_of(outcome.failures, [&](std::size_t i) { return parts.folder + "/" + parts.files[i]; })));
}

}  // namespace

std::string resolved_yaml(const mujoco::Model& model, const YAML::Node& campaign) {
  return fmt::format("# MuJoCo {}, model {:016x}\n{}", mj_versionString(), fingerprint(model), to_text(campaign));
}

std::string engine_of(const std::string& campaign_yaml) {
  const auto begin = campaign_yaml.substr(0, campaign_yaml.find_first_of(",\n"));
  return begin.starts_with("# MuJoCo ") ? begin.substr(2) : "";
}

Result<Completed> complete(const std::string& resolved_yaml, const ResumableJobs& parts, const LabOptions& options) {
  const auto lock = std::make_shared<FolderLock>();
  std::optional<PartStore> store;  // of rank 0
  const auto opened = ranks().on_root([&]() -> Status {
    if (auto ok = require_free(resolved_yaml, parts.folder, options.directory); !ok) return ok;
    if (auto ok = open(options.directory, parts, resolved_yaml, *lock); !ok) return ok;
    auto there = PartStore::open(options.directory, parts.folder);
    if (!there) return work_failed(there.error().message);
    store = *std::move(there);
    return {};
  });
  if (!opened) return tl::unexpected(opened.error());

  const Tasks tasks{.count = parts.files.size(),
                    .identity = fmt::format("{:08x}", crc32(resolved_yaml)),
                    .work = [&](std::size_t i, const std::string&) { return parts.make(i); },
                    .own_processes = true,
                    .present = [&](std::size_t i) -> std::optional<std::string> {
                      auto text = store->find(parts.files[i]);
                      return text && parts.whole(i, *text) ? std::move(text) : std::nullopt;
                    },
                    .keep = [&](std::size_t i, const std::string& text) { return store->keep(parts.files[i], text); },
                    .progress = reporter(options)};
  auto outcome = carry_out(tasks, {.threads = options.threads, .retries = options.retries, .stop = options.stop});
  if (!outcome) return work_failed(outcome.error().message);
  const auto finished = ranks().on_root([&]() -> Status {
    if (auto ok = store->finish(); !ok) return work_failed(ok.error().message);
    const auto name = [&](std::size_t i) { return parts.folder + "/" + parts.files[i]; };
    const auto input = [](std::size_t i) { return fmt::format("part {} of campaign.yaml", i); };
    if (auto ok = write_failures(options.directory, outcome->failures, name, input); !ok)
      return work_failed(ok.error().message);
    return {};
  });
  if (!finished) return tl::unexpected(finished.error());
  if (outcome->stopped || (!outcome->failures.empty() && !parts.in_place_of))
    return incomplete(*outcome, parts, options);
  for (const TaskFailure& f : outcome->failures) outcome->results[f.task] = parts.in_place_of(f.task, f.error);
  return Completed{.texts = std::move(outcome->results), .present = outcome->present, .lock = lock};
}

}  // namespace tribotwin::twin
