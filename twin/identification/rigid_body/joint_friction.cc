#include <cmath>

#include <tribotwin/twin/identification/rigid_body/joint_friction.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t offset = 2;  // place of the offset in coulomb_viscous

constexpr friction::Parameter coulomb_viscous_parameters[] = {
    {"Fc", "Nm", -1e9, 1e9, none, none, "Coulomb friction"},
    {"Fv", "Nm s/rad", -1e9, 1e9, none, none, "viscous slope"},
    {"offset", "Nm", -1e9, 1e9, none, none, "of the torque, whatever the speed"},
};

constexpr friction::LawInfo coulomb_viscous_law{
    .name = "coulomb_viscous",
    .equation = "Fc sgn v + Fv v + offset",
    .source = "paper 3",
    .side = friction::Side::arm,
    .normalised = false,
    .temperature_dependent = false,
    .load_dependent = false,
    .identified = {},
    .parameters = coulomb_viscous_parameters,
    .family = [](std::span<const double> p) { return friction::GeneralLaw{.A = p[0], .F1 = p[1]}; },
    .conflict = nullptr};

using Gradient = Eigen::Matrix<double, linear_count + nonlinear_count, 1>;

/// The family's friction at v > 0 and its derivatives by the fields, in the order of linear_fields and
/// nonlinear_fields.
double family(const friction::GeneralLaw& f, double v, double l, double T, Gradient& by) {
  const double s = std::max(0.0, 1 + f.s_T * (T - f.s_T0)), log_v = std::log(v);
  const double vs = f.vs + (f.vs_T + f.vs_TT * T) * T, u = std::abs(vs) < 1e-9 ? 1e-9 : vs,
               log_1 = log_v - std::log(std::abs(u)), log_2 = log_v - std::log(f.vl);
  // Powers beyond 700 leave nothing of e^-x, and infinity times 0 of its derivative.
  const double x1 = std::exp(std::min(f.alpha * log_1, 6.55)), e1 = std::exp(-x1),
               x2 = std::exp(std::min(f.alpha * log_2, 6.55)), e2 = std::exp(-x2);
  const double eT = std::exp(std::clamp(-T / f.T_V, -700.0, 700.0)),
               vb = std::exp(std::clamp((f.beta + f.beta_T * T) * log_v, -700.0, 700.0));
  by << 1, T, T * T, l, e1, e1 * T, e1 * T * T, e1 * l, l * e2, v, v * T, v * T * T, v * eT, v * v, v * v * v, vb,
      vb * eT, Eigen::Matrix<double, nonlinear_count, 1>::Zero();
  by *= s;
  double sum = 0;
  for (std::size_t k = 0; k < linear_count; ++k) sum += f.*linear_fields[k] * by(static_cast<Eigen::Index>(k));
  const double B = s * (f.B + (f.B_T + f.B_TT * T) * T + f.B_l * l) * e1 * x1, C = s * f.C_l * l * e2 * x2,
               power = s * (f.Fb + f.Fb_T * eT) * vb * log_v;
  const double unscaled = s > 0 ? sum / s : 0;
  by.tail<nonlinear_count>() << B * f.alpha / u, T * B * f.alpha / u, T * T * B * f.alpha / u, C * f.alpha / f.vl,
      -B * log_1 - C * log_2, s * (f.F1_T * v + f.Fb_T * vb) * eT * T / (f.T_V * f.T_V), power, T * power,
      unscaled * (T - f.s_T0), -unscaled * f.s_T;
  return sum;
}

}  // namespace

const friction::LawInfo& coulomb_viscous() { return coulomb_viscous_law; }

JointFriction::JointFriction(const friction::LawInfo& law, Scales scales) : law_(&law), scales_(scales), place_(law) {}

double JointFriction::torque(std::span<const double> p, double speed, double load_nm, double temperature_degC,
                             double* derivatives) const {
  const double sign = std::copysign(scales_.torque, speed);
  Gradient by;
  double value = sign * family(law_->family(p), std::abs(speed) * scales_.speed,
                               std::abs(load_nm) / scales_.torque_max_nm, temperature_degC, by);
  const bool has_offset = law_ == &coulomb_viscous_law;
  if (derivatives) {
    Eigen::Map<Eigen::VectorXd> out(derivatives, size());
    out = sign * (place_.linear.transpose() * by.head<linear_count>()(place_.linear_used) +
                  place_.nonlinear.transpose() * by.tail<nonlinear_count>()(place_.nonlinear_used));
    if (has_offset) out(offset) = 1;
  }
  return has_offset ? value + p[offset] : value;
}

}  // namespace tribotwin::twin::identification
