#pragma once

#include <array>
#include <limits>
#include <span>
#include <vector>

#include <tribotwin/twin/diagnosis/observation.hpp>

namespace tribotwin::twin::diagnosis::fleet {

/// Lower triangular roots of the covariances that a fit claims of itself for levels of unit variance, by rows: 6
/// numbers of the first region, 3 of the second; 0: not known.
using ClaimRoots = std::array<float, 9>;

/// One observation of one joint, as far as the statistics of a fleet need it.
struct Row {
  double day = 0;                                                      ///< since 1970-01-01, with fractions
  double temperature_degC = std::numeric_limits<double>::quiet_NaN();  ///< NaN: not known
  double load_norm = std::numeric_limits<double>::quiet_NaN();         ///< NaN: not known
  Features logarithmic = Features::Zero();                             ///< Observation::logarithmic()
  std::array<double, 2> scatter{1, 1};  ///< of the fit in both regions (shape_scatter); 0: not known
  ClaimRoots claim{};
};

/// The rows of one joint of one robot in the order of time.
using Rows = std::vector<Row>;

}  // namespace tribotwin::twin::diagnosis::fleet
