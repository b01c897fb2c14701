#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <tribotwin/twin/identification/rigid_body/consistency.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_problem.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>
#include <tribotwin/twin/numerics/triangular_factor.hpp>
#include <tribotwin/twin/robot/inertial_prior/inertial_prior.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::Matrix4d, Eigen::MatrixXd, Eigen::VectorXd;

constexpr int per_body = 10;
/// Row and column of the ten coordinates of a symmetric matrix.
constexpr int lower[per_body][2] = {{0, 0}, {1, 0}, {1, 1}, {2, 0}, {2, 1}, {2, 2}, {3, 0}, {3, 1}, {3, 2}, {3, 3}};

using Ten = Eigen::Matrix<double, per_body, 1>;

/// Pseudo-inertia to Ixx Ixy Ixz Iyy Iyz Izz mx my mz m: linear.
Ten parameters_of(const Matrix4d& J) {
  Ten p;
  p << J(1, 1) + J(2, 2), -J(0, 1), -J(0, 2), J(0, 0) + J(2, 2), -J(1, 2), J(0, 0) + J(1, 1), J(0, 3), J(1, 3), J(2, 3),
      J(3, 3);
  return p;
}

Matrix4d pseudo_inertia(const Ten& p) {
  const double half = 0.5 * (p(0) + p(3) + p(5));
  Matrix4d J;
  J << half - p(0), -p(1), -p(2), p(6), -p(1), half - p(3), -p(4), p(7), -p(2), -p(4), half - p(5), p(8), p(6), p(7),
      p(8), p(9);
  return J;
}

/// The symmetric matrix of length |d| with these coordinates.
Matrix4d symmetric(const Ten& d) {
  Matrix4d D;
  for (int k = 0; k < per_body; ++k) {
    const auto [row, column] = lower[k];
    D(row, column) = D(column, row) = row == column ? d(k) : d(k) * M_SQRT1_2;
  }
  return D;
}

/// Lower triangular L with L L' = J; none where J is not positive definite.
std::optional<Matrix4d> factor(const Matrix4d& J) {
  Matrix4d L = Matrix4d::Zero();
  for (int c = 0; c < 4; ++c) {
    const double pivot = J(c, c) - L.row(c).squaredNorm();
    if (!(pivot > 0)) return std::nullopt;
    L(c, c) = std::sqrt(pivot);
    for (int r = c + 1; r < 4; ++r) L(r, c) = (J(r, c) - L.row(r).dot(L.row(c))) / L(c, c);
  }
  return L;
}

/// Real bodies and rotors: factors of their pseudo-inertias, and the model's.
class Bodies {
 public:
  /// Those of the model. Bodies and rotors without mass get a small one: a cone has no inverse at its tip.
  explicit Bodies(const Regressor& regressor) : rotors_(regressor.model_parameters().tail(regressor.rotors())) {
    const VectorXd phi = regressor.model_parameters();
    const VectorXd scale = inertial_scale(regressor);
    constexpr double least = 1e-4;
    for (Index b = 0; b < (phi.size() - rotors_.size()) / per_body; ++b) {
      const Ten size = least * scale.segment<per_body>(per_body * b);
      Matrix4d J = pseudo_inertia(phi.segment<per_body>(per_body * b));
      J.diagonal() += Eigen::Vector4d(size(0), size(0), size(0), size(9)) + Eigen::Vector4d::Constant(1e-9);
      L_.push_back(factor(J).value_or(Matrix4d::Identity()));
      inverse_.push_back((L_.back() * L_.back().transpose()).inverse());
    }
    rotors_ = rotors_.cwiseMax(scale.tail(rotors_.size())).cwiseMax(1e-9);
    inverse_rotors_ = rotors_.cwiseInverse();
  }

  Index size() const { return per_body * std::ssize(L_) + rotors_.size(); }

  VectorXd phi() const {
    VectorXd all(size());
    for (std::size_t b = 0; b < L_.size(); ++b) all.segment<per_body>(at(b)) = parameters_of(L_[b] * L_[b].transpose());
    all.tail(rotors_.size()) = rotors_;
    return all;
  }

  /// Change of phi with each coordinate.
  MatrixXd by_coordinates() const {
    MatrixXd M = MatrixXd::Zero(size(), size());
    for (std::size_t b = 0; b < L_.size(); ++b)
      for (int k = 0; k < per_body; ++k)
        M.block<per_body, 1>(at(b), at(b) + k) = parameters_of(L_[b] * symmetric(Ten::Unit(k)) * L_[b].transpose());
    M.bottomRightCorner(rotors_.size(), rotors_.size()) = rotors_.asDiagonal();
    return M;
  }

  /// The sum of divergences from the model, without its constant, and its change with each coordinate.
  double divergence() const {
    double sum = (rotors_.array() * inverse_rotors_.array() - rotors_.array().log()).sum();
    for (std::size_t b = 0; b < L_.size(); ++b)
      sum += (L_[b] * L_[b].transpose() * inverse_[b]).trace() - 2 * L_[b].diagonal().array().log().sum();
    return sum;
  }
  VectorXd slope() const {
    VectorXd g(size());
    for (std::size_t b = 0; b < L_.size(); ++b) {
      const Matrix4d G = L_[b].transpose() * inverse_[b] * L_[b] - Matrix4d::Identity();
      for (int k = 0; k < per_body; ++k) g(at(b) + k) = G.cwiseProduct(symmetric(Ten::Unit(k))).sum();
    }
    g.tail(rotors_.size()) = rotors_.cwiseProduct(inverse_rotors_).array() - 1;
    return g;
  }

  /// None where these are no bodies.
  std::optional<Bodies> moved(const VectorXd& d) const {
    Bodies out = *this;
    for (std::size_t b = 0; b < L_.size(); ++b) {
      const auto change = factor(Matrix4d::Identity() + symmetric(d.segment<per_body>(at(b))));
      if (!change) return std::nullopt;
      out.L_[b] = L_[b] * *change;
    }
    out.rotors_ += rotors_.cwiseProduct(d.tail(rotors_.size()));
    if (!(out.rotors_.array() > 0).all()) return std::nullopt;
    return out;
  }

 private:
  static Index at(std::size_t body) { return per_body * static_cast<Index>(body); }

  std::vector<Matrix4d> L_, inverse_;  ///< now; of the model's pseudo-inertia
  VectorXd rotors_, inverse_rotors_;
};

/// min |A phi - b|^2 over real bodies.
class Nearest {
 public:
  Nearest(MatrixXd A, VectorXd b, Bodies start) : A_(std::move(A)), b_(std::move(b)), now_(std::move(start)) {}

  Bodies run() && {
    constexpr double every = 0.5;
    constexpr int most_steps = 50;
    for (double mu = distance(now_);; mu *= every) {
      if (!std::isfinite(mu)) return std::move(now_);  // nothing is known of the distance
      mu = std::max(mu, last);
      for (int k = 0; k < most_steps; ++k)
        if (!step(mu)) break;
      if (mu == last) return std::move(now_);
    }
  }

 private:
  static constexpr double last = 1e-4;  ///< of mu

  double distance(const Bodies& x) const { return (A_ * x.phi() - b_).squaredNorm(); }

  /// One step of Newton's method; whether another is worthwhile.
  bool step(double mu) {
    const Index rows = A_.rows(), n = now_.size();
    MatrixXd J(rows + n, n + 1);  // and the right-hand side
    J << M_SQRT2 * (A_ * now_.by_coordinates()), M_SQRT2 * (b_ - A_ * now_.phi()),
        std::sqrt(mu) * MatrixXd::Identity(n, n), -std::sqrt(mu) * now_.slope();
    factor_in_place(J);
    VectorXd d = J.col(n).head(n);
    const double decrease = d.squaredNorm(), decrement = std::sqrt(decrease / mu);
    J.topLeftCorner(n, n).triangularView<Eigen::Upper>().solveInPlace(d);
    const bool near = decrement < 0.25;  // there a whole step is safe, as the function is self-concordant
    auto next = near ? now_.moved(d) : along(d, mu);
    if (next) now_ = std::move(*next);
    return next && decrement > (mu > last ? 0.5 : 0.01);
  }

  /// The lowest of some points on the way; none where all are higher than the start.
  std::optional<Bodies> along(const VectorXd& d, double mu) const {
    std::optional<Bodies> best;
    double lowest = value(now_, mu);
    for (double share = 1; share > 1e-9; share *= 0.7) {
      auto next = now_.moved(share * d);
      if (!next) continue;
      const double height = value(*next, mu);
      if (height >= lowest && best) break;
      if (height < lowest) lowest = height, best = std::move(next);
    }
    return best;
  }

  double value(const Bodies& x, double mu) const { return distance(x) + mu * x.divergence(); }

  MatrixXd A_;
  VectorXd b_;
  Bodies now_;
};

/// Bodies beside `near` that have exactly these base parameters; none where there are none as near.
std::optional<Bodies> exactly(const Bodies& near, const MatrixXd& from_all, const VectorXd& beta) {
  MatrixXd A = from_all * near.by_coordinates();
  const VectorXd scale = A.rowwise().norm().cwiseInverse();
  return near.moved(ShortestSolution(scale.asDiagonal() * A)(scale.cwiseProduct(beta - from_all * near.phi())));
}

/// The fit's objective as one of its base parameters alone, friction following.
struct Marginal {
  std::vector<Index> base, friction;  ///< unknowns
  MatrixXd R;                         ///< |R (change of base)|^2
  MatrixXd follow;                    ///< change of friction = follow (change of base)
};

Marginal marginal_of(const DynamicsFit& fit, Index base_size) {
  Marginal m;
  std::vector<Index> of_base, order;
  for (std::size_t c = 0; c < fit.unknowns.size(); ++c) {
    const bool rigid = fit.unknowns[c] < base_size;
    (rigid ? m.base : m.friction).push_back(fit.unknowns[c]);
    (rigid ? of_base : order).push_back(static_cast<Index>(c));
  }
  order.insert(order.end(), of_base.begin(), of_base.end());
  TriangularFactor all(std::ssize(order));
  all.add(fit.objective(Eigen::all, order));
  const MatrixXd R = all.R();
  const Index f = std::ssize(m.friction), b = std::ssize(m.base);
  m.R = R.bottomRightCorner(b, b);
  m.follow = -R.topRightCorner(f, b);
  R.topLeftCorner(f, f).triangularView<Eigen::Upper>().solveInPlace(m.follow);
  return m;
}

/// Adds changes of friction unknowns, within the bounds of the law.
void change_friction(const RobotFriction& friction, Index base_size, const std::vector<Index>& unknowns,
                     const VectorXd& change, std::vector<std::vector<double>>& values) {
  std::vector<std::pair<std::size_t, Index>> place;
  for (std::size_t r = 0; r < friction.size(); ++r)
    for (Index p = 0; p < friction[r].size(); ++p) place.emplace_back(r, p);
  for (std::size_t c = 0; c < unknowns.size(); ++c) {
    const auto& [r, p] = place[static_cast<std::size_t>(unknowns[c] - base_size)];
    const auto& info = friction[r].parameter(p);
    double& value = values[r][static_cast<std::size_t>(p)];
    value = std::clamp(value + change(static_cast<Index>(c)), info.minimum, info.maximum);
  }
}

}  // namespace

bool contradicted(double distance_sigma, Index base_size) {
  return distance_sigma > 1.5 * std::sqrt(chi_squared_quantile(static_cast<double>(base_size), 0.95));
}

namespace {

/// That noise makes the rotor inertia that is the most sigmas below 0 so small, which no real rotor has, of as many as
/// there are: one impossible number disappears in the distance of many that the data hardly determine.
double chance_of_rotors(const BaseParameters& base, const VectorXd& beta, const MatrixXd& information) {
  const MatrixXd covariance = pseudo_inverse(information);
  double count = 0, least = 1;
  for (Index k = 0; k < base.size(); ++k) {
    if (!base.is_rotor_inertia(k) || !(covariance(k, k) > 0)) continue;
    ++count;
    least = std::min(least, 0.5 * std::erfc(-beta(k) / std::sqrt(2 * covariance(k, k))));
  }
  return count > 0 ? std::min(1.0, count * least) : 1;
}

}  // namespace

Consistency nearest_consistent(const Regressor& regressor, const BaseParameters& base, const VectorXd& beta,
                               const MatrixXd& information) {
  const SymmetricEigen eigen = symmetric_eigen(information);
  const MatrixXd root = eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
  Consistency out;
  out.parameters = Nearest(root * base.from_all, root * beta, Bodies(regressor)).run().phi();
  out.base = base.from_all * out.parameters;
  out.distance_sigma = (root * (out.base - beta)).norm();
  const auto freedom = static_cast<double>(base.size());
  out.chance = std::min(chi_squared_above(freedom, out.distance_sigma * out.distance_sigma),
                        chance_of_rotors(base, beta, information));
  out.possible = out.chance > 0.05;
  return out;
}

ConsistentDynamics consistent_dynamics(const Regressor& regressor, const BaseParameters& base,
                                       const RobotFriction& friction, const DynamicsFit& fit) {
  const Marginal marginal = marginal_of(fit, base.size());
  const MatrixXd from_all = base.from_all(marginal.base, Eigen::all);
  const VectorXd beta = fit.parameters.base(marginal.base);
  const VectorXd own = marginal.R.colwise().norm();
  const MatrixXd scale = own.cwiseMax(1e-6 * own.maxCoeff()).asDiagonal();
  const Bodies nearest = Nearest(scale * from_all, scale * beta, Bodies(regressor)).run();
  ConsistentDynamics out{.parameters = fit.parameters, .bodies = {}, .growth = {}};
  if (const auto same = exactly(nearest, from_all, beta)) {
    out.same = true;
    out.bodies = same->phi();
    return out;
  }
  // What the data do not determine stays as in the fit as far as it can.
  TriangularFactor rows(scale.rows());
  rows.add(marginal.R);
  rows.add(1e-5 * scale);
  const MatrixXd W = rows.R();
  out.bodies = Nearest(W * from_all, W * beta, Bodies(regressor)).run().phi();
  const VectorXd found = from_all * out.bodies;
  out.parameters.base(marginal.base) = found;
  change_friction(friction, base.size(), marginal.friction, marginal.follow * (found - beta), out.parameters.friction);
  return out;
}

MatrixXd held_out_of_real_bodies(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                                 const DynamicsFit& fit, const JointMotion& motion, unsigned threads) {
  const std::vector<DynamicsProblem::Block> blocks =
      DynamicsProblem(regressor, base, friction, motion, threads).blocks();
  MatrixXd out = MatrixXd::Constant(regressor.joints(), motion.size(), std::numeric_limits<double>::quiet_NaN());
  in_parallel(fit.folds.size(), threads, [&](std::size_t f) {
    DynamicsFit own;
    own.parameters = fit.partial[f].parameters, own.objective = fit.partial[f].objective, own.unknowns = fit.in_folds;
    const ConsistentDynamics real = consistent_dynamics(regressor, base, friction, own);
    const MatrixXd torque = predicted_torque(regressor, base, friction, real.parameters, motion, 1);
    for (const std::size_t b : fit.folds[f].held) {
      const auto [first, last] = blocks[b];
      out.middleCols(first, last - first) = torque.middleCols(first, last - first);
    }
  });
  return out;
}

void measure_growth(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                    const DynamicsFit& fit, const JointMotion& motion, unsigned threads, ConsistentDynamics& dynamics) {
  dynamics.growth = VectorXd::Ones(regressor.joints());
  for (Index j = 0; j < regressor.joints(); ++j)
    if (motion.is_left_out(j)) dynamics.growth(j) = std::numeric_limits<double>::quiet_NaN();
  if (dynamics.same) return;
  const auto torque = [&](const RobotParameters& parameters) {
    return predicted_torque(regressor, base, friction, parameters, motion, threads);
  };
  const MatrixXd free = torque(fit.parameters), real = torque(dynamics.parameters);
  for (Index j = 0; j < regressor.joints(); ++j) {
    double of_free = 0, of_real = 0;
    for (Index i = 0; i < motion.size(); ++i)
      if (motion.moving(j, i))
        of_free += std::pow(motion.torque(j, i) - free(j, i), 2),
            of_real += std::pow(motion.torque(j, i) - real(j, i), 2);
    if (!motion.is_left_out(j)) dynamics.growth(j) = std::sqrt(of_real / of_free);
  }
}

}  // namespace tribotwin::twin::identification
