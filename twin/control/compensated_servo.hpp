#pragma once

#include <tribotwin/twin/control/compensator.hpp>
#include <tribotwin/twin/control/servo.hpp>

namespace tribotwin::twin {

/// The cascaded servo with compensated torsion, for drives behind a transmission; others as they are.
struct CompensatedOptions {
  CascadedOptions loops;
  CompensatorOptions compensator;
  double identification_error = 0;  ///< relative, 1 sigma: the controller's model is not the plant
  std::uint64_t seed = 1;
};

std::unique_ptr<Servo> make_compensated(const mujoco::Model& model, const mjData* start,
                                        const CompensatedOptions& options);

}  // namespace tribotwin::twin
