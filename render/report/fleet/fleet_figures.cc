#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include <fmt/format.h>

#include <tribotwin/render/report/fleet/fleet_figures.hpp>
#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>

namespace tribotwin::render {
namespace {

using namespace twin::diagnosis::fleet;
using twin::diagnosis::feature_count;

constexpr const char* feature_names[] = {"ln Fc", "ln Fs", "ln Vs", "ln Fv", "beta"};

Axis days_axis(std::int64_t end_s) {
  return {.quantity = "days to " + twin::date_of(end_s), .unit = "", .from = {}, .to = {}};
}
double day_before(double day, std::int64_t end_s) {
  return std::floor(day) - std::floor(static_cast<double>(end_s) / 86400);
}

/// A strip between two levels over all days.
Series strip(double from, double to, double low, double high, std::string label) {
  return {.mark = Mark::area,
          .label = std::move(label),
          .x = {from, to, to, from},
          .y = {low, low, high, high},
          .stroke = 2};
}

struct Span {
  double from = 0, to = 0;
};
Span days_of(const Detail& d, std::int64_t end_s) {
  Span span{.from = std::numeric_limits<double>::infinity(), .to = -std::numeric_limits<double>::infinity()};
  for (const Rows* rows : {&d.track.healthy, &d.track.recent})
    for (const Row& row : *rows)
      span.from = std::min(span.from, day_before(row.day, end_s)),
      span.to = std::max(span.to, day_before(row.day, end_s));
  if (!(span.from < span.to)) span.from -= 1, span.to += 1;
  return span;
}

std::string level_text(const HealthyLevel& level) {
  return level.curves ? fmt::format("this joint's {} healthy curves", level.curves)
                      : "the healthy curves of the other robots, as this one has fewer than 3";
}

struct Shown {
  std::size_t count, all;
};

std::string plant_caption(const FleetData& data, Shown robots, Shown joints, bool grey) {
  std::string caption =
      fmt::format("Mean over the {:g} days against the joint's healthy curves at the same temperature. Framed: listed.",
                  data.options.survey.days);
  if (grey) caption += " Grey: no curve in these days, or no healthy state.";
  if (robots.all > robots.count)
    caption +=
        fmt::format(" {} of {} robots: those with listed joints first, then those whose friction has changed most.",
                    robots.count, robots.all);
  if (joints.all > joints.count)
    caption += fmt::format(" {} of {} joints, {} left out: those that are listed on a robot first.", joints.count,
                           joints.all, joints.all - joints.count);
  return caption;
}

}  // namespace

std::optional<Drawing> level_over_days(const Detail& d, std::int64_t end_s) {
  if (!d.track.level || d.track.recent.empty()) return {};
  const HealthyLevel& level = *d.track.level;
  const Span span = days_of(d, end_s);
  Figure f{
      .title = "Coulomb friction Fc", .x = days_axis(end_s), .y = {.quantity = "change from healthy", .unit = "%"}};
  f.x.from = span.from, f.x.to = span.to;
  const double half = 2 * level.deviation[0];
  f.series.push_back(
      strip(span.from, span.to, 100 * std::expm1(-half), 100 * std::expm1(half), "healthy, ± 2 deviations"));
  for (const auto& [rows, label, shape, stroke] :
       {std::tuple{&d.track.healthy, "learned from", Shape::circle, 5}, {&d.track.recent, "since", Shape::disc, 1}}) {
    if (rows->empty()) continue;
    Series s{.mark = Mark::points, .label = label, .shape = shape, .stroke = static_cast<std::size_t>(stroke)};
    for (const Row& row : *rows)
      s.x.push_back(day_before(row.day, end_s)), s.y.push_back(100 * std::expm1(level.departure(row, 0)));
    f.series.push_back(std::move(s));
  }
  return Drawing{std::move(f), fmt::format("One point per curve, against the mean of {} at its temperature. The strip: "
                                           "± 2 standard deviations of one healthy curve ({:.1f} %).",
                                           level_text(level), 100 * level.deviation[0])};
}

std::optional<Drawing> features_over_days(const Detail& d, std::int64_t end_s) {
  if (!d.track.level || d.track.recent.empty()) return {};
  const HealthyLevel& level = *d.track.level;
  Figure f{
      .title = "All features", .x = days_axis(end_s), .y = {.quantity = "departure from healthy", .unit = "sigma"}};
  double from = std::numeric_limits<double>::infinity(), to = -from;
  for (const Row& row : d.track.recent)
    from = std::min(from, day_before(row.day, end_s)), to = std::max(to, day_before(row.day, end_s));
  if (!(from < to)) from -= 1, to += 1;
  f.x.from = from, f.x.to = to;
  f.series.push_back(strip(from, to, -2, 2, ""));
  for (int k = 0; k < feature_count; ++k) {
    const auto i = static_cast<std::size_t>(k);
    if (!(level.deviation[i] > 0)) continue;
    Series s{.mark = Mark::line, .label = feature_names[i], .stroke = i == 2 ? 7 : i};
    for (const Row& row : d.track.recent)
      s.x.push_back(day_before(row.day, end_s)), s.y.push_back(level.departure(row, k) / level.deviation[i]);
    f.series.push_back(std::move(s));
  }
  return Drawing{std::move(f),
                 "Logarithms of the features of the friction curve since learning, less those of a healthy "
                 "joint at the same temperature, each in its own standard deviations of one curve; the "
                 "strip is ± 2. Features correlate: verdicts test them together."};
}

std::optional<Drawing> cusum_over_days(const Detail& d, std::int64_t end_s, std::optional<std::int64_t> since_s) {
  if (d.cusum.day.empty()) return {};
  Figure f{.title = "CUSUM", .x = days_axis(end_s), .y = {.quantity = "CUSUM", .from = 0}};
  Series s{.mark = Mark::line, .stroke = 0};
  Series points{.mark = Mark::points, .shape = Shape::disc, .stroke = 0};
  for (std::size_t i = 0; i < d.cusum.day.size(); ++i)
    for (Series* to : {&s, &points})
      to->x.push_back(day_before(d.cusum.day[i], end_s)), to->y.push_back(d.cusum.sum[i]);
  const double top = std::max(1.0, std::ranges::max(s.y) * 1.05);
  f.y.to = top;
  f.x.from = s.x.front() - 0.5, f.x.to = s.x.back() + 0.5;
  if (s.x.size() > 1) f.series.push_back(std::move(s));
  f.series.push_back(std::move(points));
  std::string caption = "Small lasting changes add up, the larger sum of both regions (contact surfaces, lubricant).";
  if (since_s) {
    const double x = day_before(static_cast<double>(*since_s) / 86400, end_s);
    f.series.push_back({.mark = Mark::reference, .label = "listed since", .x = {x, x}, .y = {0, top}, .stroke = 1});
    caption += fmt::format(" Listed by the chart since {}.", twin::date_of(*since_s));
  } else {
    caption += " The chart does not list this joint.";
  }
  return Drawing{std::move(f), std::move(caption)};
}

namespace {
const Listed* listed_as(const FleetData& data, std::int64_t joint) {
  const auto l = std::ranges::find(data.listed, joint, [](const auto& e) { return e.listed.joint.id; });
  return l == data.listed.end() ? nullptr : &l->listed;
}

/// Of more joints than have room, those that are listed on a robot and the first of the others, in their order.
void leave_out(std::vector<std::string>& joints, const FleetData& data) {
  const auto is_listed = [&](const std::string& joint) {
    return std::ranges::any_of(data.listed, [&](const auto& l) { return l.listed.joint.joint == joint; });
  };
  const auto listed = static_cast<std::size_t>(std::ranges::count_if(joints, is_listed));
  std::size_t room = columns_of_the_plant - std::min(columns_of_the_plant, listed);
  std::erase_if(joints, [&](const std::string& joint) { return !is_listed(joint) && (room == 0 || room-- == 0); });
}
}  // namespace

std::optional<Drawing> plant_map(const FleetData& data) {
  const auto& joints = data.overview.joints;
  std::vector<std::string> columns;
  struct Robot {
    std::map<std::string, const JointGlance*> joints;
    double rank = -1, deviations = 0;
  };
  std::map<std::string, Robot> robots;
  for (const auto& g : joints) {
    if (std::ranges::find(columns, g.joint.joint) == columns.end()) columns.push_back(g.joint.joint);
    auto& robot = robots[g.joint.robot];
    robot.joints[g.joint.joint] = &g;
    if (g.change) robot.deviations = std::max(robot.deviations, std::abs(g.deviations));
  }
  for (std::size_t i = 0; i < data.listed.size(); ++i) {
    auto& robot = robots[data.listed[i].listed.joint.robot];
    robot.rank = std::max(robot.rank, static_cast<double>(data.listed.size() - i));
  }
  std::vector<std::pair<std::string, const Robot*>> order;
  for (const auto& entry : robots) order.emplace_back(entry.first, &entry.second);
  std::ranges::stable_sort(order, [](const auto& a, const auto& b) {
    return std::pair{a.second->rank, a.second->deviations} > std::pair{b.second->rank, b.second->deviations};
  });
  const std::size_t all = order.size();
  if (order.size() > rows_of_the_plant) order.resize(rows_of_the_plant);
  const std::size_t all_columns = columns.size();
  leave_out(columns, data);
  HeatMap map{.columns = columns, .rows = {}, .values = {}, .decimals = 1, .signed_values = true};
  double largest = 0;
  bool any = false, all_there = true;
  for (const auto& entry : order) {
    map.rows.push_back(entry.first);
    auto& values = map.values.emplace_back();
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const auto found = entry.second->joints.find(columns[c]);
      const bool there = found != entry.second->joints.end() && found->second->change;
      const Listed* listed = there ? listed_as(data, found->second->joint.id) : nullptr;
      // Of a listed joint the estimate that its row has, which weighs curves by their errors.
      const double change = listed  ? listed->finding.friction_change
                            : there ? *found->second->change
                                    : std::numeric_limits<double>::quiet_NaN();
      values.push_back(std::round(1000 * change) / 10 + 0.0);
      any |= there, all_there &= there;
      if (there) largest = std::max(largest, std::abs(values.back()));
      if (listed) map.marked.push_back({map.rows.size() - 1, c});
    }
  }
  if (!any) return {};
  const double limit = std::max(5.0, std::ceil(largest));
  Figure f{.title = "Change of Coulomb friction",
           .x = {.quantity = "joint", .unit = ""},
           .y = {.quantity = "robot", .unit = ""},
           .colour = Axis{.quantity = "change of Fc", .unit = "%", .from = -limit, .to = limit}};
  f.heat_map = std::move(map);
  return Drawing{std::move(f), plant_caption(data, {order.size(), all}, {columns.size(), all_columns}, !all_there)};
}

}  // namespace tribotwin::render
