#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/process/child.hpp>
#include <tribotwin/render/report/sweep/sweep_figures.hpp>
#include <tribotwin/render/report/sweep/sweep_report.hpp>
#include <tribotwin/twin/io/command_line/version.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

using Outcome = Result<void>;
using twin::sweep::StoredRun;

constexpr std::size_t drawn_outputs = 6, tiles_of_outputs = 4, worst_runs = 5, shown_reasons = 12;

std::string runs_text(std::size_t count) { return fmt::format("{} run{}", count, count == 1 ? "" : "s"); }
const char* was_were(std::size_t count) { return count == 1 ? "was" : "were"; }

class Writer {
 public:
  Writer(const twin::sweep::StoredSweep& sweep, const ReportOptions& options)
      : sweep_(sweep), view_(sweep), options_(options), page_(title(), options.figure_files) {}

  Result<Report> write() {
    head();
    double share = 0;
    for (const auto part : {&Writer::what_matters, &Writer::distributions, &Writer::over_factors, &Writer::bands}) {
      if (auto ok = (this->*part)(); !ok) return tl::unexpected(ok.error());
      if (options_.progress) options_.progress(share += 0.25);
    }
    worst();
    reasons("failed", "Failed runs", "Why");
    reasons("warned", "Runs with warnings", "Checks that warn");
    notes();
    page_.add_origin(options_.command);
    page_.add(page_.add_details(page_.body(), "The sweep, as its folder has it"), "pre",
              without_folders(sweep_.campaign));
    return page_.report(said_);
  }

 private:
  std::string title() const {
    const std::string scenario = std::filesystem::path(sweep_.scenario).stem().string();
    return sweep_.plan.empty() ? "Sweep of " + scenario : "Sweep " + sweep_.plan;
  }
  std::size_t count(const char* status) const {
    return static_cast<std::size_t>(std::ranges::count(sweep_.runs, status, &StoredRun::status));
  }
  std::size_t made() const { return sweep_.runs.size(); }
  std::string stopped() const { return sweep_.statistics.value("stopped", std::string()); }
  std::size_t drawn() const { return std::min(sweep_.outputs.size(), drawn_outputs); }

  std::string design_text() const {
    static const std::map<std::string, std::string> names{{"grid", "full grid"},
                                                          {"latin_hypercube", "Latin hypercube"},
                                                          {"sobol", "Sobol' sequence"},
                                                          {"random", "random points"}};
    const auto found = names.find(sweep_.design);
    return (found == names.end() ? sweep_.design : found->second) +
           (sweep_.seed ? fmt::format(", seed {}", *sweep_.seed) : "") + (sweep_.indices ? ", for Sobol' indices" : "");
  }

  /// The first output: how large, and what moves it most.
  std::string verdict() const {
    std::string text;
    if (!sweep_.finished)
      text =
          fmt::format("Unfinished: {} of {} are there, and this page is of these. ", made(), runs_text(sweep_.planned));
    const auto first = first_with_values();
    if (!first) return text + fmt::format("None of {} has a value of any output.", runs_text(made()));
    const Quantity& q = view_.quantities[*first];
    const auto& s = view_.statistics(*first);
    const std::size_t values = s["count"].get<std::size_t>();
    const double low = number_in(s["min"]), high = number_in(s["max"]);
    if (low == high)
      return text + fmt::format("In {} {} is {}.", values == 1 ? "the only run" : "all " + runs_text(values), q.name,
                                q.with_unit(low));
    text +=
        fmt::format("The mean of {} is {} over {}, which lie between {} and {}", q.name, q.estimated(s["mean"]),
                    sweep_.indices ? fmt::format("the {} that are independent", runs_text(values)) : runs_text(values),
                    q.number(low, high - low), q.with_unit(high, high - low));
    return text + strongest(*first) + trouble();
  }

  std::string strongest(std::size_t output) const {
    const auto all = view_.effects(output);
    if (all.empty()) return ".";
    const bool indices = view_.has_indices(output);
    const auto& top = all.front();
    const Limits limits = limits_in(top.value);
    const std::string what =
        fmt::format("{} {}", indices ? "total Sobol' index" : "rank correlation", share_text(top.value));
    if (limits.there() && limits.low <= 0 && limits.high >= 0)
      return fmt::format("; no factor stands out: the largest, {}, may be without effect ({}).", top.name, what);
    return fmt::format("; of the factors, {} matters most ({}).", top.name, what);
  }

  std::string trouble() const {
    std::string text;
    if (const auto failed = count("failed")) text += fmt::format(" {} failed.", runs_text(failed));
    if (const auto warned = count("warned"))
      text += fmt::format(" {} {} not what the scenario asks for.", runs_text(warned), was_were(warned));
    return text;
  }

  std::optional<std::size_t> first_with_values() const {
    for (std::size_t o = 0; o < sweep_.outputs.size(); ++o)
      if (view_.has_values(o)) return o;
    return std::nullopt;
  }

  void head() {
    page_.add(page_.body(), "h1", title());
    const std::size_t failed = count("failed"), warned = count("warned");
    page_.open({.verdict = verdict(),
                .light = failed                       ? Light::red
                         : warned || !sweep_.finished ? Light::amber
                                                      : Light::green,
                .rule = "red when runs failed, amber when runs are missing or are not what the scenario asks for.",
                .tiles = tiles(),
                .action = failed             ? "read below why runs failed, before figures are used."
                          : warned           ? "read below which checks warn, before figures are used."
                          : !sweep_.finished ? "make the other runs; how stands below."
                                             : leading_action(),
                .identity = {options_.robot, serial_number_in_words(options_.serial_number), sweep_.date,
                             fmt::format("{} of {}: {}", runs_text(made()),
                                         std::filesystem::path(sweep_.scenario).filename().string(), design_text()),
                             "tribotwin " + twin::program::version_number(), sweep_.engine}});
    if (!sweep_.description.empty()) page_.add(page_.body(), "p", sweep_.description, "soft");
    notices();
  }

  std::string leading_action() const {
    const auto first = first_with_values();
    const auto all = first ? view_.effects(*first) : std::vector<Effect>{};
    if (all.empty()) return "nothing; the figures below show how outputs lie.";
    const Limits limits = limits_in(all.front().value);
    if (limits.there() && limits.low <= 0 && limits.high >= 0)
      return "make more runs, or vary more, where the leading factor has to be known.";
    return fmt::format("to change {}, change the factor {} first; to predict it, know that best.",
                       view_.quantities[*first].name, all.front().name);
  }

  std::vector<Tile> tiles() const {
    const std::size_t failed = count("failed"), warned = count("warned");
    std::vector<Tile> tiles{{"runs", fmt::format("{} of {}", made(), sweep_.planned),
                             fmt::format("{}; {} failed, {} warned",
                                         !sweep_.finished          ? "unfinished"
                                         : made() < sweep_.planned ? "ended by a stop rule"
                                                                   : "all there",
                                         failed, warned),
                             failed + warned || !sweep_.finished ? "bad" : "good"}};
    std::size_t shown = 0;
    for (std::size_t o = 0; o < sweep_.outputs.size() && shown < tiles_of_outputs; ++o) {
      if (!view_.has_values(o)) continue;
      const Quantity& q = view_.quantities[o];
      const auto& mean = view_.statistics(o)["mean"];
      const Limits limits = limits_in(mean);
      const double half = limits.there() ? (limits.high - limits.low) / 2 : 0;
      tiles.push_back({"mean of " + view_.quantities[o].name, q.with_unit(number_in(mean["value"]), half),
                       limits.there()
                           ? fmt::format("95 %: {} … {}", q.number(limits.low, half), q.number(limits.high, half))
                           : "of all combinations"});
      ++shown;
    }
    // A page has three tiles or more.
    if (shown < 2) tiles.push_back({"factors", fmt::format("{}", sweep_.keys.size()), "that the plan sets"});
    if (shown == 0)
      tiles.push_back({"outputs", fmt::format("0 of {}", sweep_.outputs.size()), "that have a value", "bad"});
    return tiles;
  }

  void notices() {
    std::vector<std::string> texts;
    if (!sweep_.finished)
      texts.push_back(
          fmt::format("This sweep is unfinished: {} of {} are there. 'tribotwin sweep {} -o {}' makes the "
                      "others.",
                      made(), runs_text(sweep_.planned), campaign(), word(sweep_.directory)));
    if (!sweep_.finished) said_.push_back(texts.back());
    if (!stopped().empty())
      texts.push_back(
          fmt::format("A stop rule ended the sweep after {} of {}: {}.", made(), runs_text(sweep_.planned), stopped()));
    if (const auto failed = count("failed"))
      texts.push_back(fmt::format("{} of {} failed and {} left out of all figures; why stands below.", failed,
                                  runs_text(made()), failed == 1 ? "is" : "are"));
    if (texts.empty()) return;
    auto box = page_.add(page_.body(), "div", {}, "notice");
    for (const auto& text : texts) page_.add(box, "p", text);
  }

  void said_of_drawn() {
    if (sweep_.outputs.size() > drawn())
      page_.add(page_.body(), "p",
                fmt::format("Figures are of the first {} of {} outputs.", drawn(), sweep_.outputs.size()), "soft");
  }

  Outcome what_matters() {
    bool any = false;
    for (std::size_t o = 0; o < drawn(); ++o) any |= !view_.effects(o).empty();
    page_.add(page_.body(), "h2", "What matters most");
    if (!any) {
      page_.add(page_.body(), "p",
                "Neither indices nor rank correlations: too few runs, or outputs that do not vary with any factor.");
      return {};
    }
    said_of_drawn();
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    for (std::size_t o = 0; o < drawn(); ++o) {
      if (view_.effects(o).empty()) continue;
      const Drawing d = importance(view_, o);
      if (auto ok = page_.show(grid, d.figure, "importance_" + std::to_string(o + 1), d.caption); !ok) return ok;
    }
    return {};
  }

  Outcome distributions() {
    auto to = page_.body();
    page_.add(to, "h2", "Outputs");
    std::vector<std::string> header{"output"};
    if (!all_have_all()) header.emplace_back("runs");
    header.insert(header.end(), {"mean", "95 %", "deviation"});
    for (const double p : probabilities()) header.push_back(p == 0.5 ? "median" : fmt::format("{:g} %", 100 * p));
    header.emplace_back("range");
    std::vector<std::vector<std::string>> rows;
    for (std::size_t o = 0; o < sweep_.outputs.size(); ++o) rows.push_back(row_of(o));
    page_.add_table(to, header, rows);
    name_columns(to);
    auto grid = page_.add(to, "div", {}, "figures");
    for (std::size_t o = 0; o < drawn(); ++o) {
      const auto& s = view_.statistics(o);
      if (!view_.has_values(o) || number_in(s["min"]) == number_in(s["max"])) continue;
      const Drawing d = distribution_of(view_, o);
      if (auto ok = page_.show(grid, d.figure, "distribution_" + std::to_string(o + 1), d.caption); !ok) return ok;
    }
    if (!grid.first_child()) to.remove_child(grid);
    return {};
  }

  /// Outputs without a name of the plan's are called in words: what their columns in results.csv are.
  void name_columns(pugi::xml_node to) {
    std::vector<std::string> columns;
    for (std::size_t o = 0; o < sweep_.outputs.size(); ++o)
      if (const auto& name = view_.quantities[o].name; name != sweep_.outputs[o].name)
        columns.push_back(name + " is " + sweep_.outputs[o].name);
    if (!columns.empty()) page_.add(to, "p", "In results.csv, " + twin::joined(columns, "; ") + ".", "soft");
  }

  /// Whether every output has a value of each run that counts.
  bool all_have_all() const {
    const auto counting = static_cast<std::size_t>(
        std::ranges::count_if(sweep_.runs, [](const StoredRun& run) { return run.counts && run.status != "failed"; }));
    for (std::size_t o = 0; o < sweep_.outputs.size(); ++o)
      if (!view_.has_values(o) || view_.statistics(o)["count"].get<std::size_t>() != counting) return false;
    return true;
  }

  /// Of the quantiles that statistics.json has.
  std::vector<double> probabilities() const {
    std::vector<double> all;
    if (const auto first = first_with_values())
      for (const auto& q : view_.statistics(*first)["quantiles"]) all.push_back(number_in(q["probability"]));
    return all;
  }

  std::vector<std::string> row_of(std::size_t o) const {
    const Quantity& q = view_.quantities[o];
    const auto& s = view_.statistics(o);
    std::vector<std::string> row{q.name + (q.unit.empty() ? "" : fmt::format(" [{}]", q.unit))};
    if (!view_.has_values(o)) return row.push_back("0"), row;
    if (!all_have_all()) row.push_back(fmt::format("{}", s["count"].get<std::size_t>()));
    const Limits limits = limits_in(s["mean"]);
    const double half = limits.there() ? (limits.high - limits.low) / 2 : 0,
                 span = number_in(s["max"]) - number_in(s["min"]), fine = limits.there() ? half : span / 20;
    row.insert(row.end(),
               {q.number(number_in(s["mean"]["value"]), fine),
                limits.there() ? fmt::format("{} … {}", q.number(limits.low, half), q.number(limits.high, half)) : "–",
                s.contains("deviation") ? q.number(number_in(s["deviation"]["value"]), fine) : "–"});
    for (const auto& quantile : s["quantiles"]) row.push_back(q.number(number_in(quantile["value"]), fine));
    row.push_back(fmt::format("{} … {}", q.number(number_in(s["min"]), fine), q.number(number_in(s["max"]), fine)));
    return row;
  }

  Outcome over_factors() {
    bool any = false;
    for (std::size_t o = 0; o < drawn(); ++o) {
      const auto keys = view_.leading(o);
      if (keys.empty() || !view_.has_values(o)) continue;
      std::vector<std::pair<std::string, Drawing>> drawings;
      const auto add = [&](const char* name, std::optional<Drawing> d) {
        if (d) drawings.emplace_back(fmt::format("{}_{}", name, o + 1), std::move(*d));
      };
      add("over_first", over_factor(view_, o, keys[0]));
      if (keys.size() > 1) {
        add("over_second", over_factor(view_, o, keys[1]));
        add("over_both", over_two(view_, o, keys[0], keys[1]));
        add("surface", surface_over(view_, o, keys[0], keys[1]));
      }
      if (drawings.empty()) continue;
      if (!any) page_.add(page_.body(), "h2", "Over the leading factors");
      any = true;
      page_.add(page_.body(), "h3", view_.quantities[o].name);
      auto grid = page_.add(page_.body(), "div", {}, "figures");
      for (const auto& [name, d] : drawings)
        if (auto ok = page_.show(grid, d.figure, name, d.caption); !ok) return ok;
    }
    return {};
  }

  Outcome bands() {
    if (sweep_.bands.empty()) return {};
    page_.add(page_.body(), "h2", "Over time");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    for (std::size_t b = 0; b < sweep_.bands.size(); ++b)
      if (const auto d = band_over_time(view_, b))
        if (auto ok = page_.show(grid, d->figure, "band_" + std::to_string(b + 1), d->caption); !ok) return ok;
    return {};
  }

  static std::string word(const std::filesystem::path& path) { return shell_word(path.string()); }
  std::string campaign() const { return word(sweep_.directory / "campaign.yaml"); }
  std::string repeat(std::size_t run) const {
    auto folder = sweep_.directory;
    if (!folder.has_filename()) folder = folder.parent_path();
    folder += fmt::format("_run{}", run);
    return fmt::format("tribotwin sweep {} --run {} -o {}", campaign(), run, word(folder));
  }

  /// Of an output that is a minimum the smallest values, else the largest ones.
  void worst() {
    auto to = page_.body();
    std::vector<std::vector<std::string>> rows;
    std::set<std::size_t> named;
    std::vector<std::string> header{"output", "run", "value"};
    header.insert(header.end(), sweep_.keys.begin(), sweep_.keys.end());
    const bool short_keys = sweep_.keys.size() <= 8;
    if (!short_keys) header.resize(3);
    for (std::size_t o = 0; o < drawn(); ++o) {
      std::vector<std::size_t> order;
      for (std::size_t r = 0; r < made(); ++r)
        if (std::isfinite(view_.outputs[o][r])) order.push_back(r);
      const auto& s = view_.statistics(o);
      if (order.empty() || !view_.has_values(o) || number_in(s["min"]) == number_in(s["max"])) continue;
      const double sign = smallest_is_worst(o) ? 1 : -1;
      std::ranges::stable_sort(order, {}, [&](std::size_t r) { return sign * view_.outputs[o][r]; });
      order.resize(std::min((order.size() + 3) / 4, worst_runs));
      const Quantity& q = view_.quantities[o];
      for (const std::size_t r : order) {
        const auto& run = sweep_.runs[r];
        std::vector<std::string> row{
            extreme(smallest_is_worst(o) ? "smallest" : "largest", q.name), fmt::format("{}", run.number),
            q.with_unit(view_.outputs[o][r], (number_in(s["max"]) - number_in(s["min"])) / 20)};
        if (short_keys)
          for (std::size_t k = 0; k < sweep_.keys.size(); ++k) row.push_back(short_value(run.values[k]));
        rows.push_back(std::move(row));
        named.insert(run.number);
      }
    }
    if (rows.empty()) return;
    page_.add(to, "h2", "Worst runs");
    page_.add_table(to, header, rows);
    if (!short_keys)
      page_.add(to, "p", fmt::format("The {} factors of each run stand in results.csv.", sweep_.keys.size()), "soft");
    page_.add(to, "p", "Each of them again, with its telemetry, from the folder in which this page was made:");
    std::string commands;
    for (const std::size_t run : named) commands += (commands.empty() ? "" : "\n") + repeat(run);
    page_.add(to, "pre", commands);
  }

  /// "largest friction heat"; "largest friction of hinge", which is one already, stays.
  static std::string extreme(const std::string& which, const std::string& name) {
    return name.starts_with(which + " ") ? name : which + " " + name;
  }

  bool smallest_is_worst(std::size_t o) const {
    const auto& expression = sweep_.outputs[o].expression;
    return expression.starts_with("min(") || expression.ends_with(".min");
  }
  static std::string short_value(const std::string& value) {
    const auto number = to_number(value);
    return number ? fmt::format("{:.5g}", *number) : value;
  }

  /// The kind of a message.
  static std::string without_numbers(const std::string& message) {
    std::string kind;
    for (const char c : message)
      if (std::string_view("+-.e0123456789").find(c) == std::string_view::npos) kind += c;
    return kind;
  }

  /// Runs of a status, by their message but for its numbers, the commonest first.
  void reasons(const char* status, const char* heading, const char* of) {
    std::map<std::string, std::pair<std::string, std::vector<std::size_t>>> by_message;  // as it is for the first run
    for (const auto& run : sweep_.runs)
      if (run.status == status) {
        auto& [message, runs] = by_message[without_numbers(run.message)];
        if (runs.empty()) message = run.message;
        runs.push_back(run.number);
      }
    if (by_message.empty()) return;
    std::vector<std::pair<std::string, std::vector<std::size_t>>> all;
    for (auto& entry : by_message) all.push_back(std::move(entry.second));
    std::ranges::stable_sort(all, std::greater{}, [](const auto& x) { return x.second.size(); });
    auto to = page_.body();
    page_.add(to, "h2", heading);
    if (all.size() > shown_reasons)
      page_.add(to, "p", fmt::format("The {} commonest of {} reasons; results.csv has all.", shown_reasons, all.size()),
                "soft");
    std::vector<std::vector<std::string>> rows;
    for (const auto& [message, runs] : all) {
      if (rows.size() == shown_reasons) break;
      std::string numbers;
      for (std::size_t i = 0; i < std::min<std::size_t>(runs.size(), 8); ++i)
        numbers += fmt::format("{}{}", i ? ", " : "", runs[i]);
      if (runs.size() > 8) numbers += ", …";
      rows.push_back(
          {fmt::format("{} of {}", runs.size(), made()), numbers,
           message.starts_with(sweep_.scenario + ": ") ? message.substr(sweep_.scenario.size() + 2) : message});
    }
    page_.add_table(to, {"runs", "their numbers", std::string(of) + ", the first"}, rows);
    page_.add(to, "p", "The first of them again:");
    page_.add(to, "pre", repeat(all.front().second.front()));
  }

  void notes() {
    const auto& all = sweep_.statistics["notes"];
    if (all.empty()) return;
    page_.add(page_.body(), "h2", "Notes");
    auto list = page_.add(page_.body(), "ul");
    for (const auto& note : all)
      if (note.is_string()) page_.add(list, "li", note.get<std::string>());
  }

  const twin::sweep::StoredSweep& sweep_;
  SweepView view_;
  const ReportOptions& options_;
  IllustratedPage page_;
  std::vector<std::string> said_;
};

}  // namespace

Result<Report> make_sweep_report(const twin::sweep::StoredSweep& sweep, const ReportOptions& options) {
  return Writer(sweep, options).write();
}

}  // namespace tribotwin::render
