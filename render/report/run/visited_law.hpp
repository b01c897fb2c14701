#pragma once

#include <optional>
#include <span>
#include <vector>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/page/figure_table.hpp>
#include <tribotwin/render/report/record/run_data.hpp>

namespace tribotwin::render {

/// What a joint visited of its friction law while it slid.
struct VisitedLaw {
  std::size_t number;  ///< of the drive in the model, from 1
  drive::Drive drive;
  double speed_max_rad_s;  ///< joint side
  std::vector<FrictionPoint> points;
  double load_max, load_median;
  double temperature_min_degC, temperature_max_degC, temperature_median_degC;
  bool warmest;  ///< of all joints
  bool slide;

  /// A point this close to the median is shown with the curves of the median.
  double load_window() const;
  double temperature_window_K() const;
};

/// Nothing where the joint did not slide or has no drive in the model.
std::optional<VisitedLaw> visited_law(const RunData& run, const JointHistory& joint);

/// The law with what was visited of it.
std::span<const FigureRow<VisitedLaw>> law_figures();

}  // namespace tribotwin::render
