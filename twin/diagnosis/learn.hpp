#pragma once

#include <span>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/healthy.hpp>

namespace tribotwin::twin::diagnosis {

struct LearnOptions {
  bool robust = false;  ///< leave outliers out (minimum covariance determinant, reweighted)
  double lever_m = 0;   ///< as in HealthyState
};

/// `loaded`: curves of the same joint with load, from which its effect is learned; may be empty. ErrorKind::input, with
/// what to record next: too few observations, all of them equal or collinear, features that are not identifiable from a
/// curve, loaded curves among `healthy`, more than one joint or unit.
Result<HealthyState> learn(std::span<const ObservationFile> healthy, std::span<const ObservationFile> loaded,
                           double load_sensitivity, const LearnOptions& options = {});

}  // namespace tribotwin::twin::diagnosis
