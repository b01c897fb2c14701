#include <algorithm>
#include <cmath>
#include <random>

#include <tribotwin/twin/control/compensator.hpp>

namespace tribotwin::twin {

std::string_view name_of(Compensation compensation) {
  return compensation == Compensation::none ? "none" : compensation == Compensation::static_ ? "static" : "proposed";
}

JointModel JointModel::misjudged(double relative, std::uint64_t seed) const {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const auto judged = [&](double x) { return x * (1 + relative * std::clamp(normal(random), -3.0, 3.0)); };
  JointModel m = *this;
  auto parameters = drive.law.parameters;
  for (double& p : parameters) p = judged(p);
  m.drive.law = friction::with_parameters(drive.law, {parameters.data(), drive.law.info->parameters.size()});
  for (double* p : {&m.drive.bristles.sigma0, &m.drive.bristles.sigma1, &m.drive.bristles.vd, &m.transmission.beta,
                    &m.transmission.gamma, &m.inertia_kg_m2})
    *p = judged(*p);
  for (double& p : m.drive.load_table.values) p = judged(p);
  for (auto& row : m.transmission.k)
    for (double& p : row) p = judged(p);
  m.transmission.w = std::min(judged(m.transmission.w), 1.0);
  m.transmission.n = std::max(judged(m.transmission.n), 1.0);
  m.transmission.gamma = std::clamp(m.transmission.gamma, -0.99 * m.transmission.beta, m.transmission.beta);
  return m;
}

double HysteresisInverse::update(double torque, double temperature) {
  const auto hysteretic = [&](double torsion) {
    return transmission::advance(h_, hysteretic_rad_, torsion - torsion_rad_);
  };
  const auto excess = [&](double torsion) {
    return transmission::torque_nm(h_, torsion, hysteretic(torsion), temperature) - torque;
  };
  // Torque grows with torsion: a bracket, then the secant with halved weights (Illinois).
  double a = torsion_rad_, fa = excess(a), b = a, fb = fa;
  double step = std::abs(fa) / h_.stiffness(a, temperature);
  for (int i = 0; i < 60 && fa * fb > 0; ++i, step *= 2) b = torsion_rad_ - std::copysign(step, fa), fb = excess(b);
  for (int i = 0; i < 60 && fb != 0 && fa * fb < 0 && std::abs(b - a) > 1e-13; ++i) {
    const double c = (a * fb - b * fa) / (fb - fa), fc = excess(c);
    if (fc * fb < 0)
      a = b, fa = fb;
    else
      fa *= 0.5;
    b = c, fb = fc;
  }
  hysteretic_rad_ = hysteretic(b);
  return torsion_rad_ = b;
}

Compensator::Compensator(JointModel model, const CompensatorOptions& options)
    : model_(std::move(model)),
      options_(options),
      observer_(options.observer_gain_1_s),
      inverse_(model_.transmission),
      reference_(friction::at_temperature(model_.drive.law, options.reference_temperature_degC)) {
  workspace_.temperature_held = 1;
}

void Compensator::state(StateNumbers& s) {
  observer_.state(s);
  inverse_.state(s);
  s.doubles(state_);
  s.doubles(workspace_);
  s(friction_nm_), s(applied_rad_), s(angle_rad_), s(fresh_);
}

double Compensator::gear_torque_nm() const { return observer_.residual_nm() * model_.ratio; }

double Compensator::static_friction_nm(double speed) const {
  const double friction_nm = drive::friction_nm(model_.drive, reference_, speed, 0);
  return (speed == 0 ? 0 : std::copysign(friction_nm, speed)) + model_.drive.offset_nm;
}

void Compensator::observe_friction(const Input& in, double time_s, double dt_s) {
  drive::Drive& drive = model_.drive;
  // Bristles driven by a count that toggles would lose their deflection: the angle follows with a hysteresis of one
  // count.
  angle_rad_ = fresh_ ? in.angle_rad
                      : std::clamp(angle_rad_, in.angle_rad - in.resolution_rad, in.angle_rad + in.resolution_rad);
  const double strengthening = std::copysign(workspace_.gear_limit_nm, in.speed_rad_s);
  if (!fresh_) {
    drive::end_step(drive, decay_,
                    {.friction_nm = strengthening,
                     .torque_nm = in.torque_nm,
                     .qd_end_rad_s = in.speed_rad_s,
                     .q_end_rad = angle_rad_,
                     .rotor_inertia_kg_m2 = model_.inertia_kg_m2},
                    dt_s, state_, workspace_);
    state_.z += options_.friction_gain_rad_nm_s * dt_s *
                (in.torque_nm - model_.inertia_kg_m2 * in.acceleration_rad_s2 - observer_.residual_nm() - friction_nm_);
  }
  state_.load_nm = observer_.residual_nm();
  drive::set_temperature(drive, state_, in.temperature_degC);
  drive::begin_step(drive, state_, workspace_, time_s, in.speed_rad_s, angle_rad_);
  friction_nm_ =
      workspace_.applied_nm + std::copysign(workspace_.gear_limit_nm, in.speed_rad_s) + model_.drive.offset_nm;
}

double Compensator::update(const Input& in, double time_s, double dt_s) {
  if (options_.compensation == Compensation::none) return 0;
  if (options_.compensation == Compensation::static_)
    friction_nm_ = static_friction_nm(in.speed_rad_s);
  else
    observe_friction(in, time_s, dt_s);
  observer_.update(in.torque_nm - friction_nm_, model_.inertia_kg_m2 * in.speed_rad_s, dt_s);
  fresh_ = false;
  const double temperature =
      options_.compensation == Compensation::static_ ? options_.reference_temperature_degC : in.temperature_degC;
  const double torsion = inverse_.update(gear_torque_nm(), temperature);
  // The dead zone: the applied torsion follows the estimated one at the distance of its noise.
  const double zone = options_.compensation == Compensation::proposed ? options_.dead_zone_rad : 0;
  return applied_rad_ = std::clamp(applied_rad_, torsion - zone, torsion + zone);
}

}  // namespace tribotwin::twin
