#include <fmt/format.h>

#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/live/commands.hpp>
#include <tribotwin/twin/simulation/scenario_input.hpp>

namespace tribotwin::twin::live {
namespace {

/// A marker of a program that keeps none.
std::string mark(Server& server, Mapping& keys, double time_s) {
  keys.accept({"text"});
  server.tell(Event{time_s, "marker", "", read_marker(keys)});
  return fmt::format("marked at {:.3f} s; shown only, no record has it", time_s);
}

std::string answer(Server& server, const Command& command, double time_s, const Acts& acts) {
  const auto act = acts.find(command.name);
  Mapping keys = keys_of(command);
  if (act != acts.end()) return act->second(keys);
  if (command.name == "marker") return mark(server, keys, time_s);
  throw InputError(fmt::format("{}: not now", command.name));
}

/// "wear, Fc0 1.5".
std::string words_of(const YAML::Node& event) {
  const std::string type = event["type"].Scalar();
  if (type == "marker") return event["text"].Scalar();
  std::string words = type == "fault" ? event["fault"].Scalar() : type;
  for (const auto& entry : event["factors"] ? event["factors"] : event) {
    const std::string key = entry.first.Scalar();
    const bool said = key == "type" || key == "time_s" || key == "joint" || key == "fault";
    if (!said) words += fmt::format(", {} {}", key, entry.second.Scalar());
  }
  return words;
}

/// That entry, without its time. Refuses keys of other commands; what the others say is for read_event.
YAML::Node event_of(const EventCommand& command, Mapping& keys) {
  keys.accept(command.keys);
  YAML::Node event;
  event["type"] = command.type;
  for (const std::string& key : keys.names()) event[key] = keys.raw(key);
  if (!event["parameter"] && !event["factor"]) return event;
  event["factors"][keys.text("parameter")] = keys.number("factor");
  event.remove("parameter");
  event.remove("factor");
  return event;
}

}  // namespace

Mapping keys_of(const Command& command) {
  YAML::Node keys(YAML::NodeType::Map);
  for (const auto& [key, value] : command.message.items()) {
    if (key == "type" || key == "id" || key == "do") continue;
    if (value.is_structured() || value.is_null())
      throw InputError(fmt::format("{}: {}: must be a number or a text", command.name, key));
    keys[key] = value.is_string() ? YAML::Load(quoted(value.get<std::string>())) : YAML::Node(dump_json(value));
  }
  return Mapping(command.name, "", keys);
}

std::span<const EventCommand> event_commands() {
  static const std::vector<EventCommand> all = {
      {"marker", "marker", {"text"}},
      {"ambient", "ambient", {"temperature_degC"}},
      {"payload", "payload", {"mass_kg"}},
      {"wear", "wear", {"joint", "parameter", "factor"}},
      {"joint_fault", "fault", {"joint", "fault", "severity", "growth_per_h"}},
  };
  return all;
}

Event told(double time_s, const YAML::Node& event) {
  const std::string type = event["type"].Scalar();
  const std::string joint = event["joint"] ? event["joint"].Scalar() : std::string();
  const bool is_change = type != "fault" && type != "marker";
  return {time_s, is_change ? "change" : type, joint, words_of(event)};
}

void add_event_names(Hello& hello) {
  for (const EventCommand& command : event_commands()) hello.commands.emplace_back(command.name);
}
void add_pause_names(Hello& hello) {
  for (const char* name : {"pause", "resume", "step"}) hello.commands.emplace_back(name);
}

void add_events(Acts& acts, Server& server, double time_s, std::function<bool(const YAML::Node&)> happen) {
  for (const EventCommand& command : event_commands())
    acts[command.name] = [&server, &command, time_s, happen](Mapping& keys) {
      const YAML::Node event = event_of(command, keys);
      const bool recorded = happen(event);
      server.tell(told(time_s, event));
      return fmt::format("at {:.3f} s, {}", time_s, recorded ? "in the record" : "which no record has");
    };
}

void add_pause(Acts& acts, double time_s, const Pausing& pausing) {
  const auto set = [time_s, pausing](bool pause) {
    return [time_s, pausing, pause](Mapping& keys) {
      keys.done();
      if (pausing.left().has_value() == pause)
        throw InputError(fmt::format("{} is {}", pausing.what, pause ? "paused already" : "not paused"));
      pausing.hold(pause ? std::optional<std::int64_t>(0) : std::nullopt);
      return fmt::format("{} at {:.3f} s", pause ? "paused" : "goes on", time_s);
    };
  };
  acts["pause"] = set(true);
  acts["resume"] = set(false);
  acts["step"] = [pausing](Mapping& keys) {
    const std::size_t moves = keys.whole("cycles", {1, 1e6});
    keys.done();
    const auto left = pausing.left();
    if (!left) throw InputError(fmt::format("step: {} is not paused", pausing.what));
    if (*left > 0) throw InputError(fmt::format("step: {} {}s of the last one are still to come", *left, pausing.move));
    pausing.hold(static_cast<std::int64_t>(moves));
    return fmt::format("{} {}{} from here", moves, pausing.move, moves == 1 ? "" : "s");
  };
}

void obey(Server& server, double time_s, const Acts& acts) {
  while (const auto command = server.take()) {
    Done done{command->viewer, command->id, true, {}};
    try {
      done.text = answer(server, *command, time_s, acts);
    } catch (const std::runtime_error& error) {  // InputError, or what the YAML library says: no page ends a program
      done.ok = false;
      done.text = error.what();
    }
    server.tell(std::move(done));
  }
}

}  // namespace tribotwin::twin::live
