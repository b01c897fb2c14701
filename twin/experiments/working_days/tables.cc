#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/working_days/tables.hpp>
#include <tribotwin/twin/io/text_table.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

namespace tribotwin::twin::repeatability {
namespace {

std::string number(double x) { return std::isfinite(x) ? fmt::format("{:.9g}", x) : std::string(); }

/// The time constant [s] of the simulated robot; 0 where its thermal model has none.
double true_time_s(const Campaign& c, std::size_t joint, Pole pole) {
  const auto& model =
      std::ranges::find(c.model->drives(), static_cast<int>(joint), &mujoco::Binding::dof)->drive.thermal;
  if (model.order == thermal::Order::first) return pole == Pole::slow ? model.t_s[0] : 0;
  const auto [fast, slow] = std::minmax(model.t_s[0], model.t_s[1]);
  return pole == Pole::fast ? fast : slow;
}

std::string time_constants_csv(const Campaign& c, const Findings& f, const std::vector<std::string>& names) {
  std::string times = "robot,test,joint,parameter,value_s,sigma_s,identifiable,of_robot_s\n";
  for (std::size_t robot = 0; robot < c.robots; ++robot)
    for (std::size_t d = 0; d <= c.days; ++d)
      for (std::size_t j = 0; j < names.size(); ++j)
        for (const auto& t : times_of(d < c.days ? f.thermal[robot][j].days[d] : f.thermal[robot][j].merged))
          times += fmt::format("{},{},{},{},{},{},{},{}\n", robot + 1, d < c.days ? fmt::format("{}", d + 1) : "mix",
                               names[j], t.name, number(t.value_s), number(t.sigma_s), t.identified ? "yes" : "no",
                               number(true_time_s(c, j, t.pole)));
  return times;
}

/// Calls `row(where, day, cycle)` for every cycle of every test, and for all cycles of a day with a null cycle.
void for_each_cycle(const Campaign& c, const std::vector<WorkingDay>& days, const auto& row) {
  for (std::size_t test = 0; test < days.size(); ++test) {
    const auto where = fmt::format("{},{}", c.robot_of(test) + 1, c.day_of(test) + 1);
    for (std::size_t k = 0; k < days[test].cycles.size(); ++k)
      row(fmt::format("{},{}", where, k + 1), days[test], &days[test].cycles[k]);
    row(where + ",all", days[test], static_cast<const Cycle*>(nullptr));
  }
}

std::string inertial_csv(const Campaign& c, const std::vector<WorkingDay>& days) {
  const BaseParameters base = base_parameters(*Regressor::create(c.model->get()));
  std::string inertial = "robot,test,cycle,parameter,unit,value,sigma,of_robot\n";
  for_each_cycle(c, days, [&](const std::string& where, const WorkingDay& day, const Cycle* cycle) {
    const auto& estimates = cycle ? cycle->base : day.base;
    for (std::size_t p = 0; p < estimates.size(); ++p)
      inertial += fmt::format("{},{},{},{},{},{}\n", where, base.parameters[p].name, base.parameters[p].unit,
                              number(estimates[p].value), number(estimates[p].sigma), number(day.base_of_robot[p]));
  });
  return inertial;
}

std::string friction_csv(const Campaign& c, const std::vector<WorkingDay>& days,
                         const std::vector<std::string>& names) {
  std::string friction =
      "robot,test,cycle,start_s,joint,level_nm,level_sigma_nm,f1,f1_sigma,f2,f2_sigma,f3,f3_sigma,f4,f4_sigma\n";
  for_each_cycle(c, days, [&](const std::string& where, const WorkingDay& day, const Cycle* cycle) {
    for (std::size_t j = 0; j < names.size(); ++j) {
      friction += fmt::format("{},{},{}", where, cycle ? number(cycle->start_s) : "", names[j]);
      friction +=
          cycle ? fmt::format(",{},{}", number(cycle->level_nm[j].value), number(cycle->level_nm[j].sigma)) : ",,";
      for (const auto& m : (cycle ? cycle->friction : day.friction)[j])
        friction += fmt::format(",{},{}", number(m.value), number(m.sigma));
      friction += '\n';
    }
  });
  return friction;
}

std::string changes_csv(const Campaign& c, const std::vector<WorkingDay>& days, const Findings& f,
                        const std::vector<std::string>& names) {
  std::string changes = "robot,test,cycle,start_s,joint,expected,found,z,threshold\n";
  for (const auto& x : f.changes)
    changes += fmt::format("{},{},{},{},{},{},{},{},{}\n", x.robot + 1, x.day + 1, x.cycle + 1,
                           number(days[x.robot * c.days + x.day].cycles[x.cycle].start_s), names[x.joint],
                           number(x.expected), number(x.found), number(x.z), number(f.threshold));
  return changes;
}

/// One time constant of one robot: a row per test, a column per joint. Sets `blind` where one is not identifiable.
std::string times_table(const Campaign& c, const Findings& f, const std::vector<std::string>& names, std::size_t robot,
                        Pole pole, bool& blind) {
  std::vector<TextTable::Column> columns{
      TextTable::left(fmt::format("robot {}, {} [min]", robot + 1, pole_names[static_cast<std::size_t>(pole)]))};
  for (const auto& joint : names) columns.push_back(TextTable::right(joint));
  TextTable table(std::move(columns));
  for (std::size_t d = 0; d <= c.days; ++d) {
    const bool merged = d == c.days;
    std::vector<std::string> row{
        merged ? "Mix" : fmt::format("Test {}{}", d + 1, is_changed(f, robot, d) ? " (changed, not in Mix)" : "")};
    for (std::size_t j = 0; j < names.size(); ++j) {
      std::string cell = "*";
      for (const auto& t : times_of(merged ? f.thermal[robot][j].merged : f.thermal[robot][j].days[d]))
        if (t.pole == pole && t.identified) cell = fmt::format("{:.3f} +- {:.2g}", t.value_s / 60, t.sigma_s / 60);
      blind |= cell == "*";
      row.push_back(std::move(cell));
    }
    table.add(std::move(row));
  }
  return table.text() + '\n';
}

std::string inertia_table(const Campaign& c, const std::vector<WorkingDay>& days, const Findings& f) {
  const BaseParameters base = base_parameters(*Regressor::create(c.model->get()));
  std::vector<TextTable::Column> columns{TextTable::left("inertia"), TextTable::left("unit")};
  for (std::size_t robot = 0; robot < c.robots; ++robot)
    for (const auto& head :
         {fmt::format("robot {}, all days", robot + 1), std::string("over days"), std::string("over a day")})
      columns.push_back(TextTable::right(head));
  TextTable table(std::move(columns));
  const auto percent = [](const std::optional<double>& share) {
    return share ? fmt::format("{:.2f} %", 100 * *share) : "-";
  };
  for (std::size_t p = 0; p < base.parameters.size(); ++p) {
    std::vector<std::string> row{base.parameters[p].name, base.parameters[p].unit};
    for (std::size_t robot = 0; robot < c.robots; ++robot) {
      const Spread spread = spread_of(c, days, f, robot, p);
      for (auto cell : {fmt::format("{:.5g} +- {:.2g}", spread.mean, spread.sigma), percent(spread.over_days),
                        percent(spread.over_a_day)})
        row.push_back(std::move(cell));
    }
    table.add(std::move(row));
  }
  return table.text() +
         fmt::format(
             "over days: standard deviation of the tests; over a day: from the first to the last third of it, at "
             "most; -: one test, or no sigma below {:.0f} % in a cycle\n\n",
             100 * identified_within);
}

}  // namespace

std::vector<TableFile> tables(const Campaign& c, const std::vector<WorkingDay>& days, const Findings& f) {
  const auto names = joint_names(c);
  return {{"time_constants.csv", time_constants_csv(c, f, names)},
          {"inertial.csv", inertial_csv(c, days)},
          {"friction.csv", friction_csv(c, days, names)},
          {"changes.csv", changes_csv(c, days, f, names)}};
}

std::string summary(const Campaign& c, const std::vector<WorkingDay>& days, const Findings& f) {
  const auto names = joint_names(c);
  std::string s;
  bool blind = false;
  for (std::size_t robot = 0; robot < c.robots; ++robot)
    for (const Pole pole : {Pole::fast, Pole::slow}) s += times_table(c, f, names, robot, pole, blind);
  if (blind) s += "*: not identifiable from this record\n\n";
  s += inertia_table(c, days, f);
  for (const auto& x : f.changes)
    s += fmt::format(
        "change: robot {}, test {}, cycle {} ({:.0f} min), {}: friction {:+.1f} % from the cycle before, {:+.1f} % on "
        "earlier days, {:.1f} sigma\n",
        x.robot + 1, x.day + 1, x.cycle + 1, days[x.robot * c.days + x.day].cycles[x.cycle].start_s / 60,
        names[x.joint], 100 * x.found, 100 * x.expected, std::abs(x.z));
  s += f.comparisons ? fmt::format(
                           "{} of {} comparisons with earlier days are changes (beyond {:.2f} sigma, so that 1 % of "
                           "unchanged campaigns report any)\n{}\n",
                           f.changes.size(), f.comparisons, f.threshold, what_is_seen(c, days, f))
                     : "changes are not detectable: that takes two days of two cycles\n";
  return s;
}

}  // namespace tribotwin::twin::repeatability
