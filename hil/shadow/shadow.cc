#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/can/record_file.hpp>
#include <tribotwin/hil/canopen/sync.hpp>
#include <tribotwin/hil/motion/sync_mean.hpp>
#include <tribotwin/hil/shadow/bus_clock.hpp>
#include <tribotwin/hil/shadow/expectation.hpp>
#include <tribotwin/hil/shadow/lag.hpp>
#include <tribotwin/hil/shadow/shadow.hpp>

namespace tribotwin::hil {
namespace {

constexpr double never_s = -std::numeric_limits<double>::infinity();
constexpr double stale_s = 0.5;               // a value that is sent on change may be silent for so long
constexpr double brake_release_s = 0.1;       // an enabled drive may still open its brake
constexpr double position_resolution = 1e-5;  // [rad]; a mirror frame counts in these
constexpr double half_window_s = 0.06;        // of the filter: 7 Hz, and at least six cycles
constexpr double half_window_cycles = 6;
constexpr double longest_gap = 0.9;      // in a window, by its half
constexpr double cycle_tolerance = 0.2;  // of --cycle

std::vector<std::unique_ptr<Listener>> listeners_of(const ShadowOptions& o, std::span<const DriveParameters> drives) {
  std::vector<std::unique_ptr<Listener>> all;
  if (o.listeners) all = o.listeners();
  all.resize(drives.size());
  for (std::size_t i = 0; i < drives.size(); ++i)
    if (!all[i])
      all[i] = o.profile != Profile::cia402 ? mirror_listener(drives[i]) : canopen_listener(simulated_drive(drives[i]));
  return all;
}

/// What is known of one joint.
struct Joint {
  std::unique_ptr<Listener> listener;
  Channel position, torque;
  std::optional<bool> enabled;
  double not_enabled_s = never_s;       // when it was heard last that the drive does not follow
  Samples friction_low, friction_high;  // of the cycles in `waiting_`
  Lag lag;
  double beyond_s = 0, judged_s = never_s;
  bool silent = false;       // its torque has ended, which was said
  bool mean_torque = false;  // what is heard is the mean since the SYNC before
};

/// A cycle whose motion is known, waiting for the frictions after it.
struct Cycle {
  double time_s = 0;
  struct Part {
    double measured_nm = 0, rigid_nm = 0, temperature_degC = 0;  // measured: NaN if missing
    bool enabled = false;
    double position_rad = 0, velocity_rad_s = 0;
  };
  std::vector<Part> joints;
};

/// Compares what the listeners of all drives hear with the expectation, cycle by cycle. A cycle at t needs positions
/// and torques up to t + half, and the friction of the cycles up to there in turn.
class Shadow {
 public:
  Shadow(const twin::Scenario& scenario, const ShadowOptions& o)
      : o_(o),
        clocks_(bus_count(o.wiring), BusClock(o.lockstep ? std::optional(1e-6 * o.cycle_us) : std::nullopt)),
        expectation_(scenario) {
    const auto parameters = drive_parameters(scenario, o.first_node, o.cycle_us, o.wiring);
    auto listeners = listeners_of(o, parameters);
    for (std::size_t i = 0; i < parameters.size(); ++i) {
      joints_.push_back({.listener = std::move(listeners[i])});
      result_.joints.push_back({.name = parameters[i].name});
    }
    motions_.resize(joints_.size());
  }

  Result<ShadowResult> run(const NextFrame& next) {
    if (auto ok = check_joints(); !ok) return tl::unexpected(ok.error());
    if (auto ok = open_csv(); !ok) return work_failed(ok.error().message);
    Frame frame;
    Result<bool> more = true;
    Result<void> heard;
    while (!stopped() && heard) {
      more = next(frame);
      if (!more || !*more || over(frame)) break;
      if (!frame.error) heard = hear(frame);
    }
    result_.interrupted = stopped() && !o_.endless;
    if (more && heard) heard = infer_cycle();
    if (heard && cycle_s_ > 0) advance(clock_.now_s());
    close_csv();
    if (!more) return tl::unexpected(more.error());
    if (!heard) return tl::unexpected(heard.error());
    if (!result_.interrupted)
      if (auto ok = require_predictions(); !ok) return tl::unexpected(ok.error());
    check_limit();
    return finished();
  }

 private:
  bool stopped() const { return o_.stop && o_.stop(); }
  bool over(const Frame& frame) {
    if (frame.error) return false;
    if (first_ns_ < 0) first_ns_ = frame.time_ns;
    result_.heard_s = 1e-9 * static_cast<double>(frame.time_ns - first_ns_);
    return o_.duration_s && result_.heard_s >= *o_.duration_s;
  }
  /// "joint1, joint2": the joints for which `which` is true.
  std::string names(const std::function<bool(std::size_t)>& which) const {
    std::vector<std::string> chosen;
    for (std::size_t i = 0; i < result_.joints.size(); ++i)
      if (which(i)) chosen.push_back(result_.joints[i].name);
    return fmt::format("{}", fmt::join(chosen, ", "));
  }

  Result<void> hear(const Frame& frame) {
    const std::size_t bus = o_.bus ? o_.bus() : 0;
    const bool any_sync = is_sync(frame), sync = any_sync && bus == 0;
    const bool synced = clock_.synced();
    for (std::size_t i = 0; i < clocks_.size(); ++i) clocks_[i].hear(frame, any_sync && i == bus);
    if (sync && !synced) ticks_ = {}, period_ = {};  // until now the first drive's positions were the cycle
    if (begin_s_ == never_s && std::ranges::all_of(joints_, [](const Joint& j) { return j.position.heard() > 0; }))
      begin_s_ = clock_.now_s();
    bool first_position = false;
    for (std::size_t i = 0; i < joints_.size(); ++i)
      if (place_of(o_.wiring, i).bus == bus) first_position |= hear(joints_[i], frame, bus) && i == 0;
    return sync || (first_position && !clock_.synced()) ? tick() : Result<void>{};
  }

  /// Whether the frame held a position of the joint.
  bool hear(Joint& joint, const Frame& frame, std::size_t bus) {
    const Heard heard = joint.listener->hear(frame);
    if (!heard.any()) return false;
    // In lockstep the buses have one clock; else each drive sends with the SYNC of its bus.
    const BusClock& clock = o_.lockstep ? clock_ : clocks_[bus];
    Sending sending = heard.sending;
    if (sending == Sending::with_sync && !clock.synced()) sending = Sending::periodic;
    const Stamp stamp = clock.stamp(sending);
    if (heard.position_rad) joint.position.add(stamp, *heard.position_rad, sending, heard.every);
    if (heard.torque_nm) {
      // Without SYNCs our drives send the torque of the moment.
      joint.mean_torque = heard.mean_torque && sending == heard.sending;
      const double span_s = joint.mean_torque ? torque_span_s(stamp, joint.torque) : 0;
      joint.torque.add(stamp, *heard.torque_nm, sending, heard.every, span_s);
      joint.silent = false;
    }
    // What was before the first statusword is not known: a drive heard enabled may just have become so.
    if (heard.enabled && (!joint.enabled || !*heard.enabled)) joint.not_enabled_s = stamp.time_s;
    if (heard.enabled) joint.enabled = heard.enabled;
    return heard.position_rad.has_value();
  }

  /// A cycle begins: what belongs to the ones before has been heard, but for the one that ends now, which may be late.
  Result<void> tick() {
    const double now_s = clock_.now_s();
    period_.add(clock_.stamped_s());
    if (cycle_s_ == 0 && period_.complete())
      if (auto ok = infer_cycle(); !ok) return ok;
    const double complete_s = ticks_.empty() ? now_s : ticks_.back();
    for (Joint& j : joints_) {
      j.position.hold(complete_s, stale_s), j.torque.hold(complete_s, stale_s);
      if (j.enabled == false) j.not_enabled_s = now_s;
    }
    ticks_.push_back(now_s);
    if (cycle_s_ > 0) advance(complete_s);
    return {};
  }

  Result<void> infer_cycle() {
    if (cycle_s_ > 0) return {};
    const auto measured = period_.period_s();
    if (o_.lockstep) {
      cycle_s_ = 1e-6 * o_.cycle_us;
      result_.cycle_source = "lockstep: the SYNC is the clock";
    } else if (!measured && period_.complete()) {
      return tl::unexpected(fmt::format("{} frames had one time stamp; where each SYNC is one --cycle, give --lockstep",
                                        period_.count()));
    } else if (measured) {
      cycle_s_ = *measured;
      result_.cycle_source = source();
      if (o_.cycle_expected && std::abs(1e-6 * o_.cycle_us / cycle_s_ - 1) > cycle_tolerance)
        return tl::unexpected(fmt::format(
            "--cycle {:.4g} contradicts the bus: {} every {:.4g} ms; leave --cycle out, or give --lockstep where "
            "each SYNC is one cycle, whatever the clock says",
            1e-3 * o_.cycle_us, clock_.synced() ? "a SYNC came" : "positions came", 1e3 * cycle_s_));
    }
    half_s_ = std::max(half_window_s, half_window_cycles * cycle_s_);
    result_.cycle_s = cycle_s_;
    return {};
  }
  std::string source() const {
    const std::string what = clock_.synced() ? "from the SYNCs" : "from the positions of " + result_.joints[0].name;
    if (const double spread = period_.spread(); spread > 0.25)
      return fmt::format("{}, which are irregular by {:.0f} %; if the SYNC is the clock: --lockstep", what,
                         100 * spread);
    return what;
  }
  double settling_s() const { return 2 * half_s_ + brake_release_s; }
  /// Of a mean since the SYNC before, or the frame before. Of the first, and after a pause, it is not known: hardly
  /// any, so that the sample hardly counts.
  double torque_span_s(const Stamp& stamp, const Channel& before) const {
    constexpr double shortest_s = 1e-6;
    const bool first = stamp.cycle >= 0 ? stamp.cycle == 0 : before.heard() == 0;
    const double span_s = stamp.time_s - (stamp.cycle >= 0 ? stamp.previous_s : before.heard_s());
    const bool paused = span_s > std::max(SyncMean::longest_silence_s, 2 * cycle_s_);
    return first || paused ? shortest_s : std::max(span_s, shortest_s);
  }
  /// By which torques that are means come later than the motion.
  double torque_delay_s() const { return std::ranges::any_of(joints_, &Joint::mean_torque) ? cycle_s_ / 2 : 0; }

  /// Judges all cycles for which what was heard up to `complete_s` is enough.
  void advance(double complete_s) {
    while (!ticks_.empty() && ticks_.front() + half_s_ + torque_delay_s() <= complete_s) {
      if (waiting_.empty() || ticks_.front() > waiting_.back().time_s) predict(ticks_.front());
      ticks_.pop_front();
    }
    const double keep_s = complete_s - 2 * half_s_ - (ticks_.empty() ? 0 : complete_s - ticks_.front());
    for (Joint& j : joints_) j.position.forget_before(keep_s), j.torque.forget_before(keep_s);
    while (!waiting_.empty() && waiting_.front().time_s + half_s_ <= waiting_.back().time_s) {
      compare(waiting_.front());
      for (Joint& j : joints_)
        forget_before(j.friction_low, waiting_.front().time_s - half_s_),
            forget_before(j.friction_high, waiting_.front().time_s - half_s_);
      waiting_.pop_front();
    }
  }

  bool covered(const Samples& samples, double time_s) const {
    return hil::covered(samples, time_s, half_s_, longest_gap * half_s_);
  }

  void predict(double time_s) {
    bool known = true;
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      const Samples& heard = joints_[i].position.samples();
      if (covered(heard, time_s))
        motions_[i] = local_motion(heard, time_s, half_s_, position_resolution);
      else
        known = false, result_.joints[i].position_missing += begin_s_ == never_s || time_s - half_s_ < begin_s_ ? 0 : 1;
    }
    if (!known) return;
    expectation_.set(motions_, predicted_s_ == never_s ? 0 : time_s - predicted_s_);
    predicted_s_ = time_s;
    Cycle cycle{.time_s = time_s};
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      Joint& j = joints_[i];
      j.friction_low.push_back({time_s, expectation_.friction_low_nm(i)});
      j.friction_high.push_back({time_s, expectation_.friction_high_nm(i)});
      const bool torque = covered(j.torque.samples(), time_s);
      cycle.joints.push_back({.measured_nm = torque ? local_mean(j.torque.samples(), time_s, half_s_) : std::nan(""),
                              .rigid_nm = expectation_.rigid_nm(i),
                              .temperature_degC = expectation_.temperature_degC(i),
                              .enabled = j.enabled.value_or(false) && time_s - j.not_enabled_s > settling_s(),
                              .position_rad = motions_[i].position,
                              .velocity_rad_s = motions_[i].speed});
    }
    waiting_.push_back(std::move(cycle));
  }

  void compare(const Cycle& cycle) {
    result_.seconds = cycle.time_s;
    row_ = fmt::format("{:.6f}", cycle.time_s);
    shown_ = {.time_s = cycle.time_s, .joints = {}};
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      Joint& j = joints_[i];
      note_silence(i, cycle.time_s);
      const double unknown = std::nan("");
      shown_.joints.push_back({cycle.joints[i].position_rad, cycle.joints[i].velocity_rad_s, unknown, unknown, unknown,
                               unknown, result_.joints[i].exceeded});
      // Before a gap in the positions there are fewer cycles in the window: the friction there is not known as well.
      const bool known = covered(j.friction_low, cycle.time_s);
      if (known)
        judge(i, cycle.time_s, cycle.joints[i], local_mean(j.friction_low, cycle.time_s, half_s_),
              local_mean(j.friction_high, cycle.time_s, half_s_));
      else
        row_ += ",nan,nan,nan,nan";
    }
    if (o_.cycle) o_.cycle(shown_);
    write_row();
  }

  void judge(std::size_t i, double time_s, const Cycle::Part& part, double friction_low, double friction_high) {
    ShadowJoint& j = result_.joints[i];
    j.temperature_degC = part.temperature_degC;
    const double seen = part.measured_nm, low = part.rigid_nm + friction_low, high = part.rigid_nm + friction_high;
    const double expected = std::isnan(seen) ? (low + high) / 2 : std::clamp(seen, low, std::max(low, high));
    const double residual = part.enabled ? seen - expected : std::nan("");
    row_ += fmt::format(",{:.6g},{:.6g},{:.6g},{:.3f}", seen, expected, residual, j.temperature_degC);
    ShadowCycle::Part& shown = shown_.joints[i];
    shown.measured_nm = seen, shown.predicted_nm = expected, shown.residual_nm = residual;
    shown.temperature_degC = j.temperature_degC;
    if (!part.enabled)
      ++j.not_enabled;
    else if (std::isnan(seen))
      ++j.torque_missing;
    if (std::isnan(residual)) return;
    count(j, time_s, residual);
    Joint& joint = joints_[i];
    const double since_s = time_s - joint.judged_s;
    const bool gap = since_s > half_s_;
    if (gap) joint.lag.restart();
    joint.lag.add(expected, seen);
    if (limited(i)) watch(i, time_s, residual, gap ? 0 : since_s);
    shown.exceeded = j.exceeded;
    joint.judged_s = time_s;
  }

  static void count(ShadowJoint& j, double time_s, double residual) {
    if (j.samples++ == 0) j.judged_from_s = time_s;
    j.judged_to_s = time_s;
    const auto n = static_cast<double>(j.samples);
    j.residual_mean_nm += (residual - j.residual_mean_nm) / n;
    j.residual_rms_nm += (residual * residual - j.residual_rms_nm) / n;  // its square, until the end
    j.residual_max_nm = std::max(j.residual_max_nm, std::abs(residual));
  }

  /// `since_s`: time beyond the limit that this cycle adds; 0 after a gap, where it begins anew.
  void watch(std::size_t i, double time_s, double residual, double since_s) {
    Joint& joint = joints_[i];
    const bool beyond = std::abs(residual) > *o_.limit_nm;
    joint.beyond_s = beyond && since_s > 0 ? joint.beyond_s + since_s : 0;
    if (beyond && joint.beyond_s >= o_.limit_time_s && !std::exchange(result_.joints[i].exceeded, true))
      note(fmt::format("{}: residual {:.4g} Nm beyond {:.4g} Nm for {:.3g} s, at {:.3f} s", result_.joints[i].name,
                       residual, *o_.limit_nm, o_.limit_time_s, time_s));
  }

  void note_silence(std::size_t i, double time_s) {
    Joint& j = joints_[i];
    if (j.torque.heard() == 0 || j.silent || time_s - j.torque.heard_s() <= stale_s) return;
    j.silent = true;
    note(fmt::format("{}: no torque for {} s, at {:.3f} s; not compared until it is back", result_.joints[i].name,
                     stale_s, time_s));
  }

  bool limited(std::size_t i) const {
    return o_.limit_nm && (o_.limit_joints.empty() ||
                           std::ranges::find(o_.limit_joints, result_.joints[i].name) != o_.limit_joints.end());
  }
  void note(const std::string& what) const {
    if (o_.note) o_.note(what);
  }

  Result<void> check_joints() const {
    for (const auto& name : o_.limit_joints)
      if (std::ranges::find(result_.joints, name, &ShadowJoint::name) == result_.joints.end())
        return tl::unexpected(
            fmt::format("no joint '{}' for --joint; there are {}", name, names([](std::size_t) { return true; })));
    return {};
  }

  Result<void> open_csv() {
    if (o_.csv.empty()) return {};
    auto csv = RecordFile::create(o_.csv, {.replace = o_.existing == twin::Existing::replace, .give_up = o_.stop});
    if (!csv) return tl::unexpected(csv.error());
    csv_.emplace(std::move(*csv));
    return {};
  }
  void write_row() {
    if (!csv_) return;
    std::string head;
    if (!std::exchange(headed_, true)) {
      head = "time_s";
      for (const auto& j : result_.joints)
        head += fmt::format(",{0}.measured_nm,{0}.predicted_nm,{0}.residual_nm,{0}.temperature_degC", j.name);
      head += '\n';
    }
    keep_csv(csv_->append(head + row_ + '\n'));
    if (csv_) keep_csv(csv_->flush());  // a bus may fall silent for long
  }
  void close_csv() {
    if (!csv_) return;
    if (headed_) keep_csv(csv_->finish());
    csv_.reset();  // without a row: no file
  }
  /// A full disk must not end the monitoring of a robot.
  void keep_csv(const Result<void>& written) {
    if (written) return;
    result_.csv_failure = fmt::format("{}; written up to {:.3f} s", written.error().message, result_.seconds);
    csv_.reset();
    note(result_.csv_failure + "; the shadow goes on");
  }

  Result<void> require_predictions() const {
    const auto silent = names([&](std::size_t i) { return joints_[i].position.heard() == 0; });
    if (!silent.empty())
      return tl::unexpected(fmt::format(
          "no position was heard of {}: is --first-node right, and is a PDO with 6064h on the bus?", silent));
    if (result_.seconds > 0) return {};
    const auto gaps = names([&](std::size_t i) { return result_.joints[i].position_missing > 0; });
    if (!gaps.empty())
      return tl::unexpected(
          fmt::format("positions of {} come too seldom: a prediction takes gaps of at most {:.3g} s, of every joint",
                      gaps, longest_gap * half_s_));
    return tl::unexpected(
        fmt::format("positions of {:.3g} s were heard; a prediction takes {:.3g} s: listen for longer", clock_.now_s(),
                    4 * std::max(half_s_, half_window_s)));
  }

  /// A limit that was not checked must not pass for one that was kept.
  void check_limit() {
    const auto unjudged = [&](std::size_t i) { return result_.joints[i].samples == 0 && (!o_.limit_nm || limited(i)); };
    const auto no_torque = names([&](std::size_t i) { return unjudged(i) && joints_[i].torque.heard() == 0; });
    if (!no_torque.empty()) {
      const std::string why = fmt::format(
          "no torque was heard of {}: map 6077h into a TPDO that is sent with the SYNC (1A03h, 1803h)", no_torque);
      if (o_.limit_nm)
        result_.unchecked.push_back(fmt::format("{}, or name the joints to check with --joint", why));
      else
        note(fmt::format("{}; nothing was compared there", why));
    }
    if (!o_.limit_nm) return;
    const auto add = [&](const std::string& who, const std::string& what, const std::string& help) {
      if (!who.empty()) result_.unchecked.push_back(fmt::format("{} {}: {}", what, who, help));
    };
    const auto heard = [&](std::size_t i) { return unjudged(i) && joints_[i].torque.heard() > 0; };
    add(names([&](std::size_t i) { return heard(i) && !joints_[i].enabled; }), "no state was heard of",
        "map the statusword 6041h into a TPDO; without it a brake that holds is not told from a drive (DBC: --signal "
        "enabled=...)");
    const auto held = [&](std::size_t i) {
      return heard(i) && joints_[i].enabled && result_.joints[i].not_enabled > 0 && !result_.joints[i].torque_missing;
    };
    add(names(held), "no torque of an enabled drive was heard of",
        fmt::format("brakes, stops and the first {:.3g} s after enabling are not judged: record while the arm moves",
                    settling_s()));
    add(names([&](std::size_t i) { return heard(i) && joints_[i].enabled && !held(i); }),
        "too few torques were heard of", fmt::format("they may be at most {:.3g} s apart", longest_gap * half_s_));
    add(names([&](std::size_t i) {
          const ShadowJoint& j = result_.joints[i];
          return limited(i) && j.samples > 0 && static_cast<double>(j.samples) * cycle_s_ <= o_.limit_time_s;
        }),
        "torques were judged for less than the " + fmt::format("{} s of --limit-time of", o_.limit_time_s),
        "listen for longer");
  }

  ShadowResult finished() {
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      ShadowJoint& j = result_.joints[i];
      j.residual_rms_nm = std::sqrt(j.residual_rms_nm);
      j.lag_s = cycle_s_ * joints_[i].lag.samples();
      j.positions_lost = joints_[i].position.lost();
      j.torques_lost = joints_[i].torque.lost();
    }
    return std::move(result_);
  }

  const ShadowOptions& o_;
  std::vector<BusClock> clocks_;  // of each bus
  BusClock& clock_ = clocks_[0];
  Expectation expectation_;
  std::vector<Joint> joints_;
  CyclePeriod period_;
  double cycle_s_ = 0, half_s_ = 0;  // 0 until the cycle is known
  std::deque<double> ticks_;         // cycles whose motion is not known yet
  std::deque<Cycle> waiting_;
  std::vector<Motion> motions_;
  double predicted_s_ = never_s;
  double begin_s_ = never_s;  // when a position of every joint had been heard
  bool headed_ = false;
  std::int64_t first_ns_ = -1;
  std::optional<RecordFile> csv_;
  std::string row_;
  ShadowCycle shown_;
  ShadowResult result_;
};

}  // namespace

Result<ShadowResult> shadow(const twin::Scenario& scenario, const NextFrame& next, const ShadowOptions& options) {
  return Shadow(scenario, options).run(next);
}

}  // namespace tribotwin::hil
