#include <cmath>
#include <limits>
#include <utility>

#include <tribotwin/twin/identification/rigid_body/joint_friction.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index;

namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

constexpr friction::Parameter coulomb{"Fc", "Nm", -1e9, 1e9, none, none, "Coulomb friction, without load"},
    viscous{"Fv", "Nm s/rad", -1e9, 1e9, none, none, "viscous slope"},
    load{"Fcl", "Nm", -1e9, 1e9, none, none, "growth of Coulomb friction per load / torque_max"},
    stribeck{"Fs", "Nm", -1e9, 1e9, none, none, "excess over Fc near standstill"},
    stribeck_speed{"vs", "rad/s", 1e-9, 1e9, none, none, "speed in which the excess falls to 37 %; held"};
constexpr friction::Parameter coulomb_viscous_parameters[] = {coulomb, viscous},
                              load_parameters[] = {coulomb, viscous, load},
                              stribeck_parameters[] = {coulomb, viscous, stribeck, stribeck_speed},
                              load_stribeck_parameters[] = {coulomb, viscous, load, stribeck, stribeck_speed};
constexpr friction::Parameter offset_parameter{
    offset_name, "Nm", -1e9, 1e9, none, none, "of the torque, whatever the speed"};
constexpr friction::Parameter asymmetry_parameter{
    asymmetry_name,
    "1",
    -0.99,
    0.99,
    none,
    none,
    "half the difference of forward and reverse friction per mean of both"};
constexpr friction::Parameter cosine_parameter{
    cosine_name, "Nm", -1e9, 1e9, none, none, "of the torque by the cosine of the angle"},
    sine_parameter{sine_name, "Nm", -1e9, 1e9, none, none, "of the torque by the sine of the angle"};

using Numbers = std::span<const double>;

constexpr friction::LawInfo linear_law(std::string_view name, std::string_view equation, std::string_view source,
                                       std::span<const friction::Parameter> parameters,
                                       friction::GeneralLaw (*general_law)(Numbers), bool load_dependent) {
  return {.name = name,
          .equation = equation,
          .source = source,
          .side = friction::Side::arm,
          .normalised = false,
          .temperature_dependent = false,
          .load_dependent = load_dependent,
          .identified = {},
          .parameters = parameters,
          .general_law = general_law,
          .conflict = nullptr};
}

constexpr friction::LawInfo coulomb_viscous_law = linear_law(
    "coulomb_viscous", "Fc sgn v + Fv v", "Hao 2021", coulomb_viscous_parameters,
    [](Numbers p) { return friction::GeneralLaw{.A = p[0], .F1 = p[1]}; }, false);
constexpr friction::LawInfo coulomb_viscous_load_law = linear_law(
    "coulomb_viscous_load", "(Fc + Fcl l) sgn v + Fv v", "Hao 2021 with the load term of Bittencourt 2012 (M1)",
    load_parameters, [](Numbers p) { return friction::GeneralLaw{.A = p[0], .A_l = p[2], .F1 = p[1]}; }, true);
constexpr friction::LawInfo coulomb_viscous_stribeck_law = linear_law(
    "coulomb_viscous_stribeck", "(Fc + Fs e^-|v/vs|) sgn v + Fv v", "Bittencourt 2012 (M0) with alpha = 1 and vs held",
    stribeck_parameters, [](Numbers p) { return friction::GeneralLaw{.A = p[0], .B = p[2], .vs = p[3], .F1 = p[1]}; },
    false);
constexpr friction::LawInfo coulomb_viscous_load_stribeck_law = linear_law(
    "coulomb_viscous_load_stribeck", "(Fc + Fcl l + Fs e^-|v/vs|) sgn v + Fv v",
    "Bittencourt 2012 (M1) with Fsl = 0, alpha = 1 and vs held", load_stribeck_parameters,
    [](Numbers p) { return friction::GeneralLaw{.A = p[0], .A_l = p[2], .B = p[3], .vs = p[4], .F1 = p[1]}; }, true);
/// Each beside the law that it extends.
constexpr std::pair<const friction::LawInfo*, const friction::LawInfo*> extended_by_stribeck[] = {
    {&coulomb_viscous_law, &coulomb_viscous_stribeck_law},
    {&coulomb_viscous_load_law, &coulomb_viscous_load_stribeck_law}};

/// What jumps where the direction changes: terms that are not 0 at standstill. The number that a shape depends on goes
/// with it; the scale is of all.
enum class Term { standstill, moving, both };

constexpr Term term_of(friction::formula::Shape shape) {
  return friction::formula::shape_infos[shape].at_rest != 0 ? Term::standstill : Term::moving;
}

constexpr Term term_of(friction::formula::Quantity quantity) {
  using namespace friction::formula;
  if (quantity == scale_slope || quantity == scale_reference) return Term::both;
  for (int shape = 0; shape < shape_count; ++shape)
    for (int k = 0; k < shape_infos[shape].slope_count; ++k)
      if (shape_infos[shape].slopes[k] == quantity) return term_of(static_cast<Shape>(shape));
  return Term::moving;  // the Vogel scale, of viscous terms
}

using Terms = Eigen::Matrix<double, linear_count, 1>;
using Shapes = Eigen::Matrix<double, nonlinear_count, 1>;

}  // namespace

const friction::LawInfo& coulomb_viscous() { return coulomb_viscous_law; }
const friction::LawInfo& coulomb_viscous_load() { return coulomb_viscous_load_law; }
const friction::LawInfo& coulomb_viscous_stribeck() { return coulomb_viscous_stribeck_law; }
const friction::LawInfo& coulomb_viscous_load_stribeck() { return coulomb_viscous_load_stribeck_law; }

const friction::LawInfo* with_stribeck(const friction::LawInfo& law) {
  for (const auto& [plain, extended] : extended_by_stribeck)
    if (&law == plain || &law == extended) return extended;
  return nullptr;
}

const friction::LawInfo* with_load(const friction::LawInfo& law) {
  if (&law == &coulomb_viscous_law || &law == &coulomb_viscous_load_law) return &coulomb_viscous_load_law;
  return with_stribeck(law) == &law ? &coulomb_viscous_load_stribeck_law : nullptr;
}

JointFriction::JointFriction(const friction::LawInfo& law, Scales scales, Directional directional)
    : law_(&law), scales_(scales), directional_(directional), place_(law) {}

bool JointFriction::is_linear(const friction::LawInfo& law) { return with_stribeck(law) != nullptr; }

std::optional<double> JointFriction::held(Index index) const {
  if (index < law_size() && &law_->parameters[static_cast<std::size_t>(index)] == &law_->parameters.back() &&
      with_stribeck(*law_) == law_)
    return stribeck_speed_;
  return std::nullopt;
}

const friction::Parameter& JointFriction::parameter(Index index) const {
  if (index < law_size()) return law_->parameters[static_cast<std::size_t>(index)];
  if (directional_.position && index >= size() - 2) return index == size() - 1 ? sine_parameter : cosine_parameter;
  return directional_.offset && index == law_size() ? offset_parameter : asymmetry_parameter;
}

std::vector<std::string_view> JointFriction::reference_temperatures() const {
  std::vector<std::string_view> names;
  for (std::size_t field = 0; field < place_.nonlinear_used.size(); ++field)
    if (nonlinear_fields[place_.nonlinear_used[field]] == &friction::GeneralLaw::s_T0)
      for (Eigen::Index p = 0; p < law_size(); ++p)
        if (place_.nonlinear(static_cast<Eigen::Index>(field), p) != 0)
          names.push_back(law_->parameters[static_cast<std::size_t>(p)].name);
  return names;
}

double JointFriction::filtered_torque(std::span<const double> p, double speed, double direction, double load_nm,
                                      double temperature_degC, double* derivatives) const {
  const auto own = static_cast<std::size_t>(law_size());
  const double offset = directional_.offset ? p[own] : 0,
               asymmetry = directional_.asymmetry ? p[own + directional_.offset] : 0;
  const double turning = scales_.torque * (direction + asymmetry),
               moving = scales_.torque * (std::copysign(1, speed) + asymmetry);
  const friction::GeneralLaw law = law_->general_law(p.first(own));
  const friction::Gradient at = friction::gradient(law, std::abs(speed) * scales_.speed,
                                                   std::abs(load_nm) / scales_.torque_max_nm, temperature_degC);
  Terms terms;
  double torque = 0;
  for (std::size_t k = 0; k < linear_count; ++k) {
    const double by = at.by_terms[k];
    terms(static_cast<Index>(k)) =
        by * (term_of(friction::formula::terms[k].shape) == Term::standstill ? turning : moving);
    torque += law.*linear_fields[k] * terms(static_cast<Index>(k));
  }
  if (derivatives) {
    Shapes shapes;
    for (std::size_t n = 0; n < nonlinear_count; ++n) {
      const Term part = term_of(friction::formula::shape_numbers[n].quantity);
      const double both = at.torque == 0 ? moving : torque / at.torque;
      shapes(static_cast<Index>(n)) = at.by_shape_numbers[n] * (part == Term::both         ? both
                                                                : part == Term::standstill ? turning
                                                                                           : moving);
    }
    Eigen::Map<Eigen::VectorXd>(derivatives, law_size()) = place_.linear.transpose() * terms(place_.linear_used) +
                                                           place_.nonlinear.transpose() * shapes(place_.nonlinear_used);
    if (directional_.offset) derivatives[own] = 1;
    if (directional_.asymmetry) derivatives[own + directional_.offset] = scales_.torque * at.torque;
  }
  return torque + offset;
}

double JointFriction::position_torque(std::span<const double> p, double angle_rad, double* derivatives) const {
  if (!directional_.position) return 0;
  const double by_cosine = std::cos(angle_rad), by_sine = std::sin(angle_rad);
  if (derivatives) derivatives[cosine_at()] = by_cosine, derivatives[cosine_at() + 1] = by_sine;
  return p[cosine_at()] * by_cosine + p[cosine_at() + 1] * by_sine;
}

}  // namespace tribotwin::twin::identification
