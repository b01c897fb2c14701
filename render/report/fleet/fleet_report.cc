#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/render/report/fleet/fleet_figures.hpp>
#include <tribotwin/render/report/fleet/fleet_report.hpp>
#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>
#include <tribotwin/twin/io/command_line/version.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::render {
namespace {

using Outcome = Result<void>;
using namespace twin::diagnosis::fleet;

constexpr std::size_t listed_rows = 200, shown_files = 12, shown_notes = 20, shown_checks = 20;

std::string joints_text(std::size_t count) { return fmt::format("{} joint{}", count, count == 1 ? "" : "s"); }
std::string percent_of(double share) { return fmt::format("{:g} %", 100 * share); }

class Writer {
 public:
  Writer(const FleetData& data, const ReportOptions& options)
      : d_(data), o_(data.overview), options_(options), page_(title(), options.figure_files) {}

  Result<Report> write() {
    head();
    list();
    if (auto ok = plant(); !ok) return tl::unexpected(ok.error());
    for (std::size_t i = 0; i < d_.details.size(); ++i) {
      if (auto ok = detail(i); !ok) return tl::unexpected(ok.error());
      if (options_.progress) options_.progress(static_cast<double>(i + 1) / static_cast<double>(d_.details.size()));
    }
    curves();
    past();
    notes();
    page_.add_origin(options_.command);
    return page_.report({});
  }

 private:
  std::string title() const { return "Fleet " + d_.store.stem().string(); }
  double rate() const { return d_.options.survey.rate; }
  std::size_t judged() const { return std::max(o_.check.judged, o_.watch.judged); }
  /// Joints of the store that check does not judge.
  std::size_t without_verdict() const { return o_.joints.size() - std::min(o_.joints.size(), o_.check.judged); }
  std::size_t silent() const {
    return static_cast<std::size_t>(
        std::ranges::count_if(o_.joints, [](const JointGlance& g) { return g.curves == 0; }));
  }
  std::size_t robots() const {
    std::vector<std::string> names;
    for (const auto& g : o_.joints) names.push_back(g.joint.robot);
    std::ranges::sort(names);
    return static_cast<std::size_t>(std::unique(names.begin(), names.end()) - names.begin());
  }
  static std::string name_of(const Listed& l) { return l.joint.robot + " " + l.joint.joint; }
  static std::string severity_of(const Finding& f) {
    if (f.pattern == "unknown") return "–";
    return f.unit == "1" ? fmt::format("{:.0f} %", 100 * f.severity) : fmt::format("{:.3g} {}", f.severity, f.unit);
  }
  static std::string q_text(double q) { return q < 1e-4 ? "<0.0001" : fmt::format("{:.2g}", q); }

  static std::string cause_of(const Finding& f) {
    if (f.pattern == "unknown") return "of unknown cause";
    std::string pattern(f.pattern);
    std::ranges::replace(pattern, '_', ' ');
    return fmt::format("looks like {} (confidence {})", pattern, twin::diagnosis::probability_text(f.confidence));
  }
  /// As a sentence.
  static std::string sentence(std::string_view text) {
    std::string s(text);
    if (s.empty()) return s;
    s[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(s[0])));
    return s.back() == '.' ? s : s + ".";
  }

  std::string verdict() const {
    std::string text;
    if (d_.listed.empty()) {
      text = fmt::format("None of {} needs a look", joints_text(judged()));
    } else {
      const auto& l = d_.listed.front().listed;
      const auto& f = l.finding;
      text = fmt::format("{} of {} {} a look: ", d_.listed.size(), joints_text(judged()),
                         d_.listed.size() == 1 ? "needs" : "need");
      text += fmt::format("{}{}, friction {:+.1f} %, {}", d_.listed.size() > 1 ? "first " : "", name_of(l),
                          100 * f.friction_change, cause_of(f));
      if (l.since_s) text += ", since " + twin::date_of(*l.since_s);
    }
    text += ".";
    if (const auto n = without_verdict())
      text += fmt::format(" {} {} no verdict.", joints_text(n), n == 1 ? "has" : "have");
    return text;
  }

  std::string rule() const {
    std::string text = fmt::format("red when a joint is listed, amber when one has no verdict. False-discovery rate {}",
                                   percent_of(rate()));
    if (const std::size_t check = o_.check.listed.size(), watch = o_.watch.listed.size(); check + watch > 0)
      text += fmt::format(" of each list (check {}, watch {}): of them {}", check, watch,
                          healthy_among(check + watch, rate()));
    return text + ".";
  }

  std::string action() const {
    if (!d_.listed.empty()) {
      const auto& l = d_.listed.front().listed;
      return fmt::format("{}: {}.", name_of(l), l.finding.advice);
    }
    return without_verdict() ? "measure or learn the joints without verdict; the others need nothing."
                             : "nothing; check again when there are new curves.";
  }

  /// What one list says of a joint that is on the other one alone; of one that is on both, nothing.
  std::string of_one_list(const FleetData::Entry& e) const {
    if (e.by_check && e.by_watch) return "";
    return e.by_check ? " Listed by check alone: its chart of small lasting changes does not stand out."
                      : fmt::format(
                            " Listed by watch alone: its mean over the last {} does not stand out, small lasting "
                            "changes do.",
                            days_text());
  }

  /// How many are on which list.
  std::string lists_text() const {
    const auto count = [&](bool check, bool watch) {
      return std::ranges::count_if(d_.listed,
                                   [&](const auto& e) { return e.by_check == check && e.by_watch == watch; });
    };
    return fmt::format("{} on both lists, {} on that of check alone, {} on that of watch alone.", count(true, true),
                       count(true, false), count(false, true));
  }

  std::string days_text() const {
    const double days = d_.options.survey.days;
    return days == 1 ? std::string("day") : fmt::format("{:g} days", days);
  }
  std::string these_days() const { return (d_.options.survey.days == 1 ? "this " : "these ") + days_text(); }

  void head() {
    auto to = page_.body();
    page_.add(to, "h1", title());
    page_.open({.verdict = verdict(),
                .light = !d_.listed.empty()  ? Light::red
                         : without_verdict() ? Light::amber
                                             : Light::green,
                .rule = rule(),
                .tiles = tiles(),
                .action = action(),
                .identity = {fmt::format("the {} to {}", days_text(), twin::date_of(o_.check.time_s)),
                             fmt::format("{} of {} robots", joints_text(o_.joints.size()), robots()),
                             "tribotwin " + twin::program::version_number()}});
    const auto box_of = [&] { return page_.add(page_.body(), "div", {}, "notice"); };
    std::optional<pugi::xml_node> box;
    const auto say = [&](const std::string& text) {
      if (!box) box = box_of();
      page_.add(*box, "p", text);
    };
    if (o_.check.without_model)
      say(fmt::format("{} without verdict: no healthy curves of their type were learned ('tribotwin fleet learn').",
                      joints_text(o_.check.without_model)));
    if (o_.check.without_temperature)
      say(fmt::format("{} without verdict: curves without temperature_degC.",
                      joints_text(o_.check.without_temperature)));
    if (silent()) say(fmt::format("{} without verdict: no curve in {}.", joints_text(silent()), these_days()));
  }

  std::vector<Tile> tiles() const {
    std::size_t imported = 0;
    for (const auto& file : o_.files) imported += file.curves;
    return {{"judged", fmt::format("{}", o_.check.judged), fmt::format("of {}", joints_text(o_.joints.size()))},
            {"listed", fmt::format("{}", d_.listed.size()),
             fmt::format("{} by check, {} by watch", o_.check.listed.size(), o_.watch.listed.size()),
             d_.listed.empty() ? "good" : "bad"},
            {"without verdict", fmt::format("{}", without_verdict()), "", without_verdict() ? "bad" : "good"},
            {"curves", fmt::format("{}", imported), "of " + these_days()}};
  }

  void list() {
    auto to = page_.body();
    page_.add(to, "h2", "To look at");
    if (d_.listed.empty()) {
      page_.add(to, "p", "No joint is listed.");
    } else {
      std::vector<std::vector<std::string>> rows;
      for (const auto& [l, by_check, by_watch] : d_.listed) {
        if (rows.size() == listed_rows) break;
        const auto& f = l.finding;
        rows.push_back({fmt::format("{}", rows.size() + 1), l.joint.robot, l.joint.joint,
                        fmt::format("{:+.1f} %", 100 * f.friction_change), std::string(f.pattern), severity_of(f),
                        fmt::format("{:.3f} ({:.3f} … {:.3f})", f.margin, f.margin_low, f.margin_high), q_text(l.q),
                        l.since_s ? twin::date_of(*l.since_s) : "–",
                        by_check && by_watch ? "both"
                        : by_check           ? "check"
                                             : "watch",
                        std::string(f.advice)});
      }
      page_.add_table(to,
                      {"#", "robot", "joint", "Fc change", "pattern", "severity", "margin (95 %)", "q", "since", "by",
                       "what to do"},
                      rows);
      if (d_.listed.size() > listed_rows)
        page_.add(to, "p", fmt::format("The first {} of {}.", listed_rows, d_.listed.size()), "soft");
      page_.add(to, "p", lists_text());
    }
    page_.add(
        to, "p",
        fmt::format(
            "check judges the mean of the last {}, watch small lasting changes since learning (CUSUM). Each "
            "list by itself is made at the false-discovery rate of {}; q is the rate at which a joint would just be "
            "listed. "
            "Margin: "
            "what is left to the wear threshold, in equivalent load over the maximum torque; below 0 it is exceeded. "
            "Ranked by severity or the used share of the margin, whichever is larger.",
            days_text(), percent_of(rate())),
        "soft");
  }

  Outcome plant() {
    const auto d = plant_map(d_);
    if (!d) return {};
    page_.add(page_.body(), "h2", "The plant");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    return page_.show(grid, d->figure, "plant", d->caption);
  }

  Outcome detail(std::size_t i) {
    auto to = page_.body();
    const Listed& l = d_.listed[i].listed;
    if (i == 0) {
      page_.add(to, "h2", "Listed joints");
      if (d_.details.size() < d_.listed.size())
        page_.add(to, "p", fmt::format("The first {} of {}.", d_.details.size(), d_.listed.size()), "soft");
    }
    page_.add(to, "h3", fmt::format("{}. {}", i + 1, name_of(l)));
    page_.add(to, "p",
              fmt::format("Friction {:+.1f} %, {}. {}{}", 100 * l.finding.friction_change, cause_of(l.finding),
                          sentence(l.finding.advice), of_one_list(d_.listed[i])));
    auto grid = page_.add(to, "div", {}, "figures");
    const auto& shown = d_.details[i];
    const std::int64_t end_s = o_.check.time_s;
    const std::pair<const char*, std::optional<Drawing>> drawings[] = {
        {"friction", level_over_days(shown, end_s)},
        {"cusum", cusum_over_days(shown, end_s, l.since_s)},
        {"features", features_over_days(shown, end_s)}};
    for (const auto& [name, d] : drawings)
      if (d)
        if (auto ok = page_.show(grid, d->figure, fmt::format("{}_{}", name, i + 1), d->caption); !ok) return ok;
    return {};
  }

  void curves() {
    auto to = page_.body();
    page_.add(to, "h2", "Curves of " + these_days());
    if (o_.files.empty()) {
      page_.add(to, "p", "There are none.");
      return;
    }
    std::vector<std::vector<std::string>> rows;
    for (const auto& file : o_.files) {
      if (rows.size() == shown_files) break;
      rows.push_back({std::filesystem::path(file.name).filename().string(), fmt::format("{}", file.curves),
                      fmt::format("{}", file.robots), fmt::format("{}", file.weak)});
    }
    page_.add_table(to, {"file", "curves", "robots", "left out, not identifiable"}, rows);
    if (o_.files.size() > shown_files)
      page_.add(to, "p", fmt::format("The first {} of {} files.", shown_files, o_.files.size()), "soft");
  }

  /// What was said before.
  void past() {
    if (o_.past.empty()) return;
    auto to = page_.body();
    page_.add(to, "h2", "Earlier checks");
    std::vector<std::vector<std::string>> rows;
    for (auto c = o_.past.rbegin(); c != o_.past.rend() && rows.size() < shown_checks; ++c)
      rows.push_back({twin::date_of(c->time_s), c->kind, fmt::format("{}", c->judged), fmt::format("{}", c->listed),
                      percent_of(c->rate)});
    page_.add_table(to, {"to", "kind", "judged", "listed", "false-discovery rate"}, rows);
    if (o_.past.size() > shown_checks)
      page_.add(to, "p", fmt::format("The last {} of {}.", shown_checks, o_.past.size()), "soft");
  }

  void notes() {
    if (o_.notes.empty()) return;
    auto to = page_.body();
    page_.add(to, "h2", "Notes");
    auto items = page_.add(to, "ul");
    for (std::size_t i = 0; i < std::min(o_.notes.size(), shown_notes); ++i) {
      const auto& n = o_.notes[i];
      page_.add(
          items, "li",
          n.robot.empty() ? n.text : fmt::format("{} {}, {}: {}", n.robot, n.joint, twin::date_of(n.time_s), n.text));
    }
    if (o_.notes.size() > shown_notes)
      page_.add(to, "p", fmt::format("The first {} of {}.", shown_notes, o_.notes.size()), "soft");
  }

  const FleetData& d_;
  const Overview& o_;
  const ReportOptions& options_;
  IllustratedPage page_;
};

}  // namespace

Result<FleetData> load_fleet(const std::filesystem::path& store, const FleetOptions& options) try {
  FleetData d{.store = store, .options = options, .overview = overview_of(store, options.survey)};
  std::map<std::int64_t, std::size_t> place;
  for (const auto& l : d.overview.check.listed) {
    place.emplace(l.joint.id, d.listed.size());
    d.listed.push_back({.listed = l, .by_check = true});
  }
  for (const auto& l : d.overview.watch.listed) {
    const auto known = place.find(l.joint.id);
    if (known == place.end()) {
      d.listed.push_back({.listed = l, .by_watch = true});
      continue;
    }
    auto& entry = d.listed[known->second];
    entry.by_watch = true;
    entry.listed.since_s = l.since_s, entry.listed.cusum = l.cusum;
  }
  std::ranges::stable_sort(d.listed, std::greater{}, [](const auto& e) { return e.listed.rank; });
  std::vector<std::int64_t> first;
  for (const auto& e : d.listed)
    if (first.size() < options.shown) first.push_back(e.listed.joint.id);
  d.details = details_of(store, first, options.survey);
  return d;
} catch (const twin::InputError& e) {
  return tl::unexpected(Error(e.what()));
}

Result<Report> make_fleet_report(const FleetData& data, const ReportOptions& options) {
  return Writer(data, options).write();
}

}  // namespace tribotwin::render
