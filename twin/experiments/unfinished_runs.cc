#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/experiments/part_store.hpp>
#include <tribotwin/twin/experiments/unfinished_runs.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/folder_lock.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

constexpr char reports[] = "reports", announced[] = "announced";
constexpr std::array files_of_a_run{"telemetry.h5", "summary.json", "scenario.yaml"};

/// A piece at a time: a recording is of any length.
void add_file(Fingerprint& all, const fs::path& file) {
  or_fail(check_input_file(file, "a file", limits::file_bytes, Pipes::refuse));
  std::ifstream stream(file, std::ios::binary);
  if (!stream) or_fail(Result<void>(not_read(file.string())));
  std::array<char, 1 << 16> bytes;
  while (stream) {
    stream.read(bytes.data(), bytes.size());
    all.add(std::string_view(bytes.data(), static_cast<std::size_t>(stream.gcount())));
  }
  if (stream.bad()) or_fail(Result<void>(not_read(file.string())));
}

/// Adds the content of each file that a value names. Models have a fingerprint of their own.
void add_files(Fingerprint& all, const YAML::Node& node) {
  if (node.IsMap() || node.IsSequence())
    for (const auto& entry : node) add_files(all, node.IsMap() ? entry.second : YAML::Node(entry));
  if (!node.IsScalar() || !node.Scalar().starts_with('/') || node.Scalar().ends_with(".xml")) return;
  std::error_code error;
  if (!fs::is_regular_file(node.Scalar(), error)) return;
  add_file(all, node.Scalar());
}

/// First line of what is announced.
std::string sum_of(const std::string& summary) { return fmt::format("{:08x}\n", crc32(summary)); }

Result<void> require_free(const fs::path& directory, const std::vector<std::string>& runs) {
  std::error_code error;
  for (const std::string& run : runs)
    for (const char* name : files_of_a_run)
      if (fs::exists(fs::symlink_status(directory / run / name, error)))
        return tl::unexpected(Error(
            fmt::format("{}: holds a run already ({}), not of this scenario; choose another folder with -o, or replace "
                        "it with --force",
                        (directory / run).string(), name)));
  return {};
}

}  // namespace

std::string identity_of(const std::vector<Scenario>& scenarios) {
  Fingerprint all;
  all.add(mj_versionString());
  for (const Scenario& one : scenarios) {
    all.add(one.resolved_yaml);
    all.add(fmt::format("{:016x}", fingerprint(*one.model)));
    if (one.baseline) all.add(fmt::format("{:016x}", fingerprint(*one.baseline)));
    add_files(all, YAML::Load(one.resolved_yaml));
  }
  return fmt::format("{:016x}\n", all.value());
}

UnfinishedRuns::UnfinishedRuns() = default;
UnfinishedRuns::UnfinishedRuns(UnfinishedRuns&&) noexcept = default;
UnfinishedRuns& UnfinishedRuns::operator=(UnfinishedRuns&&) noexcept = default;
UnfinishedRuns::~UnfinishedRuns() = default;

Result<UnfinishedRuns> UnfinishedRuns::open(const fs::path& directory, const std::vector<std::string>& runs,
                                            const std::string& identity, bool replace) {
  UnfinishedRuns opened;
  opened.directory_ = directory, opened.folder_ = directory / ".unfinished";
  std::error_code error;
  const auto there = read_text(opened.folder_ / "identity", "a file");
  opened.resumed_ = there && *there == identity;
  if (!opened.resumed_ && !replace)
    if (auto ok = require_free(directory, runs); !ok) return tl::unexpected(ok.error());
  if (!opened.resumed_) fs::remove_all(opened.folder_, error);
  fs::create_directories(opened.folder_ / reports, error);
  if (error)
    return work_failed(fmt::format("{}: cannot be created ({})", (opened.folder_ / reports).string(), error.message()));
  auto store = PartStore::open(opened.folder_, reports);
  if (!store) return work_failed(store.error().message);
  opened.store_ = std::make_unique<PartStore>(*std::move(store));
  if (!opened.resumed_)
    if (auto ok = write_file(opened.folder_ / "identity", identity, Existing::refuse); !ok)
      return work_failed(ok.error().message);
  return opened;
}

Result<void> UnfinishedRuns::announce(const fs::path& directory, const std::string& run, const std::string& summary,
                                      const std::string& report) {
  const fs::path folder = directory / ".unfinished" / announced;
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return work_failed(fmt::format("{}: cannot be created ({})", folder.string(), error.message()));
  const auto written = write_file(folder / run, sum_of(summary) + report, Existing::replace);
  return written ? Result<void>() : work_failed(written.error().message);
}

std::optional<std::string> UnfinishedRuns::find(const std::string& run) {
  std::error_code error;
  const bool whole = std::ranges::all_of(
      files_of_a_run, [&](const char* name) { return fs::is_regular_file(directory_ / run / name, error); });
  if (!whole) return std::nullopt;
  if (auto report = store_->find(run)) return report;
  const auto text = read_text(folder_ / announced / run, "a file");
  const auto summary = read_text(directory_ / run / "summary.json", "a file");
  if (!text || !summary) return std::nullopt;
  const std::string sum = sum_of(*summary);
  if (!text->starts_with(sum)) return std::nullopt;  // of an earlier attempt, or changed since
  clear(directory_ / run);
  std::string report = text->substr(sum.size());
  if (!store_->keep(run, report)) return std::nullopt;
  return report;
}

void UnfinishedRuns::clear(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> unfinished;
  for (const fs::directory_entry& entry : entries_of(folder).value_or(std::vector<fs::directory_entry>())) {
    const std::string there = entry.path().filename().string();
    for (const char* name : files_of_a_run)
      if (there.starts_with(fmt::format(".{}.partial-", name))) unfinished.push_back(entry.path());
    // What an attempt has set aside that was killed, too: the record of one before it. A whole run has a summary.
    if (there.starts_with("replaced") && entry.is_directory(error) && !fs::exists(entry.path() / "summary.json", error))
      unfinished.push_back(entry.path());
  }
  for (const fs::path& file : unfinished) fs::remove_all(file, error);
  // The file of a lock that nobody holds: released, it is gone.
  FolderLock left;
  if (fs::exists(folder / "run.lock", error)) static_cast<void>(left.take(folder));
}

Result<void> UnfinishedRuns::keep(const std::string& run, const std::string& report) {
  return store_->keep(run, report);
}

Result<void> UnfinishedRuns::close() { return store_->finish(); }

void UnfinishedRuns::forget() {
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

}  // namespace tribotwin::twin
