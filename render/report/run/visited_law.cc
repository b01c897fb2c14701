#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/report/run/visited_law.hpp>
#include <tribotwin/twin/numerics/median.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render {
namespace {

/// At most 250 of the points that `fit`, evenly chosen.
std::vector<FrictionPoint> some(const std::vector<FrictionPoint>& all, auto fit) {
  constexpr std::size_t count_max = 250;
  std::vector<FrictionPoint> good, few;
  std::ranges::copy_if(all, std::back_inserter(good), fit);
  const std::size_t step = good.size() / count_max + 1;
  for (std::size_t i = 0; i < good.size(); i += step) few.push_back(good[i]);
  return few;
}

bool any(const FrictionPoint&) { return true; }

Drawing over_temperature(const VisitedLaw& v, int curves) {
  const auto& law = *v.drive.law.info;
  const auto at_load = [&](const FrictionPoint& p) { return std::abs(p.load_norm - v.load_median) <= v.load_window(); };
  return {in_units_of(friction_against_temperature(v.drive, "", v.speed_max_rad_s, v.load_median,
                                                   evenly(v.temperature_min_degC, v.temperature_max_degC, curves),
                                                   law.load_dependent ? some(v.points, at_load) : some(v.points, any)),
                      v.slide),
          law.load_dependent
              ? fmt::format("Law '{}' at a load of {:.3f} of the maximum torque. Points: samples of the "
                            "run with a load within {:.3f} of that.",
                            law.name, v.load_median, v.load_window())
              : fmt::format("Law '{}', which does not depend on load. Points: samples of the run.", law.name)};
}

std::optional<Drawing> at_temperatures(const VisitedLaw& v) {
  if (!v.drive.law.info->temperature_dependent) return std::nullopt;
  return over_temperature(v, v.temperature_max_degC - v.temperature_min_degC > 0.5 ? 7 : 1);
}

std::optional<Drawing> of_speed_alone(const VisitedLaw& v) {
  if (v.drive.law.info->temperature_dependent || v.drive.law.info->load_dependent) return std::nullopt;
  return over_temperature(v, 1);
}

std::optional<Drawing> at_loads(const VisitedLaw& v) {
  const auto& law = *v.drive.law.info;
  if (!law.load_dependent) return std::nullopt;
  const auto at_temperature = [&](const FrictionPoint& p) {
    return std::abs(p.temperature_degC - v.temperature_median_degC) <= v.temperature_window_K();
  };
  return Drawing{
      in_units_of(
          friction_against_load(v.drive, "", v.speed_max_rad_s, v.temperature_median_degC,
                                evenly(0, v.load_max, v.load_max > 0.01 ? 6 : 1),
                                law.temperature_dependent ? some(v.points, at_temperature) : some(v.points, any)),
          v.slide),
      law.temperature_dependent
          ? fmt::format("Law '{}' at {:.1f} °C. Points: samples of the run within {:.2g} K of that.", law.name,
                        v.temperature_median_degC, v.temperature_window_K())
          : fmt::format("Law '{}', which does not depend on temperature. Points: samples of the run.", law.name)};
}

std::optional<Drawing> surface(const VisitedLaw& v) {
  const auto& law = *v.drive.law.info;
  if (!law.temperature_dependent || !v.warmest || v.temperature_max_degC - v.temperature_min_degC <= 5)
    return std::nullopt;
  return Drawing{in_units_of(friction_surface(v.drive, "", v.speed_max_rad_s, v.load_median, v.temperature_min_degC,
                                              v.temperature_max_degC),
                             v.slide),
                 fmt::format("Law '{}' at a load of {:.3f} of the maximum torque.", law.name, v.load_median)};
}

constexpr FigureRow<VisitedLaw> table[] = {
    {"temperature", "friction at the run's temperatures", at_temperatures},
    {"temperature", "friction", of_speed_alone},
    {"load", "friction at the run's loads", at_loads},
    {"surface", "friction over speed and temperature", surface},
};

}  // namespace

double VisitedLaw::load_window() const { return std::max(0.1 * load_max, 0.005); }
double VisitedLaw::temperature_window_K() const {
  return std::max(0.05 * (temperature_max_degC - temperature_min_degC), 0.25);
}

std::optional<VisitedLaw> visited_law(const RunData& run, const JointHistory& j) {
  const auto index = twin::find_drive(*run.model(), j.name);
  if (!j.moved || !index) return std::nullopt;
  VisitedLaw v{
      .number = *index + 1, .drive = run.model()->drives()[*index].drive, .speed_max_rad_s = 1.05 * j.speed_max_rad_s};
  std::vector<double> loads, temperatures;
  const std::size_t samples =
      std::min({run.record.time_s.size(), j.friction_nm.size(), j.load_nm.size(), j.temperature_degC.size()});
  for (std::size_t i = 0; i < samples; ++i) {
    const FrictionPoint p{std::abs(j.velocity_rad_s[i]), std::abs(j.load_nm[i]) / v.drive.torque_max_nm,
                          j.temperature_degC[i],
                          std::abs(j.friction_nm[i]) / drive::direction_factor(v.drive, j.velocity_rad_s[i])};
    if (!(p.speed_rad_s > 0.02 * j.speed_max_rad_s && std::isfinite(p.load_norm + p.temperature_degC + p.friction_nm)))
      continue;
    v.points.push_back(p);
    loads.push_back(p.load_norm);
    temperatures.push_back(p.temperature_degC);
  }
  if (v.points.empty()) return std::nullopt;
  v.drive.asymmetry = 0;  // the points are those of a symmetric drive
  v.load_max = std::ranges::max(loads);
  v.load_median = twin::identification::median_of(loads);
  v.temperature_min_degC = std::ranges::min(temperatures);
  v.temperature_max_degC = std::ranges::max(temperatures);
  v.temperature_median_degC = twin::identification::median_of(temperatures);
  const auto joints = joint_summaries(run);
  const JointSummary* hot = warmest(joints);
  v.warmest = hot && hot->name == j.name;
  v.slide = j.slide;
  return v;
}

std::span<const FigureRow<VisitedLaw>> law_figures() { return table; }

}  // namespace tribotwin::render
