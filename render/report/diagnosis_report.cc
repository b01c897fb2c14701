#include <algorithm>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/render/report/diagnosis_report.hpp>
#include <tribotwin/render/report/feature_regions.hpp>
#include <tribotwin/render/report/fit_data.hpp>
#include <tribotwin/twin/diagnosis/healthy_file.hpp>
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

class Writer {
 public:
  Writer(const DiagnosisData& d, const ReportOptions& options)
      : d_(d), h_(d.healthy), options_(options), page_(title(), options.figure_files) {}

  Result<Report> write() {
    head();
    table();
    double share = 0;
    for (const auto part : {&Writer::regions_shown, &Writer::over_time}) {
      if (auto ok = (this->*part)(); !ok) return tl::unexpected(ok.error());
      if (options_.progress) options_.progress(share += 0.5);
    }
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

  void head() {
    auto to = page_.body();
    page_.add(to, "h1", title());
    page_.add(to, "p",
              fmt::format("Compared with a healthy state of {} unloaded curves{}; {:.3g} % of healthy observations may "
                          "be called anomalous in each region.",
                          h_.observations,
                          h_.knows_temperature
                              ? fmt::format(", {:.0f} to {:.0f} °C", h_.temperature_low_degC, h_.temperature_high_degC)
                              : "",
                          100 * d_.options.check.false_alarm),
              "soft");
    page_.add(to, "p",
              anomalous() == 0 ? fmt::format("All {} observations are those of a healthy joint.", d_.verdicts.size())
                               : fmt::format("{} of {} observations are not those of a healthy joint.", anomalous(),
                                             d_.verdicts.size()),
              "verdict");
    if (!d_.missing.empty()) {
      auto box = page_.add(to, "div", {}, "notice");
      for (const auto& what : d_.missing) page_.add(box, "p", what);
    }
    auto tiles = page_.add(to, "div", {}, "tiles");
    page_.tile(tiles, "anomalous", fmt::format("{} of {}", anomalous(), d_.verdicts.size()), "observations",
               anomalous() ? "bad" : "good");
    const auto& last = d_.verdicts.back();
    page_.tile(tiles, "latest", std::string(last.pattern), fmt::format("confidence {:.0f} %", 100 * last.confidence),
               last.anomalous ? "bad" : "good");
    page_.tile(tiles, "equivalent load, latest", fmt::format("{:.3f} ± {:.3f}", last.load.load_norm, last.load.sigma),
               "of the maximum torque");
    page_.tile(tiles, "wear threshold", fmt::format("{:.3f}", last.load.threshold), "in equivalent load");
    page_.add(to, "h2", "Verdicts");
    for (std::size_t i = 0; i < d_.verdicts.size(); ++i)
      if (d_.verdicts[i].anomalous) page_.add(to, "p", fmt::format("{}. {}", i + 1, d_.verdicts[i].sentence));
    if (anomalous() < d_.verdicts.size())
      page_.add(to, "p",
                fmt::format("{} observation(s): contact surfaces and lubricant are healthy.",
                            d_.verdicts.size() - anomalous()),
                "soft");
  }

  void table() {
    auto to = page_.body();
    page_.add(to, "h2", "Distances");
    const auto yes = [](bool b) { return b ? "True" : "False"; };
    std::vector<std::vector<std::string>> rows;
    for (std::size_t i = 0; i < d_.verdicts.size(); ++i) {
      const auto& v = d_.verdicts[i];
      const auto& o = d_.checked[i];
      std::vector<std::string> row{fmt::format("{}", i + 1),
                                   o.temperature_degC ? fmt::format("{:.1f}", *o.temperature_degC) : "–"};
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
