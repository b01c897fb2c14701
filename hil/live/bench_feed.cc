#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/cia402/modes.hpp>
#include <tribotwin/hil/live/bench_feed.hpp>

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

DriveStatus status_of(const Bench& bench, std::size_t i) {
  BusDrive& drive = *bench.drives()[i];
  DriveStatus status{
      .joint = bench.joints()[i], .bus = bench.bus_of(i), .state = drive.state_name(), .brake = drive.brake_engaged()};
  auto* node = dynamic_cast<Node*>(&drive);
  if (!node) return status;  // mirror frames have none of the rest
  status.node = node->id();
  status.nmt = name_of(node->nmt());
  status.mode = mode_name(node->dictionary().get(od::modes_of_operation_display));
  status.error_code = node->error_code();
  status.error_text = text_of(status.error_code);
  return status;
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
          .lost = bus.transport ? bus.transport->counters().lost() : 0};
}

}  // namespace

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
  tell_errors(status);
  twin::live::obey(server_, time_s_);
  server_.tell(std::move(status));
}

void BenchFeed::tell_errors(const twin::live::Status& status) {
  codes_.resize(status.drives.size());
  for (std::size_t i = 0; i < codes_.size(); ++i) {
    const DriveStatus& drive = status.drives[i];
    if (std::exchange(codes_[i], drive.error_code) == drive.error_code) continue;
    server_.tell(twin::live::Event{
        time_s_, "emcy", drive.joint,
        drive.error_code ? fmt::format("{:04X}h {}", drive.error_code, drive.error_text) : "no error any more"});
  }
}

void BenchFeed::note(const std::string& text) { server_.tell(twin::live::Event{time_s_, "note", "", text}); }

}  // namespace tribotwin::hil
