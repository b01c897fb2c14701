#include <iterator>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/working_days/results.hpp>
#include <tribotwin/twin/experiments/working_days/tables.hpp>
#include <tribotwin/twin/experiments/working_days/working_day_file.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>

namespace tribotwin::twin::repeatability {
namespace {

Result<Results> found(const Campaign& campaign, std::vector<WorkingDay> days) {
  auto findings = find(campaign, days);
  if (!findings) return tl::unexpected(findings.error());
  return Results{.days = std::move(days), .findings = *std::move(findings)};
}

Shape shape_of(const Regressor& regressor) {
  return {.joints = static_cast<std::size_t>(regressor.joints()),
          .base = static_cast<std::size_t>(base_parameters(regressor).size())};
}

}  // namespace

Result<Results> run_campaign(const Campaign& campaign, const LabOptions& options) {
  const auto regressor = Regressor::create(campaign.model->get());
  if (!regressor)
    return tl::unexpected(Error(fmt::format("{}: {}", campaign.file.string(), regressor.error().message)));
  const auto excitation = excite(*campaign.model, *regressor, base_parameters(*regressor), campaign.excitation);
  if (!excitation) return work_failed(excitation.error().message);
  if (campaign.duration_s < excitation->duration_s())
    return tl::unexpected(Error(fmt::format("{}: duration_s: is {:g}, but one cycle of the motion takes {:.0f} s",
                                            campaign.file.string(), campaign.duration_s, excitation->duration_s())));
  const Shape shape = shape_of(*regressor);
  ResumableJobs parts{.folder = file_of(campaign, 0).parent_path().string(),
                      .files = {},
                      .whole = [&](std::size_t, const std::string& text) { return from_text(text, shape).has_value(); },
                      .make = [&](std::size_t test) { return working_day(campaign, *excitation, test).map(to_text); }};
  for (std::size_t test = 0; test < campaign.tests(); ++test)
    parts.files.push_back(file_of(campaign, test).filename().string());
  const auto completed = complete(campaign.resolved_yaml, parts, options);
  if (!completed) return tl::unexpected(completed.error());
  std::vector<WorkingDay> days;
  for (std::size_t test = 0; test < campaign.tests(); ++test) {
    auto day = from_text(completed->texts[test], shape);
    if (!day)
      return work_failed(
          fmt::format("{}: {}", (options.directory / file_of(campaign, test)).string(), day.error().message));
    days.push_back(*std::move(day));
  }
  auto out = found(campaign, std::move(days));
  if (!out) return out;
  out->present = completed->present;
  auto tables = repeatability::tables(campaign, out->days, out->findings);
  tables.push_back({"motion.csv", to_csv(*excitation, *regressor, 250)});
  for (const auto& [name, text] : tables) {
    out->files.push_back(options.directory / name);
    const auto write = [&] { return write_derived(out->files.back(), text, options.existing); };
    if (auto ok = ranks().on_root(write); !ok) return work_failed(ok.error().message);
  }
  return out;
}

Result<Results> read_results(const Campaign& campaign, const std::filesystem::path& directory) {
  const auto regressor = Regressor::create(campaign.model->get());
  if (!regressor) return tl::unexpected(fmt::format("{}: {}", campaign.file.string(), regressor.error().message));
  const Shape shape = shape_of(*regressor);
  std::vector<WorkingDay> days;
  for (std::size_t test = 0; test < campaign.tests(); ++test) {
    const auto file = directory / file_of(campaign, test);
    const auto text = read_text(file, "a file");
    if (!text)
      return tl::unexpected(
          fmt::format("{}: is missing; 'tribotwin lab' continues an interrupted campaign", file.string()));
    auto day = from_text(*text, shape);
    if (!day) return tl::unexpected(fmt::format("{}: {}", file.string(), day.error().message));
    days.push_back(*std::move(day));
  }
  return found(campaign, std::move(days));
}

}  // namespace tribotwin::twin::repeatability
