#include <algorithm>
#include <cmath>

#include <tribotwin/twin/control/servo.hpp>

namespace tribotwin::twin {
namespace {

class Cascaded final : public Servo {
 public:
  Cascaded(const mujoco::Model& model, const mjData* start, const CascadedOptions& o)
      : servo_(model, start, o), commands_(model.drives().size()), mode_(o.mode) {}
  void control(const mjModel* m, mjData* d, std::span<const SetPoint> set_points) override {
    for (std::size_t i = 0; i < commands_.size(); ++i)
      commands_[i] = {.mode = mode_,
                      .position_rad = set_points[i].position_rad,
                      .velocity_rad_s = set_points[i].velocity_rad_s,
                      .torque_nm = set_points[i].torque_nm};
    servo_.control(m, d, commands_);
  }
  void state(StateNumbers& s) override { servo_.state(s); }

 private:
  DriveServo servo_;
  std::vector<DriveCommand> commands_;
  DriveCommand::Mode mode_;
};

double duty(const DcPositionOptions& o, double error_rad) {
  const double gain = o.kp * o.over_kp(o.kp) * o.error_gain * o.over_error(std::abs(error_rad));
  return std::clamp(gain * error_rad, -o.duty_limit, o.duty_limit);
}

double dc_torque_nm(const DcPositionOptions& o, double duty, double speed_rad_s, double resistance_ohm) {
  const double supply_V = o.supply_V * (1 - o.supply_resistance_ohm / o.resistance_ohm * duty * duty);
  const double torque = o.kt_nm_A / resistance_ohm * (duty * supply_V - o.kt_nm_A * speed_rad_s);
  return std::clamp(torque, -o.torque_limit_nm, o.torque_limit_nm);
}

class DcPosition final : public Servo {
 public:
  DcPosition(const mujoco::Model& model, std::vector<DcPositionOptions> o)
      : model_(model), options_(std::move(o)), duty_(options_.size()) {}
  void control(const mjModel* m, mjData* d, std::span<const SetPoint> set_points) override {
    for (std::size_t i = 0; i < model_.drives().size(); ++i) {
      const auto& drive = model_.drives()[i];
      const DcPositionOptions& o = options_[i];
      const double wanted = duty(o, set_points[i].position_rad - d->qpos[position_address(m, drive)]),
                   change = o.duty_slew_1_s * m->opt.timestep;
      duty_[i] = std::clamp(wanted, duty_[i] - change, duty_[i] + change);
      const double winding_degC = drive::winding_degC(drive.drive, mujoco::state(d, drive));
      const double warm = 1 + o.resistance_per_K * (winding_degC - o.reference_degC);
      // Warm magnets induce less voltage: as much as a cold motor would at a lower speed.
      const double speed_rad_s = d->qvel[drive.dof] * drive.drive.winding.torque_share(winding_degC);
      d->ctrl[drive.control] = dc_torque_nm(o, duty_[i], speed_rad_s, o.resistance_ohm * warm) / drive.gear;
    }
  }
  void state(StateNumbers& s) override { s(duty_.data(), duty_.size()); }

 private:
  const mujoco::Model& model_;
  std::vector<DcPositionOptions> options_;
  std::vector<double> duty_;
};

class Torque final : public Servo {
 public:
  Torque(const mujoco::Model& model, std::vector<double> torque_nm) : model_(model), torque_nm_(std::move(torque_nm)) {}
  void control(const mjModel*, mjData* d, std::span<const SetPoint>) override {
    for (std::size_t i = 0; i < torque_nm_.size(); ++i)
      d->ctrl[model_.drives()[i].control] = torque_nm_[i] / model_.drives()[i].gear;
  }

 private:
  const mujoco::Model& model_;
  std::vector<double> torque_nm_;
};

}  // namespace

DriveServo::DriveServo(const mujoco::Model& model, const mjData* start, const CascadedOptions& o)
    : model_(model), options_(o) {
  for (const auto& drive : model.drives()) {
    Loop loop;
    loop.inertia_kg_m2 = inertia_kg_m2(model.get(), start, drive.dof);
    loop.gains = o.per_drive.empty() ? LoopGains{o.position_gain_1_s, o.speed_bandwidth_rad_s, o.integral_time_s}
                                     : o.per_drive[loops_.size()];
    loop.position = position_address(model.get(), drive);
    loop.limit = model->actuator_ctrllimited[drive.actuator]
                     ? model->actuator_ctrlrange[2 * drive.control + 1] * drive.gear
                     : friction::unlimited;
    if (o.encoder_counts > 0) loop.encoder = Encoder(o.encoder_counts, drive.drive.gear_ratio, o.speed_filter_rad_s);
    loops_.push_back(loop);
  }
}

void DriveServo::set_gains(std::size_t drive, const LoopGains& gains) {
  LoopGains& own = loops_[drive].gains;
  own = gains;
  own.speed_bandwidth_rad_s = std::min(own.speed_bandwidth_rad_s, 1 / model_->opt.timestep);
}

void DriveServo::state(StateNumbers& s) {
  for (Loop& loop : loops_) {
    s(loop.integral_nm), s(loop.limited);
    LoopGains& g = loop.gains;
    for (double* x : {&g.position_gain_1_s, &g.speed_bandwidth_rad_s, &g.integral_time_s, &g.speed_gain_nm_s_rad,
                      &g.torque_limit_nm, &g.torque_gain})
      s(*x);
    loop.encoder.state(s);
  }
}

void DriveServo::measure(const mjModel* m, const mjData* d) {
  for (std::size_t i = 0; i < loops_.size(); ++i)
    loops_[i].encoder.read(d->qpos[loops_[i].position], d->qvel[model_.drives()[i].dof], m->opt.timestep);
}

void DriveServo::actuate(const mjModel* m, mjData* d, std::span<const DriveCommand> commands) {
  using Mode = DriveCommand::Mode;
  for (std::size_t i = 0; i < loops_.size(); ++i) {
    Loop& loop = loops_[i];
    const DriveCommand& c = commands[i];
    const auto& drive = model_.drives()[i];
    const double limit = std::min({loop.limit, c.torque_limit_nm, loop.gains.torque_limit_nm});
    const double speed_gain = loop.gains.speed_gain_nm_s_rad > 0
                                  ? loop.gains.speed_gain_nm_s_rad
                                  : loop.gains.speed_bandwidth_rad_s * loop.inertia_kg_m2;
    double torque = loop.gains.torque_gain * c.torque_nm;
    if (c.mode == Mode::position || c.mode == Mode::velocity) {
      double speed = c.velocity_rad_s;
      if (c.mode == Mode::position) speed += loop.gains.position_gain_1_s * (c.position_rad - loop.encoder.angle_rad());
      const double error = speed - loop.encoder.speed_rad_s();
      const double forward = options_.gravity ? gravity_torque_nm(m, d, drive.dof) : 0;
      torque += forward + speed_gain * error + loop.integral_nm;
      // At the limit the integral only moves inwards.
      if (loop.gains.integral_time_s > 0 && (std::abs(torque) <= limit || error * torque < 0))
        loop.integral_nm += speed_gain / loop.gains.integral_time_s * error * m->opt.timestep;
    } else {
      loop.integral_nm = 0;
      if (c.mode == Mode::off) torque = 0;
    }
    loop.limited = std::abs(torque) > limit;
    d->ctrl[drive.control] = std::clamp(torque, -limit, limit) / drive.gear;
  }
}

double GainCurve::operator()(double x) const {
  const auto of = [this](std::size_t k) { return std::isnan(factor[k]) ? 1 : factor[k]; };
  std::size_t knots = 0;
  while (knots < most && !std::isnan(at[knots])) ++knots;
  if (knots == 0) return 1;
  if (x <= at[0]) return of(0);
  for (std::size_t k = 1; k < knots; ++k)
    if (x < at[k]) return of(k - 1) + (of(k) - of(k - 1)) * (x - at[k - 1]) / (at[k] - at[k - 1]);
  return of(knots - 1);
}

double dc_torque_nm(const DcPositionOptions& o, double error_rad, double speed_rad_s) {
  return dc_torque_nm(o, duty(o, error_rad), speed_rad_s, o.resistance_ohm);
}

std::unique_ptr<Servo> make_cascaded(const mujoco::Model& model, const mjData* start, const CascadedOptions& options) {
  return std::make_unique<Cascaded>(model, start, options);
}
std::unique_ptr<Servo> make_dc_position(const mujoco::Model& model, std::vector<DcPositionOptions> options) {
  return std::make_unique<DcPosition>(model, std::move(options));
}
std::unique_ptr<Servo> make_torque(const mujoco::Model& model, std::vector<double> torque_nm) {
  return std::make_unique<Torque>(model, std::move(torque_nm));
}

}  // namespace tribotwin::twin
