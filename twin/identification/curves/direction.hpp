#pragma once

#include <string_view>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/curves/separable.hpp>

/// Friction that differs between the directions of motion. With s = 1 for positive motion and -1 for negative, measured
/// friction against the motion is
///
///   y = level (1 + asymmetry s) + offset s
///
/// which is the level of another sample, (y - offset s) / (1 + asymmetry s), with the weight (1 + asymmetry s)^2. The
/// two numbers are searched by Gauss-Newton on the projected residual: the law's parameters follow at each of them.
namespace tribotwin::twin::identification {

inline constexpr std::string_view asymmetry_name = "asymmetry", offset_name = "offset";
inline constexpr double asymmetry_max = 0.99;  ///< as drives accept it

struct Direction {
  double asymmetry = 0, offset = 0;  ///< [-], unit of the law
  bool asymmetry_free = false, offset_free = false;

  double factor(double s) const { return 1 + asymmetry * s; }
};

/// Whether there are samples of both directions, which tell what differs between them.
bool has_both_directions(const Samples& samples);

/// One sample per direction: a level of both directions whose difference is known becomes two. `direction` has all.
Samples by_direction(const Samples& samples);

/// What remains of `rows`, which by_direction made.
std::vector<double> residuals(const Samples& rows, const Placement& place, const friction::GeneralLaw& general_law,
                              const Direction& direction, unsigned threads);

/// The samples and weights that a symmetric law has to follow.
void make_symmetric(const Samples& rows, const std::vector<double>& weights, const Direction& direction, Samples& seen,
                    std::vector<double>& seen_weights);

/// What the free numbers of a Direction, asymmetry first, add to the normal equations of the law's `coordinates`.
struct DirectionMoments {
  Eigen::MatrixXd own, cross;  ///< their products; coordinates x free numbers
  Eigen::VectorXd slope;       ///< products with the residuals
};
DirectionMoments direction_moments(const Samples& rows, const std::vector<double>& weights, const Direction& direction,
                                   const Placement& place, const Point& point,
                                   const std::vector<std::size_t>& coordinates);

}  // namespace tribotwin::twin::identification
