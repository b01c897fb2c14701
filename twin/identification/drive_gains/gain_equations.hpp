#pragma once

#include <span>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/drive_gains/payload.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>

/// Internal to this folder, not installed: what the recordings say of the drive gains, without their samples.
///
/// The recorded torque of joint j is y_j = k_j (Y_j beta + P_j phi) + F_j theta_j + noise, with the model's base
/// parameters beta, the parameters phi of the payload, and friction; k_j is the recorded torque per Nm. The sum of
/// squares at any values of them follows from the normal matrix of the columns [Y_j, F_j, y_j, P_j].
namespace tribotwin::twin::identification {

struct GainColumns {
  static constexpr Eigen::Index friction = 4,  ///< Coulomb, viscous; per load, offset
      changing = 2,                            ///< of these from period to period: the first
      carried = 10;
  Eigen::Index base = 0;
  Eigen::Index torque() const { return base + friction; }
  Eigen::Index payload() const { return torque() + 1; }
  Eigen::Index size() const { return payload() + carried; }
};

/// Samples [first, last) of a recording, long against the correlation of noise.
struct GainStretch {
  Eigen::Index first, last;
  std::size_t file, period;
};
/// About 48 of them. `period`: in which Coulomb and viscous friction are constant, as they change with the temperature:
/// of 20 s or more, all of one recording, and no more than twelve beside one for each recording.
std::vector<GainStretch> gain_stretches(const JointMotion& motion);

/// Normal matrices of a stretch of time, or of several.
struct GainBlock {
  int payload = -1;  ///< that was carried; -1: none
  std::size_t period = 0;
  std::vector<Eigen::MatrixXd> normal;  ///< per joint, of its columns over the samples in motion
  Eigen::VectorXd samples;              ///< per joint
};

/// A block of each stretch. `payload_of_file`: per recording an index of `payloads`, or -1; `load`: of the gears
/// [Nm; N], joints x samples.
std::vector<GainBlock> gain_blocks(const Regressor& regressor, const BaseParameters& base, const JointMotion& motion,
                                   std::span<const GainStretch> stretches, std::span<const PlacedPayload> payloads,
                                   std::span<const int> payload_of_file, const Eigen::MatrixXd& load, unsigned threads);

/// The equations of a least-squares step: normal matrix, right-hand side, sum of squares.
struct GainSystem {
  Eigen::MatrixXd N;
  Eigen::VectorXd g;
  double squares = 0;

  explicit GainSystem(Eigen::Index unknowns)
      : N(Eigen::MatrixXd::Zero(unknowns, unknowns)), g(Eigen::VectorXd::Zero(unknowns)) {}
  Eigen::VectorXd step() const;
  Eigen::MatrixXd inverse() const;
};

/// Covariance of the solution of `all`, whose data come in groups with independent errors and whose prior has the
/// variances 1 / precision: a jackknife over the groups, and what the prior adds.
struct GroupCovariance {
  Eigen::MatrixXd covariance;
  Eigen::VectorXd freedom;  ///< degrees of freedom of each variance, >= 1
};
GroupCovariance group_covariance(const GainSystem& all, const Eigen::VectorXd& precision,
                                 std::span<const GainSystem> groups);

}  // namespace tribotwin::twin::identification
