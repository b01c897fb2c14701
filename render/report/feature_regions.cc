#include <cmath>

#include <fmt/format.h>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/report/feature_regions.hpp>

namespace tribotwin::render {
namespace {

using namespace twin::diagnosis;

/// Two of the features of all observations.
HealthyScatter scatter(const FeatureRegions& r, Eigen::Index a, Eigen::Index b) {
  HealthyScatter s{.mean = {r.mean(a), r.mean(b)},
                   .covariance = {{{r.covariance(a, a), r.covariance(a, b)}, {r.covariance(b, a), r.covariance(b, b)}}},
                   .inner_sigma = std::sqrt(r.anomalous_distance),
                   .outer_sigma = std::sqrt(r.wear_distance)};
  const std::size_t region = a < regions[1].first ? 0 : 1;
  for (const auto& y : r.learned) s.learned.push_back({y(a), y(b)});
  for (const auto& [y, anomalous] : r.checked) (anomalous[region] ? s.anomalous : s.healthy).push_back({y(a), y(b)});
  return s;
}

}  // namespace

Axis feature_axis(Eigen::Index feature) {
  const auto i = static_cast<std::size_t>(feature);
  return {.quantity = std::string(feature_names[i]),
          .unit = feature_units[i] == "1" ? "-" : std::string(feature_units[i])};
}

Result<void> show_regions(IllustratedPage& page, pugi::xml_node to, const FeatureRegions& r, const std::string& of) {
  page.add(to, "p",
           "The ellipsoid of region 1 seen along each of its axes, and the ellipse of region 2: filled within 2 "
           "standard deviations, dashed at 6. Dots: learned; circles: healthy; crosses: anomalous in this region.",
           "soft");
  auto grid = page.add(to, "div", {}, "figures");
  for (const auto& [a, b] : {std::pair{0, 1}, {0, 2}, {1, 2}, {3, 4}}) {
    const Axis x = feature_axis(a), y = feature_axis(b);
    const std::string title =
        fmt::format("{}{}egion {}: {} and {}", of, of.empty() ? "R" : ", r", a < 3 ? 1 : 2, x.quantity, y.quantity);
    if (auto ok = page.show(
            grid, healthy_region(title, x, y, scatter(r, a, b)),
            fmt::format("{}{}{}_{}", of, of.empty() ? "" : "_", x.quantity, y.quantity),
            fmt::format("{} and {} of the {} (Zhou 2024). The ellipses are over all temperatures.", x.quantity,
                        y.quantity, a < 3 ? "velocity-weakening regime" : "velocity-strengthening regime"));
        !ok)
      return ok;
  }
  return {};
}

}  // namespace tribotwin::render
