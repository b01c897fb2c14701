#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/cia402/modes.hpp>
#include <tribotwin/hil/live/bench_feed.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::hil {
namespace {

using twin::live::BusStatus;
using twin::live::DriveStatus;

const char* name_of(Nmt nmt) {
  switch (nmt) {
    case Nmt::initialising:
      return "initialising";
    case Nmt::stopped:
      return "stopped";
    case Nmt::operational:
      return "operational";
    case Nmt::pre_operational:
      return "pre-operational";
  }
  return "";
}

struct ErrorText {
  ErrorCode code;
  const char* text;
};
constexpr ErrorText error_texts[] = {
    {ErrorCode::excess_temperature, "the drive is too hot"},
    {ErrorCode::left_operational, "NMT took the node out of operational"},
    {ErrorCode::heartbeat_lost, "a heartbeat or a life guard is missing"},
    {ErrorCode::bus_recovered, "the bus was off and is back"},
    {ErrorCode::sync_length, "a SYNC had a counter where none was expected, or none"},
    {ErrorCode::pdo_too_short, "a PDO was too short"},
    {ErrorCode::rpdo_timeout, "set points did not come in time"},
    {ErrorCode::parameter_error, "a PDO had a value that an object refuses"},
    {ErrorCode::following_error, "the position does not follow its set point"},
    {ErrorCode::sync_lost, "the SYNC is missing"},
    {ErrorCode::external, "the safety circuit took the torque off"},
};

std::string text_of(std::uint16_t code) {
  const auto* row = std::ranges::find(error_texts, static_cast<ErrorCode>(code), &ErrorText::code);
  return row == std::end(error_texts) ? "" : row->text;
}

std::string mode_name(std::int64_t number) {
  const ModeOfOperation* mode = find_mode(number);
  return mode ? mode->name : "";
}

/// What the drive follows.
void add_target(DriveStatus& status, const twin::Twin& twin, std::size_t i) {
  using Mode = twin::DriveCommand::Mode;
  const twin::DriveCommand& command = twin.commands()[i];
  const auto& binding = twin.model().drives()[i];
  if (command.mode == Mode::torque) status.target_motor_nm = command.torque_nm / binding.drive.gear_ratio;
  if (command.mode == Mode::velocity) status.target_rad_s = command.velocity_rad_s;
  if (command.mode != Mode::position) return;
  status.target_rad = command.position_rad;
  status.following_error_rad =
      command.position_rad - twin.data()->qpos[twin::position_address(twin.model().get(), binding)];
}

DriveStatus status_of(const Bench& bench, std::size_t i) {
  BusDrive& drive = *bench.drives()[i];
  DriveStatus status{
      .joint = bench.joints()[i], .bus = bench.bus_of(i), .state = drive.state_name(), .brake = drive.brake_engaged()};
  add_target(status, bench.plant().twin(), i);
  auto* node = dynamic_cast<Node*>(&drive);
  if (!node) return status;  // mirror frames have none of the rest
  status.node = node->id();
  status.nmt = name_of(node->nmt());
  status.mode = mode_name(node->dictionary().get(od::modes_of_operation_display));
  status.error_code = node->error_code();
  status.error_text = text_of(status.error_code);
  return status;
}

std::optional<twin::live::Spread> spread_of(const Distribution& times) {
  if (times.count() == 0) return std::nullopt;
  const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
  return twin::live::Spread{us(times.median_ns()), us(times.quantile_ns(0.99)), us(times.max_ns()),
                            times.histogram_us()};
}

BusStatus status_of(const SessionStatus& session, std::size_t i) {
  const SessionStatus::Bus& bus = session.buses[i];
  const BenchCounters& counted = session.bench->counters(i);
  return {.name = bus.transport ? bus.transport->name() : channel_of(i),
          .load = bus.bit_rate ? std::optional(bus.bits_per_s / *bus.bit_rate) : std::nullopt,
          .bit_rate = bus.bit_rate,
          .frames_in = counted.frames_in,
          .frames_out = counted.frames_out,
          .syncs = counted.syncs,
          .lost = bus.transport ? bus.transport->counters().lost() : 0,
          .foreign = counted.foreign,
          .sync_period = bus.sync ? spread_of(bus.sync->period()) : std::nullopt,
          .sync_to_tpdo = bus.sync ? spread_of(bus.sync->latency()) : std::nullopt};
}

}  // namespace

BenchFeed::BenchFeed(twin::live::Server& server, const twin::Scenario& scenario, bool recording)
    : server_(server), recording_(recording), joints_(twin::joint_names(*scenario.model)) {}

void BenchFeed::status(const SessionStatus& session) {
  twin::live::Status status{.simulated_s = session.simulated_s, .wall_s = session.wall_s, .recording = recording_};
  for (std::size_t i = 0; i < session.bench->drives().size(); ++i)
    status.drives.push_back(status_of(*session.bench, i));
  for (std::size_t i = 0; i < session.buses.size(); ++i) {
    status.buses.push_back(status_of(session, i));
    status.lost_frames += status.buses.back().lost;
  }
  status.joints = twin::live::joints_of(session.bench->plant().twin());
  time_s_ = session.simulated_s;
  add_times_to_limits(status, session.bench->plant().twin());
  twin::live::obey(server_, time_s_, session.control ? acts(*session.control, *session.bench) : twin::live::Acts());
  status.paused = session.bench->left().has_value();
  server_.tell(std::move(status));
}

void BenchFeed::add_times_to_limits(twin::live::Status& status, const twin::Twin& twin) {
  constexpr double longest_s = 60, shortest_s = 5, apart_s = 0.5;
  if (heat_.empty() || time_s_ >= heat_.back().time_s + apart_s) {
    Heat now{time_s_, {}};
    for (const drive::Workspace& joint : status.joints) now.joints_J.push_back(joint.heat_J);
    heat_.push_back(std::move(now));
  }
  while (heat_.size() > 1 && heat_[1].time_s <= time_s_ - longest_s) heat_.pop_front();
  const double length_s = time_s_ - heat_.front().time_s;
  if (length_s < shortest_s) return;
  for (std::size_t i = 0; i < status.drives.size(); ++i) {
    const drive::Drive& joint = twin.model().drives()[i].drive;
    const double limit_degC = joint.law.range.temperature_max_degC;
    const bool is_held = status.joints[i].temperature_held != 0 || joint.thermal.order == thermal::Order::prescribed;
    if (is_held || !std::isfinite(limit_degC)) continue;
    const double power_W = (status.joints[i].heat_J - heat_.front().joints_J[i]) / length_s;
    status.drives[i].time_to_limit_s =
        thermal::time_to_reach_s(joint.thermal, twin.state(i).rise, power_W, status.joints[i].ambient_offset_K,
                                 limit_degC - joint.thermal.T_amb_degC);
  }
}

void BenchFeed::add_commands(twin::live::Hello& hello) {
  hello.commands = {"fault"};
  twin::live::add_pause_names(hello);
  twin::live::add_event_names(hello);
  hello.faults = fault_kinds();
}

twin::live::Acts BenchFeed::acts(SessionControl& control, const Bench& bench) {
  twin::live::Acts all;
  all["fault"] = [&](twin::Mapping& keys) { return inject(control, keys); };
  twin::live::add_pause(
      all, time_s_,
      {"the robot", "cycle", [&bench] { return bench.left(); }, [&control](auto left) { control.hold(left); }});
  twin::live::add_events(all, server_, time_s_, [&control](const YAML::Node& event) { return control.happen(event); });
  return all;
}

std::string BenchFeed::inject(SessionControl& control, twin::Mapping& keys) {
  control.inject(keys);
  const std::string joint = keys.text_or("joint", "");
  const std::string what = fmt::format("{} for {:g} s", keys.text("kind"), keys.number("duration_s"));
  server_.tell(twin::live::Event{time_s_, "fault", joint, what});
  return fmt::format("from {:.3f} s", time_s_);
}

SessionEvents BenchFeed::events() {
  using twin::live::Event;
  return {.emcy =
              [this](double time_s, std::size_t drive, std::uint16_t code) {
                const std::string text =
                    code ? fmt::format("{:04X}h {}", code, text_of(code)) : std::string("no error any more");
                server_.tell(Event{time_s, "emcy", joints_[drive], text});
              },
          .happened = [this](double time_s, const YAML::Node& event) { server_.tell(twin::live::told(time_s, event)); },
          .imposed =
              [this](double time_s, const DriveFault& fault) {
                server_.tell(Event{time_s, "fault", joints_[fault.drive],
                                   fmt::format("{} {}", name_of(fault.kind), fault.on ? "begins" : "ends")});
              }};
}

void BenchFeed::note(const std::string& text) { server_.tell(twin::live::Event{time_s_, "note", "", text}); }

}  // namespace tribotwin::hil
