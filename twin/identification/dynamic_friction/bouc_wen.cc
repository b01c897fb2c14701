#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/twin/identification/dynamic_friction/bouc_wen.hpp>
#include <tribotwin/twin/identification/dynamic_friction/prediction_error.hpp>
#include <tribotwin/twin/identification/time_series.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::VectorXd;

/// [i][j] of Hysteresis::k. Constants first: of dependent numbers the last ones are not identifiable.
constexpr std::pair<int, int> stiffnesses[] = {{0, 0}, {1, 0}, {2, 0}, {0, 1}, {1, 1}, {2, 1}, {0, 2}, {1, 2}, {2, 2}};
constexpr Index linear_count = std::size(stiffnesses);
/// The nonlinear numbers, then per recording x at its start as a share of the limit.
enum Shape : Index { log_limit, ratio, exponent, share, first_start };

/// No gear of a joint has more.
constexpr double torsion_max_rad = 0.2;

struct Course {
  std::vector<double> torsion, torque, temperature;  ///< torsion as monotone_course leaves it
  std::vector<std::size_t> reversals;
};

transmission::Hysteresis spring_of(const VectorXd& at) {
  const double sum = std::exp(-at(exponent) * at(log_limit)), beta = sum / (1 + at(ratio));
  return {.w = at(share), .beta = beta, .gamma = at(ratio) * beta, .n = at(exponent)};
}

/// Prediction at some samples of each course. x is advanced from one to the next.
class Loops {
 public:
  /// At about `target` samples, reversals included.
  Loops(std::span<const Course> courses, std::size_t target) {
    std::size_t all = 0;
    for (const Course& c : courses) all += c.torsion.size();
    const std::size_t stride = std::max<std::size_t>(1, all / target);
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

/// Local parabolas over the largest window that removes no more than the noise.
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

/// Appends the extremes that differ by more than `clear` from their neighbours.
void add_reversals(const std::vector<double>& course, double clear, std::vector<std::size_t>& reversals) {
  std::size_t lowest = 0, highest = 0;
  int direction = 0;
  for (std::size_t i = 1; i < course.size(); ++i) {
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
}

/// The nearest course that rises or falls from the first value to the last: pool adjacent violators.
void make_monotone(std::span<double> course) {
  struct Pool {
    double sum;
    std::size_t count;
    double mean() const { return sum / static_cast<double>(count); }
  };
  if (course.empty()) return;
  const double sign = course.back() >= course.front() ? 1 : -1;
  std::vector<Pool> pools;
  for (const double value : course) {
    pools.push_back({sign * value, 1});
    while (pools.size() > 1 && pools[pools.size() - 2].mean() > pools.back().mean()) {
      const Pool last = pools.back();
      pools.pop_back();
      pools.back().sum += last.sum, pools.back().count += last.count;
    }
  }
  std::size_t i = 0;
  for (const Pool& pool : pools)
    for (std::size_t c = 0; c < pool.count; ++c) course[i++] = sign * pool.mean();
}

/// The recordings as courses, with their extremes.
struct Data {
  std::vector<Course> courses;
  std::size_t samples = 0, reversals = 0;
  double reach = 0;  ///< largest |torsion| [rad]
  double moved = 0;  ///< largest change of the torsion in a recording [rad]
  double coldest = 1e300, hottest = -1e300;
  bool thermal = false;  ///< temperatures were recorded
};

Data data_of(std::span<const LoopRecording> recordings) {
  Data d{.courses = {}, .thermal = !recordings.empty() && !recordings[0].temperature_degC.empty()};
  for (const LoopRecording& r : recordings) {
    Course& c = d.courses.emplace_back();
    c.torsion = monotone_course(r.torsion_rad, c.reversals);
    c.torque = r.torque_nm;
    c.temperature = d.thermal ? r.temperature_degC : std::vector<double>(r.torsion_rad.size(), 0);
    d.samples += c.torsion.size(), d.reversals += c.reversals.size();
    for (const double phi : c.torsion)
      d.reach = std::max(d.reach, std::abs(phi)), d.moved = std::max(d.moved, std::abs(phi - c.torsion[0]));
    for (const double T : c.temperature) d.coldest = std::min(d.coldest, T), d.hottest = std::max(d.hottest, T);
  }
  return d;
}

/// Why these recordings cannot identify a spring.
Result<void> require_loops(const Data& d) {
  if (!(d.moved > 0)) return work_failed("the torsion never changes: a spring is identified from its loading");
  if (d.reversals < 2)
    return work_failed(
        fmt::format("the torsion reverses {} times: only closed loops separate loss from stiffness; load the gear in "
                    "both directions, through at least one whole loop",
                    d.reversals));
  const std::size_t minimum = 10 * static_cast<std::size_t>(linear_count + first_start);
  if (d.samples < minimum)
    return work_failed(fmt::format("{} samples are too few for a loop's shape: record {} or more", d.samples, minimum));
  return {};
}

/// The highest power of the temperature that is identifiable: as in fit.cc, a curvature needs a third temperature, a
/// slope a second.
int temperature_powers(const Data& d) {
  const double span = d.hottest - d.coldest;
  if (!d.thermal || span < 1e-6 * (1 + std::abs(d.hottest))) return 0;
  const bool middle = std::ranges::any_of(d.courses, [&](const Course& c) {
    return std::ranges::any_of(c.temperature,
                               [&](double T) { return T > d.coldest + 0.05 * span && T < d.hottest - 0.05 * span; });
  });
  return middle ? 2 : 1;
}

/// Fixes the stiffnesses of higher powers at 0, with a note.
void fix_unidentifiable(const Data& d, Simulated& model, std::vector<std::string>& notes) {
  const int powers = temperature_powers(d);
  std::vector<std::string> fixed;
  for (std::size_t k = 0; k < std::size(stiffnesses); ++k)
    if (stiffnesses[k].second > powers)
      model.linear_free[k] = false, fixed.push_back(fmt::format("k{}{}", stiffnesses[k].first, stiffnesses[k].second));
  if (fixed.empty()) return;
  const std::string why = !d.thermal ? std::string("no temperature was recorded")
                          : powers   ? fmt::format("all samples are near {:.4g} or {:.4g} degC", d.coldest, d.hottest)
                                     : fmt::format("all samples are at {:.4g} degC", d.coldest);
  notes.push_back(fmt::format("{}: {} not identifiable; fixed at 0", why, joined(fixed)));
}

Simulated model_of(const Data& d, unsigned threads) {
  const auto recordings = static_cast<Index>(d.courses.size());
  Simulated model{.low = VectorXd(first_start + recordings),
                  .high = VectorXd(first_start + recordings),
                  .linear_free = std::vector<bool>(linear_count, true),
                  .threads = threads};
  model.low << std::log(1e-3 * d.reach), -0.99, 1, 0, VectorXd::Constant(recordings, -1);
  model.high << std::log(30 * d.reach), 1, 10, 1, VectorXd::Constant(recordings, 1);
  return model;
}

/// `model` at the samples of `loops`, which must outlive the result.
Simulated on(const Loops& loops, Simulated model) {
  model.measured = loops.measured();
  model.predict = [&loops](const VectorXd& at) { return loops(at); };
  return model;
}

std::vector<VectorXd> starts_of(double reach, Index size) {
  std::vector<VectorXd> starts;
  for (const double limit : {0.03, 0.1, 0.2, 0.4, 0.8, 1.6})
    for (const double gamma : {-0.5, 0.1, 0.7})
      for (const double n : {1.1, 1.6, 3.0})
        for (const double w : {0.2, 0.5, 0.8}) {
          VectorXd& at = starts.emplace_back(VectorXd::Zero(size));
          at(log_limit) = std::log(limit * reach), at(ratio) = gamma, at(exponent) = n, at(share) = w;
        }
  return starts;
}

/// Why the recordings show no hysteresis: a spring without loss predicts the torque as well.
Result<void> require_hysteresis(const Data& d, const Simulated& model, const Simulation& found) {
  VectorXd without = found.nonlinear;
  without(share) = 1;
  const double elastic = simulate(model, without).cost, n = static_cast<double>(d.samples);
  // Four numbers and the starts reduce the cost by as much by chance in one of some ten thousand recordings.
  const double by_chance = 25 + 3 * static_cast<double>(d.courses.size());
  if (elastic - found.cost > by_chance * found.cost / n) return {};
  return work_failed(
      fmt::format("there is no hysteresis in these data: a spring without loss predicts the torque to {:.3g} Nm, one "
                  "with it to {:.3g} Nm",
                  std::sqrt(elastic / n), std::sqrt(found.cost / n)));
}

transmission::Hysteresis spring_from(const Data& d, const Simulation& found) {
  transmission::Hysteresis h = spring_of(found.nonlinear);
  for (Index k = 0; k < linear_count; ++k) h.k[stiffnesses[k].first][stiffnesses[k].second] = found.linear(k);
  h.torsion_max_rad = d.reach;
  if (d.thermal) h.temperature_min_degC = d.coldest, h.temperature_max_degC = d.hottest;
  return h;
}

/// Parameters of the plugin from the coordinates of the search: values, statuses, the derivatives for the covariance,
/// and what their intervals are compared with.
struct Conversion {
  std::vector<Estimate> parameters;
  Eigen::MatrixXd to;  ///< parameters x coordinates
  std::vector<double> scale;
  std::vector<int> polynomial;  ///< as in Evidence
};

std::string loop_advice(const Estimate& e, Lack lack) {
  if (e.name.starts_with('k') && !e.name.ends_with('0')) return "record loops at more temperatures, further apart";
  if (lack == Lack::structured) return {};
  return e.name.starts_with('k') ? "record loops of more, and of different torsion"
                                 : "record larger loops, and small ones within them";
}

Conversion converted(const transmission::Hysteresis& h, const Simulation& found, const Uncertainty& sure,
                     double torque_rms_nm) {
  Conversion out{.parameters = {},
                 .to = Eigen::MatrixXd::Zero(linear_count + 4, linear_count + found.nonlinear.size()),
                 .scale = {},
                 .polynomial = {0, 0, 0, 1, 1, 1, 2, 2, 2, -1, -1, -1, -1}};
  const auto status = [&](Index coordinate) { return sure.status[static_cast<std::size_t>(coordinate)]; };
  const auto add = [&](std::string name, std::string unit, double value, Status as) {
    out.parameters.push_back({.name = std::move(name), .unit = std::move(unit), .value = value, .status = as});
    return static_cast<Index>(out.parameters.size()) - 1;
  };
  static constexpr const char* units[] = {"Nm/rad", "Nm/rad^2", "Nm/rad^4"};
  static constexpr const char* per_K[] = {"", "/K", "/K^2"};
  // The interval of a stiffness is compared with the one that gives the whole torque, that of w with its range. beta
  // and gamma are some limit^-n: n moves them by factors without moving the loop.
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      const Index k = std::ranges::find(stiffnesses, std::pair(i, j)) - std::begin(stiffnesses);
      out.to(add(fmt::format("k{}{}", i, j), std::string(units[i]) + per_K[j], h.k[i][j], status(k)), k) = 1;
      out.scale.push_back(torque_rms_nm / sure.effect[static_cast<std::size_t>(k)]);
    }
  out.scale.insert(out.scale.end(), {1, 4 * h.beta, 4 * h.beta, 0});
  // beta + gamma = limit^-n
  const Index L = linear_count + log_limit, R = linear_count + ratio, N = linear_count + exponent,
              W = linear_count + share;
  out.to(add("w", "1", h.w, status(W)), W) = 1;
  const Index beta = add("beta", "rad^-n", h.beta, status(L)),
              gamma = add("gamma", "rad^-n", h.gamma, status(L) == Status::estimated ? status(R) : status(L));
  out.to(beta, L) = -h.n * h.beta, out.to(beta, N) = -found.nonlinear(log_limit) * h.beta,
               out.to(beta, R) = -h.beta / (1 + found.nonlinear(ratio));
  out.to.row(gamma) = found.nonlinear(ratio) * out.to.row(beta);
  out.to(gamma, R) += h.beta;
  out.to(add("n", "1", h.n, status(N)), N) = 1;
  return out;
}

}  // namespace

Result<LoopRecordings> read_loops(std::span<const std::filesystem::path> files, const TableOptions& options) {
  LoopRecordings all;
  for (const auto& file : files) {
    const auto table =
        read_time_series(file, {"time_s", "torsion_rad", "torque_nm"}, {"temperature_degC"}, all.notes, options);
    if (!table) return tl::unexpected(table.error());
    const auto& c = table->columns;
    const auto largest = [](const std::vector<double>& x) {
      return std::abs(std::ranges::max(x, {}, [](double v) { return std::abs(v); }));
    };
    if (largest(c[1]) > torsion_max_rad)
      return tl::unexpected(
          fmt::format("{}: torsion_rad reaches {:.4g}, but the torsion of a gear is below {:g} rad; are these degrees, "
                      "or the motor's angle?",
                      file.string(), largest(c[1]), torsion_max_rad));
    if (auto problem = implausible_temperature(file, "temperature_degC", c[3]))
      return tl::unexpected(std::move(*problem));
    if (std::inner_product(c[1].begin(), c[1].end(), c[2].begin(), 0.0) < 0)
      return tl::unexpected(
          fmt::format("{}: torque_nm mostly has the opposite sign of torsion_rad (motor angle / gear ratio - arm "
                      "angle); a spring has the same sign",
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
  if (n < 4) return {torsion.begin(), torsion.end()};
  double squares = 0;
  for (std::size_t i = 3; i < n; ++i)
    squares += std::pow(torsion[i] - 3 * torsion[i - 1] + 3 * torsion[i - 2] - torsion[i - 3], 2);
  // White noise has third differences of variance 20; its extremes in long recordings are some 8.5 sigma apart.
  const double noise = std::sqrt(squares / (20 * static_cast<double>(n - 3)));
  std::vector<double> course = smoothed(torsion, noise);
  const std::size_t first = reversals.size();
  add_reversals(course, 9 * noise, reversals);
  std::size_t begin = 0;
  for (std::size_t k = first; k <= reversals.size(); ++k) {
    const std::size_t end = k < reversals.size() ? reversals[k] + 1 : n;
    make_monotone(
        {course.begin() + static_cast<std::ptrdiff_t>(begin), course.begin() + static_cast<std::ptrdiff_t>(end)});
    begin = end;
  }
  return course;
}

Result<HysteresisFit> fit_hysteresis(std::span<const LoopRecording> recordings, unsigned threads) {
  const Data data = data_of(recordings);
  if (const auto ok = require_loops(data); !ok) return tl::unexpected(ok.error());
  HysteresisFit result;
  Simulated model = model_of(data, threads);
  fix_unidentifiable(data, model, result.notes);
  constexpr std::size_t thinned = 1500;
  const Loops every(data.courses, data.samples), some(data.courses, thinned);
  const Simulated all = on(every, model), few = on(some, model);
  const Simulation found = search(few, all, starts_of(data.reach, all.low.size()));
  if (const auto ok = require_hysteresis(data, all, found); !ok) return tl::unexpected(ok.error());

  const Uncertainty sure = uncertainty(all, found);
  transmission::Hysteresis& h = result.hysteresis = spring_from(data, found);
  double signal = 0;
  for (const double tau : all.measured) signal += tau * tau / static_cast<double>(data.samples);
  Conversion parameters = converted(h, found, sure, std::sqrt(signal));
  result.parameters = std::move(parameters.parameters);
  conclude(all, found, sure, parameters.to,
           {.parameters = {}, .covariance = {}, .scale = parameters.scale, .polynomial = parameters.polynomial},
           loop_advice, result);
  result.normalised_mse = 1 - result.r_squared;
  h.drive = "motor";
  if (const auto loaded = transmission::make_hysteresis("", transmission::configuration_of(h)); !loaded)
    result.notes.push_back(fmt::format("a model would not load this spring: {}", loaded.error().message));
  return result;
}

}  // namespace tribotwin::twin::identification
