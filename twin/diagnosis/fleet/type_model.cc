#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/claims.hpp>
#include <tribotwin/twin/diagnosis/fleet/estimates.hpp>
#include <tribotwin/twin/diagnosis/healthy.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr std::size_t scatter_samples = 20000;
constexpr std::size_t robots_in_sums = 2000;  ///< at most so many robots (and once more) take part in their estimates

/// Temperatures, typical scatter and load.
void learn_conditions(const EachRobot& each, TypeModel& t) {
  bool all_warm = true;
  double load_sum = 0, load_count = 0;
  std::array<std::vector<double>, 2> scatter;
  std::array<bool, 2> claimed{true, true};
  std::array<MeanClaim, 2> claims;
  each([&](const Rows& rows) {
    if (rows.empty()) return;
    ++t.robots;
    for (const Row& row : rows) {
      const double T = row.temperature_degC;
      if (!std::isfinite(T)) all_warm = false;
      const bool first = t.observations++ == 0;
      if (std::isfinite(T) && (first || T < t.temperature_low_degC)) t.temperature_low_degC = T;
      if (std::isfinite(T) && (first || T > t.temperature_high_degC)) t.temperature_high_degC = T;
      if (std::isfinite(row.load_norm)) load_sum += row.load_norm, ++load_count;
      for (std::size_t r = 0; r < 2; ++r) {
        claimed[r] = claimed[r] && row.scatter[r] > 0;
        if (scatter[r].size() < scatter_samples) scatter[r].push_back(row.scatter[r]), claims[r].add(row, r);
      }
    }
  });
  t.knows_temperature = all_warm && t.temperature_high_degC - t.temperature_low_degC >= temperature_span_K;
  if (load_count > 0) t.load_norm = load_sum / load_count;
  for (std::size_t r = 0; r < 2; ++r) {
    if (!claimed[r] || scatter[r].empty()) continue;
    t.region[r].typical_scatter = identification::median_of(scatter[r]);
    t.region[r].typical_root = std::sqrt(t.region[r].typical_scatter) * Eigen::MatrixXd(claims[r].root());
  }
}

/// The model with each persistence that learn_noise found possible, in one reading of the rows per step.
void learn_region(const EachRobot& each, const WithinRobots& within, std::size_t which, TypeModel& t) {
  t.region[which].curvature = within.slopes.row(1).segment(regions[which].first, regions[which].count).transpose();
  std::vector<TypeModel> variants;
  for (auto& m : learn_noise(each, within, which, t)) {
    variants.push_back(t);
    variants.back().region[which] = std::move(m);
  }
  const std::size_t step = 1 + t.robots / robots_in_sums;
  std::vector<std::vector<RobotSums>> sums(variants.size());
  std::size_t robot = 0;
  each([&](const Rows& rows) {
    if (rows.empty() || robot++ % step != 0) return;
    for (std::size_t k = 0; k < variants.size(); ++k) sums[k].push_back(robot_sums(variants[k], which, rows));
  });
  for (std::size_t k = 0; k < variants.size(); ++k) {
    RegionModel& m = variants[k].region[which];
    learn_scale(sums[k], m);
    // With S_n and S_d times s the typical robot has a scale of 1.
    m.decouple /= std::sqrt(m.scale);
    for (auto& s : sums[k]) s.moment /= std::sqrt(m.scale);
    m.scale = 1;
    learn_between(sums[k], m);
    if (k > 0) t.others[which].push_back(m);
  }
  t.region[which] = variants.front().region[which];
}

}  // namespace

VectorXd TypeModel::regressors(const Row& row) const {
  VectorXd x = VectorXd::Ones(knows_temperature ? 2 : 1);
  const double middle = (temperature_low_degC + temperature_high_degC) / 2;
  if (knows_temperature) x(1) = (row.temperature_degC - middle) / temperature_unit_K;
  return x;
}

VectorXd TypeModel::decoupled(const Row& row, std::size_t which) const {
  const RegionModel& m = region[which];
  VectorXd y = row.logarithmic.segment(regions[which].first, regions[which].count);
  if (knows_temperature) {
    const double t = regressors(row)(1);
    y -= t * t * m.curvature;
  }
  return m.decouple * y;
}

Spread spread_of(const TypeModel& type) {
  const RegionModel& m = type.region[0];
  const Index q = m.regressors();
  const VectorXd back = inverse(m.decouple).row(0);  // ln Fc of z
  VectorXd level = VectorXd::Zero(m.mean.size());
  for (Index k = 0; k < m.features(); ++k) level(k * q) = back(k);
  return {.between = std::sqrt(level.dot(m.between * level)),
          .days = std::sqrt(back.cwiseAbs2().dot(m.lambda)),
          .measurement = back.norm()};
}

MatrixXd whiten(const RegionModel& m, Index component, std::span<const double> days, std::span<const double> scatter,
                const MatrixXd& columns, double* log_variance) {
  MatrixXd out(columns.rows(), columns.cols());
  const double lambda = m.lambda(component);
  Eigen::RowVectorXd state = Eigen::RowVectorXd::Zero(columns.cols());
  double variance = lambda;
  for (Index i = 0; i < columns.rows(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (i > 0) {
      const double gap = std::max(0.0, days[at] - days[at - 1]), kept = gap == 1  ? m.persistence
                                                                        : gap > 0 ? std::pow(m.persistence, gap)
                                                                                  : 1;
      state *= kept;
      variance = kept * kept * variance + lambda * (1 - kept * kept);
    }
    const double total = variance + scatter[at];
    if (log_variance) *log_variance += std::log(total);
    const Eigen::RowVectorXd innovation = columns.row(i) - state;
    out.row(i) = innovation / std::sqrt(total);
    state += variance / total * innovation;
    variance *= scatter[at] / total;
  }
  return out;
}

Result<TypeModel> learn_type(const EachRobot& each) {
  TypeModel t;
  learn_conditions(each, t);
  const WithinRobots within = within_robots(each, t.knows_temperature);
  if (within.own_freedom < static_cast<double>(observations_minimum))
    return tl::unexpected(Error(fmt::format(
        "{} curve(s) of {} robot(s): the scatter from curve to curve needs {} or more beyond the first{} of each "
        "robot; record some robots repeatedly, on different days, cold to hot",
        t.observations, t.robots, observations_minimum, t.knows_temperature ? " two" : "")));
  if (!(within.residual.diagonal().minCoeff() > 1e-18))
    return tl::unexpected(
        Error(fmt::format("the {} curves of {} robot(s) do not scatter: they are copies of each other, and do not show "
                          "the normal scatter",
                          t.observations, t.robots)));
  t.within = within.covariance;
  for (std::size_t r = 0; r < regions.size(); ++r) learn_region(each, within, r, t);
  if (t.robots < robots_minimum)
    t.notes.push_back(
        fmt::format("{} robots are too few to borrow from each other; {} or more do", t.robots, robots_minimum));
  if (!t.knows_temperature)
    t.notes.emplace_back(
        "the curves span less than 5 K or have no temperature_degC: effects of temperature cannot be separated from "
        "faults");
  return t;
}

}  // namespace tribotwin::twin::diagnosis::fleet
