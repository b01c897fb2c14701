#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/render/report/diagnosis_report.hpp>
#include <tribotwin/render/report/feature_regions.hpp>
#include <tribotwin/render/report/fit_data.hpp>
#include <tribotwin/twin/diagnosis/healthy_file.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

using namespace twin::diagnosis;
using Outcome = Result<void>;

/// Reads the curves that the state was learned from; none where one of the files is missing.
void load_learned(DiagnosisData& d, const ObservationOptions& read) {
  for (const auto& name : d.healthy.data) {
    const auto file = named_file(name, d.file);
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
  return f[0] + (f[1] - f[0]) * std::exp(-std::pow(speed_rad_s / f[2], alpha)) + f[3] * std::pow(speed_rad_s, f[4]);
}

/// Features of their logarithms (beta is not one).
Features from_logarithms(const Features& y) {
  Features f;
  for (Eigen::Index i = 0; i < feature_count; ++i) f[i] = i + 1 < feature_count ? std::exp(y[i]) : y[i];
  return f;
}

/// Friction of a healthy joint over speed at the temperature of an observation, and the 95 % band of a new curve there.
struct HealthyCurve {
  std::vector<double> speed_rad_s, friction_nm, half_width_nm;
};

HealthyCurve healthy_curve(const HealthyState& h, const Observation& o, double speed_max_rad_s) {
  constexpr double two_sided_95 = 1.96;
  const Features expected = o.logarithmic() - h.deviation(o);
  const Eigen::VectorXd x = h.regressors(o.temperature_degC);
  const double factor =
      std::max(h.region[0].variance(x, h.scatter_of(o, 0)), h.region[1].variance(x, h.scatter_of(o, 1)));
  const FeatureMatrix covariance = factor * h.together;
  HealthyCurve c;
  for (std::size_t i = 0; i <= curve_points; ++i) {
    const double v = speed_max_rad_s * static_cast<double>(i) / static_cast<double>(curve_points);
    const double middle = friction_nm(from_logarithms(expected), v);
    Features slope;
    for (Eigen::Index k = 0; k < feature_count; ++k) {
      constexpr double step = 1e-5;
      Features moved = expected;
      moved[k] += step;
      slope[k] = (friction_nm(from_logarithms(moved), v) - middle) / step;
    }
    c.speed_rad_s.push_back(v);
    c.friction_nm.push_back(middle);
    c.half_width_nm.push_back(two_sided_95 * std::sqrt(std::max(0.0, slope.dot(covariance * slope))));
  }
  return c;
}

class Writer {
 public:
  Writer(const DiagnosisData& d, const ReportOptions& options)
      : d_(d), h_(d.healthy), options_(options), page_(title(), options.figure_files) {}

  Result<Report> write() {
    head();
    double share = 0;
    for (const auto part : {&Writer::latest_curve, &Writer::over_time, &Writer::regions_shown}) {
      if (auto ok = (this->*part)(); !ok) return tl::unexpected(ok.error());
      if (options_.progress) options_.progress(share += 1.0 / 3);
    }
    appendix();
    origin();
    return page_.report(d_.missing);
  }

 private:
  std::string title() const {
    return fmt::format("Diagnosis{}", d_.healthy.joint.empty() ? "" : " of " + d_.healthy.joint);
  }

  std::size_t anomalous() const {
    return static_cast<std::size_t>(std::ranges::count_if(d_.verdicts, &Verdict::anomalous));
  }

  Opening opening() const {
    const auto& last = d_.verdicts.back();
    const bool now = last.anomalous, before = anomalous() > 0;
    Opening o{
        .verdict =
            !before ? fmt::format("All {} observations are those of a healthy joint.", d_.verdicts.size())
                    : fmt::format(
                          "{} of {} observations are not those of a healthy joint{}.", anomalous(), d_.verdicts.size(),
                          now ? fmt::format("; the latest looks like {}", last.pattern) : ", but the latest is"),
        .light = now      ? Light::red
                 : before ? Light::amber
                          : Light::green,
        .rule = "red when the latest observation is not that of a healthy joint, amber when an earlier one is not.",
        .tiles = {},
        .action = last.cause ? std::string(last.cause->advice) + "."
                  : now      ? "measure again, cold and hot: the cause is not known."
                             : "nothing; measure again at the next date.",
        .identity = identity_of(options_, h_.joint)};
    o.tiles.push_back({"anomalous", fmt::format("{} of {}", anomalous(), d_.verdicts.size()), "observations",
                       before ? "bad" : "good"});
    o.tiles.push_back({"latest", std::string(last.pattern), fmt::format("confidence {:.0f} %", 100 * last.confidence),
                       now ? "bad" : "good"});
    o.tiles.push_back({"equivalent load, latest", fmt::format("{:.3f} ± {:.3f}", last.load.load_norm, last.load.sigma),
                       "of the maximum torque"});
    o.tiles.push_back({"wear threshold", fmt::format("{:.3f}", last.load.threshold), "in equivalent load"});
    return o;
  }

  void head() {
    auto to = page_.body();
    page_.add(to, "h1", title());
    page_.open(opening());
    page_.add(to, "p",
              fmt::format("Compared with a healthy state of {} unloaded curves{}; {:.3g} % of healthy observations may "
                          "be called anomalous in each region.",
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
      if (d_.verdicts[i].anomalous) page_.add(to, "p", fmt::format("{}. {}", i + 1, d_.verdicts[i].sentence));
    if (anomalous() < d_.verdicts.size())
      page_.add(to, "p",
                fmt::format("{} observation(s): contact surfaces and lubricant are healthy.",
                            d_.verdicts.size() - anomalous()),
                "soft");
    std::vector<std::vector<std::string>> rows;
    for (std::size_t i = 0; i < d_.verdicts.size(); ++i) {
      const auto& v = d_.verdicts[i];
      rows.push_back({fmt::format("{}", i + 1), temperature_of(d_.checked[i]), state(v.region[0].anomalous),
                      state(v.region[1].anomalous), std::string(v.pattern),
                      fmt::format("{:.0f} %", 100 * v.confidence)});
    }
    page_.add_table(to, {"", "°C", "contact surfaces", "lubricant", "cause", "confidence"}, rows);
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
    const HealthyCurve healthy = healthy_curve(h_, o, 1.05 * std::ranges::max(levels.speed_rad_s));
    Figure f{.title = "Latest curve and healthy friction",
             .x = {.quantity = "motor speed", .symbol = "{/:Italic v}", .unit = "rad/s", .from = 0},
             .y = {.quantity = "friction", .unit = "Nm"}};
    Series band{.mark = Mark::area, .label = "healthy, 95 %", .stroke = 0};
    for (std::size_t i = 0; i < healthy.speed_rad_s.size(); ++i) {
      band.x.push_back(healthy.speed_rad_s[i]);
      band.y.push_back(healthy.friction_nm[i] + healthy.half_width_nm[i]);
    }
    for (std::size_t i = healthy.speed_rad_s.size(); i-- > 0;) {
      band.x.push_back(healthy.speed_rad_s[i]);
      band.y.push_back(healthy.friction_nm[i] - healthy.half_width_nm[i]);
    }
    f.series.push_back(std::move(band));
    f.series.push_back({.label = "healthy", .x = healthy.speed_rad_s, .y = healthy.friction_nm, .stroke = 0});
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
        fmt::format("Measured levels of observation {}{}, and where 95 % of the curves of a healthy joint "
                    "lie at that temperature.",
                    d_.checked.size(), o.temperature_degC ? fmt::format(" at {:.1f} °C", *o.temperature_degC) : ""));
  }

  /// In the words of Zhou 2024.
  void appendix() {
    auto to = page_.add_details(page_.body(), "Distances and statistics, as in Zhou 2024");
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
                    {"", "°C", "distance 1", "T² 1", "anomalous 1", "distance 2", "T² 2", "anomalous 2", "equiv. load",
                     "pattern", "confidence"},
                    rows);
    page_.add(
        to, "p",
        fmt::format(
            "Region 1: contact surfaces (Fc, Fs, Vs); region 2: lubricant (Fv, beta). Distance: squared, Zhou 2024 "
            "(15), "
            "over all temperatures; its thresholds are {:g} and, for wear, {:g}. T²: of the logarithms of the features "
            "against those of a healthy joint at this temperature; an observation is anomalous beyond {:.2f} in region "
            "1, {:.2f} in region 2.",
            h_.anomalous_distance, h_.wear_distance, d_.verdicts.front().region[0].limit,
            d_.verdicts.front().region[1].limit),
        "soft");
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
    page_.add(page_.body(), "h2", "Confidence regions");
    return show_regions(page_, page_.body(), shown);
  }

  Outcome over_time() {
    if (d_.checked.size() < 3) return {};
    page_.add(page_.body(), "h2", "Over time");
    const Watch& w = d_.watch;
    Figure f{.title = "CUSUM", .x = {.quantity = "observation"}, .y = {.quantity = "CUSUM", .from = 0}};
    for (std::size_t r = 0; r < regions.size(); ++r) {
      Series s{.label = fmt::format("region {}: {}", r + 1, regions[r].of), .stroke = r};
      for (std::size_t i = 0; i < w.steps.size(); ++i)
        s.x.push_back(static_cast<double>(i + 1)), s.y.push_back(w.steps[i].region[r].sum);
      f.series.push_back(std::move(s));
    }
    f.series.push_back({.mark = Mark::reference,
                        .label = "alarm",
                        .x = {1, static_cast<double>(w.steps.size())},
                        .y = {w.threshold, w.threshold},
                        .stroke = 5});
    std::string said =
        w.first_alarm ? fmt::format("Observation {} raises the first alarm.", *w.first_alarm + 1) : "No alarm.";
    if (w.margin) {
      const auto& m = *w.margin;
      said += fmt::format(
          " Left to the wear threshold, by a straight line through the equivalent loads: {:.3f} (95 %: {:.3f} … "
          "{:.3f}) of the maximum torque",
          m.load_norm.value, m.load_norm.low, m.load_norm.high);
      said += m.observations
                  ? fmt::format("; at this rate {:.0f} more observations (95 %: {:.0f} … {}).", *m.observations,
                                m.earliest.value_or(0), m.latest ? fmt::format("{:.0f}", *m.latest) : "never")
                  : "; it does not shrink.";
    }
    page_.add(page_.body(), "p", said);
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    return page_.show(grid, f, "cusum",
                      fmt::format("Small lasting changes add up; observations are taken in the order given. Beyond the "
                                  "dashed line ({:.2f}) there is one false alarm in {:.0f} healthy observations.",
                                  w.threshold, 1 / d_.options.watch_false_alarm));
  }

  void origin() {
    auto to = page_.body();
    page_.add_origin(options_.command);
    page_.add(to, "p", fmt::format("{}, as it was read:", d_.file.filename().string()));
    page_.add(to, "pre", d_.text);
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
  d.text = twin::or_wrong_input(twin::read_text(healthy, "a file"));
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
