#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/twin/identification/experiment_design/experiment_design.hpp>
#include <tribotwin/twin/identification/experiment_design/typical_friction.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr Directional beside{.offset = true};
/// Of the torques, where nobody says; noise as a share of the rigid torque and of friction at half speed.
constexpr double usual_cutoff_hz = 20, usual_noise = 0.01;
/// The rise that a warm-up aims at [K], as a share of the steady one if that is less.
constexpr double wanted_rise_K = 15, reachable = 0.8;
constexpr double step_s = 0.05;

/// What is assumed and known before the motion.
struct Prior {
  RobotFriction friction;
  DynamicsInformation::Settings settings;
  std::string noise_source;
  std::vector<thermal::Model> thermal;  ///< per joint
  std::vector<std::string> notes;
};

/// The units of load of joints without a drive.
std::vector<double> torque_max(const DesignInput& input, const VectorXd& typical_nm) {
  if (input.known && !input.known->torque_max_nm.empty()) return input.known->torque_max_nm;
  VectorXd out = 2 * typical_nm;
  if (input.recorded) out = input.recorded->torque.cwiseAbs().rowwise().maxCoeff().cwiseMax(1e-9);
  return {out.begin(), out.end()};
}

std::vector<thermal::Model> thermal_of(const mujoco::Model& model, Index joints, const DesignInput& input) {
  if (input.known && !input.known->thermal.empty()) return input.known->thermal;
  std::vector<thermal::Model> out(static_cast<std::size_t>(joints), thermal::Model{.T_amb_degC = 20});
  for (const auto& drive : model.drives()) out[static_cast<std::size_t>(drive.dof)] = drive.drive.thermal;
  return out;
}

/// Takes numbers of a file where its law is the same.
void use_file(const DynamicsFile& file, const friction::LawInfo& law, Prior& prior) {
  prior.settings.parameters.base = file.parameters.base;
  if (file.signals.cutoff_hz > 0) prior.settings.cutoff_hz = file.signals.cutoff_hz;
  if (!file.noise.empty()) {
    for (Index j = 0; j < prior.settings.noise.size(); ++j)
      if (const double noise = file.noise[static_cast<std::size_t>(j)]; !std::isnan(noise))
        prior.settings.noise(j) = std::max(noise, 1e-4 * prior.settings.noise(j));
    prior.noise_source = "of the parameters' file";
  }
  if (file.law != &law) {
    prior.notes.push_back(fmt::format("the file has friction '{}', not '{}': only its base parameters count as known",
                                      file.law->name, law.name));
    return;
  }
  for (std::size_t r = 0; r < prior.friction.size(); ++r) {
    if (r < file.left_out.size() && !file.left_out[r].empty()) continue;
    auto& values = prior.settings.parameters.friction[r];
    const auto& known = file.parameters.friction[r];
    std::copy_n(known.begin(), law.parameters.size(), values.begin());
    if (file.directional.offset && values.size() > law.parameters.size() && known.size() > law.parameters.size())
      values[law.parameters.size()] = known[law.parameters.size()];
  }
}

/// Whether friction with these numbers is that of the fit where it was recorded, within a quarter, and not another by
/// a factor of four when it is warmer: numbers of a fit and of typical friction, each plausible, may not go together.
bool go_together(const JointFriction& f, const std::vector<double>& values, const std::vector<double>& fitted,
                 double fastest, double recorded_degC) {
  double error = 0, size = 0;
  for (const double share : {0.05, 0.1, 0.2, 0.4, 0.7, 1.0})
    for (const double load : {0.0, 0.5}) {
      const auto at = [&](const std::vector<double>& p, double degC) {
        return f.torque(p, share * fastest, load * f.scales().torque_max_nm, degC) - f.offset(p);
      };
      const double torque = at(values, recorded_degC), warm = at(values, recorded_degC + wanted_rise_K);
      error += std::pow(torque - at(fitted, recorded_degC), 2), size += std::pow(at(fitted, recorded_degC), 2);
      if (!(std::abs(warm) < 4 * std::abs(torque)) || !(std::abs(torque) < 4 * std::abs(warm))) return false;
    }
  return error < 0.25 * 0.25 * size;
}

/// The numbers of a rotor about which to linearise: those that the fit knows to half their value beside typical ones,
/// or else all of the fit; the typical ones where neither makes up friction.
std::vector<double> about(const JointFriction& f, const std::vector<Estimate>& fit, const std::vector<double>& typical,
                          double fastest, double recorded_degC, const std::string& name,
                          std::vector<std::string>& notes) {
  std::vector<double> some = typical, all;
  for (std::size_t p = 0; p < fit.size(); ++p) {
    if (fit[p].sigma < 0.5 * std::abs(fit[p].value)) some[p] = fit[p].value;
    all.push_back(fit[p].value);
  }
  all.resize(typical.size(), 0.0);
  if (go_together(f, some, all, fastest, recorded_degC)) return some;
  if (go_together(f, all, all, fastest, recorded_degC)) return all;
  notes.push_back(
      fmt::format("{}: what the recordings tell of its friction makes up no curve that is possible when "
                  "warm; typical friction is assumed",
                  name));
  return typical;
}

/// Identifies the recordings: their noise, correlated in time as it is, and the numbers that they tell.
void use_recordings(const Regressor& regressor, const BaseParameters& base, const JointMotion& recorded, Prior& prior) {
  prior.settings.cutoff_hz = recorded.cutoff_hz;
  const auto fit = fit_dynamics(regressor, base, prior.friction, recorded);
  if (!fit) {
    prior.notes.push_back(
        fmt::format("the recordings alone cannot be identified ({}); the noise is assumed", fit.error().message));
    return;
  }
  prior.noise_source = "of the recordings";
  for (std::size_t j = 0; j < fit->joints.size(); ++j) {
    if (fit->joints[j].samples == 0) continue;
    prior.settings.noise(static_cast<Index>(j)) =
        fit->joints[j].noise *
        std::sqrt(std::max(1.0, fit->joints[j].correlation * 2 * recorded.cutoff_hz * recorded.period_s));
  }
  for (std::size_t r = 0; r < fit->friction.size(); ++r) {
    const auto rotor = static_cast<Index>(r), joint = regressor.joint_of(rotor);
    if (fit->joints[static_cast<std::size_t>(joint)].samples == 0) continue;
    auto& values = prior.settings.parameters.friction[r];
    values = about(prior.friction[r], fit->friction[r], values, fastest_of(regressor, rotor, prior.settings.speed),
                   recorded.temperature_degC.row(joint).mean(), regressor.rotor_name(rotor), prior.notes);
  }
  for (Index k = 0; k < base.size(); ++k)
    if (const Estimate& e = fit->base[static_cast<std::size_t>(k)]; std::isfinite(e.sigma))
      prior.settings.parameters.base(k) = e.value;
}

Result<Prior> prior_of(const mujoco::Model& model, const Regressor& regressor, const BaseParameters& base,
                       const DesignInput& input, const MotionLimits& limits) {
  const VectorXd typical_nm = typical_torque(regressor, limits);
  auto friction = robot_friction(model, regressor, *input.law, beside, torque_max(input, typical_nm));
  if (!friction) return tl::unexpected(friction.error());
  auto values = typical_friction(model, regressor, *friction, limits, typical_nm);
  if (!values) return tl::unexpected(values.error());
  VectorXd torque_nm = typical_nm;
  for (Index r = 0; r < regressor.rotors(); ++r) {
    const auto at = static_cast<std::size_t>(r);
    const double half = 0.5 * fastest_of(regressor, r, limits.speed),
                 torque = std::abs((*friction)[at].torque((*values)[at], half, 0, 20));
    for (Index j = 0; j < regressor.joints(); ++j) torque_nm(j) += std::abs(regressor.turns(r, j)) * torque;
  }
  Prior out{
      .friction = std::move(*friction),
      .settings = {.parameters = {.base = base.from_all * regressor.model_parameters(), .friction = std::move(*values)},
                   .noise = usual_noise * torque_nm,
                   .cutoff_hz = usual_cutoff_hz,
                   .speed = limits.speed},
      .noise_source = "assumed, 1 % of the torque",
      .thermal = thermal_of(model, regressor.joints(), input),
      .notes = {}};
  if (input.known) use_file(*input.known, *input.law, out);
  if (input.recorded) use_recordings(regressor, base, *input.recorded, out);
  for (std::size_t j = 0; j < input.noise.size(); ++j)
    if (input.noise[j]) out.settings.noise(static_cast<Index>(j)) = *input.noise[j], out.noise_source = "given";
  return out;
}

/// Information of the recordings or the estimates there are.
MatrixXd information_before(const DynamicsInformation& information, const DesignInput& input) {
  MatrixXd out = MatrixXd::Zero(information.size(), information.size());
  if (input.recorded) out += information.of(*input.recorded);
  if (!input.known) return out;
  const DynamicsFile& file = *input.known;
  const auto own = static_cast<std::ptrdiff_t>(input.law->parameters.size());
  RobotParameters sigma{.base = file.sigma.base, .friction = {}};
  for (const auto& joint : file.sigma.friction) {
    auto& sigmas = sigma.friction.emplace_back(own + 1, std::numeric_limits<double>::quiet_NaN());
    if (file.law == input.law)
      std::copy_n(joint.begin(), std::min(std::ssize(joint), own + file.directional.offset), sigmas.begin());
  }
  return out + information.of_sigmas(sigma);
}

/// Mean heat [W] of friction over a motion, per joint.
VectorXd heat_of(const MotionStates& states, const Regressor& regressor, const Prior& prior, const VectorXd& degC) {
  Regressor own = regressor;
  const VectorXd phi = regressor.model_parameters();
  VectorXd out = VectorXd::Zero(regressor.joints());
  for (Index i = 0; i < states.size(); ++i) {
    const VectorXd rigid = own.at(states.q.col(i), states.qd.col(i), states.qdd.col(i)) * phi;
    for (Index r = 0; r < regressor.rotors(); ++r) {
      const auto at = static_cast<std::size_t>(r);
      const auto& values = prior.settings.parameters.friction[at];
      const Index j = regressor.joint_of(r);
      const double speed = regressor.speed(r, states.qd.col(i)), load = regressor.load(r, rigid, states.qdd.col(i));
      if (speed == 0) continue;
      const double torque = prior.friction[at].torque(values, speed, load, degC(j)) - prior.friction[at].offset(values);
      out(j) += speed * torque / static_cast<double>(states.size());
    }
  }
  return out.cwiseMax(0);
}

/// Follows the temperatures of all joints under constant heat until each has reached its goal.
WarmUp warmed(const VectorXd& heat_w, std::span<const thermal::Model> models, WarmUp out) {
  constexpr double minute_s = 60, longest_s = 24 * 3600;
  std::vector<thermal::Rise> rise(models.size());
  const auto arrived = [&](std::size_t j) {
    const double steady = models[j].resistance_K_W() * heat_w(static_cast<Index>(j));
    return rise[j].total_K() >= std::min(wanted_rise_K, reachable * steady);
  };
  const auto all_arrived = [&] {
    for (std::size_t j = 0; j < models.size(); ++j)
      if (!arrived(j)) return false;
    return true;
  };
  while (!all_arrived() && out.duration_s < longest_s) {
    for (std::size_t j = 0; j < models.size(); ++j)
      thermal::step(models[j], thermal::decay(models[j], minute_s), heat_w(static_cast<Index>(j)), 0, rise[j]);
    out.duration_s += minute_s;
  }
  for (std::size_t j = 0; j < models.size(); ++j) out.warm_degC(static_cast<Index>(j)) += rise[j].total_K();
  return out;
}

/// The loads that a motion puts on each rotor's gear, lowest and highest, in the unit of the law.
std::vector<std::pair<double, double>> loads_of(const MotionStates& states, const Regressor& regressor,
                                                const RobotFriction& friction) {
  Regressor own = regressor;
  const VectorXd phi = regressor.model_parameters();
  std::vector<std::pair<double, double>> out(friction.size());
  for (Index i = 0; i < states.size(); ++i) {
    const VectorXd rigid = own.at(states.q.col(i), states.qd.col(i), states.qdd.col(i)) * phi;
    for (Index r = 0; r < regressor.rotors(); ++r) {
      const auto at = static_cast<std::size_t>(r);
      const double load = regressor.load(r, rigid, states.qdd.col(i)) / friction[at].scales().torque_max_nm;
      if (i == 0) out[at] = {load, load};
      out[at] = {std::min(out[at].first, load), std::max(out[at].second, load)};
    }
  }
  return out;
}

WarmUp warm_up_of(const Excitation& motion, const Regressor& regressor, const Prior& prior, const VectorXd& cold_degC) {
  WarmUp out{.cold_degC = cold_degC, .warm_degC = cold_degC, .lacking = {}};
  for (std::size_t j = 0; j < prior.thermal.size(); ++j)
    if (prior.thermal[j].order == thermal::Order::prescribed) {
      out.lacking = fmt::format("joint {} has no thermal model", regressor.joint_name(static_cast<Index>(j)));
      out.warm_degC.array() += wanted_rise_K;
      return out;
    }
  const VectorXd heat =
      heat_of(motion.states(step_s, motion.duration_s()), regressor, prior, cold_degC.array() + wanted_rise_K / 2);
  return warmed(heat, prior.thermal, out);
}

}  // namespace

Result<ExperimentDesign> design_experiment(const mujoco::Model& model, const Regressor& regressor,
                                           const BaseParameters& base, const DesignInput& input,
                                           ExcitationOptions options) {
  auto prior = prior_of(model, regressor, base, input, motion_limits(model, regressor, options.share));
  if (!prior) return tl::unexpected(prior.error());
  const DynamicsInformation information(regressor, base, prior->friction, prior->settings);
  VectorXd cold(regressor.joints());
  for (Index j = 0; j < cold.size(); ++j) cold(j) = prior->thermal[static_cast<std::size_t>(j)].T_amb_degC;
  const bool two = input.law->temperature_dependent;
  const auto of = [&](const MotionStates& states, const VectorXd& warm) -> MatrixXd {
    return two ? information.of(states, std::vector{cold, warm}) : information.of(states, std::vector{cold});
  };
  const MatrixXd known = information_before(information, input);
  const DesignCriterion criterion{known + information.weak(),
                                  [&](const MotionStates& states) { return of(states, cold.array() + wanted_rise_K); }};
  options.criterion = &criterion;
  auto motion = excite(model, regressor, base, options);
  if (!motion) return tl::unexpected(motion.error());
  ExperimentDesign out{.motion = std::move(*motion),
                       .friction = prior->friction,
                       .parameters = information.parameters(),
                       .before = information.sigmas(known),
                       .after = {},
                       .noise = prior->settings.noise,
                       .noise_source = prior->noise_source,
                       .cutoff_hz = prior->settings.cutoff_hz,
                       .warm_up = {},
                       .loads = {},
                       .notes = std::move(prior->notes)};
  if (two) out.warm_up = warm_up_of(out.motion, regressor, *prior, cold);
  const MotionStates states = out.motion.states(step_s, out.motion.duration_s());
  if (input.law->load_dependent) out.loads = loads_of(states, regressor, out.friction);
  out.after = information.sigmas(known + of(states, two ? out.warm_up->warm_degC : cold));
  return out;
}

}  // namespace tribotwin::twin::identification
