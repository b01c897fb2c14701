#pragma once

#include <array>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>

/// What one friction curve tells of a joint's state (paper 2, section 5): the parameters of law `steady_state` with
/// alpha fixed, and indicators beside them.
namespace tribotwin::twin::identification {
struct Samples;
}

namespace tribotwin::twin::diagnosis {

constexpr std::string_view law_name = "steady_state";
constexpr double alpha = 1.3;  ///< paper 2
constexpr Eigen::Index feature_count = 5;
constexpr std::array<std::string_view, feature_count> feature_names{"Fc", "Fs", "Vs", "Fv", "beta"};
constexpr std::array<std::string_view, feature_count> feature_units{"Nm", "Nm", "rad/s", "Nm (s/rad)^beta", "1"};
using Features = Eigen::Matrix<double, feature_count, 1>;
using FeatureMatrix = Eigen::Matrix<double, feature_count, feature_count>;

/// Region 1 is that of contact surfaces (velocity-weakening), region 2 that of the lubricant (velocity-strengthening).
struct RegionFeatures {
  std::string_view name, of;
  Eigen::Index first, count;
};
constexpr std::array<RegionFeatures, 2> regions{
    {{"region1", "contact surfaces", 0, 3}, {"region2", "lubricant", 3, 2}}};

enum Indicator { ripple, lost_motion, load, indicator_count };
struct IndicatorInfo {
  std::string_view name, column, meaning;
};
constexpr std::array<IndicatorInfo, indicator_count> indicators{
    {{"ripple_nm", "ripple_nm", "torque periodic in the joint's angle, largest of the levels [Nm], arm side"},
     {"lost_motion_rad", "lost_motion_rad",
      "travel after a reversal before the gear carries torque, median [rad], arm side"},
     {"load_norm", "load_norm", "mean |load| over torque_max"}}};

struct Observation {
  std::string file;
  std::size_t curve = 1;                        ///< within the file, from 1
  Features features = Features::Zero();         ///< in the order of feature_names
  FeatureMatrix shape = FeatureMatrix::Zero();  ///< covariance of `logarithmic()` that the fit claims, for levels of
                                                ///< unit variance; 0 where it claims none
  std::optional<double> temperature_degC;       ///< mean of the curve
  std::array<std::optional<double>, indicator_count> indicators;
  double residual_nm = 0;         ///< standard deviation of the levels about the law
  std::vector<std::string> weak;  ///< features that the curve does not tell

  /// ln Fc, ln Fs, ln Vs, ln Fv, beta: in these faults and temperature add up, and scatter is nearly the same cold and
  /// hot.
  Features logarithmic() const;
  std::string name() const;  ///< "FILE, curve 3 (25.0 degC)"
};

struct ObservationFile {
  std::string joint;         ///< of the campaign.yaml beside the file, or empty
  double torque_max_nm = 0;  ///< from the file's friction_nm and friction_norm; 0: not told
  std::vector<Observation> observations;
  std::vector<std::string> notes;
};

struct ObservationOptions {
  double torque_max_nm = 0;  ///< turns friction_norm into Nm where a file has no friction_nm; 0: not known
  double gear_ratio = 0;     ///< for recordings of the joint side; 0: not known
  std::string joint;         ///< of a telemetry.h5
  /// Relative rise of Fc and Fs per load (load_norm) at load 0. The levels of a curve are at different loads where
  /// gravity changes along the travel; they are brought to the mean load of their curve with it. 0.6 is that of the
  /// BR609 twin, 0.75 that of paper 1's M*.
  double load_sensitivity = 0.6;
};

/// Features of one curve, without indicators. Fails where the fit does.
Result<Observation> observe(const identification::Samples& curve, double load_sensitivity);

/// Every curve of a file that identification::read_samples reads, with its optional columns ripple_nm and
/// lost_motion_rad. Fails, naming file and curve, on cells that are not finite and on curves too short for the law;
/// features that a curve does not tell are named in `weak`.
Result<ObservationFile> read_observations(const std::filesystem::path& file, const ObservationOptions& options);

}  // namespace tribotwin::twin::diagnosis
