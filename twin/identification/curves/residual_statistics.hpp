#pragma once

#include <vector>

#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/curves/misfit.hpp>

namespace tribotwin::twin::identification {

/// Mean, standard deviation and maximum of the residuals, r_squared and aicc; notes on outliers and on errors that the
/// law, not the noise, makes. `base`: weight per sample, empty for 1 each. Expects `result.estimated`.
void describe_residuals(const Samples& samples, const std::vector<double>& residuals, const std::vector<double>& base,
                        Loss loss, const std::optional<Misfit>& misfit, Estimates& result);

}  // namespace tribotwin::twin::identification
