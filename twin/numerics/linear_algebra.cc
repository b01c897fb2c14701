#include <limits>

#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin {

using Eigen::MatrixXd, Eigen::VectorXd;

SymmetricEigen symmetric_eigen(const MatrixXd& A) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(A);
  return {.values = eigen.eigenvalues(), .vectors = eigen.eigenvectors()};
}

VectorXd symmetric_eigenvalues(const MatrixXd& A) {
  return Eigen::SelfAdjointEigenSolver<MatrixXd>(A, Eigen::EigenvaluesOnly).eigenvalues();
}

std::optional<MatrixXd> cholesky_factor(const MatrixXd& A) {
  const Eigen::LLT<MatrixXd> factor(A);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return factor.matrixL();
}

MatrixXd triangular_root(const MatrixXd& A) {
  if (const Eigen::LLT<MatrixXd> factor(A); factor.info() == Eigen::Success) return factor.matrixU();
  const SymmetricEigen eigen = symmetric_eigen(A);  // rounding took a pivot below zero
  MatrixXd root = eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
  factor_in_place(root);
  return root.triangularView<Eigen::Upper>();
}

void factor_in_place(Eigen::Ref<MatrixXd> A) { const Eigen::HouseholderQR<Eigen::Ref<MatrixXd>> qr(A); }

VectorXd symmetric_solution(const MatrixXd& A, const VectorXd& b) { return Eigen::LDLT<MatrixXd>(A).solve(b); }

std::optional<VectorXd> symmetric_solution(const MatrixXd& A, const VectorXd& b, double smallest_pivot) {
  const Eigen::LDLT<MatrixXd> factor(A);
  if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > smallest_pivot)) return std::nullopt;
  return factor.solve(b);
}

MatrixXd symmetric_inverse(const MatrixXd& A) {
  return Eigen::LDLT<MatrixXd>(A).solve(MatrixXd::Identity(A.rows(), A.cols()));
}

MatrixXd pseudo_inverse(const MatrixXd& matrix, double tolerance) {
  if (matrix.rows() == 0) return matrix;
  // A column of such a norm is one of terms that underflow: it has no effect.
  const VectorXd scale =
      matrix.diagonal().cwiseMax(0).cwiseSqrt().unaryExpr([](double x) { return x > 1e-100 ? 1 / x : 0; });
  const MatrixXd scaled = scale.asDiagonal() * matrix * scale.asDiagonal();
  // A matrix far from singular has no null space, and the slower eigenvalues are not needed.
  if (const Eigen::LLT<MatrixXd> factor(scaled);
      factor.info() == Eigen::Success && factor.matrixLLT().diagonal().minCoeff() > 1e-4)
    return scale.asDiagonal() * factor.solve(MatrixXd(scale.asDiagonal()));
  const SymmetricEigen eigen = symmetric_eigen(scaled);
  const double min_eigenvalue = tolerance * eigen.values.cwiseAbs().maxCoeff();
  const VectorXd inverse =
      eigen.values.unaryExpr([min_eigenvalue](double e) { return e > min_eigenvalue ? 1 / e : 0; });
  return scale.asDiagonal() * eigen.vectors * inverse.asDiagonal() * eigen.vectors.transpose() * scale.asDiagonal();
}

VectorXd square_solution(const MatrixXd& A, const VectorXd& b) { return A.partialPivLu().solve(b); }
MatrixXd inverse(const MatrixXd& A) { return A.inverse(); }
double determinant(const MatrixXd& A) { return A.determinant(); }

Eigen::Index numerical_rank(const MatrixXd& A, double threshold) {
  Eigen::ColPivHouseholderQR<MatrixXd> qr(A);
  qr.setThreshold(threshold);
  return qr.rank();
}

VectorXd least_squares_solution(const MatrixXd& A, const VectorXd& b, double threshold) {
  Eigen::ColPivHouseholderQR<MatrixXd> qr;
  if (threshold != rounding) qr.setThreshold(threshold);
  return qr.compute(A).solve(b);
}

MatrixXd least_squares_solutions(const MatrixXd& A, const MatrixXd& B) { return A.colPivHouseholderQr().solve(B); }

std::optional<VectorXd> well_conditioned_solution(const MatrixXd& A, const VectorXd& b,
                                                  double smallest_singular_value) {
  const Eigen::JacobiSVD<MatrixXd> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const VectorXd& s = svd.singularValues();
  if (s(s.size() - 1) < smallest_singular_value * s(0)) return std::nullopt;
  return svd.solve(b);
}

ShortestSolution::ShortestSolution(const MatrixXd& A) : factors_(A) {}
VectorXd ShortestSolution::operator()(const VectorXd& b) const { return factors_.solve(b); }
MatrixXd ShortestSolution::pseudo_inverse() const { return factors_.pseudoInverse(); }

VectorXd singular_values(const MatrixXd& A) { return Eigen::JacobiSVD<MatrixXd>(A).singularValues(); }

double scaled_condition_number(const MatrixXd& R) {
  const VectorXd length = R.colwise().norm();
  if (R.cols() == 0 || length.minCoeff() == 0) return std::numeric_limits<double>::infinity();
  const VectorXd s = singular_values(R * length.cwiseInverse().asDiagonal());
  return s(0) / s(s.size() - 1);
}

}  // namespace tribotwin::twin
