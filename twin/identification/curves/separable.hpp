#pragma once

#include <span>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/curves/basis.hpp>

/// Separable least squares over one law's parameters, the basis of the functions in fit.hpp.
namespace tribotwin::twin::identification {

/// A minimum, or a point on the way there.
struct Point {
  Eigen::VectorXd values;  ///< all coordinates
  friction::GeneralLaw general_law;
  Moments moments;             ///< at the nonlinear numbers of `general_law`
  Eigen::VectorXd linear;      ///< its linear ones
  std::vector<bool> at_bound;  ///< coordinates that a bound holds
  double cost = 0;
};

class Separable {
 public:
  /// Coordinates are the law's parameters, except that one with `not_below` is searched as its excess over that one,
  /// so that the condition is a bound.
  Separable(const friction::LawInfo& law, const Samples& samples, std::vector<double> weights, unsigned threads);

  /// Fixes a coordinate.
  void hold(std::size_t parameter, double value);
  /// The parameter that this one's coordinate is the excess over; npos if it is the parameter itself.
  std::size_t base_of(std::size_t parameter) const;
  bool is_free(std::size_t parameter) const { return free_[parameter]; }
  bool is_linear(std::size_t parameter) const { return place_.is_linear(parameter); }
  double held_value(std::size_t parameter) const { return values_(static_cast<Eigen::Index>(parameter)); }
  void set_weights(std::vector<double> weights) { weights_ = std::move(weights); }
  const Placement& place() const { return place_; }
  std::size_t parameter_of(double friction::GeneralLaw::*nonlinear_field) const;  ///< npos if the law has no such

  /// The minimum over all free coordinates: grid on a part of the samples, the best starts refined there, then all.
  Point minimise() const;
  /// From a start nearby.
  Point refine(const Eigen::VectorXd& start) const;
  /// The best linear coordinates for these nonlinear ones. Without `derivatives` its moments have none.
  Point at(const Eigen::VectorXd& nonlinear_from, bool derivatives = true) const;
  /// The same point with the current weights.
  Point again(const Point& point) const;

  /// Free linear parameters that are linear combinations of those before them in `order`, at any nonlinear ones.
  std::vector<std::size_t> dependent_linear(const std::vector<std::size_t>& order) const;

  /// sum psi psi^T of the free coordinates that no bound holds, and which those are.
  Eigen::MatrixXd information(const Point& point, std::vector<std::size_t>& coordinates) const;
  /// Of coordinates to the law's parameters.
  Eigen::VectorXd parameters(const Eigen::VectorXd& coordinates) const { return to_parameters_ * coordinates; }
  const Eigen::MatrixXd& to_parameters() const { return to_parameters_; }
  double low(std::size_t i) const { return low_(static_cast<Eigen::Index>(i)); }
  double high(std::size_t i) const { return high_(static_cast<Eigen::Index>(i)); }

  static constexpr std::size_t npos = static_cast<std::size_t>(-1);

 private:
  friend class ProjectedResidual;
  std::vector<Eigen::VectorXd> grid() const;
  /// Ends within so many sigmas of the minimum.
  Point descend(const Eigen::VectorXd& start, int iterations, double sigmas) const;
  Separable part(const Samples& samples, std::vector<double> weights) const;

  const friction::LawInfo* law_;
  const Samples* samples_;
  std::vector<double> weights_;
  unsigned threads_;
  Placement place_;
  Eigen::MatrixXd to_parameters_;
  Eigen::VectorXd values_, low_, high_;
  std::vector<bool> free_;
};

}  // namespace tribotwin::twin::identification
