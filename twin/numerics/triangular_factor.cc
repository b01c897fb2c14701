#include <algorithm>

#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/triangular_factor.hpp>

namespace tribotwin::twin {

using Eigen::Index, Eigen::MatrixXd;

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
  factor_in_place(rows);
  buffer_.topRows(columns_).setZero();
  buffer_.topRows(columns_).triangularView<Eigen::Upper>() = rows.topRows(columns_);
  used_ = columns_;
}

MatrixXd TriangularFactor::R() const {
  fold();
  return buffer_.topRows(columns_);
}

}  // namespace tribotwin::twin
