#include <random>
#include <thread>

#include "client.hpp"
#include <gmock/gmock.h>
#include <sys/resource.h>

namespace tribotwin::twin::live {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;
using namespace std::chrono_literals;

Hello some_hello() {
  return {.program = "run",
          .version = "1",
          .scenario = "test",
          .step_s = 0.001,
          .commands = {"pause"},
          .joints = {{"joint1", "extended", 80}, {"joint2", "", {}}},
          .columns = std::vector<Column>(64, {"", "time_s", "s"})};
}

ServerOptions here(ServerOptions options = {}) {
  options.address.port = 0;
  return options;
}

/// Needs a token although it is on loopback.
ServerOptions guarded() {
  ServerOptions options = here();
  options.address.loopback = false;
  return options;
}

std::unique_ptr<Server> start(const ServerOptions& options = here()) {
  return std::move(Server::start(options, some_hello()).value());
}

std::string get(const Server& server, const std::string& target, const std::string& more = {}) {
  return Client(port_of(server)).get(target, more);
}

TEST(Server, ServesWhatIsEmbeddedAndNothingElse) {
  const auto server = start();
  const std::string page = get(*server, "/");
  EXPECT_THAT(page, StartsWith("HTTP/1.1 200 OK"));
  EXPECT_THAT(page, HasSubstr("Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; "
                              "img-src 'self' data:; connect-src 'self'"));
  EXPECT_THAT(page, HasSubstr("<!doctype html>"));
  for (const char* target : {"/etc/passwd", "/../../etc/passwd", "/%2e%2e/etc/passwd", "//etc/passwd", "/index.html/",
                             "/INDEX.html", "/.", "/page/index.html", "/index.html%00", "/index.html#", "etc/passwd",
                             "*", "http://127.0.0.1/", "file:///etc/passwd"})
    EXPECT_THAT(get(*server, target), StartsWith("HTTP/1.1 404")) << target;
}

TEST(Server, UnderstandsNothingButGetAndHead) {
  const auto server = start();
  const auto answer = [&](const std::string& request) {
    Client client(port_of(*server));
    client.send(fmt::format(fmt::runtime(request), port_of(*server)));
    client.say_no_more();
    return client.rest();
  };
  for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT"})
    EXPECT_THAT(answer(std::string(method) + " / HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n"), StartsWith("HTTP/1.1 405"));
  const std::string head = answer("HEAD / HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n");
  EXPECT_THAT(head, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(head, Not(HasSubstr("<!doctype")));
  EXPECT_THAT(answer("GET / HTTP/1.1\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(answer("GET / HTTP/1.1\r\nHost: 127.0.0.1:{0}\r\nHost: 127.0.0.1:{0}\r\n\r\n"),
              StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(answer("GET / HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nContent-Length: 5\r\n\r\nhello"),
              Not(StartsWith("HTTP/1.1 200")));
  EXPECT_THAT(answer("GET / HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nX: " + std::string(9000, 'x') + "\r\n\r\n"),
              Not(StartsWith("HTTP/1.1 200")));
}

TEST(Server, RefusesForeignHostsAndOrigins) {
  const auto server = start();
  const std::string ours = fmt::format("http://127.0.0.1:{}", port_of(*server));
  EXPECT_THAT(get(*server, "/", fmt::format("Host: evil.example:{}\r\n", port_of(*server))),
              StartsWith("HTTP/1.1 403"));
  EXPECT_THAT(get(*server, "/", "Origin: http://evil.example\r\n"), StartsWith("HTTP/1.1 403"));
  EXPECT_FALSE(Client(port_of(*server)).watch("Origin: http://evil.example\r\n"));
  EXPECT_FALSE(Client(port_of(*server)).watch("Origin: null\r\n"));
  EXPECT_TRUE(Client(port_of(*server)).watch("Origin: " + ours + "\r\n"));
}

TEST(Server, LetsNobodyInWithoutTheToken) {
  const auto server = start(guarded());
  const std::string& url = server->url();
  const std::string token = url.substr(url.rfind('=') + 1);
  ASSERT_EQ(token.size(), 32);
  const std::string entered = get(*server, "/?token=" + token);
  EXPECT_THAT(entered, StartsWith("HTTP/1.1 200"));
  const std::string cookie = fmt::format("tribotwin_{}={}", port_of(*server), token);
  EXPECT_THAT(entered, HasSubstr("Set-Cookie: " + cookie));
  EXPECT_THAT(get(*server, "/", "Cookie: " + cookie + "\r\n"), StartsWith("HTTP/1.1 200"));
  EXPECT_TRUE(Client(port_of(*server)).watch("Cookie: " + cookie + "\r\n"));
  for (const char* target :
       {"/", "/index.html", "/nothing", "/live", "/?token=", "/?token=00000000000000000000000000000000"})
    EXPECT_THAT(get(*server, target), StartsWith("HTTP/1.1 403")) << target;
  EXPECT_FALSE(Client(port_of(*server)).watch());
  EXPECT_FALSE(Client(port_of(*server)).watch("Cookie: " + cookie.substr(0, cookie.size() - 1) + "\r\n"));
}

TEST(Server, SaysWhyAnAddressCannotBeHad) {
  const auto server = start();
  ServerOptions taken;
  taken.address.port = port_of(*server);
  const auto second = Server::start(taken, some_hello());
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().kind, ErrorKind::input);
  EXPECT_THAT(second.error().message,
              HasSubstr(fmt::format("127.0.0.1:{}: Address already in use", taken.address.port)));
}

TEST(Server, TellsWhatHappenedAndPassesCommands) {
  auto server = start();
  for (int i = 0; i < 250; ++i) {
    server->tell(Event{static_cast<double>(i), "note", "joint1", fmt::format("event {}", i)});
    if (i == 125) std::this_thread::sleep_for(200ms);  // the way to the server holds 256 messages
  }
  std::this_thread::sleep_for(200ms);
  Client client(port_of(*server));
  ASSERT_TRUE(client.watch());
  EXPECT_THAT(client.hear_text("hello"), HasSubstr(R"("commands":["pause"],"faults":[],"joint_faults":[],"joints":[)"));
  EXPECT_THAT(client.hear_text("event"), HasSubstr("event 50"));  // the last 200
  client.say(R"({"type":"command","id":7,"do":"pause"})");
  std::optional<Command> command;
  for (int i = 0; i < 1000 && !(command = server->take()); ++i) std::this_thread::sleep_for(10ms);
  ASSERT_TRUE(command);
  EXPECT_EQ(command->name, "pause");
  server->tell(Done{command->viewer, command->id, true, "paused"});
  EXPECT_EQ(client.hear_text("done"), R"({"type":"done","id":7,"ok":true,"message":"paused"})");
  server->tell(Status{.simulated_s = 1.5});
  EXPECT_THAT(client.hear_text("status"), HasSubstr(R"("simulated_s":1.5)"));
  server.reset();
  EXPECT_EQ(client.hear_end(), 1001);
}

TEST(Server, LosesNoAnswerAndCountsTheEventsThatItLoses) {
  ServerOptions options = here();
  options.limits.batches_per_s = 1;  // what comes within a second has to wait
  options.limits.messages_per_s = 1000;
  const auto server = start(options);
  Client client(port_of(*server));
  ASSERT_TRUE(client.watch());
  constexpr int commands = 150, events = 600;
  for (int i = 0; i < events; ++i) server->tell(Event{1, "note", "", "many"});
  int said = 0, answered = 0;
  for (int tries = 0; answered < commands && tries < 2000; ++tries, std::this_thread::sleep_for(5ms)) {
    for (; said < commands && said < answered + 60; ++said)  // 64 may wait
      client.say(fmt::format(R"({{"type":"command","id":{},"do":"pause"}})", said));
    while (const auto command = server->take()) {
      server->tell(Done{command->viewer, command->id, true, "paused"});
      ++answered;
    }
  }
  EXPECT_EQ(answered, commands);
  server->tell(Status{.simulated_s = 2});
  int told = 0, done = 0;
  std::uint64_t lost = 0;
  while (const auto message = client.hear()) {
    const std::string& text = message->content;
    told += text.starts_with(R"({"type":"event")");
    if (text.starts_with(R"({"type":"done")"))
      EXPECT_EQ(text, fmt::format(R"({{"type":"done","id":{},"ok":true,"message":"paused"}})", done++));
    if (const auto at = text.find(R"("lost_events":)"); at != text.npos) lost = std::stoull(text.substr(at + 14));
    if (lost && done == commands) break;
  }
  EXPECT_EQ(done, commands);
  EXPECT_GT(lost, 0);
  EXPECT_EQ(static_cast<std::uint64_t>(told) + lost, events);
}

TEST(Server, RefusesMessagesThatAreNoCommand) {
  const auto server = start();
  Client client(port_of(*server));
  ASSERT_TRUE(client.watch());
  for (const auto& [text, why] :
       std::vector<std::pair<std::string, std::string>>{{"", "no JSON object"},
                                                        {"[]", "no JSON object"},
                                                        {"{", "no JSON object"},
                                                        {R"({"type":"x"})", "type must be"},
                                                        {R"({"type":"watch"})", "one of: joint1, joint2"},
                                                        {R"({"type":"watch","joint":7})", "one of: joint1, joint2"},
                                                        {R"({"type":"watch","joint":"joint1"})", "tells no laws"},
                                                        {R"({"type":"command","do":"pause"})", "id must be"},
                                                        {R"({"type":"command","id":{},"do":"pause"})", "id must be"},
                                                        {R"({"type":"command","id":1,"do":"fly"})", "one of: pause"},
                                                        {R"({"type":"command","id":1})", "one of: pause"},
                                                        {std::string(4000, '['), "no JSON object"}}) {
    client.say(text);
    EXPECT_THAT(client.hear_text("done"), HasSubstr(why)) << text;
  }
  EXPECT_FALSE(server->take());
}

TEST(Server, TellsTheLawOfTheJointThatAViewerWatches) {
  ServerOptions options = here();
  options.readonly = true;
  Hello hello = some_hello();
  hello.law = [](std::size_t joint, const drive::Workspace& state) {
    return Law{joint ? "joint2" : "joint1", state.temperature_degC, 0.5, {-1, 1}, {2, 3}};
  };
  const auto server = Server::start(options, hello).value();
  Client first(port_of(*server)), second(port_of(*server));
  ASSERT_TRUE(first.watch() && second.watch());
  first.say(R"({"type":"watch","joint":"joint1"})");
  second.say(R"({"type":"watch","joint":"joint2"})");
  std::this_thread::sleep_for(200ms);
  Status status;
  status.joints.resize(2);
  status.joints[1].temperature_degC = 40;
  server->tell(status);
  EXPECT_THAT(first.hear_text("law"), HasSubstr(R"("joint":"joint1","temperature_degC":0.0)"));
  EXPECT_EQ(second.hear_text("law"), R"({"type":"law","joint":"joint2","temperature_degC":40.0,"load_norm":0.5,)"
                                     R"("speed_rad_s":[-1.0,1.0],"friction_nm":[2.0,3.0]})");
  first.say(R"({"type":"watch","joint":"joint2"})");
  std::string law;
  for (int i = 0; i < 10 && law.find("joint2") == law.npos; ++i) law = first.hear_text("law");  // the next or so
  EXPECT_THAT(law, HasSubstr("joint2"));
}

TEST(Server, ObeysNobodyWhenReadOnly) {
  ServerOptions options = here();
  options.readonly = true;
  const auto server = start(options);
  Client client(port_of(*server));
  ASSERT_TRUE(client.watch());
  EXPECT_THAT(client.hear_text("hello"), HasSubstr(R"("readonly":true,"step_s":0.001,"commands":[])"));
  client.say(R"({"type":"command","id":"a","do":"pause"})");
  EXPECT_THAT(client.hear_text("done"), HasSubstr(R"("id":"a","ok":false,"message":"this bench is read-only)"));
  EXPECT_FALSE(server->take());
}

TEST(Server, ClosesThoseWhoSayTooMuch) {
  const auto server = start();
  Client loud(port_of(*server)), fast(port_of(*server)), strange(port_of(*server));
  ASSERT_TRUE(loud.watch() && fast.watch() && strange.watch());
  loud.say(std::string(4097, ' '));
  EXPECT_EQ(loud.hear_end(), 1009);
  for (int i = 0; i < 50; ++i) fast.say("{}");
  EXPECT_EQ(fast.hear_end(), 1008);
  strange.say("bytes", 2);
  EXPECT_EQ(strange.hear_end(), 1003);
}

TEST(Server, HasRoomForSoManyViewersAndConnections) {
  ServerOptions options = here();
  options.limits.viewers = 2;
  options.limits.connections = 5;
  const auto server = start(options);
  const auto port = port_of(*server);
  Client one(port), two(port), three(port);
  EXPECT_TRUE(one.watch() && two.watch());
  EXPECT_FALSE(three.watch());
  EXPECT_THAT(three.rest(), HasSubstr("Too many pages"));
  std::vector<std::unique_ptr<Client>> idle;
  for (int i = 0; i < 3; ++i) idle.push_back(std::make_unique<Client>(port));
  for (const auto& client : idle) EXPECT_TRUE(client->send("GET / "));
  Client last(port);
  EXPECT_TRUE(last.closed());
  idle.clear();  // their places are free again
  std::string answer;
  for (int i = 0; i < 500 && !answer.starts_with("HTTP/1.1 200"); ++i) {
    std::this_thread::sleep_for(10ms);
    answer = get(*server, "/");
  }
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
}

TEST(Server, WaitsNotLongForARequest) {
  ServerOptions options = here();
  options.limits.header = 300ms;
  const auto server = start(options);
  Client slow(port_of(*server)), silent(port_of(*server));
  slow.send("GET / HTTP/1.1\r\n");
  bool closed = false;
  for (int i = 0; i < 400 && !closed; ++i) {  // each byte alone is in time
    slow.send("X");
    std::this_thread::sleep_for(50ms);
    closed = slow.closed_now();
  }
  EXPECT_TRUE(closed);
  EXPECT_TRUE(silent.closed());
}

/// Every value of row n is n.
bool push(Server& server, std::uint64_t n) {
  return server.rows().push([&](std::span<double> row) { std::ranges::fill(row, static_cast<double>(n)); });
}

TEST(Server, LosesRowsOfASlowViewerAlone) {
  auto server = start();
  Client slow(port_of(*server), 4096), fast(port_of(*server));
  ASSERT_TRUE(slow.watch() && fast.watch());
  fast.hear_text("hello");
  std::uint64_t next = 0, wrong = 0, batches = 0;
  std::thread reader([&] {
    while (const auto message = fast.hear()) {
      if (message->opcode == 8) break;
      if (message->opcode != 2) continue;
      const Batch batch(message->content);
      wrong += batch.kind != 1 || batch.columns != 64 || batch.first != next ||
               batch.values.size() != batch.rows * 64 ||
               batch.values.back() != static_cast<double>(next + batch.rows - 1);
      next = batch.first + batch.rows;
      ++batches;
    }
  });
  constexpr std::uint64_t bursts = 400, burst = 100;  // 20 MB
  std::uint64_t lost = 0;
  for (std::uint64_t i = 0; i < bursts; ++i, std::this_thread::sleep_for(5ms))
    for (std::uint64_t k = 0; k < burst; ++k) lost += !push(*server, i * burst + k);
  EXPECT_EQ(lost, 0);
  std::this_thread::sleep_for(200ms);
  // What waits for the slow viewer begins behind a gap; every row that it has is right.
  std::uint64_t gaps = 0, slow_next = 0, slow_wrong = 0;
  while (slow_next < bursts * burst) {
    const auto message = slow.hear();
    if (!message) break;
    if (message->opcode != 2) continue;
    const Batch batch(message->content);
    gaps += batch.first != slow_next;
    slow_wrong += batch.values.front() != static_cast<double>(batch.first);
    slow_next = batch.first + batch.rows;
  }
  server.reset();
  reader.join();
  EXPECT_EQ(next, bursts * burst);
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(batches, 10);
  EXPECT_EQ(slow_next, bursts * burst);
  EXPECT_GT(gaps, 0);
  EXPECT_EQ(slow_wrong, 0);
}

TEST(Server, NeverMakesTheStepsWait) {
  const auto server = start();
  Client slow(port_of(*server), 4096);
  ASSERT_TRUE(slow.watch());
  const auto waits = [] {
    rusage usage{};
    ::getrusage(RUSAGE_THREAD, &usage);
    return usage.ru_nvcsw;
  };
  const auto before = waits();
  std::uint64_t lost = 0;
  for (std::uint64_t i = 0; i < 200'000; ++i) lost += !push(*server, i);  // 100 MB, faster than anybody takes them
  for (int i = 0; i < 1000; ++i) EXPECT_FALSE(server->take());
  EXPECT_EQ(waits(), before);
  EXPECT_GT(lost, 0);  // the ring was full
}

/// Requests that were damaged, cut short, repeated, or are noise.
std::string hostile(std::mt19937& random, std::uint16_t port) {
  const auto below = [&](std::size_t n) { return std::uniform_int_distribution<std::size_t>(0, n - 1)(random); };
  std::string text = fmt::format("GET {} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{}Cookie: a=b; tribotwin_{}=0\r\n\r\n",
                                 below(2) ? "/live?token=0" : "/", port, below(2) ? Client::upgrade : "", port);
  if (below(8) == 0) text.assign(below(400), '\0');
  for (std::size_t changes = below(8); changes-- > 0 && !text.empty();) {
    const std::size_t at = below(text.size());
    switch (below(4)) {
      case 0:
        text[at] = static_cast<char>(below(256));
        break;
      case 1:
        text.erase(at, below(40));
        break;
      case 2:
        text.insert(at, std::string(below(300), static_cast<char>(below(256))));
        break;
      default:
        text.insert(at, text.substr(below(text.size()), below(100)));
    }
  }
  return text;
}

TEST(Server, SurvivesHostileRequestsAndLetsNoneIn) {
  const auto server = start(guarded());
  std::mt19937 random(1);
  for (int i = 0; i < 3000; ++i) {
    Client client(port_of(*server));
    const std::string text = hostile(random, port_of(*server));
    client.send(text);
    client.say_no_more();
    const std::string answer = client.rest();
    EXPECT_TRUE(answer.empty() || answer.starts_with("HTTP/1.1 400") || answer.starts_with("HTTP/1.1 403"))
        << i << ": " << answer << "\n"
        << text;
  }
  const std::string& url = server->url();
  EXPECT_THAT(get(*server, url.substr(url.find("/?"))), StartsWith("HTTP/1.1 200"));
}

TEST(Server, SurvivesHostileFrames) {
  const auto server = start();
  std::mt19937 random(2);
  for (int i = 0; i < 1000; ++i) {
    Client client(port_of(*server));
    ASSERT_TRUE(client.watch()) << i;
    std::string bytes(1 + random() % 200, '\0');
    for (char& byte : bytes) byte = static_cast<char>(random());
    if (i % 2) client.say(bytes.substr(0, 100));
    client.send(bytes);
    client.say_no_more();
    client.rest();
  }
  EXPECT_FALSE(server->take());
  EXPECT_THAT(get(*server, "/"), StartsWith("HTTP/1.1 200"));
}

}  // namespace
}  // namespace tribotwin::twin::live
