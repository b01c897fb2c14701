#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <tribotwin/twin/identification/thermal/thermal_problem.hpp>
#include <tribotwin/twin/numerics/least_squares.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr int grid_points = 24;

/// Response of a node of gain 1 K/W to the power and to 1 K at the start.
struct Response {
  VectorXd power, start;
};

Response response(const HeatSession& session, double t_s) {
  const auto n = static_cast<Index>(session.time_s.size());
  Response r{VectorXd(n), VectorXd(n)};
  double heated = 0, kept = 1;
  for (std::size_t i = 0; i < session.time_s.size(); ++i) {
    const double before = i ? session.time_s[i - 1] : session.start_s.value_or(session.time_s[0]),
                 loss = -std::expm1(-(session.time_s[i] - before) / t_s);
    heated += (session.power_w[i] - heated) * loss;
    kept -= kept * loss;
    r.power(static_cast<Index>(i)) = heated;
    r.start(static_cast<Index>(i)) = kept;
  }
  return r;
}

/// The residual as a function of the first `free` time constants alone, with the derivatives of Kaufman 1975: those at
/// fixed linear unknowns, projected onto the complement of the linear columns.
class ProjectedResidual final : public ceres::CostFunction {
 public:
  ProjectedResidual(const ThermalProblem& problem, const VectorXd& log_t, Index free)
      : problem_(problem), log_t_(log_t), free_(free) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(free));
    set_num_residuals(static_cast<int>(problem.samples()));
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    VectorXd log_t = log_t_;
    log_t.head(free_) = Eigen::Map<const VectorXd>(parameters[0], free_);
    const Projection at = problem_.project(log_t);
    Eigen::Map<VectorXd>(residuals, problem_.samples()) = at.residual;
    if (!jacobians || !jacobians[0]) return true;
    const MatrixXd slopes = problem_.slopes(log_t, at.linear).leftCols(free_);
    MatrixXd columns = at.columns;
    for (Index node = 0; node < problem_.nodes(); ++node)
      if (at.linear(node) == 0) columns.col(node).setZero();  // a gain fixed at 0
    const MatrixXd projected = slopes - columns * least_squares_solutions(columns, slopes);
    for (Index i = 0; i < problem_.samples(); ++i)
      for (Index k = 0; k < free_; ++k) jacobians[0][i * free_ + k] = projected(i, k);
    return true;
  }

 private:
  const ThermalProblem& problem_;
  VectorXd log_t_;
  Index free_;
};

}  // namespace

ThermalProblem::ThermalProblem(std::span<const HeatSession> sessions, Index nodes, bool rested)
    : sessions_(sessions), nodes_(nodes), step_s_(std::numeric_limits<double>::infinity()) {
  std::map<std::size_t, Index> files;
  std::vector<bool> at_rest;
  for (const auto& s : sessions) {
    const auto [file, first_of_file] = files.try_emplace(s.file, static_cast<Index>(files.size()));
    file_.push_back(file->second);
    at_rest.push_back(rested && first_of_file);
    first_.push_back(static_cast<Index>(time_s_.size()));
    time_s_.insert(time_s_.end(), s.time_s.begin(), s.time_s.end());
    const double length = s.time_s.back() - s.time_s.front();
    longest_s_ = std::max(longest_s_, length);
    step_s_ = std::min(step_s_, length / static_cast<double>(s.time_s.size() - 1));
  }
  files_ = static_cast<Index>(files.size());
  unknowns_ = nodes_ + files_;
  for (const bool rests : at_rest) {
    start_.push_back(rests ? std::nullopt : std::optional(unknowns_));
    if (!rests) unknowns_ += nodes_;
  }
  measured_.resize(static_cast<Index>(time_s_.size()));
  Index row = 0;
  for (const auto& s : sessions)
    for (const double T : s.temperature_degC) measured_(row++) = T;
}

double ThermalProblem::range_K(Index file) const {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (std::size_t s = 0; s < sessions_.size(); ++s) {
    if (file_[s] != file) continue;
    const auto [least, most] = std::ranges::minmax(sessions_[s].temperature_degC);
    low = std::min(low, least), high = std::max(high, most);
  }
  return high - low;
}

MatrixXd ThermalProblem::columns(const VectorXd& log_t) const {
  MatrixXd c = MatrixXd::Zero(samples(), unknowns_);
  for (Index node = 0; node < nodes_; ++node)
    for (std::size_t s = 0; s < sessions_.size(); ++s) {
      const Response r = response(sessions_[s], std::exp(log_t(node)));
      c.col(node).segment(first_[s], r.power.size()) = r.power;
      c.col(nodes_ + file_[s]).segment(first_[s], r.power.size()).setOnes();
      if (start_[s]) c.col(*start_[s] + node).segment(first_[s], r.power.size()) = r.start;
    }
  return c;
}

Projection ThermalProblem::project(const VectorXd& log_t) const {
  Projection best{.columns = columns(log_t), .linear = {}, .residual = {}};
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

MatrixXd ThermalProblem::slopes(const VectorXd& log_t, const VectorXd& linear) const {
  constexpr double h = 1e-4;
  MatrixXd d(samples(), nodes_);
  for (Index i = 0; i < nodes_; ++i) {
    VectorXd up = log_t, down = log_t;
    up(i) += h, down(i) -= h;
    d.col(i) = (columns(up) - columns(down)) * linear / (2 * h);
  }
  return d;
}

MatrixXd ThermalProblem::jacobian(const VectorXd& log_t, const Projection& at) const {
  MatrixXd J(samples(), nodes_ + unknowns_);
  J.leftCols(nodes_) = slopes(log_t, at.linear);
  J.rightCols(unknowns_) = at.columns;
  return J;
}

std::pair<double, double> ThermalProblem::range() const { return {std::log(2 * step_s_), std::log(10 * longest_s_)}; }

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

void descend(const ThermalProblem& problem, VectorXd& log_t, Index free) {
  const auto [low, high] = problem.range();
  ProjectedResidual residual(problem, log_t, free);
  ceres::Solver::Options options;
  options.max_num_iterations = 50;
  options.function_tolerance = 1e-9;
  VectorXd moved = log_t.head(free);
  least_squares(residual, moved, VectorXd::Constant(free, low), VectorXd::Constant(free, high), options);
  log_t.head(free) = moved;
}

}  // namespace tribotwin::twin::identification
