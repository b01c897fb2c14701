#include <algorithm>
#include <cmath>

#include <tribotwin/twin/diagnosis/fleet/claims.hpp>
#include <tribotwin/twin/diagnosis/fleet/estimates.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/search.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr std::array persistences{0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98};  ///< of deviations, per day
constexpr std::array<std::size_t, 10> lags{1, 2, 3, 4, 6, 8, 12, 16, 24, 32};            ///< of pairs, in observations
constexpr double collinear = 0.998;   ///< two causes of scatter that agree so well over all pairs cannot be separated
constexpr double floor_share = 1e-3;  ///< minimum of the measurement's share in the scatter
constexpr int between_rounds = 200;
constexpr double improbable = 1e-3;            ///< probability below which a phi is left out
constexpr std::size_t likelihood_rows = 6000;  ///< at most so many take part in the likelihood of the scatter

constexpr int direction_steps = 3;                        ///< of Newton's method, from the variogram's directions
constexpr double rough_lambda = 0.3, fine_lambda = 0.02;  ///< precision of ln lambda
constexpr double alike = 0.02;  ///< of the information about a turn of two components: with less they are not turned
constexpr double longest_step = 0.5;

constexpr int scale_choices = 40;              ///< of k
constexpr double inverse_freedom_step = 0.01;  ///< between their inverses

/// 1 / k is uniform beforehand: tails grow in proportion to it.
double scale_freedom_of(int i) { return i == 0 ? 1e4 : 1 / (inverse_freedom_step * i); }

/// T and T^2 in temperature_unit_K.
Eigen::Vector2d powers(const Row& row) {
  const double t = row.temperature_degC / temperature_unit_K;
  return {t, t * t};
}

/// For one phi: least squares of the pairs' half products on what causes them: measurement, day, slope of the robot.
struct PairSums {
  Eigen::Matrix3d gram = Eigen::Matrix3d::Zero();
  MatrixXd moment;  // 3 x p p

  void add(const Eigen::Vector3d& causes, const VectorXd& half_product, double weight) {
    gram += weight * causes * causes.transpose();
    moment += weight * causes * half_product.transpose();
  }
  /// Coefficients by rows; causes that cannot be separated from an earlier one get 0.
  MatrixXd solution() const {
    std::vector<Index> kept{0};
    for (Index i = 1; i < 3; ++i) {
      const double own = gram(i, i) * gram(0, 0);
      if (own > 1e-12 * gram(0, 0) * gram(0, 0) && std::abs(gram(i, 0)) < collinear * std::sqrt(own)) kept.push_back(i);
    }
    MatrixXd all = MatrixXd::Zero(3, moment.cols());
    all(kept, Eigen::all) = least_squares_solutions(gram(kept, kept), moment(kept, Eigen::all));
    return all;
  }
};

class Variogram {
 public:
  Variogram(const WithinRobots& within, std::size_t which, const RegionModel& model)
      : slopes_(within.slopes.middleCols(regions[which].first, regions[which].count)),
        unit_(within.residual.diagonal().segment(regions[which].first, regions[which].count).cwiseSqrt()),
        which_(which),
        errors_(model, which) {
    const Index p = unit_.size();
    for (auto& s : sums_) s.moment = MatrixXd::Zero(3, p * p);
    mix_ = MatrixXd::Zero(p * p, p * p);
  }

  void add(const Rows& rows) {
    const auto& r = regions[which_];
    MatrixXd rest(r.count, static_cast<Index>(rows.size()));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      VectorXd y = rows[i].logarithmic.segment(r.first, r.count);
      if (std::isfinite(rows[i].temperature_degC)) y -= slopes_.transpose() * powers(rows[i]);
      rest.col(static_cast<Index>(i)) = y.cwiseQuotient(unit_);
      mix(rows[i]);
    }
    for (const std::size_t lag : lags)
      for (std::size_t i = 0; i + lag < rows.size(); ++i)
        add_pair(rows[i], rows[i + lag], rest.col(static_cast<Index>(i)) - rest.col(static_cast<Index>(i + lag)));
  }

  /// W and lambda that belong to persistences[k].
  void finish(std::size_t k, RegionModel& out) const {
    const MatrixXd solution = sums_[k].solution();
    const Index p = unit_.size();
    const auto matrix = [&](Index row) {
      const VectorXd flat = solution.row(row);
      return MatrixXd(flat.reshaped(p, p));
    };
    diagonalise(typical(matrix(0)), matrix(1), out);
    out.persistence = persistences[k];
    out.decouple *= unit_.cwiseInverse().asDiagonal();
  }

 private:
  double v(const Row& row) const { return errors_.scatter(row); }

  /// What the measurement's share of a product of differences is of S_n: K S_n K', here a sum of Kronecker products.
  void mix(const Row& row) {
    const Index p = unit_.size();
    const MatrixXd K = unit_.cwiseInverse().asDiagonal() * errors_.relative_root(row) * unit_.asDiagonal();
    for (Index i = 0; i < p; ++i)
      for (Index k = 0; k < p; ++k) mix_.block(i * p, k * p, p, p) += K(i, k) / v(row) * K;
    ++mixed_;
  }
  /// S_n from its mean over rows.
  MatrixXd typical(const MatrixXd& mean) const {
    const VectorXd flat = square_solution(mix_ / mixed_, mean.reshaped());
    const MatrixXd S = flat.reshaped(mean.rows(), mean.cols());
    return (S + S.transpose()) / 2;
  }

  void add_pair(const Row& a, const Row& b, const VectorXd& difference) {
    const double days = std::abs(b.day - a.day), mean_v = (v(a) + v(b)) / 2;
    const double kelvin = std::isfinite(a.temperature_degC) && std::isfinite(b.temperature_degC)
                              ? (a.temperature_degC - b.temperature_degC) / temperature_unit_K
                              : 0;
    const MatrixXd product = 0.5 * difference * difference.transpose();
    const VectorXd half = product.reshaped();
    for (std::size_t k = 0; k < persistences.size(); ++k)
      sums_[k].add({mean_v, 1 - (days > 0 ? std::pow(persistences[k], days) : 1.0), 0.5 * kelvin * kelvin}, half,
                   1 / (mean_v * mean_v));
  }

  /// W and lambda of S_n and S_d, each made positive.
  static void diagonalise(const MatrixXd& noise, const MatrixXd& day, RegionModel& out) {
    const double total = std::max(noise.trace() + day.trace(), 1e-12) / static_cast<double>(noise.rows());
    const SymmetricEigen n = symmetric_eigen(noise);
    const MatrixXd root = n.vectors * n.values.cwiseMax(floor_share * total).cwiseSqrt().cwiseInverse().asDiagonal() *
                          n.vectors.transpose();
    const SymmetricEigen d = symmetric_eigen(root * day * root);
    out.decouple = d.vectors.transpose() * root;
    out.lambda = d.values.cwiseMax(0);
  }

  const MatrixXd slopes_;
  const VectorXd unit_;
  const std::size_t which_;
  const Errors errors_;
  MatrixXd mix_;
  double mixed_ = 0;
  std::array<PairSums, persistences.size()> sums_;
};

/// One component of z of one robot.
struct Series {
  std::vector<double> days;
  std::vector<std::vector<double>> scatter;  // by component
  MatrixXd columns;                          // regressors, then one column per component
};
Series series_of(const TypeModel& type, std::size_t region, const Errors& errors, const OwnCoordinates& own,
                 const Rows& rows) {
  const Index q = type.knows_temperature ? 2 : 1, p = type.region[region].features();
  Series s{.days = {},
           .scatter = std::vector<std::vector<double>>(static_cast<std::size_t>(p)),
           .columns = MatrixXd(static_cast<Index>(rows.size()), q + p)};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    s.days.push_back(rows[i].day);
    const Small v = errors.variance(rows[i], own.turn);
    for (Index k = 0; k < p; ++k) s.scatter[static_cast<std::size_t>(k)].push_back(v(k));
    s.columns.row(static_cast<Index>(i)) << type.regressors(rows[i]).transpose(),
        (own.turn * type.decoupled(rows[i], region)).transpose();
  }
  return s;
}

/// Restricted log-likelihood of a component for a ratio lambda, with the scale of the scatter at its maximum, which is
/// returned in `scale`.
double restricted_likelihood(const std::vector<Series>& robots, Index q, Index component, double persistence,
                             double lambda, double& scale) {
  RegionModel one{.lambda = VectorXd::Constant(1, lambda), .persistence = persistence};
  double logs = 0, squares = 0, freedom = 0;
  for (const auto& r : robots) {
    MatrixXd some(r.columns.rows(), q + 1);
    some << r.columns.leftCols(q), r.columns.col(q + component);
    double log_variance = 0;
    some = whiten(one, 0, r.days, r.scatter[static_cast<std::size_t>(component)], some, &log_variance);
    // Gram and Schmidt: q is 1 or 2.
    for (Index i = 0; i < q; ++i) {
      const double squared = some.col(i).squaredNorm();
      logs += std::log(std::max(squared, 1e-300));
      for (Index k = i + 1; k <= q; ++k) some.col(k) -= some.col(i) * (some.col(i).dot(some.col(k)) / squared);
    }
    logs += log_variance;
    squares += some.col(q).squaredNorm();
    freedom += static_cast<double>(some.rows() - q);
  }
  scale = squares / freedom;
  return -0.5 * (logs + freedom * (std::log(scale) + 1));
}

/// Z' P Z of the components Z, P the projection of the restricted likelihood of `component`.
MatrixXd restricted_products(const std::vector<Series>& robots, Index q, Index component, double persistence,
                             double lambda) {
  const RegionModel one{.lambda = VectorXd::Constant(1, lambda), .persistence = persistence};
  MatrixXd products;
  for (const auto& r : robots) {
    const Index p = r.columns.cols() - q;
    if (products.size() == 0) products = MatrixXd::Zero(p, p);
    MatrixXd some = whiten(one, 0, r.days, r.scatter[static_cast<std::size_t>(component)], r.columns);
    for (Index i = 0; i < q; ++i) {
      const double squared = std::max(some.col(i).squaredNorm(), 1e-300);
      for (Index k = i + 1; k < q + p; ++k) some.col(k) -= some.col(i) * (some.col(i).dot(some.col(k)) / squared);
    }
    products += some.rightCols(p).transpose() * some.rightCols(p);
  }
  return products;
}

/// The sample in the coordinates z of the region's model.
struct Sample {
  std::vector<Series> robots;
  double freedom = 0;

  Sample(const TypeModel& type, std::size_t region, const std::vector<Rows>& rows_of) {
    const Index p = type.region[region].features();
    const Errors errors(type.region[region], region);
    // The variances of all robots in z: what their components have in common is left out of this likelihood.
    const OwnCoordinates same{.turn = SmallMatrix::Identity(p, p), .lambda = {}};
    for (const Rows& rows : rows_of) {
      freedom += static_cast<double>(static_cast<Index>(rows.size()) - (type.knows_temperature ? 2 : 1));
      robots.push_back(series_of(type, region, errors, same, rows));
    }
  }
};

/// Of ln lambda.
template <class Function>
double most_likely(const Function& likelihood, double precision) {
  return golden_section(likelihood, std::log(1e-3), std::log(1e3), precision);
}

/// One step of Newton's method towards directions W of maximum likelihood, where z_i' P_i z_k = 0 (Pham 2001, with the
/// covariances of days and measurement): z_i + e_ik z_k, pair by pair.
void improve_directions(TypeModel& type, std::size_t region, const std::vector<Rows>& rows) {
  RegionModel& m = type.region[region];
  const Sample sample(type, region, rows);
  const Index q = type.knows_temperature ? 2 : 1, p = m.features();
  std::vector<MatrixXd> products;  // of a typical variance of 1
  VectorXd unit(p);
  for (Index k = 0; k < p; ++k) {
    const auto at = [&](double log_lambda) {
      return restricted_likelihood(sample.robots, q, k, m.persistence, std::exp(log_lambda), unit(k));
    };
    m.lambda(k) = std::exp(most_likely(at, rough_lambda));
    products.push_back(restricted_products(sample.robots, q, k, m.persistence, m.lambda(k)));
    unit(k) = products.back()(k, k) / sample.freedom;
    products.back() /= unit(k);
  }
  const double n = sample.freedom;
  MatrixXd step = MatrixXd::Identity(p, p);
  for (Index i = 0; i < p; ++i)
    for (Index k = i + 1; k < p; ++k) {
      const MatrixXd &P_i = products[static_cast<std::size_t>(i)], &P_k = products[static_cast<std::size_t>(k)];
      const double by_i = P_i(k, k), by_k = P_k(i, i), both = by_i * by_k - n * n;
      // Two components of one lambda are independent in any directions that are at right angles.
      const bool differ = both > alike * n * n;
      const double together = (P_i(i, k) + P_k(i, k)) / (by_i + by_k + 2 * n);
      step(i, k) = -(differ ? (by_k * P_i(i, k) - n * P_k(i, k)) / both : together);
      step(k, i) = -(differ ? (by_i * P_k(i, k) - n * P_i(i, k)) / both : together);
      for (double* e : {&step(i, k), &step(k, i)}) *e = std::clamp(*e, -longest_step, longest_step);
    }
  m.decouple = unit.cwiseSqrt().cwiseInverse().asDiagonal() * step * m.decouple;
}

/// Sets lambda and the scale of every component to their restricted maximum likelihood for the directions W and phi of
/// the region's model. Returns the likelihood of y.
double most_likely_scatter(TypeModel& type, std::size_t region, const std::vector<Rows>& rows) {
  RegionModel& m = type.region[region];
  const Sample sample(type, region, rows);
  const Index q = type.knows_temperature ? 2 : 1, p = m.features();
  double total = sample.freedom * std::log(std::abs(determinant(m.decouple)));
  VectorXd unit(p);
  m.lambda_variance = m.scale_by_lambda = VectorXd(p);
  for (Index k = 0; k < p; ++k) {
    double scale = 1, below = 1, above = 1;
    const auto at = [&](double log_lambda, double& to_scale) {
      return restricted_likelihood(sample.robots, q, k, m.persistence, std::exp(log_lambda), to_scale);
    };
    const double best = most_likely([&](double log_lambda) { return at(log_lambda, scale); }, fine_lambda);
    const double likelihood = at(best, unit(k)), less = at(best - 0.5, below), more = at(best + 0.5, above);
    m.lambda(k) = std::exp(best);
    // The variance of ln lambda is 1 / curvature of the likelihood; the scale moves with it.
    m.lambda_variance(k) = 1 / std::max((2 * likelihood - less - more) / 0.25, 0.1);
    m.scale_by_lambda(k) = std::log(above / below);
    total += likelihood;
  }
  m.decouple = unit.cwiseSqrt().cwiseInverse().asDiagonal() * m.decouple;
  m.noise_freedom = sample.freedom;
  return total;
}

double digamma(double x) {
  double sum = 0;
  for (; x < 8; ++x) sum -= 1 / x;
  const double r = 1 / (x * x);
  return sum + std::log(x) - 0.5 / x - r * (1.0 / 12 - r * (1.0 / 120 - r / 252));
}

/// Log-likelihood of the robots' sums of squares, squares / (d s) ~ F(d, k); terms without k and s are left out.
double scale_likelihood(const std::vector<const RobotSums*>& robots, double k, double s) {
  double sum = static_cast<double>(robots.size()) * (k / 2 * std::log(k * s) - std::lgamma(k / 2));
  for (const auto* r : robots)
    sum += std::lgamma((r->freedom + k) / 2) - (r->freedom + k) / 2 * std::log(k * s + r->squares);
  return sum;
}

/// One round of the EM algorithm's sums.
struct Round {
  MatrixXd gram, squares;  // sum of A - A V A, sum of E[b b']
  VectorXd moment;         // sum of what the mean is solved from

  explicit Round(Index n) : gram(MatrixXd::Zero(n, n)), squares(MatrixXd::Zero(n, n)), moment(VectorXd::Zero(n)) {}
};

}  // namespace

WithinRobots within_robots(const EachRobot& each, bool temperature) {
  Eigen::Matrix2d gram = Eigen::Matrix2d::Zero();
  Eigen::Matrix<double, 2, feature_count> moment = Eigen::Matrix<double, 2, feature_count>::Zero();
  WithinRobots out;
  each([&](const Rows& rows) {
    if (rows.size() < 2) return;
    const auto n = static_cast<double>(rows.size());
    Eigen::Vector2d x_mean = Eigen::Vector2d::Zero();
    Features y_mean = Features::Zero();
    for (const Row& row : rows) {
      if (temperature) x_mean += powers(row) / n;
      y_mean += row.logarithmic / n;
    }
    for (const Row& row : rows) {
      const Eigen::Vector2d x = temperature ? Eigen::Vector2d(powers(row) - x_mean) : Eigen::Vector2d(0, 0);
      const Features y = row.logarithmic - y_mean;
      gram += x * x.transpose(), moment += x * y.transpose(), out.covariance += y * y.transpose();
    }
    out.freedom += n - 1, out.own_freedom += n - (temperature ? 2 : 1);
  });
  if (temperature) {
    const bool curved = gram(0, 1) * gram(0, 1) < 0.9999 * gram(0, 0) * gram(1, 1);
    if (curved)
      out.slopes = least_squares_solutions(gram, moment);
    else
      out.slopes.row(0) = moment.row(0) / gram(0, 0);
  }
  const FeatureMatrix explained = out.slopes.transpose() * gram * out.slopes;
  out.residual = (out.covariance - explained) / std::max(1.0, out.freedom - (temperature ? 2 : 0));
  out.covariance /= std::max(1.0, out.freedom);
  return out;
}

std::vector<RegionModel> learn_noise(const EachRobot& each, const WithinRobots& within, std::size_t region,
                                     TypeModel& type) {
  RegionModel& model = type.region[region];
  Variogram variogram(within, region, model);
  std::vector<Rows> sample;
  std::size_t rows_in_sample = 0;
  each([&](const Rows& rows) {
    variogram.add(rows);
    if (rows_in_sample < likelihood_rows && rows.size() > 2) sample.push_back(rows), rows_in_sample += rows.size();
  });
  std::vector<RegionModel> models;
  for (std::size_t k = 0; k < persistences.size(); ++k) {
    variogram.finish(k, model);
    for (int i = 0; i < direction_steps; ++i) improve_directions(type, region, sample);
    model.probability = most_likely_scatter(type, region, sample);
    models.push_back(model);
  }
  std::ranges::stable_sort(models, std::greater{}, &RegionModel::probability);
  const double highest = models.front().probability;
  double sum = 0;
  for (auto& m : models) sum += m.probability = std::exp(m.probability - highest);
  for (auto& m : models) m.probability /= sum;
  std::erase_if(models, [](const RegionModel& m) { return m.probability < improbable; });
  return models;
}

RobotSums robot_sums(const TypeModel& type, std::size_t region, const Rows& rows) {
  const RegionModel& m = type.region[region];
  const Index q = type.knows_temperature ? 2 : 1, p = m.features(), n = static_cast<Index>(rows.size());
  const Errors errors(m, region);
  const OwnCoordinates own = errors.own(rows, {});
  const Series series = series_of(type, region, errors, own, rows);
  RegionModel component{.lambda = own.lambda, .persistence = m.persistence};
  RobotSums out{.information = MatrixXd::Zero(p * q, p * q), .moment = VectorXd::Zero(p * q)};
  for (Index k = 0; k < p; ++k) {
    MatrixXd some(n, q + 1);
    some << series.columns.leftCols(q), series.columns.col(q + k);
    some = whiten(component, k, series.days, series.scatter[static_cast<std::size_t>(k)], some);
    const MatrixXd gram = some.transpose() * some;
    // Of z: w_k = sum of turn(k, i) z_i.
    for (Index i = 0; i < p; ++i) {
      out.moment.segment(i * q, q) += own.turn(k, i) * gram.col(q).head(q);
      for (Index l = 0; l < p; ++l)
        out.information.block(i * q, l * q, q, q) += own.turn(k, i) * own.turn(k, l) * gram.topLeftCorner(q, q);
    }
    if (n <= q) continue;
    const VectorXd left = least_squares_solution(some.leftCols(q), some.col(q));
    out.squares += (some.col(q) - some.leftCols(q) * left).squaredNorm();
    out.freedom += static_cast<double>(n - q);
  }
  return out;
}

void learn_between(const std::vector<RobotSums>& all, RegionModel& out) {
  std::vector<const RobotSums*> robots;
  for (const auto& r : all) robots.push_back(&r);
  const Index n = all.front().moment.size();
  out.between_freedom = static_cast<double>(robots.size()) - 1;
  out.between = 1e4 * MatrixXd::Identity(n, n);
  const bool borrows = all.size() >= robots_minimum;
  for (int round = 0; round < between_rounds; ++round) {
    Round sums(n);
    const MatrixXd precision = symmetric_inverse(out.between);
    std::vector<MatrixXd> posterior;
    for (const auto* r : robots) {
      posterior.push_back(symmetric_inverse(precision + r->information));
      const MatrixXd& V = posterior.back();
      sums.gram += r->information - r->information * V * r->information;
      sums.moment += r->moment - r->information * (V * r->moment);
    }
    out.mean_error = symmetric_inverse(sums.gram);
    out.mean = out.mean_error * sums.moment;
    if (!borrows) break;
    for (std::size_t i = 0; i < robots.size(); ++i) {
      const MatrixXd &A = robots[i]->information, &V = posterior[i], VA = V * A;
      const VectorXd b = V * (robots[i]->moment - A * out.mean);
      sums.squares += b * b.transpose() + V + VA * out.mean_error * VA.transpose();
    }
    const MatrixXd next = sums.squares / static_cast<double>(robots.size());
    const double change =
        (next.diagonal() - out.between.diagonal()).cwiseQuotient(next.diagonal()).cwiseAbs().maxCoeff();
    out.between = (next + next.transpose()) / 2;
    if (change < 1e-3) break;
  }
  if (!borrows) out.between_freedom = 1e6, out.mean_error.setZero();  // unknown beforehand, not estimated
}

void learn_scale(const std::vector<RobotSums>& all, RegionModel& out) {
  std::vector<const RobotSums*> robots;
  double mean = 0;
  for (const auto& r : all) {
    if (!(r.freedom >= 2) || !(r.squares > 0)) continue;
    robots.push_back(&r);
    mean += std::log(r.squares / r.freedom) - digamma(r.freedom / 2) + std::log(r.freedom / 2);
  }
  if (robots.empty()) return;
  mean /= static_cast<double>(robots.size());
  const auto scale_of = [&](double k) { return std::exp(mean + digamma(k / 2) - std::log(k / 2)); };
  std::array<double, scale_choices> likelihood{};
  for (int i = 0; i < scale_choices; ++i)
    likelihood[i] = scale_likelihood(robots, scale_freedom_of(i), scale_of(scale_freedom_of(i)));
  const double highest = std::ranges::max(likelihood);
  double sum = 0, inverse = 0;
  for (int i = 0; i < scale_choices; ++i) {
    const double probability = std::exp(likelihood[i] - highest);
    sum += probability, inverse += probability / scale_freedom_of(i);
  }
  out.scale_freedom = sum / inverse, out.scale = scale_of(out.scale_freedom);
}

}  // namespace tribotwin::twin::diagnosis::fleet
