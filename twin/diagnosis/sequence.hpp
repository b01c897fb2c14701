#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>

/// Small changes that only a series of observations shows. Each observation is compared with the learned ones and all
/// observations before it, so that the probabilities of its T^2 are independent and uniform on a healthy joint, however
/// few were learned (recursive residuals; self-starting charts, Hawkins 1987). As normal scores z they enter a CUSUM,
/// C = max(0, C + z - 1/2), which raises an alarm at C > h.
namespace tribotwin::twin::diagnosis {

constexpr double cusum_allowance = 0.5;  ///< for shifts of about one standard deviation of z
constexpr double once_a_year = 1.0 / 365;

/// Mean number of healthy observations until a CUSUM of normal scores exceeds h > 0, by the Markov chain of Brook 1972.
double average_run_length(double h);
/// The h whose average run length is 1 / false_alarm; false_alarm in 1e-7 .. 0.3.
double cusum_threshold(double false_alarm);

/// The CUSUM of one baseline, which learns from every observation until the first alarm.
class Cusum {
 public:
  explicit Cusum(Baseline baseline) : baseline_(std::move(baseline)) {}
  struct Step {
    double score = 0, sum = 0;
  };
  /// The next observation y with regressors x and its scatter (1: typical), against the threshold h.
  Step take(const Eigen::VectorXd& y, const Eigen::VectorXd& x, double scatter, double threshold);

 private:
  Baseline baseline_;
  double sum_ = 0;
  bool alarmed_ = false;
};

struct Interval {
  double value = 0, low = 0, high = 0;  ///< 95 %
};

/// From an observation to the wear threshold, by its own equivalent load and scatter.
Interval left_to_wear(const EquivalentLoad& load);

/// A straight line through the equivalent loads of the observations over their number, or over days, extrapolated to
/// the wear threshold.
struct Margin {
  bool straight;       ///< the loads scatter about the line as much as their sigmas say (chi-squared, 1 % are refused)
  Interval load_norm;  ///< to the wear threshold at the last observation: by the line or, where not straight, its own
  std::optional<double> observations;  ///< or days, until the line reaches it; none where not rising or not straight
  std::optional<double> earliest, latest;  ///< 95 % band of that; `latest`: none where the rise is not significant
  Eigen::Vector2d line;                    ///< equivalent load at 0, and its rise
  Eigen::Matrix2d covariance;              ///< of the line
  double quantile;                         ///< Student's, two-sided, 95 %

  Interval at(double x) const;  ///< of the line
};

/// Nothing for fewer than three observations. `at` ascends and has as many values, of which two differ.
std::optional<Margin> margin(const HealthyState& healthy, std::span<const Observation> observations,
                             std::span<const double> at);

struct WatchStep {
  std::array<Cusum::Step, 2> region;
  std::array<bool, 2> alarm{};
};
struct Watch {
  double threshold = 0;                    ///< h
  std::vector<WatchStep> steps;            ///< one per observation
  std::optional<std::size_t> first_alarm;  ///< index of a step
  std::optional<Margin> margin;            ///< none for fewer than three observations
};

/// Observations in the order of time, all of which `check` accepts. `false_alarm`: mean share of a healthy joint's
/// observations at which a new alarm is raised, both regions together.
Watch watch(const HealthyState& healthy, std::span<const Observation> observations, double false_alarm = once_a_year);

/// A column JOINT.residual_nm of tribotwin-hil shadow, reduced to ln rms per window. The first windows are assumed to
/// be healthy; temperature is a regressor where it varies among them.
struct ResidualOptions {
  TableOptions table;  ///< with the joint, which may be empty where the file has only one
  double window_s = 60;
  std::size_t learn = 20;  ///< first windows, at least 8
  double false_alarm = 1e-3;
};
struct ResidualWatch {
  std::string joint;
  double threshold = 0;
  double correlation = 0;  ///< of successive learned windows; the rate of false alarms holds where it is near 0
  struct Window {
    double time_s = 0, rms_nm = 0;  ///< end of the window
    Cusum::Step cusum;              ///< 0 while learning
    bool alarm = false;
  };
  std::vector<Window> windows;
  std::optional<std::size_t> first_alarm;
  std::vector<std::string> notes;  ///< how the file was understood, and what it lacks
};
/// ErrorKind::input on files that shadow did not write, on too few windows and on residuals that are all equal.
Result<ResidualWatch> watch_residuals(const std::filesystem::path& file, const ResidualOptions& options);

}  // namespace tribotwin::twin::diagnosis
