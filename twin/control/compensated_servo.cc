#include <tribotwin/twin/control/compensated_servo.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin {
namespace {

class Compensated final : public Servo {
 public:
  Compensated(const mujoco::Model& model, const mjData* start, const CompensatedOptions& o)
      : model_(model), servo_(model, start, o.loops), commands_(model.drives().size()) {
    std::uint64_t seed = o.seed;
    for (const mujoco::Spring& spring : model.springs()) {
      const JointModel plant{.drive = spring.drive.drive,
                             .transmission = spring.hysteresis,
                             .inertia_kg_m2 = model->dof_armature[spring.drive.dof],
                             .ratio = ratio_of(spring)};
      joints_.push_back({drive_of(model, spring), plant.ratio,
                         Compensator(plant.misjudged(o.identification_error, seed++), o.compensator)});
    }
  }

  void control(const mjModel* m, mjData* d, std::span<const SetPoint> set_points) override {
    servo_.measure(m, d);
    for (std::size_t i = 0; i < commands_.size(); ++i)
      commands_[i] = {.mode = DriveCommand::Mode::position,
                      .position_rad = set_points[i].position_rad,
                      .velocity_rad_s = set_points[i].velocity_rad_s};
    for (Joint& joint : joints_) {
      const mujoco::Binding& drive = model_.drives()[joint.drive];
      const Encoder& encoder = servo_.encoder(joint.drive);
      const double speed = set_points[joint.drive].velocity_rad_s;
      const double torsion =
          joint.compensator.update({.torque_nm = d->ctrl[drive.control] * drive.gear,
                                    .angle_rad = encoder.angle_rad(),
                                    .speed_rad_s = encoder.speed_rad_s(),
                                    .resolution_rad = encoder.resolution_rad(),
                                    .acceleration_rad_s2 = (speed - joint.speed_before_rad_s) / m->opt.timestep,
                                    .temperature_degC = drive::temperature_degC(drive.drive, mujoco::state(d, drive))},
                                   d->time, m->opt.timestep);
      joint.speed_before_rad_s = speed;
      commands_[joint.drive].position_rad += joint.ratio * torsion;
    }
    servo_.actuate(m, d, commands_);
  }
  void state(StateNumbers& s) override {
    servo_.state(s);
    for (Joint& joint : joints_) joint.compensator.state(s), s(joint.speed_before_rad_s);
  }

 private:
  struct Joint {
    std::size_t drive;
    double ratio;
    Compensator compensator;
    double speed_before_rad_s = 0;
  };
  const mujoco::Model& model_;
  DriveServo servo_;
  std::vector<DriveCommand> commands_;
  std::vector<Joint> joints_;
};

}  // namespace

std::unique_ptr<Servo> make_compensated(const mujoco::Model& model, const mjData* start,
                                        const CompensatedOptions& options) {
  return std::make_unique<Compensated>(model, start, options);
}

}  // namespace tribotwin::twin
