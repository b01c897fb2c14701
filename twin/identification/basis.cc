#include <tribotwin/twin/identification/basis.hpp>

#include <algorithm>

#include <tribotwin/twin/identification/moments_kernel.hpp>
#include <tribotwin/twin/identification/parallel.hpp>

namespace tribotwin::twin::identification {
namespace {

using F = friction::Family;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
enum Linear { A, A_T, A_l, B, B_T, B_l, C_l, F1, F1_T, F2, F3, Fb, Fb_T };
enum Nonlinear { vs, vs_T, vl, alpha, T_V, beta, beta_T, s_T, s_T0 };

constexpr std::size_t chunk = 16384;

constexpr Placement::Derivative all_derivatives[] = {
    {B, vs, col_u}, {B_T, vs, col_uT}, {B_l, vs, col_ul}, {B, vs_T, col_uT}, {B_T, vs_T, col_uTT}, {B_l, vs_T, col_uTl},
    {B, alpha, col_a}, {B_T, alpha, col_aT}, {B_l, alpha, col_al}, {C_l, vl, col_vl}, {C_l, alpha, col_al2},
    {F1_T, T_V, col_F1_TV}, {Fb_T, T_V, col_Fb_TV}, {Fb, beta, col_beta}, {Fb_T, beta, col_beta_eT}, {Fb, beta_T, col_betaT}, {Fb_T, beta_T, col_beta_eTT}};

KernelNumbers numbers(const F& f) { return {f.vs, f.vs_T, f.vl, f.alpha, f.T_V, f.beta, f.beta_T, f.s_T, f.s_T0}; }

KernelSamples part(const Samples& s, std::span<const double> weights, std::size_t i) {
  const std::size_t first = i * chunk;
  return {s.speed.data() + first, s.load.data() + first, s.temperature_degC.data() + first, s.friction.data() + first,
          weights.empty() ? nullptr : weights.data() + first, std::min(chunk, s.size() - first)};
}

struct Kernels {
  decltype(&moments_baseline) moments = moments_baseline;
  decltype(&residuals_baseline) residuals = residuals_baseline;
};
const Kernels& kernels() {
  static const Kernels best = [] {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) return Kernels{moments_avx512, residuals_avx512};
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return Kernels{moments_avx2, residuals_avx2};
#endif
    return Kernels{};
  }();
  return best;
}

}  // namespace

const LinearFields linear_fields{&F::A, &F::A_T, &F::A_l, &F::B, &F::B_T, &F::B_l, &F::C_l, &F::F1, &F::F1_T, &F::F2, &F::F3, &F::Fb, &F::Fb_T};
const NonlinearFields nonlinear_fields{&F::vs, &F::vs_T, &F::vl, &F::alpha, &F::T_V, &F::beta, &F::beta_T, &F::s_T, &F::s_T0};

Placement::Placement(const friction::LawInfo& law) {
  const auto count = static_cast<Index>(law.parameters.size());
  std::vector<double> unit(law.parameters.size(), 0);
  const F origin = law.family(unit);
  const auto fill = [&](auto& fields, VectorXd& offset, MatrixXd& place) {
    const auto rows = static_cast<Index>(fields.size());
    offset.resize(rows);
    place.resize(rows, count);
    for (Index i = 0; i < rows; ++i) offset(i) = origin.*fields[i];
    for (Index j = 0; j < count; ++j) {
      unit[j] = 1;
      const F moved = law.family(unit);
      unit[j] = 0;
      for (Index i = 0; i < rows; ++i) place(i, j) = moved.*fields[i] - offset(i);
    }
  };
  fill(linear_fields, linear_offset, linear);
  fill(nonlinear_fields, nonlinear_offset, nonlinear);
  for (std::size_t k = 0; k < linear_count; ++k)
    if (!linear.row(static_cast<Index>(k)).isZero(0)) linear_used.push_back(k);
  for (std::size_t n = 0; n < nonlinear_count; ++n)
    if (!nonlinear.row(static_cast<Index>(n)).isZero(0)) nonlinear_used.push_back(n);
  const auto uses = [](const std::vector<std::size_t>& used, int field) { return std::ranges::find(used, static_cast<std::size_t>(field)) != used.end(); };
  for (const Derivative& d : all_derivatives)
    if (uses(linear_used, d.linear) && uses(nonlinear_used, d.nonlinear)) derivatives.push_back(d);
  if (uses(nonlinear_used, s_T))
    for (const std::size_t k : linear_used) derivatives.push_back({static_cast<int>(k), s_T, col_scaled + static_cast<int>(k)});
  columns.assign(linear_used.begin(), linear_used.end());
  for (const Derivative& d : derivatives) columns.push_back(d.column);
  std::ranges::sort(columns);
  columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
  columns.push_back(col_y);
}

Moments accumulate(const Samples& samples, std::span<const double> weights, const Placement& place, const friction::Family& family, unsigned threads) {
  const std::vector<int>& used = place.columns;
  const auto n = used.size();
  const std::size_t count = (samples.size() + chunk - 1) / chunk;
  std::vector<double> sums(count * n * n, 0);
  const auto kernel = kernels().moments;
  const KernelNumbers p = numbers(family);
  in_parallel(count, threads, [&](std::size_t i) { kernel(part(samples, weights, i), p, used.data(), static_cast<int>(n), sums.data() + i * n * n); });
  for (std::size_t i = 1; i < count; ++i)
    for (std::size_t k = 0; k < n * n; ++k) sums[k] += sums[i * n * n + k];
  Moments m;
  m.place_ = &place;
  const auto size = static_cast<Index>(n);
  m.all_ = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(sums.data(), size, size).selfadjointView<Eigen::Lower>();
  m.FF = MatrixXd::Zero(linear_count, linear_count);
  m.Fy = VectorXd::Zero(linear_count);
  for (Index a = 0; a < size && used[a] < col_u; ++a) {
    m.Fy(used[a]) = m.all_(a, size - 1);
    for (Index b = 0; b < size && used[b] < col_u; ++b) m.FF(used[a], used[b]) = m.all_(a, b);
  }
  m.yy = m.all_(size - 1, size - 1);
  return m;
}

Moments::At Moments::at(const VectorXd& eta) const {
  constexpr Index K = linear_count, N = nonlinear_count;
  const std::vector<Placement::Derivative>& list = place_->derivatives;
  const std::vector<int>& used = place_->columns;
  const auto size = static_cast<Index>(used.size());
  const auto place_of = [&](int column) { return static_cast<Index>(std::ranges::lower_bound(used, column) - used.begin()); };
  MatrixXd combine = MatrixXd::Zero(size, N);   // D = columns * combine
  for (const Placement::Derivative& d : list) combine(place_of(d.column), d.nonlinear) += eta(d.linear);
  VectorXd residual = VectorXd::Zero(size);     // r = columns * residual
  residual(size - 1) = 1;
  for (Index a = 0; used[a] < col_u; ++a) residual(a) = -eta(used[a]);
  const VectorXd by_residual = all_ * residual;
  const MatrixXd by_derivatives = all_ * combine;
  At result{.FD = MatrixXd::Zero(K, N), .DD = combine.transpose() * by_derivatives, .Dr = combine.transpose() * by_residual,
            .rr = std::max(0.0, residual.dot(by_residual)), .Fr_by = MatrixXd::Zero(K, N)};
  for (Index a = 0; used[a] < col_u; ++a) result.FD.row(used[a]) = by_derivatives.row(a);
  for (const Placement::Derivative& d : list) result.Fr_by(d.linear, d.nonlinear) = by_residual(place_of(d.column));
  return result;
}

std::vector<double> residuals(const Samples& samples, const Placement& place, const friction::Family& family, unsigned threads) {
  std::vector<double> r(samples.size());
  std::vector<int> used(place.linear_used.begin(), place.linear_used.end());
  double linear[linear_count];
  for (std::size_t k = 0; k < linear_count; ++k) linear[k] = family.*linear_fields[k];
  const auto kernel = kernels().residuals;
  in_parallel((samples.size() + chunk - 1) / chunk, threads, [&](std::size_t i) {
    kernel(part(samples, {}, i), numbers(family), used.data(), static_cast<int>(used.size()), linear, r.data() + i * chunk);
  });
  return r;
}

}  // namespace tribotwin::twin::identification
