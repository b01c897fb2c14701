// Those who want to harm a live bench: each test fails when the limit that it names is taken away.
#include <fstream>
#include <thread>

#include "client.hpp"
#include <gmock/gmock.h>
#include <poll.h>

namespace tribotwin::twin::live {
namespace {

using testing::HasSubstr;
using testing::StartsWith;
using namespace std::chrono_literals;

std::unique_ptr<Server> bench(Limits limits = {}) {
  ServerOptions options;
  options.address.port = 0;
  options.limits = limits;
  Hello hello{.program = "drive", .version = "1", .scenario = "hostile", .commands = {"marker"}};
  hello.columns = std::vector<Column>(8, {"", "time_s", "s"});
  return std::move(Server::start(options, hello).value());
}

/// An open connection that is not asked anything.
int raw_connection(std::uint16_t port) {
  const int client = ::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0);
  sockaddr_in address{.sin_family = AF_INET, .sin_port = htons(port), .sin_addr = {htonl(INADDR_LOOPBACK)}};
  (void)::connect(client, reinterpret_cast<sockaddr*>(&address), sizeof address);
  return client;
}

/// Whether the other end has ended it by now.
bool ended(int client) {
  char byte;
  const ssize_t got = ::recv(client, &byte, 1, MSG_DONTWAIT);
  return got == 0 || (got < 0 && errno != EAGAIN);
}

/// Whether it becomes true soon; a busy machine may take its time.
template <class Condition>
bool soon(Condition condition) {
  for (int i = 0; i < 400; ++i, std::this_thread::sleep_for(50ms))
    if (condition()) return true;
  return false;
}

bool serves(const Server& server) {
  return soon([&] { return Client(port_of(server)).get("/").starts_with("HTTP/1.1 200"); });
}

std::size_t resident_kib() {
  std::ifstream file("/proc/self/statm");
  std::size_t all = 0, resident = 0;
  file >> all >> resident;
  return resident * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)) / 1024;
}

/// A frame with a mask of zeros whose head says `size`.
std::string frame(int first, std::uint64_t size, std::string_view content = {}) {
  const int more = size > 0xFFFF ? 8 : 2;
  std::string bytes{static_cast<char>(first), static_cast<char>(more == 8 ? 0xFF : 0xFE)};
  for (int byte = more; byte-- > 0;) bytes += static_cast<char>(size >> (8 * byte));
  return bytes + std::string(4, '\0') + std::string(content);
}

// Limits::connections
TEST(Hostile, ThousandConnectionsLeaveTheViewersAlone) {
  const auto server = bench();
  Client viewer(port_of(*server));
  ASSERT_TRUE(viewer.watch());
  viewer.hear_text("hello");
  std::vector<int> crowd;
  for (int i = 0; i < 1000; ++i) crowd.push_back(raw_connection(port_of(*server)));
  const auto open = [&] { return std::ranges::count_if(crowd, [](int one) { return !ended(one); }); };
  EXPECT_TRUE(soon([&] { return open() < 64; })) << open();
  EXPECT_GT(open(), 0);
  server->rows().push([](std::span<double> row) { std::ranges::fill(row, 7); });
  const auto rows = viewer.hear();
  ASSERT_TRUE(rows);
  EXPECT_EQ(Batch(rows->content).values, std::vector<double>(8, 7));
  for (const int one : crowd) ::close(one);
  EXPECT_TRUE(serves(*server));
}

// Limits::header
TEST(Hostile, SlowRequestsGiveTheirPlacesBack) {
  Limits limits;
  limits.header = 400ms;
  const auto server = bench(limits);
  std::vector<std::unique_ptr<Client>> slow;
  for (std::size_t i = 0; i < limits.connections; ++i) {
    slow.push_back(std::make_unique<Client>(port_of(*server)));
    slow.back()->send("GET / HTTP/1.1\r\n");
  }
  EXPECT_TRUE(soon([&] {
    for (const auto& one : slow) one->send("X: y\r\n");  // each line alone is in time
    return Client(port_of(*server)).get("/").starts_with("HTTP/1.1 200");
  }));
}

// Limits::response
TEST(Hostile, ViewersThatSayNothingGiveTheirPlacesBack) {
  Limits limits;
  limits.response = 600ms;
  limits.viewers = 2;
  const auto server = bench(limits);
  Client one(port_of(*server)), two(port_of(*server));
  ASSERT_TRUE(one.watch() && two.watch());  // from here on they answer no ping
  EXPECT_FALSE(Client(port_of(*server)).watch());
  EXPECT_TRUE(soon([&] { return Client(port_of(*server)).watch(); }));
}

TEST(Hostile, HalfClosedViewersGiveTheirPlacesBack) {
  const auto server = bench();
  for (int round = 0; round < 5; ++round) {
    std::vector<std::unique_ptr<Client>> gone;
    for (std::size_t i = 0; i < Limits{}.viewers; ++i) {
      gone.push_back(std::make_unique<Client>(port_of(*server)));
      ASSERT_TRUE(soon(
          [&] { return gone.back()->watch() || (gone.back() = std::make_unique<Client>(port_of(*server)), false); }));
    }
    for (const auto& one : gone) one->say_no_more();
    for (const auto& one : gone) one->rest();  // to the end that the server makes
  }
  EXPECT_TRUE(serves(*server));
}

// Limits::message_bytes
TEST(Hostile, HugeMessagesAreRefusedBeforeTheyCome) {
  const auto server = bench();
  for (const std::uint64_t size : {std::uint64_t{4097}, std::uint64_t{1} << 32, (std::uint64_t{1} << 63) - 1}) {
    Client client(port_of(*server));
    ASSERT_TRUE(client.watch());
    client.send(frame(0x81, size, "{"));
    EXPECT_EQ(client.hear_end(), 1009) << size;
  }
  Client parts(port_of(*server));
  ASSERT_TRUE(parts.watch());
  parts.send(frame(0x01, 1000, std::string(1000, ' ')));
  for (int i = 0; i < 4; ++i) parts.send(frame(0x00, 1000, std::string(1000, ' ')));
  EXPECT_EQ(parts.hear_end(), 1009);
}

// Limits::messages_per_s: pings cost an answer each.
TEST(Hostile, PingsAreMessagesToo) {
  const auto server = bench();
  Client client(port_of(*server));
  ASSERT_TRUE(client.watch());
  for (int i = 0; i < 100; ++i) client.say("", 9);
  EXPECT_EQ(client.hear_end(), 1008);
  Client polite(port_of(*server));
  ASSERT_TRUE(polite.watch());
  polite.hear_text("hello");
  polite.say("here", 9);
  const auto answer = polite.hear();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->opcode, 10);
}

// Limits::bytes_per_s: a message of empty parts never ends and is never too long.
TEST(Hostile, AFloodIsReadSlowly) {
  const auto server = bench();
  Client client(port_of(*server));
  ASSERT_TRUE(client.watch());
  const std::string part = [] {
    std::string many;
    for (int i = 0; i < 10'000; ++i) many += std::string{'\0', '\x80', '\0', '\0', '\0', '\0'};
    return many;
  }();
  client.send(std::string{'\1', '\x80', '\0', '\0', '\0', '\0'});
  std::size_t at = 0;
  const auto taken_within = [&](std::chrono::milliseconds time) {
    std::size_t taken = 0;
    for (const auto end = std::chrono::steady_clock::now() + time; std::chrono::steady_clock::now() < end;) {
      const std::size_t sent = client.send_now(std::string_view(part).substr(at));
      taken += sent;
      at = (at + sent) % part.size();
      if (sent == 0) std::this_thread::sleep_for(5ms);
    }
    return taken;
  };
  for (int i = 0; i < 20 && taken_within(1s) > 2 * Limits{}.bytes_per_s; ++i) {
  }  // as much as the buffers of the kernel hold
  EXPECT_LT(taken_within(3s), 5 * Limits{}.bytes_per_s);
  EXPECT_TRUE(client.rest_now() && !client.closed_now());
  EXPECT_TRUE(serves(*server));
}

// Limits::texts
TEST(Hostile, AViewerThatDoesNotReadIsSentAway) {
  const auto server = bench();
  Client deaf(port_of(*server), 4096), viewer(port_of(*server));
  ASSERT_TRUE(deaf.watch() && viewer.watch());
  std::thread reader([&] { viewer.hear_end(); });
  const std::string text(20'000, 'x');
  [[maybe_unused]] const std::size_t before = resident_kib();
  for (int i = 0; i < 3000; ++i) {  // 60 MB
    server->tell(Event{0, "note", "", text});
    if (i % 50 == 49) std::this_thread::sleep_for(40ms);
  }
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // which keep what was freed
  EXPECT_LT(resident_kib(), before + 30'000);                        // 456 texts of a viewer, among them the last 200
#endif
  EXPECT_TRUE(soon([&] {
    Client(port_of(*server)).get("/");
    return deaf.rest_now() && deaf.closed_now();
  }));
  // The other one has all that it was told, and the room is free again.
  std::thread end([&] { const_cast<std::unique_ptr<Server>&>(server).reset(); });
  end.join();
  reader.join();
}

TEST(Hostile, TextThatIsNoneIsRefused) {
  const auto server = bench();
  for (const char* bad : {"\xff\xfe", "\xc0\x80", "\xed\xa0\x80", "{\"type\":\"\xf5\"}"}) {
    Client client(port_of(*server));
    ASSERT_TRUE(client.watch());
    client.say(bad);
    EXPECT_EQ(client.hear_end(), 1007) << bad;
  }
  Client client(port_of(*server));
  ASSERT_TRUE(client.watch());
  std::string deep;
  while (deep.size() < 4000) deep += "{\"a\":[";
  for (const std::string& text : {deep, std::string(4096, '['), std::string("{\"type\":") + std::string(4000, '1')}) {
    client.say(text);
    EXPECT_THAT(client.hear_text("done"), HasSubstr("no JSON object"));
  }
  EXPECT_FALSE(server->take());
}

// The room of the way to the steps: what they do not take does not wait without end.
TEST(Hostile, CommandsThatNobodyTakesAreRefused) {
  const auto server = bench();
  std::vector<std::unique_ptr<Client>> pages;
  std::size_t refused = 0;
  for (int page = 0; page < 8; ++page) {
    pages.push_back(std::make_unique<Client>(port_of(*server)));
    ASSERT_TRUE(pages.back()->watch());
    for (int i = 0; i < 15; ++i) pages.back()->say(R"({"type":"command","id":1,"do":"marker","text":"x"})");
    pages.back()->say(R"({"type":"command","id":2,"do":"nothing"})");  // answered at once, behind the others
    for (std::string done; done.find("\"id\":2") == done.npos;) {
      done = pages.back()->hear_text("done");
      ASSERT_FALSE(done.empty());
      refused += done.find("too many commands wait") != done.npos;
    }
  }
  std::size_t taken = 0;
  while (server->take()) ++taken;
  EXPECT_EQ(taken, 64);
  EXPECT_EQ(taken + refused, 8 * 15);
}

// All of it at once: what the steps call never waits, and who reads loses nothing.
TEST(Hostile, TheStepsGoOnUnderAttack) {
  const auto server = bench();
  const std::uint16_t port = port_of(*server);
  Client viewer(port);
  ASSERT_TRUE(viewer.watch());
  viewer.hear_text("hello");
  std::atomic<bool> attack = true;
  std::vector<std::thread> attackers;
  for (int who = 0; who < 3; ++who)
    attackers.emplace_back([&attack, port, who] {
      while (attack) {
        if (who == 0) {
          for (int i = 0; i < 20; ++i) ::close(raw_connection(port));
          std::this_thread::sleep_for(1ms);
          continue;
        }
        Client one(port);
        if (who == 1 && one.watch()) {
          one.send(frame(0x81, std::uint64_t{1} << 40, std::string(3000, 'x')));
          for (int i = 0; i < 50; ++i) one.say("{\"type\":", i % 2 ? 9 : 1);
        } else {
          one.send("GET /live HTTP/1.1\r\nX: " + std::string(7000, 'x'));
        }
        std::this_thread::sleep_for(1ms);
      }
    });
  std::uint64_t next = 0, wrong = 0;
  constexpr std::uint64_t rows = 2000;
  std::thread reader([&] {
    while (next < rows) {
      const auto message = viewer.hear();
      if (!message || message->opcode == 8) break;
      if (message->opcode != 2) continue;
      const Batch batch(message->content);
      wrong += batch.first != next;
      next = batch.first + batch.rows;
    }
  });
  std::uint64_t lost = 0;
  for (std::uint64_t i = 0; i < rows; ++i, std::this_thread::sleep_for(1ms))
    lost += !server->rows().push([&](std::span<double> row) { std::ranges::fill(row, 0); });
  reader.join();
  attack = false;
  for (auto& one : attackers) one.join();
  EXPECT_EQ(lost, 0);
  EXPECT_EQ(next, rows);
  EXPECT_EQ(wrong, 0);
  EXPECT_FALSE(server->take());
  EXPECT_TRUE(serves(*server));
}

}  // namespace
}  // namespace tribotwin::twin::live
