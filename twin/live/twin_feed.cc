#include <cmath>

#include <tribotwin/twin/live/law.hpp>
#include <tribotwin/twin/live/twin_feed.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/channels.hpp>

namespace tribotwin::twin::live {

Hello hello_of(const Scenario& scenario, std::string program, std::string version) {
  const mujoco::Model& model = *scenario.model;
  Hello hello{.program = std::move(program),
              .version = std::move(version),
              .scenario = scenario.name,
              .step_s = model.get()->opt.timestep,
              .columns = {{"", "time_s", "s"}},
              .law = [model = scenario.model](std::size_t joint, const drive::Workspace& state) {
                return law_of(*model, joint, state);
              }};
  const std::vector<Channel> all = channels(model);
  for (const auto& binding : model.drives()) {
    const std::string joint = joint_name(model.get(), binding);
    const friction::Law& law = binding.drive.law;
    const double limit_degC = law.range.temperature_max_degC;
    hello.joints.push_back({joint, law.info ? std::string(law.info->name) : std::string(),
                            std::isfinite(limit_degC) ? std::optional(limit_degC) : std::nullopt,
                            binding.drive.gear_ratio});
    const std::vector<std::string> of_units = units(model, binding);
    for (std::size_t c = 0; c < all.size(); ++c) hello.columns.push_back({joint, all[c].name, of_units[c]});
  }
  return hello;
}

std::vector<drive::Workspace> joints_of(const Twin& twin) {
  std::vector<drive::Workspace> joints;
  for (std::size_t i = 0; i < twin.model().drives().size(); ++i) joints.push_back(twin.drive(i));
  return joints;
}

void push_row(Server& server, const Twin& twin, double time_s) {
  server.rows().push([&](std::span<double> row) {
    row[0] = time_s;
    read_channels(twin, row.subspan(1));
  });
}

void TwinFeed::sample(const Twin& twin, double time_s) {
  push_row(server_, twin, time_s);
  const auto now = Clock::now();
  if (now < status_due_) return;
  status_due_ = now + status_period;
  server_.tell(Status{.simulated_s = twin.time_s(),
                      .wall_s = std::chrono::duration<double>(now - started_).count(),
                      .recording = recording_,
                      .joints = joints_of(twin)});
}

}  // namespace tribotwin::twin::live
