#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/report/record/run_data.hpp>

/// What figures may take from a run whose motion repeats: values of every work cycle, and the samples of complete ones.
/// A multi-rate run has samples of some cycles only, more where it is cold, and a part of a cycle is no measure of the
/// whole: no figure may depend on which samples there happen to be.
namespace tribotwin::render {

/// Whether the record has values of every work cycle.
bool has_cycles(const RunData& run);

/// A work cycle that the record has all samples of.
struct CompleteCycle {
  std::size_t begin, end;  ///< first sample, and the one after the last
  double middle_s;
  std::size_t row;  ///< of the record's values of every work cycle
};
std::vector<CompleteCycle> complete_cycles(const RunData& run);

/// Of every work cycle where there are any, else of the samples.
Trace lubricant_temperature(std::string label, const RunData& run, const JointHistory& joint);
/// Mean friction power of every work cycle; empty without cycles.
Trace friction_power(std::string label, const RunData& run, const JointHistory& joint);
/// Standard deviation of a work cycle's mean friction power [W], by how far it is from the mean of both neighbours
/// (differences of second order, so that a slow warm-up is no scatter), over complete cycles beside complete cycles
/// without the first of the record, which begins from rest. NaN where fewer than 5 are.
double friction_power_scatter(const RunData& run, const JointHistory& joint);

/// Root mean square over each complete cycle; where its motion does not repeat over windows of 1/200 of the run, or of
/// 5 samples where that is longer.
Trace friction_rms(std::string label, const RunData& run, const JointHistory& joint);
/// How friction_rms came about, for a caption.
std::string friction_rms_caption(const RunData& run);

}  // namespace tribotwin::render
