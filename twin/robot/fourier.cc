#include <cmath>
#include <numbers>

#include <tribotwin/twin/robot/fourier.hpp>

namespace tribotwin::twin {

using Eigen::Index, Eigen::VectorXd;

void FourierSeries::start_at_rest() {
  const VectorXd k = VectorXd::LinSpaced(b.cols(), 1, static_cast<double>(b.cols()));
  a.colwise() -= VectorXd(a.rowwise().mean());
  b -= (b * k) * k.transpose() / k.squaredNorm();
}

void FourierSeries::at(double t, Eigen::Ref<VectorXd> q, Eigen::Ref<VectorXd> qd, Eigen::Ref<VectorXd> qdd) const {
  q = centre;
  qd.setZero();
  qdd.setZero();
  for (Index k = 0; k < a.cols(); ++k) {
    const double w = static_cast<double>(k + 1) * 2 * std::numbers::pi / period_s, c = std::cos(w * t),
                 s = std::sin(w * t);
    q += (a.col(k) * s - b.col(k) * c) / w;
    qd += a.col(k) * c + b.col(k) * s;
    qdd += w * (b.col(k) * c - a.col(k) * s);
  }
}

}  // namespace tribotwin::twin
