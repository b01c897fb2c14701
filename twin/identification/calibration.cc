#include <algorithm>
#include <cmath>
#include <mutex>

#include <fmt/format.h>

#include <tribotwin/twin/identification/calibration.hpp>
#include <tribotwin/twin/identification/posterior.hpp>
#include <tribotwin/twin/numerics/cma_es.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>

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

/// The fits of a plan that are missing, and the threads that make them.
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
    std::vector<Minimum> minima;
    int open = 0;  ///< starts that are not finished
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
      if (std::ranges::any_of(
              have, [&](const SimulationFit& f) { return f.variant == variant && f.split == split && f.fold == fold; }))
        return;
      Job& job = jobs.emplace_back();
      job.fit.variant = variant, job.fit.split = split, job.fit.fold = fold;
      for (std::size_t i = 0; i < plan.recordings.size(); ++i)
        if (std::ranges::find(held_out, i) == held_out.end()) job.training.push_back(i);
      job.minima.resize(static_cast<std::size_t>(plan.search.starts));
      job.open = plan.search.starts;
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
      total += static_cast<double>(job.training.size()) * plan_.search.evaluations * plan_.search.starts;
      if (job.fit.split == SimulationFit::all)
        total += static_cast<double>(job.training.size() * (2 * twins_[job.fit.variant].free_quantities().size() + 1));
    }
    return total;
  }

  Result<void> run() {
    in_parallel_until_failure(jobs_.size() * static_cast<std::size_t>(plan_.search.starts), watch_.threads,
                              [this](std::size_t task) { return complete(task); });
    if (!failure_.empty()) return work_failed(failure_);
    return {};
  }

  bool complete(std::size_t task) {
    try {
      if (const auto ok = perform(task); !ok) return fail(ok.error().message);
      return true;
    } catch (const Interrupted&) {
      return false;
    } catch (const std::exception& e) {  // of a thread: memory
      return fail(e.what());
    }
  }

  bool fail(const std::string& why) {
    const std::lock_guard lock(mutex_);
    if (failure_.empty()) failure_ = why;
    return false;
  }

  /// One start of one job; the last one also finishes the job.
  Result<void> perform(std::size_t task) {
    const auto starts = static_cast<std::size_t>(plan_.search.starts);
    Job& job = jobs_[task / starts];
    const unsigned each = std::max(1u, watch_.threads / static_cast<unsigned>(jobs_.size() * starts));
    const Posterior posterior(twins_[job.fit.variant], plan_.recordings, job.training, plan_.search, counter_, each);
    job.minima[task % starts] = descend(posterior, static_cast<int>(task % starts), plan_.search, counter_,
                                        static_cast<double>(job.training.size()), each);
    const bool last = [&] {
      const std::lock_guard lock(mutex_);
      return --job.open == 0;
    }();
    if (!last) return {};
    if (const auto ok = finish(job, posterior); !ok)
      return work_failed(fmt::format("variant '{}': {}", plan_.variants[job.fit.variant].label, ok.error().message));
    const std::lock_guard lock(mutex_);
    if (watch_.done) watch_.done(job.fit);
    return {};
  }

  Result<void> finish(Job& job, const Posterior& posterior) const {
    const VariantTwins& twins = twins_[job.fit.variant];
    const Minimum& best = *std::ranges::min_element(job.minima, {}, &Minimum::objective);
    if (!std::isfinite(best.objective)) return work_failed("every twin tried was refused or diverged");
    SimulationFit& fit = job.fit;
    fit.values = posterior.values(best.z);
    fit.objective = best.objective;
    for (const Minimum& m : job.minima) fit.minima.push_back(m.objective), fit.evaluations += m.evaluations;
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
  std::mutex mutex_;  ///< guards Job::open, the calls of watch_.done and failure_
  std::string failure_;
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
