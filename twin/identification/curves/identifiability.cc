#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/direction.hpp>
#include <tribotwin/twin/identification/curves/identifiability.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using friction::formula::ShapeNumber, friction::formula::Term;
namespace formula = friction::formula;

/// Whether a parameter moves a term, or a shape number, that `is` accepts.
template <class Predicate>
bool moves_term(const Placement& place, std::size_t parameter, Predicate is) {
  for (std::size_t k = 0; k < place.linear_used.size(); ++k)
    if (place.linear(static_cast<Index>(k), static_cast<Index>(parameter)) != 0 &&
        is(formula::terms[place.linear_used[k]]))
      return true;
  return false;
}
template <class Predicate>
bool moves_number(const Placement& place, std::size_t parameter, Predicate is) {
  for (std::size_t n = 0; n < place.nonlinear_used.size(); ++n)
    if (place.nonlinear(static_cast<Index>(n), static_cast<Index>(parameter)) != 0 &&
        is(formula::shape_numbers[place.nonlinear_used[n]]))
      return true;
  return false;
}

/// Whether the law has the same term without its factor of temperature, which stays when T does not vary.
bool has_cold_term(const Placement& place, const Term& term) {
  return std::ranges::any_of(place.linear_used, [&](std::size_t k) {
    const Term& other = formula::terms[k];
    return other.shape == term.shape && other.load == term.load && other.heat == formula::cold;
  });
}

double published_or(const friction::Parameter& p, double otherwise) {
  return std::isnan(p.published) ? otherwise : p.published;
}

/// Fixes parameters one by one and keeps their names for one note.
class Fixing {
 public:
  Fixing(const friction::LawInfo& law, Separable& problem) : law_(law), problem_(problem) {}

  void operator()(std::size_t parameter, double value) {
    if (!problem_.is_free(parameter)) return;
    const friction::Parameter& p = law_.parameters[parameter];
    problem_.hold(parameter, std::clamp(value, p.minimum, p.maximum));
    // Only linear parameters have a base, and those are fixed at an excess of 0.
    const std::size_t base = problem_.base_of(parameter);
    values_.push_back(base == Separable::npos ? fmt::format("{} = {:g}", p.name, problem_.held_value(parameter))
                                              : fmt::format("{} = {}", p.name, law_.parameters[base].name));
  }
  bool any() const { return !values_.empty(); }
  /// "FsT = 0, vsT = 0 are not identifiable ..."
  std::string names() const {
    return fmt::format("{} {} not identifiable", joined(values_), values_.size() > 1 ? "are" : "is");
  }

 private:
  const friction::LawInfo& law_;
  Separable& problem_;
  std::vector<std::string> values_;
};

/// Temperature terms where all samples have one temperature. Returns whether there were any.
bool fix_at_one_temperature(const friction::LawInfo& law, const Samples& samples, const Placement& place,
                            Separable& problem, Estimates& result) {
  const auto [low, high] = std::ranges::minmax(samples.temperature_degC);
  if (!law.temperature_dependent || high - low >= 1e-6 * (1 + std::abs(high))) return false;
  Fixing fix(law, problem);
  for (std::size_t i = 0; i < law.parameters.size(); ++i) {
    const bool warm_term =
        moves_term(place, i, [&](const Term& t) { return t.heat != formula::cold && has_cold_term(place, t); });
    const bool warm_number =
        moves_number(place, i, [](const ShapeNumber& n) { return n.degree > 0 || n.quantity == formula::scale_slope; });
    if (warm_term || warm_number)
      fix(i, 0);
    else if (moves_number(place, i, [](const ShapeNumber& n) { return n.quantity == formula::vogel_scale; }))
      fix(i, published_or(law.parameters[i], 20));
  }
  if (fix.any())
    result.notes.push_back(
        fmt::format("all samples are at {:.6g} degC: {} and fixed; the other parameters are those at this temperature",
                    low, fix.names()));
  return fix.any();
}

/// Curvatures over temperature where all temperatures lie within a twentieth of either end of their range.
void fix_curvatures(const friction::LawInfo& law, const Samples& samples, const Placement& place, Separable& problem,
                    Estimates& result) {
  const auto [low, high] = std::ranges::minmax(samples.temperature_degC);
  const double end = 0.05 * (high - low);
  if (!law.temperature_dependent || std::ranges::any_of(samples.temperature_degC, [&, a = low, b = high](double T) {
        return T > a + end && T < b - end;
      }))
    return;
  Fixing fix(law, problem);
  for (std::size_t i = 0; i < law.parameters.size(); ++i)
    if (moves_term(place, i, [](const Term& t) { return t.heat == formula::per_square_degree; }) ||
        moves_number(place, i, [](const ShapeNumber& n) { return n.degree == 2; }))
      fix(i, 0);
  if (fix.any())
    result.notes.push_back(
        fmt::format("all samples are near {:.4g} or {:.4g} degC: {} and fixed; record a third temperature", low, high,
                    fix.names()));
}

/// All but the level and its dependence on temperature and load where all samples have one speed.
void fix_at_one_speed(const friction::LawInfo& law, const Samples& samples, const Placement& place, Separable& problem,
                      Estimates& result) {
  if (std::ranges::any_of(samples.speed, [&](double v) { return v != samples.speed.front(); })) return;
  Fixing fix(law, problem);
  for (std::size_t i = 0; i < law.parameters.size(); ++i)
    if (!moves_term(place, i, [](const Term& t) { return t.shape == formula::constant; }) &&
        !moves_number(place, i, [](const ShapeNumber& n) {
          return n.quantity == formula::scale_slope || n.quantity == formula::scale_reference;
        }))
      fix(i, place.is_linear(i) ? 0 : published_or(law.parameters[i], 1));
  if (fix.any())
    result.notes.push_back(
        fmt::format("all samples are at {:.6g} rad/s: {} and fixed; record several speeds on both sides of the minimum "
                    "of friction",
                    samples.speed.front(), fix.names()));
}

}  // namespace

void fix_without_variation(const friction::LawInfo& law, const Samples& samples, Separable& problem,
                           Estimates& result) {
  const Placement place(law);
  if (!fix_at_one_temperature(law, samples, place, problem, result))
    fix_curvatures(law, samples, place, problem, result);
  const auto [low, high] = std::ranges::minmax(samples.load);
  Fixing fix(law, problem);
  if (law.load_dependent && high - low < 1e-9)
    for (std::size_t i = 0; i < law.parameters.size(); ++i) {
      if (moves_term(place, i, [](const Term& t) { return t.load > 0; }))
        fix(i, 0);
      else if (moves_number(place, i, [](const ShapeNumber& n) { return n.quantity == formula::load_velocity; }))
        fix(i, published_or(law.parameters[i], 0.1 * std::ranges::max(samples.speed)));
    }
  fix_at_one_speed(law, samples, place, problem, result);
  if (fix.any())
    result.notes.push_back(fmt::format(
        "all samples are at load {:.6g}: {} and fixed; the other parameters are those at this load", low, fix.names()));
}

std::vector<std::size_t> by_rank(const Placement& place) {
  std::vector<std::size_t> order(static_cast<std::size_t>(place.linear.cols()));
  std::vector<int> rank(order.size(), 100);
  for (std::size_t i = 0; i < order.size(); ++i) {
    order[i] = i;
    const auto lower = [&](const auto& row) {
      rank[i] = std::min(rank[i], row.rank);
      return false;
    };
    // A parameter that moves a shape number has the rank of that number, even if it also moves terms.
    if (place.is_linear(i))
      moves_term(place, i, lower);
    else
      moves_number(place, i, lower);
  }
  std::ranges::stable_sort(order, {}, [&](std::size_t i) { return rank[i]; });
  return order;
}

std::size_t dependent_parameter(const friction::LawInfo& law, const Separable& problem, const Point& point) {
  std::vector<std::size_t> coordinates;
  const MatrixXd H = problem.information(point, coordinates);
  if (coordinates.empty()) return Separable::npos;
  const Placement& place = problem.place();
  std::vector<std::size_t> order;  // places in `coordinates`
  for (const std::size_t parameter : by_rank(place))
    if (const auto found = std::ranges::find(coordinates, parameter); found != coordinates.end())
      order.push_back(static_cast<std::size_t>(found - coordinates.begin()));
  // Cholesky in this order: a pivot that vanishes belongs to a column in the span of those before it.
  const double largest = H.diagonal().maxCoeff();
  MatrixXd L = MatrixXd::Zero(H.rows(), H.cols());
  for (std::size_t a = 0; a < order.size(); ++a) {
    const auto i = static_cast<Index>(order[a]), row = static_cast<Index>(a);
    const double own = H(i, i);
    const auto& p = law.parameters[coordinates[order[a]]];
    // Nonlinear parameters: an effect of the whole accepted range below rounding is no effect.
    if (!(own > 0) ||
        (!place.is_linear(coordinates[order[a]]) &&
         own * std::pow(std::min(p.maximum, 1e3), 2) < 1e-22 * point.moments.yy) ||
        own < 1e-300 * largest)
      return coordinates[order[a]];
    double pivot = own;
    for (Index c = 0; c < row; ++c) {
      double sum = H(i, static_cast<Index>(order[static_cast<std::size_t>(c)]));
      for (Index k = 0; k < c; ++k) sum -= L(row, k) * L(c, k);
      L(row, c) = sum / L(c, c);
      pivot -= L(row, c) * L(row, c);
    }
    if (pivot < 1e-11 * own) return coordinates[order[a]];
    L(row, row) = std::sqrt(pivot);
  }
  return Separable::npos;
}

namespace {

/// 0.1 of friction: a term of which less is uncertain is known, also where it may be 0.
constexpr double known_share = 0.1;

double rms(std::span<const double> x) {
  double squares = 0;
  for (const double v : x) squares += v * v;
  return std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, x.size())));
}

/// Root mean square over the samples of what one unit of a term adds; of terms that fade with speed at standstill, as
/// samples beyond their speeds say nothing of their size.
double effect_of(const Term& term, const friction::GeneralLaw& law, const Samples& s) {
  std::vector<double> effect;
  for (std::size_t i = 0; i < s.size(); ++i) {
    const double T = s.temperature_degC[i], load = term.load ? s.load[i] : 1;
    const double heat = term.heat == formula::cold                ? 1
                        : term.heat == formula::per_degree        ? T
                        : term.heat == formula::per_square_degree ? T * T
                                                                  : std::exp(-T / law.T_V);
    const auto& shape = formula::shape_infos[term.shape];
    const double exponent = term.shape == formula::power ? law.beta + law.beta_T * T : shape.degree;
    effect.push_back(load * heat * (shape.weakening ? 1 : std::pow(s.speed[i], exponent)));
  }
  return rms(effect);
}

/// Of a coefficient of vs(T) or beta(T): the quantity per unit of the coefficient, root mean squares.
double quantity_scale(const ShapeNumber& number, const friction::GeneralLaw& law, const Samples& s) {
  std::vector<double> whole, power;
  for (const double T : s.temperature_degC) {
    double sum = 0;
    for (const auto& n : formula::shape_numbers)
      if (n.quantity == number.quantity) sum += law.*n.number * std::pow(T, n.degree);
    whole.push_back(sum), power.push_back(std::pow(T, number.degree));
  }
  return rms(whole) / std::max(1e-300, rms(power));
}

/// What the interval of a parameter that may be 0 is compared with beside its value.
double scale_of(const Placement& place, std::size_t parameter, const friction::GeneralLaw& law, const Samples& s) {
  double scale = 0;
  if (place.is_linear(parameter)) {
    double effect = 0;
    moves_term(place, parameter, [&](const Term& t) {
      effect = std::max(effect, effect_of(t, law, s));
      return false;
    });
    scale = rms(s.friction) / std::max(1e-300, effect);
  } else {
    moves_number(place, parameter, [&](const ShapeNumber& n) {
      if (n.quantity == formula::stribeck_velocity || n.quantity == formula::power_exponent)
        scale = std::max(scale, quantity_scale(n, law, s));
      return false;
    });
  }
  return known_share * scale;
}

/// Which polynomial in T a parameter belongs to; -1: none.
int polynomial_of(const Placement& place, std::size_t parameter) {
  int which = -1;
  if (place.is_linear(parameter))
    moves_term(place, parameter, [&](const Term& t) {
      if (t.load == 0 && t.heat != formula::vogel && which < 0) which = t.shape;
      return false;
    });
  else
    moves_number(place, parameter, [&](const ShapeNumber& n) {
      which = static_cast<int>(formula::shape_count) + static_cast<int>(n.quantity);
      return false;
    });
  return which;
}

/// "a wider range of temperatures than 38 .. 41 degC", "another temperature than 50 degC".
std::string wider(const std::vector<double>& values, std::string_view one, std::string_view unit) {
  const auto [low, high] = std::ranges::minmax(values);
  if (high - low < 1e-6 * (1 + std::abs(high))) return fmt::format("another {} than {:.4g}{}", one, low, unit);
  return fmt::format("a wider range of {}s than {:.4g} .. {:.4g}{}", one, low, high, unit);
}

/// What to record for a parameter of the law.
std::string next_of(const Placement& place, std::size_t parameter, const Samples& s, Lack lack, std::string_view unit) {
  const auto moves = [&](auto of_term, auto of_number) {
    return moves_term(place, parameter, of_term) || moves_number(place, parameter, of_number);
  };
  const auto [slowest, fastest] = std::ranges::minmax(s.speed);
  const bool fades =
      moves([](const Term& t) { return t.shape == formula::stribeck || t.shape == formula::load_stribeck; },
            [](const ShapeNumber& n) {
              return n.quantity == formula::stribeck_velocity || n.quantity == formula::load_velocity ||
                     n.quantity == formula::stribeck_exponent;
            });
  const bool level =
      moves([](const Term& t) { return t.shape == formula::constant; }, [](const ShapeNumber&) { return false; });
  const bool grows = moves([](const Term& t) { return !formula::shape_infos[t.shape].weakening; },
                           [](const ShapeNumber& n) { return n.quantity == formula::power_exponent; });
  const bool heat =
      moves([](const Term& t) { return t.heat != formula::cold; },
            [](const ShapeNumber& n) {
              return n.degree > 0 || n.quantity == formula::vogel_scale || n.quantity == formula::scale_slope;
            });
  const bool load = moves([](const Term& t) { return t.load > 0; },
                          [](const ShapeNumber& n) { return n.quantity == formula::load_velocity; });
  std::vector<std::string> all;
  if (heat && lack == Lack::correlated) return "record " + wider(s.temperature_degC, "temperature", " degC");
  if (fades && !level) all.push_back(fmt::format("speeds below {:.3g} {}", slowest, unit));
  if (grows) all.push_back(fmt::format("speeds above {:.3g} {}", fastest, unit));
  if (heat) all.push_back(wider(s.temperature_degC, "temperature", " degC"));
  if (load) all.push_back(wider(s.load, "load", ""));
  if (all.empty()) all.push_back(fmt::format("speeds below {:.3g} and above {:.3g} {}", slowest, fastest, unit));
  return "record " + joined(all, " and ");
}

}  // namespace

std::vector<std::string> unseen_terms(const Separable& problem, const Point& point,
                                      const std::vector<std::size_t>& coordinates, double samples, double noise) {
  const Placement& place = problem.place();
  const auto fades = [](const Term& t) { return t.shape == formula::stribeck || t.shape == formula::load_stribeck; };
  std::vector<std::string> unseen(static_cast<std::size_t>(place.linear.cols()));
  std::vector<Index> stay;
  for (std::size_t k = 0; k < place.linear_used.size(); ++k)
    if (!fades(formula::terms[place.linear_used[k]])) stay.push_back(static_cast<Index>(k));
  if (stay.size() == place.linear_used.size()) return unseen;
  const auto of_fading = [&](std::size_t i) {
    const bool stays = moves_term(place, i, [&](const Term& t) { return !fades(t); }) ||
                       moves_number(place, i, [](const ShapeNumber& n) {
                         return n.quantity != formula::stribeck_velocity && n.quantity != formula::load_velocity &&
                                n.quantity != formula::stribeck_exponent;
                       });
    return !stays && (moves_term(place, i, fades) || !place.is_linear(i));
  };
  const auto moved = static_cast<double>(
      std::ranges::count_if(coordinates, [&](std::size_t c) { return c < unseen.size() && of_fading(c); }));
  const auto free = static_cast<double>(coordinates.size());
  if (moved == 0 || samples <= free) return unseen;
  const MatrixXd FF = point.moments.FF(stay, stay);
  const VectorXd Fy = point.moments.Fy(stay);
  const double without = std::max(0.0, point.moments.yy - Fy.dot(pseudo_inverse(FF) * Fy));
  const double F = (without - point.cost) / moved / (noise * point.cost / (samples - free));
  if (!(point.cost > 1e-20 * point.moments.yy) || fisher_f_above(moved, samples - free, std::max(0.0, F)) < 1e-3)
    return unseen;
  for (std::size_t i = 0; i < unseen.size(); ++i)
    if (of_fading(i)) unseen[i] = "without the term that fades with speed the law fits these data as well";
  return unseen;
}

std::vector<Lacking> lacking_of(const friction::LawInfo& law, const Samples& samples, const Estimates& estimates,
                                const std::optional<Misfit>& misfit, std::vector<std::string> unseen, LawUnits units) {
  const Placement place(law);
  std::vector<double> values;
  for (std::size_t i = 0; i < law.parameters.size(); ++i) values.push_back(estimates.parameters[i].value);
  const friction::GeneralLaw general = law.general_law(values);
  Evidence evidence{.parameters = estimates.parameters, .covariance = estimates.covariance};
  for (std::size_t i = 0; i < law.parameters.size(); ++i) {
    const bool may_be_0 = law.parameters[i].minimum < 0 || place.is_linear(i);
    const double own = std::abs(values[i]);
    evidence.scale.push_back(may_be_0 ? std::max(own, scale_of(place, i, general, samples)) : own);
    evidence.polynomial.push_back(polynomial_of(place, i));
  }
  // Asymmetry is a share of friction; an offset is compared with friction.
  for (std::size_t i = law.parameters.size(); i < estimates.parameters.size(); ++i) {
    const auto& e = estimates.parameters[i];
    const double whole = e.name == asymmetry_name ? 1 : units.offset_per_torque * rms(samples.friction);
    evidence.scale.push_back(std::max(std::abs(e.value), known_share * whole));
    evidence.polynomial.push_back(-1);
  }
  evidence.explained = estimates.r_squared;
  if (misfit) evidence.common = misfit->share, evidence.along = misfit->along;
  if (!unseen.empty()) unseen.resize(estimates.parameters.size());
  evidence.unseen = std::move(unseen);
  return lacking(evidence, [&](const Estimate& e, Lack lack) -> std::string {
    if (lack == Lack::structured) return "compare other laws with --law A,B";
    const auto own = std::ranges::find(law.parameters, e.name, &friction::Parameter::name);
    if (own == law.parameters.end()) return "record more of both directions, at speeds where friction differs";
    const auto i = static_cast<std::size_t>(own - law.parameters.begin());
    const std::string next = next_of(place, i, samples, lack, units.speed);
    return lack == Lack::at_bound ? next + ", or fix it" : next;
  });
}

bool moves_load_terms_only(const Placement& place, std::size_t parameter) {
  return (moves_term(place, parameter, [](const Term& t) { return t.load > 0; }) ||
          moves_number(place, parameter, [](const ShapeNumber& n) { return n.quantity == formula::load_velocity; })) &&
         !moves_term(place, parameter, [](const Term& t) { return t.load == 0; });
}

}  // namespace tribotwin::twin::identification
