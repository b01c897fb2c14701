#pragma once

#include <optional>

#include <Eigen/Dense>

/// Decompositions of matrices of any size. They are functions because Eigen's templates take 2 to 8 s of compilation in
/// every source that instantiates one.
namespace tribotwin::twin {

/// Of a symmetric matrix, from its lower triangle: values ascending, vectors of unit length in columns.
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& A);
Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& A);

/// Lower triangular L with L L^T = A; none where A is not positive definite.
std::optional<Eigen::MatrixXd> cholesky_factor(const Eigen::MatrixXd& A);
/// Upper triangular R with R^T R = A for symmetric positive semidefinite A; signs of rows are arbitrary.
Eigen::MatrixXd triangular_root(const Eigen::MatrixXd& A);

/// R of A = Q R in the upper triangle of A, at least as many rows as columns; the rest of A is overwritten too.
void factor_in_place(Eigen::Ref<Eigen::MatrixXd> A);

/// A x = b for symmetric positive semidefinite A, from its lower triangle, by L D L^T with pivots.
Eigen::VectorXd symmetric_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
/// The same; none where a pivot is not above this limit.
std::optional<Eigen::VectorXd> symmetric_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b,
                                                  double smallest_pivot);
Eigen::MatrixXd symmetric_inverse(const Eigen::MatrixXd& A);
/// Inverse of a symmetric positive semidefinite matrix with its null space left out, columns scaled first.
Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& matrix, double tolerance = 1e-13);

/// A x = b for square A that is not singular, by L U with pivots.
Eigen::VectorXd square_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);
double determinant(const Eigen::MatrixXd& A);

/// Columns that depend linearly on others count as such below this share of the largest pivot.
constexpr double rounding = -1;  ///< that of the machine, by the size of the matrix
Eigen::Index numerical_rank(const Eigen::MatrixXd& A, double threshold);
/// min |A x - b| by Q R with column pivots; 0 for linearly dependent columns.
Eigen::VectorXd least_squares_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, double threshold = rounding);
Eigen::MatrixXd least_squares_solutions(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
/// min |A x - b| by singular values; none where the smallest is below this share of the largest.
std::optional<Eigen::VectorXd> well_conditioned_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b,
                                                         double smallest_singular_value);

/// Of all minima of |A x - b| the shortest x.
class ShortestSolution {
 public:
  explicit ShortestSolution(const Eigen::MatrixXd& A);
  Eigen::VectorXd operator()(const Eigen::VectorXd& b) const;
  Eigen::MatrixXd pseudo_inverse() const;

 private:
  Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> factors_;
};

/// Falling; as many as the shorter side of A.
Eigen::VectorXd singular_values(const Eigen::MatrixXd& A);
/// Ratio of the largest to the smallest singular value of R once its columns have unit length; infinite where one is 0.
double scaled_condition_number(const Eigen::MatrixXd& R);

}  // namespace tribotwin::twin
