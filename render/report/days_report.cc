#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/report/days_report.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/median.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

namespace tribotwin::render {
namespace {

using Outcome = Result<void>;
using namespace twin::repeatability;

constexpr std::size_t curve_points = 400, shown_parameters = 6;
constexpr double expected_to_be_seen = 0.3;  ///< change of a joint's friction: that of the shipped campaign's break
constexpr double compared_share = 0.5;       ///< of a day, so that few breaks are in its rest

class Writer {
 public:
  Writer(const DaysData& data, const ReportOptions& options)
      : data_(data),
        c_(data.campaign),
        f_(data.results.findings),
        options_(options),
        page_(c_.name, options.figure_files),
        regressor_(*twin::Regressor::create(c_.model->get())),
        base_(twin::base_parameters(regressor_)) {}

  Result<Report> write() {
    head();
    changes_table();
    time_constants();
    double share = 0;
    for (const auto part : {&Writer::warming, &Writer::torques, &Writer::changed_joints, &Writer::inertia}) {
      if (auto ok = (this->*part)(); !ok) return tl::unexpected(ok.error());
      if (options_.progress) options_.progress(share += 0.25);
    }
    base_table();
    page_.add_origin(options_.command);
    page_.add(page_.add_details(page_.body(), "The campaign, as it was run"), "pre", without_folders(data_.text));
    return page_.report({});
  }

 private:
  std::size_t joints() const { return static_cast<std::size_t>(regressor_.joints()); }
  const std::string& joint(std::size_t j) const { return regressor_.joint_name(static_cast<Eigen::Index>(j)); }
  const WorkingDay& day(std::size_t robot, std::size_t d) const { return data_.results.days[robot * c_.days + d]; }
  bool changed(std::size_t robot, std::size_t d) const {
    return std::ranges::any_of(f_.changes, [&](const Change& x) { return x.robot == robot && x.day == d; });
  }
  static std::string share(const std::optional<double>& x) { return x ? fmt::format("{:.2f} %", 100 * *x) : "–"; }

  /// The parameters that the tests of the first robot identify best.
  std::vector<std::size_t> best_identified() const {
    std::vector<std::size_t> order(base_.parameters.size());
    std::iota(order.begin(), order.end(), 0);
    const auto precision = [&](std::size_t p) { return std::abs(day(0, 0).base[p].value) / day(0, 0).base[p].sigma; };
    std::ranges::stable_sort(order, std::greater{}, [&](std::size_t p) {
      const double x = precision(p);
      return std::isnan(x) ? 0 : x;
    });
    order.resize(std::min(order.size(), shown_parameters));
    return order;
  }

  std::string changes_in_words() const {
    std::string out;
    for (const auto& x : f_.changes)
      if (const bool first = &x == f_.changes.data() || x.robot != (&x - 1)->robot || x.day != (&x - 1)->day ||
                             x.joint != (&x - 1)->joint;
          first)
        out += fmt::format(
            "Robot {}, test {}: friction of {} changed at {:.0f} min, by {:+.1f} % from one cycle to the next where "
            "earlier days had {:+.1f} % ({:.0f} sigma). ",
            x.robot + 1, x.day + 1, joint(x.joint), minutes(x), 100 * x.found, 100 * x.expected, std::abs(x.z));
    return out;
  }

  std::string verdict() const {
    if (!f_.comparisons) return "Nothing is compared: that takes two days of two cycles.";
    return (f_.changes.empty() ? "No change of a joint's friction was seen. " : changes_in_words()) +
           what_is_seen(c_, data_.results.days, f_);
  }

  bool misses() const {
    return f_.seen > expected_to_be_seen || seen_until_s(data_.results.days) < compared_share * c_.duration_s;
  }

  /// Joints of all robots whose time constants the days without a change identify together.
  std::size_t with_time_constants() const {
    std::size_t count = 0;
    for (const auto& robot : f_.thermal)
      count += static_cast<std::size_t>(std::ranges::count_if(robot, [](const Thermal& joint) {
        return std::ranges::any_of(times_of(joint.merged), &TimeConstant::identified);
      }));
    return count;
  }
  std::size_t robots_joints() const { return c_.robots * joints(); }

  Light light() const {
    if (!f_.changes.empty()) return Light::red;
    return misses() || with_time_constants() < robots_joints() ? Light::amber : Light::green;
  }

  std::string action() const {
    if (!f_.changes.empty()) return "look at the joint named, and measure its friction curve.";
    if (!f_.comparisons) return "test on more days: a change shows against earlier ones.";
    if (light() == Light::green) return "nothing; go on with the tests.";
    return "test on longer days: friction is compared once per cycle of the motion, and a time constant is identified "
           "on days of five times its length.";
  }

  std::vector<Tile> tiles() const {
    std::vector<Tile> tiles;
    tiles.push_back({"tests", fmt::format("{}", data_.results.days.size()),
                     fmt::format("{} robot{}, {} day{} of {:.3g} h", c_.robots, c_.robots > 1 ? "s" : "", c_.days,
                                 c_.days > 1 ? "s" : "", c_.duration_s / 3600)});
    tiles.push_back({"cycles", fmt::format("{}", day(0, 0).cycles.size()), "of the motion on a day"});
    if (f_.comparisons)
      tiles.push_back({"changes", fmt::format("{}", f_.changes.size()),
                       fmt::format("of {} comparisons, beyond {:.2f} sigma", f_.comparisons, f_.threshold),
                       !f_.changes.empty() ? "bad"
                       : misses()          ? "warn"
                                           : "good"});
    const std::size_t known = with_time_constants();
    tiles.push_back({"time constants", fmt::format("{} of {}", known, robots_joints()),
                     "joints, identified from all days without a change", known < robots_joints() ? "warn" : "good"});
    add_inertia(tiles);
    return tiles;
  }

  void add_inertia(std::vector<Tile>& tiles) const {
    std::optional<double> drift, over_days;
    for (std::size_t robot = 0; robot < c_.robots; ++robot)
      for (std::size_t p = 0; p < base_.parameters.size(); ++p) {
        const Spread s = spread_of(c_, data_.results.days, f_, robot, p);
        if (s.over_a_day) drift = std::max(drift.value_or(0), *s.over_a_day);
        if (s.over_a_day && s.over_days) over_days = std::max(over_days.value_or(0), *s.over_days);
      }
    tiles.push_back({"inertia over a day", share(drift),
                     fmt::format("maximum of the parameters that one cycle identifies within {:.0f} %; their maximum "
                                 "standard deviation over days: {}",
                                 100 * identified_within, share(over_days)),
                     !drift          ? nullptr
                     : *drift < 0.05 ? "good"
                                     : "bad"});
  }

  void head() {
    page_.add(page_.body(), "h1", c_.name);
    page_.open({.verdict = verdict(),
                .light = light(),
                .rule = fmt::format(
                    "red when a joint's friction changed by more than it does from one day to the next, amber when "
                    "nothing is compared, a change of {:.0f} % could be missed, less than {:.0f} % of a day is "
                    "compared, or a joint's time constants are not identifiable.",
                    100 * expected_to_be_seen, 100 * compared_share),
                .tiles = tiles(),
                .action = action(),
                .identity = identity_of(options_, c_.model->get()->names, "", twin::engine_of(data_.text))});
    if (!c_.description.empty()) page_.add(page_.body(), "p", c_.description, "soft");
  }

  double minutes(const Change& x) const { return day(x.robot, x.day).cycles[x.cycle].start_s / 60; }

  void changes_table() {
    if (f_.changes.empty()) return;
    page_.add(page_.body(), "h2", "Changes");
    std::vector<std::vector<std::string>> rows;
    for (const auto& x : f_.changes)
      rows.push_back({joint(x.joint), fmt::format("{}", x.robot + 1), fmt::format("{}", x.day + 1),
                      fmt::format("{}", x.cycle + 1), fmt::format("{:.1f}", minutes(x)),
                      fmt::format("{:+.2f} %", 100 * x.found), fmt::format("{:+.2f} %", 100 * x.expected),
                      fmt::format("{:.1f}", std::abs(x.z))});
    page_.add_table(page_.body(),
                    {"joint", "robot", "test", "cycle", "from [min]", "friction, from the cycle before",
                     "on earlier days", "sigma"},
                    rows);
    page_.add(page_.body(), "p",
              fmt::format(
                  "A change is a step of friction from one cycle to the next that differs from the same step on "
                  "earlier days of this robot by more than {:.2f} standard deviations: of campaigns without a change, "
                  "1 % report any. Tests with a change are not merged, and later tests are not compared with them.",
                  f_.threshold),
              "soft");
  }

  void time_constants() {
    auto to = page_.body();
    page_.add(to, "h2", "Time constants");
    for (std::size_t robot = 0; robot < c_.robots; ++robot) {
      page_.add(to, "h3", fmt::format("Robot {}", robot + 1));
      std::vector<std::string> head{"minutes"};
      for (std::size_t j = 0; j < joints(); ++j) head.push_back(joint(j));
      std::vector<std::vector<std::string>> rows;
      for (const char* name : {"t1", "t2"})
        for (std::size_t d = 0; d <= c_.days; ++d) {
          auto& row = rows.emplace_back();
          row.push_back(
              fmt::format("{}, {}", name,
                          d < c_.days ? fmt::format("test {}{}", d + 1, changed(robot, d) ? ", changed" : "") : "Mix"));
          for (std::size_t j = 0; j < joints(); ++j) {
            const auto& t = f_.thermal[robot][j];
            row.push_back("*");
            for (const auto& time : times_of(d < c_.days ? t.days[d] : t.merged))
              if (time.identified && time.name == std::string(name))
                row.back() = fmt::format("{:.3f} ± {:.2g}", time.value_s / 60, time.sigma_s / 60);
          }
        }
      page_.add_table(to, head, rows);
    }
    page_.add(
        to, "p",
        "As the table of time constants in Hao 2021: of each test, and of all tests without a change merged (Mix). "
        "Estimated from friction; no temperature was measured. * not identifiable from this record.",
        "soft");
  }

  /// Friction of one joint over the days of a robot, thinned, with gaps where no window of motion came for long.
  std::vector<Trace> traces(std::size_t robot, std::size_t j) const {
    std::vector<Trace> out;
    for (std::size_t d = 0; d < c_.days; ++d) {
      const Warming& w = day(robot, d).warming[j];
      Trace t{
          .label = fmt::format("test {}{}", d + 1, changed(robot, d) ? ", changed" : ""), .time_s = {}, .values = {}};
      std::vector<double> time_s;
      const auto shown = thinned(w.time_s.size(), curve_points);
      for (const std::size_t i : shown) time_s.push_back(w.time_s[i]);
      const double gap_s = 5 * twin::identification::median_step(time_s);
      for (const std::size_t i : shown) {
        if (!t.time_s.empty() && w.time_s[i] - t.time_s.back() > gap_s)
          t.time_s.push_back((w.time_s[i] + t.time_s.back()) / 2), t.values.push_back(std::nan(""));
        t.time_s.push_back(w.time_s[i]), t.values.push_back(w.friction_nm[i]);
      }
      out.push_back(std::move(t));
    }
    return out;
  }

  Axis friction_axis(std::size_t j) const {
    return {.quantity = "friction", .unit = regressor_.is_slide(static_cast<Eigen::Index>(j)) ? "N" : "Nm"};
  }

  Outcome warming() {
    page_.add(page_.body(), "h2", "Friction over the day");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    for (std::size_t j = 0; j < joints(); ++j)
      for (std::size_t robot = 0; robot < c_.robots; ++robot)
        if (auto ok = page_.show(
                grid, history(fmt::format("{}, robot {}", joint(j), robot + 1), friction_axis(j), traces(robot, j)),
                fmt::format("friction_{}_robot{}", joint(j), robot + 1),
                fmt::format("At {:.0f} % of the maximum speed: motor torque less rigid dynamics, in windows of motion.",
                            100 * level_share));
            !ok)
          return ok;
    return {};
  }

  Outcome torques() {
    page_.add(page_.body(), "h2", "Torque, cold and hot");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    for (std::size_t j = 0; j < joints(); ++j) {
      Figure figure{.title = fmt::format("{}, robot 1, test 1", joint(j)),
                    .x = {.quantity = "time in the cycle", .unit = "s"},
                    .y = {.quantity = "motor torque", .unit = friction_axis(j).unit}};
      for (const auto& [name, stretch] : {std::pair{"cold", &day(0, 0).cold}, {"hot", &day(0, 0).hot}}) {
        std::vector<double> time, predicted = stretch->predicted_nm[j];
        for (const double t : stretch->time_s) time.push_back(t - stretch->time_s.front());
        for (std::size_t i = 0; i < predicted.size(); ++i)
          if (!stretch->moving[j][i]) predicted[i] = std::nan("");
        figure.series.push_back(
            {.mark = Mark::line, .label = fmt::format("measured, {}", name), .x = time, .y = stretch->measured_nm[j]});
        figure.series.push_back({.mark = Mark::reference,
                                 .label = fmt::format("predicted, {}", name),
                                 .x = time,
                                 .y = std::move(predicted)});
      }
      if (auto ok = page_.show(grid, figure, fmt::format("torque_{}", joint(j)),
                               "The same motion in the first and in the last cycle of the day, measured (filtered) and "
                               "predicted by the parameters of the day with friction at the estimated temperature.");
          !ok)
        return ok;
    }
    return {};
  }

  /// Values with sigmas over the cycles of all tests, one after the other.
  template <class Value>
  Series evolution(std::size_t robot, std::string label, const Value& value) const {
    Series s{.mark = Mark::error_bars, .label = std::move(label), .x = {}, .y = {}, .error = {}};
    for (std::size_t d = 0; d < c_.days; ++d)
      for (std::size_t k = 0; k < day(robot, d).cycles.size(); ++k) {
        const Measured& m = value(day(robot, d).cycles[k]);
        s.x.push_back(1 + static_cast<double>(d) +
                      (static_cast<double>(k) + 0.5) / static_cast<double>(day(robot, d).cycles.size()));
        s.y.push_back(m.value);
        s.error.push_back(std::isfinite(m.sigma) ? m.sigma : 0);
      }
    return s;
  }
  static Axis over_tests() { return {.quantity = "test, and share of its day", .unit = "-"}; }

  Outcome changed_joints() {
    std::vector<std::size_t> which;
    for (const auto& x : f_.changes)
      if (std::ranges::find(which, x.joint) == which.end()) which.push_back(x.joint);
    if (which.empty()) return {};
    page_.add(page_.body(), "h2", "Friction parameters over the tests");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    for (const std::size_t j : which) {
      const auto show = [&](const std::string& what, const Axis& axis, const std::string& caption, const auto& value) {
        Figure figure{.title = fmt::format("{}: {}", joint(j), what), .x = over_tests(), .y = axis};
        for (std::size_t robot = 0; robot < c_.robots; ++robot)
          figure.series.push_back(evolution(robot, fmt::format("robot {}", robot + 1), value));
        return page_.show(grid, figure, fmt::format("{}_{}", what, joint(j)), caption);
      };
      if (auto ok = show("friction", friction_axis(j),
                         "Friction of each cycle, the quantity that is compared from day to day, with one sigma.",
                         [&](const Cycle& k) -> const Measured& { return k.level_nm[j]; });
          !ok)
        return ok;
      if (auto ok = show("f1", friction_axis(j), "The law's friction at speed 0, of each cycle, with one sigma.",
                         [&](const Cycle& k) -> const Measured& { return k.friction[j][0]; });
          !ok)
        return ok;
    }
    return {};
  }

  Outcome inertia() {
    page_.add(page_.body(), "h2", "Inertial parameters over the tests");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    for (const std::size_t p : best_identified()) {
      const auto& parameter = base_.parameters[p];
      Figure figure{.title = parameter.name,
                    .x = over_tests(),
                    .y = {.quantity = parameter.name, .unit = with_superscripts(parameter.unit)}};
      for (std::size_t robot = 0; robot < c_.robots; ++robot) {
        figure.series.push_back(evolution(robot, fmt::format("robot {}", robot + 1),
                                          [&](const Cycle& k) -> const Measured& { return k.base[p]; }));
        const double truth = day(robot, 0).base_of_robot[p];
        figure.series.push_back({.mark = Mark::reference,
                                 .label = robot ? "" : "as simulated",
                                 .x = {1, 1 + static_cast<double>(c_.days)},
                                 .y = {truth, truth},
                                 .stroke = robot});
      }
      if (auto ok = page_.show(grid, figure, "inertia_" + parameter.name,
                               fmt::format("{}, of each cycle, with one sigma.", parameter.group));
          !ok)
        return ok;
    }
    return {};
  }

  void base_table() {
    auto to = page_.body();
    page_.add(to, "h2", "Base parameters");
    std::vector<std::string> head{"parameter", "unit"};
    for (std::size_t robot = 0; robot < c_.robots; ++robot)
      for (const char* what : {"", ", as simulated", ", over days", ", over a day"})
        head.push_back(fmt::format("robot {}{}", robot + 1, what));
    std::vector<std::vector<std::string>> rows, groups;
    for (std::size_t p = 0; p < base_.parameters.size(); ++p) {
      auto& row = rows.emplace_back();
      row = {base_.parameters[p].name, base_.parameters[p].unit};
      for (std::size_t robot = 0; robot < c_.robots; ++robot) {
        const Spread s = spread_of(c_, data_.results.days, f_, robot, p);
        row.push_back(s.sigma > 0 ? with_sigma(s.mean, s.sigma) : fmt::format("{:.4g}", s.mean));
        const double simulated = day(robot, 0).base_of_robot[p];  // of what cancels, rounding is left
        row.push_back(std::abs(simulated) < 1e-12 ? "0" : fmt::format("{:.4g}", simulated));
        row.push_back(share(s.over_a_day ? s.over_days : std::nullopt));
        row.push_back(share(s.over_a_day));
      }
      if (base_.parameters[p].group != base_.parameters[p].name)
        groups.push_back({base_.parameters[p].name, base_.parameters[p].group});
    }
    page_.add_table(to, head, rows);
    page_.add(
        to, "p",
        fmt::format("Of all tests without a change. Over days: standard deviation of the tests. Over a day: maximum "
                    "change from its first to its last third. –: one cycle does not identify it within {:.0f} %. "
                    "Some are identifiable only as combinations:",
                    100 * identified_within),
        "soft");
    page_.add_table(to, {"parameter", "stands for"}, groups);
  }

  const DaysData& data_;
  const Campaign& c_;
  const Findings& f_;
  const ReportOptions& options_;
  IllustratedPage page_;
  twin::Regressor regressor_;
  twin::BaseParameters base_;
};

}  // namespace

Result<DaysData> load_days(const std::filesystem::path& directory) try {
  const auto file = directory / "campaign.yaml";
  const YAML::Node root = twin::load_yaml(file);
  if (!is_repeatability(root)) return tl::unexpected(fmt::format("{}: is no campaign of working days", file.string()));
  auto campaign = load_campaign(file, root);
  if (!campaign) return tl::unexpected(campaign.error());
  auto text = twin::read_text(file, "a campaign");
  if (!text) return tl::unexpected(text.error());
  DaysData data{.directory = directory, .text = *std::move(text), .campaign = *std::move(campaign)};
  auto results = read_results(data.campaign, directory);
  if (!results) return tl::unexpected(results.error());
  data.results = *std::move(results);
  return data;
} catch (const twin::InputError& e) {
  return tl::unexpected(e.what());
}

Result<Report> make_days_report(const DaysData& data, const ReportOptions& options) {
  return Writer(data, options).write();
}

}  // namespace tribotwin::render
