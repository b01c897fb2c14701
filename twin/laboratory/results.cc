#include <tribotwin/twin/laboratory/results.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <iterator>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/output/folder_lock.hpp>
#include <tribotwin/twin/output/output.hpp>
#include <tribotwin/twin/scenario/input.hpp>
#include <tribotwin/twin/table/table.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Status = tl::expected<void, std::string>;

std::optional<std::string> text_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return std::nullopt;
  return std::string(std::istreambuf_iterator<char>(stream), {});
}

/// The folder of a campaign.
class Folder {
 public:
  Folder(const Campaign& campaign, fs::path directory) : campaign_(campaign), directory_(std::move(directory)) {}

  Status open() {
    std::error_code error;
    fs::create_directories(directory_ / "curves", error);
    if (error) return tl::unexpected(fmt::format("{}: cannot be created ({})", directory_.string(), error.message()));
    if (auto ok = lock_.take(directory_); !ok) return ok;
    const fs::path file = directory_ / "campaign.yaml";
    if (text_of(file) == campaign_.resolved_yaml) return {};
    return write_file(file, campaign_.resolved_yaml);
  }

  /// Throws InputError where this campaign has no business.
  static void require_free(const Campaign& campaign, const fs::path& directory) {
    std::error_code error;
    if (!fs::exists(directory, error)) return;
    if (!fs::is_directory(directory, error)) throw InputError(fmt::format("{}: is a file, not a folder", directory.string()));
    if (const auto text = text_of(directory / "campaign.yaml")) {
      if (*text == campaign.resolved_yaml) return;
      const auto first_line = [](const std::string& t) { return t.substr(0, t.find('\n')); };
      const bool same_text = text->substr(std::min(text->size(), text->find('\n'))) == campaign.resolved_yaml.substr(campaign.resolved_yaml.find('\n'));
      throw InputError(fmt::format("{}: holds {}; choose another folder with -o, or remove this one", directory.string(),
                                   same_text ? fmt::format("this campaign with another engine or model ('{}', now '{}')", first_line(*text), first_line(campaign.resolved_yaml))
                                             : "another campaign (its campaign.yaml differs)"));
    }
    // A run that was killed at its very start leaves these.
    for (const auto& entry : fs::directory_iterator(directory, error)) {
      const std::string name = entry.path().filename().string();
      if (name == "run.lock" || name == "campaign.yaml.partial" || (name == "curves" && fs::is_empty(entry.path(), error))) continue;
      throw InputError(fmt::format("{}: holds {} and no campaign; choose another folder with -o", directory.string(), name));
    }
  }

  fs::path file(const Curve& curve) const { return directory_ / "curves" / fmt::format("{:0{}}.csv", curve.number, width_); }

  /// Rows of a curve that was measured; none for a file that is not whole.
  std::optional<std::string> rows(const Curve& curve) const {
    auto text = text_of(file(curve));
    if (!text || !text->starts_with(curve_columns) || !text->ends_with('\n')) return std::nullopt;
    text->erase(0, std::strlen(curve_columns));
    if (static_cast<std::size_t>(std::ranges::count(*text, '\n')) != curve.measurement.speeds_rad_s.size()) return std::nullopt;
    return text;
  }
  Status keep(const Curve& curve, const std::string& rows) const { return write_file(file(curve), curve_columns + rows); }

 private:
  const Campaign& campaign_;
  fs::path directory_;
  FolderLock lock_;
  std::size_t width_ = std::max<std::size_t>(3, fmt::formatted_size("{}", campaign_.curves.size()));
};

}  // namespace

tl::expected<LabSummary, std::string> run_campaign(const Campaign& campaign, const LabOptions& options) {
  const auto started = std::chrono::steady_clock::now();
  const auto seconds = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count(); };
  Folder::require_free(campaign, options.directory);
  Folder folder(campaign, options.directory);
  if (auto ok = folder.open(); !ok) return tl::unexpected(ok.error());

  std::vector<std::string> rows(campaign.curves.size());
  std::vector<std::size_t> missing;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (auto present = folder.rows(campaign.curves[i])) rows[i] = std::move(*present);
    else missing.push_back(i);
  }
  LabSummary summary{.curves = rows.size(), .present = rows.size() - missing.size()};

  std::atomic<std::size_t> next = 0;
  std::atomic<bool> stop = false;
  std::mutex mutex;   // guards what follows
  std::string error;
  std::size_t error_at = rows.size(), finished = 0;
  const auto work = [&] {
    for (std::size_t k; !stop && (k = next++) < missing.size();) {
      const std::size_t i = missing[k];
      auto measured = measured_rows(campaign, campaign.curves[i]);
      Status kept = measured ? folder.keep(campaign.curves[i], *measured) : Status(tl::unexpected(measured.error()));
      const std::lock_guard lock(mutex);
      if (!kept) {
        stop = true;
        if (i < error_at) error_at = i, error = kept.error();
        return;
      }
      rows[i] = std::move(*measured);
      ++finished;
      if (options.progress)
        options.progress(static_cast<double>(summary.present + finished) / static_cast<double>(rows.size()),
                         seconds() / static_cast<double>(finished) * static_cast<double>(missing.size() - finished));
    }
  };
  const unsigned wanted = options.threads ? options.threads : std::max(1u, std::thread::hardware_concurrency());
  std::vector<std::thread> threads;
  for (unsigned t = 1; t < std::min<std::size_t>(wanted, missing.size()); ++t) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  if (error_at < rows.size()) return tl::unexpected(error);

  std::string all = curve_columns;
  for (const std::string& part : rows) all += part;
  const fs::path file = options.directory / "curves.csv";
  if (auto ok = write_file(file, all); !ok) return tl::unexpected(ok.error());

  const auto table = read_table(file);
  if (!table) return tl::unexpected(table.error());
  const auto speed = table->numbers("speed_rad_s"), load = table->numbers("load_norm"), temperature = table->numbers("temperature_degC");
  for (const auto* column : {&speed, &load, &temperature})
    if (!*column) return tl::unexpected(column->error());
  const drive::Drive& drive = campaign.model->drives()[campaign.drive].drive;
  summary.levels = speed->size();
  for (std::size_t i = 0; i < speed->size(); ++i) {
    // What was set at the edge of the range was measured a rounding beside it.
    bool outside = true;
    for (const double side : {-1e-3, 1e-3})
      outside = outside && friction::level(drive.law, friction::at_temperature(drive.law, (*temperature)[i] + side),
                                           (*speed)[i] / drive.gear_ratio * drive.speed_scale() * (1 - 1e-3), (*load)[i] * (1 - 1e-3)).outside;
    summary.outside += outside;
  }
  summary.wall_s = seconds();
  return summary;
}

}  // namespace tribotwin::twin
