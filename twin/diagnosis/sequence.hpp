#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/check.hpp>

/// Small changes that only a series of observations shows. Each observation is held against what was learned and all
/// observations before it, so that the probabilities of its T^2 are independent and uniform on a healthy joint, however
/// few were learned (recursive residuals; Hawkins 1987, self-starting); as normal scores z they go into a CUSUM C =
/// max(0, C + z - 1/2), which sounds at C > h.
namespace tribotwin::twin::diagnosis {

constexpr double cusum_allowance = 0.5;  ///< for shifts of about one standard deviation of z
constexpr double once_a_year = 1.0 / 365;

/// Mean number of healthy observations until a CUSUM of normal scores exceeds h: Markov chain of Brook and Evans
/// (1972).
double average_run_length(double h);
/// The h at which it is 1 / false_alarm; false_alarm 1e-7 .. 0.3.
double cusum_threshold(double false_alarm);

/// Of one baseline. It learns from every observation until it sounds.
class Cusum {
 public:
  explicit Cusum(Baseline baseline) : baseline_(std::move(baseline)) {}
  struct Step {
    double score = 0, sum = 0;
  };
  Step take(const Eigen::VectorXd& y, const Eigen::VectorXd& x, double scatter, double threshold);

 private:
  Baseline baseline_;
  double sum_ = 0;
  bool sounded_ = false;
};

struct Interval {
  double value = 0, low = 0, high = 0;  ///< 95 %
};

/// The equivalent load over the observations as a straight line, and where it goes.
struct Margin {
  Interval load_norm;                      ///< left to the wear threshold, at the last observation
  std::optional<double> observations;      ///< until the line reaches it; none where it does not rise
  std::optional<double> earliest, latest;  ///< its 95 % band; `latest` none where the rise is not certain
};

struct WatchStep {
  std::array<Cusum::Step, 2> region;
  std::array<bool, 2> alarm{};
};
struct Watch {
  double threshold = 0;                    ///< h
  std::vector<WatchStep> steps;            ///< as many as observations
  std::optional<std::size_t> first_alarm;  ///< index
  std::optional<Margin> margin;            ///< from three observations on
};

/// Observations in the order of time. `false_alarm`: mean share of a healthy joint's observations at which an alarm is
/// raised anew, both regions together. The observations must have passed `check`.
Watch watch(const HealthyState& healthy, std::span<const Observation> observations, double false_alarm = once_a_year);

/// A column JOINT.residual_nm of tribotwin-hil shadow, in windows: ln of its rms. The first windows are taken for
/// healthy, temperature as regressor where it varies.
struct ResidualOptions {
  std::string joint;  ///< may be empty where the file has one
  double window_s = 60;
  std::size_t learn = 20;  ///< windows, at least 8
  double false_alarm = 1e-3;
};
struct ResidualWatch {
  std::string joint;
  double threshold = 0;
  double correlation = 0;  ///< of neighbouring windows that were learned; false alarms are as asked for near 0
  struct Window {
    double time_s = 0, rms_nm = 0;  ///< end of the window
    Cusum::Step cusum;              ///< 0 while learning
    bool alarm = false;
  };
  std::vector<Window> windows;
  std::optional<std::size_t> first_alarm;
};
/// Fails on files that shadow did not write, and on too few windows.
Result<ResidualWatch> watch_residuals(const std::filesystem::path& file, const ResidualOptions& options);

}  // namespace tribotwin::twin::diagnosis
