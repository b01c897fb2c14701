#pragma once

#include <span>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/samples/passes.hpp>
#include <tribotwin/twin/identification/samples/recording.hpp>

/// Private to levels.cc: the torque of one level over the position.
namespace tribotwin::twin::curves {

/// Mean and its standard error.
struct Mean {
  double value, stderr_;  // stderr is a macro
};
/// Of samples in order of time that may be correlated, `fitted` as in samples_per_independent.
Mean mean_of(std::span<const double> x, double fitted = 1);

/// Both directions of a level, their torques as functions of the position. Positions x are scaled to -1 .. 1 over the
/// positions that both passes cover. Keeps references to the recording and the pair.
class Profile {
 public:
  Profile(const JointRecording& recording, const Pair& pair);

  struct Row {
    std::size_t sample;
    double x, sign;  ///< sign of the speed
  };
  std::span<const Row> rows() const { return rows_; }
  bool too_short() const { return forward_ < min_samples || rows_.size() - forward_ < min_samples; }
  double position(double x) const { return centre_ + half_ * x; }
  double scaled(double q) const { return (q - centre_) / half_; }

  /// Torque [Nm] of a row, the column being late by `lag_s`; linear between samples.
  double torque(const Row& row, double lag_s) const;

  /// Fits the part of the torque that both directions share, a polynomial, and the part that changes sign, a constant.
  void fit(double lag_s);
  double common_nm(double x) const { return evaluate(x).first; }
  double common_slope_nm_rad(double x) const { return evaluate(x).second / half_; }

  /// (u+ - u-) / 2 at equal positions (Zhou 2024 (6)): at the forward samples, the reverse ones interpolated. Computed
  /// from the torques minus the common part, which cancels.
  struct Difference {
    std::vector<double> x, friction_nm;
  };
  Difference difference(double lag_s) const;

  /// Information on a change of the lag: the difference = friction, free to change with |load|, + change x its
  /// derivative by the lag. All 0 where the common part does not rise above the noise.
  struct Information {
    double square = 0, product = 0;
    double variance = 0, count = 0;  ///< of the noise, per sample of a mean, correlation included
  };
  Information information(double lag_s) const;

 private:
  void take(const Pass& pass, double sign);
  /// Common part and its derivative by x.
  std::pair<double, double> evaluate(double x) const;

  const JointRecording& r_;
  const Pair& pair_;
  std::vector<Row> rows_;
  std::size_t forward_ = 0;  ///< rows of the forward pass, which come first
  double centre_, half_;
  int degree_ = 0;
  Eigen::VectorXd common_;
  double friction_ = 0;
};

}  // namespace tribotwin::twin::curves
