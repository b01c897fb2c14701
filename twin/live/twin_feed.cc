#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/live/protocol/geometry.hpp>
#include <tribotwin/twin/live/protocol/law.hpp>
#include <tribotwin/twin/live/twin_feed.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/channels.hpp>

namespace tribotwin::twin::live {
namespace {

constexpr std::size_t longest_marker = 200;

Done mark(Server& server, const Command& command, double time_s) {
  const auto text = command.message.find("text");
  const bool is_text = text != command.message.end() && text->is_string();
  const std::string said = is_text ? text->get<std::string>() : std::string();
  if (said.empty() || said.size() > longest_marker)
    return {command.viewer, command.id, false, fmt::format("marker: text must be 1 to {} bytes", longest_marker)};
  server.tell(Event{time_s, "marker", "", said});
  return {command.viewer, command.id, true, fmt::format("marked at {:.3f} s; shown only, no record has it", time_s)};
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
                            binding.drive.gear_ratio});
    const std::vector<std::string> of_units = units(model, binding);
    for (std::size_t c = 0; c < all.size(); ++c) hello.columns.push_back({joint, all[c].name, of_units[c]});
  }
  hello.geometry = geometry_json(model);
  hello.bodies = static_cast<std::size_t>(model->nbody);
  return hello;
}

void obey(Server& server, double time_s) {
  while (const auto command = server.take())
    if (command->name == "marker") server.tell(mark(server, *command, time_s));
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
  const auto now = Clock::now();
  if (now < status_due_) return;
  status_due_ = now + status_period;
  obey(server_, twin.time_s());
  server_.tell(Status{.simulated_s = twin.time_s(),
                      .wall_s = std::chrono::duration<double>(now - started_).count(),
                      .recording = recording_,
                      .joints = joints_of(twin)});
}

}  // namespace tribotwin::twin::live
