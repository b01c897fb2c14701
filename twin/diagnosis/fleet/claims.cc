#include <cmath>

#include <tribotwin/twin/diagnosis/fleet/claims.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Eigen::Index;

constexpr int sweeps = 12;  ///< of Jacobi's rotations; 4 do from far away

/// Of a positive definite matrix; empty otherwise.
SmallMatrix lower_root(const SmallMatrix& A) {
  const Eigen::LLT<SmallMatrix> factor(A);
  const SmallMatrix L = factor.matrixL();
  const bool definite =
      factor.info() == Eigen::Success && (L.diagonal().array().square() > 1e-12 * A.diagonal().array()).all();
  return definite ? L : SmallMatrix();
}

constexpr std::array<std::size_t, 2> first_root{0, 6};

}  // namespace

ClaimRoots claim_roots(const FeatureMatrix& shape) {
  ClaimRoots out{};
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const SmallMatrix L =
        lower_root(shape.block(regions[r].first, regions[r].first, regions[r].count, regions[r].count));
    std::size_t at = first_root[r];
    for (Index i = 0; i < L.rows(); ++i)
      for (Index k = 0; k <= i; ++k) out[at++] = static_cast<float>(L(i, k));
  }
  return out;
}

SmallMatrix root_of(const Row& row, std::size_t region) {
  std::size_t at = first_root[region];
  if (!(row.claim[at] > 0)) return {};
  const Index p = regions[region].count;
  SmallMatrix L = SmallMatrix::Zero(p, p);
  for (Index i = 0; i < p; ++i)
    for (Index k = 0; k <= i; ++k) L(i, k) = static_cast<double>(row.claim[at++]);
  return L;
}

SmallMatrix lower_inverse(const SmallMatrix& L) {
  return L.triangularView<Eigen::Lower>().solve(SmallMatrix::Identity(L.rows(), L.rows()));
}

void MeanClaim::add(const Row& row, std::size_t region) {
  const SmallMatrix L = root_of(row, region);
  if (L.size() == 0) return;
  const double size = std::pow(L.diagonal().prod(), 2.0 / static_cast<double>(L.rows()));
  if (sum_.size() == 0) sum_ = SmallMatrix::Zero(L.rows(), L.rows());
  sum_.noalias() += L * L.transpose() / size;
}

SmallMatrix MeanClaim::root() const {
  if (sum_.size() == 0) return {};
  SmallMatrix L = lower_root(sum_);
  if (L.size() > 0) L /= std::pow(L.diagonal().prod(), 1.0 / static_cast<double>(L.rows()));
  return L;
}

OwnCoordinates own_coordinates(const SmallMatrix& errors, const Small& lambda) {
  const Index p = lambda.size();
  OwnCoordinates out{.turn = inverse(errors), .lambda = lambda};
  SmallMatrix day = out.turn * lambda.asDiagonal() * out.turn.transpose();
  // Jacobi's rotations by at most 45 degrees leave every component in its place.
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    bool still = true;
    for (Index i = 0; i < p; ++i)
      for (Index k = i + 1; k < p; ++k) {
        if (std::abs(day(i, k)) <= 1e-10 * day.trace()) continue;
        still = false;
        Eigen::JacobiRotation<double> rotation;
        rotation.makeJacobi(day, i, k);
        day.applyOnTheLeft(i, k, rotation.adjoint());
        day.applyOnTheRight(i, k, rotation);
        out.turn.applyOnTheLeft(i, k, rotation.adjoint());
      }
    if (still) break;
  }
  out.lambda = day.diagonal().cwiseMax(0);
  return out;
}

Errors::Errors(const RegionModel& m, std::size_t region)
    : region_(region),
      typical_(m.typical_scatter),
      lambda_(m.lambda),
      decouple_(m.decouple),
      back_(inverse(m.decouple)),
      from_typical_(m.typical_root.size() > 0 ? lower_inverse(m.typical_root) : SmallMatrix()) {}

double Errors::scatter(const Row& row) const {
  return typical_ > 0 && row.scatter[region_] > 0 ? row.scatter[region_] / typical_ : 1;
}

SmallMatrix Errors::relative_root(const Row& row) const {
  SmallMatrix L = from_typical_.size() > 0 ? root_of(row, region_) : SmallMatrix();
  const Index p = regions[region_].count;
  if (L.size() == 0) return std::sqrt(scatter(row)) * SmallMatrix::Identity(p, p);
  return L * from_typical_;
}

OwnCoordinates Errors::own(const Rows& healthy, const Rows& recent) const {
  MeanClaim mean;
  if (from_typical_.size() > 0) {
    for (const Row& row : healthy) mean.add(row, region_);
    if (healthy.empty() && !recent.empty()) mean.add(recent.front(), region_);
  }
  const SmallMatrix root = mean.root();
  if (root.size() == 0) return {.turn = SmallMatrix::Identity(lambda_.size(), lambda_.size()), .lambda = lambda_};
  return own_coordinates(
      in_z(root * from_typical_) / std::pow(from_typical_.diagonal().prod(), 1.0 / static_cast<double>(lambda_.size())),
      lambda_);
}

Small Errors::variance(const Row& row, const SmallMatrix& turn) const {
  if (from_typical_.size() == 0) return Small::Constant(lambda_.size(), scatter(row));
  return (turn * in_z(relative_root(row))).rowwise().squaredNorm();
}

}  // namespace tribotwin::twin::diagnosis::fleet
