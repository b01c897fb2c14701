#pragma once

#include <array>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/twin/diagnosis/healthy.hpp>

namespace tribotwin::render {

/// The confidence regions (Zhou 2024, eq. 14) of one joint, and observations that are compared with them.
struct FeatureRegions {
  twin::diagnosis::Features mean;
  twin::diagnosis::FeatureMatrix covariance;
  double anomalous_distance, wear_distance;  ///< squared radii of the ellipses, in standard deviations
  std::vector<twin::diagnosis::Features> learned;
  struct Checked {
    twin::diagnosis::Features features;
    std::array<bool, 2> anomalous;  ///< per region
  };
  std::vector<Checked> checked;
};

/// Figures 14 and 15 of Zhou 2024 as four drawings: region 1 along each of its axes, region 2. `of` comes before the
/// titles and in the names of files; may be empty. Fails where they cannot be drawn.
Result<void> show_regions(IllustratedPage& page, pugi::xml_node to, const FeatureRegions& regions,
                          const std::string& of = {});

/// Label and unit of a feature.
Axis feature_axis(Eigen::Index feature);

}  // namespace tribotwin::render
