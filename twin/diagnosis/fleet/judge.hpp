#pragma once

#include <optional>
#include <string_view>

#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/diagnosis/fleet/discoveries.hpp>
#include <tribotwin/twin/diagnosis/fleet/type_model.hpp>

/// What the newest observations say about one joint of a robot.
namespace tribotwin::twin::diagnosis::fleet {

/// How far a joint is from where it was: the mean over a window of deviations from its own healthy state, which is its
/// type's where it has no healthy curves.
struct Shift {
  std::array<Eigen::VectorXd, 2> mean;        ///< of the logarithmic features, by region
  std::array<Eigen::MatrixXd, 2> covariance;  ///< of `mean`: measurement, days (correlated), healthy state
  std::array<double, 2> by_chance{1, 1};      ///< probability of at least this T^2 on a healthy joint
  double p = 1;                               ///< of both regions: twice the smaller one (Bonferroni)
  double freedom = 1e6;                       ///< of the scatter
  double temperature_degC = 0;                ///< mean over the window
  double load_norm = std::numeric_limits<double>::quiet_NaN();
  std::size_t observations = 0;
};
/// `recent` must not be empty; both in the order of time.
Shift judge_window(const TypeModel& type, const Rows& healthy, const Rows& recent);

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
Finding explain(const TypeModel& type, const Rows& healthy, const Shift& shift, double load_sensitivity);

/// CUSUM of one joint over its observations after the healthy ones, as `tribotwin diagnose watch`; each observation is
/// compared with what the healthy ones, the type and all before it predict, correlation in time included, so that the
/// scores of a healthy joint are independent.
struct Chart {
  struct Step {
    double day = 0;
    std::array<double, 2> sum{};  ///< CUSUM by region
    double p = 1;                 ///< of both, by chance on a healthy joint after as many steps
  };
  std::vector<Step> steps;
};
/// The chart learns from observations until p falls below `stop_learning`.
Chart watch_joint(const TypeModel& type, const Rows& healthy, const Rows& recent, const CusumTail& tail,
                  double stop_learning);

}  // namespace tribotwin::twin::diagnosis::fleet
