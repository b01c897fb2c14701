#pragma once

#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/working_days/working_day.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>

/// Results of all tests of a campaign: Hao 2021's time constants per test and merged, scatter of the parameters,
/// changes.
namespace tribotwin::twin::repeatability {

/// A change of a joint's friction between two cycles of a test that exceeds that on earlier days of the same robot.
struct Change {
  std::size_t robot = 0, day = 0, cycle = 0;  ///< from 0; the first cycle after the change
  std::size_t joint = 0;
  double expected = 0, found = 0;  ///< relative change of friction since the cycle before: on earlier days; here
  double sigma = 0;                ///< standard deviation of the difference of their logarithms
  double z = 0;                    ///< that difference over sigma
};

struct Thermal {
  std::vector<identification::ThermalFit> days;  ///< each by itself
  identification::ThermalFit merged;             ///< of the days without a change; "Mix" of Hao 2021
};

struct Findings {
  std::vector<std::vector<Thermal>>
      thermal;  ///< [robot][joint]; first order where two time constants are not identifiable
  std::vector<Change> changes;
  std::size_t comparisons = 0;  ///< possible changes
  double threshold = 0;         ///< of |z|: 1 % of campaigns without a change report one
  double seen = 0;              ///< relative change that the least certain comparison finds in 95 % of cases
  std::size_t seen_joint = 0;   ///< whose comparison that is
};

/// `days` in the order of the tests. ErrorKind::work with the robot and joint from whose friction no thermal model is
/// identifiable.
Result<Findings> find(const Campaign& campaign, const std::vector<WorkingDay>& days);

/// Time of the day [s] after which a change is compared with nothing: friction is measured once per cycle, early in it.
inline double seen_until_s(const std::vector<WorkingDay>& days) { return days.front().cycles.back().start_s; }

/// A sentence: the smallest change that is seen, of which joint and until when. Of findings with comparisons.
std::string what_is_seen(const Campaign& campaign, const std::vector<WorkingDay>& days, const Findings& findings);

/// Names in the order of the regressor's joints.
std::vector<std::string> joint_names(const Campaign& campaign);

/// Whether a test has a change.
bool is_changed(const Findings& findings, std::size_t robot, std::size_t day);

/// A time constant with Hao 2021's name: that of a first-order model is the slow one, t2.
enum class Pole { fast, slow };
inline constexpr const char* pole_names[] = {"t1", "t2"};
struct TimeConstant {
  Pole pole;
  const char* name;
  double value_s, sigma_s;
  bool identified;
};
std::vector<TimeConstant> times_of(const identification::ThermalFit& fit);

/// Scatter of an inertial parameter of a robot over the tests without a change.
struct Spread {
  double mean = 0, sigma = 0;       ///< weighted mean of the tests' values; its standard deviation by their sigmas
  std::optional<double> over_days;  ///< standard deviation of the tests / |mean|
  std::optional<double>
      over_a_day;  ///< |mean of the last third of the cycles - of the first third| / |mean|, the largest of the tests
};
/// Scatter over a day is reported of parameters whose sigma in every cycle is below this share of the value.
inline constexpr double identified_within = 0.02;
Spread spread_of(const Campaign& campaign, const std::vector<WorkingDay>& days, const Findings& findings,
                 std::size_t robot, std::size_t parameter);

}  // namespace tribotwin::twin::repeatability
