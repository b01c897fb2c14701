#include <algorithm>
#include <cmath>
#include <utility>

#include <tribotwin/hil/canopen/sync.hpp>
#include <tribotwin/hil/commands/shadow_feed.hpp>
#include <tribotwin/twin/live/twin_feed.hpp>

namespace tribotwin::hil::program {
namespace {

struct ShadowColumn {
  const char *name, *unit;
  double ShadowCycle::Part::*value;
};
constexpr ShadowColumn shadow_columns[] = {
    {"position_rad", "rad", &ShadowCycle::Part::position_rad},
    {"velocity_rad_s", "rad/s", &ShadowCycle::Part::velocity_rad_s},
    {"measured_nm", "Nm", &ShadowCycle::Part::measured_nm},
    {"predicted_nm", "Nm", &ShadowCycle::Part::predicted_nm},
    {"residual_nm", "Nm", &ShadowCycle::Part::residual_nm},
    {"temperature_degC", "degC", &ShadowCycle::Part::temperature_degC},
};

}  // namespace

twin::live::Hello shadow_hello(const twin::Scenario& scenario, const std::string& version) {
  auto hello = twin::live::hello_of(scenario, "shadow", version);
  hello.commands = {"marker"};
  hello.law = nullptr;
  hello.geometry.clear();  // a shadow tells no poses
  hello.bodies = 0;
  hello.columns = {{"", "time_s", "s"}};
  hello.head->channels.clear();
  hello.head->units.clear();
  for (const ShadowColumn& column : shadow_columns) hello.head->channels.push_back({column.name, column.unit, ""});
  for (const auto& joint : hello.joints)
    for (const ShadowColumn& column : shadow_columns) hello.columns.push_back({joint.name, column.name, column.unit});
  return hello;
}

ShadowFeed::ShadowFeed(twin::live::Server& server, Options options, std::vector<std::string> joints)
    : server_(server), options_(std::move(options)), bus_{.name = options_.bus} {
  for (std::string& joint : joints) {
    const bool limited =
        options_.limited.empty() || std::ranges::find(options_.limited, joint) != options_.limited.end();
    residual_.push_back({.joint = std::move(joint), .limit_nm = limited ? options_.limit_nm : std::nullopt});
  }
}

void ShadowFeed::heard(const Frame& frame) {
  if (frame.error) return;
  ++bus_.frames_in;
  bus_.syncs += is_sync(frame);
}

void ShadowFeed::cycle(const ShadowCycle& cycle) {
  time_s_ = cycle.time_s;
  for (std::size_t i = 0; i < residual_.size(); ++i) {
    const ShadowCycle::Part& part = cycle.joints[i];
    residual_[i].residual_nm = std::isnan(part.residual_nm) ? std::nullopt : std::optional(part.residual_nm);
    residual_[i].exceeded = part.exceeded;
  }
  server_.rows().push([&](std::span<double> row) {
    auto to = row.begin();
    *to++ = cycle.time_s;
    for (const ShadowCycle::Part& part : cycle.joints)
      for (const ShadowColumn& column : shadow_columns) *to++ = part.*column.value;
  });
}

void ShadowFeed::look(std::uint64_t lost) {
  const auto now = Clock::now();
  if (now < status_due_) return;
  status_due_ = now + twin::live::status_period;
  twin::live::obey(server_, time_s_);
  tell(lost);
}

void ShadowFeed::tell(std::uint64_t lost) {
  bus_.lost = lost;
  server_.tell(twin::live::Status{.simulated_s = time_s_,
                                  .wall_s = std::chrono::duration<double>(Clock::now() - started_).count(),
                                  .recording = options_.recording,
                                  .lost_frames = lost,
                                  .buses = {bus_},
                                  .residual = residual_});
}

void ShadowFeed::note(const std::string& text) { server_.tell(twin::live::Event{time_s_, "note", "", text}); }

}  // namespace tribotwin::hil::program
