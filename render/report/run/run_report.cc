#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/pose/pose.hpp>
#include <tribotwin/render/process/child.hpp>
#include <tribotwin/render/report/run/run_report.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render {
namespace {

using Status = Result<void>;
using nlohmann::json;

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t trace_points = 600, visited_points = 250;
const Axis temperature_axis{.quantity = "lubricant temperature", .symbol = "{/:Italic T}", .unit = "°C"};
const Axis torsion_axis{.quantity = "torsion", .symbol = "{/:Italic φ}", .unit = "mrad"},
    transmission_axis{.quantity = "torque of the transmission", .symbol = "{/:Italic τ}", .unit = "Nm"};
const Axis arm_axis{.quantity = "arm position", .symbol = "{/:Italic q}", .unit = "rad"};

/// A number of the summary, NaN where it is not there.
double number(const json& j, std::initializer_list<const char*> path) {
  const json* at = &j;
  for (const char* key : path) {
    if (!at->is_object() || !at->contains(key)) return unknown;
    at = &(*at)[key];
  }
  return at->is_number() ? at->get<double>() : unknown;
}
std::string text(const json& j, const char* key) {
  return j.is_object() && j.contains(key) && j[key].is_string() ? j[key].get<std::string>() : "";
}

/// What the summary lists under a name; nothing where it has no such list.
const json& entries(const RunData& run, const char* key) {
  static const json none = json::array();
  return run.summary.is_object() && run.summary.contains(key) && run.summary[key].is_array() ? run.summary[key] : none;
}

std::string shown(double v, const char* format) {
  return std::isfinite(v) ? fmt::format(fmt::runtime(format), v) : "–";
}

std::string energy(double joule) {
  for (const auto& [unit, size] : {std::pair{"MJ", 1e6}, {"kJ", 1e3}})
    if (std::abs(joule) >= size) return fmt::format("{:.3g} {}", joule / size, unit);
  return shown(joule, "{:.3g} J");
}

double middle(std::vector<double> v) {
  if (v.empty()) return 0;
  const auto half = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), half, v.end());
  return *half;
}

std::vector<double> evenly(double from, double to, int count) {
  std::vector<double> v;
  if (count < 2) return {(from + to) / 2};
  for (int i = 0; i < count; ++i) v.push_back(from + (to - from) * i / (count - 1));
  return v;
}

struct JointFigures {
  std::string name;
  double start_degC, end_degC, max_degC, rms_nm, friction_max_nm, load_max, clamped, stuck_s;
};

/// From the summary or, where there is none, from the samples.
std::vector<JointFigures> joint_figures(const RunData& run) {
  std::vector<JointFigures> all;
  for (const auto& j : entries(run, "joints"))
    all.push_back({text(j, "name"), number(j, {"temperature_degC", "start"}), number(j, {"temperature_degC", "end"}),
                   number(j, {"temperature_degC", "max"}), number(j, {"friction_nm", "rms"}),
                   number(j, {"friction_nm", "max"}), number(j, {"load_norm", "max"}), number(j, {"clamped_samples"}),
                   number(j, {"stuck_s"})});
  if (!all.empty()) return all;
  for (const auto& j : run.joints) {
    JointFigures f{j.name, unknown, unknown, unknown, unknown, unknown, unknown, unknown, unknown};
    double squares = 0;
    std::size_t n = 0;
    for (std::size_t i = 0; i < run.record.time_s.size(); ++i) {
      const auto at = [&](std::span<const double> v) { return i < v.size() ? v[i] : unknown; };
      if (const double t = at(j.temperature_degC); std::isfinite(t)) {
        if (!std::isfinite(f.start_degC)) f.start_degC = t;
        f.end_degC = t;
        f.max_degC = std::fmax(f.max_degC, t);
      }
      if (const double nm = at(j.friction_nm); std::isfinite(nm))
        squares += nm * nm, ++n, f.friction_max_nm = std::fmax(f.friction_max_nm, std::abs(nm));
      if (const double nm = at(j.load_nm); std::isfinite(nm))
        f.load_max = std::fmax(f.load_max, std::abs(nm) / j.torque_max_nm);
    }
    if (n) f.rms_nm = std::sqrt(squares / static_cast<double>(n));
    all.push_back(f);
  }
  return all;
}

const JointFigures* warmest(const std::vector<JointFigures>& joints) {
  const JointFigures* best = nullptr;
  for (const auto& j : joints)
    if (std::isfinite(j.max_degC) && (!best || j.max_degC > best->max_degC)) best = &j;
  return best;
}

double simulated_s(const RunData& run) {
  const double s = number(run.summary, {"simulated_s"});
  return std::isfinite(s) || run.record.time_s.empty() ? s : run.record.time_s.back();
}

/// Of many samples about trace_points: the least and the largest of each of half as many stretches, in their order, so
/// that no peak is lost; the last stays.
Trace thinned(std::string label, std::span<const double> time, std::span<const double> values) {
  Trace t{std::move(label), {}, {}};
  const auto keep = [&](std::size_t i) { t.time_s.push_back(time[i]), t.values.push_back(values[i]); };
  const std::size_t n = std::min(time.size(), values.size()), step = n > trace_points ? 2 * n / trace_points + 1 : 1;
  std::size_t last = 0;
  for (std::size_t i = 0; i < n; i += step) {
    std::size_t low = i, high = i;
    for (std::size_t k = i; k < std::min(n, i + step); ++k) {
      if (values[k] < values[low] || std::isnan(values[low])) low = k;
      if (values[k] > values[high] || std::isnan(values[high])) high = k;
    }
    keep(std::min(low, high));
    if (low != high) keep(std::max(low, high));
    last = std::max(low, high);
  }
  if (n > 0 && last != n - 1) keep(n - 1);
  return t;
}

bool any_finite(const Trace& t) {
  return std::ranges::any_of(t.values, [](double v) { return std::isfinite(v); });
}

/// At most visited_points of those that `fit`, evenly chosen.
std::vector<FrictionPoint> some(const std::vector<FrictionPoint>& all, auto fit) {
  std::vector<FrictionPoint> good, few;
  std::ranges::copy_if(all, std::back_inserter(good), fit);
  const std::size_t step = good.size() / visited_points + 1;
  for (std::size_t i = 0; i < good.size(); i += step) few.push_back(good[i]);
  return few;
}

/// Root mean square in windows of equal time.
Trace rms_trace(std::string label, std::span<const double> time, std::span<const double> values, double window_s) {
  Trace t{std::move(label), {}, {}};
  const std::size_t n = std::min(time.size(), values.size());
  for (std::size_t i = 0; i < n;) {
    const double begin = time[i];
    double squares = 0;
    std::size_t count = 0, all = 0;
    for (; i < n && time[i] < begin + window_s; ++i, ++all)
      if (std::isfinite(values[i])) squares += values[i] * values[i], ++count;
    t.time_s.push_back(begin + window_s / 2);
    t.values.push_back(count ? std::sqrt(squares / static_cast<double>(count)) : unknown);
    if (all == 0) break;
  }
  return t;
}

bool has_transmission(const JointHistory& j) {
  return !j.transmission_torque_nm.empty() &&
         std::ranges::any_of(j.torsion_rad, [](double v) { return std::isfinite(v); });
}

/// Torque over torsion [mrad] in the load's last period, that of the summary's `loops`; over all samples without one.
Loop last_loop(std::string label, const RunData& run, const JointHistory& j) {
  const auto& time = run.record.time_s;
  double period_s = std::numeric_limits<double>::infinity();
  for (const auto& loop : entries(run, "loops")) period_s = 1 / number(loop, {"frequency_hz"});
  // With the sample that the period began at, whatever its time was rounded to: the loop closes there.
  const auto first = static_cast<std::size_t>(
      std::ranges::find_if(time, [&](double t) { return !(t < time.back() - period_s * (1 + 1e-9)); }) - time.begin());
  Trace t = thinned(std::move(label), j.torsion_rad.subspan(first), j.transmission_torque_nm.subspan(first));
  for (double& torsion : t.time_s) torsion *= 1e3;
  return {std::move(t.label), std::move(t.time_s), std::move(t.values)};
}

/// Set point minus position of the arm [rad]; nothing where the set point rests or either is unknown.
std::optional<Trace> arm_error(std::string label, const RunData& run, const JointHistory& j) {
  const auto moves = [first = j.arm_set_point_rad.empty() ? unknown : j.arm_set_point_rad.front()](double q) {
    return std::abs(q - first) > 0;
  };
  if (j.arm_position_rad.empty() || std::ranges::none_of(j.arm_set_point_rad, moves)) return std::nullopt;
  std::vector<double> error;
  for (std::size_t i = 0; i < j.arm_set_point_rad.size(); ++i)
    error.push_back(j.arm_set_point_rad[i] - j.arm_position_rad[i]);
  Trace trace = thinned(std::move(label), run.record.time_s, error);
  return any_finite(trace) ? std::optional(std::move(trace)) : std::nullopt;
}

/// Spans of samples without a hole in time: the work cycles that a multi-rate run computed.
std::vector<std::pair<std::size_t, std::size_t>> stretches(std::span<const double> time) {
  std::vector<std::pair<std::size_t, std::size_t>> out;
  if (time.size() < 3) return out;
  std::vector<double> steps;
  for (std::size_t i = 1; i < time.size(); ++i) steps.push_back(time[i] - time[i - 1]);
  const double usual = middle(std::move(steps));
  std::size_t begin = 0;
  for (std::size_t i = 1; i <= time.size(); ++i)
    if (i == time.size() || time[i] - time[i - 1] > 1.5 * usual) {
      if (i - begin > 2) out.emplace_back(begin, i);
      begin = i;
    }
  return out;
}

class Writer {
 public:
  Writer(std::span<const std::unique_ptr<RunData>> runs, const ReportOptions& options)
      : runs_(runs), options_(options), page_(title(), options.figure_files) {}

  Result<Report> write() {
    page_.add(page_.body(), "h1", title());
    if (runs_.size() > 1) {
      page_.add(page_.body(), "p", "Several runs side by side, then each by itself.", "soft");
      if (auto ok = comparison(); !ok) return tl::unexpected(ok.error());
    }
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      run_index_ = i;
      if (auto ok = one(*runs_[i]); !ok) return tl::unexpected(ok.error());
    }
    return page_.report(std::move(notes_));
  }

 private:
  std::string title() const {
    if (runs_.size() == 1) return runs_[0]->name;
    const std::string scenario = runs_[0]->attribute("scenario");
    const bool one_scenario = !scenario.empty() && std::ranges::all_of(runs_, [&](const auto& r) {
      return r->attribute("scenario") == scenario;
    });
    return fmt::format("{}{} runs compared", one_scenario ? scenario + ": " : "", runs_.size());
  }

  void advance(double share_of_run) {
    if (options_.progress)
      options_.progress((static_cast<double>(run_index_) + share_of_run) / static_cast<double>(runs_.size()));
  }

  void notices(pugi::xml_node to, const RunData& run) {
    if (run.missing.empty()) return;
    auto box = page_.add(to, "div", {}, "notice");
    for (const auto& what : run.missing) {
      page_.add(box, "p", what);
      notes_.push_back(what);
    }
  }

  void tiles(pugi::xml_node to, const RunData& run) {
    auto grid = page_.add(to, "div", {}, "tiles");
    const auto joints = joint_figures(run);
    const double rate = number(run.summary, {"realtime_factor"});
    const double simulated = simulated_s(run);
    page_.tile(grid, "simulated", simulated > 7200 ? fmt::format("{:.2f} h", simulated / 3600) : duration(simulated),
               std::isfinite(rate) ? fmt::format("{:.0f} x real time", rate) : "");
    if (const auto* hot = warmest(joints))
      page_.tile(grid, "warmest joint", fmt::format("{:.1f} °C", hot->max_degC),
                 fmt::format("{}, from {:.1f} °C", hot->name, hot->start_degC));
    if (const double work = number(run.summary, {"friction_work_J"}); std::isfinite(work))
      page_.tile(grid, "lost to friction", energy(work),
                 fmt::format("of {} motor work", energy(number(run.summary, {"motor_work_J"}))));
    const JointFigures *loaded = nullptr, *outside = nullptr;
    for (const auto& j : joints) {
      if (std::isfinite(j.load_max) && (!loaded || j.load_max > loaded->load_max)) loaded = &j;
      const auto history = std::ranges::find(run.joints, j.name, &JointHistory::name);
      const bool moved = history == run.joints.end() || history->moved;
      if (moved && j.clamped > 0 && (!outside || j.clamped > outside->clamped)) outside = &j;
    }
    if (loaded)
      page_.tile(grid, "largest load", fmt::format("{:.0f} %", 100 * loaded->load_max),
                 fmt::format("of the maximum torque, {}", loaded->name));
    if (const double steps = number(run.summary, {"steps_computed"}); steps > 0) {
      if (outside)
        page_.tile(grid, "outside the law's range", fmt::format("{:.3g} %", 100 * outside->clamped / steps),
                   fmt::format("of the steps, {}; of the joints that moved", outside->name));
      else
        page_.tile(grid, "outside the law's range", "never", "of the joints that moved", "good");
    }
    if (const double mae = number(run.summary, {"comparison", "mae_mrad"}); std::isfinite(mae))
      page_.tile(grid, "error against the recording", fmt::format("{:.1f} mrad", mae),
                 fmt::format("native friction: {} mrad",
                             shown(number(run.summary, {"comparison", "baseline_mae_mrad"}), "{:.1f}")));
    if (const double left = number(run.summary, {"energy_balance_J"}); std::isfinite(left))
      page_.tile(grid, "energy balance", fmt::format("{:.2g} J", left), "what the mechanical balance leaves over");
  }

  void joint_table(pugi::xml_node to, const RunData& run) {
    page_.add(to, "h3", "Joints");
    const double steps = number(run.summary, {"steps_computed"});
    std::vector<std::vector<std::string>> rows;
    for (const auto& j : joint_figures(run))
      rows.push_back({j.name, shown(j.start_degC, "{:.1f}"), shown(j.end_degC, "{:.1f}"), shown(j.max_degC, "{:.1f}"),
                      shown(j.rms_nm, "{:.4g}"), shown(j.friction_max_nm, "{:.4g}"), shown(j.load_max, "{:.3f}"),
                      shown(100 * j.clamped / steps, "{:.3g}"), shown(j.stuck_s, "{:.1f}")});
    page_.add_table(to,
                    {"joint", "start [°C]", "end [°C]", "highest [°C]", "friction RMS [Nm]", "friction max [Nm]",
                     "load max [-]", "outside [% of steps]", "stuck [s]"},
                    rows);
    std::string still;
    for (const auto& j : run.joints)
      if (!j.moved) still += (still.empty() ? "" : ", ") + j.name;
    if (!still.empty()) page_.add(to, "p", fmt::format("Stood still: {}.", still), "soft");
  }

  Status poses(pugi::xml_node to, const RunData& run) {
    if (!run.model() || run.record.time_s.empty()) return {};
    page_.add(to, "h3", "Poses");
    auto grid = page_.add(to, "div", {}, "figures");
    PoseOptions look;
    look.text_scale = 1.4;  // the page shows them smaller than they are
    look.scale = scale_of(*run.model(), run.record, ColourBy::temperature);
    const auto failed = [&](const std::string& why) -> Status {
      notes_.push_back(why);
      page_.add(to, "p", fmt::format("The poses could not be drawn: {}", why), "bad");
      return {};
    };
    const auto model = run.scenario->model;
    auto painter = PosePainter::create(model, {1440, 960});
    if (!painter) return failed(painter.error().message);
    const std::size_t end = run.record.time_s.size() - 1;
    for (const std::size_t index : {std::size_t{0}, end}) {
      const auto image = painter->draw(recorded(*model, run.record, index), look);
      if (!image) return failed(image.error().message);
      if (auto ok =
              page_.show(grid, *image, index == end ? "pose_end" : "pose_start",
                         fmt::format("{}, at {}. Each joint's housing has the colour of its temperature.",
                                     index == end ? "The end" : "The beginning", duration(run.record.time_s[index])));
          !ok)
        return ok;
      advance(index == end ? 0.35 : 0.2);
      if (end == 0) break;
    }
    const auto sheet = contact_sheet(model, run.record, evenly_in_time(run.record.time_s, 6), look, {480, 360});
    if (!sheet) return failed(sheet.error().message);
    advance(0.5);
    return page_.show(grid, *sheet, "poses", "Poses over the run, evenly in time.", true);
  }

  Status histories(pugi::xml_node to, const RunData& run) {
    if (run.record.time_s.empty()) return {};
    page_.add(to, "h3", "Over time");
    auto grid = page_.add(to, "div", {}, "figures");
    const auto& r = run.record;
    std::vector<Trace> temperatures, friction;
    const auto column = [&](std::size_t joint, std::string_view name) -> std::span<const double> {
      for (std::size_t c = 0; c < r.cycle_channels.size(); ++c)
        if (r.cycle_channels[c].name == name) return r.cycle_values[joint][c];
      return {};
    };
    const bool cycles = r.cycle_time_s.size() > 1;
    const double window = (r.time_s.back() - r.time_s.front()) / 300;
    for (std::size_t i = 0; i < run.joints.size(); ++i) {
      const auto& j = run.joints[i];
      temperatures.push_back(thinned(j.name, cycles ? r.cycle_time_s : r.time_s,
                                     cycles ? column(i, "cycle_temperature_degC") : j.temperature_degC));
      if (!j.moved) continue;
      friction.push_back(cycles       ? thinned(j.name, r.cycle_time_s, column(i, "cycle_friction_power_W"))
                         : window > 0 ? rms_trace(j.name, r.time_s, j.friction_nm, window)
                                      : thinned(j.name, r.time_s, j.friction_nm));
    }
    std::erase_if(temperatures, [](const Trace& t) { return !any_finite(t); });
    std::erase_if(friction, [](const Trace& t) { return !any_finite(t); });
    if (!temperatures.empty())
      if (auto ok = page_.show(grid, history("Temperature", temperature_axis, temperatures), "temperature",
                               "Lubricant temperature of each joint.");
          !ok)
        return ok;
    if (!friction.empty()) {
      const Axis power{.quantity = "friction power", .symbol = "{/:Italic P}", .unit = "W"},
          torque{.quantity = "friction torque, RMS", .symbol = "{/:Italic τ}_f", .unit = "Nm"};
      if (auto ok = page_.show(
              grid, history(cycles ? "Friction power" : "Friction torque", cycles ? power : torque, friction),
              "friction",
              cycles ? "Mean friction power of each work cycle, for the joints that moved."
                     : fmt::format("Friction torque, root mean square over {}, for the joints that moved.",
                                   duration(window)));
          !ok)
        return ok;
    }
    if (auto ok = cold_and_warm(grid, run); !ok) return ok;
    return recording_errors(grid, run);
  }

  /// Friction over the first and the last work cycle of the joint that warmed most.
  Status cold_and_warm(pugi::xml_node grid, const RunData& run) {
    const auto all = stretches(run.record.time_s);
    const JointHistory* hot = nullptr;
    double most = 1;
    for (const auto& j : run.joints)
      if (j.moved && !j.temperature_degC.empty() && j.temperature_degC.back() - j.temperature_degC.front() > most)
        most = j.temperature_degC.back() - j.temperature_degC.front(), hot = &j;
    if (all.size() < 2 || !hot || hot->friction_nm.empty()) return {};
    std::vector<Trace> traces;
    const auto seconds = [&](const auto& stretch) {
      return run.record.time_s[stretch.second - 1] - run.record.time_s[stretch.first];
    };
    const double length = std::min(seconds(all.front()), seconds(all.back()));
    for (const auto& [begin, end] : {all.front(), all.back()}) {
      Trace t{
          fmt::format("{:.1f} °C, after {}", hot->temperature_degC[begin], duration(run.record.time_s[begin])), {}, {}};
      for (std::size_t i = begin; i < end && run.record.time_s[i] - run.record.time_s[begin] <= length; ++i) {
        t.time_s.push_back(run.record.time_s[i] - run.record.time_s[begin]);
        t.values.push_back(hot->friction_nm[i]);
      }
      if (any_finite(t)) traces.push_back(std::move(t));
    }
    if (traces.empty()) return {};
    return page_.show(
        grid,
        history("Cold and warm", {.quantity = "friction torque", .symbol = "{/:Italic τ}_f", .unit = "Nm"}, traces),
        "cold_and_warm", fmt::format("{}: the same motion at the beginning and at the end of the run.", hot->name));
  }

  /// Where the scenario replays a recording that measured the position.
  Status recording_errors(pugi::xml_node grid, const RunData& run) {
    if (!run.scenario || !run.scenario->recording || run.scenario->recording->measured_rad.empty() ||
        run.joints.empty())
      return {};
    const auto& set = *run.scenario->recording;
    const auto& q = run.joints[0].position_rad;
    const auto& time = run.record.time_s;
    Trace error{"twin", {}, {}};
    for (std::size_t i = 0; i < set.time_s.size(); ++i) {
      const auto after = std::ranges::lower_bound(time, set.time_s[i]);
      if (after == time.begin() || after == time.end()) continue;
      const std::size_t k = static_cast<std::size_t>(after - time.begin());
      const double w = (set.time_s[i] - time[k - 1]) / (time[k] - time[k - 1]);
      error.time_s.push_back(set.time_s[i]);
      error.values.push_back(set.measured_rad[i] - (q[k - 1] + w * (q[k] - q[k - 1])));
    }
    if (!any_finite(error)) return {};
    Figure over_time = tracking_error("Recording against twin", std::array{error});
    over_time.y = {.quantity = "recorded − simulated position", .unit = "mrad"};
    if (auto ok = page_.show(grid, over_time, "recording_error", "Recorded minus simulated joint position."); !ok)
      return ok;
    std::vector<double> mrad;
    for (const double e : error.values) mrad.push_back(1e3 * e);
    return page_.show(grid, residual_histogram("Recording against twin", over_time.y, mrad),
                      "recording_error_histogram",
                      "How often each error occurs, with the normal distribution of the same mean and deviation.");
  }

  /// Drives behind a transmission: its loop and, where it has a moving set point, how the arm follows.
  Status transmissions(pugi::xml_node to, const RunData& run) {
    pugi::xml_node grid;
    for (const auto& j : run.joints) {
      if (!has_transmission(j)) continue;
      if (!grid) {
        page_.add(to, "h3", "Transmission");
        grid = page_.add(to, "div", {}, "figures");
      }
      if (auto ok = page_.show(grid,
                               hysteresis_loop(j.name + ": torque over torsion", torsion_axis, transmission_axis,
                                               std::array{last_loop("", run, j)}),
                               "loop", "The last period of the load, or the whole run where the load has none.");
          !ok)
        return ok;
      const auto error = arm_error("", run, j);
      if (!error) continue;
      const auto& time = run.record.time_s;
      if (auto ok = page_.show(grid,
                               history(j.name + ": arm and set point", arm_axis,
                                       std::array{thinned("set point", time, j.arm_set_point_rad),
                                                  thinned("arm", time, j.arm_position_rad)}),
                               "set_point", "Angle behind the transmission and its set point.");
          !ok)
        return ok;
      if (auto ok = page_.show(grid, tracking_error(j.name + ": tracking error", std::array{*error}), "tracking_error",
                               "Set point minus angle behind the transmission.");
          !ok)
        return ok;
    }
    if (grid) transmission_tables(to, runs_.subspan(run_index_, 1));
    return {};
  }

  /// What the summaries of these runs say about their transmissions.
  void transmission_tables(pugi::xml_node to, std::span<const std::unique_ptr<RunData>> runs) {
    std::vector<std::vector<std::string>> tracking, loops;
    for (const auto& r : runs) {
      for (const auto& e : entries(*r, "tracking")) {
        const double standstill = number(e, {"standstill_pp_mrad"});  // 0: never at rest for long enough
        tracking.push_back({label(*r), shown(number(e, {"temperature_degC"}), "{:.1f}"), text(e, "compensation"),
                            shown(number(e, {"l1_mrad"}), "{:.4f}"),
                            shown(standstill > 0 ? standstill : unknown, "{:.4f}")});
      }
      for (const auto& e : entries(*r, "loops"))
        loops.push_back({label(*r), shown(number(e, {"temperature_degC"}), "{:.1f}"),
                         shown(number(e, {"frequency_hz"}), "{:g}"), shown(number(e, {"area_J"}), "{:.4g}"),
                         shown(number(e, {"torque_nm"}), "{:.5g}"),
                         shown(number(e, {"stiffness_nm_rad"}) / 1e6, "{:.4g}")});
    }
    if (!tracking.empty())
      page_.add_table(
          to, {"tracking of", "start [°C]", "compensation", "mean |error| [mrad]", "to and fro at standstill [mrad]"},
          tracking);
    if (!loops.empty())
      page_.add_table(
          to,
          {"loop of", "start [°C]", "load [Hz]", "area [J]", "largest torque [Nm]", "stiffness, end to end [MNm/rad]"},
          loops);
  }

  /// The loops of all runs in one figure; their tracking errors in one for each temperature at the start.
  Status compared_transmissions(pugi::xml_node to) {
    std::vector<Loop> loops;
    std::vector<std::pair<std::string, std::vector<Trace>>> errors;
    for (const auto& r : runs_)
      for (const auto& j : r->joints) {
        if (!has_transmission(j)) continue;
        const std::string name = r->joints.size() > 1 ? label(*r) + ", " + j.name : label(*r);
        loops.push_back(last_loop(name, *r, j));
        auto error = arm_error(name, *r, j);
        if (!error) continue;
        const std::string start = shown(j.temperature_degC.empty() ? unknown : j.temperature_degC.front(), "{:.1f} °C");
        auto group = std::ranges::find(errors, start, &decltype(errors)::value_type::first);
        if (group == errors.end()) group = errors.insert(group, {start, {}});
        group->second.push_back(std::move(*error));
      }
    if (loops.empty()) return {};
    page_.add(to, "h3", "Transmissions");
    auto grid = page_.add(to, "div", {}, "figures");
    if (auto ok =
            page_.show(grid, hysteresis_loop("Torque over torsion", torsion_axis, transmission_axis, loops),
                       "compared_loops", "The last period of each load, or the whole run where the load has none.");
        !ok)
      return ok;
    for (const auto& [start, traces] : errors)
      if (auto ok = page_.show(grid, tracking_error("Tracking error from " + start, traces), "compared_tracking_error",
                               "Set point minus angle behind the transmission.");
          !ok)
        return ok;
    transmission_tables(to, runs_);
    return {};
  }

  Status curves(pugi::xml_node to, const RunData& run) {
    if (!run.model()) return {};
    const auto joints = joint_figures(run);
    const auto* hot = warmest(joints);
    pugi::xml_node grid;
    int done = 0, count = 0;
    for (const auto& j : run.joints) count += j.moved;
    for (const auto& j : run.joints) {
      if (!j.moved) continue;
      const auto index = twin::find_drive(*run.model(), j.name);
      if (!index) continue;
      const auto& drive = run.model()->drives()[*index].drive;
      // What the joint visited while it slid.
      std::vector<FrictionPoint> all;
      std::vector<double> loads, temperatures;
      for (std::size_t i = 0; i < run.record.time_s.size() && i < j.friction_nm.size() && i < j.load_nm.size() &&
                              i < j.temperature_degC.size();
           ++i) {
        const FrictionPoint p{std::abs(j.velocity_rad_s[i]), std::abs(j.load_nm[i]) / drive.torque_max_nm,
                              j.temperature_degC[i], std::abs(j.friction_nm[i])};
        if (!(p.speed_rad_s > 0.02 * j.speed_max_rad_s &&
              std::isfinite(p.load_norm + p.temperature_degC + p.friction_nm)))
          continue;
        all.push_back(p);
        loads.push_back(p.load_norm);
        temperatures.push_back(p.temperature_degC);
      }
      if (all.empty()) continue;
      const auto [low, high] = std::ranges::minmax(temperatures);
      const double load_most = std::ranges::max(loads), load_usual = middle(loads),
                   temperature_usual = middle(temperatures);
      const double load_window = std::max(0.1 * load_most, 0.005),
                   temperature_window = std::max(0.05 * (high - low), 0.25);
      if (!grid) {
        page_.add(to, "h3", "Friction laws and what the run visited of them");
        grid = page_.add(to, "div", {}, "figures");
      }
      const auto& law = *drive.law.info;
      const std::string file = fmt::format("joint{}", *index + 1);
      const double speed = 1.05 * j.speed_max_rad_s;
      const auto any = [](const FrictionPoint&) { return true; };
      const auto at_load = [&](const FrictionPoint& p) { return std::abs(p.load_norm - load_usual) <= load_window; };
      const auto at_temperature = [&](const FrictionPoint& p) {
        return std::abs(p.temperature_degC - temperature_usual) <= temperature_window;
      };
      if (law.temperature_dependent || !law.load_dependent) {
        const auto temperatures_shown = evenly(low, high, law.temperature_dependent && high - low > 0.5 ? 7 : 1);
        const Figure figure = friction_against_temperature(
            drive, j.name + (law.temperature_dependent ? ": friction at the run's temperatures" : ": friction"), speed,
            load_usual, temperatures_shown, law.load_dependent ? some(all, at_load) : some(all, any));
        const std::string caption =
            law.load_dependent ? fmt::format(
                                     "Law '{}' at a load of {:.3f} of the maximum torque. Points: samples of the run "
                                     "with a load within {:.3f} of that.",
                                     law.name, load_usual, load_window)
                               : fmt::format("Law '{}', which knows no load. Points: samples of the run.", law.name);
        if (auto ok = page_.show(grid, figure, file + "_temperature", caption); !ok) return ok;
      }
      if (law.load_dependent) {
        const Figure figure =
            friction_against_load(drive, j.name + ": friction at the run's loads", speed, temperature_usual,
                                  evenly(0, load_most, load_most > 0.01 ? 6 : 1),
                                  law.temperature_dependent ? some(all, at_temperature) : some(all, any));
        const std::string caption =
            law.temperature_dependent
                ? fmt::format("Law '{}' at {:.1f} °C. Points: samples of the run within {:.2g} K of that.", law.name,
                              temperature_usual, temperature_window)
                : fmt::format("Law '{}', which knows no temperature. Points: samples of the run.", law.name);
        if (auto ok = page_.show(grid, figure, file + "_load", caption); !ok) return ok;
      }
      if (law.temperature_dependent && hot && hot->name == j.name && high - low > 5) {
        const Figure figure =
            friction_surface(drive, j.name + ": friction over speed and temperature", speed, load_usual, low, high);
        if (auto ok = page_.show(grid, figure, file + "_surface",
                                 fmt::format("Law '{}' at a load of {:.3f}.", law.name, load_usual));
            !ok)
          return ok;
      }
      advance(0.6 + 0.4 * ++done / count);
    }
    return {};
  }

  void provenance(pugi::xml_node to, const RunData& run) {
    page_.add(to, "h3", "Remarks of the run");
    std::size_t remarks = 0;
    for (const auto& w : entries(run, "warnings"))
      if (w.is_string()) page_.add(to, "p", w.get<std::string>()), ++remarks;
    if (remarks == 0)
      page_.add(to, "p",
                run.summary.is_object() ? "None: nothing was clamped or left out." : "Not known without a summary.",
                "soft");
    page_.add(to, "h3", "How it was made");
    const auto or_unknown = [](std::string s) { return s.empty() ? std::string("–") : s; };
    const double seed = number(run.summary, {"seed"});
    std::string version = run.attribute("engine_version");
    if (version.empty() && run.summary.contains("engine")) version = text(run.summary["engine"], "version");
    std::vector<std::vector<std::string>> rows = {
        {"engine", "MuJoCo " + or_unknown(version)},
        {"seed", run.attribute("seed").empty() ? shown(seed, "{:.0f}") : run.attribute("seed")},
        {"time step", run.attribute("timestep_s").empty() ? "–" : run.attribute("timestep_s") + " s"},
        {"steps", fmt::format("{} computed of {}", shown(number(run.summary, {"steps_computed"}), "{:.0f}"),
                              shown(number(run.summary, {"steps"}), "{:.0f}"))},
        {"samples", fmt::format("{}", run.record.time_s.size())},
        {"folder", run.directory.string()},
    };
    page_.add_table(to, {}, rows);
    page_.add(to, "p", "To reproduce the run, and this page:");
    std::filesystem::path again = (run.directory / "").parent_path();
    again += "_again";
    page_.add(to, "pre",
              fmt::format("tribotwin run {} -o {}\n{}", shell_word((run.directory / "scenario.yaml").string()),
                          shell_word(again.string()), options_.command));
    if (!run.scenario_text.empty()) {
      page_.add(to, "p", "The scenario, as it was run:");
      page_.add(to, "pre", run.scenario_text);
    }
  }

  Status one(const RunData& run) {
    auto to = page_.body();
    if (runs_.size() > 1) page_.add(to, "h2", label(run));
    if (!run.settings.empty()) page_.add(to, "p", run.settings);
    if (run.scenario && !run.scenario->description.empty()) page_.add(to, "p", run.scenario->description, "soft");
    notices(to, run);
    tiles(to, run);
    if (auto ok = poses(to, run); !ok) return ok;
    if (auto ok = histories(to, run); !ok) return ok;
    if (auto ok = transmissions(to, run); !ok) return ok;
    advance(0.6);
    if (auto ok = curves(to, run); !ok) return ok;
    joint_table(to, run);
    provenance(to, run);
    advance(1);
    return {};
  }

  /// The run's name, with its folder where names are alike.
  std::string label(const RunData& run) const {
    const auto alike = std::ranges::count_if(runs_, [&](const auto& r) { return r->name == run.name; });
    return alike > 1 ? fmt::format("{} ({})", run.name, run.directory.string()) : run.name;
  }

  Status comparison() {
    auto to = page_.body();
    page_.add(to, "h2", "Compared");
    std::vector<std::string> head{"run",
                                  "simulated [s]",
                                  "warmest joint",
                                  "highest temperature [°C]",
                                  "friction work [kJ]",
                                  "motor work [kJ]",
                                  "largest friction [Nm]",
                                  "largest load [-]",
                                  "error against recording [mrad]",
                                  "engine",
                                  "seed"};
    std::vector<std::vector<std::string>> rows;
    std::vector<Trace> temperatures, friction;
    for (const auto& r : runs_) {
      const auto joints = joint_figures(*r);
      const auto* hot = warmest(joints);
      double nm = unknown, load = unknown;
      for (const auto& j : joints) nm = std::fmax(nm, j.friction_max_nm), load = std::fmax(load, j.load_max);
      rows.push_back({label(*r), shown(simulated_s(*r), "{:.1f}"), hot ? hot->name : "",
                      hot ? shown(hot->max_degC, "{:.2f}") : "",
                      shown(number(r->summary, {"friction_work_J"}) / 1e3, "{:.5g}"),
                      shown(number(r->summary, {"motor_work_J"}) / 1e3, "{:.5g}"), shown(nm, "{:.4g}"),
                      shown(load, "{:.3f}"), shown(number(r->summary, {"comparison", "mae_mrad"}), "{:.1f}"),
                      "MuJoCo " + r->attribute("engine_version"), r->attribute("seed")});
      for (const auto& j : r->joints)
        if (hot && j.name == hot->name) {
          temperatures.push_back(thinned(label(*r) + ", " + j.name, r->record.time_s, j.temperature_degC));
          const double window = (r->record.time_s.back() - r->record.time_s.front()) / 200;
          if (window > 0)
            friction.push_back(rms_trace(label(*r) + ", " + j.name, r->record.time_s, j.friction_nm, window));
        }
    }
    for (std::size_t column = head.size(); column-- > 1;) {
      const auto at = static_cast<std::ptrdiff_t>(column);
      if (!std::ranges::all_of(rows, [column](const auto& row) { return row[column] == "–"; })) continue;
      head.erase(head.begin() + at);
      for (auto& row : rows) row.erase(row.begin() + at);
    }
    page_.add_table(to, head, rows);
    auto grid = page_.add(to, "div", {}, "figures");
    std::erase_if(temperatures, [](const Trace& t) { return !any_finite(t); });
    std::erase_if(friction, [](const Trace& t) { return !any_finite(t); });
    if (!temperatures.empty())
      if (auto ok = page_.show(grid, history("Warmest joints", temperature_axis, temperatures), "compared_temperature",
                               "The warmest joint of each run.");
          !ok)
        return ok;
    if (!friction.empty())
      if (auto ok = page_.show(
              grid,
              history("Friction of the warmest joints",
                      {.quantity = "friction torque, RMS", .symbol = "{/:Italic τ}_f", .unit = "Nm"}, friction),
              "compared_friction",
              "The same joints: friction torque, root mean square over a two hundredth of the run.");
          !ok)
        return ok;
    return compared_transmissions(to);
  }

  std::span<const std::unique_ptr<RunData>> runs_;
  const ReportOptions& options_;
  IllustratedPage page_;
  std::vector<std::string> notes_;
  std::size_t run_index_ = 0;
};

}  // namespace

Result<Report> make_report(std::span<const std::unique_ptr<RunData>> runs, const ReportOptions& options) {
  return Writer(runs, options).write();
}

}  // namespace tribotwin::render
