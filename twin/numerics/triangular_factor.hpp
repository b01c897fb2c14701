#pragma once

#include <Eigen/Dense>

namespace tribotwin::twin {

/// The factor R of the QR decomposition of a tall matrix that is never in memory: rows come one by one and are folded
/// in by Householder reflections, block by block (TSQR). R^T R is the matrix's normal matrix, without its loss of
/// digits.
class TriangularFactor {
 public:
  explicit TriangularFactor(Eigen::Index columns);

  /// The next row, all zero, to be filled by the caller before the next call.
  Eigen::Ref<Eigen::RowVectorXd, 0, Eigen::InnerStride<>> row();
  void add(const Eigen::MatrixXd& rows);
  void add(const TriangularFactor& other);

  Eigen::Index columns() const { return columns_; }
  /// Upper triangular, columns x columns; signs of rows are arbitrary.
  Eigen::MatrixXd R() const;

 private:
  void fold() const;

  Eigen::Index columns_, block_;
  // Row-major, because rows are written. Mutable: delayed folding does not change the result.
  mutable Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> buffer_;  ///< R on top, then rows
  mutable Eigen::Index used_;
};

}  // namespace tribotwin::twin
