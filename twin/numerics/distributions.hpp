#pragma once

/// Quantiles and tails of distributions. They are functions here because the templates behind them take seconds of
/// compilation in every source that instantiates them.
namespace tribotwin::twin {

/// x that a variate stays below with this probability. probability in (0, 1), freedom > 0.
double normal_quantile(double probability);
double student_t_quantile(double freedom, double probability);
double chi_squared_quantile(double freedom, double probability);
double chi_squared_median(double freedom);

/// x that a variate exceeds with this probability; keeps its digits where the probability is small.
double normal_upper_quantile(double probability);
double student_t_upper_quantile(double freedom, double probability);
double chi_squared_upper_quantile(double freedom, double probability);
double fisher_f_upper_quantile(double freedom, double freedom_below, double probability);

/// Probability of a variate below x.
double normal_below(double x);
/// Probability of a variate above x.
double chi_squared_above(double freedom, double x);
/// The same. `freedom` is that of the numerator, `freedom_below` that of the denominator.
double fisher_f_above(double freedom, double freedom_below, double x);

}  // namespace tribotwin::twin
