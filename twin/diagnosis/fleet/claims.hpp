#pragma once

#include <tribotwin/twin/diagnosis/fleet/type_model.hpp>

/// What fits claim of their own errors. A fit of a curve with a small Stribeck amplitude knows Vs badly and Fc well; of
/// another robot it is the other way round. Errors of row i, in logarithmic features y of a region:
///   covariance K_i S K_i', K_i = L_i L^-1,
/// S that of a typical fit (learned), L_i L_i' the claim of the row and L L' the typical claim. Where claims are right,
/// S is proportional to L L' and the covariance to the claim.
namespace tribotwin::twin::diagnosis::fleet {

constexpr int features_maximum = 3;  ///< p
using Small = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, features_maximum, 1>;
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, features_maximum, features_maximum>;

/// Roots of the claims of both regions; 0 where the shape is not positive definite.
ClaimRoots claim_roots(const FeatureMatrix& shape);
/// L_i, lower triangular; empty where the row has none.
SmallMatrix root_of(const Row& row, std::size_t region);
/// Inverse of a lower triangular matrix.
SmallMatrix lower_inverse(const SmallMatrix& lower);

/// Sum of claims, each relative to its own size: what they have in common is their shape.
class MeanClaim {
 public:
  void add(const Row& row, std::size_t region);
  /// Root of the mean, of determinant 1; empty where no row had a claim.
  SmallMatrix root() const;

 private:
  SmallMatrix sum_;
};

/// Coordinates of one joint, w = Q z, in which its typical errors have covariance 1 and deviations of days
/// diag(lambda), as they have for a typical fit in z. Components correspond to those of z.
struct OwnCoordinates {
  SmallMatrix turn;  ///< Q
  Small lambda;
};
/// `errors`: A, with A A' the covariance of the joint's errors in z.
OwnCoordinates own_coordinates(const SmallMatrix& errors, const Small& lambda);

/// Errors of all fits of a region under one model.
class Errors {
 public:
  Errors(const RegionModel& model, std::size_t region);
  /// By the healthy rows, or else the first.
  OwnCoordinates own(const Rows& healthy, const Rows& recent) const;
  /// Variance of each component of w = turn z.
  Small variance(const Row& row, const SmallMatrix& turn) const;
  /// Of a row without a claim: its scatter relative to the typical one.
  double scatter(const Row& row) const;
  /// K_i; of a type without claims sqrt(v).
  SmallMatrix relative_root(const Row& row) const;

 private:
  SmallMatrix in_z(const SmallMatrix& K) const { return decouple_ * K * back_; }

  const std::size_t region_;
  const double typical_;
  const Small lambda_;
  const SmallMatrix decouple_, back_, from_typical_;  // W, W^-1, L^-1
};

}  // namespace tribotwin::twin::diagnosis::fleet
