#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/estimates.hpp>

/// One rule for all fits: which of the identified parameters are numbers, why the others are not, and what to record
/// next. What data lack before any fit (a single temperature, a single load) is curves/identifiability.hpp.
namespace tribotwin::twin::identification {

struct Evidence {
  std::span<const Estimate> parameters;
  Eigen::MatrixXd covariance;  ///< of the parameters, NaN rows where not estimated; empty: correlations are not judged
  std::vector<double> scale;   ///< per parameter, what its interval is compared with, in its unit; empty or 0: |value|
  /// Per parameter, which polynomial it is a coefficient of (Fc0, FcT, FcTT of one), -1: none. They always correlate
  /// far from the origin, which their intervals count: a doubt. Empty: there are none.
  std::vector<int> polynomial;

  /// Per parameter, why the data show no effect of it although a number was fitted; empty texts: they do. Empty: all.
  std::vector<std::string> unseen;

  /// A time constant [s] and what is known only together with it, such as the gain of the same node.
  struct TimeConstant {
    std::string name;
    std::vector<std::string> with;
  };
  std::vector<TimeConstant> time_constants;
  double recorded_s = 0;  ///< longest stretch of the record without a gap; 0: lengths are not judged

  double cycles = 0, cycles_needed = 0;  ///< whole work cycles; needed 0: not judged

  /// Of the residuals, in the order of time or speed. The share of their mean square that neighbours have in common
  /// (0: white noise; 1: smooth arcs), and the share of the measured variance that the model explains.
  double common = 0, explained = 1;
  std::string along = "time";
};

/// What to record next for a parameter; empty: the rule's own words.
using Advice = std::function<std::string(const Estimate& parameter, Lack lack)>;

/// At most one Lacking per parameter, in their order. Parameters that the user fixed lack nothing.
std::vector<Lacking> lacking(const Evidence& evidence, const Advice& advice = {});

/// The names of the parameters that are no numbers.
std::vector<std::string> withheld(std::span<const Lacking> all);

/// "vs0 is not identifiable: its 95 % interval, -17 .. 21 rad/s, is wider than its value; record ..."
std::string sentence(const Lacking& one);

/// A line for those that share reason and next: "FsT, vsT not identifiable: these data show ...; record ...".
std::vector<std::string> lines_of(std::span<const Lacking> all);

}  // namespace tribotwin::twin::identification
