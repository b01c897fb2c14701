#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/identifiability.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd;
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
  Fixing(const friction::LawInfo& law, Separable& problem, Estimates& result)
      : law_(law), problem_(problem), result_(result) {}

  void operator()(std::size_t parameter, double value) {
    if (!problem_.is_free(parameter)) return;
    const friction::Parameter& p = law_.parameters[parameter];
    problem_.hold(parameter, std::clamp(value, p.minimum, p.maximum));
    // Only linear parameters have a base, and those are fixed at an excess of 0.
    const std::size_t base = problem_.base_of(parameter);
    values_.push_back(base == Separable::npos ? fmt::format("{} = {:g}", p.name, problem_.held_value(parameter))
                                              : fmt::format("{} = {}", p.name, law_.parameters[base].name));
    result_.unidentifiable.emplace_back(p.name);
  }
  bool any() const { return !values_.empty(); }
  /// "FsT = 0, vsT = 0 are not identifiable ..."
  std::string names() const {
    return fmt::format("{} {} not identifiable", joined(values_), values_.size() > 1 ? "are" : "is");
  }

 private:
  const friction::LawInfo& law_;
  Separable& problem_;
  Estimates& result_;
  std::vector<std::string> values_;
};

/// Temperature terms where all samples have one temperature. Returns whether there were any.
bool fix_at_one_temperature(const friction::LawInfo& law, const Samples& samples, const Placement& place,
                            Separable& problem, Estimates& result) {
  const auto [low, high] = std::ranges::minmax(samples.temperature_degC);
  if (!law.temperature_dependent || high - low >= 1e-6 * (1 + std::abs(high))) return false;
  Fixing fix(law, problem, result);
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
  Fixing fix(law, problem, result);
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
  Fixing fix(law, problem, result);
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
  Fixing fix(law, problem, result);
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

bool moves_load_terms_only(const Placement& place, std::size_t parameter) {
  return (moves_term(place, parameter, [](const Term& t) { return t.load > 0; }) ||
          moves_number(place, parameter, [](const ShapeNumber& n) { return n.quantity == formula::load_velocity; })) &&
         !moves_term(place, parameter, [](const Term& t) { return t.load == 0; });
}

}  // namespace tribotwin::twin::identification
