// The HTTP and WebSocket side of a live bench with hostile bytes over loopback: nobody gets in without the token, what
// is obeyed is a command that there is, and in the end the bench still serves. For libFuzzer, and as a program:
// fuzz_live COUNT SEED.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "require.hpp"
#include <arpa/inet.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <tribotwin/twin/live/commands.hpp>
#include <tribotwin/twin/live/server.hpp>
#include <tribotwin/twin/simulation/scenario_input.hpp>

namespace {

using namespace tribotwin::twin;
using namespace tribotwin::twin::live;

long inside = 0, answered = 0, refused = 0, files = 0;
std::optional<std::int64_t> left;  // of the run that is paused

/// A bench that needs a token although it is on loopback.
struct HostileBench {
  std::unique_ptr<Server> server;
  std::uint16_t port = 0;
  std::string token;
  /// What hostile pages record and export comes here and nowhere else.
  const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / fmt::format("tribotwin_fuzz_live_{}", ::getpid());

  HostileBench(const HostileBench&) = delete;
  ~HostileBench() {
    server.reset();
    std::filesystem::remove_all(folder);
  }
  HostileBench() {
    ServerOptions options;
    options.address = {.host = "127.0.0.1", .port = 0, .loopback = false};
    options.limits.messages_per_s = 1000;  // so that what is said reaches the parser
    options.limits.memory_bytes = 1 << 16;
    std::filesystem::create_directories(folder);
    options.folder = folder;
    Hello hello{.program = "fuzz",
                .version = "1",
                .scenario = "fuzz",
                .commands = {"pause", "marker", "step", "wear"},
                .joints = {{"joint1", "load", 80}},
                .columns = std::vector<Column>(8, {"", "time_s", "s"})};
    hello.head = TelemetryOptions{.joints = {"joint1"}, .channels = std::vector<Channel>(7)};
    for (std::size_t c = 0; c < 7; ++c) hello.head->channels[c].name = fmt::format("channel_{}", c);
    auto started = Server::start(options, std::move(hello));
    require(started.has_value(), "no server");
    server = std::move(*started);
    const std::string& url = server->url();
    const auto colon = url.rfind(':');
    port = static_cast<std::uint16_t>(std::stoi(url.substr(colon + 1)));
    token = url.substr(url.rfind('=') + 1);
  }
};

HostileBench& bench() {
  static HostileBench one;
  return one;
}

/// A connection to the bench.
class Stranger {
 public:
  Stranger() : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const timeval patience{.tv_sec = 20, .tv_usec = 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    const linger at_once{.l_onoff = 1, .l_linger = 0};  // no port waits
    ::setsockopt(socket_, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    const sockaddr_in address{
        .sin_family = AF_INET, .sin_port = htons(bench().port), .sin_addr = {htonl(INADDR_LOOPBACK)}, .sin_zero = {}};
    require(::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0, "nobody listens");
  }
  Stranger(const Stranger&) = delete;
  ~Stranger() { ::close(socket_); }

  void send(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t sent = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (sent <= 0) break;  // refused before the end
      bytes.remove_prefix(static_cast<std::size_t>(sent));
    }
  }
  /// Hears what comes up to this, or to the end.
  std::string hear(std::string_view end) {
    std::string all;
    for (char byte; !all.ends_with(end) && ::recv(socket_, &byte, 1, 0) == 1;) all += byte;
    return all;
  }
  /// Says that it has no more to say, and hears the rest.
  std::string rest() {
    ::shutdown(socket_, SHUT_WR);
    std::string all;
    char part[4096];
    ssize_t got;
    while ((got = ::recv(socket_, part, sizeof part, 0)) > 0) all.append(part, static_cast<std::size_t>(got));
    require(got == 0 || errno != EAGAIN, "the connection was not closed");
    return all;
  }

 private:
  int socket_;
};

std::string answer_to(std::string_view bytes) {
  Stranger stranger;
  stranger.send(bytes);
  return stranger.rest();
}

/// The commands of `run` and `drive` are read as they read them; what they say happens or is refused.
Acts acts() {
  Acts all;
  add_events(all, *bench().server, 1, [](const YAML::Node& event) {
    Mapping in("event", "", event);  // as read_event, which needs a model for the rest
    if (event["type"].Scalar() == "marker") read_marker(in);
    require(!to_text(event).empty(), "an event without words");
    return true;
  });
  add_pause(all, 1, {"the run", "row", [] { return left; }, [](auto moves) { left = moves; }});
  return all;
}

/// Files of live benches alone, and few: they are removed so that the disk stays as it is.
void check_files() {
  for (const auto& entry : std::filesystem::directory_iterator(bench().folder)) {
    const std::string name = entry.path().filename().string();
    // A dot while it is written; two for telemetry.h5 inside a file that is being written.
    require(name.substr(name.find_first_not_of('.')).starts_with("live-"), "a file with a name that a page chose");
    if (!name.starts_with(".")) std::filesystem::remove(entry.path()), ++files;
  }
}

std::string upgrade_of(const std::string& more) {
  return fmt::format(
      "GET /live HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: "
      "13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: tribotwin.live.v1\r\n{}\r\n",
      bench().port, more);
}

/// A request of a stranger; of these bytes not one is the token.
void check_request(std::string_view bytes) {
  const std::string answer = answer_to(bytes);
  const std::string_view status = std::string_view(answer).substr(0, 12);
  require(answer.empty() || status == "HTTP/1.1 400" || status == "HTTP/1.1 403", "a stranger was let in");
  require(answer.find("hello") == answer.npos, "a stranger was told something");
  refused += !answer.empty();
}

/// A viewer with the token, and these bytes once it is one: what comes before is not read as frames.
void check_viewer(std::string_view bytes) {
  Stranger viewer;
  viewer.send(upgrade_of("Cookie: tribotwin_" + std::to_string(bench().port) + "=" + bench().token + "\r\n"));
  const std::string head = viewer.hear("\r\n\r\n");
  require(head.starts_with("HTTP/1.1 101"), "a viewer was refused");
  ++inside;
  viewer.send(bytes);
  const std::string answer = viewer.rest();
  // An answer may be lost with the connection.
  answered += answer.find(R"("type":"done")") != answer.npos;
}

class HostileInput {
 public:
  explicit HostileInput(std::uint64_t seed) : random_(seed) {}

  /// The first byte says which kind the rest is.
  std::string next() {
    if (below(2)) return 'r' + mutated(request(), 8);
    std::string frames;
    for (auto n = 1 + below(4); n > 0; --n) frames += frame();
    return 'v' + (below(3) ? frames : mutated(frames, 4));
  }

 private:
  std::size_t below(std::size_t n) { return static_cast<std::size_t>(random_() % n); }
  template <std::size_t n>
  std::string one_of(const char* const (&choices)[n]) {
    return choices[below(n)];
  }

  std::string request() {
    if (below(3) == 0)
      return upgrade_of(below(2) ? "Cookie: a=b; tribotwin_1=" + std::string(below(99), '0') + "\r\n" : "");
    const std::string name = fmt::format("127.0.0.1:{}", bench().port);
    std::string text = one_of({"GET", "HEAD", "POST", "get", "CONNECT", "PRI", "\x16\x03\x01"}) + " " +
                       one_of({"/", "/live", "/app.js", "/../etc/passwd", "/?token=", "//", "*", "/%00", "http://a/"}) +
                       (below(4) ? "" : "?token=" + std::string(below(40), 'a')) + " " +
                       one_of({"HTTP/1.1", "HTTP/1.0", "HTTP/2", "HTTP/9.9", ""}) + "\r\n";
    text +=
        "Host: " + (below(4) ? name : one_of({"", "evil.example", "localhost", "[::1]", "127.0.0.1:99999"})) + "\r\n";
    for (auto n = below(4); n > 0; --n)
      text += one_of({"Origin: http://evil.example", "Origin: null", "Content-Length: 5", "Content-Length: -1",
                      "Content-Length: 99999999999999999999", "Transfer-Encoding: chunked", "Expect: 100-continue",
                      "Connection: keep-alive, Upgrade", "Upgrade: websocket, h2c", "Cookie: ;;;=;",
                      "Cookie: =", "Sec-WebSocket-Key: x", "Sec-WebSocket-Protocol: tribotwin.live.v1",
                      "Range: bytes=0-", "Host: twice", "X : y", " folded", "\x01\x02: \xff"}) +
              "\r\n";
    if (below(20) == 0) text += "X: " + std::string(below(20000), 'x') + "\r\n";
    return text + (below(5) ? "\r\n" : "") + (below(8) ? "" : std::string(below(3000), '\n'));
  }

  /// A WebSocket frame: most are well made around what is said, others lie about their size, bits or mask.
  std::string frame() {
    const int opcodes[] = {1, 1, 1, 1, 2, 0, 8, 9, 10, 3, 15};
    const int bits[] = {0x80, 0x80, 0x80, 0x80, 0x00, 0xC0, 0xF0};
    std::string said = saying();
    std::string head{static_cast<char>(bits[below(std::size(bits))] | opcodes[below(std::size(opcodes))])};
    const bool lies = below(6) == 0;
    const std::uint64_t size = lies ? (below(2) ? random_() : below(1 << 20)) : said.size();
    const int mask = below(16) ? 0x80 : 0;
    const int kind = lies && below(2) ? 127 : size < 126 ? static_cast<int>(size) : size < 65536 ? 126 : 127;
    head += static_cast<char>(mask | kind);
    for (int byte = kind == 127 ? 8 : kind == 126 ? 2 : 0; byte-- > 0;) head += static_cast<char>(size >> (8 * byte));
    std::string key(mask ? 4 : 0, '\0');
    for (char& byte : key) byte = static_cast<char>(random_());
    if (mask)
      for (std::size_t i = 0; i < said.size(); ++i) said[i] = static_cast<char>(said[i] ^ key[i % 4]);
    return head + key + said;
  }

  std::string saying() {
    switch (below(8)) {
      case 0:
        return std::string(below(5000), "[{\"0"[below(4)]);
      case 1: {
        std::string deep;
        for (auto n = below(700); n > 0; --n) deep += "{\"a\":";
        return deep;
      }
      case 2: {
        std::string noise(below(200), '\0');
        for (char& byte : noise) byte = static_cast<char>(random_());
        return noise;
      }
      case 3:
        return mutated(command(), 5);
      case 4:
        return R"({"type":"watch","joint":)" + value() + "}";
      default:
        return command();
    }
  }
  std::string command() {
    const std::string begin = R"({"type":)" + (below(6) ? R"("command")" : value()) + R"(,"id":)" + value();
    const std::string name = one_of({"marker", "pause", "resume", "step", "wear", "record", "export", "fly"});
    std::string keys;
    for (const char* key : {"text", "cycles", "joint", "parameter", "factor", "on", "minutes", "format", "messages"})
      if (below(20) == 0 || belongs(key, name))
        if (below(9)) keys += fmt::format(R"(,"{}":{})", key, below(3) ? fitting(key) : value());
    return begin + R"(,"do":)" + (below(9) ? '"' + name + '"' : value()) + keys + "}";
  }
  static bool belongs(std::string_view key, std::string_view name) {
    static const std::pair<const char*, const char*> all[] = {
        {"text", "marker"}, {"cycles", "step"}, {"joint", "wear"},     {"parameter", "wear"},
        {"factor", "wear"}, {"on", "record"},   {"minutes", "export"}, {"format", "export"}};
    return std::ranges::any_of(all, [&](const auto& row) { return row.first == key && row.second == name; });
  }
  std::string fitting(std::string_view key) {
    if (key == "on") return one_of({"true", "false"});
    if (key == "format") return one_of({"\"h5\"", "\"mcap\""});
    if (key == "messages") return one_of({"\"ros2\"", "\"json\""});
    if (key == "text" || key == "joint" || key == "parameter") return one_of({"\"joint1\"", "\"../../x\"", "\"a\""});
    return one_of({"1", "5", "0.5", "1e9"});
  }
  std::string value() {
    return one_of({"1",
                   "-1",
                   "1e999",
                   "null",
                   "true",
                   "[]",
                   "{}",
                   "\"\"",
                   "\"marker\"",
                   "\"pause\"",
                   "\"joint1\"",
                   "\"\\u0000\"",
                   "\"\\ud800\"",
                   "\"\xff\xfe\"",
                   "\"\xc0\x80\"",
                   "99999999999999999999999999",
                   "-0",
                   "0.1",
                   "NaN",
                   "\"<script>\"",
                   "[[[[[[[[1]]]]]]]]",
                   "{\"id\":{\"id\":1}}",
                   "9223372036854775807"});
  }

  std::string mutated(std::string text, std::size_t most) {
    for (auto n = below(most); n > 0 && !text.empty(); --n) {
      const std::size_t at = below(text.size());
      switch (below(5)) {
        case 0:
          text[at] = static_cast<char>(random_());
          break;
        case 1:
          text.erase(at, below(40));
          break;
        case 2:
          text.insert(at, std::string(below(300), static_cast<char>(random_())));
          break;
        case 3:
          text.resize(at);
          break;
        default:
          text.insert(at, text.substr(below(text.size()), below(100)));
      }
    }
    return text;
  }

  std::mt19937_64 random_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  bench().server->rows().push([](std::span<double> row) { std::ranges::fill(row, 0.5); });
  if (data[0] == 'r')
    check_request(bytes);
  else
    check_viewer(bytes);
  obey(*bench().server, 1, acts());
  static long inputs = 0;
  if (++inputs % 64 == 0) check_files();
  return 0;
}

/// Weak, so that libFuzzer's own main wins where it is linked.
[[gnu::weak]] int main(int argc, char** argv) {
  const long count = argc > 1 ? std::strtol(argv[1], nullptr, 10) : 10'000;
  const std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  HostileInput input(seed);
  for (long i = 0; i < count; ++i) {
    const std::string bytes = input.next();
    LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  }
  const std::string page =
      answer_to(fmt::format("GET /?token={} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", bench().token, bench().port));
  require(page.starts_with("HTTP/1.1 200"), "the bench serves no more");
  check_files();
  std::printf("%ld inputs with seed %llu: %ld strangers refused, %ld viewers, %ld answered, %ld files\n", count,
              static_cast<unsigned long long>(seed), refused, inside, answered, files);
  return count < 10'000 || (inside > 0 && answered > 0 && refused > 0 && files > 0) ? 0 : 1;
}
