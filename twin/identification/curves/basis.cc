#include <algorithm>

#include <tribotwin/twin/identification/curves/basis.hpp>
#include <tribotwin/twin/identification/curves/moments_kernel.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>

namespace tribotwin::twin::identification {
namespace {

using F = friction::GeneralLaw;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
namespace formula = friction::formula;

constexpr std::size_t chunk = 16384;

KernelSamples part(const Samples& s, std::span<const double> weights, std::size_t i) {
  const std::size_t first = i * chunk;
  return {s.speed.data() + first,
          s.load.data() + first,
          s.temperature_degC.data() + first,
          s.friction.data() + first,
          weights.empty() ? nullptr : weights.data() + first,
          std::min(chunk, s.size() - first)};
}

struct Kernels {
  decltype(&moments_baseline) moments = moments_baseline;
  decltype(&residuals_baseline) residuals = residuals_baseline;
};
const Kernels& kernels() {
  static const Kernels best = [] {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq"))
      return Kernels{moments_avx512, residuals_avx512};
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return Kernels{moments_avx2, residuals_avx2};
#endif
    return Kernels{};
  }();
  return best;
}

}  // namespace

Placement::Placement(const friction::LawInfo& law) {
  const auto count = static_cast<Index>(law.parameters.size());
  std::vector<double> unit(law.parameters.size(), 0);
  origin = law.general_law(unit);
  std::vector<F> moved;  // each parameter by 1
  for (double& x : unit) x = 1, moved.push_back(law.general_law(unit)), x = 0;
  const auto fill = [&](auto& fields, std::vector<std::size_t>& used, VectorXd& offset, MatrixXd& place) {
    for (std::size_t k = 0; k < fields.size(); ++k)
      if (std::ranges::any_of(moved, [&](const F& f) { return f.*fields[k] != origin.*fields[k]; })) used.push_back(k);
    offset.resize(static_cast<Index>(used.size()));
    place.resize(static_cast<Index>(used.size()), count);
    for (Index i = 0; i < offset.size(); ++i) {
      const auto field = fields[used[static_cast<std::size_t>(i)]];
      offset(i) = origin.*field;
      for (Index j = 0; j < count; ++j) place(i, j) = moved[static_cast<std::size_t>(j)].*field - offset(i);
    }
  };
  fill(linear_fields, linear_used, linear_offset, linear);
  fill(nonlinear_fields, nonlinear_used, nonlinear_offset, nonlinear);
  const auto place_in = [](const auto& used, auto what) {
    const auto found = std::ranges::find(used, what);
    return found == used.end() ? Index{-1} : static_cast<Index>(found - used.begin());
  };
  std::vector<int> column_of;
  const auto take = [&](std::size_t of, std::size_t by, int column) {
    const Derivative d{place_in(linear_used, of), place_in(nonlinear_used, by), 0};
    if (d.linear >= 0 && d.nonlinear >= 0) derivatives.push_back(d), column_of.push_back(column);
  };
  for (std::size_t n = 0; n < nonlinear_count; ++n)
    for (const std::size_t k : linear_used) {
      if (formula::shape_numbers[n].quantity == formula::scale_slope)
        take(k, n, col_scaled + static_cast<int>(k));
      else if (const int column = formula::columns.slope[k][n]; column >= 0)
        take(k, n, column);
    }
  columns.assign(linear_used.begin(), linear_used.end());
  columns.insert(columns.end(), column_of.begin(), column_of.end());
  std::ranges::sort(columns);
  columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
  columns.push_back(col_y);
  for (std::size_t i = 0; i < derivatives.size(); ++i) derivatives[i].column = place_in(columns, column_of[i]);
}

F Placement::general_law(const VectorXd& linear_numbers, const VectorXd& nonlinear_numbers) const {
  F f = origin;
  for (std::size_t k = 0; k < linear_used.size(); ++k)
    f.*linear_fields[linear_used[k]] = linear_numbers(static_cast<Index>(k));
  for (std::size_t n = 0; n < nonlinear_used.size(); ++n)
    f.*nonlinear_fields[nonlinear_used[n]] = nonlinear_numbers(static_cast<Index>(n));
  return f;
}

Moments accumulate(const Samples& samples, std::span<const double> weights, const Placement& place,
                   const friction::GeneralLaw& general_law, unsigned threads, bool derivatives) {
  const auto fields = static_cast<Index>(place.linear_used.size());
  std::vector<int> used = place.columns;
  if (!derivatives) used.erase(used.begin() + fields, used.end() - 1);
  const auto n = used.size();
  const std::size_t count = (samples.size() + chunk - 1) / chunk;
  std::vector<double> sums(count * n * n, 0);
  const auto kernel = kernels().moments;
  in_parallel(count, threads, [&](std::size_t i) {
    kernel(part(samples, weights, i), general_law, used.data(), static_cast<int>(n), sums.data() + i * n * n);
  });
  for (std::size_t i = 1; i < count; ++i)
    for (std::size_t k = 0; k < n * n; ++k) sums[k] += sums[i * n * n + k];
  Moments m;
  m.place_ = &place;
  const auto size = static_cast<Index>(n);
  m.all_ =
      Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(sums.data(), size, size)
          .selfadjointView<Eigen::Lower>();
  m.FF = m.all_.topLeftCorner(fields, fields);
  m.Fy = m.all_.col(size - 1).head(fields);
  m.yy = m.all_(size - 1, size - 1);
  return m;
}

Moments::At Moments::at(const VectorXd& eta) const {
  const Index K = eta.size(), N = place_->nonlinear_offset.size(), size = all_.rows();
  MatrixXd combine = MatrixXd::Zero(size, N);  // D = columns * combine
  for (const auto& d : place_->derivatives) combine(d.column, d.nonlinear) += eta(d.linear);
  const VectorXd by_residual = all_.col(size - 1) - all_.leftCols(K) * eta;
  const MatrixXd by_derivatives = all_.lazyProduct(combine);
  At result{.FD = by_derivatives.topRows(K),
            .DD = combine.transpose().lazyProduct(by_derivatives),
            .Dr = combine.transpose().lazyProduct(by_residual),
            .rr = std::max(by_residual(size - 1) - eta.dot(by_residual.head(K)), 0.0),
            .Fr_by = MatrixXd::Zero(K, N)};
  for (const auto& d : place_->derivatives) result.Fr_by(d.linear, d.nonlinear) = by_residual(d.column);
  return result;
}

std::vector<double> residuals(const Samples& samples, const Placement& place, const friction::GeneralLaw& general_law,
                              unsigned threads) {
  std::vector<double> r(samples.size());
  std::vector<int> used(place.linear_used.begin(), place.linear_used.end());
  double linear[linear_count];
  for (std::size_t k = 0; k < linear_count; ++k) linear[k] = general_law.*linear_fields[k];
  const auto kernel = kernels().residuals;
  in_parallel((samples.size() + chunk - 1) / chunk, threads, [&](std::size_t i) {
    kernel(part(samples, {}, i), general_law, used.data(), static_cast<int>(used.size()), linear, r.data() + i * chunk);
  });
  return r;
}

}  // namespace tribotwin::twin::identification
