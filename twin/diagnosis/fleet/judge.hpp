#pragma once

#include <optional>
#include <string_view>

#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/diagnosis/fleet/discoveries.hpp>
#include <tribotwin/twin/diagnosis/fleet/joint_fit.hpp>

/// What the newest observations say about one joint of a robot.
namespace tribotwin::twin::diagnosis::fleet {

/// Numbers by region, persistence (TypeModel::choice) and factor, the factors of one persistence one after the other.
using ByChoice = std::array<std::vector<double>, 2>;

/// Charts compare each curve with those before it, and extrapolate nothing; their variances are estimates all the same.
enum class WeightsOf { shifts, charts };

/// What the variance of a shift, or of all innovations of a chart, may be relative to what the type says. It is an
/// estimate, all joints of a type with the same error, that of a shift extrapolated from healthy curves to a mean over
/// days: for one joint that is an uncertainty among others, but a plant has it in all joints at once. The shifts or
/// charts of all joints tell which factor is true.
constexpr std::size_t factor_count = 13;
double log_factor(std::size_t i);
/// The factors that are possible, those of shifts all; ln of the probability of each beforehand: the logarithm of the
/// factor is normal about 0.
std::vector<std::size_t> factors_of(const RegionModel& model, WeightsOf what);
double log_prior_of_factor(std::size_t i, const RegionModel& model, WeightsOf what);

/// What joints that are not healthy may be: their share among all, and the variance of their shifts relative to that of
/// healthy joints. Were one share assumed that is too large, healthy joints of large shifts would count as theirs, and
/// the variance of healthy shifts would be found too small.
constexpr std::array others_shares{0.002, 0.01, 0.03, 0.1};
constexpr std::array others_variances{25.0, 400.0};

/// Log densities of what was observed of one joint.
struct Evidence {
  ByChoice healthy;
  std::array<std::array<double, others_variances.size()>, 2> other{};  ///< if not healthy, by region and variance
};

/// How far a joint is from where it was: the mean over a window of deviations from its own healthy state, which is its
/// type's where it has no healthy curves.
struct Shift {
  // Under the most probable persistence:
  std::array<Eigen::VectorXd, 2> mean;        ///< of the logarithmic features, by region
  std::array<Eigen::MatrixXd, 2> covariance;  ///< of `mean`: measurement, days (correlated), healthy state
  double freedom = 1e6;                       ///< of the scatter
  // Under each:
  ByChoice by_chance;  ///< probability of at least this T^2 on a healthy joint
  Evidence evidence;

  double temperature_degC = 0;  ///< mean over the window
  double load_norm = std::numeric_limits<double>::quiet_NaN();
  std::size_t observations = 0;
};

/// How probable each persistence is. The healthy curves say it as far as they span days; the shifts of all joints say
/// more, because most joints are healthy, and their shifts have the variance that the true persistence gives them
/// (Efron 2004 takes the whole null distribution from there). With joints that are not healthy as a mixture of unknown
/// share, at most the largest of others_shares.
class PersistenceWeights {
 public:
  PersistenceWeights(const TypeModel& type, WeightsOf what);
  void add(const Evidence& joint);
  ByChoice weights() const;

 private:
  /// By region, and where ByChoice has one number: by share and variance of the others.
  std::array<std::vector<std::array<double, others_shares.size() * others_variances.size()>>, 2> log_;
};
/// Probability by chance, of both regions: twice the smaller one (Bonferroni).
double by_chance(const ByChoice& p, const ByChoice& weights);

/// What the shift looks like, by the patterns of one joint (patterns.hpp), and the margin to the wear threshold.
struct Finding {
  std::string_view pattern = "unknown";  ///< of patterns(), or "unknown"
  std::string_view unit, advice;         ///< of the severity; what to do
  double severity = 0;
  double confidence = 0;                               ///< probability of the pattern among the causes
  double friction_change = 0;                          ///< relative change of Fc
  EquivalentLoad load;                                 ///< load.threshold: where Zhou 2024's distance reaches 6 sigma
  double margin = 0, margin_low = 0, margin_high = 0;  ///< load.threshold - load.load_norm, 95 %
};

/// CUSUM of one joint over its observations after the healthy ones, as `tribotwin diagnose watch`; each observation is
/// compared with what the healthy ones, the type and all before it predict, correlation in time included, so that the
/// scores of a healthy joint are independent under the true persistence.
struct Chart {
  struct Step {
    double day = 0;
    double sum = 0;  ///< CUSUM, larger of both regions, under the most probable persistence and a factor of 1
    ByChoice p;      ///< by chance on a healthy joint after as many steps
  };
  std::vector<Step> steps;
  Evidence evidence;
};

/// Judges the joints of one type. Keeps a reference.
class Judge {
 public:
  explicit Judge(const TypeModel& type);
  const TypeModel& type() const { return type_; }

  /// `recent` must not be empty; both in the order of time, the recent ones later.
  Shift shift(const Rows& healthy, const Rows& recent) const;
  /// A chart whose p, on a healthy joint, has fallen below this no longer learns.
  static constexpr double stop_learning_below = 1e-3;
  /// The chart learns from observations until p falls below `stop_learning`.
  Chart watch(const Rows& healthy, const Rows& recent, const CusumTail& tail,
              double stop_learning = stop_learning_below) const;
  Finding explain(const Rows& healthy, const Shift& shift, double load_sensitivity) const;

 private:
  struct Region {
    std::vector<Choice> choices;
    Eigen::MatrixXd back;  ///< W^-1 of the most probable one
  };
  /// The joint's own healthy state in the form in which one joint's patterns are found.
  HealthyState state_of(const Rows& healthy, const Shift& shift, double load_sensitivity) const;

  const TypeModel& type_;
  std::array<Region, 2> region_;
};

}  // namespace tribotwin::twin::diagnosis::fleet
