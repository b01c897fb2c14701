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
#include <tribotwin/twin/io/tables/table_options.hpp>

/// Features of a joint's state from one friction curve (Zhou 2024, section 5): the parameters of law `steady_state`
/// with alpha fixed, and further indicators.
namespace tribotwin::twin::identification {
struct Samples;
}

namespace tribotwin::twin::diagnosis {

constexpr std::string_view law_name = "steady_state";
constexpr double alpha = 1.3;  ///< Zhou 2024
constexpr Eigen::Index feature_count = 5;
constexpr std::array<std::string_view, feature_count> feature_names{"Fc", "Fs", "Vs", "Fv", "beta"};
constexpr std::array<std::string_view, feature_count> feature_units{"Nm", "Nm", "rad/s", "Nm (s/rad)^beta", "1"};
using Features = Eigen::Matrix<double, feature_count, 1>;
using FeatureMatrix = Eigen::Matrix<double, feature_count, feature_count>;

/// Region 1: contact surfaces (velocity weakening). Region 2: lubricant (velocity strengthening).
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
  Features features = Features::Zero();         ///< in feature_units
  FeatureMatrix shape = FeatureMatrix::Zero();  ///< covariance of `logarithmic()` by the fit, for levels of unit
                                                ///< variance; 0 where the fit has none
  std::optional<double> temperature_degC;       ///< mean of the curve
  std::array<std::optional<double>, indicator_count> indicators;
  double residual_nm = 0;         ///< standard deviation of the levels about the law
  std::vector<std::string> weak;  ///< features that are not identifiable from the curve

  /// ln Fc, ln Fs, ln Vs, ln Fv, beta: the effects of faults and temperature add up, and the scatter is nearly the same
  /// cold and hot.
  Features logarithmic() const;
  std::string name() const;  ///< "FILE, curve 3 (25.0 degC)"
};

struct ObservationFile {
  std::string joint;         ///< of the campaign.yaml beside the file, or empty
  double torque_max_nm = 0;  ///< from the file's friction_nm and friction_norm; 0: not known
  std::vector<Observation> observations;
  std::vector<std::string> notes;
};

struct ObservationOptions {
  double torque_max_nm = 0;  ///< turns friction_norm into Nm where a file has no friction_nm; 0: not known
  double gear_ratio = 0;     ///< for recordings of the joint side; 0: not known
  TableOptions table;        ///< with the joint, of tables of several
  /// Relative rise of Fc and Fs per load_norm at load 0. Where gravity changes along the travel, the levels of a curve
  /// have different loads; this corrects them to the mean load of their curve. BR609 twin: 0.6; Bittencourt 2012's M*:
  /// 0.75.
  double load_sensitivity = 0.6;
};

/// Features of one curve, without indicators. Speeds [rad/s] motor side, friction [Nm] arm side, load >= 0 over
/// torque_max. ErrorKind::input where the law cannot be fitted.
Result<Observation> observe(const identification::Samples& curve, double load_sensitivity);

/// Every curve of a file that identification::read_samples reads, with its optional columns ripple_nm and
/// lost_motion_rad. ErrorKind::input, with file and curve, on cells that are not finite and on curves too short for the
/// law. Features that are not identifiable are named in `weak`.
Result<ObservationFile> read_observations(const std::filesystem::path& file, const ObservationOptions& options);

}  // namespace tribotwin::twin::diagnosis
