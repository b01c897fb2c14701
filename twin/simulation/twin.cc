#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/engine_state.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/scenario_mark.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

namespace tribotwin::twin {
namespace {

template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};
template <class... F>
Overloaded(F...) -> Overloaded<F...>;  // clang 14 deduces none for aggregates

/// Period at which growing faults are updated: growth is slow, and friction's coefficients stay cached in between.
constexpr double growth_step_s = 1;

/// Whether the control makes the drives follow the motion's positions.
bool follows_motion(const Scenario& scenario) {
  const auto* loops = std::get_if<CascadedOptions>(&scenario.control);
  return scenario.motion && !std::holds_alternative<std::vector<double>>(scenario.control) &&
         (!loops || loops->mode == DriveCommand::Mode::position);
}

/// Warnings of the engine that leave forces out but no state that is not finite; the health check counts them.
bool ends_run(int warning) {
  if (mujoco::engine::concerns_pictures(warning)) return false;
  return warning != mjWARN_CONTACTFULL && warning != mjWARN_CNSTRFULL;
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

Twin::Twin(Scenario scenario, Commanded) : Twin(std::move(scenario)) {
  servo_.reset();
  watch_ = Watch(scenario_, false);
  const auto* gains = std::get_if<CascadedOptions>(&scenario_.control);
  drive_servo_ = std::make_unique<DriveServo>(*model_, data_.get(), gains ? *gains : CascadedOptions{});
  commands_.resize(model_->drives().size());
  total_ = std::numeric_limits<std::int64_t>::max();
}

void Twin::set_brake(std::size_t i, bool engaged) {
  mujoco::workspace(data_.get(), model_->drives()[i]).brake_engaged = engaged;
}

void Twin::set_measured_temperature(std::size_t i, std::optional<double> temperature_degC) {
  const auto& binding = model_->drives()[i];
  mujoco::workspace(data_.get(), binding).temperature_held = temperature_degC.has_value();
  if (temperature_degC) drive::set_temperature(binding.drive, mujoco::state(data_.get(), binding), *temperature_degC);
}

Twin::Twin(Scenario scenario)
    : scenario_(std::move(scenario)),
      model_(scenario_.model),
      data_(model_->make_data()),
      watch_(scenario_, follows_motion(scenario_)),
      timestep_s_((*model_)->opt.timestep),
      total_(std::llround(std::ceil(scenario_.duration_s / timestep_s_ - 1e-6))) {
  const auto drives = model_->drives();
  set_points_.resize(drives.size());
  q_begin_.resize(drives.size());
  qd_begin_.resize(drives.size());
  figures_.resize(drives.size());
  set_start_state();
  std::visit(Overloaded{[&](const CascadedOptions& o) { servo_ = make_cascaded(*model_, data_.get(), o); },
                        [&](const CompensatedOptions& o) { servo_ = make_compensated(*model_, data_.get(), o); },
                        [&](const std::vector<DcPositionOptions>& o) { servo_ = make_dc_position(*model_, o); },
                        [&](const std::vector<double>& torque) { servo_ = make_torque(*model_, torque); }},
             scenario_.control);
  if (static_cast<std::size_t>((*model_)->nu) > drives.size())
    qvel_begin_.resize(static_cast<std::size_t>((*model_)->nv));
  energy_start_J_ = mechanical_energy_J();
}

void Twin::set_start_state() {
  const auto drives = model_->drives();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    data_->qpos[position_address(model_->get(), drives[i])] = scenario_.start_rad[i];
    drive::set_temperature(drives[i].drive, mujoco::state(data_.get(), drives[i]), scenario_.temperature_degC[i]);
    drive::set_winding(drives[i].drive, mujoco::state(data_.get(), drives[i]), scenario_.temperature_degC[i]);
    if (scenario_.ambient_degC)
      mujoco::workspace(data_.get(), drives[i]).ambient_offset_K =
          *scenario_.ambient_degC - drives[i].drive.thermal.T_amb_degC;
  }
  mj_forward(model_->get(), data_.get());
  // The gear of an arm at rest carries gravity: friction of the first step depends on it.
  for (const auto& drive : drives)
    mujoco::state(data_.get(), drive).load_nm = gravity_torque_nm(model_->get(), data_.get(), drive.dof);
  for (const auto& drive : drives) mujoco::workspace(data_.get(), drive).step_open = 0;
}

double Twin::mechanical_energy_J() const {
  const mjModel* m = model_->get();
  mj_kinematics(m, data_.get());
  mj_comPos(m, data_.get());
  mj_crb(m, data_.get());
  double energy = 0;
  for (int body = 1; body < m->nbody; ++body)
    energy -= m->body_mass[body] * mju_dot3(m->opt.gravity, data_->xipos + 3 * body);
  std::vector<double> momentum(static_cast<std::size_t>(m->nv));
  mj_mulM(m, data_.get(), momentum.data(), data_->qvel);  // the joint-space inertia holds the rotors too
  return energy + 0.5 * mju_dot(momentum.data(), data_->qvel, static_cast<int>(m->nv));
}

double Twin::balance_J() const {
  double friction = 0;
  for (std::size_t i = 0; i < figures_.size(); ++i) friction += drive(i).friction_work_J;
  return motor_work_J_ + other_work_J_ - (mechanical_energy_J() - energy_start_J_ - energy_jumps_J_) - friction;
}

Twin::Transmission Twin::transmission(const mujoco::Spring& spring) const {
  const std::size_t i = drive_of(*model_, spring);
  const auto& s = mujoco::workspace(data_.get(), spring);
  const double ratio = ratio_of(spring);
  return {i,
          s.torsion_begin_rad,
          s.torque_nm,
          q_begin_[i] / ratio - s.torsion_begin_rad,
          set_points_[i].position_rad / ratio,
          set_points_[i].velocity_rad_s / ratio};
}

double Twin::next_event_s() const {
  const auto next =
      std::find_if(scenario_.events.begin() + static_cast<std::ptrdiff_t>(next_event_), scenario_.events.end(),
                   [](const Event& event) { return !std::holds_alternative<Marker>(event.what); });
  return next == scenario_.events.end() ? friction::unlimited : next->time_s;
}

void Twin::apply(const Wear& wear) {
  for (const auto& d : model_->drives()) {
    if (joint_name(model_->get(), d) != wear.joint) continue;
    const auto& parameters = d.drive.law.info->parameters;
    for (std::size_t p = 0; p < parameters.size(); ++p)
      if (const auto found = wear.factors.find(std::string(parameters[p].name)); found != wear.factors.end())
        drive::set_wear(mujoco::workspace(data_.get(), d), p, found->second);
  }
}

void Twin::apply(const Event& event) {
  if (std::holds_alternative<Marker>(event.what)) return;
  const double energy = mechanical_energy_J();
  std::visit(Overloaded{[&](const PayloadChange& change) { model_ = change.model; },
                        [&](const AmbientChange& change) {
                          for (const auto& d : model_->drives())
                            mujoco::workspace(data_.get(), d).ambient_offset_K =
                                change.temperature_degC - d.drive.thermal.T_amb_degC;
                        },
                        [&](const Wear& wear) { apply(wear); },
                        [&](const FaultChange& fault) {
                          begin_fault(fault, event.time_s);
                          set_faults();
                        },
                        [](const Marker&) {}},
             event.what);
  energy_jumps_J_ += mechanical_energy_J() - energy;
}

void Twin::begin_fault(const FaultChange& fault, double since_s) {
  std::erase_if(faults_,
                [&](const ActiveFault& a) { return a.fault->drive == fault.drive && a.fault->type == fault.type; });
  faults_.push_back({&fault, since_s});
}

void Twin::set_faults() {
  for (const ActiveFault& one : faults_) {
    drive::Faults all{};  // of its drive
    for (const auto& [fault, since_s] : faults_)
      if (fault->drive == one.fault->drive)
        fault->type->add(all, fault->severity + fault->growth_per_h * (time_s() - since_s) / 3600);
    drive::set_faults(mujoco::workspace(data_.get(), model_->drives()[one.fault->drive]), all);
  }
}

double Twin::growth_horizon_s() const {
  double growth_per_h = 0;
  for (const auto& [fault, since_s] : faults_)
    if (fault->type->unit == "1") growth_per_h = std::max(growth_per_h, fault->growth_per_h);
  return growth_per_h > 0 ? 0.05 * 3600 / growth_per_h : friction::unlimited;
}

bool Twin::recorded_torque_off() {
  if (!scenario_.recording || scenario_.recording->torque_on.empty()) return false;
  const SetPoints& r = *scenario_.recording;
  while (recording_index_ + 1 < r.time_s.size() && r.time_s[recording_index_ + 1] - r.time_s[0] <= time_s())
    ++recording_index_;
  return !r.torque_on[recording_index_];
}

void Twin::control(void* self, const mjModel* m, mjData* d) {
  Twin& twin = *static_cast<Twin*>(self);
  if (std::exchange(twin.controlled_, true)) return;  // later stages of an integrator keep the torque
  for (const Wave& wave : twin.scenario_.waves) d->ctrl[wave.control] = wave(twin.time_s());
  if (twin.drive_servo_) return twin.drive_servo_->control(m, d, twin.commands_);
  if (twin.scenario_.motion) twin.scenario_.motion->at(twin.time_s(), twin.set_points_);
  if (!twin.recorded_torque_off()) return twin.servo_->control(m, d, twin.set_points_);
  for (const auto& drive : twin.model_->drives()) d->ctrl[drive.control] = 0;
}

std::string Twin::state_text() const {
  std::string text;
  const auto drives = model_->drives();
  for (std::size_t i = 0; i < drives.size(); ++i)
    text += fmt::format("{}{} q {:.6g} rad, qd {:.6g} rad/s, motor {:.6g} Nm, {:.2f} degC", i ? "; " : "",
                        joint_name(model_->get(), drives[i]), q_begin_[i], qd_begin_[i], drive(i).torque_nm,
                        drive(i).temperature_degC);
  return text;
}

void Twin::apply_due_events() {
  const auto& events = scenario_.events;
  while (next_event_ < events.size() && events[next_event_].time_s <= time_s() + 0.5 * timestep_s_)
    apply(events[next_event_++]);
  const bool growing = std::ranges::any_of(faults_, [](const ActiveFault& a) { return a.fault->growth_per_h > 0; });
  if (growing && steps_ % std::max<std::int64_t>(1, std::llround(growth_step_s / timestep_s_)) == 0) set_faults();
}

void Twin::happen(Event event) {
  apply_due_events();
  happened_.push_back(std::move(event));
  apply(happened_.back());
}

void Twin::begin_step() {
  const auto drives = model_->drives();
  const mjData* d = data_.get();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    q_begin_[i] = d->qpos[position_address(model_->get(), drives[i])];
    qd_begin_[i] = d->qvel[drives[i].dof];
  }
  std::copy_n(d->qvel, qvel_begin_.size(), qvel_begin_.begin());
  controlled_ = false;
}

Result<void> Twin::check_engine() const {
  const auto drives = model_->drives();
  for (int w = 0; w < mjNWARNING; ++w) {
    if (data_->warning[w].number == 0 || !ends_run(w)) continue;
    const int which = data_->warning[w].lastinfo;
    std::string joint;
    for (const auto& drive : drives)
      if (((w == mjWARN_BADQVEL || w == mjWARN_BADQACC) && drive.dof == which) ||
          (w == mjWARN_BADQPOS && position_address(model_->get(), drive) == which))
        joint = ", joint " + joint_name(model_->get(), drive);
    return work_failed(fmt::format("the simulation diverged at step {} ({} s){}: {} State before the step: {}", steps_,
                                   time_s(), joint, mju_warningText(w, static_cast<std::size_t>(which)), state_text()));
  }
  return {};
}

Result<void> Twin::account(std::size_t i) {
  const auto& binding = model_->drives()[i];
  const drive::Workspace& s = drive(i);
  const double work = drive::delivered_nm(s) * 0.5 * (qd_begin_[i] + data_->qvel[binding.dof]) * timestep_s_;
  motor_work_J_ += work;
  if (!qvel_begin_.empty()) other_work_J_ -= work;
  other_work_J_ -= binding.drive.offset_nm * 0.5 * (qd_begin_[i] + data_->qvel[binding.dof]) * timestep_s_;
  JointFigures& f = figures_[i];
  f.temperature_max_degC = std::max(f.temperature_max_degC, s.temperature_degC);
  if (binding.drive.winding.present()) f.winding_max_degC = std::max(f.winding_max_degC, winding_degC(i));
  f.friction_squared_sum += s.friction_nm * s.friction_nm;
  f.friction_max_nm = std::max(f.friction_max_nm, std::abs(s.friction_nm));
  f.load_max_norm = std::max(f.load_max_norm, std::abs(s.load_used_nm) / binding.drive.torque_max_nm);
  if (s.outside == 0 || binding.drive.law.validity != friction::Validity::error) return {};
  return work_failed(
      fmt::format("joint {} left the range of its law '{}' at step {} ({} s), and its validity is 'error'. State: {}",
                  joint_name(model_->get(), binding), binding.drive.law.info->name, steps_, time_s(), state_text()));
}

Result<Status> Twin::advance() {
  if (steps_ >= total_) return Status::finished;
  apply_due_events();
  begin_step();
  model_->step(data_.get(), {control, this});
  ++computed_;
  if (auto ok = check_engine(); !ok) return tl::unexpected(ok.error());
  for (std::size_t i = 0; i < figures_.size(); ++i)
    if (auto ok = account(i); !ok) return tl::unexpected(ok.error());
  watch_.add(*this);
  for (std::size_t dof = 0; dof < qvel_begin_.size(); ++dof)
    other_work_J_ += data_->qfrc_actuator[dof] * 0.5 * (qvel_begin_[dof] + data_->qvel[dof]) * timestep_s_;
  ++steps_;
  return Status::running;
}

Result<Status> Twin::step() {
  if (status_) status_ = advance();
  return status_;
}

void Twin::skip(std::int64_t steps, std::span<const thermal::Rise> rise) {
  const auto drives = model_->drives();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    mujoco::state(data_.get(), drives[i]).rise = rise[i];
    figures_[i].temperature_max_degC = std::max(figures_[i].temperature_max_degC, temperature_degC(i));
  }
  steps_ += steps;
  data_->time = time_s();
  set_faults();
}

std::vector<double> Twin::sums() const {
  std::vector<double> sums;
  for (std::size_t i = 0; i < figures_.size(); ++i)
    sums.insert(sums.end(), {figures_[i].friction_squared_sum, drive(i).steps_outside, drive(i).stuck_s});
  watch_.append_sums(sums);
  return sums;
}

void Twin::add(std::span<const double> heat_J, std::span<const double> sums) {
  const double* sum = sums.data();
  for (std::size_t i = 0; i < figures_.size(); ++i) {
    drive::Workspace& s = mujoco::workspace(data_.get(), model_->drives()[i]);
    s.heat_J += heat_J[i];
    s.friction_work_J += heat_J[i];
    motor_work_J_ += heat_J[i];  // over a cycle that returns to its start, motor work equals friction work
    figures_[i].friction_squared_sum += *sum++;
    s.steps_outside += *sum++;
    s.stuck_s += *sum++;
  }
  watch_.add_sums(sums.subspan(static_cast<std::size_t>(sum - sums.data())));
}

double Twin::mark() {
  if (mark_ == 0) mark_ = static_cast<double>((scenario_mark(scenario_) >> 12) | 1);  // exact as a double
  return takes_commands() ? -mark_ : mark_;
}

void Twin::state(StateNumbers& s) {
  double mark = this->mark();
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
  if (numbers.empty() || numbers[0] != before[0])
    return tl::unexpected(
        Error("the state is one of another scenario: its keys, model, control, events, recording or engine differ, or "
              "commands move one of both twins"));
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
