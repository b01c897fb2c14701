// Foxglove's protocol, with a client that was written after its definition and not with our own code.
#include <thread>

#include "client.hpp"
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

namespace tribotwin::twin::live {
namespace {

using testing::ElementsAre, testing::HasSubstr, testing::StartsWith;
using Json = nlohmann::json;

constexpr const char* old_name = "foxglove.websocket.v1";
constexpr const char* new_name = "foxglove.sdk.v1";

Hello two_joints() {
  return {.program = "run",
          .version = "1",
          .scenario = "test",
          .step_s = 0.001,
          .joints = {{"j1", "extended", 80}, {"slide", "", {}}},
          .columns = {{"", "time_s", "s"},
                      {"j1", "position_rad", "rad"},
                      {"j1", "friction_nm", "Nm"},
                      {"slide", "position_rad", "m"},
                      {"slide", "friction_nm", "N"}}};
}

std::unique_ptr<Server> start(ServerOptions options = {}) {
  options.address.port = 0;
  return std::move(Server::start(options, two_joints()).value());
}

template <class T>
T number(const std::string& bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

/// "SUBSCRIPTION NS JSON", or "time NS".
std::string told(const std::string& message) {
  if (message[0] == 2) return fmt::format("time {}", number<std::uint64_t>(message, 1));
  return fmt::format("{} {} {}", number<std::uint32_t>(message, 1), number<std::uint64_t>(message, 5),
                     message.substr(13));
}

class Foxglove : public testing::Test {
 protected:
  void connect(const Server& server, const std::string& offered = old_name, const std::string& more = {},
               int receive_bytes = 0) {
    client = std::make_unique<Client>(port_of(server), receive_bytes);
    answer = client->ask_for(offered, more);
  }
  /// Those of the joints and the time, until there are `count`; others are passed over.
  std::vector<std::string> hear(std::size_t count) {
    std::vector<std::string> out;
    while (out.size() < count) {
      const auto message = client->hear();
      if (!message) break;
      if (message->opcode == 2) out.push_back(told(message->content));
    }
    return out;
  }
  Json hear_text() {
    while (const auto message = client->hear())
      if (message->opcode == 1) return Json::parse(message->content);
    return {};
  }
  static void push(Server& server, double time_s, double x) {
    server.rows().push([&](std::span<double> row) {
      row[0] = time_s;
      for (int c = 1; c < 5; ++c) row[static_cast<std::size_t>(c)] = x * c;
    });
  }
  std::unique_ptr<Client> client;
  std::string answer;
};

TEST_F(Foxglove, SpeaksUnderBothNamesOnBothPaths) {
  const auto server = start();
  const struct {
    std::string offered, spoken;
  } cases[] = {{old_name, old_name},
               {new_name, new_name},
               {"foxglove.websocket.v1, foxglove.sdk.v1", old_name},
               {"other, foxglove.sdk.v1, foxglove.websocket.v1", new_name}};
  for (const auto& c : cases) {
    connect(*server, c.offered);
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 101")) << c.offered;
    EXPECT_THAT(answer, HasSubstr("Sec-WebSocket-Protocol: " + c.spoken + "\r\n"));
    const Json info = hear_text();
    EXPECT_EQ(info["op"], "serverInfo");
    EXPECT_EQ(info["capabilities"], Json::array({"time"}));
    EXPECT_EQ(info["name"], "tribotwin run test");
    EXPECT_EQ(info["metadata"]["step_s"], "0.001");
    EXPECT_EQ(info["sessionId"].get<std::string>().size(), 32u);
  }
  client = std::make_unique<Client>(port_of(*server));
  EXPECT_THAT(client->ask_for(new_name, "", "/live"), StartsWith("HTTP/1.1 101"));
  client = std::make_unique<Client>(port_of(*server));
  EXPECT_THAT(client->ask_for("foxglove.websocket.v9", "", "/live"), StartsWith("HTTP/1.1 400"));
}

TEST_F(Foxglove, AdvertisesJointsStatusAndEvents) {
  const auto server = start();
  connect(*server);
  hear_text();
  const Json channels = hear_text()["channels"];
  std::vector<std::string> names;
  for (const Json& c : channels) {
    names.push_back(
        fmt::format("{} {} {}", c["id"].get<int>(), c["topic"].get<std::string>(), c["schemaName"].get<std::string>()));
    EXPECT_EQ(c["encoding"], "json");
    EXPECT_EQ(c["schemaEncoding"], "jsonschema");
    const Json schema = Json::parse(c["schema"].get<std::string>());
    EXPECT_EQ(schema["type"], "object") << schema;
    for (const auto& [key, value] : schema["properties"].items()) EXPECT_TRUE(value["type"].is_string()) << key;
  }
  EXPECT_THAT(names, ElementsAre("1 /joints/j1 tribotwin.Joint", "2 /joints/slide tribotwin.Joint.slide",
                                 "3 /status tribotwin.Status", "4 /events tribotwin.Event"));
  const Json slide = Json::parse(channels[1]["schema"].get<std::string>())["properties"];
  EXPECT_EQ(slide["position_m"]["description"], "[m]") << slide;
  EXPECT_TRUE(slide.contains("friction_n") && slide.contains("time_s")) << slide;
}

TEST_F(Foxglove, SendsTheRowsOfWhatWasSubscribed) {
  const auto server = start();
  connect(*server);
  client->say(R"({"op":"subscribe","subscriptions":[{"id":7,"channelId":2},{"id":0,"channelId":3}]})");
  server->tell(Status{.simulated_s = 0.5});
  EXPECT_THAT(hear(1), ElementsAre(StartsWith(R"(0 500000000 {"type":"status","simulated_s":0.5)")));
  push(*server, 0.001, 0.1);
  push(*server, 0.002, -0.0);
  push(*server, 1, std::nan(""));
  EXPECT_THAT(
      hear(6),
      ElementsAre("time 1000000", R"(7 1000000 {"time_s":0.001,"position_m":0.30000000000000004,"friction_n":0.4})",
                  "time 2000000", R"(7 2000000 {"time_s":0.002,"position_m":-0.0,"friction_n":-0.0})",
                  "time 1000000000", R"(7 1000000000 {"time_s":1.0,"position_m":null,"friction_n":null})"));
  client->say(R"({"op":"unsubscribe","subscriptionIds":[7]})");
  client->say(R"({"op":"subscribe","subscriptions":[{"id":8,"channelId":1},{"id":9,"channelId":4}]})");
  server->tell(Event{2, "marker", "", "here"});
  EXPECT_THAT(hear(1), ElementsAre(R"(9 2000000000 {"type":"event","time_s":2.0,"kind":"marker","joint":null,)"
                                   R"("text":"here"})"));
  push(*server, 3, 1);
  EXPECT_THAT(hear(2),
              ElementsAre("time 3000000000", R"(8 3000000000 {"time_s":3.0,"position_rad":1.0,"friction_nm":2.0})"));
}

TEST_F(Foxglove, WhatHappenedBeforeIsToldToWhoSubscribesLater) {
  const auto server = start();
  connect(*server);
  client->say(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":4}]})");
  server->tell(Event{1, "marker", "", "a"});
  hear(1);  // the server has it
  connect(*server);
  client->say(R"({"op":"subscribe","subscriptions":[{"id":5,"channelId":4}]})");
  EXPECT_THAT(hear(1), ElementsAre(HasSubstr(R"(5 1000000000 {"type":"event","time_s":1.0)")));
}

TEST_F(Foxglove, RefusesWhatItDoesNotOffer) {
  const auto server = start();
  connect(*server);
  hear_text(), hear_text();
  const struct {
    std::string text, says;
  } cases[] = {
      {R"({"op":"getParameters","parameterNames":[]})", "getParameters is not offered"},
      {R"({"op":"advertise","channels":[]})", "advertise is not offered"},
      {R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":5}]})", "there is no channel 5; there are 1 to 4"},
      {R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":0}]})", "there is no channel 0"},
      {R"({"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]})", "whole numbers from 0"},
      {R"({"op":"subscribe","subscriptions":[{"id":4294967296,"channelId":1}]})", "whole numbers from 0"},
      {R"({"op":"subscribe","subscriptions":[7]})", "whole numbers from 0"},
      {R"({"op":"subscribe","subscriptions":7})", "subscriptions must be a list"},
      {R"({"op":"subscribe"})", "subscriptions must be a list"},
      {R"({"op":"unsubscribe","subscriptionIds":[3]})", "there is no subscription 3"},
      {R"({"op":"unsubscribe","subscriptionIds":["x"]})", "there is no subscription"},
      {R"({"op":7})", "no JSON object with op"},
      {"[]", "no JSON object with op"},
      {"{", "no JSON object with op"},
      {R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":1},{"id":1,"channelId":2}]})", "1 is there already"},
      {R"({"op":"subscribe","subscriptions":[{"id":2,"channelId":1}]})", "channel 1 has a subscription already"},
  };
  for (const auto& c : cases) {
    client->say(c.text);
    const Json status = hear_text();
    EXPECT_EQ(status["op"], "status") << c.text;
    EXPECT_GE(status["level"], 1) << c.text;
    EXPECT_THAT(status["message"].get<std::string>(), HasSubstr(c.says)) << c.text;
  }
  client->say("\1\1\1\1\1{}", 2);
  EXPECT_THAT(hear_text()["message"].get<std::string>(), HasSubstr("binary messages are not understood"));
  EXPECT_FALSE(server->take());  // nothing of it is a command
}

TEST_F(Foxglove, TooManyMessagesEndIt) {
  const auto server = start();
  connect(*server);
  for (int i = 0; i < 200; ++i) client->say(R"({"op":"subscribe","subscriptions":[]})");
  EXPECT_EQ(client->hear_end(), 1008);
}

/// A client that does not read loses rows, is told so, and the one that pushes never waits.
TEST_F(Foxglove, ASlowClientLosesRowsAndIsTold) {
  ServerOptions options;
  options.limits.row_bytes = 4000;
  const auto server = start(options);
  connect(*server, new_name, "", 4096);
  client->say(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":1},{"id":2,"channelId":2}]})");
  for (int i = 0; i < 60000; ++i) {
    push(*server, i, 1);
    if (i % 100 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  bool told_so = false;
  std::uint64_t last_ns = 0, gaps = 0;
  while (!told_so || gaps == 0) {
    const auto message = client->hear();
    ASSERT_TRUE(message);
    told_so =
        told_so || (message->opcode == 1 && message->content.find("Send buffer limit reached") != std::string::npos);
    if (message->opcode != 2 || message->content[0] != 2) continue;
    const auto ns = number<std::uint64_t>(message->content, 1);
    EXPECT_TRUE(last_ns == 0 || ns > last_ns);
    gaps += last_ns > 0 && ns > last_ns + 1'000'000'000;
    last_ns = ns;
  }
}

TEST_F(Foxglove, HasTheSameRulesOfAccess) {
  ServerOptions options;
  options.foxglove_origin = "http://localhost:8081";
  const auto server = start(options);
  const auto answers = [&](const std::string& protocol, const std::string& more) {
    connect(*server, protocol, more);
    return answer.substr(0, 12);
  };
  const std::string named = "Origin: http://localhost:8081\r\n";
  EXPECT_EQ(answers(old_name, named), "HTTP/1.1 101");
  EXPECT_EQ(answers(old_name, "Origin: http://evil.example\r\n"), "HTTP/1.1 403");
  EXPECT_EQ(answers(old_name, "Origin: null\r\n"), "HTTP/1.1 403");
  EXPECT_EQ(answers("tribotwin.live.v1", named), "HTTP/1.1 403");  // it could give commands
  EXPECT_EQ(answers("tribotwin.live.v1, foxglove.sdk.v1", named), "HTTP/1.1 403");
  EXPECT_THAT(Client(port_of(*server)).get("/app.js", named), StartsWith("HTTP/1.1 403"));
  ServerOptions guarded = options;
  guarded.address.loopback = false;
  const auto other = start(guarded);
  Client without(port_of(*other)), with(port_of(*other));
  EXPECT_THAT(without.ask_for(old_name, named), StartsWith("HTTP/1.1 403"));
  const std::string& url = other->url();
  EXPECT_THAT(with.ask_for(old_name, named, "/" + url.substr(url.find("?token="))), StartsWith("HTTP/1.1 101"));
}

}  // namespace
}  // namespace tribotwin::twin::live
