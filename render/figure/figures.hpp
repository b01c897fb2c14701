#pragma once

#include <array>
#include <limits>
#include <optional>
#include <span>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/uncertainty.hpp>
#include <tribotwin/render/figure/figure.hpp>

/// The figures of reports, measurements and identifications, from their values.
namespace tribotwin::render {

/// Friction measured at a joint. Speed and friction are magnitudes.
struct FrictionPoint {
  double speed_rad_s;  ///< joint side
  double load_norm, temperature_degC;
  double friction_nm;   ///< arm side
  double error_nm = 0;  ///< one sigma; 0 draws no bar
};

/// The axes in which a drive's law is usually shown: motor or joint speed, Nm or parts of torque_max_nm.
struct LawAxes {
  explicit LawAxes(const drive::Drive& drive);
  Axis speed, friction, load;
  double per_joint_rad_s, per_nm;  ///< factors from joint-side rad/s and Nm
};

/// The figure of a drive's law with the units of its joint: where that is a slide, m/s and N.
Figure in_units_of(Figure law, bool slide);

/// The law over speed at several temperatures, with points coloured by theirs. speed_max is joint side [rad/s].
/// `uncertainty`: of the law, for a band of 95 % around each curve; null: none.
Figure friction_against_temperature(const drive::Drive& drive, const std::string& title, double speed_max_rad_s,
                                    double load_norm, std::span<const double> temperatures_degC,
                                    std::span<const FrictionPoint> points = {},
                                    const friction::Uncertainty* uncertainty = nullptr);
/// The law over speed at several loads (at most eight), with points coloured by theirs.
Figure friction_against_load(const drive::Drive& drive, const std::string& title, double speed_max_rad_s,
                             double temperature_degC, std::span<const double> loads_norm,
                             std::span<const FrictionPoint> points = {},
                             const friction::Uncertainty* uncertainty = nullptr);
/// The law over speed at one load, for laws that do not depend on temperature.
Figure friction_against_speed(const drive::Drive& drive, const std::string& title, double speed_max_rad_s,
                              double load_norm, std::span<const FrictionPoint> points = {},
                              const friction::Uncertainty* uncertainty = nullptr);
/// The law over speed and temperature.
Figure friction_surface(const drive::Drive& drive, const std::string& title, double speed_max_rad_s, double load_norm,
                        double temperature_from_degC, double temperature_to_degC);

struct Trace {
  std::string label;
  std::vector<double> time_s, values;
  std::optional<std::size_t> stroke{};  ///< of theme::stroke; else counted up
  Mark mark = Mark::line;
  std::vector<double> half_width{};  ///< of a band of 95 % around the values, which then need a stroke; NaN: no band
                                     ///< there; none where empty
};
/// Values against time, in seconds, minutes or hours by their span.
Figure history(const std::string& title, const Axis& quantity, std::span<const Trace> traces);
/// Commanded minus actual position against time [mrad].
Figure tracking_error(const std::string& title, std::span<const Trace> errors_rad);

/// How often residuals occur, with the normal distribution of their mean and deviation. NaN are left out.
Figure residual_histogram(const std::string& title, const Axis& residual, std::span<const double> residuals);

/// A vertical line in a distribution; those of equal, not empty labels share an entry of the key.
struct Marked {
  std::string label;
  double at;
};
/// How often values occur, with lines at `marked` and a strip from `low` to `high`, where these are numbers. NaN are
/// left out.
Figure distribution(const std::string& title, const Axis& quantity, std::span<const double> values,
                    std::span<const Marked> marked, const std::string& strip, double low, double high);

/// `count` values from first to last; one where they are equal, their mean where one is asked for.
std::vector<double> evenly(double from, double to, int count);

/// At most `maximum` of `count` indices, ascending: one of each of as many equal stretches, which one by a fixed seed,
/// so that no period of the data is hit.
std::vector<std::size_t> thinned(std::size_t count, std::size_t maximum);

constexpr std::size_t scatter_points = 2000;
/// One quantity against another: at most `points_max` points and, of all points, mean and mean +- standard deviation in
/// classes of x that hold as many each. NaN are left out.
Figure scatter(const std::string& title, const Axis& x, const Axis& y, std::span<const double> xs,
               std::span<const double> ys, std::size_t points_max = scatter_points);

/// A symmetric matrix of correlations of the named estimates.
Figure correlation_matrix(const std::string& title, Matrix correlation);

/// Two estimated parameters with their covariance, and what it was estimated from.
struct Estimate {
  std::string label;
  std::array<double, 2> mean;
  std::array<std::array<double, 2>, 2> covariance;
  std::vector<std::array<double, 2>> samples;
  double degrees_of_freedom =
      std::numeric_limits<double>::infinity();  ///< of the covariance's scale: samples - parameters
};
/// 95 % and 99 % confidence regions of normally distributed estimates: chi-squared or, with few degrees of freedom, F.
Figure confidence_ellipses(const std::string& title, const Axis& x, const Axis& y, std::span<const Estimate> estimates);

/// Two features of a joint: their healthy distribution, and observations to compare with it.
struct HealthyScatter {
  std::array<double, 2> mean;
  std::array<std::array<double, 2>, 2> covariance;
  std::vector<std::array<double, 2>> learned, healthy, anomalous;  ///< any may be empty; each has its own shape
  double inner_sigma = 2, outer_sigma = 6;                         ///< radii of the ellipses, in standard deviations
};
Figure healthy_region(const std::string& title, const Axis& x, const Axis& y, const HealthyScatter& scatter);

struct Loop {
  std::string label;
  std::vector<double> position, torque;  ///< in the order of time
};
/// Torque over position.
Figure hysteresis_loop(const std::string& title, const Axis& position, const Axis& torque, std::span<const Loop> loops);

}  // namespace tribotwin::render
