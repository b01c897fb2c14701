#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include <tribotwin/twin/numerics/distributions.hpp>

namespace tribotwin::twin {

using boost::math::normal, boost::math::students_t, boost::math::chi_squared, boost::math::fisher_f;
using boost::math::quantile, boost::math::complement, boost::math::cdf;

double normal_quantile(double probability) { return quantile(normal(), probability); }
double student_t_quantile(double freedom, double probability) { return quantile(students_t(freedom), probability); }
double chi_squared_quantile(double freedom, double probability) { return quantile(chi_squared(freedom), probability); }
double chi_squared_median(double freedom) { return boost::math::median(chi_squared(freedom)); }

double normal_upper_quantile(double probability) { return quantile(complement(normal(), probability)); }

double student_t_upper_quantile(double freedom, double probability) {
  return quantile(complement(students_t(freedom), probability));
}

double chi_squared_upper_quantile(double freedom, double probability) {
  return quantile(complement(chi_squared(freedom), probability));
}

double fisher_f_upper_quantile(double freedom, double freedom_below, double probability) {
  return quantile(complement(fisher_f(freedom, freedom_below), probability));
}

double normal_below(double x) { return cdf(normal(), x); }

double chi_squared_above(double freedom, double x) { return cdf(complement(chi_squared(freedom), x)); }

double fisher_f_above(double freedom, double freedom_below, double x) {
  // In doubles, to 13 digits: a fleet asks for several per curve, and in long double each takes seven times as long.
  using InDouble = boost::math::policies::policy<boost::math::policies::promote_double<false>>;
  return cdf(complement(boost::math::fisher_f_distribution<double, InDouble>(freedom, freedom_below), x));
}

}  // namespace tribotwin::twin
