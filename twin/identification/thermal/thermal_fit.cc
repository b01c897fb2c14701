#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>
#include <tribotwin/twin/identification/thermal/thermal_problem.hpp>
#include <tribotwin/twin/numerics/correlated_noise.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Gains, time constants and A of a point, as they are reported, and their covariance.
struct Reported {
  VectorXd values;
  MatrixXd covariance;
};

/// `nodes`: those of the model that is reported; the problem may have a slower one beside. Of first order the gain is
/// that of all nodes together, the final rise per watt; of second order c_i = R_i / t_i.
Reported reported(const ThermalProblem& problem, Index nodes, const VectorXd& log_t, const Projection& at,
                  const CorrelatedNoise& noise) {
  const Index all = problem.nodes(), rows = 2 * nodes + problem.files();
  Reported out{VectorXd(rows), {}};
  MatrixXd by = MatrixXd::Zero(rows, all + problem.unknowns());
  for (Index i = 0; i < nodes; ++i) {
    const double t_s = std::exp(log_t(i)), c = at.linear(i) / t_s;
    if (nodes == 1)
      out.values(i) = at.linear.head(all).sum(), by.row(i).segment(all, all).setOnes();
    else
      out.values(i) = c, by(i, all + i) = 1 / t_s, by(i, i) = -c;
    out.values(nodes + i) = t_s, by(nodes + i, i) = t_s;
  }
  for (Index f = 0; f < problem.files(); ++f)
    out.values(2 * nodes + f) = at.linear(all + f), by(2 * nodes + f, 2 * all + f) = 1;
  out.covariance = by * least_squares_covariance(problem.jacobian(log_t, at), noise, problem.times()) * by.transpose();
  return out;
}

/// Whether the data show the slowest node of a problem: its gain is above 0 by more than its interval.
bool shows_slowest(const ThermalProblem& problem, const VectorXd& log_t, const Projection& at, double quantile) {
  const Index own = problem.nodes() - 1, k = problem.nodes() + own;  // of the unknowns: log times first, then gains
  if (at.linear(own) == 0) return false;
  const MatrixXd jacobian = problem.jacobian(log_t, at);
  const CorrelatedNoise noise = correlated_noise(at.residual, jacobian, problem.times());
  return at.linear(own) > quantile * std::sqrt(least_squares_covariance(jacobian, noise, problem.times())(k, k));
}

/// Whether all gains of a fit are known better than to their own size.
bool gains_known(const Reported& own, Index nodes, double quantile) {
  for (Index k = 0; k < nodes; ++k)
    if (!(quantile * std::sqrt(own.covariance(k, k)) < own.values(k))) return false;
  return true;
}

/// How far a slower body, which the record cannot exclude, moves what is reported. A gear has two nodes at least
/// (Pagani, Hao), so the first order always has a slower one to fear; the second order where the data show a third, or
/// do not show its own gains.
struct Reach {
  VectorXd half;      ///< of the interval around the reported value that contains all of its intervals
  VectorXd slower_s;  ///< the time constant that reaches so far
  std::vector<WarmBodies> models = {};
};

/// All bodies of a point, with the mean of A.
WarmBodies bodies_of(const ThermalProblem& problem, const VectorXd& log_t, const Projection& at) {
  WarmBodies out{.t_s = {}, .gain_K_J = {}, .ambient_degC = at.linear.segment(problem.nodes(), problem.files()).mean()};
  for (Index i = 0; i < problem.nodes(); ++i) {
    out.t_s.push_back(std::exp(log_t(i)));
    out.gain_K_J.push_back(at.linear(i) / out.t_s.back());
  }
  return out;
}

Reach reach_of_slower_body(std::span<const HeatSession> sessions, const ThermalOptions& options, const VectorXd& log_t,
                           const Reported& own, const CorrelatedNoise& noise, double quantile) {
  const Index nodes = log_t.size();
  const ThermalProblem problem(sessions, nodes + 1, options.rested);
  Reach reach{VectorXd::Zero(own.values.size()), VectorXd::Zero(own.values.size())};
  if (problem.samples() <= problem.unknowns() + nodes + 1) return reach;
  const bool feared = nodes == 1 || !gains_known(own, nodes, quantile);
  for (const double share : {0.5, 1.0, 2.0}) {
    const double slower_s = share * problem.longest_s();
    if (slower_s < 1.5 * std::exp(log_t(nodes - 1))) continue;
    VectorXd with(nodes + 1);
    with << log_t, std::log(slower_s);
    descend(problem, with, nodes);
    const Projection at = problem.project(with);
    if (!std::isfinite(at.cost()) || (!feared && !shows_slowest(problem, with, at, quantile))) continue;
    reach.models.push_back(bodies_of(problem, with, at));
    const Reported other = reported(problem, nodes, with, at, noise);
    for (Index k = 0; k < own.values.size(); ++k) {
      const double half =
          std::abs(other.values(k) - own.values(k)) + quantile * std::sqrt(std::max(0.0, other.covariance(k, k)));
      if (half > reach.half(k)) reach.half(k) = half, reach.slower_s(k) = slower_s;
    }
  }
  return reach;
}

/// One fit in the making.
struct Found {
  const ThermalProblem& problem;
  VectorXd log_t;
  Projection at;
  Reported own;
  Reach reach;
  double quantile = 2;
};

Estimate estimate_of(const Found& f, Index k, std::string_view name, std::string_view unit) {
  const double variance = std::max(f.own.covariance(k, k), std::pow(f.reach.half(k) / f.quantile, 2));
  return estimate(std::string(name), std::string(unit), f.own.values(k), variance, f.quantile);
}

std::vector<Estimate> parameters_of(const Found& f, thermal::Order order) {
  const auto info = thermal::parameters(order);
  const Index nodes = f.problem.nodes();
  const auto [low, high] = f.problem.range();
  std::vector<Estimate> out;
  for (Index k = 0; k < 2 * nodes; ++k) {
    const auto& own = info[static_cast<std::size_t>(k)];
    const bool gain = k < nodes;
    if (gain && f.at.linear(k) == 0)
      out.push_back(without_sigma(std::string(own.name), std::string(own.unit), 0, Status::held));
    else if (!gain && (f.log_t(k - nodes) < low + 1e-6 || f.log_t(k - nodes) > high - 1e-6))
      out.push_back(without_sigma(std::string(own.name), std::string(own.unit), f.own.values(k), Status::at_bound));
    else
      out.push_back(estimate_of(f, k, own.name, own.unit));
  }
  return out;
}

/// Share of the residuals' variance that neighbours have in common; none where they are rounding.
double common_share(const ThermalProblem& problem, const CorrelatedNoise& noise, double rms_K) {
  if (noise.correlation_s <= 0 || rms_K < 1e-6 * problem.range_K(0)) return 0;
  return noise.slow * noise.slow / noise.variance() * std::exp(-problem.step_s() / noise.correlation_s);
}

/// Share of the temperatures' variance within files that the model explains.
double explained_share(const ThermalProblem& problem, const Projection& at) {
  const VectorXd& T = problem.measured();
  return 1 - at.cost() / std::max(1e-300, (T.array() - T.mean()).square().sum());
}

/// Where not its own interval but a slower body makes a parameter unknown, that is the reason: the record is short.
void name_slower_body(const Found& f, const std::vector<Estimate>& all, std::vector<Lacking>& lacking) {
  for (auto& one : lacking) {
    const auto e = std::ranges::find(all, one.parameter, &Estimate::name);
    const auto k = static_cast<Index>(e - all.begin());
    const double own = 2 * f.quantile * std::sqrt(f.own.covariance(k, k));
    if (one.lack != Lack::wide_interval || !(own < 0.999 * (e->high - e->low))) continue;
    one.lack = Lack::short_record;
    one.reason = slower_body_reason(*e, f.problem.longest_s(), f.reach.slower_s(k));
    one.next = thermal_advice(f.problem.longest_s())(*e, Lack::short_record);
  }
}

/// T_amb is what is left when all bodies have settled: no number without the slowest time constant.
void withhold_ambient(const std::string& slowest, const std::vector<Estimate>& all, std::vector<Lacking>& lacking) {
  const auto time = std::ranges::find(lacking, slowest, &Lacking::parameter);
  if (time == lacking.end() || !time->withheld) return;
  const Lacking because = *time;
  for (const auto& e : all) {
    if (!e.name.starts_with("T_amb")) continue;
    auto own = std::ranges::find(lacking, e.name, &Lacking::parameter);
    if (own == lacking.end()) own = lacking.insert(lacking.end(), {.parameter = e.name});
    if (own->withheld && !own->reason.empty()) continue;
    *own = {e.name, because.lack, fmt::format("it is known only together with {}", slowest), because.next};
  }
}

/// The rule, for the parameters and then T_amb of each file.
std::vector<Lacking> judged(const Found& f, thermal::Order order, const ThermalFit& fit) {
  std::vector<Estimate> all = fit.parameters;
  all.insert(all.end(), fit.ambient.begin(), fit.ambient.end());
  Evidence evidence = thermal_evidence(all, order, f.problem.longest_s());
  evidence.covariance = f.own.covariance;
  evidence.scale.assign(fit.parameters.size(), 0);
  // The temperature without power is compared with what the power does to it.
  for (Index file = 0; file < f.problem.files(); ++file) evidence.scale.push_back(f.problem.range_K(file));
  evidence.common = common_share(f.problem, fit.noise, fit.rms_K);
  evidence.explained = explained_share(f.problem, f.at);
  auto out = merged_nodes(fit.parameters, order);
  if (!out.empty()) return out;
  out = lacking(evidence, thermal_advice(f.problem.longest_s()));
  name_slower_body(f, all, out);
  withhold_ambient(time_constants(fit).back().name, all, out);
  return out;
}

/// Why these sessions cannot be fitted.
Result<void> require(std::span<const HeatSession> sessions, const ThermalProblem& problem) {
  if (std::ranges::any_of(sessions, [](const HeatSession& s) { return s.temperature_degC.empty(); }))
    return tl::unexpected(Error("has no temperatures"));
  const Index unknowns = problem.unknowns() + problem.nodes();
  if (problem.samples() <= unknowns)
    return tl::unexpected(Error(fmt::format("{} samples for {} unknowns", problem.samples(), unknowns)));
  return {};
}

/// Of the model's parameters and the mean of A.
std::optional<ThermalUncertainty> uncertainty_of(const Found& f, const CorrelatedNoise& noise) {
  const Index parameters = 2 * f.problem.nodes(), files = f.problem.files();
  MatrixXd by = MatrixXd::Zero(parameters + 1, parameters + files);
  by.topLeftCorner(parameters, parameters).setIdentity();
  by.row(parameters).tail(files).setConstant(1 / static_cast<double>(files));
  const VectorXd ambient = f.own.values.tail(files);
  MatrixXd covariance = by * f.own.covariance * by.transpose();
  if (!can_be_propagated(covariance, by * f.own.values)) return std::nullopt;
  return ThermalUncertainty{.covariance = std::move(covariance),
                            .sigmas = f.quantile,
                            .noise = noise,
                            .surroundings = Surroundings::of({ambient.data(), static_cast<std::size_t>(files)}),
                            .slower = f.reach.models};
}

ThermalFit fit_of(Found& f, std::span<const HeatSession> sessions, const ThermalOptions& options) {
  const Index nodes = f.problem.nodes();
  const auto samples = static_cast<double>(f.problem.samples());
  const MatrixXd jacobian = f.problem.jacobian(f.log_t, f.at);
  ThermalFit fit{.parameters = {}, .ambient = {}, .model = {}, .rms_K = std::sqrt(f.at.cost() / samples)};
  fit.noise = correlated_noise(f.at.residual, jacobian, f.problem.times());
  // No thermometer is better; of a simulation's rounding no node is identified.
  fit.noise.white = std::max(fit.noise.white, 1e-5 * f.problem.range_K(0));
  fit.correlation = std::min(samples, fit.noise.samples_per_independent(f.problem.step_s()));
  fit.samples = static_cast<std::size_t>(f.problem.samples());
  f.own = reported(f.problem, nodes, f.log_t, f.at, fit.noise);
  f.quantile = interval_sigmas(samples / fit.correlation - static_cast<double>(jacobian.cols()));
  f.reach = reach_of_slower_body(sessions, options, f.log_t, f.own, fit.noise, f.quantile);
  fit.uncertainty = uncertainty_of(f, fit.noise);
  fit.parameters = parameters_of(f, options.order);
  for (Index file = 0; file < f.problem.files(); ++file) {
    const std::string name = f.problem.files() == 1 ? "T_amb" : fmt::format("T_amb[{}]", file + 1);
    fit.ambient.push_back(estimate_of(f, 2 * nodes + file, name, "degC"));
  }
  fit.lacking = judged(f, options.order, fit);
  fit.unidentifiable = withheld(fit.lacking);
  const auto info = thermal::parameters(options.order);
  std::vector<double> values;
  for (std::size_t k = 0; k < info.size(); ++k)
    values.push_back(std::max(fit.parameters[k].value, info[k].minimum));  // also where a gain is 0
  fit.model = thermal::make_model(options.order, f.own.values.tail(f.problem.files()).mean(), values);
  return fit;
}

}  // namespace

Result<ThermalFit> fit_thermal(std::span<const HeatSession> sessions, const ThermalOptions& options) {
  const ThermalProblem problem(sessions, thermal::info(options.order).nodes, options.rested);
  if (auto ok = require(sessions, problem); !ok) return tl::unexpected(ok.error());
  VectorXd log_t = global_search(problem);
  if (log_t.size() == 0)
    return tl::unexpected(
        Error("no thermal model has a finite error; check the data for values that no joint can have"));
  descend(problem, log_t, problem.nodes());
  std::sort(log_t.data(), log_t.data() + log_t.size());
  Found found{.problem = problem, .log_t = log_t, .at = problem.project(log_t), .own = {}, .reach = {}};
  if (!std::isfinite(found.at.cost()))
    return tl::unexpected(Error("the fit has no finite error; check the data for values that no joint can have"));
  return fit_of(found, sessions, options);
}

std::span<const Estimate> time_constants(const ThermalFit& fit) {
  return std::span(fit.parameters).last(fit.parameters.size() / 2);
}

Evidence thermal_evidence(std::span<const Estimate> parameters, thermal::Order order, double recorded_s) {
  Evidence evidence{.parameters = parameters};
  evidence.recorded_s = recorded_s;
  const auto nodes = static_cast<std::size_t>(thermal::info(order).nodes);
  // The gain of first order is the final rise per watt, which only a settled joint shows; c_i is the slope at the
  // start.
  for (std::size_t i = 0; i < nodes; ++i)
    evidence.time_constants.push_back({parameters[nodes + i].name, order == thermal::Order::first
                                                                       ? std::vector{parameters[i].name}
                                                                       : std::vector<std::string>{}});
  return evidence;
}

Advice thermal_advice(double recorded_s) {
  return [recorded_s](const Estimate& e, Lack lack) {
    const bool time = e.unit == "s";
    const double known_s = time ? (std::isnan(e.high) ? e.value : e.high) : 0;
    const double hours = std::max(4 * recorded_s, std::min(2 * known_s, 20 * recorded_s)) / 3600;
    switch (lack) {
      case Lack::no_effect:
        return std::string("record hours of different power: fast, slow and idle");
      case Lack::short_record:
        return fmt::format("record {:.{}f} h or more without a gap, with different power on the way", hours,
                           hours < 10 ? 1 : 0);
      case Lack::wide_interval:
      case Lack::at_bound:
      case Lack::correlated:
        return std::string("record longer, with different power on the way, or from rest (--rested)");
      case Lack::structured:
        return std::string("record the surroundings, or its neighbours for --chain");
      case Lack::no_whole_cycle:
        break;
    }
    return std::string();
  };
}

std::string slower_body_reason(const Estimate& e, double recorded_s, double slower_s) {
  constexpr double any = 1e6;  // of K, s, K/W or K/J: no joint has that
  return fmt::format("the record, {:.3g} h, is too short to exclude a slower body ({:.2g} h), with which it may be {}",
                     recorded_s / 3600, slower_s / 3600,
                     e.high - e.low > any ? "anything" : fmt::format("{:.3g} .. {:.3g} {}", e.low, e.high, e.unit));
}

std::vector<Lacking> merged_nodes(std::span<const Estimate> parameters, thermal::Order order) {
  std::vector<Lacking> out;
  const auto times = parameters.last(parameters.size() / 2);
  if (order != thermal::Order::second || times[1].value >= closest_ratio * times[0].value) return out;
  for (const auto& e : parameters)
    out.push_back(
        {e.name, Lack::correlated,
         fmt::format("t1 and t2 are within {:.0f} %: one node explains these data", 100 * (closest_ratio - 1)),
         "record longer, with different power on the way, or use --order 1"});
  return out;
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
