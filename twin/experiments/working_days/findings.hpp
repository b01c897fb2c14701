#pragma once

#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/working_days/working_day.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>

/// What a campaign's tests say together: paper 3's time constants per test and merged, how far parameters scatter, and
/// what changed.
namespace tribotwin::twin::repeatability {

/// A joint's friction changed between two cycles of a test by more than on earlier days of the same robot.
struct Change {
  std::size_t robot = 0, day = 0, cycle = 0;  ///< from 0; the cycle from which on it is changed
  std::size_t joint = 0;
  double expected = 0, found = 0;  ///< relative change of friction from the cycle before: on earlier days, and here
  double z = 0;                    ///< their difference over its standard deviation
};

struct Thermal {
  std::vector<identification::ThermalFit> days;  ///< each by itself
  identification::ThermalFit merged;             ///< of the days without a change; "Mix" of paper 3
};

struct Findings {
  std::vector<std::vector<Thermal>>
      thermal;  ///< [robot][joint]; first order where the data do not tell two time constants
  std::vector<Change> changes;
  std::size_t comparisons = 0;  ///< that could have been a change
  double threshold = 0;         ///< of |z|: 1 % of campaigns without a change report one
};

/// `days` in the order of the tests. Fails with robot and joint whose friction tells no thermal model at all.
Result<Findings> find(const Campaign& campaign, const std::vector<WorkingDay>& days);

/// A time constant as paper 3 names them: that of a first-order model is the slow one, t2.
struct TimeConstant {
  const char* name;
  double value_s, sigma_s;
  bool told;  ///< identifiable from the record
};
std::vector<TimeConstant> times_of(const identification::ThermalFit& fit);

/// How far an inertial parameter of a robot scatters, over the tests without a change.
struct Spread {
  double mean = 0, sigma = 0;       ///< of the tests' values, weighed; its standard deviation by their sigmas
  std::optional<double> over_days;  ///< standard deviation of the tests / |mean|
  std::optional<double>
      over_a_day;  ///< |mean of the last third of the cycles - of the first third| / |mean|, the largest of the tests
};
/// Cycles tell a parameter if its sigma is below this share of it; of others no scatter over a day is told.
inline constexpr double told_within = 0.02;
Spread spread_of(const Campaign& campaign, const std::vector<WorkingDay>& days, const Findings& findings,
                 std::size_t robot, std::size_t parameter);

/// Files of a campaign's folder: names and contents.
struct TableFile {
  std::string name, text;
};
/// time_constants.csv, inertial.csv, friction.csv, changes.csv.
std::vector<TableFile> tables(const Campaign& campaign, const std::vector<WorkingDay>& days, const Findings& findings);

/// For people: time constants, scatter of inertial parameters, changes.
std::string summary(const Campaign& campaign, const std::vector<WorkingDay>& days, const Findings& findings);

}  // namespace tribotwin::twin::repeatability
