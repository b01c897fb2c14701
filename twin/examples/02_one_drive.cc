// One joint drive (motor, gear, friction, heat) that slides at constant speed and warms up. The step has two halves:
// the first gives the friction limit, the second takes the friction that acted and turns it into heat.
#include <cstdio>

#include <tribotwin/plugins/drive/configuration.hpp>

int main() {
  using namespace tribotwin;

  // The keys are those of the MJCF element <config key="..." value="..."/>.
  drive::Configuration keys{{"law", "extended"},        {"torque_max_nm", "7000"}, {"gear_ratio", "178"},
                            {"thermal", "first_order"}, {"R_th", "0.15"},          {"kappa", "10944"}};
  const auto law = friction::published_law("extended");
  for (std::size_t i = 0; i < law->info->parameters.size(); ++i)
    keys.emplace_back(law->info->parameters[i].name, std::to_string(law->parameters[i]));
  const auto drive = drive::make_drive("j2", keys);
  if (!drive) return std::fprintf(stderr, "%s\n", drive.error().message.c_str()), 1;

  drive::State state;            // the drive's state
  drive::Workspace workspace{};  // inputs, cache and outputs
  drive::set_temperature(*drive, state, 35);
  const double dt_s = 0.1, speed_rad_s = 1;
  const thermal::Decay decay = thermal::decay(drive->thermal, dt_s);
  for (int k = 0; k <= 36000; ++k) {
    const double time_s = k * dt_s, friction_nm = drive::begin_step(*drive, state, workspace, time_s, speed_rad_s);
    drive::end_step(*drive, decay, {.friction_nm = friction_nm, .torque_nm = friction_nm, .qd_end_rad_s = speed_rad_s},
                    dt_s, state, workspace);
    if (k % 9000 == 0)
      std::printf("%5.0f s: friction %6.1f Nm at %5.2f degC\n", time_s, workspace.friction_nm,
                  workspace.temperature_degC);
  }
}

// Prints:
//     0 s: friction  642.2 Nm at 35.00 degC
//   900 s: friction  599.7 Nm at 41.66 degC
//  1800 s: friction  548.7 Nm at 47.12 degC
//  2700 s: friction  515.5 Nm at 51.66 degC
//  3600 s: friction  492.4 Nm at 55.51 degC
