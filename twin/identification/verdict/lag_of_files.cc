#include <cmath>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/identification/verdict/lag_of_files.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index;

namespace {

std::string torque_column(const Regressor& regressor, Index joint) {
  return fmt::format("torque_{}_{}", regressor.joint_name(joint), regressor.is_slide(joint) ? "n" : "nm");
}

std::string words_of(const std::string& name, const FileLag& lag) {
  return fmt::format("{} {:.2g} +- {:.1g} ms", name, 1e3 * lag.value_s, 1e3 * lag.sigma_s);
}

void append(std::string& list, const std::string& word) { list += (list.empty() ? "" : ", ") + word; }

}  // namespace

std::vector<std::string> files_that_differ(const Regressor& regressor, std::span<const std::string> files,
                                           std::span<const FileLag> lags) {
  constexpr double by_chance = 1e-3;
  std::vector<std::string> out;
  for (Index j = 0; j < regressor.joints(); ++j) {
    const LagSpread spread = spread_of(lags, j);
    if (spread.chance() > by_chance) continue;
    std::string list;
    for (const FileLag& lag : lags)
      if (lag.joint == j) append(list, words_of(files[lag.file], lag));
    out.push_back(fmt::format(
        "{} is late (negative: early) by another time in each file, {:.2g} by chance: {}. One lag, or none, was taken "
        "for all: clocks that differ, or friction that does, would do that",
        torque_column(regressor, j), spread.chance(), list));
  }
  return out;
}

std::vector<std::string> late_torques(const Regressor& regressor, std::span<const std::string> files,
                                      std::span<const FileLag> lags, const JointMotion& motion) {
  constexpr double enough_sigmas = 4, least_samples = 0.2;
  std::vector<std::string> out;
  for (std::size_t f = 0; f < files.size(); ++f) {
    std::string list;
    for (const FileLag& lag : lags) {
      const double known_s = motion.lag_s.empty() ? 0 : motion.lag_s[static_cast<std::size_t>(lag.joint)],
                   more_s = std::abs(lag.value_s - known_s);
      if (lag.file == f && more_s > enough_sigmas * lag.sigma_s && more_s > least_samples * motion.period_s)
        append(list, words_of(regressor.joint_name(lag.joint), lag) +
                         (known_s == 0 ? std::string() : fmt::format(" (removed: {:.2g})", 1e3 * known_s)));
    }
    if (!list.empty())
      out.push_back(
          fmt::format("{}: torques are late against the prediction (negative: early): {}; --lag compares them without",
                      files[f], list));
  }
  return out;
}

}  // namespace tribotwin::twin::identification
