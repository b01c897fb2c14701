#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>

/// Identifies a law's parameters from measured friction, as Bittencourt 2012 section 2.2: the sum of squared errors is
/// minimised over the nonlinear parameters alone, the linear ones being the least-squares solution at each of them
/// (separable least squares, Bittencourt 2012 (9), (10)): a coarse grid, then Ceres' trust region on the projected
/// residual with the exact derivatives of Golub 1973. Covariance: lambda [sum psi psi^T]^-1 (Bittencourt 2012 (11)),
/// lambda = sum of squares / (N - p). Accepted ranges of parameters are bounds, Fs >= Fc of `steady_state` (Zhou 2024
/// (12)) included.
///
/// Where samples of both directions tell them, two more numbers are estimated with those of the law: `asymmetry` and
/// `offset` of friction against positive motion, level (1 + asymmetry), and negative motion, level (1 - asymmetry),
/// plus and minus the offset (curves/direction.hpp). Each is kept where its 95 % interval excludes 0 and it is no less
/// than a thousandth of friction; else the result is that of a symmetric law.
namespace tribotwin::twin::identification {

enum class Loss {
  squares,
  huber,  ///< linear beyond 1.345 sigma: 95 % efficient on clean data
  cauchy  ///< outliers far beyond 2.385 sigma lose their effect
};

struct FitOptions {
  std::vector<std::pair<std::string, double>> fixed;  ///< parameters that are known, asymmetry and offset included
  Loss loss = Loss::squares;
  bool weigh = true;  ///< by 1 / standard error^2 where the samples have one
  unsigned threads = 2;
};

struct Fit : Estimates {  ///< in the law's order; after them `asymmetry` and `offset` where one of them is not 0
  friction::Law law;      ///< its range is that of the samples
  double asymmetry = 0, offset = 0;  ///< [-], unit of the law
};

/// Fails with a sentence on what the data lack.
Result<Fit> fit(const friction::LawInfo& law, const Samples& samples, const FitOptions& options = {});

/// Bittencourt 2012's order: the load terms from the samples of the temperature at which most loads were measured,
/// then, these fixed, the rest from all. Only for laws that depend on both; fails where no temperature has three loads.
Result<Fit> fit_staged(const friction::LawInfo& law, const Samples& samples, const FitOptions& options = {});

/// Errors of samples that were held out: `folds` parts of whole curves where there are as many, else of samples in
/// turn.
struct HeldOutErrors {
  double rms = 0;
  std::vector<double>
      mean_squares;  ///< of each curve or, where there are fewer than five, of each tenth of the samples
};
Result<HeldOutErrors> cross_validate(const friction::LawInfo& law, const Samples& samples, const FitOptions& options,
                                     unsigned folds);

/// Whether `wide` is `narrow` with more free terms: what it cannot fit as well, it did not learn. By the terms and
/// shape numbers of the general law; v^beta contains v.
bool contains(const friction::LawInfo& wide, const friction::LawInfo& narrow);

/// Whether `wide` predicts held-out samples worse than `narrow`, by more than two standard errors of the difference.
bool worse(const HeldOutErrors& wide, const HeldOutErrors& narrow);

/// One parameter common to all curves, the others free at each (Bittencourt 2012, Fig. 5: alpha*).
struct Shared {
  double value = 0, sigma = 0;
  std::vector<std::pair<double, double>> profile;  ///< value, cost / minimum - 1
  std::size_t curves = 0, samples = 0;
  std::vector<std::string> notes;
};
Result<Shared> fit_shared(const friction::LawInfo& law, const Samples& samples, const std::string& parameter,
                          const FitOptions& options = {});

}  // namespace tribotwin::twin::identification
