#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/render/pose/moment.hpp>
#include <tribotwin/render/process/child.hpp>
#include <tribotwin/render/report/run/health.hpp>
#include <tribotwin/render/report/run/histories.hpp>
#include <tribotwin/render/report/run/robot_in_3d.hpp>
#include <tribotwin/render/report/run/run_section.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/report/run/transmissions.hpp>
#include <tribotwin/render/report/run/visited_law.hpp>
#include <tribotwin/render/report/run/warm_up.hpp>
#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {
namespace {

class Section {
 public:
  Section(IllustratedPage& page, const Runs& runs, std::size_t index, std::vector<std::string>& notes,
          const std::function<void(double)>& progress)
      : page_(page),
        to_(runs.closed() ? page.add_details(page.body(), runs.label(*runs.all[index])) : page.body()),
        runs_(runs),
        index_(index),
        run_(*runs.all[index]),
        joints_(joint_summaries(run_)),
        notes_(notes),
        progress_(progress) {}

  Result<void> write(const std::string& command_line) {
    head();
    add_warnings(to_, run_);
    for (const auto part : {&Section::histories, &Section::poses, &Section::transmissions, &Section::laws})
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
    if (runs_.all.size() > 1 && !runs_.closed()) page_.add(to_, "h2", runs_.label(run_));
    if (!run_.settings.empty()) page_.add(to_, "p", run_.settings);
    if (runs_.all.size() > 1) {
      const Opening o = opening_of(run_, {});
      page_.add(to_, "p", o.verdict);
      page_.add(to_, "p", o.rule, "soft");
      auto grid = page_.add(to_, "div", {}, "tiles");
      for (const Tile& t : o.tiles) page_.tile(grid, t.name, t.value, t.more, t.kind);
    }
    if (run_.scenario && !run_.scenario->description.empty()) page_.add(to_, "p", run_.scenario->description, "soft");
    if (run_.missing.empty()) return;
    auto box = page_.add(to_, "div", {}, "notice");
    for (const auto& what : run_.missing) {
      page_.add(box, "p", what);
      notes_.push_back(what);
    }
  }

  /// The first and the last sample, and a contact sheet. Where the model cannot be drawn, the page says why.
  Result<void> poses() {
    if (!run_.model() || run_.record.time_s.empty()) return {};
    page_.add(to_, "h3", "Poses");
    PoseOptions look;
    look.text_scale = 1.4;  // the page shows them smaller than they are
    look.scale = scale_of(*run_.model(), run_.record, ColourBy::temperature);
    const Moments moments(*run_.model(), run_.record);
    if (runs_.all.size() == 1) show_robot(page_, to_, *run_.model(), moments, look.scale);
    auto grid = page_.add(to_, "div", {}, "figures");
    look.view.whole = outline(*run_.model(), run_.record);
    const auto failed = [&](const std::string& why) -> Result<void> {
      notes_.push_back(why);
      page_.add(to_, "p", fmt::format("The poses could not be drawn: {}", why), "bad");
      return {};
    };
    // Of several runs smaller ones: their pages would need as many times the bytes.
    const bool several = runs_.all.size() > 2;
    auto painter = PosePainter::create(run_.scenario->model, several ? Size{720, 480} : Size{1440, 960}, plain_quality);
    if (!painter) return failed(painter.error().message);
    for (const bool end : {false, true}) {
      const PoseState state = moments.at(end ? moments.end_s() : moments.begin_s());
      const auto image = painter->draw(state, look);
      if (!image) return failed(image.error().message);
      if (auto ok = page_.show(grid, *image, end ? "pose_end" : "pose_start", pose_caption(state, end)); !ok) return ok;
      progress_(end ? 0.35 : 0.2);
      if (moments.end_s() == moments.begin_s()) break;
    }
    const auto states = moments.evenly(6);
    painter->resize(several ? Size{320, 240} : Size{480, 360});
    const auto sheet = contact_sheet(*painter, states, look);
    if (!sheet) return failed(sheet.error().message);
    progress_(0.5);
    return page_.show(grid, *sheet, "poses", sheet_caption(states), Width::wide);
  }

  /// Says what was drawn: a housing is coloured where its temperature is known.
  std::string pose_caption(const PoseState& state, bool end) const {
    std::string caption = fmt::format("{}, at {}.", end ? "The end" : "The beginning", duration(*state.time_s));
    if (std::ranges::any_of(state.joints, [](const JointState& j) { return std::isfinite(j.temperature_degC); }))
      caption += " Each joint's housing has the colour of its temperature.";
    if (const auto beyond = beyond_range(*run_.model(), state); !beyond.empty())
      caption += fmt::format(" Beyond its range: {}.", beyond);
    return caption;
  }

  static std::string sheet_caption(const std::vector<PoseState>& states) {
    if (states.size() == 1) return fmt::format("The only pose of the run, at {}.", duration(*states.front().time_s));
    return fmt::format("{} poses over the run, evenly in time from {} to {}.", states.size(),
                       duration(*states.front().time_s), duration(*states.back().time_s));
  }

  Result<void> histories() {
    if (run_.record.time_s.empty()) return {};
    page_.add(to_, "h3", "Over time");
    auto grid = page_.add(to_, "div", {}, "figures");
    if (auto ok = show_table(page_, grid, history_figures(), {}, run_); !ok) return ok;
    return runs_.all.size() == 1 ? show_warm_up(page_, grid, run_) : Result<void>{};  // several have another question
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
    pugi::xml_node section, grid;
    const auto joints_with_law = static_cast<std::size_t>(std::ranges::count_if(run_.joints, &JointHistory::moved));
    int done = 0;
    const auto count = static_cast<double>(std::ranges::count_if(run_.joints, &JointHistory::moved));
    for (const auto& j : run_.joints) {
      const auto visited = visited_law(run_, j);
      if (!visited) continue;
      if (!section) section = page_.add(to_, "h3", "Friction laws and the samples of the run");
      const bool open = visited->warmest || joints_with_law == 1;
      grid = page_.add(open ? to_ : page_.add_details(to_, "Law and samples of " + j.name), "div", {}, "figures");
      const FigurePrefix prefix{.name = fmt::format("joint{}_", visited->number), .title = j.name + ": "};
      if (auto ok = show_table(page_, grid, law_figures(), prefix, *visited); !ok) return ok;
      progress_(0.6 + 0.4 * ++done / count);
    }
    return {};
  }

  /// To a thousandth of the joint's torque; what is far below it is no friction but the integrator's.
  std::string friction(const JointSummary& j, double nm) const {
    const auto history = std::ranges::find(run_.joints, j.name, &JointHistory::name);
    const bool nothing = history != run_.joints.end() && std::abs(nm) < 1e-9 * history->torque_max_nm;
    return nothing ? "0" : shown(nm, 4);
  }

  void joint_table() {
    page_.add(to_, "h3", "Joints");
    const std::string unit = force_unit(run_.joints, [](const JointHistory&) { return true; });
    std::vector<std::vector<std::string>> rows;
    for (const auto& j : joints_)
      rows.push_back({j.name, shown(j.start_degC, "{:.1f}"), shown(j.end_degC, "{:.1f}"), shown(j.max_degC, "{:.1f}"),
                      friction(j, j.friction_rms_nm), friction(j, j.friction_max_nm), load_text(j.load_max),
                      shown(100 * j.outside_share, "{:.3g}"), shown(100 * j.stuck_share, "{:.3g}")});
    page_.add_table(
        to_,
        {"joint", "start [°C]", "end [°C]", "maximum [°C]", fmt::format("friction RMS [{}]", unit),
         fmt::format("friction max [{}]", unit), "load max [-]", "outside [% of time]", "stuck [% of time]"},
        rows);
    page_.add(to_, "p", "Outside: of the range of its law. Stuck: held by friction.", "soft");
    std::string still;
    for (const auto& j : run_.joints)
      if (!j.moved) still += (still.empty() ? "" : ", ") + j.name;
    if (!still.empty()) page_.add(to_, "p", fmt::format("Stood still: {}.", still), "soft");
  }

  void remarks() {
    page_.add(to_, "h3", "Remarks of the run");
    auto others = other_warnings(run_);
    std::ranges::move(health_notes(run_), std::back_inserter(others));
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
         {"folder", shown_folder(run_.directory)}});
    page_.add(to_, "p", "To reproduce the run, and this page:");
    const std::string folder = shown_folder(run_.directory);
    page_.add(to_, "pre",
              fmt::format("tribotwin run {} -o {}\n{}", shell_word(folder + "/scenario.yaml"),
                          shell_word(folder + "_again"), without_folders(command_line)));
    if (run_.scenario_text.empty()) return;
    auto scenario = page_.add_details(to_, "The scenario, as it was run");
    page_.add(scenario, "pre", without_folders(run_.scenario_text));
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
