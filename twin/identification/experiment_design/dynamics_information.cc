#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/twin/identification/experiment_design/dynamics_information.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::MatrixXd, Eigen::RowVectorXd, Eigen::VectorXd;

namespace {

/// Below this share of its largest speed `dynamics` takes a joint to be at rest, and as long around it that the filter
/// rings, in periods of the cut-off (joint_motion.hpp).
constexpr double slow = 0.01, ringing_periods = 2;

/// Whether the row of a joint counts in each state.
std::vector<bool> counted(const MotionStates& states, Index joint, double slowest, double guard_s) {
  const Index n = states.size(), guard = static_cast<Index>(std::ceil(guard_s / states.step_s - 1e-9));
  std::vector<bool> out(static_cast<std::size_t>(n), true);
  for (Index i = 0; i < n; ++i) {
    const double speed = states.qd(joint, i);
    const bool reverses = i + 1 < n && speed * states.qd(joint, i + 1) < 0;
    if (std::abs(speed) >= slowest && !reverses) continue;
    for (Index k = std::max<Index>(0, i - guard + (reverses ? 1 : 0)); k <= std::min(n - 1, i + guard); ++k)
      out[static_cast<std::size_t>(k)] = false;
  }
  return out;
}

/// rms over speeds up to `speed` and loads up to the law's unit, of friction and of its derivatives.
std::pair<double, VectorXd> sizes_of(const JointFriction& f, const std::vector<double>& parameters, double speed) {
  constexpr int steps = 20;
  VectorXd squares = VectorXd::Zero(f.size()), by(f.size());
  double friction = 0;
  for (int k = 1; k <= steps; ++k)
    for (const double load : {0.0, 0.5}) {
      const double torque = f.torque(parameters, speed * k / steps, load * f.scales().torque_max_nm, 30, by.data());
      friction += std::pow(torque - f.offset(parameters), 2);
      squares += by.cwiseAbs2();
    }
  return {std::sqrt(friction / (2 * steps)), (squares / (2 * steps)).cwiseSqrt()};
}

}  // namespace

DynamicsInformation::DynamicsInformation(const Regressor& regressor, const BaseParameters& base,
                                         const RobotFriction& friction, Settings settings)
    : regressor_(regressor),
      base_(base),
      friction_(friction),
      settings_(std::move(settings)),
      armature_(regressor.model_parameters().tail(regressor.joints())) {
  const VectorXd scale = (base.from_all.cwiseAbs2() * inertial_scale(regressor).cwiseAbs2()).cwiseSqrt();
  for (Index k = 0; k < base.size(); ++k)
    parameters_.push_back(
        {base.parameters[static_cast<std::size_t>(k)].name, -1, settings_.parameters.base(k), scale(k)});
  for (Index j = 0; j < regressor.joints(); ++j) {
    const auto at = static_cast<std::size_t>(j);
    const JointFriction& f = friction[at];
    const auto& values = settings_.parameters.friction[at];
    const auto [torque, by] = sizes_of(f, values, settings_.speed(j));
    const auto conventions = f.reference_temperatures();
    auto& place = place_.emplace_back();
    for (Index p = 0; p < f.size(); ++p) {
      const auto name = f.parameter(p).name;
      if (std::ranges::find(conventions, name) != conventions.end()) {
        place.push_back(-1);
        continue;
      }
      const double value = values[static_cast<std::size_t>(p)];
      place.push_back(size());
      const double tenth = by(p) > 0 ? 0.1 * torque / by(p) + 1e-12 : 1;
      parameters_.push_back({fmt::format("{}.{}", regressor.joint_name(j), name), j, value,
                             value == 0            ? tenth
                             : name == offset_name ? std::max(std::abs(value), tenth)
                                                   : std::abs(value)});
    }
  }
}

void DynamicsInformation::add_row(Index joint, const VectorXd& qd, const VectorXd& qdd, double temperature_degC,
                                  double weight, const MatrixXd& Y, Eigen::Ref<RowVectorXd> row) const {
  const auto at = static_cast<std::size_t>(joint);
  double rigid = 0;
  for (Index k = 0; k < base_.size(); ++k) {
    const double y = Y(joint, base_.independent[static_cast<std::size_t>(k)]);
    rigid += y * settings_.parameters.base(k);
    row(k) = weight * y * parameters_[static_cast<std::size_t>(k)].scale;
  }
  double by[friction::max_parameters + 2];
  friction_[at].torque(settings_.parameters.friction[at], qd(joint), rigid - armature_(joint) * qdd(joint),
                       temperature_degC, by);
  for (std::size_t p = 0; p < place_[at].size(); ++p)
    if (const Index c = place_[at][p]; c >= 0) row(c) = weight * by[p] * parameters_[static_cast<std::size_t>(c)].scale;
}

namespace {

/// Sums R'R of rows, some at a time.
class Gram {
 public:
  explicit Gram(Index size) : rows_(MatrixXd::Zero(at_once, size)), sum_(MatrixXd::Zero(size, size)) {}
  auto row() {
    if (used_ == at_once) flush();
    rows_.row(used_).setZero();
    return rows_.row(used_++);
  }
  MatrixXd sum() {
    flush();
    return sum_;
  }

 private:
  static constexpr Index at_once = 256;
  void flush() {
    sum_.selfadjointView<Eigen::Lower>().rankUpdate(rows_.topRows(used_).transpose());
    used_ = 0;
  }
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows_;
  MatrixXd sum_;
  Index used_ = 0;
};

}  // namespace

MatrixXd DynamicsInformation::of(const MotionStates& states, std::span<const VectorXd> temperatures_degC) const {
  Regressor regressor = regressor_;
  const Index n = regressor.joints();
  std::vector<std::vector<bool>> counts;
  for (Index j = 0; j < n; ++j)
    counts.push_back(counted(states, j, slow * settings_.speed(j), ringing_periods / settings_.cutoff_hz));
  const VectorXd weight = std::sqrt(2 * settings_.cutoff_hz * states.step_s) * settings_.noise.cwiseInverse();
  Gram gram(size());
  for (Index i = 0; i < states.size(); ++i) {
    if (std::ranges::none_of(counts, [&](const auto& c) { return c[static_cast<std::size_t>(i)]; })) continue;
    const VectorXd qd = states.qd.col(i), qdd = states.qdd.col(i);
    const MatrixXd& Y = regressor.at(states.q.col(i), qd, qdd);
    for (Index j = 0; j < n; ++j)
      if (counts[static_cast<std::size_t>(j)][static_cast<std::size_t>(i)])
        for (const VectorXd& degC : temperatures_degC) add_row(j, qd, qdd, degC(j), weight(j), Y, gram.row());
  }
  return gram.sum();
}

MatrixXd DynamicsInformation::of(const JointMotion& motion) const {
  Regressor regressor = regressor_;
  const VectorXd weight = std::sqrt(2 * motion.cutoff_hz * motion.period_s) * settings_.noise.cwiseInverse();
  Gram gram(size());
  for (Index i = 0; i < motion.size(); ++i) {
    if (!motion.moving.col(i).any()) continue;
    const VectorXd qd = motion.qd.col(i), qdd = motion.qdd.col(i);
    const MatrixXd& Y = regressor.at(motion.q.col(i), qd, qdd);
    for (Index j = 0; j < regressor.joints(); ++j)
      if (motion.moving(j, i)) add_row(j, qd, qdd, motion.temperature_degC(j, i), weight(j), Y, gram.row());
  }
  return gram.sum();
}

MatrixXd DynamicsInformation::of_sigmas(const RobotParameters& sigma) const {
  VectorXd relative = VectorXd::Constant(size(), std::numeric_limits<double>::quiet_NaN());
  for (Index k = 0; k < base_.size(); ++k) relative(k) = sigma.base(k);
  for (std::size_t j = 0; j < place_.size(); ++j)
    for (std::size_t p = 0; p < place_[j].size(); ++p)
      if (place_[j][p] >= 0) relative(place_[j][p]) = sigma.friction[j][p];
  for (Index c = 0; c < size(); ++c) {
    const double s = relative(c) / parameters_[static_cast<std::size_t>(c)].scale;
    relative(c) = s > 0 ? 1 / (s * s) : 0;
  }
  return relative.asDiagonal();
}

VectorXd DynamicsInformation::sigmas(const MatrixXd& information) const {
  constexpr double unknown = 1e3;
  const MatrixXd I = MatrixXd(information.selfadjointView<Eigen::Lower>()) +
                     1 / (unknown * unknown) * MatrixXd::Identity(size(), size());
  VectorXd out = symmetric_inverse(I).diagonal().cwiseMax(0).cwiseSqrt();
  for (double& s : out)
    if (s > 0.5 * unknown) s = std::numeric_limits<double>::infinity();
  return out;
}

}  // namespace tribotwin::twin::identification
