#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <set>

#include <fmt/format.h>

#include <tribotwin/twin/identification/curves/direction.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/curves/identifiability.hpp>
#include <tribotwin/twin/identification/curves/residual_statistics.hpp>
#include <tribotwin/twin/identification/curves/robust.hpp>
#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

/// Effects of less than this share of friction are none: models of gears and loads are no better.
constexpr double negligible = 1e-3;

/// Asymmetry and offset, as far as the user knows them.
struct KnownDirection {
  std::optional<double> asymmetry, offset;
  bool any() const { return asymmetry || offset; }
};

/// Whether the samples determine every number of a direction, with the law's parameters free (`reduced`) as with them
/// known (`own`).
bool separable(const MatrixXd& reduced, const MatrixXd& own) {
  constexpr double rounding = 1e-7;
  for (Index k = 0; k < own.rows(); ++k)
    if (!(reduced(k, k) > rounding * own(k, k))) return false;
  return own.rows() < 2 || reduced(0, 1) * reduced(0, 1) < (1 - rounding) * reduced(0, 0) * reduced(1, 1);
}

/// One identification: the stages of `fit`, in the order of its calls.
class Identification {
 public:
  /// `directed`: samples of by_direction, of which asymmetry and offset are found too.
  Identification(const friction::LawInfo& law, const Samples& samples, const FitOptions& options, bool directed)
      : law_(law),
        samples_(samples),
        options_(options),
        directed_(directed),
        weights_(options.weigh ? weights_of(samples) : std::vector<double>{}),
        seen_(directed ? samples : Samples{}),
        problem_(law, directed ? seen_ : samples, weights_, options.threads) {
    result_.samples = samples.size();
  }

  Result<void> fix_known();
  void fix_conventions();
  void fix_without_effect() { fix_without_variation(law_, samples_, problem_, result_); }
  Result<void> check_count() const;
  void minimise();
  /// Which of asymmetry and offset the samples tell, and the minimum with them. False where they tell none.
  Result<bool> find_direction(const KnownDirection& known);
  Result<void> estimate_covariance();
  /// Covariance with the arcs of the residuals, if there are any, and the half widths of intervals.
  void count_misfit();
  /// Nothing that a direction without information moves has a variance.
  void withhold_untold();
  void fill_parameters();
  void make_law();
  Fit report();

 private:
  /// Fixes a parameter that the others can replace at 0 or, where it is nonlinear, at `value`.
  void fix_dependent(std::size_t parameter, double value);
  Estimate estimate(std::size_t parameter, double value) const;
  /// The minimum with these numbers free, from `start`.
  Result<void> descend(const Direction& from, const Point& start);
  /// The law's best parameters at this direction, found from those of `start`; weights of `loss` for the next ones.
  void project(const Direction& direction, const Point& start, Loss loss);
  /// Products of the derivatives by the law's coordinates that are estimated and the free numbers of the direction.
  MatrixXd information(VectorXd* slope = nullptr);
  /// Whether a number of the direction is worth keeping: its place among law_.parameters and these two.
  bool tells(std::size_t place, double effect) const;
  void fill_direction();
  /// Derivatives of each sample by the coordinates, in units of its standard error.
  MatrixXd jacobian() const;
  /// The law's parameters and the numbers of the direction from the coordinates.
  MatrixXd to_parameters() const;

  const friction::LawInfo& law_;
  const Samples& samples_;
  const FitOptions& options_;
  const bool directed_;
  const std::vector<double> weights_;
  Samples seen_;  ///< what problem_ sees of samples_ with a direction
  Separable problem_;
  Direction direction_;
  bool told_apart_ = true;                 ///< the numbers of the direction, from each other and from the law's
  std::vector<double> direction_weights_;  ///< of samples_, robust or not, at the last projection
  std::set<std::size_t> fixed_;            ///< by the user or by convention
  std::vector<std::string> dependent_;     ///< parameters that others can replace
  Point point_;
  std::vector<double> residuals_;
  std::vector<std::size_t> coordinates_;  ///< that are estimated
  MatrixXd information_, covariance_;     ///< of the coordinates; of the parameters
  std::optional<Misfit> misfit_;
  VectorXd interval_;  ///< per parameter, half width of its 95 % interval in sigmas
  Fit result_;
};

tl::unexpected<Error> too_few(std::size_t samples, std::size_t parameters) {
  return tl::make_unexpected(Error(fmt::format(
      "{} sample{} cannot determine {} parameter{}: record {} or more, at as many speeds, or fix parameters", samples,
      samples == 1 ? "" : "s", parameters, parameters == 1 ? "" : "s", parameters + 2)));
}

Result<void> Identification::fix_known() {
  for (const auto& [name, value] : options_.fixed) {
    const auto found = std::ranges::find(law_.parameters, name, &friction::Parameter::name);
    if (found == law_.parameters.end()) {
      std::vector<std::string_view> names;
      for (const auto& p : law_.parameters) names.push_back(p.name);
      return tl::unexpected(fmt::format("law '{}' has no parameter '{}'; it has {}", law_.name, name, joined(names)));
    }
    if (!(value >= found->minimum && value <= found->maximum))
      return tl::unexpected(
          fmt::format("{} = {}: must lie in {} .. {} {}", name, value, found->minimum, found->maximum, found->unit));
    const auto i = static_cast<std::size_t>(found - law_.parameters.begin());
    fixed_.insert(i);
    problem_.hold(i, value);
  }
  // Where the search is for the excess over another parameter, only that one makes the excess a known number.
  for (const std::size_t i : fixed_) {
    const std::size_t base = problem_.base_of(i);
    if (base == Separable::npos) continue;
    const std::string_view name = law_.parameters[i].name, of = law_.parameters[base].name;
    if (!fixed_.contains(base))
      return tl::unexpected(fmt::format("{} of {} can be fixed together with {} only", name, law_.name, of));
    if (problem_.held_value(i) < problem_.held_value(base))
      return tl::unexpected(
          fmt::format("{} of {} is the standstill level and must not be below {}", name, law_.name, of));
    problem_.hold(i, problem_.held_value(i) - problem_.held_value(base));
  }
  return {};
}

void Identification::fix_conventions() {
  // The reference temperature of s(T) is a convention: another one gives the same curves.
  const std::size_t reference = problem_.parameter_of(&friction::GeneralLaw::s_T0);
  if (reference == Separable::npos || !problem_.is_free(reference)) return;
  problem_.hold(reference, 20);
  fixed_.insert(reference);
  const std::string_view name = law_.parameters[reference].name;
  result_.notes.push_back(
      fmt::format("{} = 20 degC is a convention, not a result; --fix {}=VALUE chooses another", name, name));
}

Result<void> Identification::check_count() const {
  std::size_t free = 0;
  for (std::size_t i = 0; i < law_.parameters.size(); ++i) free += problem_.is_free(i);
  if (samples_.size() <= free) return too_few(samples_.size(), free);
  return {};
}

void Identification::fix_dependent(std::size_t i, double value) {
  problem_.hold(i, problem_.is_linear(i) ? std::clamp(0.0, problem_.low(i), problem_.high(i)) : value);
  dependent_.emplace_back(law_.parameters[i].name);
}

void Identification::minimise() {
  for (const std::size_t i : problem_.dependent_linear(by_rank(problem_.place()))) fix_dependent(i, 0);
  point_ = problem_.minimise();
  for (std::size_t i; (i = dependent_parameter(law_, problem_, point_)) != Separable::npos;) {
    fix_dependent(i, point_.values(static_cast<Index>(i)));
    point_ = problem_.minimise();
  }
  if (!dependent_.empty())
    result_.notes.push_back(fmt::format(
        "{} {} not identifiable beside the other parameters and fixed; record speeds on both sides of the minimum of "
        "friction",
        joined(dependent_), dependent_.size() > 1 ? "are" : "is"));
  if (options_.loss != Loss::squares)
    point_ = robust_minimum(samples_, weights_, options_.loss, problem_, std::move(point_), options_.threads);
  residuals_ = residuals(samples_, problem_.place(), point_.general_law, options_.threads);
}

Result<void> Identification::estimate_covariance() {
  const auto n = static_cast<double>(samples_.size());
  double variance;
  if (options_.loss == Loss::squares) {
    information_ = information();
    variance = point_.cost / std::max(1.0, n - static_cast<double>(coordinates_.size()));
  } else {
    std::vector<double> weights = weights_;
    if (directed_) make_symmetric(samples_, direction_weights_ = weights_, direction_, seen_, weights);
    problem_.set_weights(std::move(weights));
    point_ = problem_.again(point_);
    variance = robust_variance(residuals_, weights_, options_.loss, point_.cost / n);
    information_ = information();
  }
  result_.estimated = coordinates_.size();
  if (samples_.size() < coordinates_.size() + 1) return too_few(samples_.size(), coordinates_.size());

  const Index count = to_parameters().rows();
  covariance_ = MatrixXd::Zero(count, count);
  const MatrixXd inverse = pseudo_inverse(information_) * variance;
  for (std::size_t a = 0; a < coordinates_.size(); ++a)
    for (std::size_t b = 0; b < coordinates_.size(); ++b)
      covariance_(static_cast<Index>(coordinates_[a]), static_cast<Index>(coordinates_[b])) =
          inverse(static_cast<Index>(a), static_cast<Index>(b));
  covariance_ = to_parameters() * covariance_ * to_parameters().transpose();
  result_.condition_number = 1;
  if (!coordinates_.empty()) {
    const VectorXd unit = information_.diagonal().cwiseSqrt().cwiseInverse();
    const VectorXd eigenvalues = symmetric_eigenvalues(unit.asDiagonal() * information_ * unit.asDiagonal());
    result_.condition_number = std::sqrt(eigenvalues.maxCoeff() / std::max(eigenvalues.minCoeff(), 1e-300));
  }
  return {};
}

MatrixXd Identification::to_parameters() const {
  const auto of_law = static_cast<Index>(law_.parameters.size()), count = of_law + (directed_ ? 2 : 0);
  MatrixXd to = MatrixXd::Identity(count, count);
  to.topLeftCorner(of_law, of_law) = problem_.to_parameters();
  return to;
}

MatrixXd Identification::jacobian() const {
  const Placement& place = problem_.place();
  const auto linear = static_cast<Index>(place.linear_used.size()),
             nonlinear = static_cast<Index>(place.nonlinear_used.size());
  std::vector<Index> of_law;
  for (const std::size_t c : coordinates_)
    if (c < law_.parameters.size()) of_law.push_back(static_cast<Index>(c));
  MatrixXd chain(linear + nonlinear, place.linear.cols());
  chain << place.linear, place.nonlinear;
  const MatrixXd by_coordinates = chain(Eigen::all, of_law);
  MatrixXd J = MatrixXd::Zero(static_cast<Index>(samples_.size()), static_cast<Index>(coordinates_.size()));
  VectorXd by_numbers(linear + nonlinear);
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    const auto g =
        friction::gradient(point_.general_law, samples_.speed[i], samples_.load[i], samples_.temperature_degC[i]);
    for (Index k = 0; k < linear; ++k) by_numbers(k) = g.by_terms[place.linear_used[static_cast<std::size_t>(k)]];
    for (Index k = 0; k < nonlinear; ++k)
      by_numbers(linear + k) = g.by_shape_numbers[place.nonlinear_used[static_cast<std::size_t>(k)]];
    const double s = directed_ ? samples_.direction[i] : 0, w = weights_.empty() ? 1 : std::sqrt(weights_[i]);
    const auto row = static_cast<Index>(i), first = static_cast<Index>(of_law.size());
    J.row(row).head(first) = w * direction_.factor(s) * by_numbers.transpose() * by_coordinates;
    for (Index k = first; k < J.cols(); ++k)
      J(row, k) = w * s * (coordinates_[static_cast<std::size_t>(k)] == law_.parameters.size() ? g.torque : 1);
  }
  return J;
}

void Identification::count_misfit() {
  const auto n = static_cast<double>(samples_.size()), own = n - static_cast<double>(coordinates_.size());
  interval_ = VectorXd::Constant(covariance_.rows(), interval_sigmas(own));
  // Outliers are no arcs.
  const double limit = 4 * robust_scale(residuals_, weights_);
  VectorXd r(static_cast<Index>(residuals_.size()));
  for (std::size_t i = 0; i < residuals_.size(); ++i)
    r(static_cast<Index>(i)) =
        std::clamp(residuals_[i] * (weights_.empty() ? 1 : std::sqrt(weights_[i])), -limit, limit);
  if (!options_.count_arcs || !(point_.cost > 1e-12 * point_.moments.yy)) return;
  misfit_ = misfit_of(samples_, r, jacobian());
  if (!misfit_) return;
  MatrixXd all = MatrixXd::Zero(covariance_.rows(), covariance_.cols());
  std::vector<Index> at(coordinates_.begin(), coordinates_.end());
  all(at, at) = misfit_->covariance;
  all = to_parameters() * all * to_parameters().transpose();
  for (Index k = 0; k < all.rows(); ++k) {
    if (!(all(k, k) > covariance_(k, k))) {  // it does not move with the arcs
      all.row(k) *= std::sqrt(covariance_(k, k) / std::max(1e-300, all(k, k)));
      all.col(k) *= std::sqrt(covariance_(k, k) / std::max(1e-300, all(k, k)));
      continue;
    }
    // Freedom of a sum of two variances (Satterthwaite 1946).
    const double white = covariance_(k, k) / all(k, k), arcs = 1 - white;
    interval_(k) = interval_sigmas(1 / (white * white / own + arcs * arcs / misfit_->freedom));
  }
  covariance_ = all;
}

void Identification::withhold_untold() {
  constexpr double no_information = 1e-13, rounding = 1e-6;
  if (coordinates_.empty()) return;
  const std::vector<Index> at(coordinates_.begin(), coordinates_.end());
  const MatrixXd to = to_parameters()(Eigen::all, at);
  const VectorXd unit = information_.diagonal().unaryExpr([](double x) { return x > 1e-200 ? 1 / std::sqrt(x) : 0; });
  const SymmetricEigen eigen = symmetric_eigen(unit.asDiagonal() * information_ * unit.asDiagonal());
  for (Index k = 0; k < eigen.values.size(); ++k) {
    if (eigen.values(k) > no_information * eigen.values.maxCoeff()) continue;
    const VectorXd direction =
        unit.asDiagonal() *
        VectorXd(eigen.vectors.col(k).unaryExpr([](double x) { return std::abs(x) < rounding ? 0 : x; }));
    const VectorXd moved = to * direction, largest = to.cwiseAbs() * direction.cwiseAbs();
    for (Index i = 0; i < moved.size(); ++i)
      if (std::abs(moved(i)) > rounding * largest(i))
        covariance_.row(i).setConstant(unknown), covariance_.col(i).setConstant(unknown);
  }
}

MatrixXd Identification::information(VectorXd* slope) {
  const MatrixXd of_law = problem_.information(point_, coordinates_);
  if (!directed_) return of_law;
  const DirectionMoments m =
      direction_moments(samples_, direction_weights_, direction_, problem_.place(), point_, coordinates_);
  if (slope) *slope = m.slope;
  const Index n = of_law.rows(), extra = m.own.rows();
  MatrixXd all(n + extra, n + extra);
  all.topLeftCorner(n, n) = of_law;
  all.topRightCorner(n, extra) = m.cross;
  all.bottomLeftCorner(extra, n) = m.cross.transpose();
  all.bottomRightCorner(extra, extra) = m.own;
  if (direction_.asymmetry_free) coordinates_.push_back(law_.parameters.size());
  if (direction_.offset_free) coordinates_.push_back(law_.parameters.size() + 1);
  return all;
}

void Identification::project(const Direction& direction, const Point& start, Loss loss) {
  direction_ = direction;
  if (options_.loss == Loss::squares) direction_weights_ = weights_;
  std::vector<double> seen_weights;
  make_symmetric(samples_, direction_weights_, direction_, seen_, seen_weights);
  problem_.set_weights(std::move(seen_weights));
  point_ = problem_.refine(start.values);
  residuals_ = residuals(samples_, problem_.place(), point_.general_law, direction_, options_.threads);
  if (options_.loss != Loss::squares) direction_weights_ = robust_weights(residuals_, weights_, loss);
}

Result<void> Identification::descend(const Direction& from, const Point& start) {
  told_apart_ = true;
  direction_weights_ = weights_;
  if (options_.loss != Loss::squares)
    direction_weights_ = robust_weights(
        residuals(samples_, problem_.place(), start.general_law, from, options_.threads), weights_, Loss::huber);
  project(from, start, Loss::huber);
  const auto n = static_cast<double>(samples_.size());
  const bool free = from.asymmetry_free || from.offset_free, robust = options_.loss != Loss::squares;
  for (int round = 0; (free || robust) && round < 100 && point_.cost > 1e-26 * point_.moments.yy; ++round) {
    VectorXd slope;
    const MatrixXd all = information(&slope);
    const Index extra = slope.size(), of_law = all.rows() - extra;
    const MatrixXd cross = all.topRightCorner(of_law, extra),
                   reduced = all.bottomRightCorner(extra, extra) -
                             cross.transpose() * pseudo_inverse(all.topLeftCorner(of_law, of_law)) * cross;
    told_apart_ = separable(reduced, all.bottomRightCorner(extra, extra));
    const VectorXd step = free ? VectorXd(pseudo_inverse(reduced) * slope) : VectorXd();
    const double gain = free ? step.dot(reduced * step) : 0;
    // The weights of a robust loss follow the residuals step by step.
    if (!(gain > 1e-10 * point_.cost / n) && (!robust || round >= 20)) break;
    const Point before = point_;
    const Direction at = direction_;
    for (double share = 1; share > 1e-4; share /= 2) {
      Direction next = at;
      if (at.asymmetry_free) next.asymmetry = std::clamp(at.asymmetry + share * step(0), -asymmetry_max, asymmetry_max);
      if (at.offset_free) next.offset += share * step(extra - 1);
      project(next, before, round < 10 ? Loss::huber : options_.loss);
      // A robust loss weighs anew at each step, and its costs do not compare.
      if (robust || point_.cost <= before.cost) break;
    }
    if (!robust && point_.cost > before.cost) {
      project(at, before, options_.loss);
      break;
    }
  }
  return estimate_covariance();
}

bool Identification::tells(std::size_t place, double effect) const {
  if (!told_apart_ || std::ranges::find(coordinates_, place) == coordinates_.end()) return false;
  const auto n = static_cast<double>(samples_.size());
  const auto i = static_cast<Index>(place);
  const double value = place == law_.parameters.size() ? direction_.asymmetry : direction_.offset;
  return std::abs(value) >
             interval_sigmas(n - static_cast<double>(coordinates_.size())) * std::sqrt(covariance_(i, i)) &&
         std::abs(value) * effect > negligible;
}

Result<bool> Identification::find_direction(const KnownDirection& known) {
  const Point start = point_;
  const std::size_t a = law_.parameters.size(), o = a + 1;
  double square = 0;
  for (const double y : samples_.friction) square += y * y;
  const double per_friction = 1 / std::sqrt(square / static_cast<double>(samples_.size()));
  Direction both{.asymmetry = known.asymmetry.value_or(0), .offset = known.offset.value_or(0)};
  if (has_both_directions(samples_)) both.asymmetry_free = !known.asymmetry, both.offset_free = !known.offset;
  if (auto ok = descend(both, start); !ok) return tl::unexpected(ok.error());
  const bool asymmetry = tells(a, 1), offset = tells(o, per_friction);
  if (asymmetry == both.asymmetry_free && offset == both.offset_free) return asymmetry || offset || known.any();

  // The best single one; what both together reach says how well the other would do in its place.
  const double reached = point_.cost, variance = reached / static_cast<double>(samples_.size());
  struct Single {
    Direction from;
    bool tells = false;
    double cost = std::numeric_limits<double>::infinity();
  };
  Single singles[] = {{both}, {both}};
  singles[0].from.offset_free = singles[1].from.asymmetry_free = false;
  for (Single& single : singles) {
    if (!single.from.asymmetry_free && !single.from.offset_free) continue;
    if (auto ok = descend(single.from, start); !ok) return tl::unexpected(ok.error());
    single.tells = tells(a, 1) || tells(o, per_friction);
    single.cost = point_.cost;
  }
  const Single& best = singles[singles[1].cost < singles[0].cost];
  const Single& other = singles[singles[1].cost < singles[0].cost ? 0 : 1];
  if (!best.tells && !known.any()) return false;
  Direction chosen = both;
  chosen.asymmetry_free = chosen.offset_free = false;
  if (best.tells) chosen = best.from;
  if (auto ok = descend(chosen, start); !ok) return tl::unexpected(ok.error());
  if (best.tells && other.tells && other.cost - best.cost < 3.84 * variance)
    result_.notes.push_back(fmt::format(
        "the directions differ, but {} in place of {} would explain it as well; record speeds at which friction "
        "differs more",
        best.from.asymmetry_free ? offset_name : asymmetry_name,
        best.from.asymmetry_free ? asymmetry_name : offset_name));
  return true;
}

void Identification::fill_direction() {
  const struct {
    std::string_view name;
    double value;
  } numbers[] = {{asymmetry_name, direction_.asymmetry}, {offset_name, direction_.offset}};
  for (std::size_t k = 0; k < 2; ++k) {
    const std::size_t place = law_.parameters.size() + k;
    const std::string name(numbers[k].name), unit(k == 0 ? "1" : law_.normalised ? "-" : "Nm");
    const auto i = static_cast<Index>(place);
    result_.parameters.push_back(
        std::ranges::find(coordinates_, place) != coordinates_.end()
            ? identification::estimate(name, unit, numbers[k].value, covariance_(i, i), interval_(i))
            : without_sigma(name, unit, numbers[k].value, Status::fixed));
  }
  result_.asymmetry = direction_.asymmetry;
  result_.offset = direction_.offset;
}

Estimate Identification::estimate(std::size_t j, double value) const {
  const auto& p = law_.parameters[j];
  const bool estimated = std::ranges::find(coordinates_, j) != coordinates_.end();
  Estimate e{.name = std::string(p.name),
             .unit = std::string(p.unit),
             .value = value,
             .sigma = unknown,
             .low = unknown,
             .high = unknown,
             .status = fixed_.contains(j)    ? Status::fixed
                       : estimated           ? Status::estimated
                       : problem_.is_free(j) ? Status::at_bound
                                             : Status::held};
  if (estimated) {
    const auto i = static_cast<Index>(j);
    e.sigma = covariance_(i, i) < 0 ? 0 : std::sqrt(covariance_(i, i));
    e.low = e.value - interval_(i) * e.sigma;
    e.high = e.value + interval_(i) * e.sigma;
  }
  return e;
}

void Identification::fill_parameters() {
  const VectorXd values = problem_.parameters(point_.values);
  for (std::size_t j = 0; j < law_.parameters.size(); ++j) {
    result_.parameters.push_back(estimate(j, values(static_cast<Index>(j))));
  }
  if (directed_) fill_direction();
  result_.covariance = covariance_;
  for (std::size_t j = 0; j < result_.parameters.size(); ++j)
    if (const auto i = static_cast<Index>(j); result_.parameters[j].status != Status::estimated)
      result_.covariance.row(i).setConstant(unknown), result_.covariance.col(i).setConstant(unknown);
  for (const auto& e : result_.parameters)
    if (e.status == Status::at_bound)
      result_.notes.push_back(fmt::format(
          "{} = {:g} is at the edge of its accepted range; the sigmas of the others hold only if it belongs there",
          e.name, e.value));
}

void Identification::make_law() {
  std::vector<std::pair<std::string, double>> named;
  std::vector<double> numbers;
  for (std::size_t i = 0; i < law_.parameters.size(); ++i) {
    const auto& p = law_.parameters[i];
    numbers.push_back(std::clamp(result_.parameters[i].value, p.minimum, p.maximum));
    named.emplace_back(p.name, numbers.back());
  }
  auto made = friction::make_law(law_.name, named);
  if (!made) {
    result_.notes.push_back(made.error().message);
    friction::Law bare;
    bare.info = &law_;
    made = friction::with_parameters(bare, numbers);
  }
  result_.law = std::move(*made);
  friction::Range& range = result_.law.range;
  range.speed_max_rad_s = std::ranges::max(samples_.speed);
  if (law_.load_dependent) range.load_max = std::ranges::max(samples_.load);
  if (law_.temperature_dependent) {
    const auto [low, high] = std::ranges::minmax(samples_.temperature_degC);
    range.temperature_min_degC = low;
    range.temperature_max_degC = high;
  }
}

Fit Identification::report() {
  result_.cost = point_.cost;
  describe_residuals(samples_, residuals_, weights_, options_.loss, misfit_, result_);
  const auto n = static_cast<double>(samples_.size());
  const double noise = misfit_ ? 1 - misfit_->share + misfit_->share * n / (misfit_->freedom + 1) : 1;
  result_.lacking =
      lacking_of(law_, samples_, result_, misfit_, unseen_terms(problem_, point_, coordinates_, n, noise));
  result_.unidentifiable = withheld(result_.lacking);
  if (result_.condition_number > 1e4)
    result_.notes.push_back(
        fmt::format("condition number {:.1e}: parameters compensate each other; their individual values mean little",
                    result_.condition_number));
  return std::move(result_);
}

/// All stages; none where asymmetry and offset were asked for and the samples tell neither.
Result<std::optional<Fit>> identify(const friction::LawInfo& law, const Samples& samples, const FitOptions& options,
                                    const KnownDirection* known) {
  Identification identification(law, samples, options, known != nullptr);
  if (auto ok = identification.fix_known(); !ok) return tl::unexpected(ok.error());
  identification.fix_conventions();
  identification.fix_without_effect();
  if (auto ok = identification.check_count(); !ok) return tl::unexpected(ok.error());
  identification.minimise();
  if (known) {
    const auto told = identification.find_direction(*known);
    if (!told) return tl::unexpected(told.error());
    if (!*told) return std::optional<Fit>();
  } else if (auto ok = identification.estimate_covariance(); !ok) {
    return tl::unexpected(ok.error());
  }
  identification.count_misfit();
  identification.withhold_untold();
  identification.fill_parameters();
  identification.make_law();
  return identification.report();
}

/// Takes asymmetry and offset out of the numbers that are known.
Result<KnownDirection> known_direction(FitOptions& options) {
  KnownDirection known;
  for (const auto& [name, value] : options.fixed) {
    if (name == asymmetry_name && !(std::abs(value) <= asymmetry_max))
      return tl::unexpected(fmt::format("{} = {}: must lie in {} .. {}", name, value, -asymmetry_max, asymmetry_max));
    if (name == asymmetry_name) known.asymmetry = value;
    if (name == offset_name) known.offset = value;
  }
  std::erase_if(options.fixed, [](const auto& f) { return f.first == asymmetry_name || f.first == offset_name; });
  return known;
}

}  // namespace

Result<Fit> fit(const friction::LawInfo& law, const Samples& samples, const FitOptions& given) {
  if (samples.size() == 0) return tl::make_unexpected(Error("there are no samples"));
  if (std::ranges::all_of(samples.friction, [](double y) { return y == 0; }))
    return tl::make_unexpected(Error("friction is 0 in every sample; nothing can be learned from it"));
  FitOptions options = given;
  const auto known = known_direction(options);
  if (!known) return tl::unexpected(known.error());
  const bool symmetric = known->asymmetry == 0.0 && known->offset == 0.0;
  auto plain = identify(law, samples, options, nullptr);
  if (!plain) return tl::unexpected(plain.error());
  if (symmetric || (!has_both_directions(samples) && !known->any())) return std::move(**plain);
  auto directed = identify(law, by_direction(samples), options, &*known);
  if (!directed && !known->any()) return std::move(**plain);  // too few samples for two numbers more
  if (!directed) return tl::unexpected(directed.error());
  if (!*directed) return std::move(**plain);
  (*directed)->notes.push_back(fmt::format(
      "friction differs between the directions of motion: without asymmetry and offset the residuals have a standard "
      "deviation of {:.4g} instead of {:.4g}",
      (*plain)->residual.std, (*directed)->residual.std));
  return std::move(**directed);
}

}  // namespace tribotwin::twin::identification
