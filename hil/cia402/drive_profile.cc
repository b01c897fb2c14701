#include <algorithm>
#include <cmath>
#include <utility>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/cia402/drive_profile.hpp>
#include <tribotwin/hil/cia402/touch_probe.hpp>
#include <tribotwin/hil/cia402/words.hpp>
#include <tribotwin/hil/motion/standstill.hpp>

namespace tribotwin::hil {
namespace {

constexpr double standstill_s = 0.02;      // duration at the end of a ramp
constexpr double longest_reaction_s = 10;  // to lost commands and faults; then the brake stops the motor
constexpr double warning_K = 10;           // below the temperature limit

/// 605Dh: halt option.
enum HaltOption : std::int64_t { slow_down_ramp = 1, quick_stop_ramp = 2 };

/// 6007h: abort connection option.
enum AbortConnection : std::int64_t { fault_reaction = 1, disable_voltage = 2, quick_stop = 3 };

double tenths_degC(const Object* object) { return 0.1 * static_cast<double>(object->value); }

}  // namespace

DriveProfile::DriveProfile(NodeContext& node, Emcy& emcy, const DriveParameters& p)
    : node_(node),
      emcy_(emcy),
      objects_(node.dictionary, p.gear_ratio),
      gear_ratio_(p.gear_ratio),
      switches_(switches_of(p)) {}

std::optional<double> DriveProfile::measured_temperature_degC() const {
  const Object* measured = objects_.measured_temperature;
  if (measured->value == measured->low) return std::nullopt;
  return tenths_degC(measured);
}

// ---- Objects.

tl::expected<void, Abort> DriveProfile::may_write(const Object& o, std::int64_t value) const {
  const bool unknown_mode = o.index == od::modes_of_operation && value != no_mode && !find_mode(value);
  const bool unknown_stop = o.index == od::quick_stop_option_code && (value == 3 || value == 4);
  const bool unknown_ramp = o.index == od::motion_profile_type && (value == 1 || value == 2);
  const bool unknown_method = o.index == od::homing_method && !has_homing_method(value);
  const bool unknown_submode = o.index == od::interpolation_submode && value != 0;
  const bool unknown_probe = o.index == od::touch_probe_function && !is_touch_probe_function(value);
  if (unknown_mode || unknown_stop || unknown_ramp || unknown_method || unknown_submode || unknown_probe)
    return tl::unexpected(Abort::out_of_range);
  return {};
}

bool DriveProfile::has_homing_method(std::int64_t number) const {
  bool has = number == 0;
  for (std::int64_t sub = node_.dictionary.get(od::supported_homing_methods); sub > 0 && !has; --sub)
    has = node_.dictionary.get(od::supported_homing_methods, static_cast<std::uint8_t>(sub)) == number;
  return has;
}

void DriveProfile::written(const Object& o) {
  if (o.index == od::controlword) return apply_controlword();
  if (o.index == od::modes_of_operation) return update_status();
  if (o.index == od::touch_probe_function) update_touch_probes(objects_, nullptr);
  const auto target =
      std::ranges::find_if(targets(), [&](const Target& t) { return t.index == o.index && t.sub == o.sub; });
  if (target == targets().end()) return;
  const ModeOfOperation* mode = followed_mode();
  // What is written for one mode does not move the drive in the next.
  fresh_[static_cast<std::size_t>(target - targets().begin())] = !mode || mode->target != o.index;
  if (mode && mode->target == o.index) made_up_ = false;
  if (follows_target() && mode->target_written && mode->target == o.index) mode->target_written(demand_, objects_);
}

void DriveProfile::reset() {
  if (machine_.powered()) stops_alone_ = true;  // the brake falls
  machine_.reset();
  objects_.error_code->value = 0;
}

bool DriveProfile::halts() const {
  return machine_.follows() && ((objects_.controlword->value & halt) || !active_mode());
}

const ModeOfOperation* DriveProfile::active_mode() const { return find_mode(objects_.mode_display->value); }

StopOptions DriveProfile::stop_options() const {
  const auto option = [&](od::Index index) { return static_cast<int>(node_.dictionary.get(index)); };
  return {option(od::quick_stop_option_code), option(od::shutdown_option_code),
          option(od::disable_operation_option_code), option(od::fault_reaction_option_code)};
}

// ---- States.

void DriveProfile::apply_controlword() {
  const DriveState before = machine_.state();
  const std::int64_t word = objects_.controlword->value;
  // Without the permission of the safety circuit every command is "disable voltage"; a fault may still be reset.
  const std::int64_t allowed = feedback_.safe_torque_off ? word & ~std::int64_t{enable_voltage} : word;
  machine_.controlword(static_cast<std::uint16_t>(allowed), stop_options());
  if (machine_.state() == DriveState::operation_enabled) stops_alone_ = false;
  if (before == DriveState::fault && machine_.state() != DriveState::fault) {
    objects_.error_code->value = 0;
    emcy_.clear();
  }
  update_status();
}

void DriveProfile::fail(std::uint16_t code, std::uint8_t register_bits, bool ramp) {
  if (machine_.state() == DriveState::fault || machine_.state() == DriveState::fault_reaction_active) return;
  objects_.error_code->value = code;
  machine_.fail(ramp);
  emcy_.raise(code, register_bits);
  refresh_status();
}

void DriveProfile::lose_commands(ErrorCode code) {
  if (!machine_.powered()) {
    if (code != ErrorCode::left_operational) emcy_.report(code);  // leaving operational without power is no error
    return;
  }
  stops_alone_ = true;
  const auto option = node_.dictionary.get(od::abort_connection_option_code);
  const StopOptions o = stop_options();
  const bool ramp = (option == fault_reaction && o.fault_reaction != 0) || (option == quick_stop && o.quick_stop != 0);
  fail(static_cast<std::uint16_t>(code), communication_error, ramp);
}

void DriveProfile::refresh_status() {
  const std::int64_t word = objects_.controlword->value;
  const ModeOfOperation* mode = followed_mode();
  // The word that enables the drive, or that a halt or a ramp outlives, starts nothing: an edge needs a frame before.
  if (mode && mode->control && controls_ && word != controlword_) mode->control(demand_, objects_, controlword_, word);
  controls_ = mode != nullptr;
  controlword_ = word;
  update_status();
}

void DriveProfile::update_status() {
  const bool follows = machine_.follows();
  if ((follows && !followed_) || (follows && objects_.mode_display->value != objects_.mode->value)) take_up_mode();
  if (!follows) objects_.mode_display->value = objects_.mode->value;
  if (machine_.ramping() && ramp_rad_s_ == 0) ramp_rad_s_ = feedback_.velocity_rad_s;
  followed_ = follows;
  if (const bool now = halts(); now != halted_) {
    halted_ = now;
    ramp_rad_s_ = feedback_.velocity_rad_s;
    // Released, CSP stands until the next target; the other modes continue with theirs.
    if (!now && follows) resume();
  }
  demand_.halted = halted_;
  demand_.lags = follows_demand() && following_s_ > 0;

  const std::uint16_t word = statusword();
  if (objects_.statusword->value != word) node_.changed = true;
  objects_.statusword->value = word;
}

Demand DriveProfile::demand_here() const {
  return {.position_rad = feedback_.position_rad,
          .torque = {.speed_rad_s = feedback_.velocity_rad_s},
          .motion = {feedback_.position_rad, feedback_.velocity_rad_s, 0},
          .inputs = &inputs_};
}

void DriveProfile::resume() {
  const Demand before = std::exchange(demand_, demand_here());
  if (const ModeOfOperation* mode = active_mode(); mode && mode->resume) mode->resume(demand_, before, objects_);
}

/// A target that was not written for this mode begins at what the drive does now, so that nothing jumps; a mode with
/// ramps of its own stops the drive.
void DriveProfile::take_up_mode() {
  objects_.mode_display->value = objects_.mode->value;
  demand_ = demand_here();
  if (!followed_) fresh_.assign(fresh_.size(), false);  // targets of another time
  const ModeOfOperation* mode = active_mode();
  const bool keeps_moving = followed_ && !halted_ && mode && mode->set_points == SetPoints::cyclic;
  made_up_ = false;
  for (std::size_t i = 0; i < fresh_.size(); ++i) {
    const Target& target = targets()[i];
    const bool asked_first = mode && mode->set_points == SetPoints::on_request && mode->target == target.index;
    if (fresh_[i] || asked_first) continue;
    const std::int64_t counts = target.standing_counts(objects_, feedback_, keeps_moving);
    node_.dictionary.set(target.index, target.sub, counts);
    if (keeps_moving && mode->target == target.index && !mode->follows_demand) made_up_ = counts != 0;
  }
  fresh_.assign(fresh_.size(), false);
  following_s_ = 0;
  if (mode && mode->enter) mode->enter(demand_, objects_);
}

std::uint16_t DriveProfile::statusword() const {
  int word = machine_.status_bits() | (feedback_.safe_torque_off ? 0 : voltage_enabled);
  if (feedback_.temperature_degC > tenths_degC(objects_.temperature_limit) - warning_K) word |= warning;
  if (above(objects_.winding_warning)) word |= warning;
  if (node_.operational()) word |= remote;
  if (feedback_.limited) word |= internal_limit_active;
  if (const ModeOfOperation* mode = followed_mode()) word |= mode->status(demand_);
  if (halts()) word &= ~target_reached;
  if (halts() && ramp_rad_s_ == 0 && stands()) word |= target_reached;
  return static_cast<std::uint16_t>(word);
}

// ---- Steps.

twin::DriveCommand DriveProfile::command(double dt) {
  twin::DriveCommand c;
  if (follows_target()) {
    ramp_rad_s_ = 0;
    c = active_mode()->command(demand_, objects_, feedback_, dt);
    c.position_rad += objects_.zero_rad;
    if (const auto home = std::exchange(demand_.homing.home_rad, {}))
      move_zero(*home + objects_.position_rad(objects_.home_offset));
  } else if (machine_.powered()) {
    c = ramp_down(c, dt);
  }
  c.torque_limit_nm = objects_.torque_nm(objects_.max_torque);
  return c;
}

twin::DriveCommand DriveProfile::ramp_down(twin::DriveCommand c, double dt) {
  c.mode = twin::DriveCommand::Mode::velocity;
  const bool slow = halts() && objects_.halt_option->value == slow_down_ramp;
  const double step =
      objects_.velocity_rad_s(slow ? objects_.profile_deceleration : objects_.quick_stop_deceleration) * dt;
  ramp_rad_s_ = std::abs(ramp_rad_s_) <= step ? 0 : ramp_rad_s_ - std::copysign(step, ramp_rad_s_);
  c.velocity_rad_s = ramp_rad_s_;
  demand_.position_rad = feedback_.position_rad;
  return c;
}

/// Position 0 is at this angle of the joint from now on; nothing moves.
void DriveProfile::move_zero(double joint_rad) {
  const double by = joint_rad - std::exchange(objects_.zero_rad, joint_rad);
  feedback_.position_rad -= by;
  demand_.position_rad -= by;
  demand_.motion.position_rad -= by;
}

void DriveProfile::read_inputs(double joint_rad) {
  switches_.home_rad = objects_.position_rad(objects_.home_switch);
  switches_.probe_2_rad = objects_.position_rad(objects_.probe_2_switch);
  inputs_.move_to(switches_, joint_rad);
  constexpr std::pair<Input, int> bits[] = {
      {Input::negative_limit, 0}, {Input::positive_limit, 1}, {Input::home, 2}, {Input::probe_2, 16}};
  constexpr int interlock = 3, brake_released = 17;
  std::int64_t word = std::int64_t{feedback_.safe_torque_off} << interlock | std::int64_t{!brake_engaged()}
                                                                                 << brake_released;
  for (const auto& [input, bit] : bits) word |= std::int64_t{inputs_.active(input)} << bit;
  set(objects_.digital_inputs, static_cast<double>(word));
  if (update_touch_probes(objects_, &inputs_)) node_.changed = true;
}

bool DriveProfile::brake_engaged() const {
  constexpr std::int64_t brake = 1;
  return !machine_.powered() || (objects_.digital_outputs->value & objects_.output_mask->value & brake);
}

/// The safety circuit takes the torque away by itself; the drive follows: a fault where it had power.
void DriveProfile::watch_safe_torque_off() {
  if (!feedback_.safe_torque_off) return;
  if (machine_.state() == DriveState::fault_reaction_active)
    machine_.stopped();
  else if (machine_.powered())
    fail(static_cast<std::uint16_t>(ErrorCode::external), generic_error, false);
  else if (machine_.state() != DriveState::fault && machine_.state() != DriveState::switch_on_disabled)
    machine_.controlword(0, stop_options());
}

void DriveProfile::feedback(const Feedback& joint, double dt) {
  feedback_ = joint;
  feedback_.position_rad -= objects_.zero_rad;
  const Feedback& f = feedback_;
  watch_safe_torque_off();
  read_inputs(joint.position_rad);
  const double lag_rad = follows_demand() ? demand_.position_rad - f.position_rad : 0;
  show(f, dt);
  set(objects_.following_error, lag_rad / objects_.increment_rad);
  if (const ModeOfOperation* mode = followed_mode(); mode && mode->observe) mode->observe(demand_, objects_, f, dt);
  watch_following_error(lag_rad, dt);
  watch_standstill(dt);
  watch_temperature();
  watch_rest(dt);
  update_status();
}

void DriveProfile::show(const Feedback& f, double dt) {
  const DriveObjects& o = objects_;
  torque_.add(f.torque_nm, dt);
  set(o.position_actual, f.position_rad / o.increment_rad);
  set(o.velocity_actual, f.velocity_rad_s / o.milli_rpm_rad_s);
  // Without power the brake and the last step decide; a master must not read a torque that is gone.
  set(o.torque_actual, (machine_.powered() ? torque_.value() : f.torque_nm) / o.per_mille_nm);
  set(o.torque_demand, f.torque_nm / o.per_mille_nm);
  set(o.position_demand, demand_.position_rad / o.increment_rad);
  set(o.lubricant_temperature, 10 * f.temperature_degC);
  if (o.winding_temperature) set(o.winding_temperature, 10 * f.winding_degC.value_or(f.temperature_degC));
  set(o.friction_torque, 1e3 * f.friction_nm);
  set(o.load_torque, 1e3 * f.load_nm);
}

void DriveProfile::set(Object* object, double counts) {
  const std::int64_t value = saturated(object->type, std::llround(counts));
  if (value != object->value) object->value = value, node_.changed = true;
}

void DriveProfile::watch_following_error(double lag_rad, double dt) {
  if (!follows_demand()) return;
  const auto window = objects_.following_error_window->value;
  const bool outside = window != DriveObjects::window_off && std::abs(lag_rad) > objects_.position_rad(window);
  following_s_ = outside ? following_s_ + dt : 0;
  if (following_s_ > 1e-3 * static_cast<double>(objects_.following_error_time_out->value))
    fail(static_cast<std::uint16_t>(ErrorCode::following_error), profile_error, stop_options().fault_reaction != 0);
}

bool DriveProfile::stands() const { return hil::stands(feedback_.velocity_rad_s, gear_ratio_); }

/// The end of a reaction to lost commands: brake, standstill for a while, torque 0.
void DriveProfile::watch_rest(double dt) {
  const bool no_torque = std::llround(feedback_.torque_nm / objects_.per_mille_nm) == 0;
  const bool rests = !machine_.powered() && stands() && no_torque;
  resting_s_ = rests ? resting_s_ + dt : 0;
  if (resting_s_ > standstill_s) stops_alone_ = false;
}

void DriveProfile::watch_standstill(double dt) {
  reaction_s_ = machine_.state() == DriveState::fault_reaction_active ? reaction_s_ + dt : 0;
  if (!machine_.ramping()) return;
  standing_s_ = ramp_rad_s_ == 0 && stands() ? standing_s_ + dt : 0;
  // A motor that a slow ramp or too small a torque (6085h, 6072h) cannot stop is left to the brake.
  if (standing_s_ > standstill_s || reaction_s_ > longest_reaction_s) {
    machine_.stopped();
    standing_s_ = 0;
  }
}

bool DriveProfile::above(const Object* winding_limit) const {
  return winding_limit && feedback_.winding_degC && *feedback_.winding_degC > tenths_degC(winding_limit);
}

void DriveProfile::watch_temperature() {
  if (feedback_.temperature_degC > tenths_degC(objects_.temperature_limit) || above(objects_.winding_limit))
    fail(static_cast<std::uint16_t>(ErrorCode::excess_temperature), temperature_error,
         stop_options().fault_reaction != 0);
}

}  // namespace tribotwin::hil
