#include <algorithm>
#include <limits>

#include <tribotwin/twin/numerics/triangular_factor.hpp>

namespace tribotwin::twin {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

TriangularFactor::TriangularFactor(Index columns)
    : columns_(columns),
      block_(std::max<Index>(4 * columns, 128)),
      buffer_(decltype(buffer_)::Zero(columns + block_, columns)),
      used_(columns) {}

Eigen::Ref<Eigen::RowVectorXd, 0, Eigen::InnerStride<>> TriangularFactor::row() {
  if (used_ == buffer_.rows()) fold();
  auto next = buffer_.row(used_++);
  next.setZero();
  return next;
}

void TriangularFactor::add(const MatrixXd& rows) {
  for (Index i = 0; i < rows.rows(); ++i) row() = rows.row(i);
}

void TriangularFactor::add(const TriangularFactor& other) { add(other.R()); }

void TriangularFactor::fold() const {
  if (used_ == columns_) return;
  MatrixXd rows = buffer_.topRows(used_);
  const Eigen::HouseholderQR<Eigen::Ref<MatrixXd>> qr(rows);
  buffer_.topRows(columns_).setZero();
  buffer_.topRows(columns_).triangularView<Eigen::Upper>() = rows.topRows(columns_);
  used_ = columns_;
}

MatrixXd TriangularFactor::R() const {
  fold();
  return buffer_.topRows(columns_);
}

double scaled_condition_number(const MatrixXd& R) {
  const VectorXd length = R.colwise().norm();
  if (R.cols() == 0 || length.minCoeff() == 0) return std::numeric_limits<double>::infinity();
  const VectorXd s = Eigen::BDCSVD<MatrixXd>(R * length.cwiseInverse().asDiagonal()).singularValues();
  return s(0) / s(s.size() - 1);
}

}  // namespace tribotwin::twin
