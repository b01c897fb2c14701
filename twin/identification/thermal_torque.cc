#include <tribotwin/twin/identification/thermal_torque.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Dense>
#include <boost/math/distributions/students_t.hpp>
#include <ceres/ceres.h>
#include <fmt/format.h>

#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/laboratory/correlation.hpp>
#include <tribotwin/twin/search/cma_es.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr double closest_ratio = 1.2;   // as in fit_thermal

/// Unknowns x: log t_i, then s_i = alpha c_i t_i W, the change of friction that node i ends with at the mean power W of all cycles.
class TorqueProblem {
 public:
  TorqueProblem(std::span<const HeatSession> sessions, Index nodes) : sessions_(sessions), nodes_(nodes) {
    double work = 0, longest = 0, shortest_cycle = std::numeric_limits<double>::infinity();
    for (const auto& s : sessions) {
      const auto n = static_cast<Index>(s.time_s.size());
      for (const double p : s.cycle_power_w) work += p;
      samples_ += n;
      longest = std::max(longest, s.time_s.back() - s.time_s.front());
      shortest_cycle = std::min(shortest_cycle, s.cycle_s);
    }
    mean_power_w_ = work / static_cast<double>(samples_);
    low_ = std::log(shortest_cycle), high_ = std::log(10 * longest);
  }

  Index nodes() const { return nodes_; }
  Index samples() const { return samples_; }
  double mean_power_w() const { return mean_power_w_; }
  /// Range of log time constants: from a cycle to ten times the longest session.
  double low() const { return low_; }
  double high() const { return high_; }

  /// Friction over that at rest, 1 + sum y_i, at each sample of a session.
  VectorXd share(const VectorXd& x, const HeatSession& session) const {
    const auto n = static_cast<Index>(session.time_s.size());
    VectorXd share = VectorXd::Ones(n);
    for (Index i = 0; i < nodes_; ++i) {
      const double t_s = std::exp(x(i));
      double y = 0;
      for (Index k = 0; k < n; ++k) {
        const auto at = static_cast<std::size_t>(k);
        // The first sample is half a cycle after the start.
        const double dt_s = k ? session.time_s[at] - session.time_s[at - 1] : session.cycle_s / 2, power_w = k ? session.power_w[at] : session.cycle_power_w.front();
        y += (x(nodes_ + i) * power_w / mean_power_w_ - y) * -std::expm1(-dt_s / t_s);
        share(k) += y;
      }
    }
    return share;
  }

  static double rest_power_w(const VectorXd& share, const HeatSession& session) {
    return share.dot(Eigen::Map<const VectorXd>(session.cycle_power_w.data(), share.size())) / share.squaredNorm();
  }

  /// Model less measured power, over the mean power of the session, P_0 being the best one.
  VectorXd residual(const VectorXd& x) const {
    VectorXd r(samples_);
    Index row = 0;
    for (const auto& s : sessions_) {
      const VectorXd model = share(x, s);
      const Eigen::Map<const VectorXd> measured(s.cycle_power_w.data(), model.size());
      r.segment(row, model.size()) = (rest_power_w(model, s) * model - measured) / measured.mean();
      row += model.size();
    }
    return r;
  }

  /// Derivatives by x and each P_0 of the residuals with P_0 free.
  MatrixXd jacobian(const VectorXd& x) const {
    constexpr double h = 1e-4;
    MatrixXd J = MatrixXd::Zero(samples_, x.size() + static_cast<Index>(sessions_.size()));
    Index row = 0;
    for (std::size_t f = 0; f < sessions_.size(); ++f) {
      const auto& s = sessions_[f];
      const VectorXd model = share(x, s);
      const double mean = Eigen::Map<const VectorXd>(s.cycle_power_w.data(), model.size()).mean(), rest = rest_power_w(model, s);
      for (Index k = 0; k < x.size(); ++k) {
        VectorXd up = x, down = x;
        up(k) += h, down(k) -= h;
        J.col(k).segment(row, model.size()) = rest / mean * (share(up, s) - share(down, s)) / (2 * h);
      }
      J.col(x.size() + static_cast<Index>(f)).segment(row, model.size()) = model / mean;
      row += model.size();
    }
    return J;
  }

 private:
  std::span<const HeatSession> sessions_;
  Index nodes_, samples_ = 0;
  double mean_power_w_ = 0, low_ = 0, high_ = 0;
};

VectorXd global_search(const TorqueProblem& problem) {
  const Index nodes = problem.nodes();
  VectorXd start(2 * nodes);
  for (Index i = 0; i < nodes; ++i) start(i) = problem.low() + (problem.high() - problem.low()) * static_cast<double>(i + 1) / static_cast<double>(nodes + 1), start(nodes + i) = -0.2;
  Gaussian gaussian(1);
  const auto cost = [&](const VectorXd& x) {
    // Beyond the range the cost is that of its edge and what is beyond: the search finds back.
    VectorXd inside = x;
    inside.head(nodes) = x.head(nodes).cwiseMax(problem.low()).cwiseMin(problem.high());
    return problem.residual(inside).squaredNorm() * (1 + (x - inside).squaredNorm()) + 1e-12 * (x - inside).squaredNorm();
  };
  VectorXd x = cma_es(cost, start, {.population = 12, .first_step = 1, .last_step = 1e-3, .evaluations = 2400}, gaussian).z;
  x.head(nodes) = x.head(nodes).cwiseMax(problem.low()).cwiseMin(problem.high());
  return x;
}

void descend(const TorqueProblem& problem, VectorXd& x) {
  const auto residual = [&problem](double const* const* parameters, double* residuals) {
    Eigen::Map<VectorXd>(residuals, problem.samples()) = problem.residual(Eigen::Map<const VectorXd>(parameters[0], 2 * problem.nodes()));
    return true;
  };
  auto* cost = new ceres::DynamicNumericDiffCostFunction<decltype(residual), ceres::CENTRAL>(new auto(residual));   // Ceres deletes both
  cost->AddParameterBlock(static_cast<int>(x.size()));
  cost->SetNumResiduals(static_cast<int>(problem.samples()));
  ceres::Problem minimisation;
  minimisation.AddResidualBlock(cost, nullptr, x.data());
  for (int i = 0; i < problem.nodes(); ++i) {
    minimisation.SetParameterLowerBound(x.data(), i, problem.low());
    minimisation.SetParameterUpperBound(x.data(), i, problem.high());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-10;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &minimisation, &summary);
}

}  // namespace

tl::expected<TorqueThermalFit, std::string> fit_thermal_torque(std::span<const HeatSession> sessions, thermal::Order order) {
  const Index nodes = order == thermal::Order::first ? 1 : 2, unknowns = 2 * nodes + static_cast<Index>(sessions.size());
  const TorqueProblem problem(sessions, nodes);
  if (problem.samples() <= unknowns) return tl::unexpected(fmt::format("{} cycles for {} unknowns", problem.samples(), unknowns));
  for (const auto& s : sessions)
    if (const double mean = Eigen::Map<const VectorXd>(s.cycle_power_w.data(), static_cast<Index>(s.cycle_power_w.size())).mean(); !(mean > 0))
      return tl::unexpected(fmt::format("the cycles take {:.3g} W in the mean, where friction takes more than 0; is the torque or the motion of the other sign, or --cycle no period of it?", mean));
  VectorXd x = global_search(problem);
  descend(problem, x);
  if (nodes == 2 && x(0) > x(1)) std::swap(x(0), x(1)), std::swap(x(2), x(3));

  const VectorXd residual = problem.residual(x);
  TorqueThermalFit fit{.order = order, .rms = std::sqrt(residual.squaredNorm() / static_cast<double>(problem.samples())), .correlation = samples_per_independent({residual.data(), static_cast<std::size_t>(residual.size())}, 0), .samples = static_cast<std::size_t>(problem.samples())};
  const MatrixXd covariance = covariance_of(problem.jacobian(x)) * (residual.squaredNorm() / static_cast<double>(problem.samples()) * fit.correlation);
  const double quantile = boost::math::quantile(boost::math::students_t(std::max(1.0, static_cast<double>(problem.samples()) / fit.correlation - static_cast<double>(unknowns))), 0.975);

  const auto info = thermal::parameters(order);
  std::vector<Estimate> gains, times;
  for (Index i = 0; i < nodes; ++i) {
    const double t_s = std::exp(x(i)), s = x(nodes + i), per_power = 1 / problem.mean_power_w();
    const Index k = nodes + i;
    // alpha c = s / (t W), alpha R_th = s / W.
    const double by_s = order == thermal::Order::first ? per_power : per_power / t_s, by_log_t = order == thermal::Order::first ? 0 : -s * per_power / t_s;
    gains.push_back(estimate(fmt::format("alpha_{}", info[static_cast<std::size_t>(i)].name), order == thermal::Order::first ? "1/W" : "1/J", s * by_s, by_s * by_s * covariance(k, k) + 2 * by_s * by_log_t * covariance(i, k) + by_log_t * by_log_t * covariance(i, i), quantile));
    const std::string name(info[static_cast<std::size_t>(nodes + i)].name);
    const bool bounded = x(i) < problem.low() + 1e-6 || x(i) > problem.high() - 1e-6;
    times.push_back(bounded ? without_sigma(name, "s", t_s, Status::at_bound) : estimate(name, "s", t_s, covariance(i, i) * t_s * t_s, quantile));
  }
  fit.parameters = gains;
  fit.parameters.insert(fit.parameters.end(), times.begin(), times.end());
  for (std::size_t f = 0; f < sessions.size(); ++f) {
    const VectorXd share = problem.share(x, sessions[f]);
    const Index k = 2 * nodes + static_cast<Index>(f);
    fit.power_w.push_back(estimate("P_0", "W", TorqueProblem::rest_power_w(share, sessions[f]), covariance(k, k), quantile));
    fit.final_to_cold = std::min(fit.final_to_cold, share.minCoeff());
  }
  const bool merged = nodes == 2 && times[1].value < closest_ratio * times[0].value;
  for (const auto& e : fit.parameters)
    if (merged || std::isnan(e.sigma) || e.high - e.low > std::abs(e.value)) fit.unidentifiable.push_back(e.name);
  return fit;
}

ThermalFit with_alpha(const TorqueThermalFit& fit, double alpha, bool alpha_known, double rest_degC) {
  constexpr std::string_view prefix = "alpha_";
  ThermalFit out{.parameters = fit.parameters, .ambient = {}, .model = {}, .rms_K = fit.rms / std::abs(alpha), .correlation = fit.correlation, .samples = fit.samples, .unidentifiable = fit.unidentifiable};
  for (auto& name : out.unidentifiable)
    if (name.starts_with(prefix)) name.erase(0, prefix.size());
  std::vector<double> values;
  const auto info = thermal::parameters(fit.order);
  for (std::size_t k = 0; k < info.size(); ++k) {
    Estimate& e = out.parameters[k];
    if (e.name.starts_with(prefix)) {
      e.name = info[k].name, e.unit = info[k].unit;
      e.value /= alpha, e.sigma /= std::abs(alpha), e.low /= alpha, e.high /= alpha;
      if (e.low > e.high) std::swap(e.low, e.high);
      if (!alpha_known && std::ranges::find(out.unidentifiable, e.name) == out.unidentifiable.end()) out.unidentifiable.push_back(e.name);
    }
    values.push_back(std::max(e.value, info[k].minimum));
  }
  out.model = thermal::make_model(fit.order, rest_degC, values);
  return out;
}

}  // namespace tribotwin::twin::identification
