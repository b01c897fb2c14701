#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_recording.hpp>

/// Recordings, prepared for the identification of the dynamics.
namespace tribotwin::twin::identification {

/// Rows that `prepare` leaves out by default, and that a design counts for nothing: those within so many periods of the
/// cut-off of a time at which a rotor turns or is below this share of its largest speed.
struct SlowRows {
  static constexpr double share = 0.01, periods = 2;
};
/// No torque is recorded later or earlier than that [s].
inline constexpr double largest_lag_s = 0.5;

/// Periods of the cut-off that a hole in time may last.
inline constexpr double hole_periods = 0.25;

struct Preparation {
  double cutoff_hz = 0;     ///< of the zero-phase low-pass on positions and torques; 0: 20 Hz, at most a fifth of the
                            ///< sampling rate, of the slowest recording
  unsigned decimation = 0;  ///< keeps every n-th sample; 0: five per period of the cut-off
  bool recorded_velocity = false;  ///< speeds from the recorded velocities, where there are, not from positions
  /// Samples of several cut-offs at the same times: as many as the widest of them needs, without the ends in which the
  /// narrowest rings. 0: the cut-off's own.
  double widest_hz = 0, narrowest_hz = 0;
  /// Interpolation crosses holes in time up to that, which a filtered signal does not fill with anything new; longer
  /// ones part a recording into stretches [s]. 0: `hole_periods` of the cut-off.
  double longest_hole_s = 0;
  /// Whether rows near reversals count, with the sign of the speed filtered as the torque. Else two periods of the
  /// cut-off are left out before and after every time at which a joint is slow or turns: the filter leaves 0.003 of a
  /// step there; unless hardly any sample of a joint is that far from its reversals.
  bool reversals = false;
  /// Where reversals count: periods that are left out before and after a rest, as friction at rest is not known. The
  /// filter leaves 0.04 of a step after one of them, 0.003 after two; but the rows beside rests are those of low
  /// speeds.
  double rest_periods = 1;
  /// Where reversals count: how long before the speed turns the friction does [s], as a joint that sticks for a moment
  /// holds less than it did before; negative: after it.
  double turn_lead_s = 0;
  bool still_joints = false;  ///< joints may rest in all recordings
  /// Per joint: how late its torques were recorded [s], negative where early; removed. Empty: none. More than half a
  /// period of the cut-off (`narrowest_hz`) costs more of the ends.
  std::vector<double> lag_s;

  bool operator==(const Preparation&) const = default;
};

/// Equidistant, filtered samples of motion; joints x samples.
struct JointMotion {
  Eigen::MatrixXd q, qd, qdd, torque, temperature_degC;  ///< temperature: 20 where none was recorded
  /// Rotors x samples: the sign of their speed after the same low-pass as the torque: of Coulomb friction Fc sgn(v) a
  /// filtered torque has Fc `direction`, also while it turns. -1 .. 1, beside a turn up to 1.14 (the filter rings); 0
  /// at rest.
  Eigen::MatrixXd direction;
  Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic>
      moving;  ///< fast enough for sliding friction, out of the filter's reach of a rest, and with a recorded torque
  std::vector<std::pair<Eigen::Index, Eigen::Index>>
      segments;  ///< first sample, and one past the last, of stretches without a gap
  std::vector<double> time_s;
  std::vector<std::size_t> file;       ///< per segment, index of its recording
  std::vector<double> edge_s;          ///< per segment, length of its stretch that was left out at either end
  double cutoff_hz = 0, period_s = 0;  ///< of the first recording
  std::vector<double> lag_s;           ///< as in Preparation: what was removed from the torques
  /// How late a recorded velocity is behind the slope of its positions [s], where speeds are recorded ones: measured
  /// without any model, and removed where it is three sigma and a fifth of a sample.
  struct VelocityDelay {
    std::size_t file;
    Eigen::Index joint;
    double value_s, sigma_s;
    bool removed;
  };
  std::vector<VelocityDelay> velocity_delay;
  bool has_temperature = false;
  bool reversals = false;  ///< rows near reversals count: as asked for, or as there are hardly any others
  /// Joints whose torque counts nowhere, per joint: not recorded, or leave_out(). Their torque may be NaN, and they
  /// never count as `moving`. Empty: none.
  std::vector<bool> left_out;
  /// Joints x samples, what the payloads of the recordings need (carried_torque); empty: there are none.
  Eigen::MatrixXd carried_torque;
  std::vector<std::string> notes;

  bool is_left_out(Eigen::Index joint) const { return !left_out.empty() && left_out[static_cast<std::size_t>(joint)]; }
  void leave_out(Eigen::Index joint) {
    left_out.resize(static_cast<std::size_t>(q.rows()), false);
    left_out[static_cast<std::size_t>(joint)] = true;
    moving.row(joint).setConstant(false);
  }

  Eigen::Index size() const { return q.cols(); }
};

/// Filters stretches of regular sampling, differentiates them (filter.hpp) and decimates; jitter is
/// removed by cubic interpolation. ErrorKind::input where no stretch of a second is left or a joint rests in all
/// recordings.
Result<JointMotion> prepare(std::span<const RobotRecording> recordings, const Regressor& regressor,
                            const Preparation& preparation = {});

/// Torques, joints x samples of `motion`, as a recording with the lags of `motion` has them at these times.
struct AsRecorded {
  Eigen::MatrixXd torque;
  std::vector<bool> known;  ///< per sample; false where a stretch does not reach back, or on, by the lags
};
AsRecorded as_recorded(const JointMotion& motion, const Eigen::MatrixXd& torque);

}  // namespace tribotwin::twin::identification
