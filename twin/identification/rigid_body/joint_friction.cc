#include <cmath>
#include <limits>

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
    .source = "Hao 2021",
    .side = friction::Side::arm,
    .normalised = false,
    .temperature_dependent = false,
    .load_dependent = false,
    .identified = {},
    .parameters = coulomb_viscous_parameters,
    .general_law = [](std::span<const double> p) { return friction::GeneralLaw{.A = p[0], .F1 = p[1]}; },
    .conflict = nullptr};

}  // namespace

const friction::LawInfo& coulomb_viscous() { return coulomb_viscous_law; }

JointFriction::JointFriction(const friction::LawInfo& law, Scales scales) : law_(&law), scales_(scales), place_(law) {}

std::vector<std::string_view> JointFriction::reference_temperatures() const {
  std::vector<std::string_view> names;
  for (std::size_t field = 0; field < place_.nonlinear_used.size(); ++field)
    if (nonlinear_fields[place_.nonlinear_used[field]] == &friction::GeneralLaw::s_T0)
      for (Eigen::Index p = 0; p < size(); ++p)
        if (place_.nonlinear(static_cast<Eigen::Index>(field), p) != 0)
          names.push_back(law_->parameters[static_cast<std::size_t>(p)].name);
  return names;
}

double JointFriction::torque(std::span<const double> p, double speed, double load_nm, double temperature_degC,
                             double* derivatives) const {
  const double sign = std::copysign(scales_.torque, speed);
  const friction::Gradient at = friction::gradient(law_->general_law(p), std::abs(speed) * scales_.speed,
                                                   std::abs(load_nm) / scales_.torque_max_nm, temperature_degC);
  const double value = sign * at.torque;
  const bool has_offset = law_ == &coulomb_viscous_law;
  if (derivatives) {
    Eigen::Map<Eigen::VectorXd> out(derivatives, size());
    const Eigen::Map<const Eigen::Matrix<double, linear_count, 1>> terms(at.by_terms.data());
    const Eigen::Map<const Eigen::Matrix<double, nonlinear_count, 1>> shapes(at.by_shape_numbers.data());
    out = sign * (place_.linear.transpose() * terms(place_.linear_used) +
                  place_.nonlinear.transpose() * shapes(place_.nonlinear_used));
    if (has_offset) out(offset) = 1;
  }
  return has_offset ? value + p[offset] : value;
}

}  // namespace tribotwin::twin::identification
