#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
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

Minimum descend(const Posterior& posterior, int start, const SearchOptions& options, Counter& counter,
                double simulations_each, unsigned threads) {
  const Index n = posterior.size();
  const auto objective = [&](const VectorXd& z) { return posterior(z); };
  Gaussian gaussian(options.seed * 1000003 + static_cast<std::uint64_t>(start));
  const VectorXd mean = start == 0 ? VectorXd(VectorXd::Zero(n)) : VectorXd(0.5 * gaussian(n));
  const auto slope = [&](const VectorXd& z, double step) { return posterior.quadratic(z, step); };
  VectorXd low(n), high(n);
  for (Index i = 0; i < n; ++i) low(i) = posterior.low(i), high(i) = posterior.high(i);
  const Minimum best =
      method_of(options) == SearchMethod::gauss_newton
          ? gauss_newton(objective, slope, mean, low, high, {.evaluations = options.evaluations})
          : cma_es(objective, mean, {.evaluations = options.evaluations, .threads = threads}, gaussian);
  if (n > 0) counter.add((options.evaluations - best.evaluations) * simulations_each);
  return best;
}

/// Sigmas and correlations at the minimum.
void judge(const Posterior& posterior, const VectorXd& z, const std::vector<std::size_t>& free, SimulationFit& fit) {
  constexpr double step = 0.1;
  std::vector<Index> inner;
  for (Index i = 0; i < posterior.size(); ++i) {
    if (z(i) > posterior.low(i) + 1e-6 && z(i) < posterior.high(i) - 1e-6)
      inner.push_back(i);
    else
      fit.status[free[static_cast<std::size_t>(i)]] = ParameterStatus::at_bound;
  }
  const MatrixXd covariance = posterior.covariance(z, step, inner);
  for (std::size_t k = 0; k < inner.size(); ++k) {
    const Quantity& q = posterior.quantity(inner[k]);
    const std::size_t at = free[static_cast<std::size_t>(inner[k])];
    const double deviation = std::sqrt(std::max(0.0, covariance(static_cast<Index>(k), static_cast<Index>(k))));
    fit.status[at] = deviation > (q.sigma > 0 ? 0.8 : 2.4) ? ParameterStatus::prior : ParameterStatus::estimated;
    fit.sigma[at] = deviation * q.scale() * (q.logarithmic ? fit.values[at] : 1);
    for (std::size_t l = 0; l < inner.size(); ++l) {
      const auto a = static_cast<Index>(k), b = static_cast<Index>(l);
      fit.correlation(static_cast<Index>(at), static_cast<Index>(free[static_cast<std::size_t>(inner[l])])) =
          covariance(a, b) / std::sqrt(covariance(a, a) * covariance(b, b));
    }
  }
}

/// A fit on its way between ranks.
std::string pack(const SimulationFit& fit) {
  const auto doubles = [](const std::vector<double>& all) { return std::span<const double>(all); };
  BytesOut out;
  out.put<std::uint64_t>(fit.variant).put<std::uint64_t>(fit.split).put<std::uint64_t>(fit.fold);
  out.put(doubles(fit.values)).put(doubles(fit.sigma)).put(std::span<const ParameterStatus>(fit.status));
  out.put(std::span<const double>(fit.correlation.data(), static_cast<std::size_t>(fit.correlation.size())));
  out.put(doubles(fit.mae_mrad)).put(fit.objective).put(doubles(fit.minima)).put(fit.evaluations);
  return out.take();
}

SimulationFit unpack(const std::string& bytes) {
  BytesIn in(bytes);
  SimulationFit fit;
  fit.variant = in.get<std::uint64_t>(), fit.split = in.get<std::uint64_t>(), fit.fold = in.get<std::uint64_t>();
  fit.values = in.numbers<double>(), fit.sigma = in.numbers<double>(), fit.status = in.numbers<ParameterStatus>();
  const auto correlation = in.numbers<double>();
  const auto n = std::ssize(fit.values);
  fit.correlation = MatrixXd::Map(correlation.data(), n, n);
  fit.mae_mrad = in.numbers<double>(), fit.objective = in.get<double>();
  fit.minima = in.numbers<double>(), fit.evaluations = in.get<int>();
  return fit;
}

/// The fits of a plan that are missing, as tasks of the executor.
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
  struct Job {
    SimulationFit fit;
    std::vector<std::size_t> training;
    bool open = true;  ///< not done by an earlier run
  };

  Calibration(const Plan& plan, const std::vector<SimulationFit>& have, const Watch& watch,
              std::vector<VariantTwins> twins)
      : plan_(plan),
        watch_(watch),
        twins_(std::move(twins)),
        jobs_(jobs_of(plan, have)),
        counter_(watch, simulations()) {}

  static std::vector<Job> jobs_of(const Plan& plan, const std::vector<SimulationFit>& have) {
    std::vector<Job> jobs;
    const auto add = [&](std::size_t variant, std::size_t split, std::size_t fold,
                         const std::vector<std::size_t>& held_out) {
      Job& job = jobs.emplace_back();
      job.open = std::ranges::none_of(
          have, [&](const SimulationFit& f) { return f.variant == variant && f.split == split && f.fold == fold; });
      job.fit.variant = variant, job.fit.split = split, job.fit.fold = fold;
      for (std::size_t i = 0; i < plan.recordings.size(); ++i)
        if (std::ranges::find(held_out, i) == held_out.end()) job.training.push_back(i);
    };
    for (std::size_t v = 0; v < plan.variants.size(); ++v) {
      add(v, SimulationFit::all, 0, {});
      for (std::size_t s = 0; s < plan.splits.size(); ++s)
        for (std::size_t f = 0; f < plan.splits[s].folds.size(); ++f) add(v, s, f, plan.splits[s].folds[f].held_out);
    }
    return jobs;
  }

  /// For the progress line.
  double simulations() const {
    double total = 0;
    for (const Job& job : jobs_) {
      if (!job.open) continue;
      total += static_cast<double>(job.training.size()) * plan_.search.evaluations * plan_.search.starts;
      if (job.fit.split == SimulationFit::all)
        total += static_cast<double>(job.training.size() * (2 * twins_[job.fit.variant].free_quantities().size() + 1));
    }
    return total;
  }

  /// Tasks: the starts of every job, then the end of every job, which needs its starts.
  std::size_t starts() const { return static_cast<std::size_t>(plan_.search.starts); }
  std::size_t first_end() const { return jobs_.size() * starts(); }
  std::size_t job_of(std::size_t task) const { return task < first_end() ? task / starts() : task - first_end(); }

  Result<void> run() {
    const auto failed_job = [this](std::size_t task) { return label_of(jobs_[job_of(task)]); };
    const Tasks tasks{
        .count = first_end() + jobs_.size(),
        .identity = watch_.identity,
        .work = [this](std::size_t task,
                       const std::string& minima) { return task < first_end() ? start(task) : end(task, minima); },
        .present =
            [this](std::size_t task) { return jobs_[job_of(task)].open ? std::nullopt : std::optional(std::string()); },
        .keep = [this](std::size_t task, const std::string& bytes) -> Result<void> {
          if (task >= first_end() && watch_.done) watch_.done(unpack(bytes));
          return {};
        },
        .after =
            [this](std::size_t task) {
              std::vector<std::size_t> before(task < first_end() ? 0 : starts());
              std::ranges::generate(before, [i = job_of(task) * starts()]() mutable { return i++; });
              return before;
            },
        .input =
            [this](std::size_t task, const std::vector<std::string>& results) {
              std::string minima;
              for (std::size_t s = 0; s < starts() && task >= first_end(); ++s)
                minima += results[job_of(task) * starts() + s];
              return minima;
            },
        .progress =
            [this](std::size_t over, std::size_t of) {
              // Simulations of other ranks are not counted here.
              if (watch_.progress && ranks().several())
                watch_.progress(static_cast<double>(over) / static_cast<double>(of));
            }};
    // A failed fit would fail again: it is a function of plan and seed.
    const auto outcome = carry_out(tasks, {.threads = watch_.threads, .retries = 0, .stop = watch_.stop});
    if (!outcome) return tl::unexpected(outcome.error());
    if (!outcome->failures.empty()) return work_failed(text_of(outcome->failures, failed_job));
    return {};
  }

  std::string label_of(const Job& job) const {
    return fmt::format("variant '{}'", plan_.variants[job.fit.variant].label);
  }

  /// Threads inside a task, where there are fewer tasks than threads.
  unsigned each() const {
    const auto open =
        static_cast<unsigned>(std::ranges::count_if(jobs_, &Job::open)) * static_cast<unsigned>(plan_.search.starts);
    return std::clamp(watch_.threads * static_cast<unsigned>(ranks().size()) / std::max(1u, open), 1u,
                      std::max(1u, watch_.threads));
  }

  Posterior posterior(const Job& job) {
    return {twins_[job.fit.variant], plan_.recordings, job.training, plan_.search, counter_, each()};
  }

  Result<std::string> start(std::size_t task) {
    const Job& job = jobs_[job_of(task)];
    const Minimum m = descend(posterior(job), static_cast<int>(task % starts()), plan_.search, counter_,
                              static_cast<double>(job.training.size()), each());
    BytesOut out;
    out.put(m.objective)
        .put(m.evaluations)
        .put(std::span<const double>(m.z.data(), static_cast<std::size_t>(m.z.size())));
    return out.take();
  }

  Result<std::string> end(std::size_t task, const std::string& minima) {
    const Job& job = jobs_[job_of(task)];
    std::vector<Minimum> all(starts());
    BytesIn in(minima);
    for (Minimum& m : all) {
      m.objective = in.get<double>();
      m.evaluations = in.get<int>();
      const auto z = in.numbers<double>();
      m.z = VectorXd::Map(z.data(), std::ssize(z));
    }
    SimulationFit fit = job.fit;
    if (const auto ok = finish(posterior(job), all, fit); !ok) return tl::unexpected(ok.error());
    return pack(fit);
  }

  Result<void> finish(const Posterior& posterior, const std::vector<Minimum>& minima, SimulationFit& fit) const {
    const VariantTwins& twins = twins_[fit.variant];
    const Minimum& best = *std::ranges::min_element(minima, {}, &Minimum::objective);
    if (!std::isfinite(best.objective)) return work_failed("every twin tried was refused or diverged");
    fit.values = posterior.values(best.z);
    fit.objective = best.objective;
    for (const Minimum& m : minima) fit.minima.push_back(m.objective), fit.evaluations += m.evaluations;
    fit.sigma.assign(fit.values.size(), unknown);
    fit.status.assign(fit.values.size(), ParameterStatus::known);
    fit.correlation = MatrixXd::Constant(std::ssize(fit.values), std::ssize(fit.values), unknown);
    const auto free = twins.free_quantities();
    for (const std::size_t i : free) fit.status[i] = ParameterStatus::estimated;
    const auto candidate = twins.candidate(fit.values);
    if (!candidate) return tl::unexpected(candidate.error());
    for (const auto& recording : plan_.recordings) {
      const auto positions = twins.positions(*candidate, recording);
      if (!positions)
        return work_failed(fmt::format("{}: {}", recording.file.filename().string(), positions.error().message));
      fit.mae_mrad.push_back(mae_mrad(recording, *positions));
    }
    if (fit.split == SimulationFit::all) judge(posterior, best.z, free, fit);
    return {};
  }

  const Plan& plan_;
  const Watch& watch_;
  const std::vector<VariantTwins> twins_;
  std::vector<Job> jobs_;
  Counter counter_;
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
