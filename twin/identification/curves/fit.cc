#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include <fmt/format.h>

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

/// One identification: the stages of `fit`, in the order of its calls.
class Identification {
 public:
  Identification(const friction::LawInfo& law, const Samples& samples, const FitOptions& options)
      : law_(law),
        samples_(samples),
        options_(options),
        weights_(options.weigh ? weights_of(samples) : std::vector<double>{}),
        problem_(law, samples, weights_, options.threads) {
    result_.samples = samples.size();
  }

  Result<void> fix_known();
  void fix_conventions();
  void fix_without_effect() { fix_without_variation(law_, samples_, problem_, result_); }
  Result<void> check_count() const;
  void minimise();
  Result<void> estimate_covariance();
  void fill_parameters();
  void make_law();
  Fit report();

 private:
  /// Fixes a parameter that the others can replace at 0 or, where it is nonlinear, at `value`.
  void fix_dependent(std::size_t parameter, double value);
  Estimate estimate(std::size_t parameter, double value, double interval) const;

  const friction::LawInfo& law_;
  const Samples& samples_;
  const FitOptions& options_;
  const std::vector<double> weights_;
  Separable problem_;
  std::set<std::size_t> fixed_;         ///< by the user or by convention
  std::vector<std::string> dependent_;  ///< parameters that others can replace
  Point point_;
  std::vector<double> residuals_;
  std::vector<std::size_t> coordinates_;  ///< that are estimated
  MatrixXd information_, covariance_;     ///< of the coordinates; of the parameters
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
  result_.unidentifiable.emplace_back(law_.parameters[i].name);
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
    information_ = problem_.information(point_, coordinates_);
    variance = point_.cost / std::max(1.0, n - static_cast<double>(coordinates_.size()));
  } else {
    problem_.set_weights(weights_);
    point_ = problem_.again(point_);
    variance = robust_variance(residuals_, weights_, options_.loss, point_.cost / n);
    information_ = problem_.information(point_, coordinates_);
  }
  result_.estimated = coordinates_.size();
  if (samples_.size() < coordinates_.size() + 1) return too_few(samples_.size(), coordinates_.size());

  const auto count = static_cast<Index>(law_.parameters.size());
  covariance_ = MatrixXd::Zero(count, count);
  const MatrixXd inverse = pseudo_inverse(information_) * variance;
  for (std::size_t a = 0; a < coordinates_.size(); ++a)
    for (std::size_t b = 0; b < coordinates_.size(); ++b)
      covariance_(static_cast<Index>(coordinates_[a]), static_cast<Index>(coordinates_[b])) =
          inverse(static_cast<Index>(a), static_cast<Index>(b));
  covariance_ = problem_.to_parameters() * covariance_ * problem_.to_parameters().transpose();
  result_.condition_number = 1;
  if (!coordinates_.empty()) {
    const VectorXd unit = information_.diagonal().cwiseSqrt().cwiseInverse();
    const VectorXd eigenvalues = symmetric_eigenvalues(unit.asDiagonal() * information_ * unit.asDiagonal());
    result_.condition_number = std::sqrt(eigenvalues.maxCoeff() / std::max(eigenvalues.minCoeff(), 1e-300));
  }
  return {};
}

/// `interval`: half width of the confidence interval in sigmas.
Estimate Identification::estimate(std::size_t j, double value, double interval) const {
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
    e.sigma = std::sqrt(std::max(0.0, covariance_(i, i)));
    e.low = e.value - interval * e.sigma;
    e.high = e.value + interval * e.sigma;
  }
  return e;
}

void Identification::fill_parameters() {
  const auto n = static_cast<double>(samples_.size());
  const VectorXd values = problem_.parameters(point_.values);
  const double interval = interval_sigmas(n - static_cast<double>(coordinates_.size()));
  const double mean_square =
      std::transform_reduce(samples_.friction.begin(), samples_.friction.end(), samples_.friction.begin(), 0.0) / n;
  for (std::size_t j = 0; j < law_.parameters.size(); ++j) {
    Estimate e = estimate(j, values(static_cast<Index>(j)), interval);
    if (const auto found = std::ranges::find(coordinates_, j); found != coordinates_.end()) {
      // Its uncertainty moves friction by more than friction itself, or exceeds a value that can only be positive.
      const auto at = static_cast<Index>(found - coordinates_.begin());
      const double effect = std::sqrt(information_(at, at) / n);
      if (e.sigma * effect > std::sqrt(mean_square) ||
          (!problem_.is_linear(j) && law_.parameters[j].minimum >= 0 && e.sigma > std::abs(e.value)))
        result_.unidentifiable.push_back(e.name);
    }
    result_.parameters.push_back(std::move(e));
  }
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
  describe_residuals(samples_, residuals_, weights_, options_.loss, result_);
  if (result_.condition_number > 1e4)
    result_.notes.push_back(
        fmt::format("condition number {:.1e}: parameters compensate each other; their individual values mean little",
                    result_.condition_number));
  std::set<std::string> once;
  std::erase_if(result_.unidentifiable, [&](const std::string& name) { return !once.insert(name).second; });
  return std::move(result_);
}

}  // namespace

Result<Fit> fit(const friction::LawInfo& law, const Samples& samples, const FitOptions& options) {
  if (samples.size() == 0) return tl::make_unexpected(Error("there are no samples"));
  if (std::ranges::all_of(samples.friction, [](double y) { return y == 0; }))
    return tl::make_unexpected(Error("friction is 0 in every sample; nothing can be learned from it"));
  Identification identification(law, samples, options);
  if (auto ok = identification.fix_known(); !ok) return tl::unexpected(ok.error());
  identification.fix_conventions();
  identification.fix_without_effect();
  if (auto ok = identification.check_count(); !ok) return tl::unexpected(ok.error());
  identification.minimise();
  if (auto ok = identification.estimate_covariance(); !ok) return tl::unexpected(ok.error());
  identification.fill_parameters();
  identification.make_law();
  return identification.report();
}

}  // namespace tribotwin::twin::identification
