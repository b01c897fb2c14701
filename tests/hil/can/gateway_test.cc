// A bus of another machine's socketcand: our client against our server in another thread, and against gateways that
// refuse, talk nonsense or vanish.
#include <atomic>
#include <chrono>
#include <thread>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/transport.hpp>

namespace tribotwin::hil {
namespace {

using testing::HasSubstr;

constexpr std::int64_t ms = 1'000'000, patience_ns = 20'000 * ms;

/// Runs `bus` in a thread: answers each frame with the next identifier.
class Echo {
 public:
  explicit Echo(int port) {
    auto opened = open_socketcand("127.0.0.1", port, "can0", {});
    if (!opened) throw std::runtime_error(opened.error().message);
    bus_ = std::move(*opened);
    const std::string state = bus_->state();
    port_ = std::stoi(state.substr(state.find("127.0.0.1:") + 10));
    thread_ = std::jthread([this](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        bus_->wait(clock_ns() + 5 * ms);
        for (Frame frame; bus_->receive(frame);) {
          ++frame.id;
          bus_->send(frame);
        }
      }
    });
  }
  int port() const { return port_; }

 private:
  std::unique_ptr<Transport> bus_;
  int port_ = 0;
  std::jthread thread_;
};

std::unique_ptr<Transport> connected(int port, const OpenOptions& options = {}) {
  auto bus = open_bus(fmt::format("gateway://127.0.0.1:{}/can0", port), options);
  if (!bus) throw std::runtime_error(bus.error().message);
  std::this_thread::sleep_for(std::chrono::milliseconds(80));  // our server keeps the first frames back
  return std::move(*bus);
}

/// The next frame; an error frame if none comes.
Frame next(Transport& bus) {
  Frame frame;
  for (const auto end = clock_ns() + patience_ns; clock_ns() < end; bus.wait(end))
    if (bus.receive(frame)) return frame;
  frame = {};
  frame.error = true;
  return frame;
}

template <class Condition>
bool until(Transport& bus, Condition condition) {
  Frame frame;
  for (const auto end = clock_ns() + patience_ns; clock_ns() < end;) {
    if (condition()) return true;
    bus.wait(clock_ns() + 5 * ms);
    while (bus.receive(frame)) {
    }
  }
  return condition();
}

TEST(Gateway, CarriesClassicFramesBothWays) {
  const Echo gateway(0);
  const auto bus = connected(gateway.port());
  EXPECT_TRUE(bus->up());
  EXPECT_EQ(bus->state(), fmt::format("bus can0 of the gateway 127.0.0.1:{}", gateway.port()));
  const std::uint8_t bytes[] = {0, 1, 0xFF, 3, 4, 5, 6, 7};
  for (Frame frame :
       {classic(0, {}), classic(0x7FE, bytes), classic(0x123, std::span(bytes).first(3)),
        Frame{.id = 0x7FF, .extended = true, .size = 2, .data = {8, 9}}, Frame{.id = 0x1FFFFFFE, .extended = true}}) {
    ASSERT_EQ(bus->send(frame), Sent::done) << text(frame);
    const Frame answer = next(*bus);
    ++frame.id;
    EXPECT_EQ(text(answer), text(frame));
    EXPECT_NEAR(1e-9 * static_cast<double>(answer.time_ns), 1e-9 * static_cast<double>(clock_ns(CLOCK_REALTIME)), 20);
  }
  EXPECT_EQ(bus->counters().sent, 5);
  EXPECT_EQ(bus->counters().received, 5);
  EXPECT_EQ(bus->counters().malformed, 0);
}

TEST(Gateway, RefusesWhatSocketcandCannotCarry) {
  const Echo gateway(0);
  const auto bus = connected(gateway.port()), mute = connected(gateway.port(), {.listen_only = true});
  EXPECT_EQ(bus->send({.id = 1, .fd = true, .size = 8}), Sent::refused);
  EXPECT_EQ(bus->send({.id = 1, .remote = true}), Sent::refused);
  EXPECT_EQ(bus->send({.id = 0x800}), Sent::refused);
  EXPECT_EQ(bus->send({.id = 1, .size = 9}), Sent::refused);
  EXPECT_EQ(mute->send(classic(1, {})), Sent::refused);
  EXPECT_EQ(bus->counters().send_refused, 4);
}

TEST(Gateway, FiltersByIdentifier) {
  const Echo gateway(0);
  const auto bus = connected(gateway.port(), {.identifiers = {0x101}});
  for (const std::uint32_t id : {0xFFU, 0x100U}) bus->send(classic(id, {}));
  EXPECT_EQ(next(*bus).id, 0x101);
}

// A gateway that is restarted: the loss is counted, nothing is sent in between, and then frames come again.
TEST(Gateway, ConnectsAgain) {
  auto gateway = std::make_unique<Echo>(0);
  const int port = gateway->port();
  const auto bus = connected(port);
  gateway.reset();
  ASSERT_TRUE(until(*bus, [&] { return !bus->up(); }));
  EXPECT_EQ(bus->send(classic(1, {})), Sent::down);
  EXPECT_THAT(bus->state(), HasSubstr("is not connected: "));
  EXPECT_EQ(bus->counters().link_losses, 1);
  EXPECT_EQ(bus->counters().send_down, 1);
  gateway = std::make_unique<Echo>(port);
  ASSERT_TRUE(until(*bus, [&] { return bus->up(); }));
  std::this_thread::sleep_for(std::chrono::milliseconds(80));
  ASSERT_EQ(bus->send(classic(5, {})), Sent::done);
  EXPECT_EQ(next(*bus).id, 6);
  EXPECT_EQ(bus->counters().link_losses, 1);
}

/// A gateway that says `words` to whoever connects, a moment later `more`, and then closes.
class Speaker {
 public:
  explicit Speaker(std::string words, std::string more = {})
      : listener_(::socket(AF_INET, SOCK_STREAM, 0)), words_(std::move(words)), more_(std::move(more)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 || ::listen(listener_, 4) != 0 ||
        ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0)
      throw std::runtime_error("no listener");
    port_ = ntohs(address.sin_port);
    thread_ = std::jthread([this](const std::stop_token& stop) {
      for (pollfd polled{listener_, POLLIN, 0}; !stop.stop_requested();)
        if (::poll(&polled, 1, 5) == 1) speak();
    });
  }
  ~Speaker() {
    thread_.request_stop();
    thread_.join();
    ::close(listener_);
  }
  Speaker(const Speaker&) = delete;
  Speaker& operator=(const Speaker&) = delete;
  int port() const { return port_; }

 private:
  void speak() const {
    const int client = ::accept(listener_, nullptr, nullptr);
    for (const std::string* text : {&words_, &more_}) {
      if (text->empty()) continue;
      EXPECT_EQ(::send(client, text->data(), text->size(), MSG_NOSIGNAL), static_cast<ssize_t>(text->size()));
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
    }
    ::close(client);
  }
  int listener_, port_ = 0;
  std::string words_, more_;
  std::jthread thread_;
};

std::string failure(int port, const std::string& bus = "can0") {
  const auto opened = open_bus(fmt::format("gateway://127.0.0.1:{}/{}", port, bus));
  return opened ? "" : opened.error().message;
}

TEST(Gateway, OpeningSaysWhatIsWrong) {
  const Echo gateway(0);
  EXPECT_THAT(failure(gateway.port(), "can7"),
              HasSubstr("/can7: the gateway says: could not open bus, the one here is can0"));
  EXPECT_THAT(failure(Speaker("< error 16 clients are connected already >").port()),
              HasSubstr("the gateway says: 16 clients are connected already"));
  EXPECT_THAT(failure(Speaker("HTTP/1.1 400 Bad Request").port()), HasSubstr("the gateway has closed the connection"));
  EXPECT_THAT(failure(Speaker(std::string(300, 'x')).port()), HasSubstr("this is not the socketcand protocol"));
  EXPECT_THAT(failure(1), HasSubstr("gateway://127.0.0.1:1/can0: Connection refused"));
  EXPECT_THAT(failure(0), HasSubstr("the port must be 1..65535; socketcand's is 29536"));
  EXPECT_THAT(failure(70000), HasSubstr("the port must be 1..65535"));
  EXPECT_THAT(failure(29536, "can 0"), HasSubstr("must be one word"));
  EXPECT_THAT(open_bus("gateway://127.0.0.1/can0").error().message,
              HasSubstr("is not of the form gateway://HOST:29536/NAME"));
  EXPECT_THAT(open_bus("gateway://127.0.0.1:1/can0", {.fd = true}).error().message, HasSubstr("classic frames only"));
  EXPECT_THAT(open_bus("gateway://no such host:29536/can0").error().message, HasSubstr("unknown host"));
}

// What other servers say: bytes in several words, errors of the controller, frames that are none.
TEST(Gateway, ReadsFramesAsTheyAreWritten) {
  const Speaker gateway(
      "< hi >< ok >< ok >< frame 123 1700000000.000001 0102 03 >< frame 00000123 1.5 >< error 4 1.5 >"
      "< frame 12G 1.5 00 >< frame 123 1.5 0 >< frame 123 1.5 010203040506070809 >< frame 20000000 1.5 >< what >"
      "< frame 7FF 1700000000.999999 FF >");
  const auto bus = open_bus(fmt::format("gateway://127.0.0.1:{}/can0", gateway.port()));
  ASSERT_TRUE(bus) << bus.error().message;
  const Frame first = next(**bus);
  EXPECT_EQ(text(first), "123#010203");
  EXPECT_EQ(first.time_ns, 1'700'000'000'000'001'000);
  EXPECT_EQ(text(next(**bus)), "00000123#");
  const Frame last = next(**bus);
  EXPECT_EQ(text(last), "7FF#FF");
  EXPECT_EQ(last.time_ns, 1'700'000'000'999'999'000);
  EXPECT_EQ((*bus)->counters().error_frames, 1);
  EXPECT_EQ((*bus)->counters().malformed, 5);
}

TEST(Gateway, WhatItSaysDoesNotSteerATerminal) {
  const Speaker gateway("< hi >< ok >< ok >", "< error \x1b[31mred >");
  const auto bus = open_bus(fmt::format("gateway://127.0.0.1:{}/can0", gateway.port()));
  ASSERT_TRUE(bus) << bus.error().message;
  ASSERT_TRUE(until(**bus, [&] { return !(*bus)->up(); }));
  EXPECT_THAT((*bus)->state(), HasSubstr("the gateway says: \\x1b[31mred"));
}

}  // namespace
}  // namespace tribotwin::hil
