#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/twin/identification/calibration.hpp>
#include <tribotwin/twin/identification/posterior.hpp>
#include <tribotwin/twin/numerics/cma_es.hpp>
#include <tribotwin/twin/numerics/executor/bytes.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

/// In place of Simulation::Wanted, of what is made of several simulations.
constexpr std::uint8_t slope_answer = 255;

/// Distance of the points whose residuals give sigmas, in units of z.
constexpr double sigma_step = 0.1;

/// Sigmas and correlations at the minimum. `at`: residuals of its neighbours.
void judge(const Posterior& posterior, const VectorXd& z, const std::vector<Posterior::Simulated>& at,
           const std::vector<std::size_t>& free, SimulationFit& fit) {
  std::vector<Index> inner;
  for (Index i = 0; i < posterior.size(); ++i) {
    if (z(i) > posterior.low(i) + 1e-6 && z(i) < posterior.high(i) - 1e-6)
      inner.push_back(i);
    else
      fit.status[free[static_cast<std::size_t>(i)]] = ParameterStatus::at_bound;
  }
  const MatrixXd covariance = posterior.covariance(z, sigma_step, at, inner);
  for (std::size_t k = 0; k < inner.size(); ++k) {
    const Quantity& q = posterior.quantity(inner[k]);
    const std::size_t of = free[static_cast<std::size_t>(inner[k])];
    const double deviation = std::sqrt(std::max(0.0, covariance(static_cast<Index>(k), static_cast<Index>(k))));
    fit.status[of] = deviation > (q.sigma > 0 ? 0.8 : 2.4) ? ParameterStatus::prior : ParameterStatus::estimated;
    fit.sigma[of] = deviation * q.scale() * (q.logarithmic ? fit.values[of] : 1);
    for (std::size_t l = 0; l < inner.size(); ++l) {
      const auto a = static_cast<Index>(k), b = static_cast<Index>(l);
      fit.correlation(static_cast<Index>(of), static_cast<Index>(free[static_cast<std::size_t>(inner[l])])) =
          covariance(a, b) / std::sqrt(covariance(a, a) * covariance(b, b));
    }
  }
}

template <class Matrix>
std::span<const double> span_of(const Matrix& m) {
  return {m.data(), static_cast<std::size_t>(m.size())};
}

/// A point of a fit that is to be simulated, and by which recordings.
struct Simulation {
  /// errors, residuals: of the posterior, by its training recordings; fit: the error of all recordings of the plan.
  enum class Wanted : std::uint8_t { errors, residuals, fit };
  std::size_t job = 0;
  Wanted wanted{};
  std::size_t first = 0, last = 0;
  VectorXd z{};

  std::string bytes() const {
    BytesOut out;
    out.put<std::uint64_t>(job).put(wanted).put<std::uint64_t>(first).put<std::uint64_t>(last).put(span_of(z));
    return out.take();
  }
  static Simulation from(const std::string& bytes) {
    BytesIn in(bytes);
    Simulation s{.job = in.get<std::uint64_t>()};
    s.wanted = in.get<Wanted>(), s.first = in.get<std::uint64_t>(), s.last = in.get<std::uint64_t>();
    const auto z = in.numbers<double>();
    s.z = VectorXd::Map(z.data(), std::ssize(z));
    return s;
  }
};

/// The fits of a plan that are missing. Rank 0 has all searches, and those of them that are under way ask for points;
/// the executor simulates these in processes of all ranks.
class Calibration {
 public:
  static Result<void> run(const Plan& plan, const std::vector<SimulationFit>& have, const Watch& watch) {
    std::vector<VariantTwins> twins;
    for (const auto& variant : plan.variants) {
      auto opened = VariantTwins::open(variant);
      if (!opened) return work_failed(fmt::format("variant '{}': {}", variant.label, opened.error().message));
      twins.push_back(std::move(*opened));
    }
    return Calibration(plan, have, watch, std::move(twins)).run();
  }

 private:
  using Wanted = Simulation::Wanted;
  struct Job {
    SimulationFit fit;
    bool open = true;  ///< not done by an earlier run
    Posterior posterior;
    std::vector<Minimum> minima;  ///< per start
    int searches = 0;             ///< that are over
  };
  struct Point {
    Wanted wanted{};
    VectorXd z;
    std::map<std::size_t, std::string> parts{};  ///< what was simulated, by the first of its recordings
  };
  /// What one search, or after the last one the end of its fit, waits for.
  struct Inquirer {
    std::size_t job = 0, start = 0;
    std::unique_ptr<Gaussian> gaussian;
    std::optional<Search> search;
    std::vector<Point> points;
    std::size_t missing = 0;  ///< parts of points
  };
  struct Task {
    Inquirer* of;
    std::size_t point, first, last;
  };

  Calibration(const Plan& plan, const std::vector<SimulationFit>& have, const Watch& watch,
              std::vector<VariantTwins> twins)
      : plan_(plan),
        watch_(watch),
        twins_(std::move(twins)),
        workers_(std::max(1u, watch.threads) * static_cast<unsigned>(ranks().size())) {
    for (std::size_t v = 0; v < plan.variants.size(); ++v) {
      add_job(have, v, SimulationFit::all, 0, {});
      for (std::size_t s = 0; s < plan.splits.size(); ++s)
        for (std::size_t f = 0; f < plan.splits[s].folds.size(); ++f)
          add_job(have, v, s, f, plan.splits[s].folds[f].held_out);
    }
  }

  void add_job(const std::vector<SimulationFit>& have, std::size_t variant, std::size_t split, std::size_t fold,
               const std::vector<std::size_t>& held_out) {
    std::vector<std::size_t> training;
    for (std::size_t i = 0; i < plan_.recordings.size(); ++i)
      if (std::ranges::find(held_out, i) == held_out.end()) training.push_back(i);
    const auto same = [&](const SimulationFit& f) {
      return f.variant == variant && f.split == split && f.fold == fold;
    };
    const double count = static_cast<double>(training.size());
    Job& job = jobs_.emplace_back(Job{.fit = {},
                                      .open = std::ranges::none_of(have, same),
                                      .posterior = {twins_[variant], plan_.recordings, training, plan_.search},
                                      .minima = std::vector<Minimum>(starts())});
    job.fit.variant = variant, job.fit.split = split, job.fit.fold = fold;
    if (!job.open) return;
    simulations_ += count * plan_.search.evaluations * plan_.search.starts;
    if (split == SimulationFit::all) simulations_ += count * static_cast<double>(2 * job.posterior.size() + 1);
  }

  std::size_t starts() const { return static_cast<std::size_t>(plan_.search.starts); }

  Result<void> run() {
    for (std::size_t job = 0; watch_.journal && job < jobs_.size(); ++job)
      if (!jobs_[job].open && kept_) kept_ = watch_.journal->forget(of_job(job));
    const Tasks tasks{.identity = watch_.identity,
                      .work = [this](std::size_t, const std::string& input) { return simulated(input); },
                      .own_processes = true,
                      .keep =
                          [this](std::size_t task, const std::string& result) {
                            over(task, result);
                            return kept_;
                          },
                      .failed = [this](const TaskFailure& failure) { lost(failure); },
                      .input = [this](std::size_t task) { return simulation_of(tasks_[task]).bytes(); },
                      .grown = [this] { return grown(); }};
    const auto outcome = carry_out(tasks, {.threads = watch_.threads, .retries = watch_.retries, .stop = watch_.stop});
    if (!outcome) return tl::unexpected(outcome.error());
    return ranks().on_root([this]() -> Result<void> {
      if (!kept_) return kept_;
      std::ranges::stable_sort(failures_, {}, &TaskFailure::task);
      const auto name = [this](std::size_t job) { return label_of(jobs_[job].fit); };
      const auto input = [this](std::size_t job) { return failed_with_[job]; };
      if (!watch_.folder.empty())
        if (auto ok = write_failures(watch_.folder, failures_, name, input); !ok) return ok;
      if (failures_.empty()) return {};
      return work_failed(text_of(failures_, name));
    });
  }

  std::string label_of(const SimulationFit& fit) const {
    std::string label = fmt::format("variant '{}'", plan_.variants[fit.variant].label);
    if (fit.split == SimulationFit::all) return label;
    const Split& split = plan_.splits[fit.split];
    return label + fmt::format(", {} '{}' held out", split.name, split.folds[fit.fold].label);
  }

  // ---- In the processes of all ranks.

  /// The twin of a point; the points of a process often have the same.
  const VariantTwins::Candidate* candidate(const Job& job, const VectorXd& z) {
    auto values = job.posterior.values(z);
    if (job.fit.variant == made_of_ && values == made_values_) return made_ ? &*made_ : nullptr;
    auto made = twins_[job.fit.variant].candidate(values);  // may throw: what is kept stays the one before
    made_ = made ? std::optional(*std::move(made)) : std::nullopt;
    made_of_ = job.fit.variant, made_values_ = std::move(values);
    return made_ ? &*made_ : nullptr;
  }

  Result<std::string> simulated(const std::string& input) {
    const Simulation s = Simulation::from(input);
    const Job& job = jobs_[s.job];
    const auto* twin = candidate(job, s.z);
    if (s.wanted == Wanted::fit) return errors_of_all(job, twin, s);
    const auto detail = s.wanted == Wanted::errors ? Posterior::Detail::errors : Posterior::Detail::residuals;
    const auto made = twin ? job.posterior.simulated(*twin, detail, s.first, s.last) : std::nullopt;
    BytesOut out;
    out.put(made.has_value());
    if (made)
      for (const MatrixXd& one : *made)
        out.put<std::uint64_t>(static_cast<std::uint64_t>(one.rows())).put(span_of(one));
    return out.take();
  }

  /// Why it cannot be simulated, or the mean absolute errors.
  Result<std::string> errors_of_all(const Job& job, const VariantTwins::Candidate* twin, const Simulation& s) const {
    const VariantTwins& twins = twins_[job.fit.variant];
    std::string why = twin ? "" : twins.candidate(job.posterior.values(s.z)).error().message;
    std::vector<double> mae;
    for (std::size_t i = s.first; i < s.last && why.empty(); ++i) {
      const Recording& recording = plan_.recordings[i];
      const auto positions = twins.positions(*twin, recording);
      if (positions)
        mae.push_back(mae_mrad(recording, *positions));
      else
        why = fmt::format("{}: {}", recording.file.filename().string(), positions.error().message);
    }
    return BytesOut().put(std::string_view(why)).put(std::span<const double>(mae)).take();
  }

  // ---- On rank 0.

  /// The points that are under way keep all workers busy while results travel; more searches would need more memory.
  std::size_t grown() {
    for (; kept_ && under_way_ < 8 * workers_ && next_ < jobs_.size() * starts(); ++next_)
      if (const std::size_t job = next_ / starts(); jobs_[job].open) begin(job, next_ % starts());
    return tasks_.size();
  }

  void begin(std::size_t job, std::size_t start) {
    const Posterior& posterior = jobs_[job].posterior;
    const Index n = posterior.size();
    Inquirer& one = *inquirers_.emplace_back(std::make_unique<Inquirer>());
    one.job = job, one.start = start;
    one.gaussian = std::make_unique<Gaussian>(plan_.search.seed * 1000003 + start);
    const VectorXd mean = start == 0 ? VectorXd(VectorXd::Zero(n)) : VectorXd(0.5 * (*one.gaussian)(n));
    VectorXd low(n), high(n);
    for (Index i = 0; i < n; ++i) low(i) = posterior.low(i), high(i) = posterior.high(i);
    const int evaluations = plan_.search.evaluations;
    one.search = method_of(plan_.search) == SearchMethod::gauss_newton
                     ? gauss_newton(mean, low, high, {.evaluations = evaluations})
                     : cma_es(mean, {.evaluations = evaluations}, *one.gaussian);
    if (ask(one)) go_on(one);
  }

  /// What the search wants to know, or after the last one the end of its fit. False where nothing is to be simulated.
  bool ask(Inquirer& one) {
    while (!one.search->over()) {
      one.points = points_of(one);
      auto known = kept_answer(one);
      if (!known) return hand_in(one), true;
      one.search->answer(*std::move(known));
    }
    Job& job = jobs_[one.job];
    const Minimum& found = job.minima[one.start] = one.search->outcome();
    one.search.reset();
    if (job.posterior.size() > 0)
      show((plan_.search.evaluations - found.evaluations) * static_cast<double>(job.posterior.recordings()));
    one.points.clear();
    return ++job.searches == plan_.search.starts && ask_for_end(one);
  }

  std::vector<Point> points_of(const Inquirer& one) const {
    const Trial& trial = one.search->question();
    const bool slope = trial.step > 0;
    std::vector<Point> points;
    for (const VectorXd& z :
         slope ? jobs_[one.job].posterior.neighbours(trial.points[0], trial.step, false) : trial.points)
      points.push_back({slope ? Wanted::residuals : Wanted::errors, z});
    return points;
  }

  /// Makes tasks of what is not in the journal. The last searches have fewer points than there are workers, which then
  /// share the recordings of a point.
  void hand_in(Inquirer& one) {
    std::vector<Task> wanted;
    for (std::size_t p = 0; p < one.points.size(); ++p)
      for (const auto& [first, last] : missing_of(one, one.points[p])) wanted.push_back({&one, p, first, last});
    const bool last_ones = next_ + 1 >= jobs_.size() * starts();
    const std::size_t share = last_ones && !wanted.empty() ? workers_ / (under_way_ + wanted.size()) : 1;
    one.missing = 0;
    for (const Task& task : wanted) {
      const std::size_t all = task.last - task.first;
      const std::size_t parts =
          one.points[task.point].wanted == Wanted::fit ? 1 : std::clamp<std::size_t>(share, 1, all);
      for (std::size_t k = 0; k < parts; ++k)
        tasks_.push_back({&one, task.point, task.first + k * all / parts, task.first + (k + 1) * all / parts});
      one.missing += parts;
    }
    under_way_ += one.missing;
  }

  // ---- The journal. Searches repeat their questions in the same order, so what is there is found by its point.

  /// The names of the tasks of a fit, of one of its searches or its end, and of a point begin so.
  static std::string of_job(std::size_t job) { return BytesOut().put<std::uint64_t>(job).take(); }
  std::string of_search(const Inquirer& one) const {
    return of_job(one.job) + BytesOut().put<std::uint64_t>(one.search ? one.start : starts()).take();
  }
  std::string of_point(const Inquirer& one, const Point& point) const {
    return of_search(one) + BytesOut().put(point.wanted).put(span_of(point.z)).take();
  }
  static std::string of_part(std::size_t first, std::size_t last) {
    return BytesOut().put<std::uint64_t>(first).put<std::uint64_t>(last).take();
  }
  /// Slope and curvature, which take the place of the residuals that they are made of.
  std::string of_slope(const Inquirer& one, const Trial& trial) const {
    return of_search(one) + BytesOut().put(slope_answer).put(trial.step).put(span_of(trial.points[0])).take();
  }

  /// The answer to the question of a search, where it is a slope.
  std::optional<Tried> kept_answer(const Inquirer& one) {
    const Trial& trial = one.search->question();
    if (!watch_.journal || !(trial.step > 0)) return std::nullopt;
    const auto found = watch_.journal->find(of_slope(one, trial));
    if (found.empty()) return std::nullopt;
    auto quadratic = slope_in(found.front().second, trial.points[0].size());
    if (!quadratic) {
      kept_ = tl::unexpected(
          Error(fmt::format("{}: holds an answer of another shape than the search has asked for; choose another folder "
                            "with -o, or remove this file",
                            watch_.journal->file().string())));
      return std::nullopt;
    }
    forget_points(one);
    simulations_ -= static_cast<double>(one.points.size() * jobs_[one.job].posterior.recordings());
    return Tried{.values = {}, .quadratic = *std::move(quadratic)};
  }

  /// Gradient (n) and curvature (n x n) as keep_answer() wrote them; nothing where they are of another shape.
  static std::optional<Quadratic> slope_in(std::string_view bytes, Index n) try {
    BytesIn in(bytes);
    const auto gradient = in.numbers<double>(), curvature = in.numbers<double>();
    if (std::ssize(gradient) != n || std::ssize(curvature) != n * n || !in.empty()) return std::nullopt;
    return Quadratic{VectorXd::Map(gradient.data(), n), MatrixXd::Map(curvature.data(), n, n)};
  } catch (const std::runtime_error&) {  // cut off
    return std::nullopt;
  }

  void keep_answer(const Inquirer& one, const Trial& trial, const Quadratic& answer) {
    if (!watch_.journal) return;
    BytesOut out;
    out.put(span_of(answer.gradient)).put(span_of(answer.curvature));
    kept_ = watch_.journal->keep(of_slope(one, trial), out.take());
    forget_points(one);
  }

  void forget_points(const Inquirer& one) {
    for (const Point& point : one.points)
      if (kept_) kept_ = watch_.journal->forget(of_point(one, point));
  }

  /// Gives the point what the journal has of it; the ranges of recordings that are left to simulate.
  std::vector<std::pair<std::size_t, std::size_t>> missing_of(const Inquirer& one, Point& point) {
    std::vector<std::pair<std::size_t, std::size_t>> missing;
    std::map<std::size_t, std::size_t> there;
    if (watch_.journal)
      for (const auto& [part, result] : watch_.journal->find(of_point(one, point))) {
        BytesIn in(part);
        const std::size_t first = in.get<std::uint64_t>(), last = in.get<std::uint64_t>();
        there[first] = last;
        point.parts[first] = std::string(result);
        if (point.wanted != Wanted::fit) simulations_ -= static_cast<double>(last - first);
      }
    std::size_t next = 0;
    for (const auto& [first, last] : there) {
      if (next < first) missing.emplace_back(next, first);
      next = last;
    }
    if (const std::size_t all = recordings_of(one.job, point.wanted); next < all) missing.emplace_back(next, all);
    return missing;
  }

  // ----

  std::size_t recordings_of(std::size_t job, Wanted wanted) const {
    return wanted == Wanted::fit ? plan_.recordings.size() : jobs_[job].posterior.recordings();
  }

  Simulation simulation_of(const Task& task) const {
    const Point& point = task.of->points[task.point];
    return {task.of->job, point.wanted, task.first, task.last, point.z};
  }

  void over(std::size_t number, const std::string& result) {
    const Task& task = tasks_[number];
    Inquirer& one = *task.of;
    Point& point = one.points[task.point];
    --under_way_, --one.missing;
    if (watch_.journal && kept_)
      kept_ = watch_.journal->keep(of_point(one, point) + of_part(task.first, task.last), result);
    point.parts[task.first] = result;
    if (point.wanted != Wanted::fit) show(static_cast<double>(task.last - task.first));
    go_on(one);
  }

  void lost(const TaskFailure& failure) {
    const Task task = tasks_[failure.task];
    --under_way_, --task.of->missing;
    fail(simulation_of(task), failure.error, failure.attempts);
  }

  /// Its fit cannot be made; the others go on.
  void fail(const Simulation& with, const Error& error, int attempts) {
    Job& job = jobs_[with.job];
    if (!std::exchange(job.open, false)) return;
    failures_.push_back({with.job, attempts, error});
    std::string text;
    const auto values = job.posterior.values(with.z);
    const auto& quantities = plan_.variants[job.fit.variant].quantities;
    for (const std::size_t i : twins_[job.fit.variant].free_quantities())
      text += fmt::format("{}{}={:.17g}", text.empty() ? "" : ", ", quantities[i].path(), values[i]);
    failed_with_[with.job] = text;
  }

  Posterior::Simulated all_parts(const Point& point) const {
    std::vector<MatrixXd> all;
    for (const auto& [first, part] : point.parts) {
      BytesIn in(part);
      if (!in.get<bool>()) return std::nullopt;
      while (!in.empty()) {
        const auto rows = static_cast<Index>(in.get<std::uint64_t>());
        const auto numbers = in.numbers<double>();
        all.emplace_back(MatrixXd::Map(numbers.data(), rows, std::ssize(numbers) / std::max<Index>(rows, 1)));
      }
    }
    return all;
  }

  /// While all that it has asked for is there.
  void go_on(Inquirer& one) {
    while (kept_ && one.missing == 0 && jobs_[one.job].open && answered(one)) {
    }
  }

  /// Whether it has asked for more.
  bool answered(Inquirer& one) {
    if (!one.search) return finish(one), false;
    const Job& job = jobs_[one.job];
    const Trial& trial = one.search->question();
    std::vector<Posterior::Simulated> at;
    for (const Point& point : one.points) at.push_back(all_parts(point));
    Tried tried;
    if (trial.step > 0) {
      tried.quadratic = job.posterior.quadratic(trial.points[0], trial.step, at);
      keep_answer(one, trial, tried.quadratic);
    } else {
      for (std::size_t p = 0; p < at.size(); ++p)
        tried.values.push_back(job.posterior.objective(trial.points[p], at[p]));
    }
    one.search->answer(std::move(tried));
    return ask(one);
  }

  /// Errors of the best point by all recordings, and what its sigmas need. False where there is no best point.
  bool ask_for_end(Inquirer& one) {
    const Job& job = jobs_[one.job];
    const Minimum& best = best_of(job);
    if (!std::isfinite(best.objective)) {
      fail({.job = one.job, .z = best.z}, Error("every twin tried was refused or diverged", ErrorKind::work), 1);
      return false;
    }
    one.points.push_back({Wanted::fit, best.z});
    if (job.fit.split == SimulationFit::all)
      for (const VectorXd& z : job.posterior.neighbours(best.z, sigma_step, true))
        one.points.push_back({Wanted::residuals, z});
    hand_in(one);
    return true;
  }

  static const Minimum& best_of(const Job& job) {
    return *std::ranges::min_element(job.minima, {}, &Minimum::objective);
  }

  void finish(Inquirer& one) {
    Job& job = jobs_[one.job];
    const Minimum& best = best_of(job);
    BytesIn in(one.points[0].parts.at(0));
    if (const std::string why = in.text(); !why.empty())
      return fail({.job = one.job, .z = best.z}, Error(why, ErrorKind::work), 1);
    SimulationFit& fit = job.fit;
    fit.mae_mrad = in.numbers<double>();
    fit.values = job.posterior.values(best.z);
    fit.objective = best.objective;
    for (const Minimum& m : job.minima) fit.minima.push_back(m.objective), fit.evaluations += m.evaluations;
    fit.sigma.assign(fit.values.size(), unknown);
    fit.status.assign(fit.values.size(), ParameterStatus::known);
    fit.correlation = MatrixXd::Constant(std::ssize(fit.values), std::ssize(fit.values), unknown);
    const auto free = twins_[fit.variant].free_quantities();
    for (const std::size_t i : free) fit.status[i] = ParameterStatus::estimated;
    if (fit.split == SimulationFit::all) {
      std::vector<Posterior::Simulated> at;
      for (std::size_t p = 1; p < one.points.size(); ++p) at.push_back(all_parts(one.points[p]));
      judge(job.posterior, best.z, at, free, fit);
    }
    one.points.clear();
    if (watch_.done) kept_ = watch_.done(fit);
    if (kept_ && watch_.journal) kept_ = watch_.journal->forget(of_job(one.job));
  }

  /// Of the progress line.
  void show(double simulations) {
    simulated_ += simulations;
    if (watch_.progress) watch_.progress(simulated_ < simulations_ ? simulated_ / simulations_ : 1);
  }

  const Plan& plan_;
  const Watch& watch_;
  const std::vector<VariantTwins> twins_;
  std::vector<Job> jobs_;
  const std::size_t workers_;
  std::vector<std::unique_ptr<Inquirer>> inquirers_;
  std::vector<Task> tasks_;
  std::size_t next_ = 0;                            ///< search that has not begun
  std::size_t under_way_ = 0;                       ///< tasks that are not over
  std::vector<TaskFailure> failures_;               ///< of jobs
  std::map<std::size_t, std::string> failed_with_;  ///< values of the quantities
  double simulations_ = 0, simulated_ = 0;          ///< to be made by this run; made
  Result<void> kept_;                               ///< an error of the journal or of `done` ends all
  // Of a process of tasks.
  std::optional<std::size_t> made_of_;  ///< variant
  std::vector<double> made_values_;
  std::optional<VariantTwins::Candidate> made_;
};

}  // namespace

std::string_view name(SearchMethod method) {
  static constexpr std::string_view names[] = {"auto", "gauss_newton", "cma_es"};
  return names[static_cast<std::size_t>(method)];
}

SearchMethod method_of(const SearchOptions& options) {
  if (options.method != SearchMethod::automatic) return options.method;
  return options.norm == Norm::squared ? SearchMethod::gauss_newton : SearchMethod::cma_es;
}

std::string_view name(ParameterStatus status) {
  static constexpr std::string_view names[] = {"known", "estimated", "prior", "at_bound"};
  return names[static_cast<std::size_t>(status)];
}

Result<void> calibrate(const Plan& plan, const std::vector<SimulationFit>& have, const Watch& watch) {
  return Calibration::run(plan, have, watch);
}

}  // namespace tribotwin::twin::identification
