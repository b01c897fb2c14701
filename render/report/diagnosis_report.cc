#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/render/report/diagnosis_report.hpp>
#include <tribotwin/render/report/diagnosis_words.hpp>
#include <tribotwin/render/report/feature_regions.hpp>
#include <tribotwin/render/report/fit_data.hpp>
#include <tribotwin/twin/diagnosis/healthy_file.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

using namespace twin::diagnosis;
using Outcome = Result<void>;

/// Reads the curves that the state was learned from; none where one of the files is missing.
void load_learned(DiagnosisData& d, const ObservationOptions& read) {
  for (const auto& name : d.healthy.data) {
    const auto file = twin::named_file(name, d.file);
    auto seen =
        file ? read_observations(*file, read)
             : Result<ObservationFile>(tl::unexpect, fmt::format("{} is neither in the working directory nor beside {}",
                                                                 name, d.file.filename().string()));
    if (!seen) {
      d.missing.push_back(
          fmt::format("The curves that the healthy state was learned from are not shown: {}.", seen.error().message));
      d.learned.clear();
      return;
    }
    std::ranges::move(seen->observations, std::back_inserter(d.learned));
  }
}

/// The levels of the last curve of a file.
void load_latest(DiagnosisData& d, const std::filesystem::path& file, const ObservationOptions& read) {
  const auto samples = twin::identification::read_samples(
      std::array{file}, *friction::find_law(law_name),
      {.torque_max_nm = read.torque_max_nm, .gear_ratio = read.gear_ratio, .table = read.table});
  if (!samples) return;  // read_observations has read it; what its page lacks then is the figure of the levels
  for (std::size_t i = 0; i < samples->size(); ++i) {
    if (!samples->curve.empty() && samples->curve[i] + 1 != samples->curves()) continue;
    d.latest.speed_rad_s.push_back(samples->speed[i]);
    d.latest.friction_nm.push_back(samples->friction[i]);
    d.latest.error_nm.push_back(samples->standard_error.empty() ? 0 : samples->standard_error[i]);
  }
}

constexpr std::size_t curve_points = 200;

/// The steady-state law of Zhou 2024 (11) with these features.
double friction_nm(const Features& f, double speed_rad_s) {
  const friction::Law steady_state{.info = friction::find_law(law_name), .validity = friction::Validity::extrapolate};
  const friction::Law law = friction::with_parameters(steady_state, std::array{f[0], f[1], f[2], alpha, f[3], f[4]});
  return friction::level(law, friction::at_temperature(law, 0), speed_rad_s, 0).total();
}

/// Features of their logarithms (beta is not one).
Features from_logarithms(const Features& y) {
  Features f;
  for (Eigen::Index i = 0; i < feature_count; ++i) f[i] = i + 1 < feature_count ? std::exp(y[i]) : y[i];
  return f;
}

constexpr double two_sided_95 = 1.96;

/// Covariance of the logarithmic features of a healthy joint's next curve at the temperature of an observation.
FeatureMatrix healthy_covariance(const HealthyState& h, const Observation& o) {
  const Eigen::VectorXd x = h.regressors(o.temperature_degC);
  Features scale;
  for (std::size_t r = 0; r < regions.size(); ++r)
    scale.segment(regions[r].first, regions[r].count)
        .setConstant(std::sqrt(h.region[r].variance(x, h.scatter_of(o, r))));
  return scale.asDiagonal() * h.together * scale.asDiagonal();
}

/// What `of` makes of the features of a healthy joint, and how far 95 % of new curves are from it at most.
struct Healthy {
  double value, half_width;
};
Healthy healthy(const HealthyState& h, const Observation& o, auto of) {
  const Features expected = o.logarithmic() - h.deviation(o);
  const double value = of(from_logarithms(expected));
  Features slope;
  for (Eigen::Index k = 0; k < feature_count; ++k) {
    constexpr double step = 1e-5;
    Features moved = expected;
    moved[k] += step;
    slope[k] = (of(from_logarithms(moved)) - value) / step;
  }
  return {value, two_sided_95 * std::sqrt(std::max(0.0, slope.dot(healthy_covariance(h, o) * slope)))};
}

constexpr double day_s = 86400;

/// Days since 1970-01-01 of the first date in a name, "joint3_2026-03-14.csv".
std::optional<double> day_of(const std::string& name) {
  for (std::size_t i = 0; i + 10 <= name.size(); ++i)
    if (const auto time_s = twin::to_time(std::string_view(name).substr(i, 10)))
      return static_cast<double>(*time_s) / day_s;
  return std::nullopt;
}

std::string date_text(double day) { return twin::date_of(std::llround(day) * std::llround(day_s)); }

std::string name_of(const Observation& o) { return std::filesystem::path(o.file).filename().string(); }

/// The days of observations, in the order given; nothing where one has none.
std::vector<double> days_of(const std::vector<Observation>& observations) {
  std::vector<double> days;
  for (const auto& o : observations)
    if (const auto day = day_of(name_of(o))) days.push_back(*day);
  if (days.size() != observations.size()) days.clear();
  return days;
}

/// Over the days; without one where there are none or only one, and, with the reason, where they go back.
void add_trend(DiagnosisData& d) {
  d.days = days_of(d.checked);
  if (!std::ranges::is_sorted(d.days)) {
    d.missing.push_back(
        "The files are not in the order of the dates in their names: there is no trend over dates, and changes add up "
        "in the order given.");
    return;
  }
  if (d.days.empty() || d.days.front() == d.days.back()) return;
  std::vector<double> since;
  for (const double day : d.days) since.push_back(day - d.days.front());
  d.trend = margin(d.healthy, d.checked, since);
}

std::string percent(double share) { return fmt::format("{:.1f}", 100 * share); }

/// "joint3" of joint3_2026-01-10.csv, joint3_2026-02-14.csv: what the names of the files share before their dates; of
/// files without dates nothing.
std::string common_name(const std::vector<Observation>& observations) {
  std::string common;
  for (const auto& o : observations) {
    const std::string name = name_of(o);
    std::size_t date = 0;
    while (date + 10 <= name.size() && !twin::to_time(std::string_view(name).substr(date, 10))) ++date;
    if (date + 10 > name.size()) return {};
    const std::string before = name.substr(0, name.find_last_not_of("_-. ", date ? date - 1 : 0) + 1);
    if (before.empty() || (!common.empty() && before != common) || date == 0) return {};
    common = before;
  }
  return common;
}

class Writer {
 public:
  Writer(const DiagnosisData& d, const ReportOptions& options)
      : d_(d), h_(d.healthy), options_(options), page_(title(), options.figure_files) {}

  Result<Report> write() {
    head();
    double share = 0;
    for (const auto part : {&Writer::latest_curve, &Writer::over_dates, &Writer::over_time, &Writer::regions_shown}) {
      if (auto ok = (this->*part)(); !ok) return tl::unexpected(ok.error());
      if (options_.progress) options_.progress(share += 0.25);
    }
    appendix();
    origin();
    return page_.report(d_.missing);
  }

 private:
  std::string title() const {
    const std::string joint = d_.healthy.joint.empty() ? common_name(d_.checked) : d_.healthy.joint;
    return fmt::format("Diagnosis{}", joint.empty() ? "" : " of " + joint);
  }

  std::size_t anomalous() const {
    return static_cast<std::size_t>(std::ranges::count_if(d_.verdicts, &Verdict::anomalous));
  }

  std::string verdict() const {
    const auto& last = d_.verdicts.back();
    const std::size_t sure = anomalous() - by_chance();
    if (anomalous() == 0)
      return d_.verdicts.size() == 1 ? std::string("The curve is that of a healthy joint.")
                                     : fmt::format("All {} curves are those of a healthy joint.", d_.verdicts.size());
    const bool one = d_.verdicts.size() == 1;
    if (one && last.perhaps_healthy)
      return fmt::format(
          "The curve is beyond the limits of a healthy joint; chance is the likeliest cause "
          "(probability {}).",
          probability_text(last.confidence));
    if (sure == 0 && !beyond_chance())
      return fmt::format("{} of {} curves {} beyond the limits of a healthy joint, which may be chance.", anomalous(),
                         d_.verdicts.size(), anomalous() == 1 ? "is" : "are");
    if (sure == 0)
      return fmt::format(
          "{} of {} curves are beyond the limits of a healthy joint, too many for chance, and like no "
          "known cause.",
          anomalous(), d_.verdicts.size());
    std::string now = ", but the latest is.";
    if (last.anomalous && last.cause)
      now = fmt::format("; {} looks like {}.", one ? "it" : "the latest", cause_text(last));
    else if (last.perhaps_healthy)
      now = beyond_chance() ? fmt::format("; the latest is one of {} more, too many for chance.", by_chance())
                            : "; the latest may be beyond the limits by chance.";
    else if (last.anomalous)
      now = fmt::format("; no known cause changes friction like {}.", one ? "it" : "the latest");
    if (one) return "The curve is not that of a healthy joint" + now;
    return fmt::format("{} of {} curves {} of a healthy joint{}", sure, d_.verdicts.size(),
                       sure == 1 ? "is not that" : "are not those", now);
  }

  /// Curves beyond a limit of which each alone is likelier so by chance than by a known cause.
  std::size_t by_chance() const {
    return static_cast<std::size_t>(std::ranges::count_if(d_.verdicts, &Verdict::perhaps_healthy));
  }

  /// Whether these are too many: chance has a healthy curve beyond the limit of either region at the rate that was
  /// asked for, and so many of all curves with a probability below 1 % (binomial).
  bool beyond_chance() const {
    const double each = 1 - std::pow(1 - d_.options.check.false_alarm, 2), n = static_cast<double>(d_.verdicts.size());
    double fewer = 0, term = std::pow(1 - each, n);
    for (std::size_t k = 0; k < by_chance(); ++k) {
      fewer += term;
      term *= (n - static_cast<double>(k)) / static_cast<double>(k + 1) * each / (1 - each);
    }
    return by_chance() > 1 && 1 - fewer < 0.01;
  }

  Opening opening() const {
    const auto& last = d_.verdicts.back();
    const bool now = last.anomalous && (!last.perhaps_healthy || beyond_chance()), before = anomalous() > 0;
    Opening o{
        .verdict = verdict(),
        .light = now      ? Light::red
                 : before ? Light::amber
                          : Light::green,
        .rule =
            "red when the latest curve is not that of a healthy joint, or is one of too many beyond a limit for chance "
            "(1 %); amber when an earlier one is not, or chance may explain the latest.",
        .tiles = {},
        .action = last.cause             ? std::string(last.cause->advice) + "."
                  : now                  ? "measure again, cold and hot: the cause is not known."
                  : last.perhaps_healthy ? "measure again; go on as before if that curve is healthy."
                                         : "nothing; measure again at the next date.",
        .identity = identity_of(options_, h_.joint, d_.days.empty() ? "" : date_text(std::ranges::max(d_.days)))};
    o.tiles.push_back(
        {"anomalous", fmt::format("{} of {}", anomalous(), d_.verdicts.size()), "curves", before ? "bad" : "good"});
    add_friction(o.tiles);
    o.tiles.push_back(
        {"equivalent load, latest", fmt::format("{} ± {} %", percent(last.load.load_norm), percent(last.load.sigma)),
         fmt::format("of the maximum torque{}, one sigma: the extra load that would raise friction as much",
                     h_.torque_max_nm > 0 ? " (" + load_text(h_, last.load.load_norm) + ")" : "")});
    o.tiles.push_back(margin_tile());
    return o;
  }

  bool follows_line() const { return d_.trend && d_.trend->straight; }

  /// What is left to the wear threshold, or how far it is exceeded: by the trend where there is a straight one.
  Tile margin_tile() const {
    const EquivalentLoad& last = d_.verdicts.back().load;
    const Interval left = follows_line() ? d_.trend->load_norm : left_to_wear(last);
    const auto [low, high] = left.value > 0 ? std::pair{left.low, left.high} : std::pair{-left.high, -left.low};
    return {left.value > 0 ? "left to the wear threshold" : "beyond the wear threshold",
            percent(std::abs(left.value)) + " %",
            fmt::format("by {}; 95 %: {} … {} %; the threshold is {} %",
                        follows_line() ? "a straight line" : "the latest curve", percent(low), percent(high),
                        percent(last.threshold))};
  }

  /// Friction of the latest curve against that of a healthy joint at the same temperature and speeds.
  void add_friction(std::vector<Tile>& tiles) const {
    const auto& levels = d_.latest;
    if (levels.speed_rad_s.empty()) return;
    double measured = 0;
    for (const double nm : levels.friction_nm) measured += nm;
    const Healthy sum = healthy(h_, d_.checked.back(), [&](const Features& f) {
      double all = 0;
      for (const double v : levels.speed_rad_s) all += friction_nm(f, v);
      return all;
    });
    tiles.push_back(
        {"friction, latest", fmt::format("{:+.1f} %", 100 * (measured / sum.value - 1)),
         fmt::format("against a healthy joint at this temperature; 95 % of healthy curves lie within ± {:.1f} %",
                     100 * sum.half_width / sum.value)});
  }

  std::string sentence(std::size_t i) const {
    const Observation& o = d_.checked[i];
    const bool one_of_several = std::ranges::count(d_.checked, o.file, &Observation::file) > 1;
    return plain_sentence(
        h_, o, d_.verdicts[i],
        fmt::format("{}. {}{}{}", i + 1, name_of(o), one_of_several ? fmt::format(", curve {}", o.curve) : "",
                    o.temperature_degC ? fmt::format(", {:.1f} °C", *o.temperature_degC) : ""));
  }

  void head() {
    auto to = page_.body();
    page_.add(to, "h1", title());
    page_.open(opening());
    page_.add(to, "p",
              fmt::format("Compared with {} unloaded curves of the healthy joint{}; {:.3g} % of healthy curves may be "
                          "called anomalous by their contact surfaces, as many by their lubricant.",
                          h_.observations,
                          h_.knows_temperature
                              ? fmt::format(", {:.0f} to {:.0f} °C", h_.temperature_low_degC, h_.temperature_high_degC)
                              : "",
                          100 * d_.options.check.false_alarm),
              "soft");
    if (!d_.missing.empty()) {
      auto box = page_.add(to, "div", {}, "notice");
      for (const auto& what : d_.missing) page_.add(box, "p", what);
    }
    page_.add(to, "h2", "Verdicts");
    for (std::size_t i = 0; i < d_.verdicts.size(); ++i)
      if (d_.verdicts[i].anomalous) page_.add(to, "p", sentence(i));
    if (const std::size_t others = d_.verdicts.size() - anomalous(); anomalous() > 0 && others > 0)
      page_.add(to, "p",
                others == 1 ? std::string("The other curve is that of a healthy joint.")
                            : fmt::format("The other {} curves are those of a healthy joint.", others),
                "soft");
    std::vector<std::vector<std::string>> rows;
    for (std::size_t i = 0; i < d_.verdicts.size(); ++i) {
      const auto& v = d_.verdicts[i];
      rows.push_back({fmt::format("{}", i + 1), temperature_of(d_.checked[i]), state(v.region[0].anomalous),
                      state(v.region[1].anomalous), v.anomalous ? in_words(v.pattern) : "none",
                      probability_text(v.confidence)});
      if (!d_.days.empty()) rows.back().insert(rows.back().begin() + 1, date_text(d_.days[i]));
    }
    std::vector<std::string> columns{"curve", "°C", "contact surfaces", "lubricant", "cause", "confidence"};
    if (!d_.days.empty()) columns.insert(columns.begin() + 1, "date");
    page_.add_table(to, columns, rows);
    evidence(to);
  }

  static std::string temperature_of(const Observation& o) {
    return o.temperature_degC ? fmt::format("{:.1f}", *o.temperature_degC) : "–";
  }
  static std::string state(bool anomalous) { return anomalous ? "anomalous" : "healthy"; }

  /// The latest curve over those of a healthy joint at its temperature.
  Outcome latest_curve() {
    const auto& levels = d_.latest;
    if (levels.speed_rad_s.empty()) return {};
    const Observation& o = d_.checked.back();
    std::vector<double> speed;
    std::vector<Healthy> band_of;
    for (std::size_t i = 0; i <= curve_points; ++i) {
      const double v = 1.05 * std::ranges::max(levels.speed_rad_s) * static_cast<double>(i) / curve_points;
      speed.push_back(v);
      band_of.push_back(healthy(h_, o, [v](const Features& f) { return friction_nm(f, v); }));
    }
    Figure f{.title = "Latest curve and healthy friction",
             .x = {.quantity = "motor speed", .symbol = "{/:Italic v}", .unit = "rad/s", .from = 0},
             .y = {.quantity = "friction", .unit = "Nm"}};
    Series band{.mark = Mark::area, .label = "healthy, 95 %", .stroke = 0};
    Series middle{.label = "healthy", .x = speed, .stroke = 0};
    for (std::size_t i = 0; i < speed.size(); ++i) {
      middle.y.push_back(band_of[i].value);
      band.x.push_back(speed[i]);
      band.y.push_back(band_of[i].value + band_of[i].half_width);
    }
    for (std::size_t i = speed.size(); i-- > 0;) {
      band.x.push_back(speed[i]);
      band.y.push_back(band_of[i].value - band_of[i].half_width);
    }
    f.series.push_back(std::move(band));
    f.series.push_back(std::move(middle));
    f.series.push_back({.mark = Mark::error_bars,
                        .label = "measured",
                        .x = levels.speed_rad_s,
                        .y = levels.friction_nm,
                        .error = levels.error_nm,
                        .stroke = 1});
    page_.add(page_.body(), "h2", "The latest curve");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    return page_.show(
        grid, f, "latest_curve",
        fmt::format("Measured levels of curve {}{}, and where 95 % of the curves of a healthy joint "
                    "lie at that temperature.",
                    d_.checked.size(), o.temperature_degC ? fmt::format(" at {:.1f} °C", *o.temperature_degC) : ""));
  }

  /// What the latest observation has of its cause, and what it lacks.
  void evidence(pugi::xml_node to) {
    const Observation& o = d_.checked.back();
    const Verdict& v = d_.verdicts.back();
    if (!v.anomalous) return;
    page_.add(to, "h2", "The cause");
    const Features expected = v.cause ? v.cause->footprint(h_, v.severity).features : Features::Zero().eval();
    const Features found = h_.deviation(o), sigma = healthy_covariance(h_, o).diagonal().cwiseSqrt();
    std::vector<std::string> pro, contra;
    std::vector<std::vector<std::string>> rows;
    for (Eigen::Index i = 0; i < feature_count; ++i) {
      const std::string name(feature_words[static_cast<std::size_t>(i)]);
      const double reach = two_sided_95 * sigma[i];
      const bool changed = std::abs(found[i]) > reach, agrees = std::abs(found[i] - expected[i]) <= reach;
      if (v.cause && (changed || !agrees)) (agrees ? pro : contra).push_back(name);
      rows.push_back({name, change_of(i, found[i]), "± " + change_of(i, reach).substr(1),
                      v.cause ? change_of(i, expected[i]) : "–",
                      !v.cause  ? (changed ? "changed" : "unchanged")
                      : !agrees ? "against"
                      : changed ? "for"
                                : "no change, as expected"});
    }
    if (v.cause)
      page_.add(
          to, "p",
          fmt::format("It looks like {}. For it: {}. Against it: {}.", cause_text(v), listed(pro), listed(contra)));
    else
      page_.add(to, "p", cause_sentence(v));
    page_.add(to, "p", "Next test: " + next_test(v, sigma));
    page_.add_table(to, {"of the latest curve", "change", "healthy curves, 95 %", "expected of this cause", "evidence"},
                    rows);
    other_causes(to, v);
  }

  /// Relative to a healthy joint at this temperature; of the exponent the difference.
  static std::string change_of(Eigen::Index feature, double logarithm) {
    return feature + 1 < feature_count ? fmt::format("{:+.1f} %", 100 * std::expm1(logarithm))
                                       : fmt::format("{:+.3f}", logarithm);
  }

  static std::string listed(const std::vector<std::string>& all) { return all.empty() ? "nothing" : twin::joined(all); }

  /// What tells the two likeliest causes from each other.
  std::string next_test(const Verdict& v, const Features& sigma) const {
    const std::string again = "measure the friction curve again, at the same temperature and without payload";
    if (v.candidates.size() < 2 || !v.cause || !(v.candidates[1].probability > 0.01) || !v.candidates[1].pattern)
      return again + "; repeat it after the maintenance.";
    const Candidate& second = v.candidates[1];
    const Features differ =
        (second.pattern->footprint(h_, second.severity).features - v.cause->footprint(h_, v.severity).features)
            .cwiseAbs()
            .cwiseQuotient(sigma);
    Eigen::Index which = 0;
    if (differ.maxCoeff(&which) < 1)
      return fmt::format("{}. Friction curves alone cannot distinguish it from {}.", again, second.pattern->meaning);
    const double slow = 3 * h_.mean(2);
    return fmt::format(
        "{}, with more levels {} {:.3g} rad/s (motor side): {} distinguishes it from {} (probability {}).", again,
        which < 3 ? "below" : "above", slow, feature_words[static_cast<std::size_t>(which)], second.pattern->meaning,
        probability_text(second.probability));
  }

  void other_causes(pugi::xml_node to, const Verdict& v) {
    std::vector<std::vector<std::string>> rows;
    for (const auto& c : v.candidates)
      if (c.pattern && c.pattern != v.cause && c.probability >= 0.01)
        rows.push_back(
            {std::string(c.pattern->meaning), probability_text(c.probability), severity_text(*c.pattern, c.severity)});
    if (!rows.empty()) page_.add_table(to, {"other causes", "probability", "how much"}, rows);
  }

  /// When the wear threshold is reached, or was.
  std::string trend_text(const Margin& m) const {
    const double threshold = d_.verdicts.back().load.threshold;
    const auto date = [&](double days) { return date_text(d_.days.back() + days); };
    if (!m.straight)
      return fmt::format(
          "The wear threshold is {}. The equivalent loads do not follow a straight line, so no date is "
          "given.",
          m.load_norm.value <= 0 ? "exceeded" : "not reached");
    if (m.load_norm.value <= 0) {
      const double since = (threshold - m.line[0]) / m.line[1];
      return m.line[1] > 0 && since > 0
                 ? fmt::format(
                       "The wear threshold has been exceeded since about {}, by a straight line through the "
                       "equivalent loads.",
                       date_text(d_.days.front() + since))
                 : std::string("The wear threshold has been exceeded since the first curve.");
    }
    if (!m.observations) return "The equivalent load does not rise.";
    return fmt::format("At this rate the wear threshold is reached about {} (95 %: {} … {}).", date(*m.observations),
                       date(m.earliest.value_or(0)),
                       m.latest ? date(*m.latest) : std::string("never, as the rise may be chance"));
  }

  /// The equivalent load over the dates of the curves, and when it reaches the wear threshold.
  Outcome over_dates() {
    const auto& m = d_.trend;
    if (!m) return {};
    page_.add(page_.body(), "h2", "Trend");
    const double first = d_.days.front(), last = d_.days.back() - first;
    const double end = last + std::min(last, m->observations.value_or(last));
    const double threshold = 100 * d_.verdicts.back().load.threshold;
    Figure f{.title = "Equivalent load over dates",
             .x = {.quantity = "days since " + date_text(first), .unit = "d"},
             .y = {.quantity = "equivalent load", .unit = "%"}};
    const auto loads = [&](double x) {
      const Interval of_line = m->at(x);
      return Interval{100 * of_line.value, 100 * of_line.low, 100 * of_line.high};
    };
    Series band{.mark = Mark::area, .label = "line, 95 %", .stroke = 0},
        line{.label = "straight line", .x = {0, end}, .y = {loads(0).value, loads(end).value}, .stroke = 0},
        points{.mark = Mark::error_bars, .label = "measured, 95 %", .stroke = 1};
    for (int i = 0; i <= 50; ++i) band.x.push_back(end * i / 50), band.y.push_back(loads(end * i / 50).high);
    for (int i = 50; i >= 0; --i) band.x.push_back(end * i / 50), band.y.push_back(loads(end * i / 50).low);
    for (std::size_t i = 0; i < d_.days.size(); ++i) {
      points.x.push_back(d_.days[i] - first);
      points.y.push_back(100 * d_.verdicts[i].load.load_norm);
      points.error.push_back(100 * two_sided_95 * d_.verdicts[i].load.sigma);
    }
    f.series = {
        std::move(band),
        std::move(line),
        std::move(points),
        {.mark = Mark::reference, .label = "wear threshold", .x = {0, end}, .y = {threshold, threshold}, .stroke = 5}};
    page_.add(page_.body(), "p", trend_text(*m));
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    return page_.show(grid, f, "trend",
                      "The extra load that would change friction of the contact surfaces as much, in % of the maximum "
                      "torque, with the straight line through all curves.");
  }

  /// In the words of Zhou 2024.
  void appendix() {
    auto to = page_.add_details(page_.body(), "Terms, distances and statistics, as in Zhou 2024");
    page_.add_table(to, {"term", "meaning"}, terms());
    const auto yes = [](bool b) { return b ? "yes" : "no"; };
    std::vector<std::vector<std::string>> rows;
    for (std::size_t i = 0; i < d_.verdicts.size(); ++i) {
      const auto& v = d_.verdicts[i];
      const auto& o = d_.checked[i];
      std::vector<std::string> row{fmt::format("{}", i + 1), temperature_of(o)};
      for (const auto& r : v.region)
        row.insert(row.end(),
                   {fmt::format("{:.3f}", r.distance), fmt::format("{:.2f}", r.statistic), yes(r.anomalous)});
      row.insert(row.end(), {fmt::format("{:.3f}", v.load.load_norm), std::string(v.pattern),
                             fmt::format("{:.2f}", v.confidence)});
      rows.push_back(std::move(row));
    }
    page_.add_table(to,
                    {"curve", "°C", "distance 1", "T² 1", "anomalous 1", "distance 2", "T² 2", "anomalous 2",
                     "equiv. load", "pattern", "confidence"},
                    rows);
  }

  std::vector<std::vector<std::string>> terms() const {
    const auto& limit = d_.verdicts.front().region;
    return {
        {"region 1", "contact surfaces: Fc, Fs, Vs"},
        {"region 2", "lubricant: Fv, beta"},
        {"distance", fmt::format("squared, Zhou 2024 (15), over all temperatures; its thresholds are {:g} and, for "
                                 "wear, {:g}",
                                 h_.anomalous_distance, h_.wear_distance)},
        {"T²", fmt::format("squared distance of the logarithms of the features from those of a healthy joint at this "
                           "temperature; anomalous beyond {:.2f} in region 1, {:.2f} in region 2",
                           limit[0].limit, limit[1].limit)},
        {"times as far from healthy", "the root of T² over its limit"},
        {"equivalent load", "the extra load that would change Fc, Fs and Vs as much, over the maximum torque"},
        {"wear threshold", "the equivalent load at which the distance in region 1 reaches that of wear"},
        {"by a straight line",
         "where the dates' equivalent loads scatter about a straight line as little as their "
         "sigmas say (chi-squared, 1 % of straight trends are refused); else by the latest curve"},
        {"CUSUM", "small changes that last, added up: of each curve the normal score of its T², less a half"}};
  }

  Outcome regions_shown() {
    FeatureRegions shown{.mean = h_.mean,
                         .covariance = h_.covariance,
                         .anomalous_distance = h_.anomalous_distance,
                         .wear_distance = h_.wear_distance,
                         .learned = {},
                         .checked = {}};
    for (const auto& o : d_.learned) shown.learned.push_back(o.features);
    for (std::size_t i = 0; i < d_.checked.size(); ++i)
      shown.checked.push_back(
          {d_.checked[i].features, {d_.verdicts[i].region[0].anomalous, d_.verdicts[i].region[1].anomalous}});
    return show_regions(page_, page_.add_details(page_.body(), "Confidence regions, as in Zhou 2024"), shown);
  }

  Outcome over_time() {
    if (d_.checked.size() < 3) return {};
    page_.add(page_.body(), "h2", "Small changes that last");
    const Watch& w = d_.watch;
    Figure f{.title = "Small changes, added up",
             .x = {.quantity = "curve", .whole = true},
             .y = {.quantity = "sum of changes", .from = 0}};
    for (std::size_t r = 0; r < regions.size(); ++r) {
      Series s{.label = std::string(regions[r].of), .stroke = r};
      for (std::size_t i = 0; i < w.steps.size(); ++i)
        s.x.push_back(static_cast<double>(i + 1)), s.y.push_back(w.steps[i].region[r].sum);
      f.series.push_back(std::move(s));
    }
    f.series.push_back({.mark = Mark::reference,
                        .label = "alarm",
                        .x = {1, static_cast<double>(w.steps.size())},
                        .y = {w.threshold, w.threshold},
                        .stroke = 5});
    page_.add(page_.body(), "p",
              w.first_alarm ? fmt::format("Curve {} raises the first alarm.", *w.first_alarm + 1) : "No alarm.");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    return page_.show(
        grid, f, "cusum",
        fmt::format("Small lasting changes add up; curves are taken in the order given. Beyond the dashed line "
                    "({:.2f}) there is one false alarm in {:.0f} healthy curves.",
                    w.threshold, 1 / d_.options.watch_false_alarm));
  }

  void origin() {
    page_.add_origin(options_.command);
    page_.add(page_.add_details(page_.body(), fmt::format("{}, as it was read", d_.file.filename().string())), "pre",
              d_.text);
  }

  const DiagnosisData& d_;
  const HealthyState& h_;
  const ReportOptions& options_;
  IllustratedPage page_;
};

}  // namespace

Result<DiagnosisData> load_diagnosis(const std::filesystem::path& healthy,
                                     const std::vector<std::filesystem::path>& data, ObservationOptions read,
                                     const DiagnosisOptions& options) try {
  DiagnosisData d{.file = healthy, .healthy = twin::or_wrong_input(read_healthy(healthy)), .options = options};
  d.text = twin::or_throw(twin::read_text(healthy, "a file"));
  read.load_sensitivity = d.healthy.load_sensitivity;
  if (!(read.torque_max_nm > 0)) read.torque_max_nm = d.healthy.torque_max_nm;
  for (const auto& file : data) {
    auto seen = read_observations(file, read);
    if (!seen) return tl::unexpected(seen.error());
    auto verdicts = check(d.healthy, *seen, options.check);
    if (!verdicts) return tl::unexpected(verdicts.error());
    std::ranges::move(seen->observations, std::back_inserter(d.checked));
    std::ranges::move(*verdicts, std::back_inserter(d.verdicts));
  }
  load_latest(d, data.back(), read);
  add_trend(d);
  d.watch = watch(d.healthy, d.checked, options.watch_false_alarm);
  load_learned(d, read);
  return d;
} catch (const twin::InputError& e) {
  return tl::unexpected(std::string(e.what()));
}

Result<Report> make_diagnosis_report(const DiagnosisData& data, const ReportOptions& options) {
  return Writer(data, options).write();
}

}  // namespace tribotwin::render
