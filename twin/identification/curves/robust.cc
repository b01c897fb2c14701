#include <cmath>

#include <tribotwin/twin/identification/curves/robust.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr double huber_at = 1.345, cauchy_at = 2.385;  // in sigmas: 95 % efficient on normal errors

double loss_weight(Loss loss, double u) {
  return loss == Loss::huber ? (std::abs(u) <= huber_at ? 1 : huber_at / std::abs(u))
                             : 1 / (1 + std::pow(u / cauchy_at, 2));
}
double loss_curvature(Loss loss, double u) {
  if (loss == Loss::huber) return std::abs(u) <= huber_at;
  const double q = std::pow(u / cauchy_at, 2);
  return (1 - q) / std::pow(1 + q, 2);
}

}  // namespace

double robust_scale(const std::vector<double>& r, const std::vector<double>& base) {
  std::vector<double> magnitude(r.size());
  for (std::size_t i = 0; i < r.size(); ++i) magnitude[i] = std::abs(r[i]) * (base.empty() ? 1 : std::sqrt(base[i]));
  return 1.4826 * median_of(std::move(magnitude));
}

std::vector<double> robust_weights(const std::vector<double>& r, const std::vector<double>& base, Loss loss) {
  const double scale = robust_scale(r, base);
  if (!(scale > 0)) return base;
  std::vector<double> w(r.size());
  for (std::size_t i = 0; i < r.size(); ++i) {
    const double b = base.empty() ? 1 : base[i];
    w[i] = b * loss_weight(loss, r[i] * std::sqrt(b) / scale);
  }
  return w;
}

Point robust_minimum(const Samples& samples, const std::vector<double>& base, Loss loss, Separable& problem,
                     Point point, unsigned threads) {
  for (const Loss now : loss == Loss::cauchy ? std::vector{Loss::huber, Loss::cauchy} : std::vector{loss})
    for (int round = 0; round < 40; ++round) {
      const auto r = residuals(samples, problem.place(), point.general_law, threads);
      if (!(robust_scale(r, base) > 0)) return point;  // more than half of the samples are on the curve
      problem.set_weights(robust_weights(r, base, now));
      const Point next = round == 0 ? problem.minimise() : problem.refine(point.values);
      const double change =
          (next.values - point.values).cwiseAbs().cwiseQuotient(next.values.cwiseAbs().cwiseMax(1e-12)).maxCoeff();
      point = next;
      if (round > 0 && change < 1e-7) break;
    }
  return point;
}

double robust_variance(const std::vector<double>& r, const std::vector<double>& base, Loss loss, double squares) {
  const double scale = robust_scale(r, base), n = static_cast<double>(r.size());
  double psi2 = 0, slope = 0;
  for (std::size_t i = 0; i < r.size(); ++i) {
    const double u = scale > 0 ? r[i] * (base.empty() ? 1 : std::sqrt(base[i])) / scale : 0;
    psi2 += std::pow(u * loss_weight(loss, u), 2), slope += loss_curvature(loss, u);
  }
  return slope > 0 ? scale * scale * psi2 * n / (slope * slope) : squares;
}

}  // namespace tribotwin::twin::identification
