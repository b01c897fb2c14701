#include <algorithm>
#include <cmath>

#include <ceres/ceres.h>

#include <tribotwin/twin/identification/rigid_body/consistency.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::Matrix4d, Eigen::MatrixXd, Eigen::VectorXd;

constexpr int per_body = 10;
/// Row and column of the ten free numbers of L.
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

Matrix4d factor(const double* x) {
  Matrix4d L = Matrix4d::Zero();
  for (int k = 0; k < per_body; ++k) L(lower[k][0], lower[k][1]) = x[k];
  return L;
}

/// phi(x): ten numbers of L per body, the root of every rotor inertia; with its Jacobian.
VectorXd physical(const double* x, Index count, Index bodies, MatrixXd* by) {
  VectorXd phi(count);
  if (by) by->setZero(count, count);
  for (Index b = 0; b < bodies; ++b) {
    const Matrix4d L = factor(x + per_body * b);
    phi.segment<per_body>(per_body * b) = parameters_of(L * L.transpose());
    if (!by) continue;
    for (int k = 0; k < per_body; ++k) {
      Matrix4d dL = Matrix4d::Zero();
      dL(lower[k][0], lower[k][1]) = 1;
      const Matrix4d half = dL * L.transpose();
      by->block<per_body, 1>(per_body * b, per_body * b + k) = parameters_of(half + half.transpose());
    }
  }
  for (Index k = per_body * bodies; k < count; ++k) {
    phi(k) = x[k] * x[k];
    if (by) (*by)(k, k) = 2 * x[k];
  }
  return phi;
}

/// Rows W (from_all phi(x) - beta), then (phi(x) - model's) weakly.
class Mismatch final : public ceres::CostFunction {
 public:
  Mismatch(MatrixXd W, const BaseParameters& base, const VectorXd& beta, VectorXd model, VectorXd weak, Index bodies)
      : A_(W * base.from_all), b_(W * beta), model_(std::move(model)), weak_(std::move(weak)), bodies_(bodies) {
    set_num_residuals(static_cast<int>(b_.size() + model_.size()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(model_.size()));
  }

  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const bool wanted = jacobians && jacobians[0];
    MatrixXd by;
    const VectorXd phi = physical(x[0], model_.size(), bodies_, wanted ? &by : nullptr);
    Eigen::Map<VectorXd>(residuals, b_.size() + model_.size()) << A_ * phi - b_, weak_.cwiseProduct(phi - model_);
    if (wanted)
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
          jacobians[0], b_.size() + model_.size(), model_.size())
          << A_ * by,
          weak_.asDiagonal() * by;
    return true;
  }

 private:
  MatrixXd A_;
  VectorXd b_, model_, weak_;
  Index bodies_;
};

}  // namespace

Consistency nearest_consistent(const Regressor& regressor, const BaseParameters& base, const VectorXd& beta,
                               const MatrixXd& information) {
  const VectorXd model = regressor.model_parameters();
  const Index count = model.size(), bodies = (count - regressor.rotors()) / per_body;
  VectorXd x(count), weak(count);
  for (Index b = 0; b < bodies; ++b) {
    Ten p = model.segment<per_body>(per_body * b);
    // Bodies without mass get a small one, as L could not change from 0.
    Matrix4d J = pseudo_inertia(p);
    J += 1e-6 * (1e-3 + J.trace()) * Matrix4d::Identity();
    const Matrix4d L = J.llt().matrixL();
    for (int k = 0; k < per_body; ++k) x(per_body * b + k) = L(lower[k][0], lower[k][1]);
    weak.segment<per_body>(per_body * b).setConstant(1e-4 / (1e-3 + p.cwiseAbs().maxCoeff()));
  }
  for (Index k = per_body * bodies; k < count; ++k)
    x(k) = std::sqrt(std::max(model(k), 1e-6)), weak(k) = 1e-4 / (1e-3 + model(k));

  const SymmetricEigen eigen = symmetric_eigen(information);
  const MatrixXd root = eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
  ceres::Problem problem;
  problem.AddResidualBlock(new Mismatch(root, base, beta, model, weak, bodies), nullptr, x.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 500;
  options.function_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  Consistency out;
  out.parameters = physical(x.data(), count, bodies, nullptr);
  out.base = base.from_all * out.parameters;
  out.distance_sigma = (root * (out.base - beta)).norm();
  out.possible = out.distance_sigma * out.distance_sigma < chi_squared_quantile(static_cast<double>(base.size()), 0.95);
  return out;
}

}  // namespace tribotwin::twin::identification
