#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/experiments/fault_study/power.hpp>

namespace tribotwin::render {

/// A measured curve, level by level.
struct StudyCurve {
  std::string series;
  std::vector<double> speed_rad_s, friction_nm;  ///< motor side; arm side
};

/// The features of a curve.
struct StudyObservation {
  std::size_t curve = 0;  ///< key of StudyJoint::curves
  double temperature_degC = 0;
  twin::diagnosis::Features features;  ///< in feature_units
};

/// An observation with its verdict.
struct StudyVerdict : StudyObservation {
  double load_kg = 0;
  std::string state, pattern;                            ///< given by the campaign; found by the verdict
  std::vector<std::string> faults;                       ///< of the twin, on purpose
  std::array<twin::diagnosis::RegionVerdict, 2> region;  ///< distance, statistic, limit, anomalous
  bool anomalous = false;

  bool is_named() const;     ///< the pattern is one of the faults
  std::string name() const;  ///< "2 kg, cold"
};

struct StudyJoint {
  std::string name;
  std::map<std::size_t, StudyCurve> curves;  ///< by number
  std::vector<StudyObservation> learned;     ///< at least observations_minimum, in the order of time
  std::vector<StudyVerdict> checked;         ///< at least one
  std::vector<twin::study::Power> power;     ///< empty where no curves were drawn
};

/// Reads the folder of `tribotwin lab` for a study: DIR/diagnosis.json, DIR/JOINT/curves.csv. Fails with
/// file, key and what would be right.
Result<std::vector<StudyJoint>> load_study_folder(const std::filesystem::path& directory);

}  // namespace tribotwin::render
