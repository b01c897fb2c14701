#pragma once

#include <memory>
#include <span>
#include <string>

#include <tribotwin/render/page/figure_table.hpp>
#include <tribotwin/render/report/run/run_data.hpp>

namespace tribotwin::render {

/// The runs of a page.
struct Runs {
  std::span<const std::unique_ptr<RunData>> all;

  /// The scenario where all have one, and how many there are; the name of a single one.
  std::string title() const;
  /// The run's name, with its folder where names are alike.
  std::string label(const RunData& run) const;
};

/// Adds a table and figures that show the runs beside each other. Fails where they cannot be drawn.
Result<void> add_comparison(IllustratedPage& page, const Runs& runs);

}  // namespace tribotwin::render
