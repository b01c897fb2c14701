#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/friction/experiment.hpp>

namespace tribotwin::twin {
namespace {

// After a ramp the slowest pole of the servo (14.5 rad/s) decays over `settle_s` to 0.07 %; levels_of removes more
// where the position shows it.
constexpr double ramp_s = 0.2, settle_s = 0.5, measure_s = 0.5, dwell_s = 0.05;
constexpr double longest_step_s = 0.004;
constexpr double deg = std::numbers::pi / 180;

/// Zhou 2024, Table 1 [deg/s, deg].
constexpr struct {
  double speed, displacement;
} cycle[] = {{0.1, 2},  {0.5, 6},  {1, 15},   {1.5, 15}, {2, 30},   {3, 30},   {5, 60},   {8, 120},
             {10, 120}, {15, 180}, {30, 240}, {45, 360}, {60, 360}, {80, 360}, {100, 360}};

/// Data with the arm at a pose, with load and temperature from before the motion.
mujoco::DataPtr prepared(const mujoco::Model& bench, std::size_t drive, std::span<const double> pose_rad,
                         const Measurement& me) {
  const mjModel* m = bench.get();
  mujoco::DataPtr d = bench.make_data();
  const auto drives = bench.drives();
  for (std::size_t i = 0; i < drives.size(); ++i) d->qpos[position_address(m, drives[i])] = pose_rad[i];
  mj_forward(m, d.get());
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const bool own = i == drive;
    drive::Workspace& s = mujoco::workspace(d.get(), drives[i]);
    drive::State& state = mujoco::state(d.get(), drives[i]);
    s = {};
    s.temperature_held = own ? me.heat.held : 1;
    if (own) {
      state.rise = me.heat.rise;
      drive::set_winding(drives[i].drive, state, drive::temperature_degC(drives[i].drive, state));
      s.ambient_offset_K = me.heat.ambient_offset_K;
      drive::set_faults(s, me.faults);
    } else {
      s.brake_engaged = 1e6;  // the others are braked
    }
    state.load_nm = gravity_torque_nm(m, d.get(), drives[i].dof) + (own ? me.external_nm : 0);
  }
  d->qfrc_applied[drives[drive].dof] = -me.external_nm;
  return d;
}

struct Loop {
  DriveServo& servo;
  std::vector<DriveCommand>& commands;
  bool fresh = true;  ///< later stages of an integrator keep the torque
  static void control(void* self, const mjModel* m, mjData* d) {
    Loop& loop = *static_cast<Loop*>(self);
    if (std::exchange(loop.fresh, false)) loop.servo.control(m, d, loop.commands);
  }
};

/// How long the joint sticks at a reversal at speed v: until the torque has changed by gain v (1 + (Kp + 1/Ti) t +
/// Kp/(2 Ti) t^2) from friction in one direction to friction in the other.
double stuck_s(const CascadedOptions& servo, double breakaway_nm, double gain, double v) {
  const double per_s = servo.integral_time_s > 0 ? 1 / servo.integral_time_s : 0;
  const double a = 0.5 * servo.position_gain_1_s * per_s, b = servo.position_gain_1_s + per_s,
               c = 1 - 2 * breakaway_nm / (gain * v);
  return c >= 0 ? 0 : a > 0 ? (-b + std::sqrt(b * b - 4 * a * c)) / (2 * a) : b > 0 ? -c / b : 1e300;
}

}  // namespace

Result<std::shared_ptr<const mujoco::Model>> bench_of(const mujoco::Model& arm, bool gravity, double sampling_hz) {
  // Stiction or friction of a joint may need a shorter step. Tried on a copy: engine plugins terminate the process
  // instead of refusing a model.
  const mujoco::ModelPtr trial(mj_copyModel(nullptr, arm.get()));
  double parts = std::ceil(1 / sampling_hz / std::max(longest_step_s, arm->opt.timestep) - 1e-9);
  const auto carries = [&] {
    trial->opt.timestep = 1 / sampling_hz / parts;
    return trial->opt.timestep <= arm->opt.timestep || std::ranges::all_of(arm.drives(), [&](const auto& b) {
             return mujoco::bind(trial.get(), b.drive, b.actuator).has_value();
           });
  };
  while (!carries()) ++parts;
  return mujoco::variant(arm, [&](mjModel* m) {
    if (!gravity) mju_zero3(m->opt.gravity);
    m->opt.disableflags |= mjDSBL_CONTACT;
    for (int j = 0; j < m->njnt; ++j) m->jnt_limited[j] = 0;
    for (int i = 0; i < m->nu; ++i) m->actuator_ctrllimited[i] = 0;
    m->opt.timestep = trial->opt.timestep;
  });
}

Result<Motion> plus_minus(const mujoco::Model& bench, std::size_t drive, const Measurement& me) {
  const auto& binding = bench.drives()[drive];
  const auto d = prepared(bench, drive, me.start_rad, me);
  const double load = std::abs(mujoco::state(d.get(), binding).load_nm) / binding.drive.torque_max_nm;
  const double breakaway = mujoco::friction_nm(binding.drive, 0, load,
                                               drive::temperature_degC(binding.drive, mujoco::state(d.get(), binding)));
  const double gain = me.servo.speed_bandwidth_rad_s * inertia_kg_m2(bench.get(), d.get(), binding.dof);

  const std::size_t joints = bench.drives().size();
  const double approach = 0.5 * std::ranges::max(me.speeds_rad_s);
  const std::vector<double> approach_speed(joints, approach), approach_acceleration(joints, approach / ramp_s);
  std::vector<double> low = me.start_rad, high = me.start_rad;
  std::optional<Motion> motion;
  for (const double v : me.speeds_rad_s) {
    const double stuck = stuck_s(me.servo, breakaway, gain, v);
    if (v < 1e-4 || stuck > 20)
      return work_failed(fmt::format(
          "no steady motion at {:g} motor rad/s ({}); such low speeds stick and slip, measure at higher ones",
          v * binding.drive.gear_ratio,
          v < 1e-4 ? "below 1e-4 rad/s of the joint"
                   : fmt::format("the servo would need {:.0f} s to break the joint away", stuck)));
    const double reach = 0.5 * std::min(v * measure_s, me.width_rad) + v * (0.5 * ramp_s + settle_s + 3 * stuck);
    low[drive] = me.start_rad[drive] - reach;
    high[drive] = me.start_rad[drive] + reach;
    const std::vector<double> speed(joints, v), acceleration(joints, v / ramp_s);
    if (!motion)
      motion.emplace(low);
    else
      motion->move_to(low, approach_speed, approach_acceleration).dwell(dwell_s);
    motion->move_to(high, speed, acceleration).dwell(dwell_s).move_to(low, speed, acceleration).dwell(dwell_s);
  }
  return *motion;
}

std::vector<double> test_cycle_speeds_rad_s() {
  std::vector<double> speeds;
  for (const auto& level : cycle) speeds.push_back(level.speed * deg);
  return speeds;
}

std::vector<double> test_cycle_travel_rad() {
  std::vector<double> travel;
  for (const auto& level : cycle) travel.push_back(level.displacement * deg / 2);
  return travel;
}

Motion test_cycle_of(const mujoco::Model& bench, std::size_t drive, std::span<const double> start_rad) {
  const std::size_t joints = bench.drives().size();
  const std::vector<double> centre(start_rad.begin(), start_rad.end()), acceleration(joints, 400 * deg),
      approach(joints, 50 * deg);
  Motion motion(centre);
  std::vector<double> low = centre, high = centre;
  for (const auto& level : cycle) {
    low[drive] = centre[drive] - level.displacement * deg / 4;
    high[drive] = centre[drive] + level.displacement * deg / 4;
    const std::vector<double> speed(joints, level.speed * deg);
    motion.move_to(low, approach, acceleration).dwell(dwell_s);
    motion.move_to(high, speed, acceleration).dwell(dwell_s).move_to(low, speed, acceleration).dwell(dwell_s);
  }
  return motion;
}

Result<JointRecording> record(const mujoco::Model& bench, std::size_t drive, const Motion& motion,
                              const Measurement& me, const std::function<void(double)>& progress) {
  const mjModel* m = bench.get();
  const auto d = prepared(bench, drive, motion.start_rad(), me);
  const auto& binding = bench.drives()[drive];
  const int address = position_address(m, binding);
  DriveServo servo(bench, d.get(), me.servo);
  std::vector<DriveCommand> commands(bench.drives().size());
  std::vector<SetPoint> set_points(commands.size());
  Loop loop{servo, commands};
  commands[drive].torque_nm = me.external_nm;

  const double dt = m->opt.timestep;
  const auto steps = static_cast<std::size_t>(std::ceil(motion.duration_s() / dt));
  JointRecording signals;
  for (auto* column : {&signals.time_s, &signals.position_rad, &signals.velocity_rad_s, &signals.torque_nm,
                       &signals.load_nm, &signals.temperature_degC})
    column->reserve(steps);
  for (std::size_t k = 0; k < steps; ++k) {
    const double t = static_cast<double>(k) * dt;
    motion.at(t, set_points);
    for (std::size_t i = 0; i < commands.size(); ++i) {
      commands[i].mode = DriveCommand::Mode::position;
      commands[i].position_rad = set_points[i].position_rad;
      commands[i].velocity_rad_s = set_points[i].velocity_rad_s;
    }
    signals.time_s.push_back(t);
    signals.position_rad.push_back(d->qpos[address]);
    signals.velocity_rad_s.push_back(d->qvel[binding.dof]);
    loop.fresh = true;
    bench.step(d.get(), {Loop::control, &loop});
    for (int w = 0; w < mjNWARNING; ++w)
      if (d->warning[w].number)
        return work_failed(fmt::format("the simulation diverged: {}",
                                       mju_warningText(w, static_cast<std::size_t>(d->warning[w].lastinfo))));
    const drive::Workspace& s = mujoco::workspace(d.get(), binding);
    signals.torque_nm.push_back(s.torque_nm);
    // Load of this step; that of the drive is one step late and filtered where configured. A controller measures it by
    // the motor current, like the torque.
    const double load = drive::delivered_nm(s) - s.friction_nm - binding.drive.offset_nm -
                        m->dof_armature[binding.dof] * (d->qvel[binding.dof] - signals.velocity_rad_s.back()) / dt;
    signals.load_nm.push_back(load / ((1 - me.faults.torque_loss) * (1 - s.hot_torque_loss)));
    signals.temperature_degC.push_back(s.temperature_degC);
    if (progress && k % 512 == 0) progress(static_cast<double>(k) / static_cast<double>(steps));
  }
  return sensed(signals, me.sensors, me.seed);
}

std::vector<CurvePoint> law_curve(const drive::Drive& drive, std::span<const double> speeds, double load_norm,
                                  double temperature_degC) {
  drive::Drive symmetric = drive;
  symmetric.asymmetry = 0;
  const auto level = [&](double speed) {
    return mujoco::friction_nm(symmetric, speed / drive.gear_ratio, load_norm, temperature_degC);
  };
  std::vector<CurvePoint> points;
  for (const double speed : speeds) {
    const double nm = std::copysign(level(speed), speed);
    points.push_back({speed, load_norm, temperature_degC, nm / drive.torque_max_nm, nm, 0,
                      level(std::abs(speed)) * (1 + drive.asymmetry) + drive.offset_nm,
                      level(-std::abs(speed)) * (1 - drive.asymmetry) - drive.offset_nm});
  }
  return points;
}

Result<std::vector<CurvePoint>> measure_curve(const mujoco::Model& model, std::size_t drive_index,
                                              std::span<const double> speeds, const ExperimentOptions& options) {
  const drive::Drive& drive = model.drives()[drive_index].drive;
  const bool gravity = options.load_by != LoadBy::torque;
  Measurement me{.speeds_rad_s = {},
                 .start_rad = std::vector<double>(model.drives().size(), 0.0),
                 .sensors = {.torque_noise_nm = options.noise_nm},
                 .seed = options.seed};
  for (const double speed : speeds) me.speeds_rad_s.push_back(std::abs(speed) / drive.gear_ratio);
  me.heat.rise = thermal::steady_rise(drive.thermal, options.temperature_degC - drive.thermal.T_amb_degC);
  if (gravity) {
    const auto pose = Gravity(model, drive_index, me.start_rad).pose_for(options.load_norm * drive.torque_max_nm);
    if (!pose) return tl::unexpected(Error(pose.error().message));
    me.start_rad = pose->position_rad;
    me.width_rad = pose->width_rad;
  } else {
    me.external_nm = options.load_norm * drive.torque_max_nm;
  }
  const auto bench = bench_of(model, gravity, me.sensors.sampling_hz);
  if (!bench) return work_failed(bench.error().message);
  const auto motion = plus_minus(**bench, drive_index, me);
  if (!motion) return work_failed(motion.error().message);
  const auto recording = record(**bench, drive_index, *motion, me, options.progress);
  if (!recording) return work_failed(recording.error().message);
  const auto levels = levels_of(*recording, {.speeds_rad_s = me.speeds_rad_s,
                                             .centre_rad = me.start_rad[drive_index],
                                             .width_rad = me.width_rad,
                                             .lag_s = 0});
  if (!levels) return work_failed(levels.error().message);
  std::vector<CurvePoint> points;
  for (std::size_t i = 0; i < speeds.size(); ++i) {
    const Level& level = levels->levels[i];
    const double friction = std::copysign(level.friction_nm, speeds[i]);
    points.push_back({std::copysign(level.speed_rad_s * drive.gear_ratio, speeds[i]),
                      level.load_nm / drive.torque_max_nm, level.temperature_degC, friction / drive.torque_max_nm,
                      friction, level.stderr_nm, level.forward->friction_nm, level.backward->friction_nm});
  }
  return points;
}

}  // namespace tribotwin::twin
