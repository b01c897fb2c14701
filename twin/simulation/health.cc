#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/starting_points.hpp>
#include <tribotwin/twin/simulation/health.hpp>
#include <tribotwin/twin/simulation/summary.hpp>

namespace tribotwin::twin {
namespace {

using Findings = std::vector<Finding>;

constexpr double saturated_share = 0.05;
constexpr double tracking_share = 0.05, tracking_floor = 0.02;
constexpr double ctrlrange_factor = 2;
constexpr double speed_factor = 1.1, energy_factor = 2;
constexpr double idle_share = 0.05;
constexpr double record_limit_bytes = 100e6;
constexpr std::size_t joints_named = 3;

std::string percent(double share) { return fmt::format("{:.3g} %", 100 * share); }

std::string angle_unit(const mjModel* m, const mujoco::Binding& b) { return unit_of("rad", is_slide(m, b)); }
std::string torque_unit(const mjModel* m, const mujoco::Binding& b) { return unit_of("Nm", is_slide(m, b)); }

/// Calls `each(index, binding, joint)` for the drives.
template <class Each>
void for_drives(const Examined& e, const Each& each) {
  const auto drives = e.scenario.model->drives();
  for (std::size_t i = 0; i < drives.size(); ++i) each(i, drives[i], joint_name(e.scenario.model->get(), drives[i]));
}

double share_of(const Examined& e, double steps) {
  return steps / static_cast<double>(std::max<std::int64_t>(1, e.twin->steps()));
}

void starting(const Examined& e, Findings& found) {
  for_drives(e, [&](std::size_t, const mujoco::Binding& b, const std::string& joint) {
    found.push_back({.joint = joint,
                     .value = starting_point(*e.scenario.model, b).empty() ? 0.0 : 1.0,
                     .unit = "1",
                     .threshold = 0,
                     .cause = "friction and heat are guesses, starting points of a gear class",
                     .remedy = "measure the joints, `tribotwin identify` them and add the drives again with "
                               "--params JOINT=PARAMS.yaml"});
  });
}

/// Whether the scenario moves the drives, not a master on a bus.
bool moves(const Examined& e) { return e.scenario.motion && !(e.twin && e.twin->takes_commands()); }

/// Torques without a loop around them: the motion is set points that nobody reads.
void unread_motion(const Examined& e, Findings& found) {
  const bool unread = moves(e) && std::holds_alternative<std::vector<double>>(e.scenario.control);
  found.push_back({.value = unread ? 1.0 : 0.0,
                   .unit = "1",
                   .threshold = 0,
                   .cause = "control: {type: torque} gives constant torques 100 % of the time, and nothing follows the "
                            "motion",
                   .remedy = "control: {type: servo} follows it; to watch the arm fall, take the motion out and give "
                             "start_rad"});
}

/// The speed that a joint can have in a motion of this reach, and why: the model's, or twice the energy that the
/// drive's torque can give over the whole reach. Gravity may help, and the inertia is that of one pose.
std::pair<double, std::string> possible_speed(const Examined& e, std::size_t drive, double reach) {
  const mujoco::Binding& b = e.scenario.model->drives()[drive];
  if (const auto most = joint_speed_max_rad_s(*e.scenario.model, drive))
    return {speed_factor * *most, fmt::format("the model's joint_speed_max_rad_s is {:.4g}", *most)};
  const mjModel* m = e.scenario.model->get();
  const auto [low, high] = control_range(e.scenario, drive);
  const double torque = std::max(-low, high) * std::abs(b.gear), inertia = std::max<double>(m->dof_M0[b.dof], 1e-12);
  return {std::sqrt(2 * energy_factor * torque * reach / inertia),
          fmt::format("{:.4g} {} over {:.3g} {} cannot bring it there", torque, torque_unit(m, b), reach,
                      angle_unit(m, b))};
}

void asked_speed(const Examined& e, Findings& found) {
  if (!moves(e)) return;
  for_drives(e, [&](std::size_t i, const mujoco::Binding& b, const std::string& joint) {
    const auto [low, high] = e.scenario.motion->reach_rad(i);
    const auto [possible, why] = possible_speed(e, i, high - low);
    double fast_s = 0, most = 0;
    for (const Motion::Pace& pace : e.scenario.motion->paces(i)) {
      most = std::max(most, pace.speed_rad_s);
      if (pace.speed_rad_s > possible) fast_s += pace.duration_s;
    }
    const double whole_s = e.scenario.motion->period_s() > 0 ? e.scenario.motion->period_s() : e.scenario.duration_s;
    const double share = std::min(1.0, fast_s / whole_s);
    found.push_back({.joint = joint,
                     .value = share,
                     .unit = "1",
                     .threshold = 0,
                     .cause = fmt::format("the motion asks for more speed than the drive has {} of the time, up to "
                                          "{:.3g} {}/s ({})",
                                          percent(share), most, angle_unit(e.scenario.model->get(), b), why),
                     .remedy = "check the units of the motion (degrees or milliseconds taken for rad or s?), or move "
                               "more slowly"});
  });
}

void idle(const Examined& e, Findings& found) {
  if (!moves(e)) return;
  const bool ends = e.scenario.motion->period_s() == 0 && e.scenario.motion->duration_s() > 0;  // holding goes on
  const double motion_s = e.scenario.motion->duration_s(), duration_s = e.scenario.duration_s;
  const double share = ends ? std::max(0.0, 1 - motion_s / duration_s) : 0;
  found.push_back(
      {.value = share,
       .unit = "1",
       .threshold = idle_share,
       .cause = fmt::format("the {} is over after {:.6g} of {:.6g} s, and the robot stands still {} of the "
                            "time",
                            e.scenario.recording ? "recording" : "motion", motion_s, duration_s, percent(share)),
       .remedy = fmt::format("set duration_s: {:.6g}, check the unit of the time, or say expects: [idle] "
                             "in the scenario",
                             motion_s)});
}

void saturation(const Examined& e, Findings& found) {
  if (e.twin->takes_commands()) return;  // a master may press against a stop, and chooses its limits
  for_drives(e, [&](std::size_t i, const mujoco::Binding& b, const std::string& joint) {
    const auto [low, high] = control_range(e.scenario, i);
    const double share = share_of(e, e.twin->watch().joints()[i].saturated);
    found.push_back(
        {.joint = joint,
         .value = share,
         .unit = "1",
         .threshold = saturated_share,
         .cause = fmt::format("control saturated {} of the time (limit {:.4g} {})", percent(share),
                              std::min(high, -low) * std::abs(b.gear), torque_unit(e.scenario.model->get(), b)),
         .remedy = "raise ctrlrange and forcerange to the peak torque of the real drive, or move more "
                   "slowly or with less load"});
  });
}

/// Joint turns per turn of the arm behind the joint's transmission; 1 without one.
double arm_ratio(const Examined& e, std::size_t drive) {
  for (const auto& spring : e.scenario.model->springs())
    if (drive_of(*e.scenario.model, spring) == drive) return std::abs(ratio_of(spring));
  return 1;
}

void tracking(const Examined& e, Findings& found) {
  if (!e.twin->watch().follows()) return;
  for_drives(e, [&](std::size_t i, const mujoco::Binding& b, const std::string& joint) {
    const auto [low, high] = e.scenario.motion->reach_rad(i);
    const JointWatch& w = e.twin->watch().joints()[i];
    const std::string unit = angle_unit(e.scenario.model->get(), b);
    const double rms = std::sqrt(share_of(e, w.error_squared_sum));
    const std::string of = high > low ? fmt::format("a motion of {:.3g} {} peak to peak", high - low, unit)
                                      : std::string("a joint that is to stand still");
    found.push_back({.joint = joint,
                     .value = rms,
                     .unit = unit,
                     .threshold = std::max(tracking_share * (high - low), tracking_floor * arm_ratio(e, i)),
                     .cause = fmt::format("tracking error {:.3g} {} rms, {:.3g} {} maximum, of {}", rms, unit,
                                          w.error_max, unit, of),
                     .remedy = "see saturation, limits and contacts, if they are said, else raise "
                               "control.position_gain_1_s and speed_bandwidth_rad_s or move more slowly"});
  });
}

void balance(const Examined& e, Findings& found) {
  double work_J = 0;
  for_drives(e, [&](std::size_t i, const auto&, const auto&) { work_J += e.twin->drive(i).friction_work_J; });
  const double residual_J = std::abs(e.twin->balance_J());
  found.push_back({.value = residual_J,
                   .unit = "J",
                   .threshold = std::max(balance_floor_J, balance_share * std::abs(work_J)),
                   .cause = fmt::format("the mechanical energy balance is off by {:.3g} J, {:.3g} % of the friction "
                                        "work ({:.3g} J)",
                                        residual_J, 100 * residual_J / std::max(std::abs(work_J), 1e-300), work_J),
                   .remedy = "shorten timestep_s, or remove what acts on the joints and is neither a drive nor the "
                             "friction law: damping, limits, contacts"});
}

bool pulls(const mjModel* m, int tendon, int joint) {
  const int* first = m->wrap_objid + m->tendon_adr[tendon];
  return m->wrap_type[m->tendon_adr[tendon]] == mjWRAP_JOINT &&
         std::find(first, first + m->tendon_num[tendon], joint) != first + m->tendon_num[tendon];
}

/// Damping and frictionloss of tendons on a joint; the damping of a transmission is its own.
double tendon_loss(const mujoco::Model& model, int joint) {
  double loss = 0;
  for (int t = 0; t < model->ntendon; ++t) {
    if (!pulls(model.get(), t, joint)) continue;
    const bool transmission = std::ranges::any_of(
        model.springs(), [&](const mujoco::Spring& s) { return model->actuator_trnid[2 * s.actuator] == t; });
    loss += model->tendon_frictionloss[t] + (transmission ? 0 : model->tendon_damping[t]);
  }
  return loss;
}

void damping(const Examined& e, Findings& found) {
  const mujoco::Model& model = *e.scenario.model;
  for_drives(e, [&](std::size_t, const mujoco::Binding& b, const std::string& joint) {
    const double own = model->dof_damping[b.dof], tendon = tendon_loss(model, b.joint);
    found.push_back({.joint = joint,
                     .value = own + tendon,
                     .unit = unit_of("Nm s/rad", is_slide(model.get(), b)),
                     .threshold = 0,
                     .cause = own > 0 ? fmt::format("damping=\"{:g}\" is left beside its drive", own)
                                      : "a tendon on the joint has damping or frictionloss beside its drive",
                     .remedy = own > 0 ? "set damping=\"0\" on the joint; a default class may hand it down"
                                       : "remove damping and frictionloss of the tendon"});
  });
}

/// Whether a number is a usual end of a joint's range [rad].
bool like_an_angle(double x) {
  return std::abs(x / (std::numbers::pi / 2) - std::round(x / (std::numbers::pi / 2))) < 5e-3 && std::abs(x) < 13;
}

void ctrlrange(const Examined& e, Findings& found) {
  const mjModel* m = e.scenario.model->get();
  for_drives(e, [&](std::size_t, const mujoco::Binding& b, const std::string& joint) {
    if (!m->actuator_ctrllimited[b.actuator]) return;
    const double low = m->actuator_ctrlrange[2 * b.control], high = m->actuator_ctrlrange[2 * b.control + 1],
                 gear = std::abs(b.gear), limit = std::max(0.0, std::min(high, -low)) * gear;
    const bool forced = m->actuator_forcelimited[b.actuator] != 0;
    const double torque = forced ? m->actuator_forcerange[2 * b.actuator + 1] * gear : b.drive.torque_max_nm;
    const std::string unit = torque_unit(m, b);
    found.push_back(
        {.joint = joint,
         .value = torque / std::max(limit, 1e-9),
         .unit = "1",
         .threshold = ctrlrange_factor,
         .cause = fmt::format("ctrlrange=\"{:g} {:g}\" limits the drive to {:.3g} {}, but its {} is {:.4g} {}{}", low,
                              high, limit, unit, forced ? "forcerange" : "torque_max_nm", torque, unit,
                              like_an_angle(high) ? " (the range looks like angles, as of a position actuator)" : ""),
         .remedy = fmt::format("give the actuator ctrllimited=\"true\" ctrlrange=\"{:g} {:g}\" of its own; without "
                               "them it takes those of its default class",
                               -torque / gear, torque / gear)});
  });
}

void limits(const Examined& e, Findings& found) {
  if (e.twin->takes_commands()) return;
  const mjModel* m = e.scenario.model->get();
  for_drives(e, [&](std::size_t i, const mujoco::Binding& b, const std::string& joint) {
    if (!m->jnt_limited[b.joint]) return;
    const double share = share_of(e, e.twin->watch().joints()[i].beyond_range);
    found.push_back(
        {.joint = joint,
         .value = share,
         .unit = "1",
         .threshold = 0,
         .cause = fmt::format("at an end of its range ({:.4g} .. {:.4g} {}) {} of the time", m->jnt_range[2 * b.joint],
                              m->jnt_range[2 * b.joint + 1], angle_unit(m, b), percent(share)),
         .remedy = "change start_rad, the motion or the joint's range"});
  });
}

std::string geom_text(const mjModel* m, int geom) {
  const char* name = mj_id2name(m, mjOBJ_GEOM, geom);
  if (name && *name) return fmt::format("'{}'", name);
  const char* body = mj_id2name(m, mjOBJ_BODY, m->geom_bodyid[geom]);
  return fmt::format("geom {} of body '{}'", geom, body ? body : "");
}

void contacts(const Examined& e, Findings& found) {
  if (e.twin->takes_commands()) return;
  const Watch& watch = e.twin->watch();
  std::vector<TouchedGeoms> pairs(watch.touched().begin(), watch.touched().end());
  std::ranges::stable_sort(pairs, std::ranges::greater(), &TouchedGeoms::steps);
  std::string text;
  for (std::size_t i = 0; i < std::min(pairs.size(), joints_named); ++i)
    text += fmt::format("{}{} and {} {}", i ? ", " : "", geom_text(e.scenario.model->get(), pairs[i].geom1),
                        geom_text(e.scenario.model->get(), pairs[i].geom2), percent(share_of(e, pairs[i].steps)));
  if (pairs.size() > joints_named) text += fmt::format(", and {} more pairs", pairs.size() - joints_named);
  const double share = share_of(e, watch.touched_steps());
  found.push_back(
      {.value = share,
       .unit = "1",
       .threshold = 0,
       .cause = fmt::format("the robot touches itself or its surroundings {} of the time ({})", percent(share), text),
       .remedy = "change the motion, exclude geoms that overlap by design (<contact><exclude>), or say "
                 "expects: [contacts] in the scenario"});
}

/// What left the law's range, with its bound: "temperature below 38 degC".
std::string outside_text(const drive::Drive& drive, const JointWatch& w) {
  const friction::Range& range = drive.law.range;
  std::vector<std::string> what;
  if (w.too_cold) what.push_back(fmt::format("temperature below {:g} degC", range.temperature_min_degC));
  if (w.too_hot) what.push_back(fmt::format("temperature above {:g} degC", range.temperature_max_degC));
  if (w.too_fast) what.push_back(fmt::format("speed above {:g} rad/s", range.speed_max_rad_s));
  if (w.overloaded) what.push_back(fmt::format("load above {:g}", range.load_max));
  return joined(what);
}

void law_range(const Examined& e, Findings& found) {
  for_drives(e, [&](std::size_t i, const mujoco::Binding& b, const std::string& joint) {
    const double share = share_of(e, e.twin->drive(i).steps_outside);
    const bool extrapolates = b.drive.law.validity == friction::Validity::extrapolate;
    found.push_back(
        {.joint = joint,
         .value = share,
         .unit = "1",
         .threshold = 0,
         .cause = fmt::format("{} of the time outside the range in which law '{}' was identified ({})", percent(share),
                              b.drive.law.info->name, outside_text(b.drive, e.twin->watch().joints()[i])),
         .remedy = extrapolates ? "identify the law there (its formula is extrapolated now), or accept it"
                                : "identify the law there (its value at the edge is used now), or accept "
                                  "it"});
  });
}

void record_size(const Examined& e, Findings& found) {
  if (e.record_bytes == 0) return;
  const double rate_hz = e.scenario.telemetry_rate_hz * record_limit_bytes / e.record_bytes,
               digit = std::pow(10, std::floor(std::log10(rate_hz))), lower_hz = std::floor(rate_hz / digit) * digit;
  const bool repeats = e.scenario.motion && e.scenario.motion->period_s() > 0 && !e.scenario.multirate.enabled;
  found.push_back(
      {.value = e.record_bytes,
       .unit = "byte",
       .threshold = record_limit_bytes,
       .cause = fmt::format("telemetry.h5 takes {:.3g} MB at telemetry_rate_hz: {:g}", e.record_bytes / 1e6,
                            e.scenario.telemetry_rate_hz),
       .remedy = fmt::format("{}telemetry_rate_hz: {:g} takes {:.3g} MB",
                             repeats ? "the motion repeats: multirate: {tolerance_K: 2} computes and records few of "
                                       "its cycles; "
                                     : "",
                             lower_hz, e.record_bytes / 1e6 * lower_hz / e.scenario.telemetry_rate_hz)});
}

void engine(const Examined& e, Findings& found) {
  int count = 0;
  std::string text;
  for (int w = 0; w < mjNWARNING; ++w)
    if (const auto& warning = e.twin->data()->warning[w]; warning.number > 0) {
      text +=
          (text.empty() ? "" : ", ") +
          fmt::format("'{}' {} times", mju_warningText(w, static_cast<std::size_t>(warning.lastinfo)), warning.number);
      count += warning.number;
    }
  found.push_back({.value = static_cast<double>(count),
                   .unit = "1",
                   .threshold = 0,
                   .cause = fmt::format("the engine warned: {}", text),
                   .remedy = "give the model more room (<size nconmax njmax memory>), or fewer contacts"});
}

// The order is that of the report: the model first, because what is wrong there causes what follows.
constexpr HealthCheck table[] = {
    {"ctrlrange", "torque limit (forcerange, else torque_max_nm) / ctrlrange, per joint [-]",
     "2: a drive that may deliver less than half of its torque has a range that was made for something else",
     "the drive cannot deliver its torque, and the arm sags or stands still", Verdict::warning, true, ctrlrange},
    {"damping", "damping of the joint, damping and frictionloss of tendons on it [Nm s/rad, Nm; slides N s/m, N]",
     "0: the law holds the whole friction, and native losses heat nothing",
     "friction is counted twice, and the share of the damping becomes no heat", Verdict::warning, true, damping},
    {"control", "whether the scenario has a motion that its control does not follow (1) or not (0)",
     "0: torques without a loop around them follow nothing", "the joints go where torque and gravity take them",
     Verdict::warning, true, unread_motion},
    {"speed", "share of the time in which the motion asks for more speed than the drive has, per joint [-]",
     "0: the model's joint_speed_max_rad_s and 10 %, or, without it, twice the energy that the torque limit can give "
     "the joint over the motion's reach",
     "the joint cannot follow; torques and heat are not those of the motion", Verdict::warning, true, asked_speed},
    {"idle", "share of the time after the end of a motion that does not repeat [-]",
     "0.05: a run ends about when its motion does", "temperatures and work are those of a robot that stands still",
     Verdict::warning, true, idle},
    {"record_size", "predicted size of telemetry.h5 [byte]", "100 MB: larger files are slow to copy and to plot",
     "the record is large", Verdict::note, true, record_size},
    {"saturation", "share of the time with the control at ctrlrange or a torque limit, per joint [-]",
     "0.05: set points that jump saturate a servo for moments; a planned motion leaves it reserve",
     "the arm does not follow its motion", Verdict::warning, false, saturation},
    {"tracking", "rms of set point - position, per joint [rad, m]",
     "5 % of the motion's peak-to-peak value, at least 0.02 (behind a transmission: of the arm): a servo that works "
     "stays well below",
     "loads, speeds and temperatures are those of another motion", Verdict::warning, false, tracking},
    {"limits", "share of the time past an end of the joint's range, per joint [-]",
     "0: a stop takes load and energy that a gear would have to carry",
     "a stop carries the joint, and its impact is not friction", Verdict::warning, false, limits},
    {"contacts", "share of the time in which the robot touches itself or what does not move [-]",
     "0: one touch is a collision. Objects that move, fingers that no drive moves against each other, and the ground "
     "of a robot that is not fixed do not count",
     "contact forces load the drives and take energy", Verdict::warning, false, contacts},
    {"balance", "residual of the mechanical energy balance [J]",
     "1 % of the friction work, at least 1 mJ: a run that works stays below 0.1 %",
     "work goes where no drive and no law accounts for it", Verdict::warning, false, balance},
    {"law_range", "share of the time outside the range of the law, per joint [-]",
     "0: there nobody measured; the law's key validity says what happens",
     "friction there is not backed by measurements", Verdict::note, false, law_range},
    {"starting_points",
     "whether the drive has the parameters of a gear class (1), as add-drives gives them, or its own (0), per joint",
     "0: friction differs by tens of percent from one actuator to the next. A note, because the run is as asked",
     "torques, heat and temperatures may be off by tens of percent", Verdict::note, false, starting},
    {"engine", "warnings of the engine (mjData.warning) that do not end the run [-]",
     "0: full buffers leave contacts out. What is not finite ends the run", "forces were left out", Verdict::warning,
     false, engine},
};

/// "joint1: CAUSE; joint2: CAUSE", joints of one cause together, the first three causes.
std::string causes(std::span<const Finding* const> group) {
  std::vector<std::pair<std::string, std::vector<std::string>>> by_cause;
  for (const Finding* f : group) {
    auto known = std::ranges::find(by_cause, f->cause, &decltype(by_cause)::value_type::first);
    if (known == by_cause.end()) known = by_cause.insert(known, {f->cause, {}});
    known->second.push_back(f->joint);
  }
  std::string text;
  std::size_t left = 0;
  for (std::size_t i = 0; i < by_cause.size(); ++i) {
    const auto& [cause, joints] = by_cause[i];
    if (i >= joints_named) {
      left += joints.size();
      continue;
    }
    text += (i ? "; " : "") + (joints.front().empty() ? cause : joined(joints) + ": " + cause);
  }
  if (left > 0) text += fmt::format("; and {} more joint{}", left, left == 1 ? "" : "s");
  return text;
}

}  // namespace

std::string_view name(Verdict verdict) {
  constexpr std::string_view names[] = {"ok", "note", "expected", "warning"};
  return names[static_cast<std::size_t>(verdict)];
}

std::span<const HealthCheck> health_checks() { return table; }

std::vector<Finding> examine(const Examined& examined) {
  std::vector<Finding> all;
  const auto& expects = examined.scenario.expects;
  for (const HealthCheck& check : table) {
    if (!examined.twin && !check.before_run) continue;
    const std::size_t first = all.size();
    check.examine(examined, all);
    for (Finding& f : std::span(all).subspan(first)) {
      f.check = check.name;
      if (f.value <= f.threshold) {
        f.cause.clear();
        f.remedy.clear();
        continue;
      }
      f.effect = check.effect;
      f.verdict = std::ranges::find(expects, check.name) != expects.end() ? Verdict::expected : check.verdict;
    }
  }
  return all;
}

std::vector<HealthLine> health_lines(std::span<const Finding> findings) {
  std::vector<HealthLine> lines;
  const auto said = [](const Finding& f) { return f.verdict == Verdict::note || f.verdict == Verdict::warning; };
  for (std::size_t first = 0; first < findings.size();) {
    std::vector<const Finding*> group;
    const std::size_t begin = first;
    for (; first < findings.size() && findings[first].check == findings[begin].check; ++first)
      if (said(findings[first])) group.push_back(&findings[first]);
    if (group.empty()) continue;
    std::ranges::stable_sort(group, std::ranges::greater(), &Finding::value);
    const Finding& worst = *group[0];
    const bool same = std::ranges::all_of(group, [&](const Finding* f) { return f->remedy == worst.remedy; });
    lines.push_back(
        {worst.check, worst.verdict,
         fmt::format("{}: {}; {}{}", causes(group), worst.effect, same ? "" : worst.joint + ": ", worst.remedy)});
  }
  return lines;
}

bool as_asked(std::span<const Finding> findings) {
  return std::ranges::none_of(findings, [](const Finding& f) { return f.verdict == Verdict::warning; });
}

std::string health_markdown() {
  std::string text = "| check | measured | ok up to | else | verdict |\n|---|---|---|---|---|\n";
  for (const HealthCheck& c : table)
    text += fmt::format("| `{}` | {} | {} | {} | {} |\n", c.name, c.measured, c.threshold, c.effect, name(c.verdict));
  return text;
}

}  // namespace tribotwin::twin
