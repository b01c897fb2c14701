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
  if (rows_left_ > 0) --rows_left_;
}

std::vector<std::string> TwinFeed::commands() {
  std::vector<std::string> all{"pause", "resume", "step"};
  for (const EventCommand& command : event_commands()) all.emplace_back(command.name);
  return all;
}

bool TwinFeed::held(RunningTwin& run) {
  const auto now = Clock::now();
  if (now >= status_due_) {
    status_due_ = now + status_period;
    obey(server_, run.twin().time_s(), acts(run));
    tell_status(run.twin());
  }
  return paused_ && rows_left_ == 0;
}

void TwinFeed::tell_status(const Twin& twin) {
  server_.tell(Status{.simulated_s = twin.time_s(),
                      .wall_s = std::chrono::duration<double>(Clock::now() - started_).count(),
                      .paused = paused_,
                      .recording = recording_,
                      .joints = joints_of(twin)});
}

Acts TwinFeed::acts(RunningTwin& run) {
  const auto paused = [this, &run](bool now) {
    return [this, &run, now](Mapping& keys) {
      keys.done();
      if (paused_ == now) throw InputError(fmt::format("the run is {}", now ? "paused already" : "not paused"));
      paused_ = now;
      rows_left_ = 0;
      return fmt::format("{} at {:.3f} s", now ? "paused" : "goes on", run.twin().time_s());
    };
  };
  Acts all{{"pause", paused(true)}, {"resume", paused(false)}, {"step", [this](Mapping& keys) { return step(keys); }}};
  for (const EventCommand& command : event_commands())
    all[command.name] = [this, &run, &command](Mapping& keys) { return happen(run, event_of(command, keys)); };
  return all;
}

std::string TwinFeed::happen(RunningTwin& run, YAML::Node event) {
  run.happen(event);
  server_.tell(told(run.twin().time_s(), event));
  return fmt::format("at {:.3f} s{}", run.twin().time_s(), recording_ ? ", in the record" : ", which no record has");
}

std::string TwinFeed::step(Mapping& keys) {
  const std::size_t rows = keys.whole("cycles", {1, 1e6});
  keys.done();
  if (!paused_) throw InputError("step: the run is not paused");
  if (rows_left_ > 0) throw InputError(fmt::format("step: {} rows of the last one are still to come", rows_left_));
  rows_left_ = rows;
  return fmt::format("{} row{} from here", rows, rows == 1 ? "" : "s");
}

}  // namespace tribotwin::twin::live
