#include <tribotwin/render/report/fit_report.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {
namespace {

using Outcome = tl::expected<void, std::string>;
using twin::identification::ParameterFile, twin::identification::Status;

constexpr std::size_t curve_points = 300, cloud_points = 2000;

/// A law's source with the paper's name for its number.
std::string source_of(const friction::LawInfo& law) {
  std::string s(law.source);
  for (const auto& [number, name] : {std::pair{"P1", "Bittencourt and Gunnarsson 2012"}, {"P2", "Incipient fault diagnosis for robot manipulators (HSR-BR609)"}, {"P5", "Pagani et al., Thermal effects"}})
    if (s.starts_with(number)) s.replace(0, 2, name);
  return s;
}

std::string superscript(int power) {
  static constexpr const char* digits[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string out = power < 0 ? "⁻" : "";
  for (const char c : std::to_string(std::abs(power))) out += digits[c - '0'];
  return out;
}

/// The power of ten that a number is written with: none within 0.01 .. 100000.
int power_of(double v) {
  if (v == 0 || !std::isfinite(v)) return 0;
  const int power = static_cast<int>(std::floor(std::log10(std::abs(v))));
  return power < -2 || power > 4 ? power : 0;
}

/// v in units of 10^power, to `decimals` places: "1.30·10⁻⁴".
std::string written(double v, int power, int decimals) {
  const double scaled = v / std::pow(10, power);
  const std::string digits = fmt::format("{:.{}f}", scaled, std::clamp(decimals, 0, 9));
  return power ? fmt::format("{}·10{}", digits, superscript(power)) : digits;
}

/// A number to `digits` significant digits.
std::string significant(double v, int digits = 3) {
  if (!std::isfinite(v)) return "–";
  if (v == 0) return "0";
  const int power = power_of(v), first = static_cast<int>(std::floor(std::log10(std::abs(v)))) - power;
  return written(v, power, digits - 1 - first);
}

/// A number that is known exactly, to six significant digits at most.
std::string shortest(double v) {
  const int power = power_of(v);
  const std::string digits = fmt::format("{:.6g}", v / std::pow(10, power));
  return power ? fmt::format("{}·10{}", digits, superscript(power)) : digits;
}

/// A value and what goes with it, written alike: to the second digit of sigma.
struct Written {
  std::string value, sigma, interval;
};
Written written(const twin::identification::Estimate& e) {
  if (!(e.sigma > 0)) return {shortest(e.value), std::isnan(e.sigma) ? "–" : significant(e.sigma), "–"};
  const int power = power_of(e.value != 0 ? e.value : e.sigma);
  const int decimals = 1 - static_cast<int>(std::floor(std::log10(e.sigma))) + power;
  if (decimals > 7) return {significant(e.value, 8), significant(e.sigma, 2), std::isnan(e.low) ? "–" : fmt::format("{} … {}", significant(e.low, 8), significant(e.high, 8))};
  const std::string ends = std::isnan(e.low) ? "–" : fmt::format("{} … {}", written(e.low / std::pow(10, power), 0, decimals), written(e.high / std::pow(10, power), 0, decimals));
  return {written(e.value, power, decimals), written(e.sigma, power, decimals), power && ends != "–" ? fmt::format("({})·10{}", ends, superscript(power)) : ends};
}

std::string plural(std::size_t n, const char* what) { return fmt::format("{} {}{}", n, what, n == 1 ? "" : "s"); }

/// "Fcl, Fsl and vsl"
std::string listed(const std::vector<std::string>& names) {
  if (names.size() < 2) return names.empty() ? "" : names[0];
  return fmt::format("{} and {}", fmt::join(names.begin(), names.end() - 1, ", "), names.back());
}

std::string percent(double share) {
  const double gap = std::abs(1 - share);
  return fmt::format("{:.{}f} %", 100 * share, gap > 0 && gap < 0.001 ? 3 : gap < 0.01 ? 2 : 1);
}

double quantile(std::vector<double> v, double share) {
  const auto at = v.begin() + static_cast<std::ptrdiff_t>(std::lround(share * static_cast<double>(v.size() - 1)));
  std::ranges::nth_element(v, at);
  return *at;
}

std::vector<double> evenly(double from, double to, int count) {
  std::vector<double> v;
  if (!(from < to) || count < 2) return {(from + to) / 2};
  for (int i = 0; i < count; ++i) v.push_back(from + (to - from) * i / (count - 1));
  return v;
}

/// One of the inputs beside speed: how far the figures go in it, and where they are cut.
struct Input {
  double low = 0, high = 0, window = 0;
  std::vector<double> levels;   ///< at which the other input's curves are drawn

  bool varies() const { return high > low; }
  bool holds(double value, double level) const { return std::abs(value - level) <= window; }
};

/// A unit and the factor to it, such that numbers of this size read well.
struct Scale {
  double factor = 1;
  int power = 0;

  static Scale of(double size) {
    if (!(size > 0) || (size >= 0.1 && size < 1e4)) return {};
    const int power = 3 * static_cast<int>(std::floor(std::log10(size) / 3));
    return {std::pow(10, -power), power};
  }
  std::string unit(const std::string& plain) const {
    if (power == 0) return plain;
    return fmt::format("10{}{}", superscript(power), plain == "-" || plain == "1" ? "" : " " + plain);
  }
};

/// Limits with room around what is shown.
struct Bounds {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(const std::vector<double>& v) {
    for (const double x : v) low = std::min(low, x), high = std::max(high, x);
  }
  void put(Axis& axis) const { axis.from = low - 0.08 * (high - low), axis.to = high + 0.08 * (high - low); }
};

class Writer {
 public:
  Writer(const FitData& fit, const FitReportOptions& options)
      : fit_(fit), p_(fit.parameters), law_(*fit.parameters.law.info), options_(options), page_(title(), options.figure_files), axes_(fit.drive) {
    const auto& range = p_.law.range;
    const auto limit = [](double v, double otherwise) { return std::abs(v) < friction::unlimited ? v : otherwise; };
    speed_max_ = limit(range.speed_max_rad_s, law_.side == friction::Side::motor ? 280 : 3);
    load_ = {0, limit(range.load_max, 0.8), 0, {}};
    temperature_ = {limit(range.temperature_min_degC, 20), limit(range.temperature_max_degC, 80), 0, {}};
    const auto& s = fit_.samples;
    if (s.size()) {
      speed_max_ = std::ranges::max(s.speed);
      const double least = std::ranges::min(s.speed);
      if (quantile(s.speed, 0.5) < 0.15 * speed_max_ && least > 1e-6 * speed_max_) speed_from_ = 0.85 * least;
      std::tie(load_.low, load_.high) = ends(s.load);
      std::tie(temperature_.low, temperature_.high) = ends(s.temperature_degC);
    }
    for (Input* input : {&load_, &temperature_}) {
      const auto& column = input == &load_ ? s.load : s.temperature_degC;
      input->window = std::max(0.05 * (input->high - input->low), 1e-6 * (1 + std::abs(input->high)));
      if (!input->varies()) input->levels = {input->low};
      else if (column.empty()) input->levels = {input->low, input->high};
      else input->levels = {quantile(column, 0.1), quantile(column, 0.9)};
      if (input->levels.size() > 1 && input->levels[1] - input->levels[0] <= 2 * input->window) input->levels = {column.empty() ? input->low : quantile(column, 0.5)};
    }
    names_.reserve(p_.estimates.size());
    for (std::size_t i = 0; i < p_.estimates.size(); ++i)
      if (!std::isnan(p_.estimates[i].sigma)) known_.push_back(i), names_.push_back(p_.estimates[i].name);
  }

  tl::expected<Report, std::string> write() {
    head();
    parameters();
    advance(0.05);
    for (const auto part : {&Writer::curves, &Writer::residuals, &Writer::correlation}) {
      if (auto ok = (this->*part)(); !ok) return tl::unexpected(ok.error());
      advance(part == &Writer::curves ? 0.5 : part == &Writer::residuals ? 0.75 : 1);
    }
    origin();
    return page_.report(std::move(notes_));
  }

 private:
  static std::pair<double, double> ends(const std::vector<double>& v) {
    const auto [low, high] = std::ranges::minmax(v);
    return {low, high};
  }
  std::string title() const { return fmt::format("{}: friction law '{}'", fit_.file.stem().string(), law_.name); }
  void advance(double share) const {
    if (options_.progress) options_.progress(share);
  }
  const char* friction_unit() const { return law_.normalised ? "of the maximum torque" : "Nm"; }
  bool has_samples() const { return fit_.samples.size() > 0; }
  std::string drawn_of(std::size_t shown, std::size_t all) const { return shown < all ? fmt::format("{} of the {} samples are drawn, chosen evenly", shown, all) : fmt::format("{} samples", all); }
  std::vector<std::string> with_status(Status status) const {
    std::vector<std::string> names;
    for (const auto& e : p_.estimates)
      if (e.status == status) names.push_back(e.name);
    return names;
  }
  /// Whether a parameter that may be 0 cannot be told from it.
  bool may_vanish(std::size_t i) const {
    const auto& e = p_.estimates[i];
    return e.status == Status::estimated && e.low < 0 && e.high > 0 && law_.parameters[i].minimum <= 0;
  }
  bool told(const std::string& name) const { return std::ranges::find(p_.unidentifiable, name) == p_.unidentifiable.end(); }

  /// What was identified, from what, how well, and what could not be told.
  std::string verdict() const {
    const std::size_t all = p_.estimates.size();
    if (known_.empty() && p_.samples == 0) return fmt::format("Law '{}' with given parameters: the file does not say how they were found.", law_.name);
    std::size_t count = 0;
    for (const auto& e : p_.estimates) count += e.status == Status::estimated && told(e.name);
    const std::string from = fmt::format("from {}{}", plural(p_.samples, "sample"),
                                         p_.data.size() == 1 ? " of " + std::filesystem::path(p_.data[0]).filename().string() : p_.data.empty() ? "" : " of " + plural(p_.data.size(), "file"));
    std::string s = count == all ? fmt::format("All {} parameters of law '{}' were identified {}. ", all, law_.name, from)
                                 : fmt::format("{} of the {} parameters of law '{}' were identified {}. ", count, all, law_.name, from);
    if (p_.residual_std > 0 || p_.r_squared != 0)
      s += fmt::format("The law leaves a standard deviation of {} {} and explains {} of how friction varies. ", significant(p_.residual_std), friction_unit(), percent(p_.r_squared));
    if (!p_.unidentifiable.empty()) s += fmt::format("These data cannot tell {}. ", listed(p_.unidentifiable));
    if (const auto fixed = with_status(Status::fixed); !fixed.empty()) s += fmt::format("{} {} known beforehand. ", listed(fixed), fixed.size() == 1 ? "was" : "were");
    if (const auto edge = with_status(Status::at_bound); !edge.empty()) s += fmt::format("{} {} at the edge of what is accepted. ", listed(edge), edge.size() == 1 ? "lies" : "lie");
    std::vector<std::string> vanishing;
    for (std::size_t i = 0; i < all; ++i)
      if (may_vanish(i) && told(p_.estimates[i].name)) vanishing.push_back(p_.estimates[i].name);
    if (!vanishing.empty()) s += fmt::format("{} may as well be 0. ", listed(vanishing));
    for (const auto& [i, k] : closest_pairs())
      if (std::abs(correlation_of(i, k)) >= 0.95) {
        s += fmt::format("{} and {} are known together rather than one by one (correlation {}). ", p_.estimates[i].name, p_.estimates[k].name, render::correlation(correlation_of(i, k)));
        break;
      }
    s.pop_back();
    return s;
  }

  void head() {
    auto to = page_.body();
    page_.add(to, "h1", title());
    page_.add(to, "p", range_text() + ".", "soft");
    page_.add(to, "p", verdict(), "verdict");
    if (!fit_.missing.empty()) {
      auto box = page_.add(to, "div", {}, "notice");
      for (const auto& what : fit_.missing) page_.add(box, "p", what), notes_.push_back(what);
    }
    if (has_samples() && !fit_.own_data) {
      const std::string what = fmt::format("The data shown here are not those of the identification: {} with a residual standard deviation of {} {}, against {} with {}.{} Parameters, sigmas and correlation are those of the identification.",
                                           plural(fit_.samples.size(), "sample"), significant(fit_.deviation), friction_unit(), plural(p_.samples, "sample"), significant(p_.residual_std),
                                           fit_.outside ? fmt::format(" {} lie outside the range of the identification, where the law is held at its edge.", fit_.outside) : "");
      page_.add(page_.add(to, "div", {}, "notice"), "p", what);
      notes_.push_back(what);
    }
    tiles(to);
    std::vector<std::string> remarks = p_.notes;
    for (const auto& note : fit_.samples.notes)
      if (std::ranges::find(remarks, note) == remarks.end()) remarks.push_back(note);
    if (remarks.empty()) return;
    page_.add(to, "h3", "Remarks");
    auto box = page_.add(to, "div", {}, "notice remarks");
    for (const auto& note : remarks) page_.add(box, "p", note);
  }

  void tiles(pugi::xml_node to) {
    auto grid = page_.add(to, "div", {}, "tiles");
    const char* unit = law_.normalised ? "of the maximum torque" : "";
    const auto level = [&](double v) { return significant(v) + (law_.normalised ? "" : " Nm"); };
    if (has_samples() && !fit_.own_data) page_.tile(grid, "residual on these data, std", level(fit_.deviation), fmt::format("mean {}, largest {}", level(fit_.mean), level(fit_.largest)));
    if (p_.samples) {
      page_.tile(grid, "residual, std", level(p_.residual_std), unit);
      page_.tile(grid, "largest residual", level(p_.residual_max_abs), p_.residual_std > 0 ? fmt::format("{:.1f} standard deviations", p_.residual_max_abs / p_.residual_std) : "");
      page_.tile(grid, "explained", percent(p_.r_squared), "of how friction varies");
    }
    std::size_t sure = 0;
    for (const auto& e : p_.estimates) sure += e.status == Status::fixed || (e.status == Status::estimated && told(e.name));
    if (!known_.empty()) page_.tile(grid, "parameters known", fmt::format("{} of {}", sure, p_.estimates.size()), p_.unidentifiable.empty() ? "" : "not: " + listed(p_.unidentifiable), sure == p_.estimates.size() ? "good" : "bad");
    if (const auto pairs = closest_pairs(); !pairs.empty()) {
      const auto [i, k] = pairs[0];
      page_.tile(grid, "closest pair", fmt::format("{} – {}", p_.estimates[i].name, p_.estimates[k].name), "correlation " + render::correlation(correlation_of(i, k)));
    }
    if (p_.condition_number > 0) page_.tile(grid, "condition number", significant(p_.condition_number), "of the scaled Jacobian", p_.condition_number > 1e4 ? "bad" : nullptr);
  }

  const char* status_of(std::size_t i) const {
    switch (p_.estimates[i].status) {
      case Status::estimated: return !told(p_.estimates[i].name) ? "estimated, but not told" : may_vanish(i) ? "estimated, may be 0" : "estimated";
      case Status::fixed: return known_.empty() ? "given" : "known beforehand";
      case Status::held: return "held: not told by the data";
      case Status::at_bound: return "at the edge of its range";
    }
    return "";
  }

  void parameters() {
    auto to = page_.body();
    page_.add(to, "h2", "Parameters");
    std::vector<std::vector<std::string>> rows;
    for (std::size_t i = 0; i < p_.estimates.size(); ++i) {
      const auto& e = p_.estimates[i];
      const auto w = written(e);
      rows.push_back({e.name, w.value, w.sigma, w.interval, e.unit == "1" ? "-" : e.unit == "-" ? "of τmax" : e.unit, status_of(i), std::string(law_.parameters[i].meaning)});
    }
    page_.add_table(to, {"parameter", "value", "sigma", "95 % interval", "unit", "status", "meaning"}, rows);
    page_.add(to, "pre", fmt::format("{} = {}", law_.normalised ? "friction / τmax" : "friction [Nm]", law_.equation));
    page_.add(to, "p", fmt::format("{}v: {} speed [rad/s]{}{}. Sigma: one standard deviation.", law_.normalised ? "τmax: maximum torque; " : "", law_.side == friction::Side::motor ? "motor" : "joint",
                                   law_.load_dependent ? "; l: load torque / maximum torque" : "", law_.temperature_dependent ? "; T: lubricant temperature [°C]" : ""), "soft");
  }

  std::string range_text() const {
    const auto& r = p_.law.range;
    std::string s = r.speed_max_rad_s < friction::unlimited ? fmt::format("Holds up to {:.4g} rad/s", r.speed_max_rad_s) : "Holds at any speed";
    if (r.load_max < friction::unlimited && law_.load_dependent) s += fmt::format(", for loads up to {:.3g} of the maximum torque", r.load_max);
    if (r.temperature_max_degC < friction::unlimited && law_.temperature_dependent) s += fmt::format(", at {:.3g} to {:.3g} °C", r.temperature_min_degC, r.temperature_max_degC);
    return s;
  }

  /// Samples for a figure of curves: those that `fit`, at most `curve_points`.
  struct Points {
    std::vector<FrictionPoint> drawn;
    std::size_t all = 0;
  };
  Points points(auto fit) const {
    const auto& s = fit_.samples;
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < s.size(); ++i)
      if (fit(i)) rows.push_back(i);
    Points p{{}, rows.size()};
    for (const std::size_t k : thinned(rows.size(), curve_points)) {
      const std::size_t i = rows[k];
      p.drawn.push_back({s.speed[i] / fit_.drive.speed_scale(), s.load[i], s.temperature_degC[i], s.friction[i] * fit_.drive.torque_scale_nm()});
    }
    return p;
  }
  std::string points_text(const Points& p, const std::string& which) const {
    if (!has_samples()) return "";
    if (p.all == 0) return " No sample is there.";
    return fmt::format(" Points: {}{}.", which, p.drawn.size() < p.all ? fmt::format("; {} of {} are drawn, chosen evenly", p.drawn.size(), p.all) : "");
  }

  /// With a logarithmic axis of speed where that shows the samples better.
  Figure over_speed(Figure figure) const {
    if (!speed_from_) return figure;
    figure.x.logarithmic = true;
    figure.x.from = *speed_from_;
    figure.x.to = 1.1 * speed_max_;
    for (auto& s : figure.series)
      if (s.mark == Mark::line && s.x.front() <= 0) s.x.erase(s.x.begin()), s.y.erase(s.y.begin());
    return figure;
  }

  Outcome curves() {
    page_.add(page_.body(), "h2", has_samples() ? "Curves over points" : "Curves");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    const double speed = speed_max_ / fit_.drive.speed_scale();
    const auto& s = fit_.samples;
    const bool thermal = law_.temperature_dependent, loaded = law_.load_dependent;
    // Where the law does not know what the data vary in, the points' colour shows what that does.
    const bool hue_T = !thermal && !loaded && has_samples() && temperature_.high - temperature_.low > 0.5, hue_load = !thermal && !loaded && !hue_T && has_samples() && load_.high - load_.low > 0.01;
    if (!thermal && !loaded && !hue_T && !hue_load) {
      const auto p = points([](std::size_t) { return true; });
      return page_.show(grid, over_speed(friction_against_speed(fit_.drive, fmt::format("Law '{}'", law_.name), speed, 0, p.drawn)), "curve", fmt::format("Law '{}', which knows neither load nor temperature.{}", law_.name, points_text(p, "samples")));
    }
    // Curves that differ in what did not vary would say the same as the others.
    if (hue_T || (thermal && (temperature_.varies() || !loaded || !load_.varies())))
      for (const double load : loaded ? load_.levels : std::vector{0.0}) {
        const auto p = points([&](std::size_t i) { return !loaded || load_.holds(s.load[i], load); });
        const std::string where = loaded ? fmt::format(" at a load of {:.3g}", load) : "";
        const std::string title = fmt::format("Friction{}{}", where, thermal && temperature_.varies() ? where.empty() ? " at several temperatures" : ", several temperatures" : "");
        const auto figure = friction_against_temperature(fit_.drive, title, speed, load, evenly(temperature_.low, temperature_.high, thermal ? 7 : 1), p.drawn);
        const auto which = !loaded || !load_.varies() ? std::string("samples") : fmt::format("samples with a load within {:.2g} of that", load_.window);
        if (auto ok = page_.show(grid, over_speed(figure), "temperature", fmt::format("Law '{}'{}{}.{}", law_.name, where, loaded ? " of the maximum torque" : thermal ? "" : ", which knows no temperature", points_text(p, which))); !ok) return ok;
      }
    advance(0.2);
    if (hue_load || (loaded && (load_.varies() || !thermal)))
      for (const double T : thermal ? temperature_.levels : std::vector{temperature_.low}) {
        const auto p = points([&](std::size_t i) { return !thermal || temperature_.holds(s.temperature_degC[i], T); });
        const std::string where = thermal ? fmt::format(" at {:.1f} °C", T) : "";
        const std::string title = fmt::format("Friction{}{}", where, loaded && load_.varies() ? where.empty() ? " at several loads" : ", several loads" : "");
        const auto figure = friction_against_load(fit_.drive, title, speed, T, evenly(load_.low, load_.high, loaded ? 6 : 1), p.drawn);
        const auto which = !thermal || !temperature_.varies() ? std::string("samples") : fmt::format("samples within {:.2g} K of that", temperature_.window);
        if (auto ok = page_.show(grid, over_speed(figure), "load", fmt::format("Law '{}'{}{}.{}", law_.name, where, loaded ? "" : ", which knows no load", points_text(p, which))); !ok) return ok;
      }
    advance(0.35);
    if (thermal && temperature_.high - temperature_.low > 1) {
      const double load = has_samples() && loaded ? quantile(s.load, 0.5) : load_.low;
      const auto figure = friction_surface(fit_.drive, loaded ? fmt::format("Law '{}' at a load of {:.3g}", law_.name, load) : fmt::format("Law '{}'", law_.name), speed, load, temperature_.low, temperature_.high);
      if (auto ok = page_.show(grid, figure, "surface", "The law over speed and temperature."); !ok) return ok;
    }
    if (thermal && loaded && has_samples() && load_.varies() && temperature_.varies()) {
      const auto figure = coverage("Where the samples are", {.quantity = "lubricant temperature", .symbol = "{/:Italic T}", .unit = "°C"}, axes_.load, s.temperature_degC, s.load, cloud_points);
      return page_.show(grid, figure, "coverage", fmt::format("Temperature and load of the samples: beyond them the law is a guess. {}.", drawn_of(std::min(cloud_points, s.size()), s.size())));
    }
    return {};
  }

  Outcome residuals() {
    if (!has_samples()) return {};
    const auto& s = fit_.samples;
    page_.add(page_.body(), "h2", "Residuals");
    page_.add(page_.body(), "p", "Measured minus law. Where the law follows the data, residuals scatter about 0 alike at every speed, temperature and load; a mean that wanders off tells what the law does not know.", "soft");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    const Scale scale = Scale::of(fit_.deviation);
    std::vector<double> scaled = fit_.residuals;
    for (double& r : scaled) r *= scale.factor;
    const Axis residual{.quantity = "measured − law", .unit = law_.normalised ? scale.power ? scale.unit("-") + " of τmax" : "τmax" : scale.unit("Nm")};
    if (auto ok = page_.show(grid, residual_histogram("Residuals", residual, scaled), "residuals", fmt::format("How often each residual occurs, all {}, with the normal distribution of their mean and deviation.", plural(scaled.size(), "sample"))); !ok) return ok;
    const auto against = [&](const char* what, const Axis& x, const std::vector<double>& xs) -> Outcome {
      const std::size_t shown = std::min(cloud_points, xs.size());
      const Figure figure = scatter(fmt::format("Residuals against {}", what), x, residual, xs, scaled, cloud_points);
      return page_.show(grid, &xs == &s.speed ? over_speed(figure) : figure, fmt::format("residuals_{}", what),
                        fmt::format("{}; the lines are mean and standard deviation of all in classes of {}.", drawn_of(shown, xs.size()), what));
    };
    if (auto ok = against("speed", axes_.speed, s.speed); !ok) return ok;
    if (temperature_.varies())
      if (auto ok = against("temperature", {.quantity = "lubricant temperature", .symbol = "{/:Italic T}", .unit = "°C"}, s.temperature_degC); !ok) return ok;
    if (load_.varies()) return against("load", axes_.load, s.load);
    return {};
  }

  double correlation_of(std::size_t i, std::size_t k) const { return p_.correlation(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)); }

  /// Pairs of estimated parameters by the magnitude of their correlation.
  std::vector<std::pair<std::size_t, std::size_t>> closest_pairs() const {
    std::vector<std::pair<std::size_t, std::size_t>> pairs;
    for (std::size_t a = 0; a < known_.size(); ++a)
      for (std::size_t b = a + 1; b < known_.size(); ++b)
        if (std::isfinite(correlation_of(known_[a], known_[b]))) pairs.emplace_back(known_[a], known_[b]);
    std::ranges::stable_sort(pairs, std::greater{}, [&](const auto& p) { return std::abs(correlation_of(p.first, p.second)); });
    return pairs;
  }

  Outcome correlation() {
    auto pairs = closest_pairs();
    if (pairs.empty()) return {};
    page_.add(page_.body(), "h2", "How well parameters can be told apart");
    auto grid = page_.add(page_.body(), "div", {}, "figures");
    Matrix m{names_, {}};
    for (const std::size_t i : known_) {
      auto& row = m.values.emplace_back();
      for (const std::size_t k : known_) row.push_back(correlation_of(i, k));
    }
    if (auto ok = page_.show(grid, correlation_matrix("Correlation of the estimates", std::move(m)), "correlation",
                             "Correlation of the estimated parameters: the darker, the stronger. Orange pairs rise and fall together; blue pairs, with a minus, make up for each other. Bold from 0.9.", known_.size() > 6);
        !ok)
      return ok;
    std::erase_if(pairs, [&](const auto& p) { return !(p_.estimates[p.first].sigma > 0 && p_.estimates[p.second].sigma > 0); });
    const auto close = static_cast<std::size_t>(std::ranges::count_if(pairs, [&](const auto& p) { return std::abs(correlation_of(p.first, p.second)) >= 0.5; }));
    pairs.resize(std::min(pairs.size(), std::size_t{known_.size() > 6 ? close > 2 ? 4u : 2u : close > 1 ? 3u : 1u}));
    grid = page_.add(page_.body(), "div", {}, "figures");
    for (const auto& [i, k] : pairs) {
      const auto &a = p_.estimates[i], &b = p_.estimates[k];
      const Scale x = Scale::of(std::abs(a.value) + 3 * a.sigma), y = Scale::of(std::abs(b.value) + 3 * b.sigma);
      const double sa = a.sigma * x.factor, sb = b.sigma * y.factor, r = correlation_of(i, k);
      const Estimate e{.label = "", .mean = {a.value * x.factor, b.value * y.factor}, .covariance = {{{sa * sa, r * sa * sb}, {r * sa * sb, sb * sb}}},
                       .samples = {{a.value * x.factor, b.value * y.factor}}, .degrees_of_freedom = std::max(1.0, static_cast<double>(p_.samples) - static_cast<double>(known_.size()))};
      Figure figure = confidence_ellipses(fmt::format("{} and {}: correlation {}", a.name, b.name, render::correlation(r)), {.quantity = a.name, .unit = x.unit(a.unit)}, {.quantity = b.name, .unit = y.unit(b.unit)}, std::array{e});
      Bounds bx, by;
      for (const auto& series : figure.series) bx.add(series.x), by.add(series.y);
      bx.put(figure.x), by.put(figure.y);
      if (auto ok = page_.show(grid, figure, "ellipse", "Where both parameters are: with 95 % confidence (filled) and with 99 % (dashed). The point is the estimate."); !ok) return ok;
    }
    return {};
  }

  void origin() {
    auto to = page_.body();
    page_.add(to, "h2", "Origin");
    std::vector<std::string> files;
    for (const auto& file : fit_.data) files.push_back(file.string());
    std::vector<std::vector<std::string>> rows = {{"law", std::string(law_.name)}, {"its source", source_of(law_)}, {"parameter file", fit_.file.string()}};
    if (!p_.data.empty()) rows.push_back({"identified from", fmt::format("{}", fmt::join(p_.data, ", "))});
    if (!files.empty() && !fit_.own_data) rows.push_back({"shown with", fmt::format("{}", fmt::join(files, ", "))});
    if (p_.samples) rows.push_back({"samples", fmt::format("{}", p_.samples)});
    rows.push_back({"largest torque", p_.torque_max_nm > 0 ? fmt::format("{:g} Nm", p_.torque_max_nm) : law_.normalised ? "not in the file: friction is normalised" : "not in the file"});
    rows.push_back({"gear ratio", p_.gear_ratio > 0 ? fmt::format("{:g}", p_.gear_ratio) : "not in the file"});
    rows.push_back({"page made by", fmt::format("tribotwin-report {}", options_.version)});
    page_.add_table(to, {}, rows);
    page_.add(to, "p", "To make this page again:");
    page_.add(to, "pre", options_.command);
    page_.add(to, "p", "The parameter file, as it was read:");
    page_.add(to, "pre", fit_.text);
  }

  const FitData& fit_;
  const ParameterFile& p_;
  const friction::LawInfo& law_;
  const FitReportOptions& options_;
  IllustratedPage page_;
  std::vector<std::string> notes_;
  LawAxes axes_;
  double speed_max_ = 0;                ///< in the law's unit
  std::optional<double> speed_from_;    ///< where the axis is logarithmic: most samples are slow
  Input load_, temperature_;
  std::vector<std::size_t> known_;      ///< parameters with a sigma
  std::vector<std::string> names_;      ///< their names
};

}  // namespace

tl::expected<Report, std::string> make_fit_report(const FitData& fit, const FitReportOptions& options) { return Writer(fit, options).write(); }

}  // namespace tribotwin::render
