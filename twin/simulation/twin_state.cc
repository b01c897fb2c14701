#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/mujoco/engine_state.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

namespace tribotwin::twin {
namespace {

/// Of the scenario, wherever its files lie: FNV-1a, exact as a double.
double scenario_mark(const Twin& twin) {
  const Scenario& scenario = twin.scenario();
  std::string text = fmt::format("{} {} {} {} {}", scenario.name, scenario.duration_s, scenario.seed,
                                 twin.takes_commands(), (*scenario.model)->opt.timestep);
  for (const Event& event : scenario.events) text += fmt::format(" {} {}", event.time_s, event.what.index());
  for (const mujoco::Binding& binding : scenario.model->drives()) {
    text += joint_name(scenario.model->get(), binding);
    for (const auto& [key, value] : drive::configuration_of(binding.drive)) text += key + value;
  }
  std::uint64_t hash = 14695981039346656037u;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211u;
  return static_cast<double>(hash >> 12);
}

void state_of(mjData* d, StateNumbers& s) {
  for (mjWarningStat& warning : d->warning) s(warning.lastinfo), s(warning.number);
}

void state_of(DriveCommand& c, StateNumbers& s) {
  int mode = static_cast<int>(c.mode);
  s(mode);
  c.mode = static_cast<DriveCommand::Mode>(std::clamp(mode, 0, static_cast<int>(DriveCommand::Mode::position)));
  s(c.position_rad), s(c.velocity_rad_s), s(c.torque_nm), s(c.torque_limit_nm);
}

}  // namespace

void Watch::state(StateNumbers& s) {
  for (JointWatch& j : joints_) {
    s(j.saturated), s(j.beyond_range), s(j.too_fast), s(j.overloaded), s(j.too_cold), s(j.too_hot);
    s(j.error_squared_sum), s(j.error_max);
  }
  s(touched_steps_);
  // As many numbers for any number of pairs.
  std::size_t count = touched_.size();
  s(count);
  touched_.resize(pairs_named);
  for (TouchedGeoms& pair : touched_) s(pair.geom1), s(pair.geom2), s(pair.steps), s(pair.last_step);
  touched_.resize(std::min(count, pairs_named));
  const auto known = [&](int geom) { return geom >= 0 && geom < model_->ngeom; };
  std::erase_if(touched_, [&](const TouchedGeoms& pair) { return !known(pair.geom1) || !known(pair.geom2); });
}

void Twin::state(StateNumbers& s) {
  double mark = scenario_mark(*this);
  s(mark), s(next_event_), s(recording_index_), s(steps_), s(computed_);
  mujoco::engine::all_state(model_->get(), data_.get(), s);
  state_of(data_.get(), s);
  if (servo_) servo_->state(s);
  if (drive_servo_) drive_servo_->state(s);
  for (DriveCommand& command : commands_) state_of(command, s);
  for (SetPoint& point : set_points_) s.doubles(point);
  for (JointFigures& figures : figures_) s.doubles(figures);
  for (std::vector<double>* all : {&q_begin_, &qd_begin_, &qvel_begin_}) s(all->data(), all->size());
  for (double* x : {&motor_work_J_, &other_work_J_, &energy_start_J_, &energy_jumps_J_}) s(*x);
  watch_.state(s);
}

Result<std::vector<double>> Twin::save() {
  if (!status_) return tl::unexpected(status_.error());
  if (!happened_.empty())
    return tl::unexpected(
        Error("events that came from outside the scenario have no place in a saved state; give them "
              "in the scenario's `events`"));
  std::vector<double> numbers;
  StateNumbers writer(numbers);
  state(writer);
  return numbers;
}

void Twin::follow_events() {
  model_ = scenario_.model;
  faults_.clear();
  happened_.clear();
  for (std::size_t i = 0; i < next_event_; ++i) {
    const Event& event = scenario_.events[i];
    if (const auto* payload = std::get_if<PayloadChange>(&event.what)) model_ = payload->model;
    if (const auto* fault = std::get_if<FaultChange>(&event.what)) begin_fault(*fault, event.time_s);
  }
}

Result<void> Twin::restore(std::span<const double> numbers) {
  std::vector<double> before;
  StateNumbers writer(before);
  state(writer);
  if (numbers.empty() || numbers[0] != before[0]) return tl::unexpected(Error("the state is one of another scenario"));
  if (numbers.size() != before.size())
    return tl::unexpected(
        Error(fmt::format("the state has {} numbers but one of this scenario has {}", numbers.size(), before.size())));
  const double events = static_cast<double>(scenario_.events.size()),
               rows = scenario_.recording ? static_cast<double>(scenario_.recording->time_s.size()) : 1;
  const auto whole = [](double x, double most) { return x >= 0 && x <= most && x == std::floor(x); };
  if (!whole(numbers[1], events) || !whole(numbers[2], rows - 1) ||
      !whole(numbers[3], std::min(static_cast<double>(total_), 0x1p53)) || !whole(numbers[4], numbers[3]))
    return tl::unexpected(Error("the state is damaged: its time or events are not those of this scenario"));
  StateNumbers reader(numbers);
  state(reader);
  status_ = Status::running;
  follow_events();
  return {};
}

}  // namespace tribotwin::twin
