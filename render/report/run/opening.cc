#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/report/record/cycles.hpp>
#include <tribotwin/render/report/run/differences.hpp>
#include <tribotwin/render/report/run/health.hpp>
#include <tribotwin/render/report/run/run_section.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {
namespace {

constexpr double watched_share = 0.05;  ///< of friction: more is amber
constexpr double same_share = 0.005;    ///< of friction: less would be written as 0 %

/// Less is what a drive that stands still, or has just begun, works [J]; its digits say nothing.
constexpr double no_work_J = 1e-9;

std::string energy(double joule) {
  if (std::abs(joule) < no_work_J) return "0 J";
  const auto [unit, size] = energy_unit(joule);
  return std::isfinite(joule) ? digits(joule / size, 3) + " " + unit : "–";
}

/// A motor that is off, or carries nothing, does no work that friction could have a share of; nor do motors that brake
/// more than they drive.
std::string of_motor_work(double joule, double motor_joule) {
  if (std::abs(motor_joule) <= std::max(no_work_J, 1e-9 * std::abs(joule))) return "without work of the motors";
  if (motor_joule < 0) return fmt::format("while the motors brake more than they drive, by {}", energy(-motor_joule));
  return fmt::format("{} % of {} motor work{}", digits(100 * joule / motor_joule, 3), energy(motor_joule),
                     joule > motor_joule * 1.005 ? ", as gravity or stored energy drives, too" : "");
}

struct Change {
  std::string what, unit;
  double from, to;
};

/// Friction of a joint at the beginning and at the end: power of the first and the last work cycle, else root mean
/// squares. Nothing where either is not known.
std::optional<Change> friction_change(const RunData& run, const std::string& name) {
  const auto joint = std::ranges::find(run.joints, name, &JointHistory::name);
  if (joint == run.joints.end() || run.record.time_s.empty()) return std::nullopt;
  const bool cycles = has_cycles(run);
  const Trace t = cycles ? friction_power("", run, *joint) : friction_rms("", run, *joint);
  const auto finite = [](double v) { return std::isfinite(v); };
  const auto first = std::ranges::find_if(t.values, finite);
  const auto last = std::find_if(t.values.rbegin(), t.values.rend(), finite);
  if (first == t.values.end() || !(*first > 0) || t.values.size() < 3) return std::nullopt;
  return Change{cycles ? "friction power" : "friction (RMS)", cycles ? "W" : joint->slide ? "N" : "Nm", *first, *last};
}

/// Of a run that repeats a recording, how near it comes; empty where it repeats none.
std::string against_recording(const RunData& run) {
  const double mae = number(run.summary, {"comparison", "mae_mrad"}),
               native = number(run.summary, {"comparison", "baseline_mae_mrad"});
  if (!std::isfinite(mae)) return "";
  return fmt::format("The twin is {:.1f} mrad from the recording (mean absolute error{})", mae,
                     std::isfinite(native) ? fmt::format("; with native friction {:.1f} mrad", native) : "");
}

std::string sentence(const RunData& run, const std::vector<JointSummary>& joints) {
  const JointSummary* hot = most_warmed(run, joints);
  if (!hot) {
    if (const auto error = against_recording(run); !error.empty()) return error + "; no joint warms by more than 1 K.";
    const double work = number(run.summary, {"friction_work_J"}), motor = number(run.summary, {"motor_work_J"});
    return "No joint warms by more than 1 K" +
           (std::isfinite(work + motor)
                ? fmt::format("; friction takes {}, {}.", energy(work), of_motor_work(work, motor))
                : std::string("."));
  }
  const auto warms = fmt::format("{} warms from {:.1f} to {:.1f} °C", hot->name, hot->start_degC, hot->end_degC);
  const auto friction = friction_change(run, hot->name);
  if (!friction) return warms + ".";
  const double share = friction->to / friction->from - 1;
  if (std::abs(share) < same_share)
    return fmt::format("{}, and its {} stays at {} {}.", warms, friction->what, digits(friction->to, 3),
                       friction->unit);
  return fmt::format("{}, and its {} {} from {} to {} {} ({:+.0f} %).", warms, friction->what,
                     share < 0 ? "falls" : "rises", digits(friction->from, 3), digits(friction->to, 3), friction->unit,
                     100 * share);
}

void add_load(std::vector<Tile>& tiles, const std::vector<JointSummary>& joints) {
  const JointSummary* loaded = nullptr;
  for (const auto& j : joints)
    if (std::isfinite(j.load_max) && (!loaded || j.load_max > loaded->load_max)) loaded = &j;
  if (loaded)
    tiles.push_back({"maximum load",
                     loaded->load_max < 10 ? fmt::format("{:.0f} %", 100 * loaded->load_max)
                                           : fmt::format("{} times", digits(loaded->load_max, 3)),
                     fmt::format("{}the maximum torque, {}", loaded->load_max < 10 ? "of " : "", loaded->name)});
}

/// At most five.
std::vector<Tile> tiles_of(const RunData& run, const std::vector<JointSummary>& joints) {
  std::vector<Tile> tiles;
  if (const std::size_t guessed = starting_points(run); guessed > 0)
    tiles.push_back({"friction and heat", "guessed",
                     fmt::format("of {} of {} joints: starting points of a gear class", guessed, joints.size()),
                     "bad"});
  const JointSummary* hot = most_warmed(run, joints);
  if (const auto friction = hot ? friction_change(run, hot->name) : std::nullopt)
    tiles.push_back({fmt::format("{}, {}", friction->what, hot->name),
                     fmt::format("{} → {} {}", digits(friction->from, 3), digits(friction->to, 3), friction->unit),
                     change_text(friction->from, friction->to, friction->unit)});
  if (!hot) hot = warmest(joints);
  if (hot)
    tiles.push_back({fmt::format("temperature, {}", hot->name),
                     fmt::format("{:.1f} → {:.1f} °C", hot->start_degC, hot->end_degC),
                     fmt::format("{:+.1f} K, at most {:.1f} °C", hot->end_degC - hot->start_degC, hot->max_degC)});
  if (const double work = number(run.summary, {"friction_work_J"}), motor = number(run.summary, {"motor_work_J"});
      std::isfinite(work + motor))
    tiles.push_back({"friction loss", energy(work), of_motor_work(work, motor)});
  if (const double mae = number(run.summary, {"comparison", "mae_mrad"}); std::isfinite(mae))
    tiles.push_back({"error against the recording", fmt::format("{:.1f} mrad", mae),
                     fmt::format("native friction: {} mrad",
                                 shown(number(run.summary, {"comparison", "baseline_mae_mrad"}), "{:.1f}"))});
  if (tiles.size() < 4) add_load(tiles, joints);
  const double rate = number(run.summary, {"realtime_factor"}), simulated = simulated_s(run);
  tiles.push_back({"simulated", simulated > 7200 ? fmt::format("{:.2f} h", simulated / 3600) : duration(simulated),
                   std::isfinite(rate) ? fmt::format("{:.0f} × real time", rate) : ""});
  return tiles;
}

std::vector<std::string> identity_of_run(const RunData& run, const ReportOptions& options) {
  std::string version = run.attribute("engine_version");
  if (version.empty() && run.summary.is_object() && run.summary.contains("engine"))
    version = text(run.summary["engine"], "version");
  const std::string robot = options.robot.empty() ? run.robot() : options.robot,
                    serial = options.serial_number.empty() ? run.serial_number() : options.serial_number;
  const std::string repeats = run.recording_file();
  return {robot,
          serial_number_in_words(serial),
          repeats.empty() ? "" : "recording: " + repeats,
          run.date(),
          options.software,
          version.empty() ? "" : "simulated by MuJoCo " + version};
}

/// "ctrlrange of joint2, saturation of joint2"
std::string checks_that_warn(const RunData& run) {
  std::string all;
  for (const auto& w : warnings(run))
    all += (all.empty() ? "" : ", ") + w.check + (w.joint.empty() ? "" : " of " + w.joint);
  return all;
}

}  // namespace

Opening opening_of(const RunData& run, const ReportOptions& options) {
  const auto joints = joint_summaries(run);
  Opening o{.verdict = sentence(run, joints),
            .light = Light::green,
            .rule = as_asked_text(run),
            .tiles = tiles_of(run, joints),
            .action = "nothing; the figures below show how it came about.",
            .identity = identity_of_run(run, options)};
  if (!run.damage.empty()) {
    o.verdict = "The record of this run is damaged.";
    o.light = Light::red;
    o.rule = "a record is red when a part of it cannot be read.";
    o.action = "read what is missing below, and repeat the run or recover what is whole.";
  } else if (const auto warned = warnings(run); !warned.empty()) {
    o.verdict = fmt::format("The run is not what its scenario asked for: {}.", checks_that_warn(run));
    o.light = Light::red;
    o.action = warned.front().remedy + ".";
  } else if (starting_points(run) > 0) {
    o.light = Light::amber;
    o.rule += " But friction and heat of its model are guesses.";
    o.action = "identify friction and heat of this robot before torques or temperatures are used.";
  } else if (run.unfinished()) {
    o.verdict = fmt::format("This run has not finished; so far: {}", o.verdict);
    o.light = Light::amber;
    o.rule = "a run is amber when it is still being written or was ended early: nothing is known of its health.";
    o.action = "wait for its end, or run it again; what it has written is below.";
  } else if (!run.missing.empty()) {
    o.light = Light::amber;
    o.rule = "a page is amber when something is missing.";
    o.action = "read what is missing below.";
  } else if (!has_checks(run)) {
    o.light = Light::amber;
    o.action = "run the scenario again with this version, which checks the run, before its figures are used.";
  } else if (const auto outside = joints_outside_law(run); !outside.empty()) {
    o.light = Light::amber;
    o.rule += fmt::format(" Amber, because {} left the range in which the law was measured.", outside);
    o.action = fmt::format(
        "take friction of {} as a guess where the law was left, or measure it there (tribotwin lab).", outside);
  }
  return o;
}

namespace {

/// Which robot it was changes nothing of what it does.
std::string list_of(std::vector<DifferingKey> keys) {
  const auto identity = [](const DifferingKey& k) { return k.key == "robot" || k.key == "serial_number"; };
  if (!std::ranges::all_of(keys, identity)) std::erase_if(keys, identity);
  constexpr std::size_t shown_max = 4;
  std::string all;
  for (std::size_t i = 0; i < std::min(shown_max, keys.size()); ++i) {
    std::string values;
    for (const auto& v : keys[i].values) values += (values.empty() ? "" : " → ") + v;
    all += fmt::format("{}{} ({})", i ? ", " : "", keys[i].key, values);
  }
  return keys.size() > shown_max ? fmt::format("{} and {} more", all, keys.size() - shown_max) : all;
}

/// The largest change of friction work against that of the first run.
struct WorkChange {
  std::size_t run = 0;  ///< 0: none beyond resolved_share
  double share = 0;
};

/// Of runs as long as the first; others work more or less anyhow.
WorkChange work_change(const Runs& runs) {
  const double first = number(runs.all.front()->summary, {"friction_work_J"}), s = simulated_s(*runs.all.front());
  WorkChange most;
  for (std::size_t r = 1; r < runs.all.size(); ++r)
    if (const double share = number(runs.all[r]->summary, {"friction_work_J"}) / first - 1;
        first > no_work_J && std::isfinite(share) && std::abs(simulated_s(*runs.all[r]) / s - 1) < resolved_share &&
        std::abs(share) > std::max(resolved_share, std::abs(most.share)))
      most = {r, share};
  return most;
}

/// Whether root mean squares would mislead: they hardly differ where work does, or the other way. They are ruled by how
/// large friction is, work by how far the joint moves as well.
bool work_matters_more(const WorkChange& work, const FrictionChange& most) {
  constexpr double far_more = 2;
  const bool otherwise = (work.share < 0) != (most.share() < 0);
  const bool hardly =
      std::abs(most.share()) <= watched_share && std::abs(work.share) > far_more * std::abs(most.share());
  return std::abs(work.share) > watched_share && (hardly || otherwise);
}

std::vector<Tile> tiles_of(const Runs& runs, const FrictionChange* most) {
  std::vector<Tile> tiles;
  if (!most) return tiles;
  const RunData &first = *runs.all.front(), &other = *runs.all[most->run];
  const auto which = [&](const RunData& run) {
    return runs.all.size() > 2 ? fmt::format(", {} → {}", runs.label(first), runs.label(run)) : std::string();
  };
  tiles.push_back({fmt::format("friction of {}, RMS{}", most->joint, which(other)),
                   fmt::format("{} → {} {}", digits(most->first, 4), digits(most->other, 4), most->unit),
                   change_text(most->first, most->other, most->unit)});
  const auto temperature = [&](const RunData& run) {
    for (const auto& j : joint_summaries(run))
      if (j.name == most->joint) return j.max_degC;
    return std::nan("");
  };
  if (const double a = temperature(first), b = temperature(other); std::isfinite(a + b))
    tiles.push_back({fmt::format("maximum temperature, {}{}", most->joint, which(other)),
                     fmt::format("{:.1f} → {:.1f} °C", a, b), fmt::format("{:+.1f} K", b - a)});
  const WorkChange work = work_change(runs);
  const RunData& worked = work_matters_more(work, *most) ? *runs.all[work.run] : other;
  for (const auto& [what, key] :
       {std::pair<std::string, const char*>{"friction work", "friction_work_J"}, {"motor work", "motor_work_J"}})
    if (const double a = number(first.summary, {key}), b = number(worked.summary, {key}); std::isfinite(a + b)) {
      const auto [unit, size] = energy_unit(std::max(std::abs(a), std::abs(b)));
      tiles.push_back(
          {what + which(worked), fmt::format("{} → {}", energy(a), energy(b)), change_text(a / size, b / size, unit)});
    }
  return tiles;
}

/// ", but friction work falls by 4.1 % in hotter": root mean squares may stay where power does not.
std::string changed_work(const Runs& runs, const WorkChange& work) {
  if (work.run == 0) return {};
  return fmt::format(", but friction work {} by {:.1f} % in {}", work.share < 0 ? "falls" : "rises",
                     100 * std::abs(work.share), runs.label(*runs.all[work.run]));
}

/// "Friction takes 12.6 % less work in hotter than in cold: 1.23 → 1.08 kJ"
std::string sentence_of_work(const Runs& runs, const WorkChange& work) {
  const RunData &first = *runs.all.front(), &other = *runs.all[work.run];
  const double a = number(first.summary, {"friction_work_J"}), b = number(other.summary, {"friction_work_J"});
  return fmt::format("Friction takes {:.1f} % {} work in {} than in {}: {} → {}", 100 * std::abs(work.share),
                     work.share < 0 ? "less" : "more", runs.label(other), runs.label(first), energy(a), energy(b));
}

/// "; joint3 +20.0 %, joint4 -7.1 % with a smaller change of power"; nothing where no other joint differs so much.
std::string other_joints(const Runs& runs, const std::vector<FrictionChange>& changes, const FrictionChange& most) {
  constexpr std::size_t shown_max = 3;
  const auto others = others_beyond(watched_share, changes, most);
  std::string all;
  for (std::size_t i = 0; i < std::min(shown_max, others.size()); ++i) {
    const FrictionChange* const c = others[i];
    all += fmt::format("{} {} {:+.1f} %{}", all.empty() ? ";" : ",", c->joint, 100 * c->share(),
                       c->run == most.run ? "" : " in " + runs.label(*runs.all[c->run]));
  }
  if (others.size() > shown_max) all += fmt::format(" and {} more", others.size() - shown_max);
  return all.empty() || !know_power(changes) ? all : all + " with a smaller change of power";
}

std::string sentence(const Runs& runs, const std::vector<FrictionChange>& changes, const FrictionChange* most) {
  if (!most) return "No joint moves in both runs, so that their friction cannot be compared.";
  const WorkChange work = work_change(runs);
  const bool same_friction = std::abs(most->share()) <= resolved_share;
  if (work_matters_more(work, *most))
    return sentence_of_work(runs, work) +
           (same_friction
                ? fmt::format("; no joint's friction (RMS) differs by more than {:g} %.", 100 * resolved_share)
                : fmt::format("; friction (RMS) of {} differs by {:+.1f} % in {}.", most->joint, 100 * most->share(),
                              runs.label(*runs.all[most->run])));
  if (same_friction)
    return fmt::format("No joint's friction (RMS) differs by more than {:g} % from that in {}{}.", 100 * resolved_share,
                       runs.label(*runs.all.front()), changed_work(runs, work));
  return fmt::format("{} has {} friction in {} than in {}: {} → {} {} ({}){}.", most->joint,
                     most->share() > 0 ? "more" : "less", runs.label(*runs.all[most->run]),
                     runs.label(*runs.all.front()), digits(most->first, 4), digits(most->other, 4), most->unit,
                     change_text(most->first, most->other, most->unit), other_joints(runs, changes, *most));
}

/// "hinge in more (+9.4 %), friction work in much (+11.5 %) and 2 more": what makes a comparison amber, the largest
/// first; empty where nothing does.
std::string beyond_watched(const Runs& runs, const std::vector<FrictionChange>& changes) {
  constexpr std::size_t shown_max = 3;
  std::vector<std::pair<double, std::string>> all;
  const auto add = [&](const std::string& what, std::size_t run, double share) {
    if (std::abs(share) > watched_share)
      all.emplace_back(std::abs(share),
                       fmt::format("{} in {} ({:+.1f} %)", what, runs.label(*runs.all[run]), 100 * share));
  };
  for (const FrictionChange& c : changes) add(c.joint, c.run, c.share());
  const WorkChange work = work_change(runs);
  add("friction work", work.run, work.share);
  std::ranges::stable_sort(all, std::greater{}, &std::pair<double, std::string>::first);
  std::string text;
  for (std::size_t i = 0; i < std::min(shown_max, all.size()); ++i) text += (i ? ", " : "") + all[i].second;
  return all.size() > shown_max ? fmt::format("{} and {} more", text, all.size() - shown_max) : text;
}

/// "early", "early, older": whose summaries do not say whether the run is what its scenario asked for.
std::string without_checks(const Runs& runs) {
  std::string all;
  for (const auto& run : runs.all)
    if (!has_checks(*run) && !run->unfinished()) all += (all.empty() ? "" : ", ") + runs.label(*run);
  return all;
}

}  // namespace

Opening opening_of(const Runs& runs, const ReportOptions& options) {
  const auto changes = friction_changes(runs.all);
  const FrictionChange* most = largest(changes);
  const auto keys = differing_keys(runs.all);
  Opening o{
      .verdict = sentence(runs, changes, most),
      .light = Light::green,
      .rule = fmt::format("green up to {:g} % of a joint's friction (root mean square over the run) and of friction "
                          "work, amber beyond; red when a run is not what its scenario asked for.",
                          100 * watched_share),
      .tiles = tiles_of(runs, most),
      .action = keys.empty() ? "look at models and engines: the scenarios are the same."
                             : fmt::format("see whether what was changed explains it: {}.", list_of(keys)),
      .identity = identity_of_run(*runs.all.front(), options)};
  if (const auto why = beyond_watched(runs, changes); !why.empty()) {
    o.light = Light::amber;
    o.rule += fmt::format(" Amber, because of {}.", why);
  }
  if (const auto unchecked = without_checks(runs); !unchecked.empty()) {
    o.light = Light::amber;
    o.rule += fmt::format(" Amber, because the health of {} is not known: no checks in its summary.", unchecked);
    o.action = fmt::format("run {} again with this version, which checks the run, before it is compared.", unchecked);
  }
  for (const auto& run : runs.all)
    if (run->unfinished()) {
      o.light = Light::amber;
      o.rule += fmt::format(" Amber, because {} has not finished.", runs.label(*run));
      o.action = fmt::format("wait for the end of {}, or run it again, before it is compared.", runs.label(*run));
    }
  for (const auto& run : runs.all)
    if (!run->damage.empty() || !warnings(*run).empty()) {
      o.light = Light::red;
      o.rule += fmt::format(" That is {}.", runs.label(*run));
      o.action = "see to that run first: its section below says what is wrong.";
      break;
    }
  return o;
}

}  // namespace tribotwin::render
