#pragma once

#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

#include <tribotwin/twin/identification/curves/misfit.hpp>
#include <tribotwin/twin/identification/curves/separable.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>

/// Which parameters of a law the data at hand determine: before any number is fitted, and by the rule of
/// twin/identification/identifiability.hpp once they are. All of it follows from the rows of friction::formula::terms
/// and friction::formula::shape_numbers that a parameter moves; no law is named here.
namespace tribotwin::twin::identification {

/// Fixes the parameters without effect on these inputs: temperature terms at one temperature, load terms at one load,
/// all but the level at one speed. Adds one note per reason.
void fix_without_variation(const friction::LawInfo& law, const Samples& samples, Separable& problem, Estimates& result);

/// The parameters of `place` in the order in which to keep them where data cannot separate them: constant terms before
/// slopes before curvatures, linear before nonlinear parameters.
std::vector<std::size_t> by_rank(const Placement& place);

/// A free parameter that at this point has no effect or that others can replace; npos when there is none. Of a
/// dependent set it is the one with the highest rank.
std::size_t dependent_parameter(const friction::LawInfo& law, const Separable& problem, const Point& point);

/// Whether a parameter moves the load terms alone, which samples at one temperature determine.
bool moves_load_terms_only(const Placement& place, std::size_t parameter);

/// Which of the law's terms that fade with speed the data show: such a term bends towards any noise, and its numbers
/// are none where the law without it fits as well (F test, 0.1 %). `noise`: of how many samples' noise one degree of
/// freedom of the residuals is worth, 1 where they are white. One text per parameter, empty: it is seen, or not
/// examined.
std::vector<std::string> unseen_terms(const Separable& problem, const Point& point,
                                      const std::vector<std::size_t>& coordinates, double samples, double noise);

/// Units beside those of a law: of speeds in advice, and of an offset in units of the law's torque.
struct LawUnits {
  std::string_view speed = "rad/s";
  double offset_per_torque = 1;
};

/// The rule for a fitted law: `estimates` are its parameters, then asymmetry and offset where they are there. Intervals
/// are compared with the value; of parameters that may be 0 also with a tenth of friction or, of a velocity's or an
/// exponent's coefficients, of that quantity. What to record next follows from what a parameter moves. `samples` give
/// speeds, loads, temperatures and the size of friction; `unseen` as of unseen_terms.
std::vector<Lacking> lacking_of(const friction::LawInfo& law, const Samples& samples, const Estimates& estimates,
                                const std::optional<Misfit>& misfit, std::vector<std::string> unseen = {},
                                LawUnits units = {});

}  // namespace tribotwin::twin::identification
