#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/variant_twins.hpp>

/// Identification by simulation, for recordings that are not friction curves: the whole twin (controller, motor, gear,
/// arm) follows recorded goal positions as in `tribotwin run`; its error of position is minimised.
///
/// The objective is the negative logarithm of the posterior,
///
///   n sum ln(error) + 1/2 sum z^2,   n = recorded time / correlation time,
///
/// error: per joint the root mean square or mean absolute error of position, every recording with the same weight; z:
/// the distance of each free quantity from its start in units of its prior standard deviation. The scale of the error
/// is unknown; its likelihood is maximised over it, hence the logarithm. Samples are milliseconds apart but errors last
/// for a swing: a recording counts as many measurements as it has correlation times.
///
/// The objective is discontinuous where a joint starts or stops sticking. Gauss-Newton's method with wide differences
/// needs a tenth to a third of the simulations of a covariance matrix adaptation evolution strategy (Hansen 2016,
/// arXiv:1604.00772) for the same minimum; the strategy goes lower where thousands are allowed.
namespace tribotwin::twin::identification {

enum class SearchMethod {
  automatic,     ///< gauss_newton for squared errors, else cma_es
  gauss_newton,  ///< of squared errors only
  cma_es
};
std::string_view name(SearchMethod method);

struct SearchOptions {
  Norm norm = Norm::squared;
  SearchMethod method = SearchMethod::automatic;
  double correlation_s = 3;  ///< errors of position this far apart count as independent
  int starts = 2;            ///< the first at the start values, the others drawn around them
  int evaluations = 400;     ///< per start; an evaluation simulates every training recording
  std::uint64_t seed = 1;
};
/// What `automatic` stands for.
SearchMethod method_of(const SearchOptions& options);

struct Split {
  struct Fold {
    std::string label;
    std::vector<std::size_t> held_out;
  };
  std::string name;
  std::vector<Fold> folds;
};

struct Plan {
  std::vector<Variant> variants;
  std::vector<Recording> recordings;
  std::vector<Split> splits;
  SearchOptions search;
};

/// Result of one quantity.
enum class ParameterStatus {
  known,  ///< not free
  estimated,
  prior,  ///< the recordings add little information to the prior
  at_bound
};
std::string_view name(ParameterStatus status);

/// One variant fitted on all recordings but those of a fold.
struct SimulationFit {
  static constexpr std::size_t all = static_cast<std::size_t>(-1);
  std::size_t variant = 0, split = all, fold = 0;
  std::vector<double> values;           ///< per quantity
  std::vector<double> sigma;            ///< per quantity, NaN unless estimated or prior; of fits on all recordings
  std::vector<ParameterStatus> status;  ///< alike
  Eigen::MatrixXd correlation;          ///< alike, quantities by quantities
  std::vector<double> mae_mrad;         ///< per recording of the plan, training or not
  double objective = 0;                 ///< the minimum found
  std::vector<double> minima;           ///< found by each start
  int evaluations = 0;                  ///< of all starts
};

struct Watch {
  unsigned threads = 1;            ///< per rank; processes that simulate
  int retries = 1;                 ///< further attempts of a simulation whose process ended
  std::filesystem::path folder{};  ///< where failures.csv lists the fits that failed; empty: nowhere
  std::string identity;            ///< of the plan: MPI ranks whose identity differs take no part
  const std::atomic<bool>* stop = nullptr;
  std::function<void(double share)> progress;      ///< one call at a time
  std::function<void(const SimulationFit&)> done;  ///< on rank 0, one call at a time, in any order
};

/// Fits every variant on all recordings and, for every fold, on those that are not held out; fits in `have` are
/// skipped; `have` of rank 0 counts. All points that the searches ask for are distributed over processes of all MPI
/// ranks, and their recordings where there are fewer points than processes; the results do not depend on their number.
/// Collective. ErrorKind::work when a variant is refused, an identified twin diverges or a simulation crashes; the
/// other fits are made all the same. After a stop the finished fits have been passed to `done`; that is no failure.
Result<void> calibrate(const Plan& plan, const std::vector<SimulationFit>& have, const Watch& watch);

}  // namespace tribotwin::twin::identification
