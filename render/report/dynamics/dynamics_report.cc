#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/report/dynamics/dynamics_report.hpp>
#include <tribotwin/twin/identification/verdict/torque_band.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

using Outcome = Result<void>;
using twin::identification::Dependence;
using twin::identification::InBand;

constexpr std::size_t excerpt_samples = 800;
constexpr double seldom = 0.01;  // share of samples outside the training that needs no word

std::string number(double v) { return std::isnan(v) ? "–" : fmt::format("{:.4g}", v); }

bool moves(const JointPrediction& joint) { return joint.lacking.empty() && !std::isnan(joint.rms); }

/// The axis of a quantity that residuals may depend on.
Axis axis_of(const Dependence& d, bool slide) {
  const bool of_other = d.on.starts_with("speed of ");
  std::string unit = d.on == "time"          ? "s"
                     : d.on == "temperature" ? "°C"
                     : d.on == "load"        ? (slide ? "N" : "Nm")
                     : d.on == "position"    ? (slide ? "m" : "rad")
                     : of_other              ? ""
                                             : (slide ? "m/s" : "rad/s");
  return {.quantity = d.on, .unit = std::move(unit)};
}

class Writer {
 public:
  Writer(const DynamicsData& data, const ReportOptions& options)
      : data_(data), options_(options), page_(title(), options.figure_files) {}

  Result<Report> write() {
    head();
    notes();
    errors();
    for (std::size_t k = 0; k < data_.joints.size(); ++k) {
      if (auto ok = joint(data_.joints[k]); !ok) return tl::unexpected(ok.error());
      if (options_.progress) options_.progress(static_cast<double>(k + 1) / static_cast<double>(data_.joints.size()));
    }
    parameters();
    origin();
    return page_.report(data_.missing);
  }

 private:
  std::string title() const { return without_folder(data_.parameters) + ": torques predicted and recorded"; }

  /// The moving joint with the largest share; null where none moves.
  template <class Share>
  const JointPrediction* worst(const Share& share) const {
    const JointPrediction* found = nullptr;
    for (const auto& j : data_.joints)
      if (moves(j) && !std::isnan(j.*share) && (!found || j.*share > found->*share)) found = &j;
    return found;
  }

  std::vector<std::string> names(bool JointPrediction::*which) const {
    std::vector<std::string> out;
    for (const auto& j : data_.joints)
      if (j.*which) out.push_back(j.name);
    return out;
  }

  bool in_doubt() const {
    return !data_.warnings.empty() || std::ranges::any_of(data_.joints, [](const JointPrediction& j) {
      return !j.lacking.empty() || !(j.outside <= seldom);
    });
  }
  Light light() const { return !data_.badly_explained.empty() ? Light::red : in_doubt() ? Light::amber : Light::green; }

  std::string verdict() const {
    const auto* by_range = worst(&JointPrediction::of_range);
    if (!by_range) return "No joint moves: friction at rest does not follow from the motion.";
    const auto bad = names(&JointPrediction::badly_explained);
    const auto* by_variation = worst(&JointPrediction::of_variation);
    std::string rest;
    if (!bad.empty())
      rest = fmt::format("; {} {} badly explained", twin::joined(bad), bad.size() > 1 ? "are" : "is");
    else if (by_variation)
      rest = fmt::format("; {} of a joint's variation is unexplained (worst: {})", percent(by_variation->of_variation),
                         by_variation->name);
    return fmt::format("Torques are predicted to {} of their range (root mean square; worst: {}){}.",
                       percent(by_range->of_range), by_range->name, rest);
  }

  std::string action() const {
    const auto* worst_explained = worst(&JointPrediction::of_variation);
    if (!data_.badly_explained.empty() && worst_explained) {
      const auto shown = shown_of(*worst_explained);
      return fmt::format(
          "look at the residual of {} below{}; the notes say what would help.", worst_explained->name,
          shown.empty() || !shown.front()->shown()
              ? ""
              : fmt::format(", {} of which goes with {}", percent(shown.front()->share), shown.front()->on));
    }
    if (in_doubt()) return "read the notes below before these torques are relied on.";
    return "nothing; torques of motions like these may be predicted.";
  }

  /// What the residual depends on beyond noise, most first, at most three; else speed.
  static std::vector<const Dependence*> shown_of(const JointPrediction& j) {
    std::vector<const Dependence*> shown;
    for (const auto& d : j.dependence)
      if (d.shown() && !d.bins.empty()) shown.push_back(&d);
    std::ranges::stable_sort(shown, std::greater{}, &Dependence::share);
    if (shown.size() > 3) shown.resize(3);
    if (shown.empty())
      for (const auto& d : j.dependence)
        if (d.on == "speed" && !d.bins.empty()) shown.push_back(&d);
    return shown;
  }

  void head() {
    auto to = page_.body();
    page_.add(to, "h1", title());
    std::vector<Tile> tiles;
    if (const auto* j = worst(&JointPrediction::of_range))
      tiles.push_back({"largest error", percent(j->of_range), fmt::format("of the range of {}, RMS", j->name)});
    if (const auto* j = worst(&JointPrediction::of_variation))
      tiles.push_back({"unexplained", percent(j->of_variation), fmt::format("of the variation of {}", j->name),
                       j->badly_explained ? "bad" : "good"});
    if (const auto* j = worst(&JointPrediction::beside_band))
      tiles.push_back({"within the 95 % band", percent(1 - j->beside_band),
                       fmt::format("of the torques of {}", j->name), j->band_fails ? "warn" : "good"});
    if (const auto* j = worst(&JointPrediction::outside))
      tiles.push_back(
          {"outside the training", percent(j->outside),
           j->outside == 0 ? "of the samples" : fmt::format("of the samples of {}, by {}", j->name, j->outside_of),
           j->outside > seldom ? "warn" : "good"});
    tiles.push_back({"recordings", fmt::format("{}", data_.recordings.size()), without_folder(data_.model)});
    page_.open(
        {.verdict = verdict(),
         .light = light(),
         .rule = fmt::format("red when 30 % or more of the variation of a joint's torque is unexplained, amber "
                             "when a note is below, a joint has no prediction, or more than {:.0f} % of its "
                             "samples are outside the training. A note says where less than {:.0f} % of a "
                             "joint's torques are within their 95 % band, though the motion is within the training's "
                             "range.",
                             100 * seldom, 100 * InBand::too_few),
         .tiles = std::move(tiles),
         .action = action(),
         .identity = identity_of(options_, source_of("recording", data_.recordings))});
  }

  void notes() {
    auto all = data_.badly_explained;
    all.insert(all.end(), data_.warnings.begin(), data_.warnings.end());
    all.insert(all.end(), data_.missing.begin(), data_.missing.end());
    if (all.empty()) return;
    page_.add(page_.body(), "h2", "Notes");
    auto list = page_.add(page_.body(), "ul");
    for (const auto& one : all) page_.add(list, "li", without_folders(one));
  }

  void errors() {
    page_.add(page_.body(), "h2", "Errors");
    std::vector<std::vector<std::string>> rows;
    for (const auto& j : data_.joints) {
      const std::string outside = !j.lacking.empty()      ? j.lacking
                                  : std::isnan(j.outside) ? "not known"
                                  : j.outside == 0        ? "–"
                                                          : fmt::format("{} by {}", percent(j.outside), j.outside_of);
      rows.push_back({j.name, number(j.rms), percent(j.of_range), number(j.range), number(j.largest),
                      number(j.half_width), j.unit, percent(1 - j.beside_band), percent(j.of_variation), outside});
    }
    page_.add_table(page_.body(),
                    {"joint", "error, RMS", "of its range", "range", "largest", "95 % band, ±", "unit", "in the band",
                     "unexplained", "outside the training"},
                    rows);
    page_.add(
        page_.body(), "p",
        "Of samples in which the joint moves. 95 % band: 95 % of the torques of the training were that near to what "
        "the rest of the training predicts. In the band: the share of the torques of these recordings, where the "
        "motion is within the training's range. Unexplained: error over the standard deviation of the torque.",
        "soft");
  }

  /// From one sample to before another.
  struct Stretch {
    std::size_t first, last;
  };
  /// Around the middle of the samples with a prediction, as far as time goes on; nothing where none has one.
  static std::optional<Stretch> excerpt(const JointPrediction& j) {
    std::vector<std::size_t> known;
    for (std::size_t i = 0; i < j.predicted.size(); ++i)
      if (std::isfinite(j.predicted[i])) known.push_back(i);
    if (known.empty()) return std::nullopt;
    const std::size_t n = j.time_s.size(), count = std::min(n, excerpt_samples), middle = known[known.size() / 2];
    const std::size_t begin = std::min(middle - std::min(middle, count / 2), n - count);
    Stretch s{.first = middle, .last = middle + 1};
    while (s.first > begin && j.time_s[s.first] > j.time_s[s.first - 1]) --s.first;
    while (s.last < begin + count && j.time_s[s.last] > j.time_s[s.last - 1]) ++s.last;
    return s;
  }

  Outcome torques(pugi::xml_node to, const JointPrediction& j) {
    const auto shown = excerpt(j);
    if (!shown) {
      page_.add(to, "p", fmt::format("No torques of {} are drawn: no sample of the table has a prediction.", j.name));
      return {};
    }
    const auto [first, last] = *shown;
    const auto cut = [&](const std::vector<double>& v) {
      return std::vector<double>(v.begin() + static_cast<std::ptrdiff_t>(first),
                                 v.begin() + static_cast<std::ptrdiff_t>(last));
    };
    const std::vector<double> time_s = cut(j.time_s);
    const std::vector<Trace> traces{{.label = "recorded", .time_s = time_s, .values = cut(j.recorded), .stroke = 0},
                                    {.label = "predicted",
                                     .time_s = time_s,
                                     .values = cut(j.predicted),
                                     .stroke = 1,
                                     .half_width = j.band.empty() ? std::vector<double>() : cut(j.band)}};
    const bool with_band = std::ranges::any_of(traces[1].half_width, [](double h) { return std::isfinite(h); });
    return page_.show(
        to, history(j.name, {.quantity = "torque", .symbol = "τ", .unit = j.unit}, traces), "torque_" + j.name,
        fmt::format("{}: torque, recorded and, while the joint moves, predicted, from {:.6g} to {:.6g} s.{}", j.name,
                    time_s.front(), time_s.back(),
                    with_band
                        ? fmt::format(" Band: ± {} {} about it, in which 95 % of recorded torques lie if the robot "
                                      "is as in the training; drawn where the motion is within the training's range.",
                                      number(j.half_width), j.unit)
                        : ""));
  }

  Outcome residual(pugi::xml_node to, const JointPrediction& j, const Dependence& d) {
    Series s{.mark = Mark::error_bars};
    for (const auto& bin : d.bins)
      s.x.push_back((bin.from + bin.to) / 2), s.y.push_back(bin.mean),
          s.error.push_back(std::isnan(bin.sigma) ? 0 : 1.96 * bin.sigma);
    const bool opposes = d.on == "load" || d.on == "temperature";
    Figure f{.title = fmt::format("{}: residual over {}", j.name, d.on),
             .x = axis_of(d, j.unit == "N"),
             .y = {.quantity = opposes ? "residual × sign of speed" : "residual", .unit = j.unit},
             .series = {std::move(s)}};
    return page_.show(to, f, "residual_" + j.name,
                      fmt::format("{}: mean residual with its 95 % interval; {} of the residual goes with {}{}.",
                                  j.name, percent(d.share), d.on, d.shown() ? "" : ", as much as noise does"));
  }

  Outcome joint(const JointPrediction& j) {
    if (!moves(j)) return {};
    const auto shown = shown_of(j);
    if (j.time_s.size() < 2 && shown.empty()) return {};
    page_.add(page_.body(), "h2", j.name);
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    if (j.time_s.size() >= 2)
      if (auto ok = torques(grid, j); !ok) return ok;
    for (const auto* d : shown)
      if (auto ok = residual(grid, j, *d); !ok) return ok;
    return {};
  }

  void parameters() {
    if (data_.friction.empty()) return;
    page_.add(page_.body(), "h2", "Friction");
    std::vector<std::vector<std::string>> rows;
    for (const auto& j : data_.friction)
      for (const auto& e : j.estimates)
        rows.push_back({j.joint, j.law, e.name, number(e.value),
                        std::isnan(e.sigma) ? "–" : fmt::format("{:.2g}", e.sigma), e.unit});
    page_.add_table(page_.body(), {"joint", "law", "parameter", "value", "standard deviation", "unit"}, rows);
    page_.add(page_.body(), "p", "– without a standard deviation: given, or not told by the recordings.", "soft");
  }

  void origin() {
    page_.add_origin(options_.command);
    std::vector<std::string> names;
    for (const auto& file : data_.recordings) names.push_back(without_folder(file));
    page_.add(page_.body(), "p",
              fmt::format("Predicted with {} and {} of the recordings {}.", without_folder(data_.model),
                          without_folder(data_.parameters), twin::joined(names)),
              "soft");
  }

  const DynamicsData& data_;
  const ReportOptions& options_;
  IllustratedPage page_;
};

}  // namespace

Result<Report> make_dynamics_report(const DynamicsData& data, const ReportOptions& options) {
  return Writer(data, options).write();
}

}  // namespace tribotwin::render
