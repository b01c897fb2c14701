#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>

/// The general law (plugins/friction/formula.hpp) as Bittencourt 2012 (5) writes a model: linear in `linear` numbers
/// eta, nonlinear in `nonlinear` numbers rho. Every law places its parameters affinely in the general law, so these
/// derivatives are those of every law by the chain rule, exactly.
namespace tribotwin::twin::identification {

inline constexpr std::size_t linear_count = friction::formula::term_count,
                             nonlinear_count = friction::formula::shape_number_count;
using LinearFields = std::array<double friction::GeneralLaw::*, linear_count>;
using NonlinearFields = std::array<double friction::GeneralLaw::*, nonlinear_count>;
/// The numbers of friction::formula::terms and of friction::formula::shape_numbers.
inline constexpr LinearFields linear_fields = [] {
  LinearFields fields{};
  for (std::size_t k = 0; k < linear_count; ++k) fields[k] = friction::formula::terms[k].number;
  return fields;
}();
inline constexpr NonlinearFields nonlinear_fields = [] {
  NonlinearFields fields{};
  for (std::size_t n = 0; n < nonlinear_count; ++n) fields[n] = friction::formula::shape_numbers[n].number;
  return fields;
}();

/// A law's parameters in the general law. Vectors and matrices below are over the fields that some parameter moves ("in
/// use").
struct Placement {
  explicit Placement(const friction::LawInfo& law);
  friction::GeneralLaw origin;                           ///< of parameters that are all 0
  std::vector<std::size_t> linear_used, nonlinear_used;  ///< fields in use, ascending
  Eigen::VectorXd linear_offset, nonlinear_offset;
  Eigen::MatrixXd linear, nonlinear;  ///< fields in use x parameters: field = offset + place * parameters

  /// d(basis_k)/d(nonlinear_n) is a column of the kernels: all three as places among those in use.
  struct Derivative {
    Eigen::Index linear, nonlinear, column;
  };
  std::vector<Derivative> derivatives;  ///< the law's, but for its reference temperature s_T0, a convention
  std::vector<int> columns;             ///< those in use, ascending: first the linear fields, last y

  friction::GeneralLaw general_law(const Eigen::VectorXd& linear_numbers,
                                   const Eigen::VectorXd& nonlinear_numbers) const;

  bool is_linear(std::size_t parameter) const { return nonlinear.col(static_cast<Eigen::Index>(parameter)).isZero(0); }
};

/// Products of all columns that the fit needs, weighted and summed over the samples, at one set of nonlinear numbers:
/// cost, gradient and every derivative at any linear numbers follow from them.
struct Moments {
  Eigen::MatrixXd FF;  ///< basis^T basis, linear fields in use
  Eigen::VectorXd Fy;  ///< basis^T y
  double yy = 0;

  /// At the linear numbers eta, with residual r = y - basis eta and D = its derivatives by the nonlinear fields in use,
  /// negative.
  struct At {
    Eigen::MatrixXd FD, DD;
    Eigen::VectorXd Dr;
    double rr = 0;
    Eigen::MatrixXd Fr_by;  ///< sum of r d(basis_k)/d(nonlinear_n): the second term of Golub 1973
  };
  At at(const Eigen::VectorXd& eta) const;  ///< of moments with derivatives only
  /// At::rr alone.
  double cost(const Eigen::VectorXd& eta) const {
    return std::max(yy - 2 * eta.dot(Fy) + eta.dot(FF * eta), 0.0);
  }  // NaN stays NaN

 private:
  friend Moments accumulate(const Samples&, std::span<const double>, const Placement&, const friction::GeneralLaw&,
                            unsigned, bool);
  Eigen::MatrixXd all_;  ///< products of the columns in use
  const Placement* place_ = nullptr;
};

/// One pass over the samples (at least one). The order of summation does not depend on the number of threads. `place`
/// must outlive the result.
Moments accumulate(const Samples& samples, std::span<const double> weights, const Placement& place,
                   const friction::GeneralLaw& general_law, unsigned threads, bool derivatives = true);

/// y - f of every sample.
std::vector<double> residuals(const Samples& samples, const Placement& place, const friction::GeneralLaw& general_law,
                              unsigned threads);

}  // namespace tribotwin::twin::identification
