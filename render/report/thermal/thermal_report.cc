#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/report/thermal/thermal_report.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

using namespace twin::identification;
using Outcome = Result<void>;

constexpr std::size_t trace_points = 800, points_max = 80, files_shown = 3;
constexpr std::size_t recorded_stroke = 5;  ///< grey
// Errors, rms, that matter: shares of a joint's temperature range, and what changes friction by about 1 %.
constexpr double good_share = 0.05, bad_share = 0.25, good_K = 1;
// Of a day's temperatures within their band; they are warmer or colder together, so that single days have far fewer
// than 95 %.
constexpr double few_inside = 0.5;
constexpr double least_room_K = 1;  // above and below curves in a figure that their band would flatten

/// How well a joint's temperatures are predicted in all its sessions.
struct Agreement {
  std::string joint;
  double low_degC = std::numeric_limits<double>::infinity(), high_degC = -low_degC;
  double rms_K = 0, largest_K = 0, recorded_s = 0;
  double inside = std::nan("");  ///< of the temperatures after the first of each session; NaN without bands
  double half_width_K = 0;       ///< the largest
  bool surprises() const { return inside < few_inside; }
  double range_K() const { return high_degC - low_degC; }
  double share() const { return rms_K / range_K(); }
  Light light() const {
    if (rms_K <= good_K || (share() <= good_share && !surprises())) return Light::green;
    return share() <= bad_share ? Light::amber : Light::red;
  }
  bool operator<(const Agreement& other) const {
    return std::pair(light(), rms_K) < std::pair(other.light(), other.rms_K);
  }
};

Agreement agreement_of(const JointHeat& joint, const std::vector<PredictedSession>& predicted) {
  Agreement a{.joint = joint.name};
  double squares = 0, samples = 0, inside = 0, later = 0;
  for (std::size_t s = 0; s < predicted.size(); ++s) {
    const auto& session = joint.sessions[s];
    const auto [low, high] = std::ranges::minmax(session.temperature_degC);
    a.low_degC = std::min(a.low_degC, low), a.high_degC = std::max(a.high_degC, high);
    a.largest_K = std::max(a.largest_K, predicted[s].largest_K);
    const auto n = static_cast<double>(session.time_s.size());
    squares += predicted[s].rms_K * predicted[s].rms_K * n, samples += n;
    inside += predicted[s].inside * (n - 1), later += n - 1;
    for (const double half : predicted[s].half_width_K) a.half_width_K = std::max(a.half_width_K, half);
    a.recorded_s += session.time_s.back() - session.time_s.front();
  }
  a.rms_K = std::sqrt(squares / samples);
  if (!predicted.front().half_width_K.empty() && later > 0) a.inside = inside / later;
  return a;
}

/// "1.5 h", "49 min"
std::string duration(double seconds) {
  return seconds >= 5400 ? fmt::format("{:.3g} h", seconds / 3600) : fmt::format("{:.3g} min", seconds / 60);
}

/// What is far below any sensor's resolution is not spelt out.
std::string kelvins(double K) { return digits(std::max(K, 1e-3), 2) + " K"; }

/// Where the band of `predicted` is far wider than both curves, limits of the axis around these. Returns whether the
/// band leaves them.
bool set_limits(Axis& axis, const Trace& recorded, const Trace& predicted) {
  double low = std::numeric_limits<double>::infinity(), high = -low, widest_K = 0;
  for (const auto* values : {&recorded.values, &predicted.values})
    for (const double T : *values)
      if (std::isfinite(T)) low = std::min(low, T), high = std::max(high, T);
  for (const double half : predicted.half_width) widest_K = std::max(widest_K, std::isfinite(half) ? half : 0);
  const double room_K = std::max(high - low, least_room_K);
  if (widest_K <= room_K) return false;
  axis.from = low - room_K, axis.to = high + room_K;
  return true;
}

/// So many points that a line through them stays visible.
void thin(Trace& points) {
  const std::size_t n = points.values.size(), step = n / points_max + 1;
  for (std::size_t i = 0, k = 0; i < n; i += step, ++k)
    points.time_s[k] = points.time_s[i], points.values[k] = points.values[i];
  points.time_s.resize((n + step - 1) / step), points.values.resize(points.time_s.size());
}

class Writer {
 public:
  Writer(const ThermalData& data, const ReportOptions& options)
      : data_(data), options_(options), page_(title(), options.figure_files) {
    const auto& joints = data.recordings.joints;
    for (std::size_t k = 0; k < joints.size(); ++k) all_.push_back(agreement_of(joints[k], data.predicted[k]));
    worst_ = *std::max_element(all_.begin(), all_.end());
    for (const auto& row : data.parameters.rows)
      if (!row.identifiable) lacking_.push_back((row.joint == "all" ? "" : row.joint + ": ") + row.estimate.name);
  }

  Result<Report> write() {
    head();
    agreements();
    const std::size_t shown = std::min(data_.recordings.files.size(), files_shown);
    for (std::size_t f = 0; f < shown; ++f) {
      if (auto ok = recording(f); !ok) return tl::unexpected(ok.error());
      if (options_.progress) options_.progress(static_cast<double>(f + 1) / static_cast<double>(shown));
    }
    if (const auto more = data_.recordings.files.size() - shown; more > 0)
      page_.add(page_.body(), "p",
                fmt::format("{} more recording{}: in the table above, without figures.", more, more > 1 ? "s" : ""),
                "soft");
    parameters();
    origin();
    return page_.report(data_.recordings.notes);
  }

 private:
  std::string title() const { return data_.file.stem().string() + ": how joints warm up"; }
  std::string file_name(std::size_t f) const { return without_folder(data_.recordings.files[f]); }

  Light light() const { return worst_.light() == Light::green && !lacking_.empty() ? Light::amber : worst_.light(); }
  bool nothing_identified() const { return lacking_.size() == data_.parameters.rows.size(); }

  std::string identified_in_words() const {
    const std::size_t all = data_.parameters.rows.size();
    if (nothing_identified()) return fmt::format("None of the {} parameters is identified.", all);
    return lacking_.empty() ? fmt::format("All {} parameters are identified.", all)
                            : fmt::format("{} of {} parameters are identified.", all - lacking_.size(), all);
  }

  std::string verdict() const {
    return fmt::format(
        "{} Temperatures of {} are predicted within {} (root mean square); {} is worst, {} of its range.",
        identified_in_words(), recordings_in_words(), kelvins(std::ranges::max(all_, {}, &Agreement::rms_K).rms_K),
        worst_.joint, percent(worst_.share()));
  }

  /// What the verdict is too short for.
  std::string details() const {
    return fmt::format(
        "Predicted from the first temperature of each recording on; largest error {}. {} has a range of {} over {}.{}",
        kelvins(std::ranges::max(all_, {}, &Agreement::largest_K).largest_K), worst_.joint, kelvins(worst_.range_K()),
        duration(worst_.recorded_s), band_in_words());
  }

  std::string band_in_words() const {
    if (std::isnan(worst_.inside)) return {};
    const Agreement& least = std::ranges::min(all_, {}, &Agreement::inside);
    const std::string own = percent(worst_.inside), fewest = percent(least.inside);
    return fmt::format(" Of its temperatures {} lie within their 95 % band, at most ±{}{}.", own,
                       kelvins(worst_.half_width_K),
                       fewest == own ? "" : fmt::format("; of those of {}, the fewest, {}", least.joint, fewest));
  }

  std::string recordings_in_words() const {
    if (data_.seen == data_.recordings.files.size()) return "the recordings that the models are from";
    return data_.seen == 0 ? "recordings that the models have not seen"
                           : fmt::format("recordings, {} of which the models are from,", data_.seen);
  }

  std::string action() const {
    if (worst_.light() == Light::red)
      return fmt::format(
          "do not use the model of {}: look at its figure below for heat that is not in the recording, "
          "another ambient temperature, or a change of the robot.",
          worst_.joint);
    if (nothing_identified())
      return "do not predict other warm-ups with these models: record longer, from cold and with a rest in between; "
             "tribotwin thermal says what each parameter lacks.";
    if (!lacking_.empty())
      return "use the models for warm-ups as long and as hot as the recordings; for longer ones record longer, with "
             "a rest in between: tribotwin thermal says what each parameter lacks.";
    if (worst_.light() == Light::amber)
      return fmt::format("look at the figure of {} below before its model is used.", worst_.joint);
    return data_.seen > 0 ? "compare with a recording of another day: tribotwin-report thermal takes it as DATA."
                          : "nothing; the models may be used.";
  }

  void head() {
    auto to = page_.body();
    page_.add(to, "h1", title());
    const Agreement& hottest = std::ranges::max(all_, {}, &Agreement::high_degC);
    const Agreement& longest = std::ranges::max(all_, {}, &Agreement::recorded_s);
    std::vector<Tile> tiles{
        {"worst joint", kelvins(worst_.rms_K),
         fmt::format("root mean square of {}, {} of its range", worst_.joint, percent(worst_.share())),
         light() == Light::red     ? "bad"
         : light() == Light::amber ? "warn"
                                   : "good"},
        {"hottest joint", fmt::format("{:.1f} °C", hottest.high_degC), hottest.joint},
        {"recorded", duration(longest.recorded_s),
         fmt::format("{} joint{}, {} file{}", all_.size(), all_.size() > 1 ? "s" : "", data_.recordings.files.size(),
                     data_.recordings.files.size() > 1 ? "s" : "")},
        {"not identifiable", fmt::format("{} of {}", lacking_.size(), data_.parameters.rows.size()), "parameters",
         lacking_.empty() ? "good" : "warn"}};
    page_.open({.verdict = verdict(),
                .light = light(),
                .rule = fmt::format("red when a joint's error is above {:g} K and {:.0f} % of its temperature range, "
                                    "amber above {:g} K and {:.0f} %, above {:g} K with less than {:.0f} % of the "
                                    "temperatures within their band, or when a parameter is not identifiable.",
                                    good_K, 100 * bad_share, good_K, 100 * good_share, good_K, 100 * few_inside),
                .tiles = std::move(tiles),
                .action = action(),
                .identity = identity_of(options_, source_of("recording", data_.recordings.files))});
    page_.add(to, "p", details(), "soft");
  }

  void agreements() {
    page_.add(page_.body(), "h2", "Predicted and recorded");
    std::vector<std::vector<std::string>> rows;
    for (std::size_t k = 0; k < all_.size(); ++k)
      for (std::size_t s = 0; s < data_.predicted[k].size(); ++s) {
        const auto& session = data_.recordings.joints[k].sessions[s];
        const auto [low, high] = std::ranges::minmax(session.temperature_degC);
        const PredictedSession& p = data_.predicted[k][s];
        rows.push_back({all_[k].joint, file_name(session.file),
                        fmt::format("{:.1f} … {:.1f}", session.time_s.front() / 60, session.time_s.back() / 60),
                        fmt::format("{:.1f} … {:.1f}", low, high), fmt::format("{:.3f}", p.rms_K),
                        high > low ? percent(p.rms_K / (high - low)) : "–", fmt::format("{:.3f}", p.largest_K),
                        p.half_width_K.empty() ? "–" : digits(std::ranges::max(p.half_width_K), 3),
                        p.half_width_K.empty() ? "–" : percent(p.inside), fmt::format("{}", session.time_s.size())});
      }
    page_.add_table(page_.body(),
                    {"joint", "recording", "time [min]", "recorded [°C]", "error, RMS [K]", "of its range",
                     "largest [K]", "95 % band ± [K]", "inside", "samples"},
                    rows);
    page_.add(page_.body(), "p",
              "Each stretch without a gap begins at its first recorded temperature; all later ones are predicted from "
              "the heat alone. " +
                  meaning_of_band(),
              "soft");
  }

  std::string meaning_of_band() const {
    const auto& u = data_.parameters.surroundings;
    if (!u)
      return "There is no band: the models are of an earlier version, from torque alone, or from records that leave a "
             "number free, as power that never changes does.";
    return fmt::format(
        "The band, the widest of each stretch in the table, holds 95 % of the recorded temperatures of many days, far "
        "fewer or all of a single one. It counts the parameters, bodies too slow for the record, noise, how the first "
        "temperature is spread in the joint, and on days that the models have not seen surroundings that vary by "
        "{:.2g} K (standard deviation, from {}).",
        u->deviation_K,
        u->days > 1 ? fmt::format("the {} days of the models and {:g} supposed ones with {:g} K", u->days,
                                  Surroundings::supposed_days, Surroundings::supposed_K)
                    : "no measurement: one day shows none. Edit deviation_K in the file where you know it");
  }

  /// A quantity of a joint over the sessions of a file, with gaps between them.
  template <class Values>
  Trace trace(std::size_t joint, std::size_t file, const std::string& label, const Values& of) const {
    Trace t{.label = label, .time_s = {}, .values = {}};
    const auto& sessions = data_.recordings.joints[joint].sessions;
    for (std::size_t s = 0; s < sessions.size(); ++s) {
      if (sessions[s].file != file) continue;
      if (!t.time_s.empty()) t.time_s.push_back(sessions[s].time_s.front()), t.values.push_back(std::nan(""));
      const std::size_t n = sessions[s].time_s.size(), step = n / trace_points + 1;
      for (std::size_t i = 0; i < n; i += step) t.time_s.push_back(sessions[s].time_s[i]), t.values.push_back(of(s, i));
    }
    return t;
  }

  std::vector<std::size_t> joints_of(std::size_t file) const {
    std::vector<std::size_t> out;
    for (std::size_t k = 0; k < all_.size(); ++k)
      if (std::ranges::count(data_.recordings.joints[k].sessions, file, &HeatSession::file)) out.push_back(k);
    return out;
  }

  /// Traces of all joints of a file; each keeps its colour in all figures.
  template <class Values>
  std::vector<Trace> of_joints(std::size_t file, const Values& of) const {
    std::vector<Trace> out;
    for (const std::size_t k : joints_of(file)) {
      out.push_back(trace(k, file, all_[k].joint, [&](std::size_t s, std::size_t i) { return of(k, s, i); }));
      out.back().stroke = k;
    }
    return out;
  }

  Outcome temperatures(pugi::xml_node to, std::size_t file, std::size_t k) {
    const auto& sessions = data_.recordings.joints[k].sessions;
    Trace recorded = trace(k, file, "recorded", [&](auto s, auto i) { return sessions[s].temperature_degC[i]; }),
          predicted =
              trace(k, file, "predicted", [&](auto s, auto i) { return data_.predicted[k][s].temperature_degC[i]; });
    recorded.mark = Mark::points;
    thin(recorded);
    if (!data_.predicted[k].front().half_width_K.empty())
      predicted.half_width =
          trace(k, file, "", [&](auto s, auto i) { return data_.predicted[k][s].half_width_K[i]; }).values;
    predicted.stroke = k;
    recorded.stroke = k % theme::strokes == recorded_stroke ? 0 : recorded_stroke;
    Axis axis{.quantity = "temperature", .symbol = "{/:Italic T}", .unit = "°C"};
    const bool clipped = set_limits(axis, recorded, predicted);
    const auto& name = all_[k].joint;
    return page_.show(
        to, history(name, axis, std::vector{recorded, predicted}), "temperature_" + name,
        fmt::format(
            "{}: temperatures recorded in {}, and predicted from the first one{}{}.", name, file_name(file),
            predicted.half_width.empty() ? "" : " with the band of 95 %",
            clipped ? fmt::format("; the band, up to ±{}, leaves the figure", kelvins(all_[k].half_width_K)) : ""));
  }

  Outcome recording(std::size_t file) {
    page_.add(page_.body(), "h2", file_name(file));
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    for (const std::size_t k : joints_of(file))
      if (auto ok = temperatures(grid, file, k); !ok) return ok;
    const auto& joints = data_.recordings.joints;
    const auto errors = of_joints(file, [&](auto k, auto s, auto i) {
      return data_.predicted[k][s].temperature_degC[i] - joints[k].sessions[s].temperature_degC[i];
    });
    if (auto ok = page_.show(grid, history("Error", {.quantity = "error", .unit = "K"}, errors), "error",
                             fmt::format("Predicted minus recorded temperature, {}.", file_name(file)));
        !ok)
      return ok;
    const auto heat = of_joints(file, [&](auto k, auto s, auto i) { return joints[k].sessions[s].power_w[i]; });
    return page_.show(grid, history("Heat", {.quantity = "power", .symbol = "{/:Italic P}", .unit = "W"}, heat), "heat",
                      fmt::format("What heated the joints, mean between two samples, {}.", file_name(file)));
  }

  void parameters() {
    auto to = page_.body();
    page_.add(to, "h2", "Parameters");
    std::vector<std::vector<std::string>> rows;
    for (const auto& row : data_.parameters.rows) {
      const auto& e = row.estimate;
      const bool number = row.identifiable && !std::isnan(e.sigma);
      rows.push_back(
          {row.joint, e.name, row.identifiable ? digits(e.value, 4) : "–", number ? digits(e.sigma, 2) : "–", e.unit,
           row.identifiable ? "" : fmt::format("not identifiable; {} fits, as do others", digits(e.value, 2))});
    }
    page_.add_table(to, {"joint", "parameter", "value", "standard deviation", "unit", "remark"}, rows);
    page_.add(
        to, "p",
        "A joint is one warm body, R_th its steady rise per watt and kappa its time constant, or two with heat "
        "gains c1, c2 and time constants t1, t2. In a chain, gain is that of heat, t the time constant towards the "
        "surroundings at T_amb, and exchange the rate at which neighbours exchange heat.",
        "soft");
  }

  void origin() {
    page_.add_origin(options_.command);
    page_.add(page_.body(), "p", "The models are from " + twin::joined(names_of(data_.parameters.data)) + ".", "soft");
    page_.add(page_.add_details(page_.body(), data_.file.filename().string() + ", as it is"), "pre",
              without_folders(data_.text));
  }

  static std::vector<std::string> names_of(const std::vector<std::string>& files) {
    std::vector<std::string> names;
    for (const auto& file : files) names.push_back(without_folder(file));
    return names;
  }

  const ThermalData& data_;
  const ReportOptions& options_;
  IllustratedPage page_;
  std::vector<Agreement> all_;
  Agreement worst_;
  std::vector<std::string> lacking_;
};

/// Of the files that PARAMS names, where they are.
Result<std::vector<std::string>> found(const std::vector<std::string>& named, const std::filesystem::path& by) {
  std::vector<std::string> out;
  for (const auto& name : named) {
    const auto file = twin::named_file(name, by);
    if (!file)
      return tl::unexpected(
          Error(fmt::format("{}: data: {} is neither in the working directory nor beside it; name "
                            "recordings to compare with after it",
                            by.string(), name)));
    out.push_back(file->string());
  }
  return out;
}

}  // namespace

Result<ThermalData> load_thermal(const std::filesystem::path& parameters, std::vector<std::string> data,
                                 std::span<const double> cycle_s, const twin::TableOptions& tables) {
  auto read = read_thermal_parameters(parameters);
  if (!read) return tl::unexpected(read.error());
  ThermalData out{.file = parameters, .text = twin::read_text(parameters, "a file").value_or("")};
  out.parameters = std::move(*read);
  if (data.empty()) {
    auto own = found(out.parameters.data, parameters);
    if (!own) return tl::unexpected(own.error());
    data = std::move(*own);
  }
  auto recordings = read_thermal_recordings(data, cycle_s, tables);
  if (!recordings) return tl::unexpected(recordings.error());
  out.recordings = std::move(*recordings);
  const auto seen = of_the_fit(data, out.parameters.data, parameters);
  out.seen = static_cast<std::size_t>(std::ranges::count(seen, true));
  auto predicted = predict_temperatures(parameters, out.recordings);
  if (!predicted) return tl::unexpected(predicted.error());
  out.predicted = std::move(*predicted);
  return out;
}

Result<Report> make_thermal_report(const ThermalData& data, const ReportOptions& options) {
  return Writer(data, options).write();
}

}  // namespace tribotwin::render
