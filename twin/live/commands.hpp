#pragma once

#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/live/server.hpp>

/// What the commands of a page do.
namespace tribotwin::twin::live {

/// Obeys a command with these keys: the text of its answer. Throws InputError where it is refused.
using Act = std::function<std::string(Mapping& keys)>;
/// By the names that hello.commands has.
using Acts = std::map<std::string, Act>;

/// A command that is an entry of a scenario's `events` (twin/simulation/event.hpp).
struct EventCommand {
  const char *name, *type;
  std::vector<std::string_view> keys;
};
std::span<const EventCommand> event_commands();
/// That entry, without its time. Refuses keys of other commands; what the others say is for read_event.
YAML::Node event_of(const EventCommand& command, Mapping& keys);

/// What pages hear of an event of a scenario that happened.
Event told(double time_s, const YAML::Node& event);

/// Obeys the commands of the pages that wait: those of `acts`, and `marker`, which is only shown where they have none.
/// For the thread of the steps, at simulated time `time_s`.
void obey(Server& server, double time_s, const Acts& acts = {});

}  // namespace tribotwin::twin::live
