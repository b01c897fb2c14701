#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <type_traits>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>
#include <tribotwin/twin/numerics/correlation.hpp>
#include <tribotwin/twin/numerics/least_squares.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr double copper = 0.00393;        // IEC 60028 [1/K]
constexpr std::size_t max_samples = 300;  // per session: bodies of many minutes

/// A session of all joints: joints x samples.
struct Session {
  std::vector<double> time_s;
  MatrixXd power_w, temperature_degC;  ///< power: mean since the sample before
};

std::size_t group_of(std::size_t samples, std::size_t limit) { return (samples + limit - 1) / limit; }

/// At most `limit` samples: means over groups of equal size, with the mean power between their mean times.
Session averaged(std::span<const JointHeat> joints, std::size_t session, std::size_t limit) {
  const auto& time = joints.front().sessions[session].time_s;
  const std::size_t group = group_of(time.size(), limit), count = time.size() / group;
  const auto n = static_cast<Index>(joints.size());
  Session out{.time_s = std::vector<double>(count, 0.0),
              .power_w = MatrixXd::Zero(n, static_cast<Index>(count)),
              .temperature_degC = MatrixXd::Zero(n, static_cast<Index>(count))};
  for (std::size_t i = 0; i < count * group; ++i) out.time_s[i / group] += time[i] / static_cast<double>(group);
  for (Index j = 0; j < n; ++j) {
    const HeatSession& s = joints[static_cast<std::size_t>(j)].sessions[session];
    double work = 0;
    VectorXd mean_work = VectorXd::Zero(static_cast<Index>(count));
    for (std::size_t i = 0; i < count * group; ++i) {
      const auto k = static_cast<Index>(i / group);
      if (i) work += s.power_w[i] * (time[i] - time[i - 1]);
      mean_work(k) += work / static_cast<double>(group);
      out.temperature_degC(j, k) += s.temperature_degC[i] / static_cast<double>(group);
    }
    for (std::size_t k = 1; k < count; ++k)
      out.power_w(j, static_cast<Index>(k)) =
          (mean_work(static_cast<Index>(k)) - mean_work(static_cast<Index>(k) - 1)) /
          (out.time_s[k] - out.time_s[k - 1]);
  }
  return out;
}

constexpr double copper_reference_degC = 25;

/// The state of all windings of a chain: heat flows on their way from the copper to the joints [W].
class WindingFlow {
 public:
  WindingFlow(const ChainWinding& winding, Index joints) : winding_(winding), flow_w_(VectorXd::Zero(joints)) {}
  /// From the mean power of the first time constant, as if it had gone on before.
  WindingFlow(const ChainWinding& winding, const Session& session) : winding_(winding) {
    Index first = 1;
    while (first + 1 < session.power_w.cols() &&
           session.time_s[static_cast<std::size_t>(first)] - session.time_s[0] < winding.winding_s)
      ++first;
    flow_w_ = resisted(session.power_w.middleCols(1, std::min(first, session.power_w.cols() - 1)).rowwise().mean(),
                       session.temperature_degC.col(0));
  }
  /// Mean flow over dt_s with this power and these temperatures of the joints.
  VectorXd advance(const VectorXd& power_w, const VectorXd& temperature_degC, double dt_s) {
    const VectorXd target = resisted(power_w, temperature_degC);
    if (winding_.winding_s == 0) return target;
    const double loss = -std::expm1(-dt_s / winding_.winding_s);
    const VectorXd mean = target + (flow_w_ - target) * loss * winding_.winding_s / dt_s;
    flow_w_ += (target - flow_w_) * loss;
    return mean;
  }

 private:
  VectorXd resisted(const VectorXd& power_w, const VectorXd& temperature_degC) const {
    return power_w.array() * (1 + winding_.copper_1_K * (temperature_degC.array() - copper_reference_degC));
  }
  ChainWinding winding_;
  VectorXd flow_w_;
};

/// The session with the heat that reaches the joints for its power, at the measured temperatures and from windings
/// without a flow, which ChainProblem adds.
Session behind_windings(Session session, const ChainWinding& winding) {
  if (winding == ChainWinding{}) return session;
  WindingFlow flow(winding, session.power_w.rows());
  for (Index k = 1; k < session.power_w.cols(); ++k) {
    const auto at = static_cast<std::size_t>(k);
    const VectorXd mean_degC = (session.temperature_degC.col(k - 1) + session.temperature_degC.col(k)) / 2;
    session.power_w.col(k) =
        flow.advance(session.power_w.col(k), mean_degC, session.time_s[at] - session.time_s[at - 1]);
  }
  return session;
}

/// The chain's matrix is symmetric: its modes relax independently, each exactly.
struct Modes {
  MatrixXd shape;  ///< columns
  VectorXd rate_1_s;

  Modes(const VectorXd& t_s, double exchange_1_s) {
    const Index n = t_s.size();
    MatrixXd m = t_s.cwiseInverse().asDiagonal();
    for (Index j = 0; j + 1 < n; ++j)
      m(j, j) += exchange_1_s, m(j + 1, j + 1) += exchange_1_s, m(j, j + 1) -= exchange_1_s,
          m(j + 1, j) -= exchange_1_s;
    const SymmetricEigen eigen = symmetric_eigen(m);
    shape = eigen.vectors;
    rate_1_s = eigen.values;
  }

  /// Amplitudes of the modes, modes x samples, from those at the start under constant drives [K/s] since the sample
  /// before, at which the amplitudes may decide them.
  template <class Drive>
  MatrixXd amplitudes(const std::vector<double>& time_s, VectorXd x, const Drive& drive) const {
    MatrixXd out(x.size(), static_cast<Index>(time_s.size()));
    out.col(0) = x;
    for (Index k = 1; k < out.cols(); ++k) {
      const auto at = static_cast<std::size_t>(k);
      const VectorXd loss =
          rate_1_s.unaryExpr([&](double rate) { return -std::expm1(-rate * (time_s[at] - time_s[at - 1])); });
      x += loss.cwiseProduct(drive(k, x).cwiseQuotient(rate_1_s) - x);
      out.col(k) = x;
    }
    return out;
  }
};

/// Unknowns: log t_j, then log k. Linear at each of them: g_j, A_j, the start of each session, and with windings what
/// flows out of them then.
class ChainProblem {
 public:
  ChainProblem(std::vector<Session> sessions, double winding_s)
      : sessions_(std::move(sessions)), n_(sessions_.front().power_w.rows()), winding_s_(winding_s) {
    for (const auto& s : sessions_) samples_ += n_ * static_cast<Index>(s.time_s.size());
    measured_.resize(samples_);
    Index row = 0;
    for (const auto& s : sessions_) {
      measured_.segment(row, s.temperature_degC.size()) = s.temperature_degC.reshaped();
      row += s.temperature_degC.size();
    }
  }

  Index joints() const { return n_; }
  Index samples() const { return samples_; }
  Index unknowns() const { return n_ * (2 + static_cast<Index>(sessions_.size()) * (winding_s_ > 0 ? 2 : 1)); }

  MatrixXd columns(const VectorXd& z) const {
    const VectorXd t_s = z.head(n_).array().exp();
    const Modes modes(t_s, std::exp(z(n_)));
    MatrixXd c = MatrixXd::Zero(samples_, unknowns());
    Index row = 0;
    for (std::size_t s = 0; s < sessions_.size(); ++s) {
      const Session& session = sessions_[s];
      const Index rows = session.power_w.size();
      const auto put = [&](Index column, const MatrixXd& amplitudes) {
        c.col(column).segment(row, rows) = (modes.shape * amplitudes).reshaped();
      };
      const VectorXd none = VectorXd::Zero(n_);
      for (Index j = 0; j < n_; ++j) {
        const VectorXd of_joint = modes.shape.row(j).transpose();
        put(j, modes.amplitudes(session.time_s, none,
                                [&](Index k, auto&) { return VectorXd(of_joint * session.power_w(j, k)); }));
        put(n_ + j, modes.amplitudes(session.time_s, none, [&](auto...) { return VectorXd(of_joint / t_s(j)); }));
        put((2 + static_cast<Index>(s)) * n_ + j,
            modes.amplitudes(session.time_s, of_joint, [&](auto...) { return none; }));
        if (winding_s_ > 0)
          put((2 + static_cast<Index>(sessions_.size() + s)) * n_ + j,
              modes.amplitudes(session.time_s, none,
                               [&](Index k, auto&) { return VectorXd(of_joint * left_of_flow(session.time_s, k)); }));
      }
      row += rows;
    }
    return c;
  }

  /// Gains that would be negative are fixed at 0, then surroundings that cannot be at the nearest that can.
  VectorXd linear(MatrixXd columns) const {
    VectorXd measured = measured_, fixed = VectorXd::Zero(columns.cols());
    while (true) {
      const VectorXd x = least_squares_solution(columns, measured) + fixed;  // 0 where a column is
      Index worst;
      if (x.head(n_).minCoeff(&worst) < 0) {
        columns.col(worst).setZero();
        continue;
      }
      const VectorXd ambient = x.segment(n_, n_),
                     possible = ambient.cwiseMax(lowest_ambient_degC).cwiseMin(highest_ambient_degC);
      if ((ambient - possible).cwiseAbs().maxCoeff(&worst) == 0) return x;
      fixed(n_ + worst) = possible(worst);
      measured -= possible(worst) * columns.col(n_ + worst);
      columns.col(n_ + worst).setZero();
    }
  }

  VectorXd residual(const VectorXd& z) const {
    const MatrixXd c = columns(z);
    return c * linear(c) - measured_;
  }

  /// Derivatives by z at fixed linear unknowns, then by these.
  MatrixXd jacobian(const VectorXd& z) const {
    constexpr double h = 1e-4;
    const MatrixXd c = columns(z);
    const VectorXd x = linear(c);
    MatrixXd J(samples_, z.size() + c.cols());
    for (Index k = 0; k < z.size(); ++k) {
      VectorXd up = z, down = z;
      up(k) += h, down(k) -= h;
      J.col(k) = (columns(up) - columns(down)) * x / (2 * h);
    }
    J.rightCols(c.cols()) = c;
    return J;
  }

 private:
  /// Mean since the sample before of a flow that was 1 at the start.
  double left_of_flow(const std::vector<double>& time_s, Index k) const {
    const auto at = static_cast<std::size_t>(k);
    const double from_s = time_s[at - 1] - time_s[0], dt_s = time_s[at] - time_s[at - 1];
    return std::exp(-from_s / winding_s_) * -std::expm1(-dt_s / winding_s_) * winding_s_ / dt_s;
  }

  std::vector<Session> sessions_;
  Index n_, samples_ = 0;
  double winding_s_;
  VectorXd measured_;
};

double descend(const ChainProblem& problem, VectorXd& z) {
  VectorXd low = VectorXd::Constant(z.size(), std::log(10.0)), high = VectorXd::Constant(z.size(), std::log(1e6));
  low(problem.joints()) = std::log(1e-7), high(problem.joints()) = std::log(0.1);
  const auto residual = by_differences<ceres::FORWARD>([&problem](const VectorXd& at) { return problem.residual(at); },
                                                       z.size(), problem.samples());
  ceres::Solver::Options options;
  options.max_num_iterations = 40;
  options.function_tolerance = 1e-7;
  return least_squares(*residual, z, low, high, options);
}

/// Why these joints are no chain.
Result<void> require_chain(std::span<const JointHeat> joints) {
  if (joints.size() < 2)
    return tl::unexpected(Error(fmt::format("{} joint with a temperature is no chain", joints.size())));
  for (const auto& joint : joints) {
    const auto same = [](const HeatSession& a, const HeatSession& b) {
      return a.file == b.file && a.time_s == b.time_s;
    };
    if (!std::ranges::equal(joint.sessions, joints.front().sessions, same))
      return tl::unexpected(Error(fmt::format("{} is not recorded at the times of {}; every file needs all joints",
                                              joint.name, joints.front().name)));
  }
  return {};
}

/// The first two thirds of every session (part 0), or the rest (1).
std::vector<JointHeat> parts(std::span<const JointHeat> joints, int part) {
  std::vector<JointHeat> out(joints.begin(), joints.end());
  for (JointHeat& joint : out)
    for (HeatSession& s : joint.sessions) {
      const auto middle = static_cast<std::ptrdiff_t>(s.time_s.size() * 2 / 3);
      for (std::vector<double>* column : {&s.time_s, &s.power_w, &s.temperature_degC})
        part == 0 ? column->erase(column->begin() + middle, column->end())
                  : column->erase(column->begin(), column->begin() + middle);
    }
  return out;
}

/// The best of several starts; empty where none has a finite cost.
VectorXd global_search(const ChainProblem& problem) {
  const Index n = problem.joints();
  VectorXd z;
  double lowest = std::numeric_limits<double>::infinity();
  for (const double exchange_s : {300.0, 1500.0, 8000.0}) {
    VectorXd start = VectorXd::Constant(n + 1, std::log(1500.0));
    start(n) = -std::log(exchange_s);
    if (const double cost = descend(problem, start); cost < lowest) lowest = cost, z = start;
  }
  return z;
}

/// Largest number of correlated samples per independent one, along the time of each joint.
double correlation_of(const VectorXd& residual, Index joints) {
  double correlation = 1;
  for (Index j = 0; j < joints; ++j) {
    const VectorXd own = residual(Eigen::seq(j, Eigen::last, joints));
    correlation = std::max(correlation, samples_per_independent({own.data(), static_cast<std::size_t>(own.size())}, 0));
  }
  return correlation;
}

std::size_t files_of(const std::vector<HeatSession>& sessions) {
  std::set<std::size_t> files;
  for (const auto& s : sessions) files.insert(s.file);
  return files.size();
}

/// Of exchange, then gain, t and T_amb of each joint, from that of log t_j, log k, gains and A.
MatrixXd covariance_in_file_order(const ThermalChain& chain, const MatrixXd& covariance) {
  const Index n = std::ssize(chain.joints);
  std::vector<Index> place{n};
  VectorXd scale = VectorXd::Ones(1 + 3 * n);
  scale(0) = chain.exchange_1_s;
  for (Index j = 0; j < n; ++j) {
    place.insert(place.end(), {n + 1 + j, j, 2 * n + 1 + j});
    scale(2 + 3 * j) = chain.t_s[static_cast<std::size_t>(j)];
  }
  return scale.asDiagonal() * MatrixXd(covariance(place, place)) * scale.asDiagonal();
}

/// The rule of identifiability for exchange, then JOINT.gain, JOINT.t, JOINT.T_amb, of which `covariance` is.
std::vector<Lacking> judged(const ThermalChainFit& fit, std::span<const JointHeat> joints, const MatrixXd& covariance) {
  std::vector<Estimate> all{fit.exchange};
  Evidence evidence{.parameters = {}, .covariance = covariance, .scale = {0}};
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const JointHeat& joint = joints[j];
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const auto& s : joint.sessions) {
      const auto [least, most] = std::ranges::minmax(s.temperature_degC);
      low = std::min(low, least), high = std::max(high, most);
      evidence.recorded_s = std::max(evidence.recorded_s, s.time_s.back() - s.time_s.front());
    }
    for (Estimate e : fit.parameters[j]) {
      e.name = joint.name + "." + e.name;
      all.push_back(std::move(e));
    }
    evidence.scale.insert(evidence.scale.end(), {0, 0, high - low});
    evidence.time_constants.push_back({joint.name + ".t", {}});
  }
  evidence.parameters = all;
  return lacking(evidence, thermal_advice(evidence.recorded_s));
}

/// Noise of samples whose means were fitted to `rms_K`: with what the means took, by how far samples are from the
/// straight line between their neighbours (Gasser, Sroka and Jennen-Steinmetz 1986), so that warming is no noise.
double noise_of_samples(std::span<const JointHeat> joints, double rms_K) {
  double taken = 0, count = 0;
  for (const JointHeat& joint : joints)
    for (const HeatSession& s : joint.sessions) {
      const auto &t = s.time_s, &T = s.temperature_degC;
      const double share = 1 - 1 / static_cast<double>(group_of(T.size(), max_samples));
      for (std::size_t i = 1; i + 1 < T.size(); ++i, ++count) {
        const double b = (t[i] - t[i - 1]) / (t[i + 1] - t[i - 1]), a = 1 - b;
        taken += share * std::pow(T[i] - a * T[i - 1] - b * T[i + 1], 2) / (1 + a * a + b * b);
      }
    }
  return std::sqrt(rms_K * rms_K + (count > 0 ? taken / count : 0));
}

}  // namespace

Result<ThermalChainFit> fit_thermal_chain(std::span<const JointHeat> joints, ChainWinding winding) {
  if (auto ok = require_chain(joints); !ok) return tl::unexpected(ok.error());
  std::vector<Session> sessions;
  for (std::size_t s = 0; s < joints.front().sessions.size(); ++s)
    sessions.push_back(behind_windings(averaged(joints, s, max_samples), winding));
  const ChainProblem problem(std::move(sessions), winding.winding_s);
  const Index n = problem.joints();
  if (problem.samples() <= problem.unknowns() + n + 1)
    return tl::unexpected(
        Error(fmt::format("{} samples for {} unknowns", problem.samples(), problem.unknowns() + n + 1)));
  const VectorXd z = global_search(problem);
  if (z.size() == 0)
    return tl::unexpected(Error("no chain has a finite error; check the data for values that no joint can have"));

  const VectorXd residual = problem.residual(z), x = problem.linear(problem.columns(z));
  ThermalChainFit fit{.chain = {},
                      .parameters = {},
                      .exchange = {},
                      .rms_K = std::sqrt(residual.squaredNorm() / static_cast<double>(residual.size())),
                      .correlation = correlation_of(residual, n),
                      .samples = static_cast<std::size_t>(problem.samples())};
  const MatrixXd covariance = covariance_of(problem.jacobian(z)) *
                              (residual.squaredNorm() / static_cast<double>(residual.size()) * fit.correlation);
  const double freedom =
      static_cast<double>(problem.samples()) / fit.correlation - static_cast<double>(covariance.cols());
  const double quantile = interval_sigmas(freedom);
  fit.chain.exchange_1_s = std::exp(z(n));
  fit.chain.winding = winding;
  fit.exchange = estimate("exchange", "1/s", fit.chain.exchange_1_s,
                          covariance(n, n) * fit.chain.exchange_1_s * fit.chain.exchange_1_s, quantile);
  for (Index j = 0; j < n; ++j) {
    const auto& name = joints[static_cast<std::size_t>(j)].name;
    const double t_s = std::exp(z(j)), gain = x(j), ambient = x(n + j);
    fit.chain.joints.push_back(name);
    fit.chain.gain_K_J.push_back(gain), fit.chain.t_s.push_back(t_s), fit.chain.ambient_degC.push_back(ambient);
    const Index first = n + 1;
    const bool possible = ambient > lowest_ambient_degC && ambient < highest_ambient_degC;
    fit.parameters.push_back(
        {gain == 0 ? without_sigma("gain", "K/J", 0, Status::held)
                   : estimate("gain", "K/J", gain, covariance(first + j, first + j), quantile),
         estimate("t", "s", t_s, covariance(j, j) * t_s * t_s, quantile),
         possible ? estimate("T_amb", "degC", ambient, covariance(first + n + j, first + n + j), quantile)
                  : without_sigma("T_amb", "degC", ambient, Status::at_bound)});
  }
  const MatrixXd in_file_order = covariance_in_file_order(fit.chain, covariance);
  if (can_be_propagated(in_file_order, numbers_of(fit.chain)))
    fit.uncertainty = {.covariance = in_file_order,
                       .sigmas = quantile,
                       .noise = {.white = noise_of_samples(joints, fit.rms_K)},
                       .surroundings = {.days = files_of(joints.front().sessions)},
                       .slower = {}};
  fit.lacking = judged(fit, joints, in_file_order);
  fit.unidentifiable = withheld(fit.lacking);
  return fit;
}

VectorXd numbers_of(const ThermalChain& chain) {
  const Index n = std::ssize(chain.joints);
  VectorXd out(1 + 3 * n);
  out(0) = chain.exchange_1_s;
  for (std::size_t k = 0; k < chain.joints.size(); ++k)
    out.segment(1 + 3 * static_cast<Index>(k), 3) << chain.gain_K_J[k], chain.t_s[k], chain.ambient_degC[k];
  return out;
}

MatrixXd predicted_temperatures(const ThermalChain& chain, std::span<const JointHeat> joints, std::size_t session) {
  const Session s = averaged(joints, session, joints.front().sessions[session].time_s.size());
  const auto vector = [](const std::vector<double>& v) {
    return Eigen::Map<const VectorXd>(v.data(), static_cast<Index>(v.size()));
  };
  const Modes modes(vector(chain.t_s), chain.exchange_1_s);
  const VectorXd surroundings = vector(chain.ambient_degC).cwiseQuotient(vector(chain.t_s));
  WindingFlow flow(chain.winding, s);
  VectorXd x = modes.shape.transpose() * s.temperature_degC.col(0);
  return modes.shape * modes.amplitudes(s.time_s, x, [&](Index k, const VectorXd& before) {
    const auto at = static_cast<std::size_t>(k);
    const VectorXd heat_w = flow.advance(s.power_w.col(k), modes.shape * before, s.time_s[at] - s.time_s[at - 1]);
    return VectorXd(modes.shape.transpose() * (vector(chain.gain_K_J).cwiseProduct(heat_w) + surroundings));
  });
}

Result<std::vector<WindingTrial>> try_windings(std::span<const JointHeat> joints) {
  if (auto ok = require_chain(joints); !ok) return tl::unexpected(ok.error());
  const std::vector<JointHeat> begin = parts(joints, 0), end = parts(joints, 1);
  std::vector<WindingTrial> trials;
  for (const double copper_1_K : {0.0, copper})
    for (const double winding_s : {0.0, 15.0, 30.0, 60.0, 120.0, 240.0, 480.0}) {
      WindingTrial trial{{winding_s, copper_1_K}};
      const auto fit = fit_thermal_chain(begin, trial.winding);
      if (!fit) return tl::unexpected(fit.error());
      double squares = 0, count = 0;
      for (std::size_t s = 0; s < end.front().sessions.size(); ++s) {
        const MatrixXd predicted = predicted_temperatures(fit->chain, end, s);
        for (Index j = 0; j < predicted.rows(); ++j) {
          const auto& measured = end[static_cast<std::size_t>(j)].sessions[s].temperature_degC;
          squares += (predicted.row(j).transpose() -
                      Eigen::Map<const VectorXd>(measured.data(), static_cast<Index>(measured.size())))
                         .squaredNorm();
          count += static_cast<double>(measured.size());
        }
      }
      trial.held_out_rms_K = std::sqrt(squares / count);
      trials.push_back(trial);
    }
  return trials;
}

}  // namespace tribotwin::twin::identification
