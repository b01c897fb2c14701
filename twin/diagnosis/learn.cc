#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/learn.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::diagnosis {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using Problem = std::optional<std::string>;

/// Minimum scatter of the indicators: encoders and fits of the levels have a resolution.
constexpr std::array<double, indicator_count> relative_floor{0.05, 0.05, 0.01}, absolute_floor{1e-3, 1e-6, 1e-4};

bool singular(const MatrixXd& covariance) {
  const VectorXd unit = covariance.diagonal().cwiseSqrt().cwiseInverse();
  return !unit.allFinite() || symmetric_eigenvalues(unit.asDiagonal() * covariance * unit.asDiagonal())(0) < 1e-7;
}

/// Oracle approximating shrinkage (Chen 2010) of a covariance towards its mean variance times the
/// identity, in coordinates in which the target is the identity.
double shrink(FeatureMatrix& covariance, const FeatureMatrix& target, double n) {
  const FeatureMatrix L = target.llt().matrixL();
  const auto p = static_cast<double>(covariance.rows());
  FeatureMatrix S = L.triangularView<Eigen::Lower>().solve(covariance);
  S = L.triangularView<Eigen::Lower>().solve(S.transpose()).eval();
  const double trace = S.trace(), squares = S.squaredNorm();
  const double share =
      std::min(1.0, ((1 - 2 / p) * squares + trace * trace) / ((n + 1 - 2 / p) * (squares - trace * trace / p)));
  S = (1 - share) * S + share * trace / p * FeatureMatrix::Identity();
  covariance = L * S * L.transpose();
  return share;
}

std::vector<std::size_t> rows_with(const std::vector<double>& distances, double limit) {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < distances.size(); ++i)
    if (distances[i] <= limit) rows.push_back(i);
  return rows;
}

/// Robust regression of y on x by the minimum covariance determinant (Rousseeuw 1999), reweighted.
class CleanRows {
 public:
  CleanRows(const MatrixXd& x, const MatrixXd& y, const VectorXd& scatter)
      : x_(x), y_(y), scatter_(scatter), count_(static_cast<std::size_t>(x.rows())), half_((3 * count_) / 4) {}

  /// The rows that are not outliers, ascending.
  std::vector<std::size_t> find() const {
    std::vector<std::size_t> rows = nearest(start());
    for (int round = 0; round < 50; ++round) {
      auto next = nearest(distances(rows));
      if (next == rows) break;
      rows = std::move(next);
    }
    const std::vector<double> d = distances(rows);
    // The covariance of the inner rows is too small; the median distance gives the factor.
    const auto freedom = static_cast<double>(y_.cols());
    const double factor = identification::median_of(d) / chi_squared_median(freedom);
    return readmitted(rows_with(d, chi_squared_quantile(freedom, 0.999) * factor));
  }

 private:
  /// Squared distance of every row from the regression through some.
  std::vector<double> distances(const std::vector<std::size_t>& rows) const {
    const Baseline b = regression(x_(rows, Eigen::all), y_(rows, Eigen::all), scatter_(rows));
    const MatrixXd weight = inverse(b.covariance);
    std::vector<double> d;
    for (Index i = 0; i < x_.rows(); ++i) {
      const VectorXd r = y_.row(i).transpose() - b.predicted(x_.row(i).transpose());
      d.push_back(r.dot(weight * r) / scatter_(i));
    }
    return d;
  }

  /// The three quarters of the rows with the smallest distances.
  std::vector<std::size_t> nearest(const std::vector<double>& d) const {
    std::vector<std::size_t> order(count_);
    std::iota(order.begin(), order.end(), 0u);
    std::ranges::stable_sort(order, {}, [&](std::size_t i) { return d[i]; });
    order.resize(half_);
    std::ranges::sort(order);
    return order;
  }

  /// Largest deviation from a column's median in units of its median deviation, without the slope over temperature.
  std::vector<double> start() const {
    std::vector<double> d(count_, 0.0);
    for (Index k = 0; k < y_.cols(); ++k) {
      VectorXd column = y_.col(k);
      if (x_.cols() > 1) {  // Theil and Sen: the median of all slopes
        std::vector<double> slopes;
        for (Index i = 0; i < x_.rows(); ++i)
          for (Index j = 0; j < i; ++j)
            if (std::abs(x_(i, 1) - x_(j, 1)) > 1) slopes.push_back((column(i) - column(j)) / (x_(i, 1) - x_(j, 1)));
        if (!slopes.empty()) column -= identification::median_of(slopes) * x_.col(1);
      }
      const double middle = identification::median_of({column.begin(), column.end()});
      std::vector<double> off;
      for (const double v : column) off.push_back(std::abs(v - middle));
      const double unit = identification::median_of(off);
      for (std::size_t i = 0; i < count_; ++i) d[i] = std::max(d[i], off[i] / std::max(unit, 1e-12));
    }
    return d;
  }

  /// Few inner rows make the region narrow: rows within the prediction limit of the kept ones come back.
  std::vector<std::size_t> readmitted(const std::vector<std::size_t>& kept) const {
    const Baseline b = regression(x_(kept, Eigen::all), y_(kept, Eigen::all), scatter_(kept));
    const double limit = b.limit(1e-3);
    const MatrixXd weight = inverse(b.covariance);
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < count_; ++i) {
      const auto row = static_cast<Index>(i);
      const VectorXd at = x_.row(row), r = y_.row(row).transpose() - b.predicted(at);
      if (r.dot(weight * r) <= limit * b.variance(at, scatter_(row))) rows.push_back(i);
    }
    return rows;
  }

  const MatrixXd x_, y_;
  const VectorXd scatter_;
  const std::size_t count_, half_;
};

const char* const record_cold_to_hot =
    "record unloaded curves from a cold start to thermal equilibrium, 20 or so, each with speeds from below to far "
    "above the Stribeck velocity";

/// Why the files are not of one joint in one unit.
Problem mixed(std::span<const ObservationFile> files, std::string& joint, double& torque_max_nm) {
  const ObservationFile *named = nullptr, *scaled = nullptr;
  for (const auto& f : files) {
    const std::string& file = f.observations.front().file;
    if (!joint.empty() && !f.joint.empty() && f.joint != joint)
      return fmt::format("{}: is of joint '{}', {} of '{}'; a healthy state is that of one joint: learn each by itself",
                         file, f.joint, named ? named->observations.front().file : "--joint", joint);
    if (!f.joint.empty() && !named) named = &f, joint = f.joint;
    if (torque_max_nm > 0 && f.torque_max_nm > 0 && std::abs(f.torque_max_nm / torque_max_nm - 1) > 1e-3)
      return fmt::format(
          "{}: friction_nm / friction_norm says torque_max {:.4g} Nm, {} {:.4g} Nm; these are different joints or "
          "units: learn each joint by itself",
          file, f.torque_max_nm, scaled ? scaled->observations.front().file : "another says", torque_max_nm);
    if (f.torque_max_nm > 0 && !scaled) scaled = &f, torque_max_nm = f.torque_max_nm;
  }
  return {};
}

/// A healthy joint's friction at standstill and its Stribeck velocity do not change threefold from cold to hot.
Problem far_from_the_rest(const std::vector<const Observation*>& all) {
  for (const auto& [feature, hint] : {std::pair{1, "Nm, or parts of torque_max"}, {2, "motor side, rad/s"}}) {
    std::vector<double> values;
    for (const auto* o : all) values.push_back(o->features(feature));
    const double middle = identification::median_of(values);
    for (const auto* o : all)
      if (const double ratio = o->features(feature) / middle; !(ratio < 3 && ratio > 1.0 / 3))
        return fmt::format(
            "{}: {} is {:.4g} {} where the others have {:.4g}: another joint or another unit ({}); learn from one "
            "joint in one unit",
            o->name(), feature_names[static_cast<std::size_t>(feature)], o->features(feature),
            feature_units[static_cast<std::size_t>(feature)], middle, hint);
  }
  return {};
}

Problem loaded_among(const std::vector<const Observation*>& all) {
  std::vector<double> loads;
  for (const auto* o : all)
    if (o->indicators[load]) loads.push_back(*o->indicators[load]);
  if (loads.empty()) return {};
  const double middle = identification::median_of(loads);
  for (const auto* o : all)
    if (o->indicators[load] && *o->indicators[load] > middle + std::max(0.1 * middle, 0.02))
      return fmt::format(
          "{}: carries a load of {:.3g} of torque_max where the others have {:.3g}; the healthy state is learned "
          "without payload: leave this curve out and give it as --loaded, from which the effect of load is learned",
          o->name(), *o->indicators[load], middle);
  return {};
}

/// Effect of load on the features: regression of the baseline's residuals on the load beyond the healthy one.
Problem learn_load(std::span<const ObservationFile> loaded, HealthyState& h) {
  Features sum = Features::Zero();
  double squares = 0;
  if (!h.indicators[load])
    return std::string("--loaded: the healthy curves have no column load_norm; record the load with every curve");
  for (const auto& file : loaded)
    for (const auto& o : file.observations) {
      if (!o.indicators[load])
        return fmt::format("{}: has no column load_norm; record the load with every curve", o.name());
      const double extra = h.load_term(*o.indicators[load] - h.indicators[load]->mean);
      sum += extra * h.deviation(o);
      squares += extra * extra;
    }
  if (squares < 0.02 * 0.02)
    return fmt::format(
        "--loaded: these curves carry no more load than the healthy ones ({:.3g} of torque_max): record some with a "
        "payload",
        h.indicators[load]->mean);
  h.load_effect.head(3) = sum.head(3) / squares;  // load does not change the lubricant (Zhou 2024, Table IV)
  h.load_measured = true;
  return {};
}

using Observations = std::vector<const Observation*>;

/// Why a state cannot be learned from these curves, apart from their temperatures.
Problem unlearnable(const Observations& all) {
  for (const auto* o : all)
    if (!o->weak.empty())
      return fmt::format(
          "{}: {}: not identifiable from its levels; record speeds from well below the Stribeck velocity "
          "(about 1 rad/s, motor side) to well into viscous friction (about 100 rad/s), 10 levels or "
          "more",
          o->name(), joined(o->weak));
  if (all.size() < observations_minimum)
    return fmt::format("{} curve(s): a healthy state needs {} or more, {} for a useful one: {}", all.size(),
                       observations_minimum, observations_usual, record_cold_to_hot);
  if (auto p = far_from_the_rest(all)) return p;
  return loaded_among(all);
}

/// The range of temperatures, and whether the baseline has a temperature term.
Problem learn_temperatures(const Observations& all, HealthyState& h) {
  const auto known = std::ranges::count_if(all, [](const auto* o) { return o->temperature_degC.has_value(); });
  if (known == 0) return {};
  if (static_cast<std::size_t>(known) < all.size()) {
    const auto* without = *std::ranges::find_if(all, [](const auto* o) { return !o->temperature_degC; });
    return fmt::format(
        "{}: has no column temperature_degC, others have: record it with every curve, or take it out of all",
        without->name());
  }
  const auto [low, high] = std::ranges::minmax(all, {}, [](const auto* o) { return *o->temperature_degC; });
  h.temperature_low_degC = *low->temperature_degC, h.temperature_high_degC = *high->temperature_degC;
  h.knows_temperature = h.temperature_high_degC - h.temperature_low_degC >= temperature_span_K;
  return {};
}

/// One row per observation.
struct Rows {
  MatrixXd regressors, logarithmic, features;
  MatrixXd scatter;  ///< of both regions

  void keep(const std::vector<std::size_t>& kept) {
    for (auto* m : {&regressors, &logarithmic, &features, &scatter}) *m = MatrixXd((*m)(kept, Eigen::all));
  }
};

/// Sets the scatter of a typical fit, which the rows are relative to.
Rows rows_of(const Observations& all, HealthyState& h) {
  for (std::size_t which = 0; which < regions.size(); ++which) {
    std::vector<double> s;
    for (const auto* o : all) s.push_back(shape_scatter(o->shape, regions[which]));
    h.scatter[which] = std::ranges::all_of(s, [](double v) { return v > 0; }) ? identification::median_of(s) : 0;
  }
  const auto count = static_cast<Index>(all.size());
  Rows rows{.regressors = MatrixXd(count, h.regressors({}).size()),
            .logarithmic = MatrixXd(count, feature_count),
            .features = MatrixXd(count, feature_count),
            .scatter = MatrixXd(count, 2)};
  for (Index i = 0; i < count; ++i) {
    const Observation& o = *all[static_cast<std::size_t>(i)];
    rows.regressors.row(i) = h.regressors(o.temperature_degC);
    rows.logarithmic.row(i) = o.logarithmic();
    rows.features.row(i) = o.features;
    rows.scatter.row(i) << h.scatter_of(o, 0), h.scatter_of(o, 1);
  }
  return rows;
}

/// Leaves out observations that are outliers in either region.
Problem leave_out(Observations& all, Rows& rows, HealthyState& h) {
  const auto good1 = CleanRows(rows.regressors, rows.logarithmic.leftCols(3), rows.scatter.col(0)).find(),
             good2 = CleanRows(rows.regressors, rows.logarithmic.rightCols(2), rows.scatter.col(1)).find();
  std::vector<std::size_t> kept;
  std::ranges::set_intersection(good1, good2, std::back_inserter(kept));
  h.left_out = all.size() - kept.size();
  if (kept.size() < observations_minimum || 3 * kept.size() < 2 * all.size())
    return fmt::format(
        "only {} of {} curves agree with each other: these are no {} healthy observations of one joint; {}",
        kept.size(), all.size(), all.size(), record_cold_to_hot);
  rows.keep(kept);
  Observations some;
  for (const std::size_t i : kept) some.push_back(all[i]);
  all = std::move(some);
  return {};
}

/// Zhou 2024's mean and covariance, and the baseline of each region.
Problem learn_regions(const Rows& rows, HealthyState& h) {
  const auto n = static_cast<double>(h.observations);
  h.mean = rows.features.colwise().mean().transpose();
  const MatrixXd off = rows.features.rowwise() - h.mean.transpose();
  h.covariance = off.transpose() * off / (n - 1);
  for (std::size_t which = 0; which < regions.size(); ++which) {
    const auto& r = regions[which];
    h.region[which] = regression(rows.regressors, rows.logarithmic.middleCols(r.first, r.count),
                                 rows.scatter.col(static_cast<Index>(which)));
    if (singular(h.region[which].covariance) || singular(h.covariance.block(r.first, r.first, r.count, r.count)))
      return fmt::format(
          "the {} curves do not scatter in all of {}: they are copies of each other or lie in one line (collinear), "
          "and do not show the normal scatter; {}",
          h.observations,
          joined(
              std::span(feature_names).subspan(static_cast<std::size_t>(r.first), static_cast<std::size_t>(r.count))),
          record_cold_to_hot);
  }
  return {};
}

/// Covariance of both regions together, from observations scaled to scatter 1.
Problem learn_covariance(const Observations& all, const Rows& rows, HealthyState& h) {
  FeatureMatrix claimed = FeatureMatrix::Zero();
  h.together.setZero();
  for (std::size_t i = 0; i < all.size(); ++i) {
    Features unit;
    unit.head(3).setConstant(1 / std::sqrt(rows.scatter(static_cast<Index>(i), 0)));
    unit.tail(2).setConstant(1 / std::sqrt(rows.scatter(static_cast<Index>(i), 1)));
    const Features e = unit.cwiseProduct(h.deviation(*all[i]));
    h.together += e * e.transpose() / h.degrees_of_freedom();
    claimed +=
        FeatureMatrix(unit.asDiagonal() * all[i]->shape * unit.asDiagonal()) / static_cast<double>(h.observations);
  }
  if (claimed.diagonal().minCoeff() > 0 && claimed.llt().info() == Eigen::Success)
    h.shrinkage = shrink(h.together, claimed, h.degrees_of_freedom());
  if (singular(h.together))
    return fmt::format("the features of the {} curves lie in one line (collinear); {}", all.size(), record_cold_to_hot);
  return {};
}

/// Of the indicators that every observation has.
void learn_indicators(const Observations& all, HealthyState& h) {
  const auto n = static_cast<double>(all.size());
  for (std::size_t k = 0; k < indicator_count; ++k) {
    std::vector<double> values;
    for (const auto* o : all)
      if (o->indicators[k]) values.push_back(*o->indicators[k]);
    if (values.size() < all.size()) continue;
    double mean = 0, squares = 0;
    for (const double v : values) mean += v / n;
    for (const double v : values) squares += (v - mean) * (v - mean) / (n - 1);
    h.indicators[k] = HealthyState::IndicatorState{
        .mean = mean, .deviation = std::max({std::sqrt(squares), relative_floor[k] * mean, absolute_floor[k]})};
  }
}

}  // namespace

Result<HealthyState> learn(std::span<const ObservationFile> healthy, std::span<const ObservationFile> loaded,
                           double load_sensitivity, const LearnOptions& options) {
  HealthyState h{.load_sensitivity = load_sensitivity, .lever_m = options.lever_m};
  Observations all;
  for (const auto& file : healthy) {
    h.data.push_back(file.observations.front().file);
    for (const auto& o : file.observations) all.push_back(&o);
  }
  if (auto p = mixed(healthy, h.joint, h.torque_max_nm)) return tl::unexpected(*p);
  if (auto p = mixed(loaded, h.joint, h.torque_max_nm)) return tl::unexpected(*p);
  if (auto p = unlearnable(all)) return tl::unexpected(*p);
  if (auto p = learn_temperatures(all, h)) return tl::unexpected(*p);
  Rows rows = rows_of(all, h);
  if (options.robust)
    if (auto p = leave_out(all, rows, h)) return tl::unexpected(*p);
  h.observations = all.size();
  if (auto p = learn_regions(rows, h)) return tl::unexpected(*p);
  if (auto p = learn_covariance(all, rows, h)) return tl::unexpected(*p);
  learn_indicators(all, h);
  h.load_effect.head(2).setConstant(h.sensitivity_at_mean_load());
  if (!loaded.empty())
    if (auto p = learn_load(loaded, h)) return tl::unexpected(*p);
  return h;
}

}  // namespace tribotwin::twin::diagnosis
