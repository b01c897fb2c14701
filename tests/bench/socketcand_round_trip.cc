// socketcand_round_trip PORT OUT IN_ID COUNT PAUSE_US: sends the frame OUT (ID or ID#BYTES, hex) to the socketcand
// server on this machine, waits for IN_ID, COUNT times. Prints median and 99 % in microseconds, answers per second, and
// how many did not come within 100 ms; in a second line when those were asked that came within 5 s, CLOCK_MONOTONIC in
// seconds.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

namespace {

using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

[[noreturn]] void fail(const char* what) {
  std::perror(what);
  std::exit(1);
}

int connect_to(int port) {
  const int server = ::socket(AF_INET, SOCK_STREAM, 0), on = 1;
  ::setsockopt(server, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (::connect(server, reinterpret_cast<const sockaddr*>(&address), sizeof address)) fail("connect");
  return server;
}

void say(int server, const std::string& text) {
  if (::send(server, text.data(), text.size(), 0) != static_cast<ssize_t>(text.size())) fail("send");
}

/// ID#0100 as socketcand's command.
std::string command_of(const std::string& frame) {
  const auto hash = std::min(frame.find('#'), frame.size());
  const std::string bytes = frame.substr(std::min(hash + 1, frame.size()));
  std::string command = "< send " + frame.substr(0, hash) + " " + std::to_string(bytes.size() / 2);
  for (std::size_t i = 0; i + 1 < bytes.size(); i += 2) command += " " + bytes.substr(i, 2);
  return command + " >";
}

/// Reads until `word` has come; false after `patience`.
bool hear(int server, std::string& heard, const std::string& word, std::chrono::milliseconds patience = 100ms) {
  const auto end = Clock::now() + patience;
  for (;;) {
    if (const auto at = heard.find(word); at != heard.npos) {
      heard.erase(0, at + word.size());
      return true;
    }
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now()).count();
    pollfd waits{server, POLLIN, 0};
    char more[4096];
    if (left <= 0 || ::poll(&waits, 1, static_cast<int>(left)) != 1) return false;
    const ssize_t n = ::recv(server, more, sizeof more, 0);
    if (n <= 0) fail("recv");
    heard.append(more, static_cast<std::size_t>(n));
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6) return std::fputs("usage: socketcand_round_trip PORT OUT IN_ID COUNT PAUSE_US\n", stderr), 2;
  const int server = connect_to(std::atoi(argv[1]));
  const std::string out = command_of(argv[2]), in = std::string("< frame ") + argv[3] + " ";
  const int count = std::atoi(argv[4]), pause_us = std::atoi(argv[5]);
  std::string heard;
  if (!hear(server, heard, "< hi >", 5s)) fail("no greeting");
  say(server, "< open can0 >");
  if (!hear(server, heard, "< ok >")) fail("not opened");
  say(server, "< rawmode >");
  if (!hear(server, heard, "< ok >")) fail("no raw mode");
  std::this_thread::sleep_for(100ms);  // the server keeps the first frames of a new client back

  std::vector<double> took_us, late_s;
  int missing = 0, never = 0;
  const auto begin = Clock::now();
  auto due = begin;
  for (int i = 0; i < count; ++i) {
    const auto sent = Clock::now();
    say(server, out);
    if (hear(server, heard, in)) {
      took_us.push_back(std::chrono::duration<double, std::micro>(Clock::now() - sent).count());
    } else {
      ++missing;
      // Else the next one would be answered by this one's answer.
      if (hear(server, heard, in, 5s)) {
        late_s.push_back(std::chrono::duration<double>(sent.time_since_epoch()).count());
        never = 0;
      } else if (++never == 5) {
        return std::fputs("five in a row were never answered\n", stderr), 1;
      }
    }
    due += std::chrono::microseconds(pause_us);
    if (pause_us > 0) std::this_thread::sleep_until(due);
  }
  const std::chrono::duration<double> all = Clock::now() - begin;
  std::ranges::sort(took_us);
  const auto quantile = [&](double q) {
    return took_us.empty() ? -1 : took_us[static_cast<std::size_t>(q * static_cast<double>(took_us.size()))];
  };
  std::printf("%.1f %.1f %.0f %d\n", quantile(0.5), quantile(0.99), static_cast<double>(took_us.size()) / all.count(),
              missing);
  for (const double at : late_s) std::printf("%.3f ", at);
  std::puts("");
  return ::close(server);
}
