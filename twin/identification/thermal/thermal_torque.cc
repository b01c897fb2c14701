#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numeric>
#include <optional>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/identification/thermal/thermal_torque.hpp>
#include <tribotwin/twin/numerics/cma_es.hpp>
#include <tribotwin/twin/numerics/correlated_noise.hpp>
#include <tribotwin/twin/numerics/correlation.hpp>
#include <tribotwin/twin/numerics/least_squares.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Unknowns x: log t_i; s_i = alpha c_i t_i W, the final relative change of friction by node i at the mean power W of
/// all cycles; P_0 of each session over its mean power.
class TorqueProblem {
 public:
  TorqueProblem(std::span<const HeatSession> sessions, Index nodes) : sessions_(sessions), nodes_(nodes) {
    shortest_cycle_s_ = std::numeric_limits<double>::infinity();
    for (const auto& s : sessions) {
      first_.push_back(static_cast<Index>(time_s_.size()));
      time_s_.insert(time_s_.end(), s.time_s.begin(), s.time_s.end());
      const Eigen::Map<const VectorXd> power(s.cycle_power_w.data(), static_cast<Index>(s.cycle_power_w.size()));
      mean_power_w_.push_back(power.mean());
      samples_ += power.size();
      longest_s_ = std::max(longest_s_, since_start(s, s.time_s.size() - 1));
      shortest_cycle_s_ = std::min(shortest_cycle_s_, s.cycle_s);
    }
    typical_power_w_ =
        std::accumulate(mean_power_w_.begin(), mean_power_w_.end(), 0.0) / static_cast<double>(mean_power_w_.size());
    low_ = std::log(shortest_cycle_s_), high_ = std::log(10 * longest_s_);
  }

  Index nodes() const { return nodes_; }
  Index samples() const { return samples_; }
  SampleTimes times() const { return {time_s_, first_}; }
  double longest_s() const { return longest_s_; }  ///< session
  double shortest_cycle_s() const { return shortest_cycle_s_; }
  Index unknowns() const { return 2 * nodes_ + static_cast<Index>(sessions_.size()); }
  double typical_power_w() const { return typical_power_w_; }
  double mean_power_w(std::size_t session) const { return mean_power_w_[session]; }
  double rest_power_w(const VectorXd& x, std::size_t session) const {
    return x(2 * nodes_ + static_cast<Index>(session)) * mean_power_w_[session];
  }
  /// Range of log time constants: from a cycle to ten times the longest session.
  double low() const { return low_; }
  double high() const { return high_; }

  VectorXd clamped(VectorXd x) const {
    x.head(nodes_) = x.head(nodes_).cwiseMax(low_).cwiseMin(high_);
    return x;
  }

  /// With gains alpha c_i in place of c_i.
  thermal::Model model(const VectorXd& x) const {
    thermal::Model m{.order = nodes_ == 1 ? thermal::Order::first : thermal::Order::second};
    for (Index i = 0; i < nodes_; ++i)
      m.t_s[i] = std::exp(x(i)), m.gain_K_J[i] = x(nodes_ + i) / (typical_power_w_ * m.t_s[i]);
    return m;
  }

  /// (Model - measured power) / mean power of the session.
  VectorXd residual(const VectorXd& x) const {
    VectorXd r(samples_);
    const thermal::Model m = model(x);
    Index row = 0;
    for (std::size_t f = 0; f < sessions_.size(); ++f) {
      const auto& s = sessions_[f];
      const double rest = rest_power_w(x, f);
      for (std::size_t k = 0; k < s.time_s.size(); ++k)
        r(row++) = (rest * friction_share(m, 1, rest, since_start(s, k)) - s.cycle_power_w[k]) / mean_power_w_[f];
    }
    return r;
  }

  MatrixXd jacobian(const VectorXd& x) const {
    constexpr double h = 1e-4;
    MatrixXd J(samples_, x.size());
    for (Index k = 0; k < x.size(); ++k) {
      VectorXd up = x, down = x;
      up(k) += h, down(k) -= h;
      J.col(k) = (residual(up) - residual(down)) / (2 * h);
    }
    return J;
  }

  /// The first sample is the middle of the first cycle.
  static double since_start(const HeatSession& s, std::size_t k) {
    return s.time_s[k] - s.time_s.front() + s.cycle_s / 2;
  }

 private:
  std::span<const HeatSession> sessions_;
  Index nodes_, samples_ = 0;
  std::vector<double> mean_power_w_;
  std::vector<double> time_s_;
  std::vector<Index> first_;  ///< row of each session
  double typical_power_w_ = 0, longest_s_ = 0, shortest_cycle_s_ = 0, low_ = 0, high_ = 0;
};

VectorXd global_search(const TorqueProblem& problem) {
  const Index nodes = problem.nodes();
  VectorXd start = VectorXd::Ones(problem.unknowns());
  for (Index i = 0; i < nodes; ++i)
    start(i) =
        problem.low() + (problem.high() - problem.low()) * static_cast<double>(i + 1) / static_cast<double>(nodes + 1),
    start(nodes + i) = -0.2;
  Gaussian gaussian(1);
  const auto cost = [&](const VectorXd& x) {
    // Outside the range the cost is that of the nearest edge plus a penalty that leads back.
    const VectorXd inside = problem.clamped(x);
    return (problem.residual(inside).squaredNorm() + 1e-12) * (1 + (x - inside).squaredNorm());
  };
  return problem.clamped(
      answered(cma_es(start, {.population = 12, .first_step = 0.5, .last_step = 1e-3, .evaluations = 4000}, gaussian),
               cost)
          .z);
}

/// `slower_log_t`: where the second node's time constant is given.
void descend(const TorqueProblem& problem, VectorXd& x, std::optional<double> slower_log_t = {}) {
  VectorXd low = VectorXd::Constant(x.size(), std::numeric_limits<double>::lowest()), high = -low;
  low.head(problem.nodes()).setConstant(problem.low()), high.head(problem.nodes()).setConstant(problem.high());
  if (slower_log_t) low(1) = *slower_log_t - 1e-3, high(1) = *slower_log_t + 1e-3;
  const auto residual = by_differences<ceres::CENTRAL>([&problem](const VectorXd& at) { return problem.residual(at); },
                                                       x.size(), problem.samples());
  ceres::Solver::Options options;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-10;
  least_squares(*residual, x, low, high, options);
}

/// Why these cycles cannot identify a thermal model.
Result<void> require_cycles(std::span<const HeatSession> sessions, const TorqueProblem& problem) {
  if (std::ranges::adjacent_find(sessions, {}, &HeatSession::file) != sessions.end())
    return tl::unexpected(Error("a file with gaps of hours does not begin at rest temperature after each of them"));
  if (problem.samples() <= problem.unknowns())
    return tl::unexpected(Error(fmt::format("{} cycles for {} unknowns", problem.samples(), problem.unknowns())));
  for (std::size_t f = 0; f < sessions.size(); ++f)
    if (!(problem.mean_power_w(f) > 0))
      return tl::unexpected(Error(
          fmt::format("the mean power of the cycles is {:.3g} W, where that of friction is above 0; is the torque "
                      "or the motion of the other sign, or --work-cycle no period of it?",
                      problem.mean_power_w(f))));
  return {};
}

/// alpha c_i or, of first order, alpha R_th; then the time constants.
std::vector<Estimate> parameters_of(const TorqueProblem& problem, thermal::Order order, const VectorXd& x,
                                    const MatrixXd& covariance, double quantile) {
  const bool first_order = order == thermal::Order::first;
  const Index nodes = problem.nodes();
  const auto info = thermal::parameters(order);
  std::vector<Estimate> gains, times;
  for (Index i = 0; i < nodes; ++i) {
    const double t_s = std::exp(x(i)), s = x(nodes + i), per_power = 1 / problem.typical_power_w();
    const Index k = nodes + i;
    // alpha c = s / (t W), alpha R_th = s / W.
    const double by_s = first_order ? per_power : per_power / t_s, by_log_t = first_order ? 0 : -s * per_power / t_s;
    gains.push_back(estimate(fmt::format("alpha_{}", info[static_cast<std::size_t>(i)].name),
                             first_order ? "1/W" : "1/J", s * by_s,
                             by_s * by_s * covariance(k, k) + 2 * by_s * by_log_t * covariance(i, k) +
                                 by_log_t * by_log_t * covariance(i, i),
                             quantile));
    const std::string name(info[static_cast<std::size_t>(nodes + i)].name);
    const bool bounded = x(i) < problem.low() + 1e-6 || x(i) > problem.high() - 1e-6;
    times.push_back(bounded ? without_sigma(name, "s", t_s, Status::at_bound)
                            : estimate(name, "s", t_s, covariance(i, i) * t_s * t_s, quantile));
  }
  gains.insert(gains.end(), times.begin(), times.end());
  return gains;
}

/// The first order's interval of each parameter, as far as a slower body moves it that the record cannot exclude.
/// Returns the time constant of the one that reaches farthest; 0 where none reaches beyond the interval.
double widen_by_slower_body(std::span<const HeatSession> sessions, const VectorXd& x, const CorrelatedNoise& noise,
                            double quantile, std::vector<Estimate>& parameters) {
  const TorqueProblem problem(sessions, 2);
  if (problem.samples() <= problem.unknowns()) return 0;
  double reaching_s = 0;
  for (const double share : {0.5, 1.0, 2.0, 4.0}) {
    const double slower_s = share * problem.longest_s();
    if (slower_s < 1.5 * std::exp(x(0))) continue;
    VectorXd with(problem.unknowns());
    with << x(0), std::log(slower_s), x(1), 0, x.tail(x.size() - 2);
    descend(problem, with, std::log(slower_s));
    const MatrixXd C = least_squares_covariance(problem.jacobian(with), noise, problem.times());
    const double per_power = 1 / problem.typical_power_w(), t_s = std::exp(with(0));
    const double value[] = {(with(2) + with(3)) * per_power, t_s},
                 sigma[] = {std::sqrt(std::max(0.0, C(2, 2) + C(3, 3) + 2 * C(2, 3))) * per_power,
                            std::sqrt(C(0, 0)) * t_s};
    for (const std::size_t k : {0u, 1u}) {
      Estimate& e = parameters[k];
      const double half = std::abs(value[k] - e.value) + quantile * sigma[k];
      if (std::isnan(e.sigma) || !(half > e.high - e.value)) continue;
      e = estimate(e.name, e.unit, e.value, std::pow(half / quantile, 2), quantile);
      reaching_s = slower_s;
    }
  }
  return reaching_s;
}

/// The rule of identifiability. `slower_s`: of the slower body that widened the intervals, or 0.
void judge(const TorqueProblem& problem, double slower_s, TorqueThermalFit& fit) {
  const double recorded_s = problem.longest_s();
  std::vector<Estimate> all = fit.parameters;
  all.insert(all.end(), fit.power_w.begin(), fit.power_w.end());
  fit.lacking = merged_nodes(fit.parameters, fit.order);
  if (fit.lacking.empty())
    fit.lacking = lacking(thermal_evidence(all, fit.order, recorded_s), thermal_advice(recorded_s));
  for (auto& one : fit.lacking) {
    if (slower_s == 0 || one.lack != Lack::wide_interval) continue;
    const auto& e = *std::ranges::find(all, one.parameter, &Estimate::name);
    one.lack = Lack::short_record;
    one.reason = slower_body_reason(e, recorded_s, slower_s);
    one.next = thermal_advice(recorded_s)(e, Lack::short_record);
  }
  fit.unidentifiable = withheld(fit.lacking);
}

}  // namespace

double friction_share(const thermal::Model& model, double alpha, double rest_power_w, double time_s) {
  // y_i' = g_i z - y_i / t_i, z = 1 + sum y_i: z is its final value plus two exponentials; at the start z = 1 and
  // z' = sum g_i.
  const double g1 = alpha * model.gain_K_J[0] * rest_power_w, a1 = 1 / model.t_s[0] - g1;
  if (model.order == thermal::Order::first) {
    const double end = 1 / (model.t_s[0] * a1);
    return end + (1 - end) * std::exp(-a1 * time_s);
  }
  const double g2 = alpha * model.gain_K_J[1] * rest_power_w, a2 = 1 / model.t_s[1] - g2;
  const double end = 1 / (1 - g1 * model.t_s[0] - g2 * model.t_s[1]);
  const std::complex<double> apart = std::sqrt(std::complex<double>((a1 - a2) * (a1 - a2) / 4 + g1 * g2)),
                             fast = -(a1 + a2) / 2 - apart, slow = -(a1 + a2) / 2 + apart;
  if (std::abs(apart) * time_s < 1e-9)
    return end + (1 - end + (g1 + g2 - slow.real() * (1 - end)) * time_s) * std::exp(slow.real() * time_s);
  const std::complex<double> of_fast = (g1 + g2 - slow * (1 - end)) / (fast - slow);
  return (end + of_fast * std::exp(fast * time_s) + (1 - end - of_fast) * std::exp(slow * time_s)).real();
}

Result<TorqueThermalFit> fit_thermal_torque(std::span<const HeatSession> sessions, thermal::Order order) {
  const Index nodes = thermal::info(order).nodes;
  const TorqueProblem problem(sessions, nodes);
  if (auto ok = require_cycles(sessions, problem); !ok) return tl::unexpected(ok.error());
  VectorXd x = global_search(problem);
  descend(problem, x);
  if (nodes == 2 && x(0) > x(1)) std::swap(x(0), x(1)), std::swap(x(2), x(3));

  const VectorXd residual = problem.residual(x);
  if (!x.allFinite() || !residual.allFinite())
    return tl::unexpected(Error("the fit has no finite error; check the data for values that no joint can have"));
  TorqueThermalFit fit{.order = order,
                       .parameters = {},
                       .power_w = {},
                       .rms = std::sqrt(residual.squaredNorm() / static_cast<double>(problem.samples())),
                       .samples = static_cast<std::size_t>(problem.samples())};
  const MatrixXd jacobian = problem.jacobian(x);
  const CorrelatedNoise noise = correlated_noise(residual, jacobian, problem.times());
  fit.correlation =
      std::min(static_cast<double>(fit.samples), noise.samples_per_independent(problem.shortest_cycle_s()));
  const MatrixXd covariance = least_squares_covariance(jacobian, noise, problem.times());
  const double quantile = interval_sigmas(static_cast<double>(problem.samples()) / fit.correlation -
                                          static_cast<double>(problem.unknowns()));
  fit.parameters = parameters_of(problem, order, x, covariance, quantile);
  const double slower_s = nodes == 1 ? widen_by_slower_body(sessions, x, noise, quantile, fit.parameters) : 0;
  for (std::size_t f = 0; f < sessions.size(); ++f) {
    const Index k = 2 * nodes + static_cast<Index>(f);
    const double rest = problem.rest_power_w(x, f), mean = problem.mean_power_w(f);
    const std::string name = sessions.size() == 1 ? "P_0" : fmt::format("P_0[{}]", f + 1);
    fit.power_w.push_back(estimate(name, "W", rest, covariance(k, k) * mean * mean, quantile));
    fit.final_to_cold = std::min(
        fit.final_to_cold, friction_share(problem.model(x), 1, rest,
                                          TorqueProblem::since_start(sessions[f], sessions[f].time_s.size() - 1)));
  }
  judge(problem, slower_s, fit);
  return fit;
}

Estimate fit_alpha(std::span<const HeatSession> sessions, double rest_degC) {
  // Unknowns: alpha, then P_0 of each session; residuals over the session's mean power.
  Index samples = 0;
  for (const auto& s : sessions) samples += static_cast<Index>(s.time_s.size());
  const auto unknowns = 1 + static_cast<Index>(sessions.size());
  VectorXd x = VectorXd::Ones(unknowns), residual(samples);
  x(0) = 0;
  MatrixXd J = MatrixXd::Zero(samples, unknowns);
  constexpr int steps = 20;  // bilinear: a few would do
  for (int step = 0; step <= steps; ++step) {
    Index row = 0;
    for (Index f = 0; f + 1 < unknowns; ++f) {
      const HeatSession& s = sessions[static_cast<std::size_t>(f)];
      const auto n = static_cast<Index>(s.time_s.size());
      const VectorXd rise = Eigen::Map<const VectorXd>(s.temperature_degC.data(), n).array() - rest_degC;
      const Eigen::Map<const VectorXd> power(s.cycle_power_w.data(), n);
      J.col(0).segment(row, n) = x(1 + f) * rise;
      J.col(1 + f).segment(row, n) = VectorXd::Ones(n) + x(0) * rise;
      residual.segment(row, n) = power / power.mean() - x(1 + f) * J.col(1 + f).segment(row, n);
      row += n;
    }
    if (step < steps) x += least_squares_solution(J, residual);
  }
  const double correlation = samples_per_independent({residual.data(), static_cast<std::size_t>(samples)}, 0);
  const double quantile = interval_sigmas(static_cast<double>(samples) / correlation - static_cast<double>(unknowns));
  return estimate("alpha", "1/K", x(0),
                  covariance_of(J)(0, 0) * residual.squaredNorm() / static_cast<double>(samples) * correlation,
                  quantile);
}

ThermalFit with_alpha(const TorqueThermalFit& fit, double alpha, bool alpha_known, double rest_degC) {
  constexpr std::string_view prefix = "alpha_";  // of the gains
  ThermalFit out{.parameters = fit.parameters,
                 .ambient = {},
                 .model = {},
                 .rms_K = fit.rms / std::abs(alpha),
                 .correlation = fit.correlation,
                 .samples = fit.samples,
                 .unidentifiable = fit.unidentifiable};
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
      if (!alpha_known && std::ranges::find(out.unidentifiable, e.name) == out.unidentifiable.end())
        out.unidentifiable.push_back(e.name);
    }
    values.push_back(std::max(e.value, info[k].minimum));
  }
  out.model = thermal::make_model(fit.order, rest_degC, values);
  return out;
}

}  // namespace tribotwin::twin::identification
