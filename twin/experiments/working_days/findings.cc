#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/working_days/findings.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

namespace tribotwin::twin::repeatability {
namespace {

using namespace identification;

constexpr double steady = 5;           ///< time constants until the steady state: 0.7 % are left
constexpr double false_alarms = 0.01;  ///< share of campaigns without a change that report one
constexpr double missed = 0.05;        ///< probability with which a change of size Findings::seen is not found

bool identified(const ThermalFit& fit, const std::string& name) {
  return std::ranges::find(fit.unidentifiable, name) == fit.unidentifiable.end();
}

bool times_identified(const ThermalFit& fit) {
  return std::ranges::all_of(time_constants(fit), [&](const Estimate& e) { return identified(fit, e.name); });
}

/// Second order where both time constants are identifiable, else first. Its time constant counts as not identifiable
/// where it may represent two: the day is too short, or the second order fits significantly better (likelihood ratio,
/// 1 %).
Result<ThermalFit> fitted(const std::vector<HeatSession>& sessions) {
  auto second = fit_thermal(sessions, {.order = thermal::Order::second, .rested = true});
  if (!second || times_identified(*second)) return second;
  auto first = fit_thermal(sessions, {.order = thermal::Order::first, .rested = true});
  if (!first) return first;
  double longest_s = 0;
  for (const HeatSession& session : sessions) longest_s = std::max(longest_s, session.time_s.back());
  const double ratio =
      2 * static_cast<double>(second->samples) / second->correlation * std::log(first->rms_K / second->rms_K);
  if (times_identified(*first) &&
      (longest_s < steady * first->model.t_s[0] || ratio > chi_squared_upper_quantile(2, 0.01)))
    first->unidentifiable.push_back(time_constants(*first).front().name);
  return first;
}

/// Relative change of a joint's friction from the cycle before, and its standard deviation.
Measured change_of(const WorkingDay& day, std::size_t joint, std::size_t cycle) {
  const Measured &now = day.cycles[cycle].level_nm[joint], &before = day.cycles[cycle - 1].level_nm[joint];
  return {std::log(now.value / before.value), std::hypot(now.sigma / now.value, before.sigma / before.value)};
}

/// z of every change of a test against the same change on `earlier` days.
std::vector<Change> compared(const Campaign& c, std::size_t test, const WorkingDay& day,
                             const std::vector<const WorkingDay*>& earlier) {
  std::vector<Change> out;
  for (std::size_t joint = 0; joint < day.warming.size(); ++joint)
    for (std::size_t cycle = 1; cycle < day.cycles.size(); ++cycle) {
      double mean = 0, variance = 0;
      const auto n = static_cast<double>(earlier.size());
      for (const WorkingDay* e : earlier) {
        const Measured m = change_of(*e, joint, cycle);
        mean += m.value / n, variance += m.sigma * m.sigma / (n * n);
      }
      const Measured m = change_of(day, joint, cycle);
      const double sigma = std::sqrt(variance + m.sigma * m.sigma);
      out.push_back({.robot = c.robot_of(test),
                     .day = c.day_of(test),
                     .cycle = cycle,
                     .joint = joint,
                     .expected = std::expm1(mean),
                     .found = std::expm1(m.value),
                     .sigma = sigma,
                     .z = (m.value - mean) / sigma});
    }
  return out;
}

}  // namespace

std::vector<std::string> joint_names(const Campaign& c) {
  std::vector<std::string> names;
  const auto regressor = Regressor::create(c.model->get());
  for (Eigen::Index j = 0; j < regressor->joints(); ++j) names.push_back(regressor->joint_name(j));
  return names;
}

bool is_changed(const Findings& f, std::size_t robot, std::size_t day) {
  return std::ranges::any_of(f.changes, [&](const Change& x) { return x.robot == robot && x.day == day; });
}

/// All comparisons of a robot's days with earlier ones, and the days without a change.
struct Days {
  std::vector<Change> compared;
  std::vector<std::size_t> unchanged;
};

Days days_of(const Campaign& c, const std::vector<WorkingDay>& days, std::size_t robot, double threshold) {
  Days out;
  std::vector<const WorkingDay*> earlier;
  for (std::size_t d = 0; d < c.days; ++d) {
    const WorkingDay& day = days[robot * c.days + d];
    std::vector<Change> changes;
    if (!earlier.empty()) changes = compared(c, robot * c.days + d, day, earlier);
    if (std::ranges::none_of(changes, [&](const Change& x) { return std::abs(x.z) >= threshold; }))
      earlier.push_back(&day), out.unchanged.push_back(d);
    out.compared.insert(out.compared.end(), changes.begin(), changes.end());
  }
  return out;
}

/// A joint's thermal model of each day, and of the unchanged days together.
Result<Thermal> thermal_of(const Campaign& c, const std::vector<WorkingDay>& days, std::size_t robot, std::size_t joint,
                           const std::string& name, const std::vector<std::size_t>& unchanged) {
  const WorkingDay* first = &days[robot * c.days];
  const bool rising = rises(first[unchanged.front()].warming[joint]);
  Thermal t;
  std::vector<HeatSession> all;
  for (std::size_t d = 0; d < c.days; ++d) {
    const HeatSession session = as_heat(first[d].warming[joint], d, rising);
    auto fit = fitted({session});
    if (!fit) return work_failed(fmt::format("robot {}, day {}, {}: {}", robot + 1, d + 1, name, fit.error().message));
    t.days.push_back(std::move(*fit));
    if (std::ranges::find(unchanged, d) != unchanged.end()) all.push_back(session);
  }
  auto fit = fitted(all);
  if (!fit) return work_failed(fmt::format("robot {}, {}: {}", robot + 1, name, fit.error().message));
  t.merged = std::move(*fit);
  return t;
}

std::vector<TimeConstant> times_of(const ThermalFit& fit) {
  const auto times = time_constants(fit);
  std::vector<TimeConstant> out;
  for (std::size_t i = 0; i < times.size(); ++i) {
    const Pole pole = i + 1 == times.size() ? Pole::slow : Pole::fast;
    out.push_back({pole, pole_names[static_cast<std::size_t>(pole)], times[i].value, times[i].sigma,
                   identified(fit, times[i].name)});
  }
  return out;
}

Result<Findings> find(const Campaign& c, const std::vector<WorkingDay>& days) {
  Findings out;
  for (std::size_t test = 0; test < days.size(); ++test)
    if (c.day_of(test) > 0) out.comparisons += (days[test].cycles.size() - 1) * days[test].warming.size();
  if (out.comparisons) out.threshold = normal_upper_quantile(false_alarms / 2 / static_cast<double>(out.comparisons));
  const auto names = joint_names(c);
  double largest_sigma = 0;
  for (std::size_t robot = 0; robot < c.robots; ++robot) {
    const Days own = days_of(c, days, robot, out.threshold);
    for (const Change& x : own.compared) {
      if (std::abs(x.z) >= out.threshold) out.changes.push_back(x);
      const double sigma = std::isnan(x.z) ? std::numeric_limits<double>::infinity() : x.sigma;
      if (sigma > largest_sigma) largest_sigma = sigma, out.seen_joint = x.joint;
    }
    auto& joints = out.thermal.emplace_back();
    for (std::size_t j = 0; j < names.size(); ++j) {
      auto thermal = thermal_of(c, days, robot, j, names[j], own.unchanged);
      if (!thermal) return tl::unexpected(thermal.error());
      joints.push_back(*std::move(thermal));
    }
  }
  out.seen = std::expm1((out.threshold + normal_upper_quantile(missed)) * largest_sigma);
  return out;
}

std::string what_is_seen(const Campaign& c, const std::vector<WorkingDay>& days, const Findings& f) {
  return fmt::format(
      "A change of {:.3g} % from one cycle to the next is seen in {:.0f} % of cases ({}; smaller ones of other "
      "joints), "
      "none on the first day or after {:.2g} of a day's {:.2g} min.",
      100 * f.seen, 100 * (1 - missed), joint_names(c)[f.seen_joint], seen_until_s(days) / 60, c.duration_s / 60);
}

Spread spread_of(const Campaign& c, const std::vector<WorkingDay>& days, const Findings& f, std::size_t robot,
                 std::size_t p) {
  Spread out;
  double weights = 0;
  std::vector<double> values;
  for (std::size_t d = 0; d < c.days; ++d)
    if (const Measured& m = days[robot * c.days + d].base[p]; !is_changed(f, robot, d) && std::isfinite(m.sigma)) {
      const double weight = 1 / (m.sigma * m.sigma);
      out.mean += weight * m.value, weights += weight;
      values.push_back(m.value);
    }
  out.mean /= weights, out.sigma = 1 / std::sqrt(weights);
  double squares = 0;
  const double middle = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  for (const double v : values) squares += (v - middle) * (v - middle);
  if (values.size() > 1)
    out.over_days = std::sqrt(squares / static_cast<double>(values.size() - 1)) / std::abs(out.mean);
  for (std::size_t d = 0; d < c.days; ++d) {
    const auto& cycles = days[robot * c.days + d].cycles;
    const std::size_t third = cycles.size() / 3;
    if (is_changed(f, robot, d) || third == 0 || std::ranges::any_of(cycles, [&](const Cycle& k) {
          return !(k.base[p].sigma < identified_within * std::abs(out.mean));
        }))
      continue;
    double change = 0;
    for (std::size_t k = 0; k < third; ++k)
      change += (cycles[cycles.size() - 1 - k].base[p].value - cycles[k].base[p].value) / static_cast<double>(third);
    out.over_a_day = std::max(out.over_a_day.value_or(0), std::abs(change / out.mean));
  }
  return out;
}

}  // namespace tribotwin::twin::repeatability
