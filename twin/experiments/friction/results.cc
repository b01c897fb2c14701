#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/friction/curve_rows.hpp>
#include <tribotwin/twin/experiments/friction/results.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>
#include <tribotwin/twin/simulation/watch.hpp>

namespace tribotwin::twin {

namespace {

/// Levels that the law does not cover, and those that the robot's drive could not have driven: the bench has no limits.
void count_levels(const Campaign& campaign, const Numbers& table, LabSummary& summary) {
  const auto &speed = table.columns[0], &load = table.columns[1], &temperature = table.columns[2],
             &friction_norm = table.columns[3];
  const mujoco::Binding& binding = campaign.model->drives()[campaign.drive];
  const drive::Drive& drive = binding.drive;
  const auto [low, high] = control_range(*campaign.model, campaign.drive);
  const double limit_nm = std::max(-low, high) * std::abs(binding.gear);
  summary.levels = speed.size();
  for (std::size_t i = 0; i < speed.size(); ++i) {
    // A condition at the edge of the range is measured within rounding of it.
    bool outside = true;
    for (const double side : {-1e-3, 1e-3})
      outside = outside &&
                friction::level(drive.law, friction::at_temperature(drive.law, temperature[i] + side),
                                speed[i] / drive.gear_ratio * drive.speed_scale() * (1 - 1e-3), load[i] * (1 - 1e-3))
                    .outside;
    summary.outside += outside;
    summary.saturated += (std::abs(load[i]) + std::abs(friction_norm[i])) * drive.torque_max_nm > limit_nm * (1 + 1e-3);
  }
  if (summary.saturated > 0) summary.torque_limit_nm = limit_nm;
}

}  // namespace

Result<LabSummary> run_campaign(const Campaign& campaign, const LabOptions& options) {
  const auto started = std::chrono::steady_clock::now();
  ResumableJobs parts{.folder = "curves",
                      .files = {},
                      .whole =
                          [&](std::size_t i, const std::string& text) {
                            return text.starts_with(curve_columns) && text.ends_with('\n') &&
                                   static_cast<std::size_t>(std::ranges::count(text, '\n')) ==
                                       1 + campaign.curves[i].measurement.speeds_rad_s.size();
                          },
                      .make =
                          [&](std::size_t i) {
                            return measured_rows(campaign, campaign.curves[i]).map([](const std::string& rows) {
                              return curve_columns + rows;
                            });
                          }};
  const std::size_t width = std::max<std::size_t>(3, fmt::formatted_size("{}", campaign.curves.size()));
  for (const Curve& curve : campaign.curves) parts.files.push_back(fmt::format("{:0{}}.csv", curve.number, width));
  const auto completed = complete(campaign.resolved_yaml, parts, options);
  if (!completed) return tl::unexpected(completed.error());
  LabSummary summary{.curves = campaign.curves.size(), .present = completed->present};

  const auto counted = ranks().on_root([&]() -> Result<void> {
    std::string all = curve_columns;
    for (const std::string& text : completed->texts) all += text.substr(std::strlen(curve_columns));
    const std::filesystem::path file = options.directory / "curves.csv";
    if (auto ok = write_derived(file, all, options.existing); !ok) return work_failed(ok.error().message);
    const auto table = read_numbers(file, {"speed_rad_s", "load_norm", "temperature_degC", "friction_norm"});
    if (!table) return work_failed(table.error().message);
    count_levels(campaign, *table, summary);
    return {};
  });
  if (!counted) return tl::unexpected(counted.error());
  summary.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return summary;
}

}  // namespace tribotwin::twin
