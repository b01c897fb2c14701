#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/twin/identification/experiment_design/dynamics_information.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/robot/inertial_prior/inertial_prior.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::MatrixXd, Eigen::RowVectorXd, Eigen::VectorXd;

double fastest_of(const Regressor& regressor, Index rotor, const VectorXd& speed) {
  double fastest = 0;
  for (Index j = 0; j < speed.size(); ++j) fastest += std::abs(regressor.turns(rotor, j)) * speed(j);
  return fastest;
}

namespace {

/// Whether a rotor is out of the reach of slow states in each state, by the rule of `dynamics` (SlowRows). The states
/// of a design are so far apart that a reversal may lie between two of them.
std::vector<bool> counted(const Regressor& regressor, const MotionStates& states, Index rotor, double slowest,
                          double guard_s) {
  const Index n = states.size(), guard = static_cast<Index>(std::ceil(guard_s / states.step_s - 1e-9));
  std::vector<double> speed;
  for (Index i = 0; i < n; ++i) speed.push_back(regressor.speed(rotor, states.qd.col(i)));
  std::vector<bool> slow, reverses;
  for (std::size_t i = 0; i < speed.size(); ++i) {
    slow.push_back(std::abs(speed[i]) < slowest);
    reverses.push_back(i + 1 < speed.size() && speed[i] * speed[i + 1] < 0);
  }
  std::vector<bool> out(speed.size(), true);
  for (Index i = 0; i < n; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (!slow[at] && !reverses[at]) continue;
    for (Index k = std::max<Index>(0, i - guard + (slow[at] ? 0 : 1)); k <= std::min(n - 1, i + guard); ++k)
      out[static_cast<std::size_t>(k)] = false;
  }
  return out;
}

/// A parameter whose share of friction is below 0.1 % was fitted to nothing: 0, and what rounding left of it.
constexpr double negligible = 0.01;

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
    : regressor_(regressor), base_(base), friction_(friction), settings_(std::move(settings)) {
  const VectorXd scale = (base.from_all.cwiseAbs2() * inertial_scale(regressor).cwiseAbs2()).cwiseSqrt();
  for (Index k = 0; k < base.size(); ++k)
    parameters_.push_back(
        {base.parameters[static_cast<std::size_t>(k)].name, -1, settings_.parameters.base(k), scale(k)});
  for (Index r = 0; r < regressor.rotors(); ++r) add_friction(r);
}

void DynamicsInformation::add_friction(Index rotor) {
  const auto at = static_cast<std::size_t>(rotor);
  const JointFriction& f = friction_[at];
  const auto& values = settings_.parameters.friction[at];
  const auto [torque, by] = sizes_of(f, values, fastest_of(regressor_, rotor, settings_.speed));
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
    const bool as_0 = std::abs(value) < negligible * tenth;
    parameters_.push_back({fmt::format("{}.{}", regressor_.rotor_name(rotor), name), rotor, value,
                           as_0                  ? tenth
                           : name == offset_name ? std::max(std::abs(value), tenth)
                                                 : std::abs(value)});
  }
}

MatrixXd DynamicsInformation::by_friction(const VectorXd& qd, const VectorXd& qdd, const VectorXd& temperature_degC,
                                          const MatrixXd& Y) const {
  const VectorXd rigid = Y(Eigen::all, base_.independent) * settings_.parameters.base;
  MatrixXd by = MatrixXd::Zero(friction::max_parameters + 2, regressor_.rotors());
  for (Index r = 0; r < regressor_.rotors(); ++r) {
    const auto at = static_cast<std::size_t>(r);
    friction_[at].torque(settings_.parameters.friction[at], regressor_.speed(r, qd), regressor_.load(r, rigid, qdd),
                         temperature_degC(regressor_.joint_of(r)), by.col(r).data());
  }
  return by;
}

void DynamicsInformation::fill(Index joint, double weight, const MatrixXd& Y, const MatrixXd& by,
                               Eigen::Ref<RowVectorXd> row) const {
  const auto scale = [&](Index c) { return parameters_[static_cast<std::size_t>(c)].scale; };
  for (Index k = 0; k < base_.size(); ++k)
    row(k) = weight * Y(joint, base_.independent[static_cast<std::size_t>(k)]) * scale(k);
  for (Index r = 0; r < regressor_.rotors(); ++r) {
    const double turns = regressor_.turns(r, joint);
    if (turns == 0) continue;
    const auto& place = place_[static_cast<std::size_t>(r)];
    for (std::size_t p = 0; p < place.size(); ++p)
      if (const Index c = place[p]; c >= 0) row(c) = weight * turns * by(static_cast<Index>(p), r) * scale(c);
  }
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
    if (used_ == 0) return;  // Eigen 3.4 divides by the number of rows
    sum_.selfadjointView<Eigen::Lower>().rankUpdate(rows_.topRows(used_).transpose());
    used_ = 0;
  }
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows_;
  MatrixXd sum_;
  Index used_ = 0;
};

}  // namespace

Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic> DynamicsInformation::counting(const MotionStates& states) const {
  Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic> out;
  out.setConstant(regressor_.joints(), states.size(), true);
  for (Index r = 0; r < regressor_.rotors(); ++r) {
    const double slowest = SlowRows::share * fastest_of(regressor_, r, settings_.speed);
    const auto fast = counted(regressor_, states, r, slowest, SlowRows::periods / settings_.cutoff_hz);
    for (Index j = 0; j < regressor_.joints(); ++j)
      if (regressor_.turns(r, j) != 0)
        for (Index i = 0; i < states.size(); ++i) out(j, i) = out(j, i) && fast[static_cast<std::size_t>(i)];
  }
  return out;
}

MatrixXd DynamicsInformation::of(const MotionStates& states, std::span<const VectorXd> temperatures_degC) const {
  Regressor regressor = regressor_;
  const auto counts = counting(states);
  const VectorXd weight = std::sqrt(2 * settings_.cutoff_hz * states.step_s) * settings_.noise.cwiseInverse();
  Gram gram(size());
  for (Index i = 0; i < states.size(); ++i) {
    if (!counts.col(i).any()) continue;
    const VectorXd qd = states.qd.col(i), qdd = states.qdd.col(i);
    const MatrixXd& Y = regressor.at(states.q.col(i), qd, qdd);
    for (const VectorXd& degC : temperatures_degC) {
      const MatrixXd by = by_friction(qd, qdd, degC, Y);
      for (Index j = 0; j < regressor.joints(); ++j)
        if (counts(j, i)) fill(j, weight(j), Y, by, gram.row());
    }
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
    const MatrixXd by = by_friction(qd, qdd, motion.temperature_degC.col(i), Y);
    for (Index j = 0; j < regressor.joints(); ++j)
      if (motion.moving(j, i)) fill(j, weight(j), Y, by, gram.row());
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
