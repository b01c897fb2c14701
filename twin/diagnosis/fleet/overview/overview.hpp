#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/twin/diagnosis/fleet/survey.hpp>

/// A fleet for those who show it: verdicts, and how far each joint is from its healthy curves. Functions throw as Store
/// does; nothing is kept in the store.
namespace tribotwin::twin::diagnosis::fleet {

/// What a joint of a type does when it is healthy, as plainly as it can be drawn: the mean of its healthy curves at a
/// temperature, with the slopes of all robots (pooled least squares on T and T^2 within robots), and the standard
/// deviation of one curve from it. Verdicts do not come from here.
struct HealthyLevel {
  std::array<double, feature_count> mean{};  ///< of the logarithmic features, at the middle temperature
  std::array<double, feature_count> slope{}, curvature{};
  std::array<double, feature_count> deviation{};  ///< of one curve; with few healthy ones wider
  double middle_degC = 0;
  std::size_t curves = 0;  ///< healthy ones of the joint itself; 0: those of the other robots are taken

  /// ln of a feature over that of a healthy joint at this temperature.
  double departure(const Row& row, int feature) const;
};

/// A joint over days.
struct JointTrack {
  JointName joint;
  std::optional<HealthyLevel> level;  ///< none where no robot has healthy curves
  Rows healthy, recent;               ///< in the order of time; recent: to the day that is judged
};

/// One joint at one glance.
struct JointGlance {
  JointName joint;
  std::size_t curves = 0;              ///< in the window
  std::optional<double> change;        ///< of Fc over the window, relative; none without curves or healthy level
  double deviations = 0;               ///< change in standard deviations of one curve
  std::optional<std::int64_t> last_s;  ///< newest curve that was not learned from
};

struct Overview {
  Survey check, watch;
  std::vector<JointGlance> joints;  ///< all, as Store::joints()
  std::vector<PastCheck> past;      ///< of the store, in the order of time
  std::vector<ImportedFile> files;  ///< of the curves in the window
  std::vector<StoredNote> notes;    ///< of the window
};
Overview overview_of(const std::filesystem::path& store, const SurveyOptions& options);

/// CUSUM of `watch` by time.
struct CusumTrack {
  std::vector<double> day, sum;  ///< larger of both regions
};
/// Tracks and charts of some joints, to the end of `options`.
struct Detail {
  JointTrack track;
  CusumTrack cusum;
};
std::vector<Detail> details_of(const std::filesystem::path& store, const std::vector<std::int64_t>& joints,
                               const SurveyOptions& options);

}  // namespace tribotwin::twin::diagnosis::fleet
