#include <algorithm>
#include <cmath>
#include <numeric>
#include <ranges>

#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/normal.hpp>
#include <fmt/format.h>

#include <tribotwin/twin/experiments/working_days/findings.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

namespace tribotwin::twin::repeatability {
namespace {

using namespace identification;

constexpr double settled = 5;          ///< time constants after which nothing slower can hide: 0.7 % are left
constexpr double false_alarms = 0.01;  ///< share of campaigns without a change that report one

bool told(const ThermalFit& fit, const std::string& name) {
  return std::ranges::find(fit.unidentifiable, name) == fit.unidentifiable.end();
}

bool tells_times(const ThermalFit& fit) {
  return std::ranges::none_of(fit.parameters, [&](const Estimate& e) { return e.unit == "s" && !told(fit, e.name); });
}

/// Second order where both time constants are told, else first. Its time constant is not told where it may stand for
/// two: the day ends before it is over, or the second order follows the data better than chance would (likelihood
/// ratio, 1 %).
Result<ThermalFit> fitted(const std::vector<HeatSession>& sessions) {
  auto second = fit_thermal(sessions, {.order = thermal::Order::second, .rested = true});
  if (!second || tells_times(*second)) return second;
  auto first = fit_thermal(sessions, {.order = thermal::Order::first, .rested = true});
  const auto longest_s =
      std::ranges::max(sessions | std::views::transform([](const HeatSession& s) { return s.time_s.back(); }));
  if (!first) return first;
  const double ratio =
      2 * static_cast<double>(second->samples) / second->correlation * std::log(first->rms_K / second->rms_K);
  if (tells_times(*first) &&
      (longest_s < settled * first->model.t_s[0] ||
       ratio > boost::math::quantile(boost::math::complement(boost::math::chi_squared(2), 0.01))))
    first->unidentifiable.push_back(std::string(thermal::parameters(thermal::Order::first)[1].name));
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
      out.push_back({.robot = c.robot_of(test),
                     .day = c.day_of(test),
                     .cycle = cycle,
                     .joint = joint,
                     .expected = std::expm1(mean),
                     .found = std::expm1(m.value),
                     .z = (m.value - mean) / std::sqrt(variance + m.sigma * m.sigma)});
    }
  return out;
}

std::vector<std::string> joint_names(const Campaign& c) {
  std::vector<std::string> names;
  const auto regressor = Regressor::create(c.model->get());
  for (Eigen::Index j = 0; j < regressor->joints(); ++j) names.push_back(regressor->joint_name(j));
  return names;
}

/// Of the simulated robot; 0 where its thermal model has none.
double true_time_s(const Campaign& c, std::size_t joint, std::string_view name) {
  const auto& model =
      std::ranges::find(c.model->drives(), static_cast<int>(joint), &mujoco::Binding::dof)->drive.thermal;
  if (model.order == thermal::Order::first) return name == "t2" ? model.t_s[0] : 0;
  const auto [fast, slow] = std::minmax(model.t_s[0], model.t_s[1]);
  return name == "t1" ? fast : slow;
}

bool is_changed(const Findings& f, std::size_t robot, std::size_t day) {
  return std::ranges::any_of(f.changes, [&](const Change& x) { return x.robot == robot && x.day == day; });
}

}  // namespace

std::vector<TimeConstant> times_of(const ThermalFit& fit) {
  std::vector<TimeConstant> out;
  for (const auto& e : fit.parameters)
    if (e.unit == "s")
      out.push_back({fit.model.order == thermal::Order::second && e.name == "t1" ? "t1" : "t2", e.value, e.sigma,
                     told(fit, e.name)});
  return out;
}

Result<Findings> find(const Campaign& c, const std::vector<WorkingDay>& days) {
  Findings out;
  for (const auto& day : days)
    out.comparisons +=
        c.day_of(static_cast<std::size_t>(&day - days.data())) ? (day.cycles.size() - 1) * day.warming.size() : 0;
  if (out.comparisons)
    out.threshold = boost::math::quantile(
        boost::math::complement(boost::math::normal(), false_alarms / 2 / static_cast<double>(out.comparisons)));
  const auto names = joint_names(c);
  for (std::size_t robot = 0; robot < c.robots; ++robot) {
    std::vector<const WorkingDay*> healthy;
    std::vector<std::size_t> healthy_days;
    for (std::size_t d = 0; d < c.days; ++d) {
      const WorkingDay& day = days[robot * c.days + d];
      std::vector<Change> changes;
      if (!healthy.empty()) changes = compared(c, robot * c.days + d, day, healthy);
      std::erase_if(changes, [&](const Change& x) { return std::abs(x.z) < out.threshold; });
      if (changes.empty()) healthy.push_back(&day), healthy_days.push_back(d);
      out.changes.insert(out.changes.end(), changes.begin(), changes.end());
    }
    auto& joints = out.thermal.emplace_back();
    for (std::size_t j = 0; j < names.size(); ++j) {
      Thermal t;
      std::vector<HeatSession> all;
      const bool rising = rises(healthy.front()->warming[j]);
      for (std::size_t d = 0; d < c.days; ++d) {
        const HeatSession session = as_heat(days[robot * c.days + d].warming[j], d, rising);
        auto fit = fitted({session});
        if (!fit)
          return tl::unexpected(
              fmt::format("robot {}, day {}, {}: {}", robot + 1, d + 1, names[j], fit.error().message));
        t.days.push_back(std::move(*fit));
        if (std::ranges::find(healthy_days, d) != healthy_days.end()) all.push_back(session);
      }
      auto fit = fitted(all);
      if (!fit) return tl::unexpected(fmt::format("robot {}, {}: {}", robot + 1, names[j], fit.error().message));
      t.merged = std::move(*fit);
      joints.push_back(std::move(t));
    }
  }
  return out;
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
          return !(k.base[p].sigma < told_within * std::abs(out.mean));
        }))
      continue;
    double change = 0;
    for (std::size_t k = 0; k < third; ++k)
      change += (cycles[cycles.size() - 1 - k].base[p].value - cycles[k].base[p].value) / static_cast<double>(third);
    out.over_a_day = std::max(out.over_a_day.value_or(0), std::abs(change / out.mean));
  }
  return out;
}

std::vector<TableFile> tables(const Campaign& c, const std::vector<WorkingDay>& days, const Findings& f) {
  const auto names = joint_names(c);
  const BaseParameters base = base_parameters(*Regressor::create(c.model->get()));
  const auto number = [](double x) { return std::isfinite(x) ? fmt::format("{:.9g}", x) : std::string(); };
  std::string times = "robot,test,joint,parameter,value_s,sigma_s,identifiable,of_robot_s\n";
  for (std::size_t robot = 0; robot < c.robots; ++robot)
    for (std::size_t d = 0; d <= c.days; ++d)
      for (std::size_t j = 0; j < names.size(); ++j)
        for (const auto& t : times_of(d < c.days ? f.thermal[robot][j].days[d] : f.thermal[robot][j].merged))
          times += fmt::format("{},{},{},{},{},{},{},{}\n", robot + 1, d < c.days ? fmt::format("{}", d + 1) : "mix",
                               names[j], t.name, number(t.value_s), number(t.sigma_s), t.told ? "yes" : "no",
                               number(true_time_s(c, j, t.name)));
  std::string
      inertial = "robot,test,cycle,parameter,unit,value,sigma,of_robot\n",
      friction =
          "robot,test,cycle,start_s,joint,level_nm,level_sigma_nm,f1,f1_sigma,f2,f2_sigma,f3,f3_sigma,f4,f4_sigma\n";
  for (std::size_t test = 0; test < days.size(); ++test) {
    const WorkingDay& day = days[test];
    for (std::size_t k = 0; k <= day.cycles.size(); ++k) {  // the last: all cycles of the day
      const bool all = k == day.cycles.size();
      const std::string where =
          fmt::format("{},{},{}", c.robot_of(test) + 1, c.day_of(test) + 1, all ? "all" : fmt::format("{}", k + 1));
      const auto& estimates = all ? day.base : day.cycles[k].base;
      for (std::size_t p = 0; p < estimates.size(); ++p)
        inertial += fmt::format("{},{},{},{},{},{}\n", where, base.parameters[p].name, base.parameters[p].unit,
                                number(estimates[p].value), number(estimates[p].sigma), number(day.base_of_robot[p]));
      for (std::size_t j = 0; j < names.size(); ++j) {
        friction += fmt::format("{},{},{}", where, all ? "" : number(day.cycles[k].start_s), names[j]);
        friction += all ? ",,"
                        : fmt::format(",{},{}", number(day.cycles[k].level_nm[j].value),
                                      number(day.cycles[k].level_nm[j].sigma));
        for (const auto& m : (all ? day.friction : day.cycles[k].friction)[j])
          friction += fmt::format(",{},{}", number(m.value), number(m.sigma));
        friction += '\n';
      }
    }
  }
  std::string changes = "robot,test,cycle,start_s,joint,expected,found,z,threshold\n";
  for (const auto& x : f.changes)
    changes += fmt::format("{},{},{},{},{},{},{},{},{}\n", x.robot + 1, x.day + 1, x.cycle + 1,
                           number(days[x.robot * c.days + x.day].cycles[x.cycle].start_s), names[x.joint],
                           number(x.expected), number(x.found), number(x.z), number(f.threshold));
  return {
      {"time_constants.csv", times}, {"inertial.csv", inertial}, {"friction.csv", friction}, {"changes.csv", changes}};
}

std::string summary(const Campaign& c, const std::vector<WorkingDay>& days, const Findings& f) {
  const auto names = joint_names(c);
  const BaseParameters base = base_parameters(*Regressor::create(c.model->get()));
  std::string s;
  bool blind = false;
  for (std::size_t robot = 0; robot < c.robots; ++robot)
    for (const char* name : {"t1", "t2"}) {
      s += fmt::format("{:<28}", fmt::format("robot {}, {} [min]", robot + 1, name));
      for (const auto& joint : names) s += fmt::format(" {:>17}", joint);
      s += '\n';
      for (std::size_t d = 0; d <= c.days; ++d) {
        const bool merged = d == c.days;
        s += fmt::format(
            "{:<28}",
            merged ? "Mix" : fmt::format("Test {}{}", d + 1, is_changed(f, robot, d) ? " (changed, not in Mix)" : ""));
        for (std::size_t j = 0; j < names.size(); ++j) {
          std::string cell = "*";
          for (const auto& t : times_of(merged ? f.thermal[robot][j].merged : f.thermal[robot][j].days[d]))
            if (name == std::string(t.name) && t.told)
              cell = fmt::format("{:.3f} +- {:.2g}", t.value_s / 60, t.sigma_s / 60);
          blind |= cell == "*";
          s += fmt::format(" {:>17}", cell);
        }
        s += '\n';
      }
      s += '\n';
    }
  if (blind) s += "*: not identifiable from this record\n\n";
  s += fmt::format("{:<14} {:<9}", "inertia", "unit");
  for (std::size_t robot = 0; robot < c.robots; ++robot)
    s += fmt::format(" {:>24} {:>10} {:>12}", fmt::format("robot {}, all days", robot + 1), "over days", "over a day");
  s += '\n';
  for (std::size_t p = 0; p < base.parameters.size(); ++p) {
    s += fmt::format("{:<14} {:<9}", base.parameters[p].name, base.parameters[p].unit);
    for (std::size_t robot = 0; robot < c.robots; ++robot) {
      const Spread spread = spread_of(c, days, f, robot, p);
      s += fmt::format(" {:>24} {:>10} {:>12}", fmt::format("{:.5g} +- {:.2g}", spread.mean, spread.sigma),
                       spread.over_days ? fmt::format("{:.2f} %", 100 * *spread.over_days) : "-",
                       spread.over_a_day ? fmt::format("{:.2f} %", 100 * *spread.over_a_day) : "-");
    }
    s += '\n';
  }
  s += fmt::format(
      "over days: standard deviation of the tests; over a day: from the first to the last third of it, at most; -: one "
      "test, or not told within {:.0f} % by a cycle\n\n",
      100 * told_within);
  for (const auto& x : f.changes)
    s += fmt::format(
        "change: robot {}, test {}, cycle {} ({:.0f} min), {}: friction {:+.1f} % from the cycle before, {:+.1f} % on "
        "earlier days, {:.1f} sigma\n",
        x.robot + 1, x.day + 1, x.cycle + 1, days[x.robot * c.days + x.day].cycles[x.cycle].start_s / 60,
        names[x.joint], 100 * x.found, 100 * x.expected, std::abs(x.z));
  s += f.comparisons ? fmt::format(
                           "{} of {} comparisons with earlier days are changes (beyond {:.2f} sigma, so that 1 % of "
                           "unchanged campaigns report any)\n",
                           f.changes.size(), f.comparisons, f.threshold)
                     : "no changes can be told: there are no earlier days\n";
  return s;
}

}  // namespace tribotwin::twin::repeatability
