#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>
#include <tribotwin/twin/numerics/correlation.hpp>
#include <tribotwin/twin/numerics/least_squares.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr int grid_points = 24;

/// Response of a node of gain 1 K/W to the power and to 1 K at the start.
struct Response {
  std::vector<double> power, start;
};

Response response(const HeatSession& session, double t_s) {
  Response r;
  double heated = 0, kept = 1;
  for (std::size_t i = 0; i < session.time_s.size(); ++i) {
    const double before = i ? session.time_s[i - 1] : session.start_s.value_or(session.time_s[0]),
                 loss = -std::expm1(-(session.time_s[i] - before) / t_s);
    heated += (session.power_w[i] - heated) * loss;
    kept -= kept * loss;
    r.power.push_back(heated);
    r.start.push_back(kept);
  }
  return r;
}

/// The least-squares solution of the linear unknowns at given time constants: gains c_i t_i (0 where they would be
/// negative), then A per file, then x_i0.
struct Projection {
  MatrixXd columns;
  VectorXd linear, residual;  ///< residual: model - measured
  double cost() const { return residual.squaredNorm(); }
};

class ThermalProblem {
 public:
  ThermalProblem(std::span<const HeatSession> sessions, const ThermalOptions& options)
      : sessions_(sessions), nodes_(thermal::info(options.order).nodes), rested_(options.rested) {
    std::map<std::size_t, Index> files;
    for (const auto& s : sessions) {
      file_.push_back(files.try_emplace(s.file, static_cast<Index>(files.size())).first->second);
      samples_ += static_cast<Index>(s.time_s.size());
    }
    files_ = static_cast<Index>(files.size());
    measured_.resize(samples_);
    Index row = 0;
    for (const auto& s : sessions)
      for (const double T : s.temperature_degC) measured_(row++) = T;
  }

  Index nodes() const { return nodes_; }
  Index files() const { return files_; }
  Index samples() const { return samples_; }
  Index unknowns() const { return nodes_ + files_ + (rested_ ? 0 : nodes_ * static_cast<Index>(sessions_.size())); }

  MatrixXd columns(const VectorXd& log_t) const {
    MatrixXd c = MatrixXd::Zero(samples_, unknowns());
    for (Index node = 0; node < nodes_; ++node) {
      Index row = 0;
      for (std::size_t s = 0; s < sessions_.size(); ++s) {
        const Response r = response(sessions_[s], std::exp(log_t(node)));
        const auto n = static_cast<Index>(r.power.size());
        c.col(node).segment(row, n) = Eigen::Map<const VectorXd>(r.power.data(), n);
        c.col(nodes_ + file_[s]).segment(row, n).setOnes();
        if (!rested_)
          c.col(nodes_ + files_ + static_cast<Index>(s) * nodes_ + node).segment(row, n) =
              Eigen::Map<const VectorXd>(r.start.data(), n);
        row += n;
      }
    }
    return c;
  }

  Projection project(const VectorXd& log_t) const {
    Projection best{.columns = columns(log_t)};
    // Every choice of gains fixed at 0; the best of those without a negative gain.
    for (unsigned closed = 0; closed < 1u << nodes_; ++closed) {
      std::vector<Index> kept;
      for (Index k = 0; k < best.columns.cols(); ++k)
        if (k >= nodes_ || !(closed >> k & 1u)) kept.push_back(k);
      const MatrixXd part = best.columns(Eigen::all, kept);
      // Linearly dependent columns (a gain where the power never changes) get 0.
      const VectorXd x = least_squares_solution(part, measured_, 1e-9);
      const auto open_gains = static_cast<Index>(kept.size()) - (best.columns.cols() - nodes_);
      if (open_gains && x.head(open_gains).minCoeff() < 0) continue;
      const VectorXd residual = part * x - measured_;
      if (best.residual.size() && residual.squaredNorm() >= best.cost()) continue;
      best.residual = residual;
      best.linear = VectorXd::Zero(best.columns.cols());
      best.linear(kept) = x;
      if (closed == 0) break;  // nothing was negative
    }
    return best;
  }

  /// Derivatives of the temperatures with respect to the log time constants, the linear unknowns fixed.
  MatrixXd slopes(const VectorXd& log_t, const VectorXd& linear) const {
    constexpr double h = 1e-4;
    MatrixXd d(samples_, nodes_);
    for (Index i = 0; i < nodes_; ++i) {
      VectorXd up = log_t, down = log_t;
      up(i) += h, down(i) -= h;
      d.col(i) = (columns(up) - columns(down)) * linear / (2 * h);
    }
    return d;
  }

  /// Range of log time constants: from two samples to ten times the longest session.
  std::pair<double, double> range() const {
    double longest = 0, step = std::numeric_limits<double>::infinity();
    for (const auto& s : sessions_) {
      const double length = s.time_s.back() - s.time_s.front();
      longest = std::max(longest, length);
      step = std::min(step, length / static_cast<double>(s.time_s.size() - 1));
    }
    return {std::log(2 * step), std::log(10 * longest)};
  }

 private:
  std::span<const HeatSession> sessions_;
  Index nodes_, files_ = 0, samples_ = 0;
  bool rested_;
  std::vector<Index> file_;  ///< per session, from 0
  VectorXd measured_;
};

/// The residual as a function of the time constants alone, with the derivatives of Kaufman 1975: those at fixed linear
/// unknowns, projected onto the complement of the linear columns.
class ProjectedResidual final : public ceres::CostFunction {
 public:
  explicit ProjectedResidual(const ThermalProblem& problem) : problem_(problem) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(problem.nodes()));
    set_num_residuals(static_cast<int>(problem.samples()));
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const VectorXd log_t = Eigen::Map<const VectorXd>(parameters[0], problem_.nodes());
    const Projection at = problem_.project(log_t);
    Eigen::Map<VectorXd>(residuals, problem_.samples()) = at.residual;
    if (!jacobians || !jacobians[0]) return true;
    const MatrixXd slopes = problem_.slopes(log_t, at.linear);
    MatrixXd free = at.columns;
    for (Index node = 0; node < problem_.nodes(); ++node)
      if (at.linear(node) == 0) free.col(node).setZero();  // a gain fixed at 0
    const MatrixXd projected = slopes - free * least_squares_solutions(free, slopes);
    for (Index i = 0; i < problem_.samples(); ++i)
      for (Index k = 0; k < problem_.nodes(); ++k) jacobians[0][i * problem_.nodes() + k] = projected(i, k);
    return true;
  }

 private:
  const ThermalProblem& problem_;
};

VectorXd global_search(const ThermalProblem& problem) {
  const auto [low, high] = problem.range();
  const auto at = [&, low = low, high = high](int i) { return low + (high - low) * i / (grid_points - 1); };
  VectorXd best, log_t(problem.nodes());
  double lowest = std::numeric_limits<double>::infinity();
  const auto attempt = [&] {
    const double cost = problem.project(log_t).cost();
    if (cost < lowest) lowest = cost, best = log_t;
  };
  for (int i = 0; i < grid_points; ++i) {
    log_t(0) = at(i);
    if (problem.nodes() == 1)
      attempt();
    else
      for (int k = i + 1; k < grid_points; ++k) log_t(1) = at(k), attempt();
  }
  return best;
}

void descend(const ThermalProblem& problem, VectorXd& log_t) {
  const auto [low, high] = problem.range();
  ProjectedResidual residual(problem);
  ceres::Solver::Options options;
  options.max_num_iterations = 50;
  options.function_tolerance = 1e-9;
  least_squares(residual, log_t, VectorXd::Constant(log_t.size(), low), VectorXd::Constant(log_t.size(), high),
                options);
}

/// Derivatives of the temperatures by the log time constants, then by the linear unknowns. A gain that is 0 counts as
/// free: it adds to the uncertainty of the time constants.
MatrixXd jacobian_of(const ThermalProblem& problem, const VectorXd& log_t, const Projection& at) {
  MatrixXd jacobian(problem.samples(), problem.nodes() + problem.unknowns());
  jacobian.leftCols(problem.nodes()) = problem.slopes(log_t, at.linear);
  jacobian.rightCols(problem.unknowns()) = at.columns;
  return jacobian;
}

/// Of a gain c_i t_i = `resistance` (0: held), first the resistance itself or, of second order, c_i.
Estimate gain_of(const thermal::Parameter& info, thermal::Order order, Index node, double resistance, double t_s,
                 const MatrixXd& covariance, Index nodes, double quantile) {
  if (resistance == 0) return without_sigma(std::string(info.name), std::string(info.unit), 0, Status::held);
  const Index k = nodes + node;
  const double gain = order == thermal::Order::first ? resistance : resistance / t_s;
  double relative = covariance(k, k) / (resistance * resistance);
  if (order == thermal::Order::second)
    relative += covariance(node, node) - 2 * covariance(node, k) / resistance;  // c = R / t
  return estimate(std::string(info.name), std::string(info.unit), gain, relative * gain * gain, quantile);
}

}  // namespace

Result<ThermalFit> fit_thermal(std::span<const HeatSession> sessions, const ThermalOptions& options) {
  if (std::ranges::any_of(sessions, [](const HeatSession& s) { return s.temperature_degC.empty(); }))
    return tl::unexpected(Error("has no temperatures"));
  const ThermalProblem problem(sessions, options);
  if (options.rested && static_cast<std::size_t>(problem.files()) < sessions.size())
    return tl::unexpected(Error("a file with gaps of hours does not begin at ambient temperature after each of them"));
  const Index nodes = problem.nodes();
  if (problem.samples() <= problem.unknowns() + nodes)
    return tl::unexpected(
        Error(fmt::format("{} samples for {} unknowns", problem.samples(), problem.unknowns() + nodes)));
  VectorXd log_t = global_search(problem);
  if (log_t.size() == 0)
    return tl::unexpected(
        Error("no thermal model has a finite error; check the data for values that no joint can have"));
  descend(problem, log_t);
  std::sort(log_t.data(), log_t.data() + nodes);
  const Projection at = problem.project(log_t);
  if (!std::isfinite(at.cost()))
    return tl::unexpected(Error("the fit has no finite error; check the data for values that no joint can have"));

  ThermalFit fit{
      .rms_K = std::sqrt(at.cost() / static_cast<double>(problem.samples())),
      .correlation = samples_per_independent({at.residual.data(), static_cast<std::size_t>(at.residual.size())}, 0),
      .samples = static_cast<std::size_t>(problem.samples())};
  const MatrixXd jacobian = jacobian_of(problem, log_t, at);
  const double quantile =
      interval_sigmas(static_cast<double>(problem.samples()) / fit.correlation - static_cast<double>(jacobian.cols()));
  const MatrixXd covariance =
      covariance_of(jacobian) * (at.cost() / static_cast<double>(problem.samples()) * fit.correlation);

  const auto [low, high] = problem.range();
  const auto info = thermal::parameters(options.order);
  std::vector<Estimate> times;
  for (Index i = 0; i < nodes; ++i) {
    const std::string name(info[static_cast<std::size_t>(nodes + i)].name);
    const double t_s = std::exp(log_t(i));
    fit.parameters.push_back(
        gain_of(info[static_cast<std::size_t>(i)], options.order, i, at.linear(i), t_s, covariance, nodes, quantile));
    const bool bounded = log_t(i) < low + 1e-6 || log_t(i) > high - 1e-6;
    times.push_back(bounded ? without_sigma(name, "s", t_s, Status::at_bound)
                            : estimate(name, "s", t_s, covariance(i, i) * t_s * t_s, quantile));
  }
  fit.parameters.insert(fit.parameters.end(), times.begin(), times.end());
  double mean_ambient = 0;
  for (Index f = 0; f < problem.files(); ++f) {
    const Index k = 2 * nodes + f;
    fit.ambient.push_back(estimate("T_amb", "degC", at.linear(nodes + f), covariance(k, k), quantile));
    mean_ambient += at.linear(nodes + f) / static_cast<double>(problem.files());
  }
  fit.unidentifiable = unidentifiable(fit.parameters, options.order);
  std::vector<double> values;
  for (std::size_t k = 0; k < info.size(); ++k)
    values.push_back(std::max(fit.parameters[k].value, info[k].minimum));  // also where a gain is 0
  fit.model = thermal::make_model(options.order, mean_ambient, values);
  return fit;
}

std::span<const Estimate> time_constants(const ThermalFit& fit) {
  return std::span(fit.parameters).last(fit.parameters.size() / 2);
}

std::vector<std::string> unidentifiable(std::span<const Estimate> parameters, thermal::Order order) {
  const auto times = parameters.last(parameters.size() / 2);
  const bool merged = order == thermal::Order::second && times[1].value < closest_ratio * times[0].value;
  std::vector<std::string> names;
  for (const auto& e : parameters)
    if (merged || std::isnan(e.sigma) || e.high - e.low > std::abs(e.value)) names.push_back(e.name);
  return names;
}

std::vector<double> predicted_temperature(const thermal::Model& model, const HeatSession& session) {
  thermal::Rise rise = thermal::steady_rise(model, session.temperature_degC.front() - model.T_amb_degC);
  std::vector<double> temperature{session.temperature_degC.front()};
  for (std::size_t i = 1; i < session.time_s.size(); ++i) {
    thermal::step(model, thermal::decay(model, session.time_s[i] - session.time_s[i - 1]), session.power_w[i], 0, rise);
    temperature.push_back(model.T_amb_degC + rise.total_K());
  }
  return temperature;
}

}  // namespace tribotwin::twin::identification
