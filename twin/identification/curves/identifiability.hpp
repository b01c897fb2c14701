#pragma once

#include <cstddef>
#include <vector>

#include <tribotwin/twin/identification/curves/separable.hpp>
#include <tribotwin/twin/identification/estimates.hpp>

/// Which parameters of a law the data at hand determine, before any number is fitted; what fitted numbers are worth is
/// judged by twin/identification/identifiability.hpp. All of it follows from the rows of friction::formula::terms
/// and friction::formula::shape_numbers that a parameter moves; no law is named here.
namespace tribotwin::twin::identification {

/// Fixes the parameters without effect on these inputs: temperature terms at one temperature, load terms at one load,
/// all but the level at one speed. Adds their names to `result.unidentifiable` and one note per reason.
void fix_without_variation(const friction::LawInfo& law, const Samples& samples, Separable& problem, Estimates& result);

/// The parameters of `place` in the order in which to keep them where data cannot separate them: constant terms before
/// slopes before curvatures, linear before nonlinear parameters.
std::vector<std::size_t> by_rank(const Placement& place);

/// A free parameter that at this point has no effect or that others can replace; npos when there is none. Of a
/// dependent set it is the one with the highest rank.
std::size_t dependent_parameter(const friction::LawInfo& law, const Separable& problem, const Point& point);

/// Whether a parameter moves the load terms alone, which samples at one temperature determine.
bool moves_load_terms_only(const Placement& place, std::size_t parameter);

}  // namespace tribotwin::twin::identification
