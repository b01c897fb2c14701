#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin {

/// Running figures of one joint.
struct JointFigures {
  double temperature_max_degC = -1e9;
  double friction_squared_sum = 0, friction_max_nm = 0;
  double load_max_norm = 0;
};

/// One simulation of a scenario: `while (twin.step()) ...`. Several twins of one scenario run in parallel threads; they
/// share the model and nothing else.
class Twin {
 public:
  explicit Twin(const Scenario& scenario);
  /// A twin whose drives do what `commands` says, in place of the scenario's motion and control: for controllers
  /// outside. The loops' gains are those of the scenario's servo.
  static constexpr struct Commanded {
  } commanded{};
  Twin(const Scenario& scenario, Commanded);
  Twin(const Twin&) = delete;
  Twin& operator=(const Twin&) = delete;

  /// Advances one time step; applies due events first. Fails when the simulation diverges or a drive of validity
  /// `error` leaves its range: the message names step, joint and state.
  Result<void> step();

  double time_s() const { return static_cast<double>(steps_) * timestep_s_; }
  std::int64_t steps() const { return steps_; }  ///< of simulated time, skipped ones included
  std::int64_t steps_computed() const { return computed_; }
  const mujoco::Model& model() const { return *model_; }
  mjData* data() { return data_.get(); }
  const mjData* data() const { return data_.get(); }
  const drive::Workspace& drive(std::size_t i) const { return mujoco::workspace(data_.get(), model_->drives()[i]); }
  const drive::State& state(std::size_t i) const { return mujoco::state(data_.get(), model_->drives()[i]); }
  double temperature_degC(std::size_t i) const { return drive::temperature_degC(model_->drives()[i].drive, state(i)); }
  const JointFigures& figures(std::size_t i) const { return figures_[i]; }

  /// Of a commanded twin: read at every step.
  std::span<DriveCommand> commands() { return commands_; }
  /// Whether a commanded drive's torque was cut to a limit in the last step.
  bool limited(std::size_t i) const { return drive_servo_->limited(i); }
  void set_brake(std::size_t i, bool engaged);
  /// Holds a drive's temperature at what a bench measured [degC]; without a value the thermal model goes on from there.
  void set_measured_temperature(std::size_t i, std::optional<double> temperature_degC);

  /// State at the start of the last step, per drive.
  double position_rad(std::size_t i) const { return q_begin_[i]; }
  double velocity_rad_s(std::size_t i) const { return qd_begin_[i]; }

  /// A transmission at the start of the last step. Torsion and set point are those of the arm.
  struct Transmission {
    std::size_t drive;
    double torsion_rad, torque_nm, arm_rad, arm_set_point_rad, arm_set_speed_rad_s;
  };
  Transmission transmission(const mujoco::Spring& spring) const;

  /// Mechanical energy balance since the start [J]: work of motors and of all other actuators - change of kinetic and
  /// potential energy (payload changes excluded) - friction work; 0 up to the integrator's error.
  double balance_J() const;
  double motor_work_J() const { return motor_work_J_; }

  /// Time in which no growing fault's friction changes by more than 5 % [s], infinite when none grows.
  double growth_horizon_s() const;
  /// Time of the next event, infinite when there is none.
  double next_event_s() const;
  /// Lets simulated time pass without stepping: `steps` steps in which the drives got the given heat [J] and reached
  /// the given rise. For motions that repeat; the mechanical state stays.
  void skip(std::int64_t steps, std::span<const thermal::Rise> rise, std::span<const double> heat_J);

 private:
  static void control(void* self, const mjModel* m, mjData* d);
  void apply(const Event& event);
  void set_faults();
  double mechanical_energy_J() const;
  std::string diagnosis() const;

  const Scenario& scenario_;
  std::shared_ptr<const mujoco::Model> model_;
  mujoco::DataPtr data_;
  std::unique_ptr<Servo> servo_;
  std::unique_ptr<DriveServo> drive_servo_;  ///< of a commanded twin, in place of servo_
  std::vector<DriveCommand> commands_;
  std::vector<SetPoint> set_points_;
  std::vector<double> q_begin_, qd_begin_;
  std::vector<JointFigures> figures_;
  double timestep_s_;
  std::int64_t steps_ = 0, computed_ = 0;
  std::size_t next_event_ = 0;
  struct ActiveFault {
    const FaultChange* fault;
    double since_s;
  };
  std::vector<ActiveFault> faults_;
  std::size_t recording_index_ = 0;
  bool controlled_ = false;
  std::vector<double> qvel_begin_;  ///< of all joints, where actuators beside the drives work on them
  double motor_work_J_ = 0, other_work_J_ = 0, energy_start_J_ = 0, energy_jumps_J_ = 0;
};

}  // namespace tribotwin::twin
