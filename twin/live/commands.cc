#include <fmt/format.h>

#include <tribotwin/twin/live/commands.hpp>

namespace tribotwin::twin::live {
namespace {

constexpr std::size_t longest_marker = 200;

/// What a command says beside its name, to be read as strictly as a scenario.
Mapping keys_of(const Command& command) {
  YAML::Node keys(YAML::NodeType::Map);
  for (const auto& [key, value] : command.message.items()) {
    if (key == "type" || key == "id" || key == "do") continue;
    if (value.is_structured() || value.is_null())
      throw InputError(fmt::format("{}: {}: must be a number or a text", command.name, key));
    keys[key] = value.is_string() ? YAML::Load(quoted(value.get<std::string>())) : YAML::Node(value.dump());
  }
  return Mapping(command.name, "", keys);
}

std::string mark(Server& server, const Command& command, double time_s) {
  const auto text = command.message.find("text");
  const bool is_text = text != command.message.end() && text->is_string();
  const std::string said = is_text ? text->get<std::string>() : std::string();
  if (said.empty() || said.size() > longest_marker)
    throw InputError(fmt::format("marker: text: must be 1 to {} bytes", longest_marker));
  server.tell(Event{time_s, "marker", "", said});
  return fmt::format("marked at {:.3f} s; shown only, no record has it", time_s);
}

std::string answer(Server& server, const Command& command, double time_s, const Acts& acts) {
  const auto act = acts.find(command.name);
  if (act == acts.end() && command.name == "marker") return mark(server, command, time_s);
  if (act == acts.end()) throw InputError(fmt::format("{}: not now", command.name));
  Mapping keys = keys_of(command);
  return act->second(keys);
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

}  // namespace

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

Event told(double time_s, const YAML::Node& event) {
  const std::string type = event["type"].Scalar();
  const std::string joint = event["joint"] ? event["joint"].Scalar() : std::string();
  const bool is_change = type != "fault" && type != "marker";
  return {time_s, is_change ? "change" : type, joint, words_of(event)};
}

void obey(Server& server, double time_s, const Acts& acts) {
  while (const auto command = server.take()) {
    Done done{command->viewer, command->id, true, {}};
    try {
      done.text = answer(server, *command, time_s, acts);
    } catch (const InputError& error) {
      done.ok = false;
      done.text = error.what();
    }
    server.tell(std::move(done));
  }
}

}  // namespace tribotwin::twin::live
