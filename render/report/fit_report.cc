#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/page/what_if.hpp>
#include <tribotwin/render/report/fit_report.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

using Outcome = Result<void>;
using twin::identification::ParameterFile, twin::identification::Status;

constexpr std::size_t curve_points = 300, tiles_min = 3, tiles_max = 5;

std::string significant(double v, int digits = 3) {
  return v == 0 ? "0" : typeset(fmt::format("{:#.{}g}", v, std::clamp(digits, 1, 9)));
}

/// v to the second digit of its sigma.
std::string significant(double v, double sigma) {
  const auto place = [](double x) { return static_cast<int>(std::floor(std::log10(std::abs(x)))); };
  return significant(v, v == 0 ? 1 : place(v) - place(sigma) + 2);
}

double quantile(std::vector<double> v, double share) {
  const auto at = v.begin() + std::lround(share * static_cast<double>(v.size() - 1));
  std::ranges::nth_element(v, at);
  return *at;
}

/// Residuals of other data than the identification's may be larger by this factor.
constexpr double misfit_max = 2;

/// The range of load or temperature in the data (of the law, where there are none).
struct Input {
  double low, high, window;    ///< a sample within `window` of a level is shown with the curves of that level
  std::vector<double> levels;  ///< at which the curves over the other input are drawn

  Input(const std::vector<double>& column, double law_low, double law_high) : low(law_low), high(law_high) {
    if (!column.empty()) low = std::ranges::min(column), high = std::ranges::max(column);
    window = 0.05 * (high - low) + 1e-6 * (1 + std::abs(high));
    levels = {column.empty() ? low : quantile(column, 0.1), column.empty() ? high : quantile(column, 0.9)};
    if (levels[1] - levels[0] <= 2 * window) levels = {levels[0]};
  }
  bool varies() const { return high > low; }
};

std::string level_text(const char* level_format, const char* window_format, double level, const Input& input) {
  return fmt::format(fmt::runtime(level_format), level) +
         (input.varies() ? fmt::format(fmt::runtime(window_format), input.window) : "");
}

double end_or(double end, double otherwise) { return std::abs(end) < friction::unlimited ? end : otherwise; }

class Writer {
 public:
  Writer(const FitData& fit, const ReportOptions& options)
      : fit_(fit),
        p_(fit.parameters),
        s_(fit.samples),
        law_(*fit.parameters.law.info),
        options_(options),
        page_(title(), options.figure_files),
        axes_(fit.drive),
        speed_max_((s_.size() ? std::ranges::max(s_.speed)
                              : end_or(p_.law.range.speed_max_rad_s, law_.side == friction::Side::motor ? 280 : 3)) /
                   fit.drive.speed_scale()),
        load_(s_.load, 0, end_or(p_.law.range.load_max, 0.8)),
        temperature_(s_.temperature_degC, end_or(p_.law.range.temperature_min_degC, 20),
                     end_or(p_.law.range.temperature_max_degC, 80)) {
    for (std::size_t i = 0; i < p_.found.parameters.size(); ++i)
      if (!std::isnan(p_.found.parameters[i].sigma)) known_.push_back(i);
  }

  Result<Report> write() {
    head();
    parameters();
    double share = 0;
    for (const auto part : {&Writer::curves, &Writer::what_if, &Writer::residuals, &Writer::correlations}) {
      if (auto ok = (this->*part)(); !ok) return tl::unexpected(ok.error());
      if (options_.progress) options_.progress(share += 1.0 / 4);
    }
    origin();
    return page_.report(std::move(notes_));
  }

 private:
  std::string title() const { return fmt::format("{}: friction law '{}'", fit_.file.stem().string(), law_.name); }
  std::string torque(double v) const {
    return fmt::format("{} {}", significant(v), law_.normalised ? "of the maximum torque" : "Nm");
  }
  bool has_samples() const { return s_.size() > 0; }
  static std::string drawn_of(std::size_t shown, std::size_t all) {
    return shown < all ? fmt::format("{} of the {} samples are drawn, chosen evenly", shown, all)
                       : fmt::format("{} samples", all);
  }
  std::vector<std::string> with_status(Status status) const {
    std::vector<std::string> names;
    for (const auto& e : p_.found.parameters)
      if (e.status == status) names.push_back(e.name);
    return names;
  }
  bool identifiable(const std::string& name) const {
    return std::ranges::find(p_.found.unidentifiable, name) == p_.found.unidentifiable.end();
  }
  std::size_t identified() const {
    return static_cast<std::size_t>(std::ranges::count_if(
        p_.found.parameters, [&](const auto& e) { return e.status == Status::estimated && identifiable(e.name); }));
  }

  /// Root mean square of the residuals of other data than the identification's; nothing where there are none.
  std::optional<double> other_residual() const {
    if (!has_samples() || fit_.own_data || !fit_.has_residual() || !(p_.found.residual.std > 0)) return std::nullopt;
    double squares = 0;
    for (const double r : fit_.residuals) squares += r * r;
    return std::sqrt(squares / static_cast<double>(fit_.residuals.size()));
  }
  bool worse_elsewhere() const { return other_residual().value_or(0) > misfit_max * p_.found.residual.std; }

  std::string other_verdict(double rms) const {
    const double times = rms / p_.found.residual.std;
    return fmt::format(
        "Law '{}' is off by {} (RMS) on data that it was not identified from, {} times its residual on its own.",
        law_.name, torque(rms), fmt::format("{:.{}f}", times, times < 10 ? 1 : 0));
  }

  /// What was identified, from what and how well.
  std::string verdict() const {
    if (const auto rms = other_residual()) return other_verdict(*rms);
    if (p_.found.samples == 0)
      return fmt::format("Law '{}' with given parameters: the file does not say how they were found.", law_.name);
    const std::string source = p_.data.size() == 1 ? " of " + std::filesystem::path(p_.data[0]).filename().string()
                               : p_.data.empty()   ? ""
                                                   : fmt::format(" of {} files", p_.data.size());
    const std::size_t all = p_.found.parameters.size();
    return fmt::format("{} {} parameters of law '{}' were identified from {} samples{}.",
                       identified() == all ? "All" : fmt::format("{} of the", identified()), all, law_.name,
                       p_.found.samples, source);
  }

  /// How well they fit, and what is not identifiable.
  std::string details() const {
    std::string s;
    if (fit_.has_residual())
      s += fmt::format(
          "{} residuals have a standard deviation of {}; the law explains {:.2f} % of the variance of friction.",
          other_residual() ? "On its own data the" : "The", torque(p_.found.residual.std), 100 * p_.found.r_squared);
    const auto say = [&](const std::vector<std::string>& names, const char* what) {
      if (!names.empty()) s += fmt::format(" {}: {}.", what, twin::joined(names));
    };
    say(p_.found.unidentifiable, "Not identifiable from these data");
    say(with_status(Status::fixed), "Given, not estimated");
    say(with_status(Status::at_bound), "At a bound of the accepted range");
    return s;
  }

  Opening opening() const {
    const auto bound = with_status(Status::at_bound), held = with_status(Status::held);
    const bool lacks = !p_.found.unidentifiable.empty() || !held.empty();
    return {.verdict = verdict(),
            .light = !bound.empty()               ? Light::red
                     : lacks || worse_elsewhere() ? Light::amber
                                                  : Light::green,
            .rule = fmt::format("green when every parameter is identified or given, amber when data do not identify "
                                "one{}, red when one is at a bound of its range.",
                                other_residual() ? fmt::format(" or the law is off by more than {:g} times its "
                                                               "residual on other data",
                                                               misfit_max)
                                                 : ""),
            .tiles = tiles(),
            .action = !bound.empty() ? "do not use " + twin::joined(bound) +
                                           ": measure at other speeds, loads or "
                                           "temperatures, or choose another law."
                      : worse_elsewhere()
                          ? "see the residuals: where their mean leaves 0, the law lacks an effect. Identify it "
                            "from these data, too, or use it where it was measured only."
                      : lacks ? "use the law where it was measured only; more speeds, loads or temperatures "
                                "identify the rest."
                              : "use the law within its range.",
            .identity = identity_of(options_, source_of("measurement", p_.data))};
  }

  std::string range_text() const {
    const auto& r = p_.law.range;
    std::string s = r.speed_max_rad_s < friction::unlimited ? fmt::format("Holds up to {:.4g} rad/s", r.speed_max_rad_s)
                                                            : "Holds at any speed";
    if (r.load_max < friction::unlimited && law_.load_dependent)
      s += fmt::format(", for loads up to {:.3g} of the maximum torque", r.load_max);
    if (r.temperature_max_degC < friction::unlimited && law_.temperature_dependent)
      s += fmt::format(", at {:.3g} to {:.3g} °C", r.temperature_min_degC, r.temperature_max_degC);
    return s + ".";
  }

  void head() {
    auto to = page_.body();
    page_.add(to, "h1", title());
    notes_ = fit_.missing;
    page_.open(opening());
    page_.add(to, "p", range_text(), "soft");
    page_.add(to, "p", details(), "soft");
    if (has_samples() && !fit_.own_data)
      notes_.push_back(fmt::format(
          "The data shown here are not those of the identification: {} samples, whose residuals have a standard "
          "deviation of {}.",
          s_.size(), torque(fit_.deviation)));
    if (!notes_.empty()) {
      auto box = page_.add(to, "div", {}, "notice");
      for (const auto& what : notes_) page_.add(box, "p", what);
    }
    std::vector<std::string> remarks = p_.found.notes;
    for (const auto& note : s_.notes)
      if (std::ranges::find(remarks, note) == remarks.end()) remarks.push_back(note);
    if (remarks.empty()) return;
    page_.add(to, "h3", "Remarks");
    for (const auto& note : remarks) page_.add(to, "p", note);
  }

  std::vector<Tile> tiles() const {
    std::vector<Tile> all;
    const char* unit = law_.normalised ? "of the maximum torque" : "Nm";
    if (const auto rms = other_residual())
      all.push_back({"residual of these data, RMS", significant(*rms), unit, worse_elsewhere() ? "warn" : "good"});
    if (fit_.has_residual()) {
      all.push_back({"residual, std", significant(p_.found.residual.std), unit});
      all.push_back({"maximum residual", significant(p_.found.residual.max_abs), unit});
      all.push_back({"explained", fmt::format("{:.2f} %", 100 * p_.found.r_squared), "of the variance of friction"});
    }
    const std::size_t known = identified() + with_status(Status::fixed).size();
    all.push_back({"parameters known", fmt::format("{} of {}", known, p_.found.parameters.size()), "",
                   known == p_.found.parameters.size() ? "good" : "bad"});
    if (const auto pairs = most_correlated(); !pairs.empty() && all.size() < tiles_max)
      all.push_back(
          {"strongest correlation", pair_name(pairs[0]), "correlation " + correlation(correlation_of(pairs[0]))});
    if (all.size() < tiles_min) add_range(all);
    return all;
  }

  /// Where the law holds.
  void add_range(std::vector<Tile>& all) const {
    const auto& r = p_.law.range;
    const char* of_law = "where the law holds";
    all.push_back(
        {law_.side == friction::Side::motor ? "motor speed" : "joint speed",
         r.speed_max_rad_s < friction::unlimited ? fmt::format("up to {:.4g} rad/s", r.speed_max_rad_s) : "any",
         of_law});
    all.push_back(
        {"load",
         law_.load_dependent && r.load_max < friction::unlimited ? fmt::format("up to {:.3g}", r.load_max) : "any",
         law_.load_dependent ? "of the maximum torque, where the law holds" : "without effect on friction"});
    all.push_back({"temperature",
                   law_.temperature_dependent && r.temperature_max_degC < friction::unlimited
                       ? fmt::format("{:.3g} to {:.3g} °C", r.temperature_min_degC, r.temperature_max_degC)
                       : "any",
                   law_.temperature_dependent ? of_law : "without effect on friction"});
  }

  const char* status_of(const twin::identification::Estimate& e) const {
    switch (e.status) {
      case Status::estimated:
        return identifiable(e.name) ? "estimated" : "estimated, but not identifiable";
      case Status::fixed:
        return p_.found.samples ? "given, not estimated" : "given";
      case Status::held:
        return "fixed: not identifiable";
      case Status::at_bound:
        return "at a bound of its range";
    }
    return "";
  }

  std::string meaning_of(std::size_t i) const {
    if (i < law_.parameters.size()) return std::string(law_.parameters[i].meaning);
    return p_.found.parameters[i].name == "offset" ? "torque against positive motion at every speed, without heat"
                                                   : "friction x (1 + asymmetry) with positive motion, x (1 - "
                                                     "asymmetry) with negative; figures show the law without";
  }

  void parameters() {
    auto to = page_.body();
    page_.add(to, "h2", "Parameters");
    std::vector<std::vector<std::string>> rows;
    for (std::size_t i = 0; i < p_.found.parameters.size(); ++i) {
      const auto& e = p_.found.parameters[i];
      const bool sure = e.sigma > 0;
      rows.push_back({e.name, sure ? significant(e.value, e.sigma) : typeset(fmt::format("{:.6g}", e.value)),
                      sure ? significant(e.sigma, 2) : "–",
                      sure && !std::isnan(e.low)
                          ? fmt::format("{} … {}", significant(e.low, e.sigma), significant(e.high, e.sigma))
                          : "–",
                      e.unit == "-"   ? "of τmax"
                      : e.unit == "1" ? "-"
                                      : e.unit,
                      status_of(e), meaning_of(i)});
    }
    page_.add_table(to, {"parameter", "value", "sigma", "95 % interval", "unit", "status", "meaning"}, rows);
    page_.add(to, "pre", fmt::format("{} = {}", law_.normalised ? "friction / τmax" : "friction [Nm]", law_.equation));
    page_.add(to, "p",
              fmt::format("{}v: {} speed [rad/s]{}{}. Sigma: one standard deviation.",
                          law_.normalised ? "τmax: maximum torque; " : "",
                          law_.side == friction::Side::motor ? "motor" : "joint",
                          law_.load_dependent ? "; l: load torque / maximum torque" : "",
                          law_.temperature_dependent ? "; T: lubricant temperature [°C]" : ""),
              "soft");
  }

  /// Shows the figure that `draw` makes of at most `curve_points` of the samples that are `near`.
  Outcome show_curves(pugi::xml_node to, const char* name, const std::string& where, auto near, auto draw) {
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < s_.size(); ++i)
      if (near(i)) rows.push_back(i);
    std::vector<std::size_t> some;
    for (const std::size_t k : thinned(rows.size(), curve_points)) some.push_back(rows[k]);
    const auto points = friction_points(fit_.drive, s_, some);
    return page_.show(
        to, draw("Friction" + where, points), name,
        fmt::format("Law '{}'{}.{}{}", law_.name, where, band_text(),
                    has_samples() ? fmt::format(" Points: {}.", drawn_of(points.size(), rows.size())) : ""));
  }

  const friction::Uncertainty* band() const { return uncertainty_ ? &*uncertainty_ : nullptr; }

  std::string band_text() const {
    if (uncertainty_) return " Bands: where the law is with 95 % confidence, by the covariance of its parameters.";
    return p_.found.samples ? " Without bands: not every parameter that was looked for has a sigma." : "";
  }

  Outcome curves() {
    page_.add(page_.body(), "h2", has_samples() ? "Curves over points" : "Curves");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    const bool thermal = law_.temperature_dependent, loaded = law_.load_dependent;
    if (!thermal && !loaded)
      return show_curves(
          grid, "curve", "", [](std::size_t) { return true; },
          [&](const std::string& title, const auto& points) {
            return friction_against_speed(fit_.drive, title, speed_max_, 0, points, band());
          });
    // Where load or temperature did not vary, curves over it would repeat the others.
    if (thermal && (temperature_.varies() || !loaded || !load_.varies()))
      for (const double load : loaded ? load_.levels : std::vector{0.0})
        if (auto ok = show_curves(
                grid, "temperature", loaded ? level_text(" at a load of {:.2f}", " ± {:.2f}", load, load_) : "",
                [&](std::size_t i) { return !loaded || std::abs(s_.load[i] - load) <= load_.window; },
                [&](const std::string& title, const auto& points) {
                  return friction_against_temperature(fit_.drive, title, speed_max_, load,
                                                      evenly(temperature_.low, temperature_.high, 7), points, band());
                });
            !ok)
          return ok;
    if (loaded && (load_.varies() || !thermal))
      for (const double T : thermal ? temperature_.levels : std::vector{temperature_.low})
        if (auto ok = show_curves(
                grid, "load", thermal ? level_text(" at {:.1f}", " ± {:.1f}", T, temperature_) + " °C" : "",
                [&](std::size_t i) { return !thermal || std::abs(s_.temperature_degC[i] - T) <= temperature_.window; },
                [&](const std::string& title, const auto& points) {
                  return friction_against_load(fit_.drive, title, speed_max_, T, evenly(load_.low, load_.high, 6),
                                               points, band());
                });
            !ok)
          return ok;
    return {};
  }

  /// Where there are data, within them.
  Outcome what_if() {
    const double T = temperature_.low, l = load_.low;
    return show_what_if(page_, fit_.drive, speed_max_,
                        law_.temperature_dependent ? Choice{T, temperature_.high} : Choice{T, T},
                        law_.load_dependent ? Choice{l, load_.high} : Choice{l, l}, band());
  }

  Outcome residuals() {
    if (!has_samples()) return {};
    page_.add(page_.body(), "h2", "Residuals");
    page_.add(page_.body(), "p",
              "Measured minus law. Where the law fits, residuals scatter about 0 alike at every speed, temperature and "
              "load; where their mean leaves 0, the law lacks an effect.",
              "soft");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    const int power = fit_.deviation > 0 ? 3 * static_cast<int>(std::floor(std::log10(fit_.deviation) / 3)) : 0;
    std::vector<double> scaled = fit_.residuals;
    for (double& r : scaled) r *= std::pow(10, -power);
    const Axis residual{.quantity = "measured − law",
                        .unit = fmt::format("{}{}", power ? power_of_ten(power) + (law_.normalised ? " of " : " ") : "",
                                            law_.normalised ? "τmax" : "Nm")};
    if (auto ok = page_.show(grid, residual_histogram("Residuals", residual, scaled), "residuals",
                             fmt::format("Histogram of the residuals of all {} samples, and the normal distribution of "
                                         "the same mean and standard deviation.",
                                         s_.size()));
        !ok)
      return ok;
    const Axis temperature{.quantity = "lubricant temperature", .symbol = "{/:Italic T}", .unit = "°C"};
    for (const auto& [what, axis, column] : {std::tuple{"speed", &axes_.speed, &s_.speed},
                                             {"temperature", &temperature, &s_.temperature_degC},
                                             {"load", &axes_.load, &s_.load}}) {
      if (std::ranges::min(*column) == std::ranges::max(*column)) continue;
      if (auto ok =
              page_.show(grid, scatter(fmt::format("Residuals against {}", what), *axis, residual, *column, scaled),
                         fmt::format("residuals_{}", what),
                         fmt::format("{}; the lines are mean and standard deviation of all in classes of {}.",
                                     drawn_of(std::min(scatter_points, s_.size()), s_.size()), what));
          !ok)
        return ok;
    }
    return {};
  }

  using Pair = std::array<std::size_t, 2>;
  double correlation_of(Pair p) const { return p_.found.correlation(p[0], p[1]); }
  std::string pair_name(Pair p) const {
    return fmt::format("{} and {}", p_.found.parameters[p[0]].name, p_.found.parameters[p[1]].name);
  }

  /// Pairs of estimated parameters by the magnitude of their correlation.
  std::vector<Pair> most_correlated() const {
    std::vector<Pair> pairs;
    for (const std::size_t a : known_)
      for (const std::size_t b : known_)
        if (a < b && std::isfinite(correlation_of({a, b})) && p_.found.parameters[a].sigma > 0 &&
            p_.found.parameters[b].sigma > 0)
          pairs.push_back({a, b});
    std::ranges::stable_sort(pairs, std::greater{}, [&](Pair p) { return std::abs(correlation_of(p)); });
    return pairs;
  }

  Outcome correlations() {
    auto pairs = most_correlated();
    if (pairs.empty()) return {};
    page_.add(page_.body(), "h2", "Correlation of the parameters");
    Matrix m;
    for (const std::size_t i : known_) {
      m.names.push_back(p_.found.parameters[i].name);
      auto& row = m.values.emplace_back();
      for (const std::size_t k : known_) row.push_back(correlation_of({i, k}));
    }
    const bool wide = known_.size() > 6;
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    if (auto ok =
            page_.show(grid, correlation_matrix("Correlation of the estimates", std::move(m)), "correlation",
                       "Correlation of the estimated parameters: the darker, the stronger. Errors of orange pairs have "
                       "the same sign, errors of blue pairs (minus) opposite signs. Bold from 0.9.",
                       wide ? Width::wide : Width::normal);
        !ok)
      return ok;
    if (wide) grid = page_.add(page_.body(), "div", {}, "figures");
    pairs.resize(std::min<std::size_t>(pairs.size(), wide ? 2 : 1));
    for (const Pair pair : pairs) {
      const auto &a = p_.found.parameters[pair[0]], &b = p_.found.parameters[pair[1]];
      const double both = correlation_of(pair) * a.sigma * b.sigma;
      const Estimate e{.label = "",
                       .mean = {a.value, b.value},
                       .covariance = {{{a.sigma * a.sigma, both}, {both, b.sigma * b.sigma}}},
                       .samples = {{a.value, b.value}},
                       .degrees_of_freedom =
                           std::max(1.0, static_cast<double>(p_.found.samples) - static_cast<double>(known_.size()))};
      if (auto ok = page_.show(
              grid,
              confidence_ellipses(fmt::format("{}: correlation {}", pair_name(pair), correlation(correlation_of(pair))),
                                  {.quantity = a.name, .unit = with_superscripts(a.unit)},
                                  {.quantity = b.name, .unit = with_superscripts(b.unit)}, std::array{e}),
              "ellipse", "Confidence regions of both parameters: 95 % (filled), 99 % (dashed). Point: the estimate.");
          !ok)
        return ok;
    }
    return {};
  }

  void origin() {
    auto to = page_.body();
    page_.add_origin(options_.command);
    auto text = page_.add_details(to, fmt::format("{}, as it was read", fit_.file.filename().string()));
    page_.add(text, "pre", without_folders(fit_.text));
  }

  const FitData& fit_;
  const ParameterFile& p_;
  const twin::identification::Samples& s_;
  const friction::LawInfo& law_;
  const ReportOptions& options_;
  IllustratedPage page_;
  std::vector<std::string> notes_;
  const LawAxes axes_;
  double speed_max_;  ///< joint side [rad/s]
  Input load_, temperature_;
  std::vector<std::size_t> known_;  ///< parameters with a sigma
  std::optional<friction::Uncertainty> uncertainty_ = uncertainty_of(p_);
};

}  // namespace

Result<Report> make_fit_report(const FitData& fit, const ReportOptions& options) {
  return Writer(fit, options).write();
}

}  // namespace tribotwin::render
