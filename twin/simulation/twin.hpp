#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>
#include <tribotwin/twin/simulation/watch.hpp>

namespace tribotwin::twin {

/// Outcome of a step of a twin; the third one is an error.
enum class Status {
  running,   ///< one time step was computed
  finished,  ///< the scenario's duration is over: nothing was computed
};

/// Statistics of one joint since the start of the run; the sum is over all steps, skipped ones included.
struct JointFigures {
  double temperature_max_degC = -1e9, winding_max_degC = -1e9;
  double friction_squared_sum = 0, friction_max_nm = 0;
  double load_max_norm = 0;
};

/// One simulation of a scenario:
///
///     Twin twin(std::move(*scenario));
///     while (twin.step() == Status::running) use(twin.temperature_degC(0));
///     if (!twin.status()) report(twin.status().error().message);
///
/// A twin owns its scenario. The model is shared and immutable, so twins of one scenario may run in parallel threads.
class Twin {
 public:
  explicit Twin(Scenario scenario);
  /// A twin whose drives follow `commands` instead of the scenario's motion and control, for external controllers. The
  /// loops have the gains of the scenario's servo. Such a twin never finishes.
  static constexpr struct Commanded {
  } commanded{};
  Twin(Scenario scenario, Commanded);
  Twin(const Twin&) = delete;
  Twin& operator=(const Twin&) = delete;

  /// Applies due events, then advances one time step. Fails when the simulation diverges or a drive of validity `error`
  /// leaves its range: the message names step, joint and state. A failed twin stays failed.
  Result<Status> step();
  /// Something happens now: before the next step, after what the scenario has for its time.
  void happen(Event event);
  /// The result of the last step.
  const Result<Status>& status() const { return status_; }

  /// Everything that the next steps depend on, and the sums since the start, as numbers for `restore`; as many for
  /// every time of a scenario. Fails for a twin that has failed, and after `happen`.
  Result<std::vector<double>> save();
  /// Goes to a state that a twin of the same scenario and engine saved: its steps are then the same doubles. One of a
  /// scenario that differs in anything (scenario_mark.hpp) is refused and changes nothing. Events of `happen` are
  /// forgotten.
  Result<void> restore(std::span<const double> numbers);

  const Scenario& scenario() const { return scenario_; }
  double time_s() const { return static_cast<double>(steps_) * timestep_s_; }
  std::int64_t steps() const { return steps_; }  ///< of simulated time, skipped ones included
  std::int64_t steps_computed() const { return computed_; }
  /// Steps until the scenario's end.
  std::int64_t steps_total() const { return total_; }
  const mujoco::Model& model() const { return *model_; }
  mjData* data() { return data_.get(); }
  const mjData* data() const { return data_.get(); }
  const drive::Workspace& drive(std::size_t i) const { return mujoco::workspace(data_.get(), model_->drives()[i]); }
  const drive::State& state(std::size_t i) const { return mujoco::state(data_.get(), model_->drives()[i]); }
  double temperature_degC(std::size_t i) const { return drive::temperature_degC(model_->drives()[i].drive, state(i)); }
  /// Of the winding; of the lubricant without one.
  double winding_degC(std::size_t i) const { return drive::winding_degC(model_->drives()[i].drive, state(i)); }
  const JointFigures& figures(std::size_t i) const { return figures_[i]; }
  const Watch& watch() const { return watch_; }

  /// Whether commands move the drives.
  bool takes_commands() const { return drive_servo_ != nullptr; }
  /// Commands of a commanded twin, per drive. Each step reads them.
  std::span<DriveCommand> commands() { return commands_; }
  std::span<const DriveCommand> commands() const { return commands_; }
  /// Whether a limit cut a commanded drive's torque in the last step.
  bool limited(std::size_t i) const { return drive_servo_->limited(i); }
  void set_brake(std::size_t i, bool engaged);
  /// Of a commanded twin: gains of a drive's loops, in place of the scenario's.
  void set_gains(std::size_t i, const LoopGains& gains) { drive_servo_->set_gains(i, gains); }
  /// Holds a drive's temperature at a measured value [degC]. Without a value the thermal model continues from there.
  void set_measured_temperature(std::size_t i, std::optional<double> temperature_degC);

  /// State of a drive at the start of the last step.
  double position_rad(std::size_t i) const { return q_begin_[i]; }
  double velocity_rad_s(std::size_t i) const { return qd_begin_[i]; }
  /// Of the scenario's motion at that time.
  const SetPoint& set_point(std::size_t i) const { return set_points_[i]; }

  /// State of a transmission at the start of the last step. Torsion and set point are on the arm side.
  struct Transmission {
    std::size_t drive;
    double torsion_rad, torque_nm, arm_rad, arm_set_point_rad, arm_set_speed_rad_s;
  };
  Transmission transmission(const mujoco::Spring& spring) const;

  /// Residual of the mechanical energy balance since the start [J]: work of all actuators - change of kinetic and
  /// potential energy (payload changes excluded) - friction work. 0 up to the integrator's error.
  double balance_J() const;
  double motor_work_J() const { return motor_work_J_; }

  /// Time in which no growing fault changes friction by more than 5 % [s]; infinite when none grows.
  double growth_horizon_s() const;
  /// Time of the next event that changes something [s]; infinite when there is none.
  double next_event_s() const;
  /// Advances simulated time by `steps` time steps without computing them. The drives reach the given temperature rise;
  /// the mechanical state stays. For motions that repeat.
  void skip(std::int64_t steps, std::span<const thermal::Rise> rise);
  /// What adds up over a run beside heat, as numbers: squared friction, time held by friction, and what the health
  /// check counts. Later vectors may be longer; what is new was 0.
  std::vector<double> sums() const;
  /// Adds the heat of each drive [J], and sums as above, of steps that were skipped.
  void add(std::span<const double> heat_J, std::span<const double> sums);

 private:
  void set_start_state();
  Result<Status> advance();
  void begin_step();
  Result<void> check_engine() const;
  Result<void> account(std::size_t drive);
  static void control(void* self, const mjModel* m, mjData* d);
  bool recorded_torque_off();
  void apply(const Event& event);
  void apply(const Wear& wear);
  void apply_due_events();
  void set_faults();
  void begin_fault(const FaultChange& fault, double since_s);
  void state(StateNumbers& s);
  /// Of the scenario, and of whether commands move the drives.
  double mark();
  /// What the scenario's events so far have left beside the numbers: the model and the faults.
  void follow_events();
  double mechanical_energy_J() const;
  std::string state_text() const;

  const Scenario scenario_;
  std::shared_ptr<const mujoco::Model> model_;
  mujoco::DataPtr data_;
  std::unique_ptr<Servo> servo_;
  std::unique_ptr<DriveServo> drive_servo_;  ///< of a commanded twin, in place of servo_
  std::vector<DriveCommand> commands_;
  std::vector<SetPoint> set_points_;
  std::vector<double> q_begin_, qd_begin_;
  std::vector<JointFigures> figures_;
  Watch watch_;
  double timestep_s_;
  std::int64_t steps_ = 0, computed_ = 0, total_;
  Result<Status> status_ = Status::running;
  std::size_t next_event_ = 0;
  struct ActiveFault {
    const FaultChange* fault;
    double since_s;
  };
  std::vector<ActiveFault> faults_;
  std::deque<Event> happened_;  ///< faults_ points into it
  std::size_t recording_index_ = 0;
  double mark_ = 0;                 ///< of scenario_, once it was needed
  bool controlled_ = false;         ///< in this step
  std::vector<double> qvel_begin_;  ///< of all joints; empty without actuators beside the drives
  double motor_work_J_ = 0, other_work_J_ = 0, energy_start_J_ = 0, energy_jumps_J_ = 0;
};

}  // namespace tribotwin::twin
