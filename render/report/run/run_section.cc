#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/render/pose/pose.hpp>
#include <tribotwin/render/process/child.hpp>
#include <tribotwin/render/report/run/health.hpp>
#include <tribotwin/render/report/run/histories.hpp>
#include <tribotwin/render/report/run/run_section.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/report/run/transmissions.hpp>
#include <tribotwin/render/report/run/visited_law.hpp>
#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {
namespace {

std::string energy(double joule) {
  for (const auto& [unit, size] : {std::pair{"MJ", 1e6}, {"kJ", 1e3}})
    if (std::abs(joule) >= size) return fmt::format("{:.3g} {}", joule / size, unit);
  return shown(joule, "{:.3g} J");
}

class Section {
 public:
  Section(IllustratedPage& page, const Runs& runs, std::size_t index, std::vector<std::string>& notes,
          const std::function<void(double)>& progress)
      : page_(page),
        to_(page.body()),
        runs_(runs),
        index_(index),
        run_(*runs.all[index]),
        joints_(joint_summaries(run_)),
        notes_(notes),
        progress_(progress) {}

  Result<void> write(const std::string& command_line) {
    head();
    add_verdict(to_, run_);
    tiles();
    for (const auto part : {&Section::poses, &Section::histories, &Section::transmissions, &Section::laws})
      if (auto ok = (this->*part)(); !ok) return ok;
    joint_table();
    add_health_table(to_, run_);
    remarks();
    origin(command_line);
    progress_(1);
    return {};
  }

 private:
  void head() {
    if (runs_.all.size() > 1) page_.add(to_, "h2", runs_.label(run_));
    if (!run_.settings.empty()) page_.add(to_, "p", run_.settings);
    if (run_.scenario && !run_.scenario->description.empty()) page_.add(to_, "p", run_.scenario->description, "soft");
    if (run_.missing.empty()) return;
    auto box = page_.add(to_, "div", {}, "notice");
    for (const auto& what : run_.missing) {
      page_.add(box, "p", what);
      notes_.push_back(what);
    }
  }

  void tiles() {
    auto grid = page_.add(to_, "div", {}, "tiles");
    const double rate = number(run_.summary, {"realtime_factor"});
    const double simulated = simulated_s(run_);
    page_.tile(grid, "simulated", simulated > 7200 ? fmt::format("{:.2f} h", simulated / 3600) : duration(simulated),
               std::isfinite(rate) ? fmt::format("{:.0f} x real time", rate) : "");
    if (const auto* hot = warmest(joints_))
      page_.tile(grid, "warmest joint", fmt::format("{:.1f} °C", hot->max_degC),
                 fmt::format("{}, from {:.1f} °C", hot->name, hot->start_degC));
    if (const double work = number(run_.summary, {"friction_work_J"}); std::isfinite(work))
      page_.tile(grid, "friction loss", energy(work),
                 fmt::format("of {} motor work", energy(number(run_.summary, {"motor_work_J"}))));
    load_tiles(grid);
    if (const double mae = number(run_.summary, {"comparison", "mae_mrad"}); std::isfinite(mae))
      page_.tile(grid, "error against the recording", fmt::format("{:.1f} mrad", mae),
                 fmt::format("native friction: {} mrad",
                             shown(number(run_.summary, {"comparison", "baseline_mae_mrad"}), "{:.1f}")));
    if (const double left = number(run_.summary, {"energy_balance_J"}); std::isfinite(left))
      page_.tile(grid, "energy balance", fmt::format("{:.2g} J", left), "residual of the mechanical energy");
  }

  /// The largest load, and how often a joint was outside the range of its law.
  void load_tiles(pugi::xml_node grid) {
    const JointSummary *loaded = nullptr, *outside = nullptr;
    for (const auto& j : joints_) {
      if (std::isfinite(j.load_max) && (!loaded || j.load_max > loaded->load_max)) loaded = &j;
      const auto history = std::ranges::find(run_.joints, j.name, &JointHistory::name);
      const bool moved = history == run_.joints.end() || history->moved;
      if (moved && j.clamped_samples > 0 && (!outside || j.clamped_samples > outside->clamped_samples)) outside = &j;
    }
    if (loaded)
      page_.tile(grid, "maximum load", fmt::format("{:.0f} %", 100 * loaded->load_max),
                 fmt::format("of the maximum torque, {}", loaded->name));
    const std::size_t guessed = starting_points(run_);
    if (guessed > 0)
      page_.tile(grid, "friction and heat", "guessed",
                 fmt::format("of {} of {} joints: starting points of a gear class", guessed, joints_.size()), "bad");
    const double steps = number(run_.summary, {"steps_computed"});
    if (!(steps > 0)) return;
    if (outside)
      page_.tile(grid, "outside the law's range", fmt::format("{:.3g} %", 100 * outside->clamped_samples / steps),
                 fmt::format("of the steps, {}; of the joints that moved", outside->name));
    else
      page_.tile(
          grid, "outside the law's range", "never",
          guessed > 0 ? "of the joints that moved; the range is that of a gear class" : "of the joints that moved",
          guessed > 0 ? "" : "good");
  }

  /// The first and the last sample, and a contact sheet. Where the model cannot be drawn, the page says why.
  Result<void> poses() {
    if (!run_.model() || run_.record.time_s.empty()) return {};
    page_.add(to_, "h3", "Poses");
    auto grid = page_.add(to_, "div", {}, "figures");
    PoseOptions look;
    look.text_scale = 1.4;  // the page shows them smaller than they are
    look.scale = scale_of(*run_.model(), run_.record, ColourBy::temperature);
    look.view.whole = outline(*run_.model(), run_.record);
    const auto failed = [&](const std::string& why) -> Result<void> {
      notes_.push_back(why);
      page_.add(to_, "p", fmt::format("The poses could not be drawn: {}", why), "bad");
      return {};
    };
    const auto model = run_.scenario->model;
    auto painter = PosePainter::create(model, {1440, 960});
    if (!painter) return failed(painter.error().message);
    const std::size_t end = run_.record.time_s.size() - 1;
    for (const std::size_t index : {std::size_t{0}, end}) {
      const PoseState state = recorded(*model, run_.record, index);
      const auto image = painter->draw(state, look);
      if (!image) return failed(image.error().message);
      std::string caption =
          fmt::format("{}, at {}. Each joint's housing has the colour of its temperature.",
                      index == end ? "The end" : "The beginning", duration(run_.record.time_s[index]));
      if (const auto beyond = beyond_range(*model, state); !beyond.empty())
        caption += fmt::format(" Beyond its range: {}.", beyond);
      if (auto ok = page_.show(grid, *image, index == end ? "pose_end" : "pose_start", caption); !ok) return ok;
      progress_(index == end ? 0.35 : 0.2);
      if (end == 0) break;
    }
    const auto sheet = contact_sheet(model, run_.record, evenly_in_time(run_.record.time_s, 6), look, {480, 360});
    if (!sheet) return failed(sheet.error().message);
    progress_(0.5);
    return page_.show(grid, *sheet, "poses", "Poses over the run, evenly in time.", true);
  }

  Result<void> histories() {
    if (run_.record.time_s.empty()) return {};
    page_.add(to_, "h3", "Over time");
    return show_table(page_, page_.add(to_, "div", {}, "figures"), history_figures(), {}, run_);
  }

  Result<void> transmissions() {
    pugi::xml_node grid;
    for (const auto& j : run_.joints) {
      if (!has_transmission(j)) continue;
      if (!grid) {
        page_.add(to_, "h3", "Transmission");
        grid = page_.add(to_, "div", {}, "figures");
      }
      const FigurePrefix prefix{.name = "", .title = j.name + ": "};
      if (auto ok = show_table(page_, grid, transmission_figures(), prefix, run_, j); !ok) return ok;
    }
    if (grid)
      add_transmission_tables(page_, to_, runs_.all.subspan(index_, 1),
                              [&](const RunData& run) { return runs_.label(run); });
    progress_(0.6);
    return {};
  }

  Result<void> laws() {
    if (!run_.model()) return {};
    pugi::xml_node grid;
    int done = 0;
    const auto count = static_cast<double>(std::ranges::count_if(run_.joints, &JointHistory::moved));
    for (const auto& j : run_.joints) {
      const auto visited = visited_law(run_, j);
      if (!visited) continue;
      if (!grid) {
        page_.add(to_, "h3", "Friction laws and the samples of the run");
        grid = page_.add(to_, "div", {}, "figures");
      }
      const FigurePrefix prefix{.name = fmt::format("joint{}_", visited->number), .title = j.name + ": "};
      if (auto ok = show_table(page_, grid, law_figures(), prefix, *visited); !ok) return ok;
      progress_(0.6 + 0.4 * ++done / count);
    }
    return {};
  }

  void joint_table() {
    page_.add(to_, "h3", "Joints");
    const double steps = number(run_.summary, {"steps_computed"});
    const std::string unit = force_unit(run_.joints, [](const JointHistory&) { return true; });
    std::vector<std::vector<std::string>> rows;
    for (const auto& j : joints_)
      rows.push_back({j.name, shown(j.start_degC, "{:.1f}"), shown(j.end_degC, "{:.1f}"), shown(j.max_degC, "{:.1f}"),
                      shown(j.friction_rms_nm, "{:.4g}"), shown(j.friction_max_nm, "{:.4g}"),
                      shown(j.load_max, "{:.3f}"), shown(100 * j.clamped_samples / steps, "{:.3g}"),
                      shown(j.stuck_s, "{:.1f}")});
    page_.add_table(to_,
                    {"joint", "start [°C]", "end [°C]", "maximum [°C]", fmt::format("friction RMS [{}]", unit),
                     fmt::format("friction max [{}]", unit), "load max [-]", "outside [% of steps]", "stuck [s]"},
                    rows);
    std::string still;
    for (const auto& j : run_.joints)
      if (!j.moved) still += (still.empty() ? "" : ", ") + j.name;
    if (!still.empty()) page_.add(to_, "p", fmt::format("Stood still: {}.", still), "soft");
  }

  void remarks() {
    page_.add(to_, "h3", "Remarks of the run");
    const auto others = other_warnings(run_);
    for (const auto& warning : others) page_.add(to_, "p", warning);
    if (others.empty())
      page_.add(to_, "p", run_.summary.is_object() ? "None." : "Not known without a summary.", "soft");
  }

  void origin(const std::string& command_line) {
    page_.add(to_, "h3", "How it was made");
    const auto or_unknown = [](const std::string& s) { return s.empty() ? "–" : s; };
    std::string version = run_.attribute("engine_version");
    if (version.empty() && run_.summary.contains("engine")) version = text(run_.summary["engine"], "version");
    const std::string step = run_.attribute("timestep_s"), seed = run_.attribute("seed");
    page_.add_table(
        to_, {},
        {{"engine", "MuJoCo " + or_unknown(version)},
         {"seed", seed.empty() ? shown(number(run_.summary, {"seed"}), "{:.0f}") : seed},
         {"time step", step.empty() ? "–" : step + " s"},
         {"steps", fmt::format("{} computed of {}", shown(number(run_.summary, {"steps_computed"}), "{:.0f}"),
                               shown(number(run_.summary, {"steps"}), "{:.0f}"))},
         {"samples", fmt::format("{}", run_.record.time_s.size())},
         {"folder", run_.directory.string()}});
    page_.add(to_, "p", "To reproduce the run, and this page:");
    std::filesystem::path again = (run_.directory / "").parent_path();
    again += "_again";
    page_.add(to_, "pre",
              fmt::format("tribotwin run {} -o {}\n{}", shell_word((run_.directory / "scenario.yaml").string()),
                          shell_word(again.string()), command_line));
    if (run_.scenario_text.empty()) return;
    page_.add(to_, "p", "The scenario, as it was run:");
    page_.add(to_, "pre", run_.scenario_text);
  }

  IllustratedPage& page_;
  pugi::xml_node to_;
  const Runs& runs_;
  std::size_t index_;
  const RunData& run_;
  const std::vector<JointSummary> joints_;
  std::vector<std::string>& notes_;
  const std::function<void(double)>& progress_;
};

}  // namespace

Result<void> add_run(IllustratedPage& page, const Runs& runs, std::size_t index, const std::string& command_line,
                     std::vector<std::string>& notes, const std::function<void(double)>& progress) {
  return Section(page, runs, index, notes, progress).write(command_line);
}

}  // namespace tribotwin::render
