#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/judge.hpp>
#include <tribotwin/twin/diagnosis/fleet/model_text.hpp>
#include <tribotwin/twin/diagnosis/fleet/overview/overview.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

constexpr std::int64_t ever = std::numeric_limits<std::int64_t>::max();
constexpr std::size_t own_minimum = 3;  ///< healthy curves from which a joint has a level of its own
constexpr double day_s = 86400;

/// Regressors of a row: T and T^2 from the middle, 0 where the temperature is not known.
Eigen::Vector2d terms(const Row& row, double middle_degC) {
  const double t = std::isfinite(row.temperature_degC) ? (row.temperature_degC - middle_degC) / 10 : 0;
  return {t, t * t};
}

/// All robots of a type, one joint.
struct Pool {
  double middle_degC = 0;
  Eigen::Matrix<double, 2, feature_count> slopes = Eigen::Matrix<double, 2, feature_count>::Zero();
  Eigen::Array<double, feature_count, 1> mean = Eigen::Array<double, feature_count, 1>::Zero(), between = mean,
                                         within = mean;
  std::size_t robots = 0;
};

/// Calls visit with the healthy rows of every robot.
template <class Visit>
void each_robot(Store& store, const std::vector<std::int64_t>& joints, const Visit& visit) {
  for (const auto id : joints)
    if (const Rows rows = store.rows(id, true, -ever, ever); !rows.empty()) visit(rows);
}

Eigen::Array<double, feature_count, 1> mean_of(const Rows& rows, const Pool& pool) {
  Eigen::Array<double, feature_count, 1> sum = Eigen::Array<double, feature_count, 1>::Zero();
  for (const Row& row : rows)
    sum += row.logarithmic.array() - (pool.slopes.transpose() * terms(row, pool.middle_degC)).array();
  return sum / static_cast<double>(rows.size());
}

Pool pool_of(Store& store, const std::vector<std::int64_t>& joints) {
  Pool pool;
  double sum = 0, count = 0;
  each_robot(store, joints, [&](const Rows& rows) {
    ++pool.robots;
    for (const Row& row : rows)
      if (std::isfinite(row.temperature_degC)) sum += row.temperature_degC, ++count;
  });
  if (pool.robots == 0) return pool;
  pool.middle_degC = count > 0 ? sum / count : 0;
  Eigen::Matrix2d xx = Eigen::Matrix2d::Zero();
  Eigen::Matrix<double, 2, feature_count> xy = Eigen::Matrix<double, 2, feature_count>::Zero();
  each_robot(store, joints, [&](const Rows& rows) {
    Eigen::Vector2d x = Eigen::Vector2d::Zero();
    Features y = Features::Zero();
    for (const Row& row : rows) x += terms(row, pool.middle_degC), y += row.logarithmic;
    x /= static_cast<double>(rows.size()), y /= static_cast<double>(rows.size());
    for (const Row& row : rows) {
      const Eigen::Vector2d d = terms(row, pool.middle_degC) - x;
      xx += d * d.transpose();
      xy += d * (row.logarithmic - y).transpose();
    }
  });
  pool.slopes = xx.completeOrthogonalDecomposition().solve(xy);
  Eigen::Array<double, feature_count, 1> squares = Eigen::Array<double, feature_count, 1>::Zero(), means = squares,
                                         mean_squares = squares;
  double freedom = 0;
  each_robot(store, joints, [&](const Rows& rows) {
    const auto mean = mean_of(rows, pool);
    means += mean, mean_squares += mean.square();
    for (const Row& row : rows)
      squares +=
          (row.logarithmic.array() - (pool.slopes.transpose() * terms(row, pool.middle_degC)).array() - mean).square();
    freedom += static_cast<double>(rows.size()) - 1;
  });
  const auto n = static_cast<double>(pool.robots);
  pool.mean = means / n;
  pool.between = n > 1 ? ((mean_squares - n * pool.mean.square()) / (n - 1)).max(0).eval() : pool.between;
  pool.within = squares / std::max(freedom - 2, 1.0);
  return pool;
}

std::optional<HealthyLevel> level_of(const Pool& pool, const Rows& healthy) {
  if (pool.robots == 0) return std::nullopt;
  HealthyLevel level{.middle_degC = pool.middle_degC};
  const bool own = healthy.size() >= own_minimum;
  if (own) level.curves = healthy.size();
  const auto mean = own ? mean_of(healthy, pool) : pool.mean;
  for (int f = 0; f < feature_count; ++f) {
    const auto k = static_cast<std::size_t>(f);
    level.mean[k] = mean(f), level.slope[k] = pool.slopes(0, f), level.curvature[k] = pool.slopes(1, f);
    const double of_mean = own ? pool.within(f) / static_cast<double>(healthy.size())
                               : pool.between(f) * (1 + 1 / static_cast<double>(pool.robots));
    level.deviation[k] = std::sqrt(pool.within(f) + of_mean);
  }
  return level;
}

using TypeKey = std::pair<std::string, std::string>;

/// Pools of all types of joints, each made when it is first asked for.
class Pools {
 public:
  explicit Pools(Store& store) : store_(store) {
    for (auto& j : store.joints()) ids_[{j.type, j.joint}].push_back(j.id);
  }
  const Pool& operator()(const JointName& j) {
    const TypeKey key{j.type, j.joint};
    auto& pool = pools_[key];
    if (!pool) pool = pool_of(store_, ids_[key]);
    return *pool;
  }

 private:
  Store& store_;
  std::map<TypeKey, std::vector<std::int64_t>> ids_;
  std::map<TypeKey, std::optional<Pool>> pools_;
};

JointGlance glance(Store& store, Pools& pools, const JointName& joint, std::int64_t from_s, std::int64_t to_s) {
  JointGlance g{.joint = joint, .change = {}, .last_s = {}};
  const Rows recent = store.rows(joint.id, false, -ever, to_s);
  if (recent.empty()) return g;
  g.last_s = static_cast<std::int64_t>(std::llround(recent.back().day * day_s));
  const auto level = level_of(pools(joint), store.rows(joint.id, true, -ever, ever));
  double sum = 0;
  for (const Row& row : recent) {
    if (row.day * day_s < static_cast<double>(from_s)) continue;
    ++g.curves;
    if (level) sum += level->departure(row, 0);
  }
  if (g.curves == 0 || !level) return g;
  const double mean = sum / static_cast<double>(g.curves);
  if (!std::isfinite(mean)) return g;
  g.change = std::expm1(mean);
  g.deviations = mean / level->deviation[0];
  return g;
}

void require_store(const std::filesystem::path& file) {
  std::error_code error;
  if (std::filesystem::is_regular_file(file, error) && std::filesystem::file_size(file, error) == 0)
    throw InputError(fmt::format("{}: is empty; give the store that 'tribotwin fleet' wrote", file.string()));
  if (!std::filesystem::is_regular_file(file, error))
    throw InputError(
        fmt::format("{}: there is no such file; give the store that 'tribotwin fleet' wrote", file.string()));
}

}  // namespace

double HealthyLevel::departure(const Row& row, int feature) const {
  const auto k = static_cast<std::size_t>(feature);
  const Eigen::Vector2d x = terms(row, middle_degC);
  return row.logarithmic(feature) - mean[k] - slope[k] * x(0) - curvature[k] * x(1);
}

Overview overview_of(const std::filesystem::path& file, const SurveyOptions& options) {
  require_store(file);
  Store store(file.string());  // without commit(): what the surveys write into it is gone at the end
  Overview o;
  o.past = store.checks();
  try {
    o.check = check_fleet(&store, options);
    o.watch = watch_fleet(&store, options);
  } catch (const InputError& e) {
    const std::string what = e.what(), place = file.string() + ": ";
    throw InputError(what.starts_with(place) ? what : place + what);
  }
  const std::int64_t to_s = o.check.time_s,
                     from_s = to_s - static_cast<std::int64_t>(std::llround(options.days * day_s)) + 1;
  Pools pools(store);
  for (const auto& joint : store.joints()) o.joints.push_back(glance(store, pools, joint, from_s, to_s));
  o.files = store.files(from_s, to_s);
  o.notes = store.notes(from_s, to_s);
  return o;
}

std::vector<Detail> details_of(const std::filesystem::path& file, const std::vector<std::int64_t>& ids,
                               const SurveyOptions& options) {
  require_store(file);
  Store store(file.string());
  Pools pools(store);
  const CusumTail tail;
  std::map<TypeKey, TypeModel> models;
  for (const auto& text : store.model_texts()) {
    auto m = from_text(text, store.name());
    const TypeKey key{m.type, m.joint};
    models.emplace(key, std::move(m));
  }
  std::map<std::int64_t, JointName> names;
  for (auto& j : store.joints()) names.emplace(j.id, std::move(j));
  const std::int64_t end = options.time_s ? *options.time_s : store.newest().value_or(ever);
  std::vector<Detail> all;
  for (const auto id : ids) {
    Detail d;
    d.track.joint = names.at(id);
    d.track.healthy = store.rows(id, true, -ever, ever);
    d.track.recent = store.rows(id, false, -ever, end);
    d.track.level = level_of(pools(d.track.joint), d.track.healthy);
    if (const auto model = models.find({d.track.joint.type, d.track.joint.joint}); model != models.end())
      for (const auto& step : Judge(model->second).watch(d.track.healthy, d.track.recent, tail).steps) {
        d.cusum.day.push_back(step.day);
        d.cusum.sum.push_back(step.sum);
      }
    all.push_back(std::move(d));
  }
  return all;
}

}  // namespace tribotwin::twin::diagnosis::fleet
