#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/live/server.hpp>

/// What the commands of a page do.
namespace tribotwin::twin::live {

/// What a command says beside its name, to be read as strictly as a scenario. Throws InputError.
Mapping keys_of(const Command& command);

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
/// What pages hear of an event of a scenario that happened.
Event told(double time_s, const YAML::Node& event);

/// Adds names of commands to hello.commands.
void add_event_names(Hello& hello);
void add_pause_names(Hello& hello);

/// Adds the event commands. `happen` makes an entry happen that has no time yet: whether a record has it; it throws
/// InputError. All pages hear of it.
void add_events(Acts& acts, Server& server, double time_s, std::function<bool(const YAML::Node&)> happen);

/// That which a page can pause.
struct Pausing {
  std::string what, move;                                 ///< "the run", by "row"
  std::function<std::optional<std::int64_t>()> left;      ///< moves until it stands; without a value: it is not paused
  std::function<void(std::optional<std::int64_t>)> hold;  ///< sets that; may throw InputError
};
/// Adds `pause`, `resume` and `step`.
void add_pause(Acts& acts, double time_s, const Pausing& pausing);

/// Obeys the commands of the pages that wait: those of `acts`, and `marker`, which is only shown where they have none.
/// For the thread of the steps, at simulated time `time_s`.
void obey(Server& server, double time_s, const Acts& acts = {});

}  // namespace tribotwin::twin::live
