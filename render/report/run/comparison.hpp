#pragma once

#include <memory>
#include <span>
#include <string>

#include <tribotwin/render/page/figure_table.hpp>
#include <tribotwin/render/report/record/run_data.hpp>

namespace tribotwin::render {

/// Of more runs than this each has a small figure of its own beside the first.
inline constexpr std::size_t overlaid_max = 6;
/// Of more runs than this their sections are closed: what they say is in the comparison, and paper has an end.
inline constexpr std::size_t open_max = 2;

/// The runs of a page.
struct Runs {
  std::span<const std::unique_ptr<RunData>> all;
  bool many() const { return all.size() > overlaid_max; }
  bool closed() const { return all.size() > open_max; }

  /// The scenario where all have one, and how many there are; the name of a single one.
  std::string title() const;
  /// What names it among the others: its name, or the shortest end of its folder's path that no other has.
  std::string label(const RunData& run) const;
};

/// Adds what differs: keys, results, and figures of the joint whose friction differs most, with their differences.
/// Fails where they cannot be drawn.
Result<void> add_comparison(IllustratedPage& page, const Runs& runs);

}  // namespace tribotwin::render
