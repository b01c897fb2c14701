#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <tuple>

#include <fmt/format.h>

#include <tribotwin/render/page/figure_table.hpp>
#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/report/diagnosis_words.hpp>
#include <tribotwin/render/report/feature_regions.hpp>
#include <tribotwin/render/report/study_report.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

using Outcome = Result<void>;
using namespace twin::diagnosis;

/// Of the levels, from the slowest: those of a test cycle up to a tenth of its speed.
constexpr double slow_share = 0.6;

/// Verdicts of the tables, or those on faults.
std::vector<const StudyVerdict*> verdicts(const StudyJoint& joint, bool on_faults) {
  std::vector<const StudyVerdict*> some;
  for (const auto& v : joint.checked)
    if (!v.faults.empty() == on_faults) some.push_back(&v);
  return some;
}

const StudyCurve& curve(const StudyJoint& joint, const StudyObservation& o) { return joint.curves.at(o.curve); }
Axis speed() { return {.quantity = "motor speed", .unit = "rad/s", .from = 0}; }
Axis torque() { return {.quantity = "friction", .unit = "Nm"}; }

/// The learned observations from the coldest to the hottest.
std::vector<const StudyObservation*> by_temperature(const StudyJoint& joint) {
  std::vector<const StudyObservation*> sorted;
  for (const auto& o : joint.learned) sorted.push_back(&o);
  std::ranges::stable_sort(sorted, {}, &StudyObservation::temperature_degC);
  return sorted;
}

std::optional<Drawing> cold_to_hot(const StudyJoint& joint) {
  const auto warming = by_temperature(joint);
  const double cold = warming.front()->temperature_degC, hot = warming.back()->temperature_degC;
  const StudyObservation* medium = *std::ranges::min_element(
      warming, {}, [&](const auto* o) { return std::abs(o->temperature_degC - (cold + hot) / 2); });
  Figure f{.x = speed(),
           .y = torque(),
           .colour = Axis{.quantity = "temperature", .unit = "°C", .from = cold, .to = std::max(hot, cold + 1)}};
  for (const auto* o : warming)
    f.series.push_back(
        {.x = curve(joint, *o).speed_rad_s, .y = curve(joint, *o).friction_nm, .shade = {o->temperature_degC}});
  for (const auto& [name, o, shape] : {std::tuple{"cold", warming.front(), Shape::circle},
                                       {"medium", medium, Shape::dot},
                                       {"hot", warming.back(), Shape::cross}})
    f.series.push_back({.mark = Mark::points,
                        .label = fmt::format("{}, {:.0f} °C", name, o->temperature_degC),
                        .x = curve(joint, *o).speed_rad_s,
                        .y = curve(joint, *o).friction_nm,
                        .shape = shape,
                        .stroke = 0});
  return Drawing{std::move(f), "The learned curves, as Figures 9 and 10 of Zhou 2024. Hotter is lighter."};
}

std::optional<Drawing> cold_over_hot(const StudyJoint& joint) {
  const auto warming = by_temperature(joint);
  const StudyCurve &cold = curve(joint, *warming.front()), &hot = curve(joint, *warming.back());
  if (cold.speed_rad_s.size() != hot.speed_rad_s.size()) return std::nullopt;
  Series ratio{.x = cold.speed_rad_s};
  for (std::size_t i = 0; i < ratio.x.size(); ++i)
    ratio.y.push_back(hot.friction_nm[i] != 0 ? cold.friction_nm[i] / hot.friction_nm[i] : std::nan(""));
  return Drawing{{.x = speed(), .y = {.quantity = "friction cold / friction hot"}, .series = {std::move(ratio)}},
                 "Coldest over hottest learned curve, level by level, as Figure 11 of Zhou 2024."};
}

/// The curves that were not learned; of each the first `share` of its levels.
std::optional<Drawing> under_load(const StudyJoint& joint, double share, std::string caption) {
  const auto loads = verdicts(joint, false);
  if (loads.empty()) return std::nullopt;
  Figure f{.x = speed(), .y = torque()};
  for (const auto* v : loads) {
    const StudyCurve& c = curve(joint, *v);
    const auto count = static_cast<std::ptrdiff_t>(std::ceil(share * static_cast<double>(c.speed_rad_s.size())));
    f.series.push_back({.label = fmt::format("{}, {:.0f} °C", v->name(), v->temperature_degC),
                        .x = {c.speed_rad_s.begin(), c.speed_rad_s.begin() + count},
                        .y = {c.friction_nm.begin(), c.friction_nm.begin() + count}});
  }
  return Drawing{std::move(f), std::move(caption)};
}

std::optional<Drawing> loads(const StudyJoint& joint) {
  return under_load(joint, 1, "Curves that were not learned, as Figure 13 of Zhou 2024.");
}

std::optional<Drawing> loads_slow(const StudyJoint& joint) {
  return under_load(joint, slow_share, "The slower levels of the same curves, where contact surfaces carry the load.");
}

constexpr FigureRow<StudyJoint> friction_figures[] = {
    {"cold_to_hot", "friction, cold to hot", cold_to_hot},
    {"cold_over_hot", "cold over hot", cold_over_hot},
    {"loads", "friction under load", loads},
    {"loads_slow", "friction under load, slow", loads_slow},
};

class Writer {
 public:
  Writer(const std::filesystem::path& directory, const std::vector<StudyJoint>& joints, const ReportOptions& options)
      : joints_(joints),
        options_(options),
        title_(fmt::format("Study of {}", twin::joined(names(joints), " and "))),
        page_(title_, options.figure_files) {
    head(directory);
  }

  Result<Report> write() {
    double done = 0;
    for (const StudyJoint& joint : joints_) {
      page_.add(page_.body(), "h2", joint.name);
      for (const auto part :
           {&Writer::friction, &Writer::over_observations, &Writer::regions_shown, &Writer::table, &Writer::faults}) {
        if (auto ok = (this->*part)(joint); !ok) return tl::unexpected(ok.error());
        if (options_.progress) options_.progress(++done / (5 * static_cast<double>(joints_.size())));
      }
    }
    page_.add_origin(options_.command);
    return page_.report({});
  }

 private:
  static std::vector<std::string> names(const std::vector<StudyJoint>& joints) {
    std::vector<std::string> all;
    for (const auto& joint : joints) all.push_back(joint.name);
    return all;
  }

  std::vector<Tile> learned_tiles() const {
    std::size_t learned = 0;
    for (const StudyJoint& joint : joints_) learned += joint.learned.size();
    return {{"joints", fmt::format("{}", joints_.size()), twin::joined(names(joints_))},
            {"learned", fmt::format("{}", learned), "unloaded curves of healthy joints"}};
  }

  void head(const std::filesystem::path& directory) {
    auto to = page_.body();
    page_.add(to, "h1", title_);
    std::vector<std::string> sentences;
    std::size_t unloaded = 0, false_alarms = 0, loaded = 0, flagged = 0, faults = 0, named = 0;
    for (const StudyJoint& joint : joints_) {
      std::string said;
      for (std::size_t r = 0; r < regions.size(); ++r) {
        std::vector<std::string> which;
        for (const auto* v : verdicts(joint, false))
          if (v->region[r].anomalous) which.push_back(v->name());
        said += fmt::format(" Region {} ({}) flags {}.", r + 1, regions[r].of,
                            which.empty() ? "nothing" : twin::joined(which, "; "));
      }
      if (!verdicts(joint, false).empty()) sentences.push_back(joint.name + ":" + said);
      for (const StudyVerdict& v : joint.checked) {
        const auto [count, hits] = !v.faults.empty() ? std::tie(faults, named)
                                   : v.load_kg == 0  ? std::tie(unloaded, false_alarms)
                                                     : std::tie(loaded, flagged);
        ++count;
        hits += v.faults.empty() ? v.anomalous : v.is_named();
      }
    }
    std::vector<Tile> tiles = learned_tiles();
    std::vector<std::string> found;
    if (loaded) {
      found.push_back(fmt::format("{} of {} curves with a payload are noticed", flagged, loaded));
      tiles.push_back({"loads noticed", fmt::format("{} of {}", flagged, loaded), "curves with a payload"});
    }
    if (unloaded) {
      found.push_back(
          fmt::format("{} of {} new healthy ones without a payload are false alarms", false_alarms, unloaded));
      tiles.push_back({"false alarms", fmt::format("{} of {}", false_alarms, unloaded), "new unloaded curves",
                       false_alarms ? "bad" : "good"});
    }
    const bool missed = 5 * named < 4 * faults;
    if (faults) {
      found.push_back(fmt::format("{} of {} curves with a fault are named by it", named, faults));
      tiles.push_back({"faults named", fmt::format("{} of {}", named, faults), "simulated curves with a fault",
                       missed ? "bad" : "good"});
    }
    page_.open({.verdict = twin::joined(found) + ".",
                .light = missed         ? Light::red
                         : false_alarms ? Light::amber
                                        : Light::green,
                .rule = "red when fewer than 80 % of the faults are named, amber with a false alarm.",
                .tiles = std::move(tiles),
                .action = "compare figures and tables with those of Zhou 2024.",
                .identity = identity_of(
                    options_, "", "",
                    twin::engine_of(twin::read_text(directory / "campaign.yaml", "a campaign").value_or("")))});
    for (const auto& said : sentences) page_.add(to, "p", said);
    page_.add(
        to, "p",
        fmt::format("{}: the experiment of Zhou 2024, healthy states learned from unloaded curves cold to hot, and "
                    "verdicts on curves that were not learned.",
                    (directory / "").parent_path().filename().string()),
        "soft");
  }

  Outcome friction(const StudyJoint& joint) {
    page_.add(page_.body(), "h3", "Friction, cold to hot and under load");
    return show_table(page_, page_.add(page_.body(), "div", {}, "figures"), friction_figures,
                      {.name = joint.name + "_", .title = joint.name + ": "}, joint);
  }

  /// One line for each series of the campaign that was learned.
  Outcome over_observations(const StudyJoint& joint) {
    page_.add(page_.body(), "h3", "Features over the learned observations");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    const auto show = [&](const Axis& axis, const std::string& caption,
                          const std::function<double(const StudyObservation&)>& value) {
      Figure f{.title = fmt::format("{}: {}", joint.name, axis.quantity), .x = {.quantity = "observation"}, .y = axis};
      for (std::size_t i = 0; i < joint.learned.size(); ++i) {
        const std::string& series = curve(joint, joint.learned[i]).series;
        if (f.series.empty() || f.series.back().label != series) f.series.push_back({.label = series});
        f.series.back().x.push_back(static_cast<double>(i + 1));
        f.series.back().y.push_back(value(joint.learned[i]));
      }
      return page_.show(grid, f, fmt::format("{}_{}", joint.name, axis.quantity), caption);
    };
    if (auto ok = show({.quantity = "temperature", .unit = "°C"}, "Of the learned curves, in the order of time.",
                       [](const auto& o) { return o.temperature_degC; });
        !ok)
      return ok;
    for (Eigen::Index k = 0; k < feature_count; ++k)
      if (auto ok = show(feature_axis(k), "Fitted to each learned curve, as Figure 12 of Zhou 2024.",
                         [k](const auto& o) { return o.features(k); });
          !ok)
        return ok;
    return {};
  }

  Outcome regions_shown(const StudyJoint& joint) {
    const HealthyState published;  // for its thresholds
    const auto n = static_cast<double>(joint.learned.size());
    FeatureRegions shown{.mean = Features::Zero(),
                         .covariance = FeatureMatrix::Zero(),
                         .anomalous_distance = published.anomalous_distance,
                         .wear_distance = published.wear_distance,
                         .learned = {},
                         .checked = {}};
    for (const auto& o : joint.learned) shown.learned.push_back(o.features), shown.mean += o.features / n;
    for (const auto& y : shown.learned) shown.covariance += (y - shown.mean) * (y - shown.mean).transpose() / (n - 1);
    for (const auto* v : verdicts(joint, false))
      shown.checked.push_back({v->features, {v->region[0].anomalous, v->region[1].anomalous}});
    page_.add(page_.body(), "h3", "Confidence regions");
    return show_regions(page_, page_.body(), shown, joint.name);
  }

  Outcome table(const StudyJoint& joint) {
    const auto some = verdicts(joint, false);
    if (some.empty()) return {};
    page_.add(page_.body(), "h3", "Distances");
    const auto yes = [](bool b) { return b ? "yes" : "no"; };
    std::vector<std::vector<std::string>> rows;
    for (const auto* v : some) {
      auto& row = rows.emplace_back();
      row = {fmt::format("{}", rows.size()), fmt::format("{:g} kg", v->load_kg), v->state,
             fmt::format("{:.1f}", v->temperature_degC)};
      for (const auto& r : v->region)
        row.insert(row.end(),
                   {fmt::format("{:.3f}", r.distance), fmt::format("{:.2f}", r.statistic), yes(r.anomalous)});
      row.push_back(v->pattern);
    }
    page_.add_table(page_.body(),
                    {"", "load", "state", "°C", "distance region 1", "T² 1", "anomalous 1", "distance region 2", "T² 2",
                     "anomalous 2", "pattern"},
                    rows);
    const auto& first = some.front()->region;
    page_.add(page_.body(), "p",
              fmt::format("As Tables II and III of Zhou 2024. Distance: squared, eq. (15), over all temperatures; Zhou "
                          "calls distances beyond {:g} anomalous. Anomalous here: T², against a healthy joint at the "
                          "same temperature, "
                          "beyond {:.2f} in region 1, {:.2f} in region 2.",
                          HealthyState{}.anomalous_distance, first[0].limit, first[1].limit),
              "soft");
    return {};
  }

  Outcome faults(const StudyJoint& joint) {
    const auto simulated = verdicts(joint, true);
    if (simulated.empty() && joint.power.empty()) return {};
    page_.add(page_.body(), "h3", "Faults");
    if (!simulated.empty()) {
      std::vector<Counted> counted;
      for (const auto* v : simulated) {
        const std::string fault = twin::joined(v->faults);
        if (counted.empty() || counted.back().fault != fault) counted.push_back({.fault = fault});
        ++counted.back().verdicts[v->pattern];
      }
      page_.add(page_.body(), "p", "Verdicts on simulated curves with a fault: how often each fault got which name.");
      confusion(counted, [](double count) { return fmt::format("{:g}", count); });
    }
    if (joint.power.empty()) return {};
    std::vector<Counted> drawn;
    for (const auto& power : joint.power)
      drawn.push_back(
          {fmt::format("{}, {}", power.fault->name, severity_text(power, 2 * power.detection_limit)), power.named});
    page_.add(page_.body(), "p",
              "Curves drawn from law and scatter, each fault at twice its detection limit (the severity that is "
              "detected in 95 % of the curves): shares by verdict.");
    confusion(drawn, [](double share) { return fmt::format("{:.3g} %", 100 * share); });
    page_.add(page_.body(), "p",
              "Share of curves with a fault that are found over the share of false alarms that each region and "
              "indicator may raise, for severities up to twice the detection limit. Line by line from no fault (the "
              "share of healthy curves that any of them flags) upwards; where all are found, lines lie on each other.",
              "soft");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    for (const auto& power : joint.power)
      if (auto ok = page_.show(grid, roc(joint, power), fmt::format("{}_roc_{}", joint.name, power.fault->name),
                               fmt::format("{}; detection limit {}.", power.fault->footprint,
                                           severity_text(power, power.detection_limit)));
          !ok)
        return ok;
    return {};
  }

  /// With its unit where it has one: "0.04", "0.1 Nm".
  static std::string severity_text(const twin::study::Power& power, double severity) {
    return fmt::format("{:.2g}{}", severity, power.fault->unit == "1" ? "" : fmt::format(" {}", power.fault->unit));
  }

  static Figure roc(const StudyJoint& joint, const twin::study::Power& power) {
    Figure f{.title = fmt::format("{}: ROC of {}{}", joint.name, power.fault->name,
                                  power.fault->unit == "1" ? "" : fmt::format(" [{}]", power.fault->unit)),
             .x = {.quantity = "false-alarm share", .from = 0},
             .y = {.quantity = "detected share", .from = 0, .to = 1.05}};
    double last = -1;
    for (const auto& [severity, false_alarm, detected] : power.roc) {
      if (f.series.empty() || severity != last)
        f.series.push_back({.label = severity == 0 ? "no fault" : typeset(fmt::format("{:.2g}", severity))});
      f.series.back().x.push_back(false_alarm);
      f.series.back().y.push_back(detected);
      last = severity;
    }
    return f;
  }

  /// How often a fault got which verdict.
  struct Counted {
    std::string fault;
    std::map<std::string, double> verdicts;
  };

  void confusion(const std::vector<Counted>& counted, const std::function<std::string(double)>& shown) {
    std::vector<std::string> columns;
    for (const auto& fault : drive::faults()) columns.emplace_back(fault.name);
    for (const auto& one : counted)
      for (const auto& [name, count] : one.verdicts)
        if (std::ranges::find(columns, name) == columns.end()) columns.push_back(name);
    std::vector<std::vector<std::string>> rows;
    for (const auto& one : counted) {
      auto& row = rows.emplace_back(1, in_words(one.fault));
      for (const auto& name : columns) row.push_back(one.verdicts.contains(name) ? shown(one.verdicts.at(name)) : "");
    }
    std::ranges::transform(columns, columns.begin(), in_words);
    columns.insert(columns.begin(), "fault");
    page_.add_table(page_.body(), columns, rows);
  }

  const std::vector<StudyJoint>& joints_;
  const ReportOptions& options_;
  std::string title_;
  IllustratedPage page_;
};

}  // namespace

Result<Report> make_study_report(const std::filesystem::path& directory, const std::vector<StudyJoint>& joints,
                                 const ReportOptions& options) {
  return Writer(directory, joints, options).write();
}

}  // namespace tribotwin::render
