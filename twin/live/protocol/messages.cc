#include <algorithm>
#include <cmath>

#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/live/protocol/messages.hpp>

namespace tribotwin::twin::live {
namespace {

using Json = nlohmann::ordered_json;

Json text_or_null(const std::string& text) { return text.empty() ? Json(nullptr) : Json(text); }

/// Names come from files and may be no UTF-8.
std::string text_of(const Json& message) { return dump_json(message); }

Json drive_json(const DriveStatus& drive) {
  return {{"joint", drive.joint},
          {"bus", drive.bus},
          {"node", drive.node},
          {"nmt", text_or_null(drive.nmt)},
          {"state", text_or_null(drive.state)},
          {"mode", text_or_null(drive.mode)},
          {"error_code", drive.error_code},
          {"error_text", text_or_null(drive.error_text)},
          {"brake", or_null(drive.brake)},
          {"target",
           {{"position_rad", or_null(drive.target_rad)},
            {"velocity_rad_s", or_null(drive.target_rad_s)},
            {"torque_nm", or_null(drive.target_motor_nm)}}},
          {"following_error_rad", or_null(drive.following_error_rad)},
          {"reported_degC", or_null(drive.reported_degC)},
          {"reaches_limit", drive.time_to_limit_s ? Json(std::isfinite(*drive.time_to_limit_s)) : Json(nullptr)},
          {"time_to_limit_s", or_null(drive.time_to_limit_s)}};
}

Json spread_json(const std::optional<Spread>& spread) {
  if (!spread) return nullptr;
  Json histogram = Json::array();
  for (const auto& [limit, count] : spread->histogram) histogram.push_back({limit, count});
  return {{"median", spread->median}, {"p99", spread->p99}, {"max", spread->max}, {"histogram", histogram}};
}

Json bus_json(const BusStatus& bus) {
  return {{"name", bus.name},
          {"load", or_null(bus.load)},
          {"bit_rate", or_null(bus.bit_rate)},
          {"frames_in", bus.frames_in},
          {"frames_out", bus.frames_out},
          {"syncs", bus.syncs},
          {"lost", bus.lost},
          {"foreign", bus.foreign ? Json(*bus.foreign) : Json(nullptr)},
          {"sync_period_us", spread_json(bus.sync_period)},
          {"sync_to_tpdo_us", spread_json(bus.sync_to_tpdo)}};
}

Json file_json(const RowFile& file) {
  return {{"name", file.name},     {"rows", file.rows}, {"lost_rows", file.lost_rows},
          {"from_s", file.from_s}, {"to_s", file.to_s}, {"minutes", (file.to_s - file.from_s) / 60}};
}

Json residual_json(const Residual& residual) {
  return {{"joint", residual.joint},
          {"residual_nm", or_null(residual.residual_nm)},
          {"limit_nm", or_null(residual.limit_nm)},
          {"exceeded", residual.exceeded}};
}

std::string joint_names(const Hello& hello) {
  std::vector<std::string> names;
  for (const Joint& joint : hello.joints) names.push_back(joint.name);
  return joined(names);
}

/// A name that a page gave to a command: a number, or a text that is not long.
bool is_id(const nlohmann::json& id) {
  constexpr std::size_t longest = 64;
  return id.is_number_integer() || (id.is_string() && id.get_ref<const std::string&>().size() <= longest);
}

}  // namespace

std::string to_json(const Hello& hello, const std::string& session, bool readonly) {
  Json joints = Json::array(), columns = Json::array(), faults = Json::array();
  for (const auto& [name, maximum] : hello.joint_faults) faults.push_back({{"name", name}, {"maximum", maximum}});
  for (const Joint& joint : hello.joints)
    joints.push_back({{"name", joint.name},
                      {"law", joint.law},
                      {"limit_degC", or_null(joint.limit_degC)},
                      {"gear_ratio", joint.gear_ratio},
                      {"parameters", joint.parameters}});
  for (const Column& column : hello.columns)
    columns.push_back({{"joint", text_or_null(column.joint)}, {"name", column.name}, {"unit", column.unit}});
  return text_of({{"type", "hello"},
                  {"version", hello.version},
                  {"program", hello.program},
                  {"scenario", hello.scenario},
                  {"session", session},
                  {"readonly", readonly},
                  {"step_s", hello.step_s},
                  {"commands", readonly ? std::vector<std::string>{} : hello.commands},
                  {"faults", readonly ? std::vector<std::string>{} : hello.faults},
                  {"joint_faults", readonly ? Json::array() : faults},
                  {"joints", joints},
                  {"columns", columns},
                  {"bodies", hello.geometry.empty() ? 0 : hello.bodies}});
}

std::string to_json(const Status& status) {
  Json drives = nullptr, buses = Json::array(), residual = nullptr;
  if (!status.drives.empty()) drives = Json::array();
  for (const DriveStatus& drive : status.drives) drives.push_back(drive_json(drive));
  for (const BusStatus& bus : status.buses) buses.push_back(bus_json(bus));
  if (!status.residual.empty()) residual = Json::array();
  for (const Residual& one : status.residual) residual.push_back(residual_json(one));
  return text_of({{"type", "status"},
                  {"simulated_s", status.simulated_s},
                  {"wall_s", status.wall_s},
                  {"paused", status.paused},
                  {"recording", status.recording || status.file},
                  {"file", status.file ? file_json(*status.file) : Json(nullptr)},
                  {"lost_frames", status.lost_frames},
                  {"lost_events", status.lost_events},
                  {"drives", drives},
                  {"buses", buses},
                  {"residual", residual}});
}

std::string to_json(const Event& event) {
  return text_of({{"type", "event"},
                  {"time_s", event.time_s},
                  {"kind", event.kind},
                  {"joint", text_or_null(event.joint)},
                  {"text", event.text}});
}

std::string to_json(const Law& law) {
  return text_of({{"type", "law"},
                  {"joint", law.joint},
                  {"temperature_degC", law.temperature_degC},
                  {"load_norm", law.load_norm},
                  {"speed_rad_s", law.speed_rad_s},
                  {"friction_nm", law.friction_nm}});
}

std::string to_json(const Done& done) {
  Json json{{"type", "done"}, {"id", Json(done.id)}, {"ok", done.ok}, {"message", done.text}};
  if (done.file) json["file"] = file_json(*done.file);
  return text_of(json);
}

Asking read_message(const std::string& text, const Hello& hello, bool readonly) {
  Asking asking;
  const auto refuse = [&](std::string why) {
    asking.refusal.ok = false;
    asking.refusal.text = std::move(why);
    return asking;
  };
  const nlohmann::json message = parse_json(text);
  if (!message.is_object()) return refuse("the message is no JSON object");
  if (const auto id = message.find("id"); id != message.end() && is_id(*id)) asking.refusal.id = *id;
  const auto word = [&](const char* key) {
    const auto found = message.find(key);
    return found != message.end() && found->is_string() ? found->get<std::string>() : std::string();
  };
  if (word("type") == "watch") {
    const auto joint = std::ranges::find(hello.joints, word("joint"), &Joint::name);
    if (joint == hello.joints.end()) return refuse("watch: joint must be one of: " + joint_names(hello));
    if (!hello.law) return refuse("watch: this bench tells no laws");
    asking.watched = static_cast<std::size_t>(joint - hello.joints.begin());
    return asking;
  }
  if (word("type") != "command") return refuse("type must be command or watch");
  if (asking.refusal.id.is_null()) return refuse("id must be a whole number, or a text of at most 64 bytes");
  if (readonly) return refuse("this bench is read-only (--web-readonly)");
  const std::string name = word("do");
  if (std::ranges::find(hello.commands, name) == hello.commands.end())
    return refuse(hello.commands.empty() ? "this bench takes no commands"
                                         : "do must be one of: " + joined(hello.commands));
  asking.command = Command{0, asking.refusal.id, message, name};
  return asking;
}

}  // namespace tribotwin::twin::live
