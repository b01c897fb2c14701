#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>
#include <tribotwin/twin/numerics/direction.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

namespace {

/// Whether a rotor that acts on the joint turns within two periods of the cut-off. There torque says little of its lag:
/// friction follows a reversal late by itself, and its step is recorded a part of a sample late.
std::vector<bool> near_reversals(const Regressor& regressor, const JointMotion& motion, Index joint) {
  constexpr double turning = 0.05, periods = 2;
  std::vector<bool> out(static_cast<std::size_t>(motion.size()));
  for (const auto& [first, last] : motion.segments)
    for (Index i = first; i < last; ++i)
      for (Index r = 0; r < regressor.rotors(); ++r) {
        const double now = motion.direction(r, i), before = motion.direction(r, std::max(first, i - 1));
        if (regressor.turns(r, joint) != 0 && (std::abs(std::abs(now) - 1) > turning || now * before < 0))
          out[static_cast<std::size_t>(i)] = true;
      }
  return widened(out, static_cast<std::size_t>(std::ceil(periods / (motion.cutoff_hz * motion.period_s))));
}

}  // namespace

Result<RobotFriction> robot_friction(const mujoco::Model& model, const Regressor& regressor,
                                     const friction::LawInfo& law, Directional directional,
                                     std::span<const double> torque_max_nm) {
  RobotFriction out;
  for (Index r = 0; r < regressor.rotors(); ++r) {
    const Index j = regressor.joint_of(r);
    JointFriction::Scales scales;
    const auto drive = std::ranges::find(model.drives(), static_cast<int>(j), &mujoco::Binding::dof);
    if (drive != model.drives().end()) {
      scales.torque_max_nm = drive->drive.torque_max_nm;
      if (law.side == friction::Side::motor) scales.speed = drive->drive.gear_ratio;
    } else if (!torque_max_nm.empty()) {
      scales.torque_max_nm = torque_max_nm[static_cast<std::size_t>(j)];
    } else if (law.normalised || law.load_dependent) {
      return tl::unexpected(
          fmt::format("law '{}' depends on load or normalised torque, but joint {} has no tribotwin.drive with "
                      "gear_ratio and torque_max_nm in the model",
                      law.name, regressor.joint_name(j)));
    }
    if (law.normalised) scales.torque = scales.torque_max_nm;
    Directional beside = directional;
    if (regressor.is_coupled(r)) beside.offset = false;
    beside.position = directional.position && may_depend_on_position(regressor, r);
    out.emplace_back(law, scales, beside);
  }
  return out;
}

bool may_depend_on_position(const Regressor& regressor, Index rotor) {
  return !regressor.is_coupled(rotor) && !regressor.is_slide(regressor.joint_of(rotor));
}

double friction_of(const Regressor& regressor, const RobotFriction& friction, const RobotParameters& parameters,
                   const JointMotion& motion, Index rotor, Index sample, const VectorXd& rigid, double* derivatives) {
  const auto at = static_cast<std::size_t>(rotor);
  const double speed = regressor.speed(rotor, motion.qd.col(sample));
  const Index joint = regressor.joint_of(rotor);
  if (speed == 0 && !derivatives)  // at rest friction is not known, what depends on speed is 0
    return friction[at].offset(parameters.friction[at]) +
           friction[at].position_torque(parameters.friction[at], motion.q(joint, sample), nullptr);
  return friction[at].filtered_torque(parameters.friction[at], speed, motion.direction(rotor, sample),
                                      regressor.load(rotor, rigid, motion.qdd.col(sample)),
                                      motion.temperature_degC(joint, sample), derivatives) +
         friction[at].position_torque(parameters.friction[at], motion.q(joint, sample), derivatives);
}

Index first_column(const Regressor& regressor, int body) {
  const auto& columns = regressor.columns();
  const auto found = std::ranges::find(columns, body, &Regressor::Column::body);
  return found == columns.end() ? -1 : found - columns.begin();
}

MatrixXd carried_torque(const Regressor& regressor, std::span<const std::optional<CarriedBody>> carried,
                        const JointMotion& motion) {
  if (std::ranges::none_of(carried, [](const auto& body) { return body.has_value(); })) return {};
  MatrixXd out = MatrixXd::Zero(regressor.joints(), motion.size());
  Regressor own = regressor;
  for (std::size_t s = 0; s < motion.segments.size(); ++s) {
    const auto& body = carried[motion.file[s]];
    if (!body) continue;
    const Index first = first_column(regressor, body->body);
    for (Index i = motion.segments[s].first; i < motion.segments[s].second; ++i)
      out.col(i) =
          own.at(motion.q.col(i), motion.qd.col(i), motion.qdd.col(i)).middleCols(first, body->parameters.size()) *
          body->parameters;
  }
  return out;
}

MatrixXd predicted_torque(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                          const RobotParameters& parameters, const JointMotion& motion, unsigned threads) {
  constexpr Index chunk = 4096;
  MatrixXd torque(regressor.joints(), motion.size());
  in_parallel(static_cast<std::size_t>((motion.size() + chunk - 1) / chunk), threads, [&](std::size_t part) {
    Regressor own = regressor;
    const Index first = static_cast<Index>(part) * chunk;
    VectorXd rigid;
    for (Index i = first; i < std::min(first + chunk, motion.size()); ++i) {
      rigid =
          own.at(motion.q.col(i), motion.qd.col(i), motion.qdd.col(i))(Eigen::all, base.independent) * parameters.base;
      if (motion.carried_torque.size() > 0) rigid += motion.carried_torque.col(i);
      torque.col(i) = rigid;
      for (Index r = 0; r < regressor.rotors(); ++r) {
        const double f = friction_of(regressor, friction, parameters, motion, r, i, rigid);
        for (Index j = 0; j < regressor.joints(); ++j)
          if (const double turns = regressor.turns(r, j); turns != 0) torque(j, i) += turns * f;
      }
    }
  });
  return torque;
}

MatrixXd gear_load(const Regressor& regressor, const BaseParameters& base, const VectorXd& parameters,
                   const JointMotion& motion, unsigned threads) {
  RobotFriction none;
  for (Index r = 0; r < regressor.rotors(); ++r) none.emplace_back(coulomb_viscous(), JointFriction::Scales{});
  const MatrixXd rigid = predicted_torque(
      regressor, base, none, {.base = parameters, .friction = std::vector<std::vector<double>>(none.size(), {0, 0})},
      motion, threads);
  MatrixXd load(rigid.rows(), rigid.cols());
  for (Index i = 0; i < load.cols(); ++i)
    for (Index j = 0; j < load.rows(); ++j) load(j, i) = regressor.load(j, rigid.col(i), motion.qdd.col(i));
  return load;
}

MatrixXd slope_by_time(const MatrixXd& torque, const Regressor& regressor, const JointMotion& motion) {
  MatrixXd slope = MatrixXd::Zero(torque.rows(), torque.cols());
  for (Index j = 0; j < torque.rows(); ++j) {
    const std::vector<bool> left_out = near_reversals(regressor, motion, j);
    for (const auto& [first, last] : motion.segments)
      for (Index i = first; i < last; ++i) {
        const auto known = [&, from = first, to = last](Index k) {
          return k >= from && k < to && !std::isnan(torque(j, k));
        };
        const Index before = known(i - 1) ? i - 1 : i, after = known(i + 1) ? i + 1 : i;
        if (left_out[static_cast<std::size_t>(i)] || !known(i) || before == after) continue;
        slope(j, i) = (torque(j, after) - torque(j, before)) / (motion.time_s[static_cast<std::size_t>(after)] -
                                                                motion.time_s[static_cast<std::size_t>(before)]);
      }
  }
  return slope;
}

namespace {

/// Of half a second of a joint: sums by which a lag shows.
struct LagSums {
  double product = 0;  ///< of the prediction's slope and what it is above the torque
  double slopes = 0;   ///< of the slopes of prediction and torque, whose noise is not one
};

/// Nothing where too little of the file tells.
std::optional<FileLag> lag_of(std::size_t file, Index joint, const std::vector<LagSums>& parts, double removed_s) {
  constexpr std::ptrdiff_t least_parts = 8;
  double product = 0, slopes = 0, squares = 0, count = 0;
  for (const LagSums& part : parts) product += part.product, slopes += part.slopes, count += part.slopes != 0;
  if (count < least_parts || !(slopes > 0)) return {};
  const double lag_s = product / slopes;
  for (const LagSums& part : parts) squares += std::pow(part.product - lag_s * part.slopes, 2);
  return FileLag{file, joint, removed_s + lag_s, std::sqrt(squares * count / (count - 1)) / slopes};
}

}  // namespace

std::vector<FileLag> lag_of_files(const Regressor& regressor, const JointMotion& motion, const MatrixXd& predicted) {
  constexpr double part_s = 0.5;
  const MatrixXd slope = slope_by_time(predicted, regressor, motion);
  std::vector<FileLag> out;
  for (Index j = 0; j < predicted.rows(); ++j) {
    std::map<std::size_t, std::vector<LagSums>> of_file;
    for (std::size_t s = 0; s < motion.segments.size() && !motion.is_left_out(j); ++s) {
      const auto [first, last] = motion.segments[s];
      std::vector<LagSums>& parts = of_file[motion.file[s]];
      double until_s = 0;
      for (Index i = first; i < last; ++i) {
        const double now_s = motion.time_s[static_cast<std::size_t>(i)];
        if (i == first || now_s >= until_s) parts.emplace_back(), until_s = now_s + part_s;
        if (slope(j, i) == 0 || i == first || i + 1 == last || !motion.moving(j, i)) continue;
        const double span_s =
            motion.time_s[static_cast<std::size_t>(i + 1)] - motion.time_s[static_cast<std::size_t>(i - 1)];
        parts.back().product += slope(j, i) * (predicted(j, i) - motion.torque(j, i));
        parts.back().slopes += slope(j, i) * (motion.torque(j, i + 1) - motion.torque(j, i - 1)) / span_s;
      }
    }
    const double removed_s = motion.lag_s.empty() ? 0 : motion.lag_s[static_cast<std::size_t>(j)];
    for (const auto& [file, parts] : of_file)
      if (const auto found = lag_of(file, j, parts, removed_s)) out.push_back(*found);
  }
  return out;
}

double LagSpread::chance() const { return files > 1 ? chi_squared_above(files - 1, squares) : 1; }
double LagSpread::factor() const { return files > 1 ? std::sqrt(std::max(1.0, squares / (files - 1))) : 1; }

LagSpread spread_of(std::span<const FileLag> lags, Index joint) {
  double weights = 0, sum = 0;
  LagSpread out;
  for (const FileLag& lag : lags)
    if (lag.joint == joint)
      weights += 1 / (lag.sigma_s * lag.sigma_s), sum += lag.value_s / (lag.sigma_s * lag.sigma_s);
  for (const FileLag& lag : lags)
    if (lag.joint == joint) out.squares += std::pow((lag.value_s - sum / weights) / lag.sigma_s, 2), ++out.files;
  return out;
}

}  // namespace tribotwin::twin::identification
