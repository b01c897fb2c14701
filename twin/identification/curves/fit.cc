#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include <boost/math/tools/minima.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/curves/separable.hpp>
#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using F = friction::GeneralLaw;
constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

std::vector<double> weights_of(const Samples& samples, const FitOptions& options) {
  std::vector<double> w;
  if (!options.weigh || samples.standard_error.empty()) return w;
  for (const double e : samples.standard_error) w.push_back(1 / (e * e));
  // Only their ratios matter; around 1 they keep the sums well scaled.
  const double mean = std::accumulate(w.begin(), w.end(), 0.0) / static_cast<double>(w.size());
  for (double& x : w) x /= mean;
  return w;
}

/// Which parameters move a field.
bool moves(const Placement& place, std::size_t parameter, std::initializer_list<double F::*> fields) {
  const auto i = static_cast<Index>(parameter);
  for (const auto field : fields) {
    for (std::size_t k = 0; k < place.linear_used.size(); ++k)
      if (linear_fields[place.linear_used[k]] == field && place.linear(static_cast<Index>(k), i) != 0) return true;
    for (std::size_t n = 0; n < place.nonlinear_used.size(); ++n)
      if (nonlinear_fields[place.nonlinear_used[n]] == field && place.nonlinear(static_cast<Index>(n), i) != 0)
        return true;
  }
  return false;
}

double published_or(const friction::Parameter& p, double otherwise) {
  return std::isnan(p.published) ? otherwise : p.published;
}

/// Holds what the inputs cannot move at all: temperature terms at one temperature, load terms at one load.
void hold_what_does_not_vary(const friction::LawInfo& law, const Samples& samples, Separable& problem, Fit& result) {
  const auto [t_low, t_high] = std::ranges::minmax(samples.temperature_degC);
  const auto [l_low, l_high] = std::ranges::minmax(samples.load);
  const Placement place(law);
  const auto hold = [&](std::size_t i, double value, std::vector<std::string_view>& names) {
    if (!problem.is_free(i)) return;
    problem.hold(i, std::clamp(value, law.parameters[i].minimum, law.parameters[i].maximum));
    names.push_back(law.parameters[i].name);
    result.unidentifiable.emplace_back(law.parameters[i].name);
  };
  std::vector<std::string_view> thermal, loaded;
  if (law.temperature_dependent && t_high - t_low < 1e-6 * (1 + std::abs(t_high)))
    for (std::size_t i = 0; i < law.parameters.size(); ++i) {
      // Fs - Fc may be the only thing that carries FcT: held at 0 all the same.
      if (moves(place, i,
                {&F::A_T, &F::A_TT, &F::B_T, &F::B_TT, &F::vs_T, &F::vs_TT, &F::F1_t, &F::F1_tt, &F::F1_T, &F::beta_T,
                 &F::s_T})) {
        hold(i, 0, thermal);
      } else if (moves(place, i, {&F::T_V})) {
        hold(i, published_or(law.parameters[i], 20), thermal);
      }
    }
  if (!thermal.empty())
    result.notes.push_back(
        fmt::format("all samples are at {:.6g} degC: {} cannot be told and are held; the other parameters are those at "
                    "this temperature",
                    t_low, fmt::join(thermal, ", ")));
  // Temperatures within a twentieth of either end of their range say nothing of curvature.
  const double end = 0.05 * (t_high - t_low);
  if (law.temperature_dependent && thermal.empty() &&
      std::ranges::none_of(samples.temperature_degC, [&](double T) { return T > t_low + end && T < t_high - end; })) {
    std::vector<std::string_view> curved;
    for (std::size_t i = 0; i < law.parameters.size(); ++i)
      if (moves(place, i, {&F::A_TT, &F::B_TT, &F::vs_TT, &F::F1_tt})) hold(i, 0, curved);
    if (!curved.empty())
      result.notes.push_back(fmt::format(
          "all samples are near {:.4g} or {:.4g} degC: {} cannot be told and are held; a third temperature would tell",
          t_low, t_high, fmt::join(curved, ", ")));
  }
  if (law.load_dependent && l_high - l_low < 1e-9)
    for (std::size_t i = 0; i < law.parameters.size(); ++i) {
      if (moves(place, i, {&F::A_l, &F::C_l}) || (moves(place, i, {&F::B_l}) && !moves(place, i, {&F::A})))
        hold(i, 0, loaded);
      else if (moves(place, i, {&F::vl}))
        hold(i, published_or(law.parameters[i], 0.1 * std::ranges::max(samples.speed)), loaded);
    }
  if (std::ranges::all_of(samples.speed, [&](double v) { return v == samples.speed.front(); })) {
    std::vector<std::string_view> shape;
    for (std::size_t i = 0; i < law.parameters.size(); ++i)
      if (!moves(place, i, {&F::A, &F::A_T, &F::A_TT, &F::A_l, &F::s_T, &F::s_T0}))
        hold(i, place.is_linear(i) ? 0 : published_or(law.parameters[i], 1), shape);
    if (!shape.empty())
      result.notes.push_back(
          fmt::format("all samples are at {:.6g} rad/s: {} cannot be told and are held; record several speeds on both "
                      "sides of the minimum of friction",
                      samples.speed.front(), fmt::join(shape, ", ")));
  }
  if (!loaded.empty())
    result.notes.push_back(fmt::format(
        "all samples are at load {:.6g}: {} cannot be told and are held; the other parameters are those at this load",
        l_low, fmt::join(loaded, ", ")));
}

/// Which parameter stays when one of two must go: constant terms before slopes before curvatures, linear before
/// nonlinear ones.
int precedence(const Placement& place, std::size_t i) {
  if (!place.is_linear(i))
    return moves(place, i, {&F::vs_TT})             ? 23
           : moves(place, i, {&F::vs, &F::vl})      ? 20
           : moves(place, i, {&F::alpha, &F::beta}) ? 21
                                                    : 22;
  if (moves(place, i, {&F::A_TT, &F::B_TT, &F::F1_tt})) return 7;
  return moves(place, i, {&F::A})                      ? 0
         : moves(place, i, {&F::A_l})                  ? 1
         : moves(place, i, {&F::A_T})                  ? 2
         : moves(place, i, {&F::F1, &F::Fb, &F::Fb_T}) ? 3
         : moves(place, i, {&F::B})                    ? 4
         : moves(place, i, {&F::C_l, &F::B_l})         ? 5
                                                       : 6;
}

/// A free parameter that the others can stand in for, or that has no effect; npos when there is none.
std::size_t dependent_parameter(const friction::LawInfo& law, const Separable& problem, const Point& point) {
  std::vector<std::size_t> coordinates;
  const MatrixXd H = problem.information(point, coordinates);
  if (coordinates.empty()) return Separable::npos;
  const Placement& place = problem.place();
  const auto rank = [&](std::size_t i) { return precedence(place, i); };
  std::vector<std::size_t> order(coordinates.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::stable_sort(order, {}, [&](std::size_t i) { return rank(coordinates[i]); });
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

double robust_scale(const std::vector<double>& r, const std::vector<double>& base) {
  std::vector<double> magnitude(r.size());
  for (std::size_t i = 0; i < r.size(); ++i) magnitude[i] = std::abs(r[i]) * (base.empty() ? 1 : std::sqrt(base[i]));
  return 1.4826 * median_of(std::move(magnitude));
}

constexpr double huber_at = 1.345, cauchy_at = 2.385;
double loss_weight(Loss loss, double u) {
  return loss == Loss::huber ? (std::abs(u) <= huber_at ? 1 : huber_at / std::abs(u))
                             : 1 / (1 + std::pow(u / cauchy_at, 2));
}
double loss_curvature(Loss loss, double u) {
  if (loss == Loss::huber) return std::abs(u) <= huber_at;
  const double q = std::pow(u / cauchy_at, 2);
  return (1 - q) / std::pow(1 + q, 2);
}

/// Iteratively reweighted: each round is a weighted fit from where the last one ended.
Point robust_minimum(const Samples& samples, const std::vector<double>& base, Loss loss, Separable& problem,
                     Point point, unsigned threads) {
  for (const Loss now : loss == Loss::cauchy ? std::vector{Loss::huber, Loss::cauchy} : std::vector{loss})
    for (int round = 0; round < 40; ++round) {
      const auto r = residuals(samples, problem.place(), point.family, threads);
      const double scale = robust_scale(r, base);
      if (!(scale > 0)) return point;  // more than half of the samples are on the curve
      std::vector<double> w(r.size());
      for (std::size_t i = 0; i < r.size(); ++i) {
        const double b = base.empty() ? 1 : base[i];
        w[i] = b * loss_weight(now, r[i] * std::sqrt(b) / scale);
      }
      problem.set_weights(std::move(w));
      const Point next = round == 0 ? problem.minimise() : problem.refine(point.values);
      const double change =
          (next.values - point.values).cwiseAbs().cwiseQuotient(next.values.cwiseAbs().cwiseMax(1e-12)).maxCoeff();
      point = next;
      if (round > 0 && change < 1e-7) break;
    }
  return point;
}

void describe_residuals(const Samples& samples, const std::vector<double>& r, const std::vector<double>& base,
                        const FitOptions& options, Fit& result) {
  const auto n = static_cast<double>(r.size());
  const double mean = std::reduce(r.begin(), r.end()) / n;
  double squares = 0;
  for (const double x : r)
    squares += (x - mean) * (x - mean), result.residual.max_abs = std::max(result.residual.max_abs, std::abs(x));
  result.residual.mean = mean;
  result.residual.std = std::sqrt(squares / n);
  const double scale = robust_scale(r, base);
  std::size_t far = 0;
  for (std::size_t i = 0; i < r.size(); ++i)
    far += std::abs(r[i]) * (base.empty() ? 1 : std::sqrt(base[i])) > 5 * scale;
  if (scale > 1e-9 * result.residual.max_abs && static_cast<double>(far) > 0.005 * n + 1)
    result.notes.push_back(
        options.loss == Loss::squares
            ? fmt::format("{:.1f} % of the samples lie more than 5 sigma off the curve: outliers pull at this fit; a "
                          "robust loss (--robust cauchy) would not let them",
                          100 * static_cast<double>(far) / n)
            : fmt::format("{:.1f} % of the samples lie more than 5 sigma off the curve and hardly counted",
                          100 * static_cast<double>(far) / n));
  // Neighbours in speed whose errors are alike: the law, not the noise, is to blame.
  if (r.size() >= 30 && result.residual.std > 1e-6 * std::ranges::max(samples.friction)) {
    std::vector<std::size_t> order(r.size());
    std::iota(order.begin(), order.end(), 0u);
    const auto by_speed = [&](std::size_t i) {
      return std::pair(samples.curve.empty() ? 0u : samples.curve[i], samples.speed[i]);
    };
    if (!std::ranges::is_sorted(order, {}, by_speed)) std::ranges::stable_sort(order, {}, by_speed);
    double products = 0, clipped = 0, before = 0;
    for (const std::size_t row : order) {
      const double error = std::clamp(r[row] - mean, -4 * scale, 4 * scale);
      products += error * std::exchange(before, error);
      clipped += error * error;
    }
    const double correlation = clipped > 0 ? products / clipped : 0;
    if (correlation > std::max(0.2, 4 / std::sqrt(n)))
      result.notes.push_back(
          fmt::format("errors of neighbouring speeds are alike (correlation {:.2f}): the law does not follow these "
                      "data, and its sigmas are too small; compare others with --law A,B",
                      correlation));
  }
}

}  // namespace

double Estimates::correlation(std::size_t i, std::size_t j) const {
  const auto a = static_cast<Index>(i), b = static_cast<Index>(j);
  return covariance(a, b) / std::sqrt(covariance(a, a) * covariance(b, b));
}

Result<Fit> fit(const friction::LawInfo& law, const Samples& samples, const FitOptions& options) {
  Fit result;
  result.samples = samples.size();
  if (samples.size() == 0) return tl::unexpected(std::string("there are no samples"));
  if (std::ranges::all_of(samples.friction, [](double y) { return y == 0; }))
    return tl::unexpected(std::string("friction is 0 in every sample; nothing can be learned from it"));
  const std::vector<double> base = weights_of(samples, options);
  Separable problem(law, samples, base, options.threads);
  std::set<std::size_t> fixed;
  for (const auto& [name, value] : options.fixed) {
    const auto found = std::ranges::find(law.parameters, name, &friction::Parameter::name);
    if (found == law.parameters.end()) {
      std::vector<std::string_view> names;
      for (const auto& p : law.parameters) names.push_back(p.name);
      return tl::unexpected(
          fmt::format("law '{}' has no parameter '{}'; it has {}", law.name, name, fmt::join(names, ", ")));
    }
    if (!(value >= found->minimum && value <= found->maximum))
      return tl::unexpected(
          fmt::format("{} = {}: must lie in {} .. {} {}", name, value, found->minimum, found->maximum, found->unit));
    const auto i = static_cast<std::size_t>(found - law.parameters.begin());
    fixed.insert(i);
    problem.hold(i, value);
  }
  if (law.name == "steady_state" && fixed.contains(1)) {
    // Fs is counted from Fc, which only a known Fc makes a known number.
    if (!fixed.contains(0)) return tl::unexpected(std::string("Fs of steady_state can be fixed together with Fc only"));
    if (problem.held_value(1) < problem.held_value(0))
      return tl::unexpected(std::string("Fs of steady_state is the standstill level and must not be below Fc"));
    problem.hold(1, problem.held_value(1) - problem.held_value(0));
  }
  // The reference temperature of `polynomial` is a convention: another one gives the same curves.
  if (const std::size_t reference = problem.parameter_of(&F::s_T0);
      reference != Separable::npos && problem.is_free(reference)) {
    problem.hold(reference, 20);
    fixed.insert(reference);
    result.notes.push_back(fmt::format("{} = 20 degC is a convention, not a result; --fix {}=VALUE chooses another",
                                       law.parameters[reference].name, law.parameters[reference].name));
  }
  hold_what_does_not_vary(law, samples, problem, result);

  std::size_t open = 0;
  for (std::size_t i = 0; i < law.parameters.size(); ++i) open += problem.is_free(i);
  if (samples.size() <= open)
    return tl::unexpected(
        fmt::format("{} samples cannot tell {} parameters: record {} or more, at as many speeds, or fix parameters",
                    samples.size(), open, open + 2));

  std::vector<std::string> dependent;
  std::vector<std::size_t> order(law.parameters.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::stable_sort(order, {}, [&](std::size_t i) { return precedence(problem.place(), i); });
  for (const std::size_t i : problem.dependent_linear(order)) {
    problem.hold(i, std::clamp(0.0, problem.low(i), problem.high(i)));
    dependent.emplace_back(law.parameters[i].name);
    result.unidentifiable.emplace_back(law.parameters[i].name);
  }
  Point point = problem.minimise();
  for (std::size_t i; (i = dependent_parameter(law, problem, point)) != Separable::npos;) {
    const auto& p = law.parameters[i];
    problem.hold(i, problem.is_linear(i) ? std::clamp(0.0, problem.low(i), problem.high(i))
                                         : point.values(static_cast<Index>(i)));
    dependent.emplace_back(p.name);
    result.unidentifiable.emplace_back(p.name);
    point = problem.minimise();
  }
  if (!dependent.empty())
    result.notes.push_back(
        fmt::format("{} cannot be told apart from the other parameters by these data and {} held; speeds on both sides "
                    "of the minimum of friction would tell",
                    fmt::join(dependent, ", "), dependent.size() > 1 ? "are" : "is"));
  if (options.loss != Loss::squares)
    point = robust_minimum(samples, base, options.loss, problem, std::move(point), options.threads);

  std::vector<std::size_t> coordinates;
  const std::vector<double> r = residuals(samples, problem.place(), point.family, options.threads);
  const auto n = static_cast<double>(samples.size());
  double variance;
  if (options.loss == Loss::squares) {
    std::vector<std::size_t> unused;
    problem.information(point, unused);
    variance = point.cost / std::max(1.0, n - static_cast<double>(unused.size()));
  } else {
    // M-estimate: lambda = scale^2 mean(psi^2) / mean(psi')^2, with the information of unweighted samples.
    problem.set_weights(base);
    point = problem.again(point);
    const double scale = robust_scale(r, base);
    double psi2 = 0, slope = 0;
    for (std::size_t i = 0; i < r.size(); ++i) {
      const double u = scale > 0 ? r[i] * (base.empty() ? 1 : std::sqrt(base[i])) / scale : 0;
      psi2 += std::pow(u * loss_weight(options.loss, u), 2), slope += loss_curvature(options.loss, u);
    }
    variance = slope > 0 ? scale * scale * psi2 * n / (slope * slope) : point.cost / n;
  }
  const MatrixXd information = problem.information(point, coordinates);
  result.estimated = coordinates.size();
  const double freedom = n - static_cast<double>(coordinates.size());
  if (freedom < 1) {
    return tl::unexpected(
        fmt::format("{} samples cannot tell {} parameters: record {} or more, at as many speeds, or fix parameters",
                    samples.size(), coordinates.size(), coordinates.size() + 2));
  }

  const auto count = static_cast<Index>(law.parameters.size());
  MatrixXd covariance = MatrixXd::Zero(count, count);
  const MatrixXd inverse = pseudo_inverse(information) * variance;
  for (std::size_t a = 0; a < coordinates.size(); ++a)
    for (std::size_t b = 0; b < coordinates.size(); ++b)
      covariance(static_cast<Index>(coordinates[a]), static_cast<Index>(coordinates[b])) =
          inverse(static_cast<Index>(a), static_cast<Index>(b));
  covariance = problem.to_parameters() * covariance * problem.to_parameters().transpose();
  result.condition_number = 1;
  if (!coordinates.empty()) {
    const VectorXd unit = information.diagonal().cwiseSqrt().cwiseInverse();
    const VectorXd eigenvalues = Eigen::SelfAdjointEigenSolver<MatrixXd>(
                                     unit.asDiagonal() * information * unit.asDiagonal(), Eigen::EigenvaluesOnly)
                                     .eigenvalues();
    result.condition_number = std::sqrt(eigenvalues.maxCoeff() / std::max(eigenvalues.minCoeff(), 1e-300));
  }

  const VectorXd values = problem.parameters(point.values);
  const double t = interval_sigmas(freedom);
  std::vector<double> numbers;
  const double signal =
      std::transform_reduce(samples.friction.begin(), samples.friction.end(), samples.friction.begin(), 0.0) / n;
  for (Index i = 0; i < count; ++i) {
    const auto j = static_cast<std::size_t>(i);
    const auto& p = law.parameters[j];
    Estimate e{.name = std::string(p.name),
               .unit = std::string(p.unit),
               .value = values(i),
               .sigma = unknown,
               .low = unknown,
               .high = unknown};
    const bool sought = std::ranges::find(coordinates, j) != coordinates.end();
    e.status = fixed.contains(j)    ? Status::fixed
               : sought             ? Status::estimated
               : problem.is_free(j) ? Status::at_bound
                                    : Status::held;
    if (sought) {
      e.sigma = std::sqrt(std::max(0.0, covariance(i, i)));
      e.low = e.value - t * e.sigma;
      e.high = e.value + t * e.sigma;
      // Its uncertainty is worth more than the friction itself, or than itself where it can only be positive.
      const auto at = static_cast<Index>(std::ranges::find(coordinates, j) - coordinates.begin());
      const double effect = std::sqrt(information(at, at) / n);
      if (e.sigma * effect > std::sqrt(signal) ||
          (!problem.is_linear(j) && p.minimum >= 0 && e.sigma > std::abs(e.value)))
        result.unidentifiable.push_back(e.name);
    }
    numbers.push_back(std::clamp(e.value, p.minimum, p.maximum));
    result.parameters.push_back(std::move(e));
  }
  for (Index i = 0; i < count; ++i)
    if (result.parameters[static_cast<std::size_t>(i)].status != Status::estimated)
      covariance.row(i).setConstant(unknown), covariance.col(i).setConstant(unknown);
  result.covariance = covariance;
  for (const auto& e : result.parameters)
    if (e.status == Status::at_bound)
      result.notes.push_back(fmt::format(
          "{} = {:g} is at the edge of its accepted range; the sigmas of the others hold only if it belongs there",
          e.name, e.value));

  std::vector<std::pair<std::string, double>> named;
  for (std::size_t i = 0; i < numbers.size(); ++i) named.emplace_back(law.parameters[i].name, numbers[i]);
  auto made = friction::make_law(law.name, named);
  if (!made) {
    result.notes.push_back(made.error().message);
    friction::Law bare;
    bare.info = &law;
    made = friction::with_parameters(bare, numbers);
  }
  result.law = std::move(*made);
  result.law.range.speed_max_rad_s = std::ranges::max(samples.speed);
  if (law.load_dependent) result.law.range.load_max = std::ranges::max(samples.load);
  if (law.temperature_dependent) {
    const auto [low, high] = std::ranges::minmax(samples.temperature_degC);
    result.law.range.temperature_min_degC = low;
    result.law.range.temperature_max_degC = high;
  }

  result.cost = point.cost;
  double mean = 0, weight_sum = 0, spread = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const double w = base.empty() ? 1 : base[i];
    mean += w * samples.friction[i], weight_sum += w;
  }
  mean /= weight_sum;
  double squares = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const double w = base.empty() ? 1 : base[i];
    spread += w * std::pow(samples.friction[i] - mean, 2), squares += w * r[i] * r[i];
  }
  result.r_squared = spread > 0 ? 1 - squares / spread : 0;
  const double p = static_cast<double>(coordinates.size()) + 1;  // the variance is one
  result.aicc =
      n * std::log(std::max(squares, 1e-300) / n) + 2 * p + (n - p - 1 > 0 ? 2 * p * (p + 1) / (n - p - 1) : unknown);
  describe_residuals(samples, r, base, options, result);
  std::set<double> speeds;
  for (std::size_t i = 0; i < samples.size() && speeds.size() < 5; ++i) speeds.insert(samples.speed[i]);
  if (speeds.size() > 4 && result.r_squared < 0.5)
    result.notes.push_back(fmt::format(
        "the law explains only {:.0f} % of how friction varies in these data: are the columns what their names say?",
        100 * std::max(0.0, result.r_squared)));
  if (result.condition_number > 1e4)
    result.notes.push_back(fmt::format(
        "condition number {:.1e}: parameters trade against each other; their values are little worth one by one",
        result.condition_number));
  std::set<std::string> once;
  std::erase_if(result.unidentifiable, [&](const std::string& name) { return !once.insert(name).second; });
  return result;
}

Result<Fit> fit_staged(const friction::LawInfo& law, const Samples& samples, const FitOptions& options) {
  if (!law.load_dependent || !law.temperature_dependent)
    return tl::unexpected(fmt::format(
        "law '{}' does not depend on both load and temperature: there are no stages to identify it in", law.name));
  std::map<long, std::vector<std::size_t>> by_temperature;
  for (std::size_t i = 0; i < samples.size(); ++i)
    by_temperature[std::lround(5 * samples.temperature_degC[i])].push_back(i);
  const std::vector<std::size_t>* most = nullptr;
  std::size_t loads = 0;
  for (const auto& [T, rows] : by_temperature) {
    std::set<long> levels;
    for (const std::size_t i : rows) levels.insert(std::lround(samples.load[i] * 1000));
    if (levels.size() > loads) loads = levels.size(), most = &rows;
  }
  if (loads < 3)
    return tl::unexpected(
        fmt::format("no temperature was measured at three loads or more (at most {}): the load terms cannot be found "
                    "first; fit all at once",
                    loads));
  Samples still = samples.subset(*most);
  const double mean = std::accumulate(still.temperature_degC.begin(), still.temperature_degC.end(), 0.0) /
                      static_cast<double>(still.size());
  std::ranges::fill(still.temperature_degC, mean);
  const auto first = fit(law, still, options);
  if (!first) return tl::unexpected("load terms: " + first.error().message);
  const Placement place(law);
  FitOptions rest = options;
  std::vector<std::size_t> load_terms;
  for (std::size_t i = 0; i < law.parameters.size(); ++i)
    if (moves(place, i, {&F::A_l, &F::B_l, &F::C_l, &F::vl}) && !moves(place, i, {&F::A, &F::B}) &&
        first->parameters[i].status == Status::estimated) {
      load_terms.push_back(i);
      rest.fixed.emplace_back(law.parameters[i].name, first->parameters[i].value);
    }
  auto result = fit(law, samples, rest);
  if (!result) return result;
  for (const std::size_t i : load_terms) {
    result->parameters[i] = first->parameters[i];
    for (const std::size_t j : load_terms)
      result->covariance(static_cast<Index>(i), static_cast<Index>(j)) =
          first->covariance(static_cast<Index>(i), static_cast<Index>(j));
  }
  result->estimated += load_terms.size();
  result->notes.insert(result->notes.begin(),
                       fmt::format("in stages: the load terms from {} samples at {:.1f} degC and {} loads, the rest "
                                   "from all; the sigmas of the rest take the load terms as known",
                                   still.size(), mean, loads));
  return result;
}

Result<double> cross_validate(const friction::LawInfo& law, const Samples& samples, const FitOptions& options,
                              unsigned folds) {
  const bool by_curve = samples.curves() >= folds;
  double squares = 0;
  for (unsigned fold = 0; fold < folds; ++fold) {
    std::vector<std::size_t> learn, test;
    for (std::size_t i = 0; i < samples.size(); ++i)
      ((by_curve ? samples.curve[i] : i) % folds == fold ? test : learn).push_back(i);
    if (learn.empty() || test.empty())
      return tl::unexpected(fmt::format("{} samples are too few for {} folds", samples.size(), folds));
    const Samples learned = samples.subset(learn), tested = samples.subset(test);
    const auto found = fit(law, learned, options);
    if (!found) return tl::unexpected(fmt::format("without fold {}: {}", fold + 1, found.error().message));
    for (const double r : residuals(tested, Placement(law), found->law.family, options.threads)) squares += r * r;
  }
  return std::sqrt(squares / static_cast<double>(samples.size()));
}

Result<Shared> fit_shared(const friction::LawInfo& law, const Samples& samples, const std::string& parameter,
                          const FitOptions& options) {
  const auto found = std::ranges::find(law.parameters, parameter, &friction::Parameter::name);
  if (found == law.parameters.end())
    return tl::unexpected(fmt::format("law '{}' has no parameter '{}'", law.name, parameter));
  const auto shared = static_cast<std::size_t>(found - law.parameters.begin());
  std::vector<std::vector<std::size_t>> rows(samples.curves());
  for (std::size_t i = 0; i < samples.size(); ++i) rows[samples.curve[i]].push_back(i);
  const Placement place(law);
  std::size_t nonlinear = 0, linear = 0;
  for (std::size_t i = 0; i < law.parameters.size(); ++i) (place.is_linear(i) ? linear : nonlinear) += 1;
  std::vector<Samples> curves;
  Shared result;
  for (const auto& of_curve : rows) {
    if (of_curve.size() <= law.parameters.size()) continue;
    curves.push_back(samples.subset(of_curve));
    result.samples += of_curve.size();
  }
  result.curves = curves.size();
  if (curves.size() < rows.size())
    result.notes.push_back(
        fmt::format("{} curves with no more samples than parameters were left out", rows.size() - curves.size()));
  if (curves.empty())
    return tl::unexpected(
        fmt::format("no curve has more samples than law '{}' parameters ({})", law.name, law.parameters.size()));
  std::vector<Separable> problems;
  std::vector<VectorXd> at(curves.size());
  for (const Samples& curve : curves) {
    Separable& problem = problems.emplace_back(law, curve, weights_of(curve, options), 1u);
    for (const auto& [name, value] : options.fixed)
      if (const auto p = std::ranges::find(law.parameters, name, &friction::Parameter::name); p != law.parameters.end())
        problem.hold(static_cast<std::size_t>(p - law.parameters.begin()), value);
  }
  const auto cost = [&](double value) {
    double sum = 0;
    for (std::size_t c = 0; c < curves.size(); ++c) {
      problems[c].hold(shared, value);
      const Point p = at[c].size() ? problems[c].refine(at[c]) : problems[c].minimise();
      at[c] = p.values;
      sum += p.cost;
    }
    return sum;
  };
  const double low = std::max(found->minimum, 0.3), high = std::min(found->maximum, 4.0);
  const auto [best, least] = boost::math::tools::brent_find_minima(cost, low, high, 14);
  result.value = best;
  // Curvature from a parabola as wide as costs tell values apart.
  const double h = 0.05 * best, curvature = (cost(best + h) - 2 * least + cost(best - h)) / (h * h);
  const double freedom = static_cast<double>(result.samples) -
                         static_cast<double>(curves.size() * (law.parameters.size() - 1 - options.fixed.size())) - 1;
  result.sigma = std::sqrt(2 * least / std::max(1.0, freedom) / curvature);
  for (int i = -8; i <= 8; ++i)
    if (const double v = best * (1 + 0.05 * i); v > low && v < high)
      result.profile.emplace_back(v, cost(v) / least - 1);
  if (best < low * 1.01 || best > high * 0.99)
    result.notes.push_back(
        fmt::format("{} = {:.3g} is at the end of the searched range {} .. {}", parameter, best, low, high));
  return result;
}

}  // namespace tribotwin::twin::identification
