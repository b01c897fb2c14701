#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/live/protocol/geometry.hpp>
#include <tribotwin/twin/live/protocol/law.hpp>
#include <tribotwin/twin/live/twin_feed.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/channels.hpp>

namespace tribotwin::twin::live {

namespace {

std::vector<std::string> parameters_of(const friction::Law& law) {
  std::vector<std::string> names;
  if (law.info)
    for (const auto& parameter : law.info->parameters) names.emplace_back(parameter.name);
  return names;
}

}  // namespace

Hello hello_of(const Scenario& scenario, std::string program, std::string version) {
  const mujoco::Model& model = *scenario.model;
  Hello hello{.program = std::move(program),
              .version = std::move(version),
              .scenario = scenario.name,
              .step_s = model.get()->opt.timestep,
              .commands = {"marker"},
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
                            binding.drive.gear_ratio, parameters_of(law)});
    const std::vector<std::string> of_units = units(model, binding);
    for (std::size_t c = 0; c < all.size(); ++c) hello.columns.push_back({joint, all[c].name, of_units[c]});
  }
  hello.head = telemetry_options(scenario);
  for (const drive::FaultInfo& fault : drive::faults())
    hello.joint_faults.emplace_back(std::string(fault.name), fault.maximum);
  hello.geometry = geometry_json(model);
  hello.bodies = static_cast<std::size_t>(model->nbody);
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
  server.poses().write(server.rows().next() - 1,
                       [&](std::span<float> to) { read_poses(twin.model().get(), twin.data(), to); });
}

void TwinFeed::sample(const Twin& twin, double time_s) {
  push_row(server_, twin, time_s);
  if (rows_left_ && *rows_left_ > 0) --*rows_left_;
}

void TwinFeed::add_commands(Hello& hello) {
  hello.commands.clear();
  add_pause_names(hello);
  add_event_names(hello);
}

bool TwinFeed::held(RunningTwin& run) {
  const auto now = Clock::now();
  if (now >= status_due_) {
    status_due_ = now + status_period;
    obey(server_, run.twin().time_s(), acts(run));
    tell_status(run.twin());
  }
  return rows_left_ == 0;
}

void TwinFeed::tell_status(const Twin& twin) {
  server_.tell(Status{.simulated_s = twin.time_s(),
                      .wall_s = std::chrono::duration<double>(Clock::now() - started_).count(),
                      .paused = rows_left_.has_value(),
                      .recording = recording_,
                      .joints = joints_of(twin)});
}

Acts TwinFeed::acts(RunningTwin& run) {
  const double time_s = run.twin().time_s();
  Acts all;
  add_pause(all, time_s, {"the run", "row", [this] { return rows_left_; }, [this](auto rows) { rows_left_ = rows; }});
  add_events(all, server_, time_s, [this, &run](const YAML::Node& event) {
    run.happen(event);
    return recording_;
  });
  return all;
}

}  // namespace tribotwin::twin::live
