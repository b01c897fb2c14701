#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/identification/dynamic_friction/bouc_wen.hpp>
#include <tribotwin/twin/identification/dynamic_friction/prediction_error.hpp>
#include <tribotwin/twin/identification/time_series.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::VectorXd;

/// Of the linear numbers: constants first, for what the data cannot tell is what comes last. [i][j] of Hysteresis::k.
constexpr std::pair<int, int> stiffnesses[] = {{0, 0}, {1, 0}, {2, 0}, {0, 1}, {1, 1}, {2, 1}, {0, 2}, {1, 2}, {2, 2}};
constexpr Index linear_count = std::size(stiffnesses);
/// The nonlinear ones; then a share of the limit per recording, x at its start.
enum Shape : Index { log_limit, ratio, exponent, share, first_start };

/// What no joint's gear yields.
constexpr double torsion_most_rad = 0.2;

struct Course {
  std::vector<double> torsion, torque, temperature;  ///< torsion as monotone_course leaves it
  std::vector<std::size_t> reversals;
};

transmission::Hysteresis spring_of(const VectorXd& at) {
  const double sum = std::exp(-at(exponent) * at(log_limit)), beta = sum / (1 + at(ratio));
  return {.w = at(share), .beta = beta, .gamma = at(ratio) * beta, .n = at(exponent)};
}

/// The torsions and what of them linear numbers multiply, at some samples of each course. x is advanced from one to the
/// next.
class Loops {
 public:
  Loops(std::span<const Course> courses, std::size_t most) {
    std::size_t all = 0;
    for (const Course& c : courses) all += c.torsion.size();
    const std::size_t stride = std::max<std::size_t>(1, all / most);
    for (const Course& c : courses) {
      for (std::size_t i = 0, r = 0; i < c.torsion.size(); ++i) {
        const bool turns = r < c.reversals.size() && c.reversals[r] == i;
        r += turns;
        if (i % stride && !turns) continue;
        torsion_.push_back(c.torsion[i]), torque_.push_back(c.torque[i]), temperature_.push_back(c.temperature[i]);
      }
      ends_.push_back(torsion_.size());
    }
  }

  Prediction operator()(const VectorXd& at) const {
    const transmission::Hysteresis h = spring_of(at);
    const auto rows = static_cast<Index>(torsion_.size());
    Prediction p{.known = VectorXd::Zero(rows), .basis = Eigen::MatrixXd(rows, linear_count)};
    std::size_t i = 0;
    for (std::size_t r = 0; r < ends_.size(); ++r) {
      double x = at(first_start + static_cast<Index>(r)) * h.limit_rad();
      for (const std::size_t begin = i; i < ends_[r]; ++i) {
        if (i > begin) x = transmission::advance(h, x, torsion_[i] - torsion_[i - 1]);
        const double stretch = h.w * torsion_[i] + (1 - h.w) * x, size = std::abs(torsion_[i]), T = temperature_[i];
        const double by_torsion[] = {stretch, stretch * size, stretch * size * size * size},
                     by_temperature[] = {1, T, T * T};
        for (Index k = 0; k < linear_count; ++k)
          p.basis(static_cast<Index>(i), k) = by_torsion[stiffnesses[k].first] * by_temperature[stiffnesses[k].second];
      }
    }
    return p;
  }
  VectorXd measured() const { return Eigen::Map<const VectorXd>(torque_.data(), static_cast<Index>(torque_.size())); }

 private:
  std::vector<double> torsion_, torque_, temperature_;
  std::vector<std::size_t> ends_;
};

/// Through local parabolas over as many samples as can be without more than the noise being taken away.
std::vector<double> smoothed(std::span<const double> x, double noise) {
  std::vector<double> best(x.begin(), x.end());
  for (const int m : {2, 4, 8, 16}) {
    const auto width = static_cast<std::size_t>(m);
    if (x.size() < 4 * width) break;
    std::vector<double> y(x.begin(), x.end());
    double squares = 0;
    for (std::size_t i = width; i + width < x.size(); ++i) {
      double sum = 0;
      for (int j = -m; j <= m; ++j)
        sum += (3 * m * m + 3 * m - 1 - 5 * j * j) * x[i + static_cast<std::size_t>(j + m) - width];
      y[i] = 3 * sum / ((2 * m + 3) * (2 * m + 1) * (2 * m - 1));
      squares += (y[i] - x[i]) * (y[i] - x[i]);
    }
    if (squares > 1.05 * noise * noise * static_cast<double>(x.size())) break;
    best = std::move(y);
  }
  return best;
}

}  // namespace

Result<LoopRecordings> read_loops(std::span<const std::filesystem::path> files) {
  LoopRecordings all;
  for (const auto& file : files) {
    const auto table = read_time_series(file, {"time_s", "torsion_rad", "torque_nm"}, {"temperature_degC"}, all.notes);
    if (!table) return tl::unexpected(table.error());
    const auto& c = table->columns;
    const auto largest = [](const std::vector<double>& x) {
      return std::abs(std::ranges::max(x, {}, [](double v) { return std::abs(v); }));
    };
    if (largest(c[1]) > torsion_most_rad)
      return tl::unexpected(
          fmt::format("{}: torsion_rad reaches {:.4g}, where {:g} rad is more than a gear yields; are these degrees, "
                      "or the motor's angle?",
                      file.string(), largest(c[1]), torsion_most_rad));
    if (auto problem = implausible_temperature(file, "temperature_degC", c[3]))
      return tl::unexpected(std::move(*problem));
    if (std::inner_product(c[1].begin(), c[1].end(), c[2].begin(), 0.0) < 0)
      return tl::unexpected(
          fmt::format("{}: torque_nm is mostly of the sign opposite to torsion_rad (motor angle / gear ratio - arm "
                      "angle); a spring has the same",
                      file.string()));
    all.recordings.push_back({c[1], c[2], c[3]});
    if (all.recordings.back().temperature_degC.empty() != all.recordings.front().temperature_degC.empty())
      return tl::unexpected(fmt::format("{}: {} a column temperature_degC, {} {}", file.string(),
                                        c[3].empty() ? "lacks" : "has", files[0].string(),
                                        c[3].empty() ? "has one" : "does not"));
  }
  return all;
}

std::vector<double> monotone_course(std::span<const double> torsion, std::vector<std::size_t>& reversals) {
  const std::size_t n = torsion.size();
  std::vector<double> course(torsion.begin(), torsion.end());
  if (n < 4) return course;
  double squares = 0;
  for (std::size_t i = 3; i < n; ++i)
    squares += std::pow(torsion[i] - 3 * torsion[i - 1] + 3 * torsion[i - 2] - torsion[i - 3], 2);
  // White noise has third differences of variance 20. In long recordings its extremes are some 8.5 sigma apart.
  const double noise = std::sqrt(squares / (20 * static_cast<double>(n - 3))), clear = 9 * noise;
  course = smoothed(torsion, noise);
  const std::size_t first = reversals.size();
  std::size_t lowest = 0, highest = 0;
  int direction = 0;
  for (std::size_t i = 1; i < n; ++i) {
    if (course[i] > course[highest]) highest = i;
    if (course[i] < course[lowest]) lowest = i;
    if (direction >= 0 && course[highest] - course[i] > clear && highest > 0) {
      reversals.push_back(highest);
      direction = -1, lowest = highest = i;
    } else if (direction <= 0 && course[i] - course[lowest] > clear && lowest > 0) {
      reversals.push_back(lowest);
      direction = 1, lowest = highest = i;
    }
  }
  // Pool adjacent violators between them.
  struct Pool {
    double sum;
    std::size_t count;
    double mean() const { return sum / static_cast<double>(count); }
  };
  std::vector<Pool> pools;
  std::size_t begin = 0;
  for (std::size_t k = first; k <= reversals.size(); ++k) {
    const std::size_t end = k < reversals.size() ? reversals[k] + 1 : n;
    const double sign = course[end - 1] >= course[begin] ? 1 : -1;
    pools.clear();
    for (std::size_t i = begin; i < end; ++i) {
      pools.push_back({sign * course[i], 1});
      while (pools.size() > 1 && pools[pools.size() - 2].mean() > pools.back().mean()) {
        const Pool last = pools.back();
        pools.pop_back();
        pools.back().sum += last.sum, pools.back().count += last.count;
      }
    }
    std::size_t i = begin;
    for (const Pool& pool : pools)
      for (std::size_t c = 0; c < pool.count; ++c) course[i++] = sign * pool.mean();
    begin = end;
  }
  return course;
}

Result<HysteresisFit> fit_hysteresis(std::span<const LoopRecording> recordings, unsigned threads) {
  HysteresisFit result;
  std::vector<Course> courses;
  std::size_t samples = 0, reversals = 0;
  double reach = 0, coldest = 1e300, hottest = -1e300, moved = 0;
  const bool thermal = !recordings.empty() && !recordings[0].temperature_degC.empty();
  for (const LoopRecording& r : recordings) {
    Course& c = courses.emplace_back();
    c.torsion = monotone_course(r.torsion_rad, c.reversals);
    c.torque = r.torque_nm;
    c.temperature = thermal ? r.temperature_degC : std::vector<double>(r.torsion_rad.size(), 0);
    samples += c.torsion.size(), reversals += c.reversals.size();
    for (const double phi : c.torsion)
      reach = std::max(reach, std::abs(phi)), moved = std::max(moved, std::abs(phi - c.torsion[0]));
    for (const double T : c.temperature) coldest = std::min(coldest, T), hottest = std::max(hottest, T);
  }
  if (!(moved > 0))
    return tl::unexpected(std::string("the torsion never changes: nothing can be learned of a spring at rest"));
  if (reversals < 2)
    return tl::unexpected(
        fmt::format("the torsion reverses {} times: only closed loops tell loss from stiffness; load the gear both "
                    "ways, at least once around",
                    reversals));
  const std::size_t least = 10 * static_cast<std::size_t>(linear_count + first_start);
  if (samples < least)
    return tl::unexpected(fmt::format("{} samples cannot tell a loop's shape: record {} or more", samples, least));

  const auto starts_of = static_cast<Index>(courses.size());
  Simulated all{.low = VectorXd(first_start + starts_of),
                .high = VectorXd(first_start + starts_of),
                .linear_free = std::vector<bool>(linear_count, true),
                .threads = threads};
  all.low << std::log(1e-3 * reach), -0.99, 1, 0, VectorXd::Constant(starts_of, -1);
  all.high << std::log(30 * reach), 1, 10, 1, VectorXd::Constant(starts_of, 1);
  // As in fit.cc: a curvature needs a third temperature, a slope a second.
  const double span = hottest - coldest;
  std::vector<std::string> held;
  const bool middle = std::ranges::any_of(courses, [&](const Course& c) {
    return std::ranges::any_of(c.temperature,
                               [&](double T) { return T > coldest + 0.05 * span && T < hottest - 0.05 * span; });
  });
  const int powers = !thermal || span < 1e-6 * (1 + std::abs(hottest)) ? 0 : middle ? 2 : 1;
  for (std::size_t k = 0; k < std::size(stiffnesses); ++k)
    if (stiffnesses[k].second > powers)
      all.linear_free[k] = false, held.push_back(fmt::format("k{}{}", stiffnesses[k].first, stiffnesses[k].second));
  if (!held.empty())
    result.notes.push_back(fmt::format("{}: {} cannot be told and are held at 0",
                                       !thermal ? std::string("no temperature was recorded")
                                       : powers
                                           ? fmt::format("all samples are near {:.4g} or {:.4g} degC", coldest, hottest)
                                           : fmt::format("all samples are at {:.4g} degC", coldest),
                                       fmt::join(held, ", ")));

  constexpr std::size_t thinned = 1500;
  const Loops every(courses, samples), some(courses, thinned);
  all.measured = every.measured();
  all.predict = [&every](const VectorXd& at) { return every(at); };
  Simulated few = all;
  few.measured = some.measured();
  few.predict = [&some](const VectorXd& at) { return some(at); };
  std::vector<VectorXd> starts;
  for (const double limit : {0.03, 0.1, 0.2, 0.4, 0.8, 1.6})
    for (const double gamma : {-0.5, 0.1, 0.7})
      for (const double n : {1.1, 1.6, 3.0})
        for (const double w : {0.2, 0.5, 0.8}) {
          VectorXd& at = starts.emplace_back(VectorXd::Zero(all.low.size()));
          at(log_limit) = std::log(limit * reach), at(ratio) = gamma, at(exponent) = n, at(share) = w;
        }
  const Simulation found = search(few, all, starts);

  VectorXd without = found.nonlinear;
  without(share) = 1;
  const double elastic = simulate(all, without).cost, n = static_cast<double>(samples);
  // Four numbers and the starts would take away as much by chance once in some ten thousand recordings.
  const double by_chance = 25 + 3 * static_cast<double>(starts_of);
  if (!(elastic - found.cost > by_chance * found.cost / n))
    return tl::unexpected(
        fmt::format("there is no hysteresis in these data: a spring without loss predicts the torque to {:.3g} Nm, one "
                    "with it to {:.3g} Nm",
                    std::sqrt(elastic / n), std::sqrt(found.cost / n)));

  const Uncertainty is_worth = uncertainty(all, found);
  // From the coordinates of the search to the parameters of the plugin, with beta + gamma = limit^-n.
  transmission::Hysteresis& h = result.hysteresis = spring_of(found.nonlinear);
  for (Index k = 0; k < linear_count; ++k) h.k[stiffnesses[k].first][stiffnesses[k].second] = found.linear(k);
  h.torsion_max_rad = reach;
  if (thermal) h.temperature_min_degC = coldest, h.temperature_max_degC = hottest;
  const Index coordinates = linear_count + first_start + starts_of, count = linear_count + 4;
  Eigen::MatrixXd to = Eigen::MatrixXd::Zero(count, coordinates);
  const auto status = [&](Index coordinate) { return is_worth.status[static_cast<std::size_t>(coordinate)]; };
  const auto add = [&](std::string name, std::string unit, double value, Status as) {
    result.parameters.push_back({.name = std::move(name), .unit = std::move(unit), .value = value, .status = as});
    return static_cast<Index>(result.parameters.size()) - 1;
  };
  static constexpr const char* units[] = {"Nm/rad", "Nm/rad^2", "Nm/rad^4"};
  static constexpr const char* per_K[] = {"", "/K", "/K^2"};
  std::vector<double> effect;  // of one unit, root mean square [Nm]
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      const Index k = std::ranges::find(stiffnesses, std::pair(i, j)) - std::begin(stiffnesses);
      to(add(fmt::format("k{}{}", i, j), std::string(units[i]) + per_K[j], h.k[i][j], status(k)), k) = 1;
      effect.push_back(is_worth.effect[static_cast<std::size_t>(k)]);
    }
  const Index L = linear_count + log_limit, R = linear_count + ratio, N = linear_count + exponent,
              W = linear_count + share;
  to(add("w", "1", h.w, status(W)), W) = 1;
  const Index beta = add("beta", "rad^-n", h.beta, status(L)),
              gamma = add("gamma", "rad^-n", h.gamma, status(L) == Status::estimated ? status(R) : status(L));
  to(beta, L) = -h.n * h.beta, to(beta, N) = -found.nonlinear(log_limit) * h.beta,
           to(beta, R) = -h.beta / (1 + found.nonlinear(ratio));
  to.row(gamma) = found.nonlinear(ratio) * to.row(beta);
  to(gamma, R) += h.beta;
  to(add("n", "1", h.n, status(N)), N) = 1;
  // Unknown is what is as uncertain as the number may be large, of stiffnesses what is worth the torque itself.
  double signal = 0;
  for (const double tau : all.measured) signal += tau * tau / n;
  std::vector<double> widest;
  for (const double of_one : effect) widest.push_back(std::sqrt(signal) / of_one);
  widest.insert(widest.end(), {0.25, h.beta, h.beta, h.n});
  conclude(all, found, is_worth, to, widest, result);
  result.normalised_mse = 1 - result.r_squared;
  h.drive = "motor";
  if (const auto loaded = transmission::make_hysteresis("", transmission::configuration_of(h)); !loaded)
    result.notes.push_back(fmt::format("a model would not load this spring: {}", loaded.error().message));
  return result;
}

}  // namespace tribotwin::twin::identification
