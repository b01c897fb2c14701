#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include <fmt/format.h>

#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/live/protocol/foxglove.hpp>

namespace tribotwin::twin::live::foxglove {
namespace {

using Object = nlohmann::ordered_json;

std::string dumped(const Object& message) { return dump_json(message); }

Object of_type(const char* type, const char* description) { return {{"type", type}, {"description", description}}; }

Object object_schema(const char* title, const Object& properties) {
  return {{"$schema", "https://json-schema.org/draft/2020-12/schema"},
          {"title", title},
          {"type", "object"},
          {"properties", properties}};
}

Object list_schema(const Object& properties) {
  return {{"type", "array"}, {"items", {{"type", "object"}, {"properties", properties}}}};
}

/// Each has one type and no list of types, which Lichtblick does not read. What is not known is null or not there.
Object status_schema() {
  const Object number = of_type("number", ""), text = of_type("string", "");
  const Object target = of_type("object", "position_rad, velocity_rad_s, torque_nm (motor side)");
  const Object spread = of_type("object", "median, p99, max [us]; histogram: [below [us], count]");
  return object_schema("tribotwin.Status", {{"simulated_s", of_type("number", "time of the run [s]")},
                                            {"wall_s", of_type("number", "since the start [s]")},
                                            {"paused", of_type("boolean", "")},
                                            {"recording", of_type("boolean", "telemetry is written")},
                                            {"lost_frames", number},
                                            {"drives", list_schema({{"joint", text},
                                                                    {"bus", number},
                                                                    {"node", number},
                                                                    {"nmt", text},
                                                                    {"state", of_type("string", "of CiA 402")},
                                                                    {"mode", text},
                                                                    {"error_code", number},
                                                                    {"error_text", text},
                                                                    {"brake", of_type("boolean", "engaged")},
                                                                    {"target", target},
                                                                    {"following_error_rad", number},
                                                                    {"reported_degC", number},
                                                                    {"reaches_limit", of_type("boolean", "")},
                                                                    {"time_to_limit_s", number}})},
                                            {"buses", list_schema({{"name", text},
                                                                   {"load", of_type("number", "share of 1")},
                                                                   {"bit_rate", of_type("number", "[bit/s]")},
                                                                   {"frames_in", number},
                                                                   {"frames_out", number},
                                                                   {"syncs", number},
                                                                   {"lost", number},
                                                                   {"sync_period_us", spread},
                                                                   {"sync_to_tpdo_us", spread}})}});
}

Object event_schema() {
  return object_schema("tribotwin.Event", {{"time_s", of_type("number", "time of the run [s]")},
                                           {"kind", of_type("string", "emcy, fault, marker, note, health")},
                                           {"joint", of_type("string", "null: of no joint")},
                                           {"text", of_type("string", "")}});
}

Object channel(std::size_t topic, const std::string& name, const std::string& schema_name, const std::string& schema) {
  return {{"id", topic + 1},           {"topic", name},    {"encoding", "json"},
          {"schemaName", schema_name}, {"schema", schema}, {"schemaEncoding", "jsonschema"}};
}

template <class T>
void put_number(std::string& out, T value) {
  static_assert(std::endian::native == std::endian::little);
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

bool is_whole(const nlohmann::json& value, std::uint64_t most) {
  return value.is_number_unsigned() && value.get<std::uint64_t>() <= most;
}

/// A part of what a client said, for an answer to it.
std::string shortened(const std::string& text) {
  constexpr std::size_t most = 60;
  return text.size() <= most ? text : text.substr(0, most) + "...";
}

}  // namespace

Topics::Topics(const Hello& hello) {
  for (const live::Joint& joint : hello.joints) {
    std::vector<std::size_t> columns;
    std::vector<mcap::Quantity> quantities;
    for (std::size_t c = 0; c < hello.columns.size(); ++c) {
      const Column& column = hello.columns[c];
      if (column.joint != joint.name) continue;
      columns.push_back(c);
      quantities.push_back({column_name(column.name, column.unit), column.unit, ""});
    }
    if (!columns.empty()) joints_.push_back({joint.name, std::move(columns), mcap::JointJson(std::move(quantities))});
  }
}

std::string Topics::advertisement() const {
  Object channels = Object::array();
  std::string first;
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const std::string& name = joints_[j].name;
    const std::string schema = joints_[j].json.schema();
    if (j == 0) first = schema;
    channels.push_back(channel(j, mcap::joint_topic(name), mcap::joint_schema_name(name, schema, first), schema));
  }
  channels.push_back(channel(status(), "/status", "tribotwin.Status", dumped(status_schema())));
  channels.push_back(channel(events(), "/events", "tribotwin.Event", dumped(event_schema())));
  return dumped({{"op", "advertise"}, {"channels", channels}});
}

void Topics::append_joint(std::string& out, std::size_t topic, std::span<const double> row) const {
  const Joint& joint = joints_[topic];
  std::vector<double> values(joint.columns.size());
  std::ranges::transform(joint.columns, values.begin(), [&](std::size_t c) { return row[c]; });
  joint.json.append(out, row[0], values);
}

std::string server_info(const Hello& hello, const std::string& session) {
  return dumped({{"op", "serverInfo"},
                 {"name", fmt::format("tribotwin {} {}", hello.program, hello.scenario)},
                 {"capabilities", {"time"}},
                 {"supportedEncodings", {"json"}},
                 {"metadata",
                  {{"program", hello.program},
                   {"version", hello.version},
                   {"scenario", hello.scenario},
                   {"step_s", fmt::format("{}", hello.step_s)}}},
                 {"sessionId", session}});
}

std::string status_text(Level level, const std::string& message, const std::string& id) {
  Object status{{"op", "status"}, {"level", static_cast<int>(level)}, {"message", message}};
  if (!id.empty()) status["id"] = id;
  return dumped(status);
}

std::uint64_t ns_of(double time_s) {
  constexpr double last_s = 4e9;  // seconds are 32 bits in the clients
  return static_cast<std::uint64_t>(std::llround((time_s > 0 ? std::min(time_s, last_s) : 0) * 1e9));
}

std::string message_head(std::uint32_t subscription, std::uint64_t ns) {
  std::string out(1, '\1');
  put_number(out, subscription);
  put_number(out, ns);
  return out;
}

std::string time_message(std::uint64_t ns) {
  std::string out(1, '\2');
  put_number(out, ns);
  return out;
}

const Subscriptions::Subscription* Subscriptions::find(std::size_t topic) const {
  const auto found = std::ranges::find(all_, topic, &Subscription::topic);
  return found == all_.end() ? nullptr : &*found;
}

void Subscriptions::subscribe(const Topics& topics, const nlohmann::json& wanted, Heard& heard) {
  const auto refuse = [&](std::string why) {
    heard.answers.push_back(status_text(Level::error, "subscribe: " + std::move(why)));
  };
  const bool whole = wanted.is_object() && wanted.contains("id") && wanted.contains("channelId") &&
                     is_whole(wanted["id"], UINT32_MAX) && is_whole(wanted["channelId"], UINT64_MAX);
  if (!whole) return refuse("each subscription needs id and channelId, whole numbers from 0");
  const auto id = wanted["id"].get<std::uint32_t>();
  const auto channel = wanted["channelId"].get<std::uint64_t>();
  if (channel < 1 || channel > topics.size())
    return refuse(fmt::format("there is no channel {}; there are 1 to {}", channel, topics.size()));
  const Subscription subscription{id, static_cast<std::size_t>(channel - 1)};
  if (std::ranges::find(all_, id, &Subscription::id) != all_.end())
    return refuse(fmt::format("the subscription {} is there already", id));
  if (find(subscription.topic)) return refuse(fmt::format("channel {} has a subscription already", channel));
  all_.push_back(subscription);
  heard.added.push_back(subscription);
}

void Subscriptions::unsubscribe(const nlohmann::json& id, Heard& heard) {
  const bool is_id = is_whole(id, UINT32_MAX);
  if (!is_id || std::erase_if(all_, [&](const Subscription& s) { return s.id == id.get<std::uint32_t>(); }) == 0)
    heard.answers.push_back(
        status_text(Level::warning, "unsubscribe: there is no subscription " + shortened(dumped(Object(id)))));
}

Subscriptions::Heard Subscriptions::hear(const Topics& topics, const std::string& text) {
  constexpr std::size_t most_answers = 8;
  Heard heard;
  const nlohmann::json message = parse_json(text);
  const bool named = message.is_object() && message.contains("op") && message["op"].is_string();
  const std::string op = named ? message["op"].get<std::string>() : std::string();
  const bool add = op == "subscribe";
  const char* const list = add ? "subscriptions" : "subscriptionIds";
  if (!add && op != "unsubscribe") {
    heard.answers.push_back(status_text(
        Level::error, named ? fmt::format("{} is not offered: this bench tells of joints, status and events, to those "
                                          "who subscribe",
                                          shortened(op))
                            : "the message is no JSON object with op"));
  } else if (!message.contains(list) || !message[list].is_array()) {
    heard.answers.push_back(status_text(Level::error, fmt::format("{}: {} must be a list", op, list)));
  } else {
    for (const auto& one : message[list]) add ? subscribe(topics, one, heard) : unsubscribe(one, heard);
  }
  if (heard.answers.size() > most_answers) heard.answers.resize(most_answers);
  return heard;
}

}  // namespace tribotwin::twin::live::foxglove
