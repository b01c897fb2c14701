#include <algorithm>
#include <cmath>
#include <limits>

#include <tribotwin/twin/identification/curves/separable.hpp>
#include <tribotwin/twin/numerics/least_squares.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using F = friction::GeneralLaw;

constexpr std::size_t grid_samples = 128, start_samples = 1024;
/// How near to its minimum a search ends, in sigmas of the samples it is made on.
constexpr double exact = 1e-4, near = 0.03;

/// Evenly spread samples, enough to find the deepest valley.
Samples thinned(const Samples& all, std::size_t count) {
  if (all.size() <= count) return all;
  std::vector<std::size_t> rows(count);
  // Golden-ratio steps within strides: no beat with speed levels that repeat.
  for (std::size_t i = 0; i < count; ++i) {
    const double stride = static_cast<double>(all.size()) / static_cast<double>(count),
                 jitter = 0.6180339887498949 * static_cast<double>(i);
    rows[i] = std::min(all.size() - 1,
                       static_cast<std::size_t>(stride * (static_cast<double>(i) + jitter - std::floor(jitter))));
  }
  return all.subset(rows);
}

std::vector<double> thinned_weights(const std::vector<double>& weights, std::size_t count) {
  if (weights.size() <= count) return weights;
  Samples carrier;
  carrier.speed = carrier.load = carrier.temperature_degC = carrier.friction = weights;
  return thinned(carrier, count).speed;
}

/// A^T B C of a dozen rows and columns at most, for which Eigen's way with large matrices is the slower one.
MatrixXd product(const MatrixXd& A, const MatrixXd& B, const MatrixXd& C) {
  const MatrixXd BC = B.lazyProduct(C);
  return A.transpose().lazyProduct(BC);
}

/// A x = c for symmetric positive semidefinite A; of many solutions the shortest in units of the columns.
VectorXd solution(const MatrixXd& A, const VectorXd& c) {
  const VectorXd unit = A.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  if (const auto x = symmetric_solution(unit.asDiagonal() * A * unit.asDiagonal(), unit.asDiagonal() * c, 1e-12))
    return unit.asDiagonal() * *x;
  return pseudo_inverse(A) * c;
}

/// min x^T N x / 2 - b^T x within bounds; `held` says which bounds are active. Active sets (Stark 1995): every step
/// stays within the bounds and goes down.
VectorXd bounded_solution(const MatrixXd& N, const VectorXd& b, const VectorXd& low, const VectorXd& high,
                          std::vector<bool>& held) {
  const Index n = b.size();
  held.assign(static_cast<std::size_t>(n), false);
  if (n == 0) return b;
  VectorXd x = solution(N, b);
  if ((x.array() >= low.array()).all() && (x.array() <= high.array()).all()) return x;
  x = x.cwiseMax(low).cwiseMin(high);
  for (Index round = 0; round < 10 * n + 10; ++round) {
    std::vector<Index> open;
    for (Index i = 0; i < n; ++i)
      if (!held[i]) open.push_back(i);
    // As far towards the best of these as the bounds let.
    double share = 1;
    Index stopped = -1;
    if (!open.empty()) {
      const VectorXd step = solution(N(open, open), b(open) - N(open, Eigen::all) * x);
      for (std::size_t k = 0; k < open.size(); ++k) {
        const Index i = open[k];
        const double to = x(i) + step(k), room = std::clamp(to, low(i), high(i)) - x(i);
        if (std::abs(to - x(i) - room) * std::sqrt(N(i, i)) > 1e-12 && room / step(k) < share)
          share = room / step(k), stopped = i;
      }
      x(open) += share * step;
    }
    if (stopped >= 0) {
      x(stopped) =
          std::abs(x(stopped) - low(stopped)) < std::abs(x(stopped) - high(stopped)) ? low(stopped) : high(stopped);
      held[stopped] = true;
      continue;
    }
    // Releases a bound from which the cost falls towards the inside.
    const VectorXd gradient = N * x - b;
    Index leave = -1;
    double gain = 1e-9;
    for (Index i = 0; i < n; ++i) {
      if (!held[i]) continue;
      const double pull = (x(i) <= low(i) ? -gradient(i) : gradient(i)) / std::sqrt(std::max(N(i, i), 1e-300));
      if (pull > gain * std::sqrt(std::max(b.dot(x), 1e-300))) gain = pull, leave = i;
    }
    if (leave < 0) break;
    held[leave] = false;
  }
  return x.cwiseMax(low).cwiseMin(high);
}

}  // namespace

Separable::Separable(const friction::LawInfo& law, const Samples& samples, std::vector<double> weights,
                     unsigned threads)
    : law_(&law), samples_(&samples), weights_(std::move(weights)), threads_(threads), place_(law) {
  const auto count = static_cast<Index>(law.parameters.size());
  to_parameters_ = MatrixXd::Identity(count, count);
  values_ = VectorXd::Zero(count);
  low_.resize(count);
  high_.resize(count);
  for (Index i = 0; i < count; ++i) low_(i) = law.parameters[i].minimum, high_(i) = law.parameters[i].maximum;
  free_.assign(law.parameters.size(), true);
  for (Index i = 0; i < count; ++i)
    if (const std::size_t base = base_of(static_cast<std::size_t>(i)); base != npos) {
      to_parameters_(i, static_cast<Index>(base)) = 1;
      low_(i) = 0;
    }
  if (!to_parameters_.isIdentity(0)) {
    place_.linear = place_.linear * to_parameters_;
    place_.nonlinear = place_.nonlinear * to_parameters_;
  }
}

std::size_t Separable::base_of(std::size_t parameter) const {
  const auto& all = law_->parameters;
  const auto base = std::ranges::find(all, all[parameter].not_below, &friction::Parameter::name);
  return base == all.end() ? npos : static_cast<std::size_t>(base - all.begin());
}

void Separable::hold(std::size_t parameter, double value) {
  free_[parameter] = false;
  values_(static_cast<Index>(parameter)) = value;
}

std::size_t Separable::parameter_of(double F::*field) const {
  for (std::size_t n = 0; n < place_.nonlinear_used.size(); ++n)
    if (nonlinear_fields[place_.nonlinear_used[n]] == field)
      for (Index j = 0; j < place_.nonlinear.cols(); ++j)
        if (place_.nonlinear(static_cast<Index>(n), j) != 0) return static_cast<std::size_t>(j);
  return npos;
}

Point Separable::at(const VectorXd& start, bool derivatives) const {
  Point point{.values = start,
              .general_law = {},
              .moments = {},
              .linear = {},
              .at_bound = std::vector<bool>(free_.size(), false),
              .cost = 0};
  VectorXd& u = point.values;
  std::vector<Index> searched;
  searched.reserve(free_.size());
  for (std::size_t j = 0; j < free_.size(); ++j) {
    const auto i = static_cast<Index>(j);
    if (!free_[j])
      u(i) = values_(i);
    else if (place_.is_linear(j))
      u(i) = 0, searched.push_back(i);
    else
      u(i) = std::clamp(u(i), low_(i), high_(i));
  }
  const VectorXd nonlinear = place_.nonlinear_offset + place_.nonlinear * u,
                 known = place_.linear_offset + place_.linear * u;
  point.general_law = place_.general_law(known, nonlinear);
  point.moments = accumulate(*samples_, weights_, place_, point.general_law, threads_, derivatives);
  const Moments& basis = point.moments;
  const MatrixXd Q = place_.linear(Eigen::all, searched), N = product(Q, basis.FF, Q);
  const VectorXd b = Q.transpose() * (basis.Fy - basis.FF * known), low = low_(searched), high = high_(searched);
  std::vector<bool> held;
  const VectorXd eta = bounded_solution(N, b, low, high, held);
  for (std::size_t i = 0; i < searched.size(); ++i)
    u(searched[i]) = eta(static_cast<Index>(i)), point.at_bound[searched[i]] = held[i];
  const VectorXd linear = known + Q * eta;
  point.general_law = place_.general_law(linear, nonlinear);
  point.cost = basis.cost(linear);
  point.linear = linear;
  return point;
}

Point Separable::again(const Point& point) const {
  Point now = point;
  now.moments = accumulate(*samples_, weights_, place_, point.general_law, threads_);
  now.cost = now.moments.cost(now.linear);
  return now;
}

/// The projected residual in as few numbers as there are nonlinear coordinates, plus one: Ceres' steps depend on J^T J,
/// J^T r and r^T r alone, and the triangular factor of these products has the same.
class ProjectedResidual final : public ceres::CostFunction {
 public:
  mutable Point best_;  ///< of all that were tried

  ProjectedResidual(const Separable& problem, const Point& first, const VectorXd& first_x, std::vector<Index> searched,
                    double scale)
      : best_(first),
        problem_(problem),
        start_(first.values),
        searched_(std::move(searched)),
        scale_(scale),
        last_(first),
        last_x_(first_x) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(searched_.size()));
    set_num_residuals(static_cast<int>(searched_.size()) + 1);
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const auto n = static_cast<Index>(searched_.size());
    const Eigen::Map<const VectorXd> x(parameters[0], n);
    // Ceres asks for the cost of a step and, once it takes it, for the derivatives there: the same passes give both.
    if (last_x_ != x) {
      VectorXd values = start_;
      for (Index i = 0; i < n; ++i) values(searched_[i]) = x(i);
      last_ = problem_.at(values);
      last_x_ = x;
      if (last_.cost < best_.cost) best_ = last_;
    }
    Eigen::Map<VectorXd> r(residuals, n + 1);
    if (!std::isfinite(last_.cost)) return false;
    r.setZero();
    r(n) = std::sqrt(last_.cost * scale_);
    if (!jacobians || !jacobians[0]) return true;
    const Placement& place = problem_.place_;
    const Moments::At sums = last_.moments.at(last_.linear);
    std::vector<Index> open;
    for (std::size_t j = 0; j < problem_.free_.size(); ++j)
      if (problem_.free_[j] && place.is_linear(j) && !last_.at_bound[j]) open.push_back(static_cast<Index>(j));
    const MatrixXd Q = place.linear(Eigen::all, open), R = place.nonlinear(Eigen::all, searched_);
    const MatrixXd inverse = pseudo_inverse(product(Q, last_.moments.FF, Q)), FD = product(Q, sums.FD, R),
                   S = product(Q, sums.Fr_by, R);
    MatrixXd products(n + 1, n + 1);
    const MatrixXd DD = product(R, sums.DD, R);
    products.topLeftCorner(n, n) = DD - product(FD, inverse, FD) + product(S, inverse, S);
    products.topRightCorner(n, 1) = -R.transpose() * sums.Dr;
    products.bottomLeftCorner(1, n) = products.topRightCorner(n, 1).transpose();
    products(n, n) = last_.cost;
    products *= scale_;
    // Of a derivative within the span of the linear terms only rounding is left.
    for (Index i = 0; i < n; ++i)
      if (products(i, i) < 1e-13 * scale_ * DD(i, i)) products.row(i).setZero(), products.col(i).setZero();
    const VectorXd unit = products.diagonal().cwiseMax(1e-300).cwiseSqrt();
    const MatrixXd normal = unit.cwiseInverse().asDiagonal() * products * unit.cwiseInverse().asDiagonal();
    MatrixXd root = triangular_root(normal);
    offset_ = root.col(n).head(n).squaredNorm() / std::max(root(n, n) * root(n, n), 1e-300);
    root = root * unit.asDiagonal();
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(jacobians[0], n + 1, n) =
        root.leftCols(n);
    r = root.col(n);
    return true;
  }
  /// What a step is expected to take off the cost where derivatives were last asked for, in parts of what no step
  /// takes: the square of the relative offset of Bates 1981.
  double offset() const { return offset_; }

 private:
  const Separable& problem_;
  const VectorXd start_;
  const std::vector<Index> searched_;
  const double scale_;
  mutable Point last_;
  mutable VectorXd last_x_;
  mutable double offset_ = std::numeric_limits<double>::infinity();
};

/// Ends a search whose next step would move the parameters by less than their noise.
struct Converged final : ceres::IterationCallback {
  const ProjectedResidual& residual;
  double offset;
  Converged(const ProjectedResidual& r, double o) : residual(r), offset(o) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    return residual.offset() < offset ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }
};

Point Separable::descend(const VectorXd& start, int iterations, double sigmas) const {
  std::vector<Index> searched;
  for (std::size_t j = 0; j < free_.size(); ++j)
    if (free_[j] && !place_.is_linear(j)) searched.push_back(static_cast<Index>(j));
  if (searched.empty()) return at(start);
  const auto n = static_cast<Index>(searched.size());
  VectorXd x(n);
  for (Index i = 0; i < n; ++i) x(i) = std::clamp(start(searched[i]), low_(searched[i]), high_(searched[i]));
  // Costs in units of the noise, so that Ceres' absolute tolerances mean something.
  Point first = at(start);
  if (first.cost <= 1e-26 * first.moments.yy) return first;  // nothing is left but rounding
  const double scale = static_cast<double>(samples_->size()) / first.cost;
  ProjectedResidual residual(*this, first, x, searched, scale);
  ceres::Solver::Options options;
  options.max_num_iterations = iterations;
  options.function_tolerance =
      1e-6 / static_cast<double>(samples_->size());  // where steps are short because the valley is curved
  options.parameter_tolerance = 1e-11;
  options.gradient_tolerance = 1e-13;
  options.max_num_line_search_step_size_iterations = 0;  // bounds are kept without it
  Converged converged(residual, sigmas * sigmas / static_cast<double>(samples_->size()));
  options.callbacks.push_back(&converged);
  least_squares(residual, x, low_(searched), high_(searched), options);
  return std::move(residual.best_);
}

Separable Separable::part(const Samples& samples, std::vector<double> weights) const {
  Separable copy = *this;
  copy.samples_ = &samples;
  copy.weights_ = std::move(weights);
  return copy;
}

std::vector<std::size_t> Separable::dependent_linear(const std::vector<std::size_t>& order) const {
  // Terms that are independent on some of the samples are so on all.
  if (samples_->size() > 4 * grid_samples) {
    const Samples few = thinned(*samples_, grid_samples);
    if (part(few, thinned_weights(weights_, grid_samples)).dependent_linear(order).empty()) return {};
  }
  // A term is dependent if it is within the span of the others everywhere on the grid.
  const std::vector<VectorXd> points = grid();
  std::vector<std::size_t> dependent;
  for (const std::size_t g : {std::size_t{0}, points.size() - 1}) {  // its two ends
    const MatrixXd FF = at(points[g], false).moments.FF;
    std::vector<std::size_t> kept, spare;
    for (const std::size_t j : order) {
      if (!free_[j] || !place_.is_linear(j)) continue;
      std::vector<std::size_t> with = kept;
      with.push_back(j);
      const MatrixXd Q = place_.linear(Eigen::all, with);
      MatrixXd N = product(Q, FF, Q);
      const VectorXd unit = N.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
      N = unit.asDiagonal() * N * unit.asDiagonal();
      const bool independent = N(N.rows() - 1, N.rows() - 1) > 0.5 && symmetric_eigenvalues(N)(0) > 1e-12;
      (independent ? kept : spare).push_back(j);
    }
    if (g == 0)
      dependent = spare;
    else
      std::erase_if(dependent, [&](std::size_t j) { return std::ranges::find(spare, j) == spare.end(); });
  }
  return dependent;
}

/// Start values of the nonlinear coordinates.
std::vector<VectorXd> Separable::grid() const {
  // No bindings: clang 14 cannot capture them.
  const auto temperature = std::ranges::minmax(samples_->temperature_degC);
  const double t_low = temperature.min, t_high = temperature.max;
  // Speeds spread over the decades that were measured.
  const auto speed = std::ranges::minmax(samples_->speed);
  const auto decade = [high = speed.max, low = std::max(speed.min, 1e-3 * speed.max)](double share) {
    return low * std::pow(high / low, share);
  };
  std::vector<VectorXd> points{values_};
  const auto branch = [&](std::size_t parameter, std::span<const double> choices) {
    if (parameter == npos || !free_[parameter]) return;
    std::vector<VectorXd> more;
    for (const VectorXd& p : points)
      for (const double c : choices) {
        more.push_back(p);
        more.back()(static_cast<Index>(parameter)) = std::clamp(c, low(parameter), high(parameter));
      }
    points = std::move(more);
  };
  // A quantity that changes with temperature: choices at both ends of the range.
  const auto branch_line = [&](double F::*level, double F::*slope, std::span<const double> choices) {
    const std::size_t a = parameter_of(level), b = parameter_of(slope);
    if (b == npos || !free_[b] || t_high - t_low < 1e-9) return branch(a, choices);
    std::vector<VectorXd> more;
    for (const VectorXd& p : points)
      for (const double at_low : choices)
        for (const double at_high : choices) {
          more.push_back(p);
          const double k = (at_high - at_low) / (t_high - t_low);
          more.back()(static_cast<Index>(b)) = k;
          if (free_[a])
            more.back()(static_cast<Index>(a)) = at_low - k * t_low;
          else
            more.back()(static_cast<Index>(b)) = (at_high - values_(static_cast<Index>(a))) / t_high;
        }
    points = std::move(more);
  };
  for (const auto& row : friction::formula::shape_numbers) {
    if (row.starts.count == 0) continue;
    std::vector<double> choices(row.starts.values, row.starts.values + row.starts.count);
    if (row.starts.of_speeds)
      for (double& x : choices) x = decade(x);
    const auto slope = std::ranges::find_if(friction::formula::shape_numbers, [&](const auto& other) {
      return other.quantity == row.quantity && other.degree == 1;
    });
    if (slope == std::end(friction::formula::shape_numbers))
      branch(parameter_of(row.number), choices);
    else
      branch_line(row.number, slope->number, choices);
  }
  return points;
}

Point Separable::minimise() const {
  // Ever more samples: each minimum is a start within the reach of one or two steps for the next.
  const Samples few = thinned(*samples_, grid_samples);
  const Separable coarse = part(few, thinned_weights(weights_, grid_samples));
  std::vector<std::pair<double, VectorXd>> starts;
  for (const VectorXd& p : grid()) starts.emplace_back(coarse.at(p, false).cost, p);
  std::ranges::stable_sort(starts, {}, [](const auto& s) { return s.first; });
  std::vector<Point> valleys;
  // Few nonlinear numbers have few valleys.
  std::size_t nonlinear = 0;
  for (std::size_t j = 0; j < free_.size(); ++j) nonlinear += free_[j] && !place_.is_linear(j);
  // The Stribeck velocities make the valleys: of starts that share them only the best is followed.
  const std::size_t places[] = {parameter_of(&F::vs), parameter_of(&F::vs_T)};
  const auto same_place = [&](const VectorXd& a, const VectorXd& b) {
    return std::ranges::all_of(
        places, [&](std::size_t j) { return j == npos || a(static_cast<Index>(j)) == b(static_cast<Index>(j)); });
  };
  std::vector<VectorXd> followed;
  for (const auto& [cost, found] : starts) {
    const VectorXd& start = found;  // which clang 14 can capture
    if (followed.size() == (nonlinear < 6 ? 3u : 9u)) break;
    if (std::ranges::any_of(followed, [&](const VectorXd& other) { return same_place(other, start); })) continue;
    followed.push_back(start);
    const Point valley = coarse.descend(start, nonlinear < 6 ? 12 : 40, near);
    // Two starts that ran into the same valley count once.
    if (std::ranges::none_of(valleys,
                             [&](const Point& v) { return std::abs(v.cost - valley.cost) <= 1e-3 * valley.cost; }))
      valleys.push_back(valley);
  }
  // A valley that lies clearly higher on the few samples does not become the deepest on more.
  const double lowest = std::ranges::min(valleys, {}, &Point::cost).cost;
  std::erase_if(valleys, [&](const Point& v) { return v.cost > (nonlinear < 6 ? 1.3 : 3) * lowest; });
  const auto deepest = [&](const Separable& problem, int iterations, double sigmas) {
    Point best = problem.descend(valleys.front().values, iterations, sigmas);
    for (std::size_t i = 1; i < valleys.size(); ++i)
      if (Point found = problem.descend(valleys[i].values, iterations, sigmas); found.cost < best.cost)
        best = std::move(found);
    return best;
  };
  for (std::size_t count = start_samples; 4 * count <= samples_->size(); count *= 16) {
    const Samples more = thinned(*samples_, count);
    valleys = {deepest(part(more, thinned_weights(weights_, count)), 60, near)};
  }
  return deepest(*this, 300, exact);
}

Point Separable::refine(const VectorXd& start) const { return descend(start, 300, exact); }

MatrixXd Separable::information(const Point& point, std::vector<std::size_t>& coordinates) const {
  coordinates.clear();
  for (std::size_t j = 0; j < free_.size(); ++j) {
    const auto i = static_cast<Index>(j);
    const bool at_edge = !place_.is_linear(j) && (point.values(i) <= low_(i) || point.values(i) >= high_(i));
    if (free_[j] && !point.at_bound[j] && !at_edge) coordinates.push_back(j);
  }
  const MatrixXd Q = place_.linear(Eigen::all, coordinates), R = place_.nonlinear(Eigen::all, coordinates);
  const Moments::At derivatives = point.moments.at(point.linear);
  const MatrixXd cross = product(Q, derivatives.FD, R);
  return product(Q, point.moments.FF, Q) + cross + cross.transpose() + product(R, derivatives.DD, R);
}

}  // namespace tribotwin::twin::identification
