// Run by tests/can_vm/run.sh, because these tests break the buses they use; without it only those that need no bus run.
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <thread>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <net/if.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <tribotwin/hil/can/transport.hpp>

namespace tribotwin::hil {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using namespace std::chrono_literals;

constexpr std::int64_t ms = 1'000'000, s = 1000 * ms;  // in ns
constexpr std::int64_t patience = 20 * s;              // for what must happen, but nobody knows when

std::int64_t now_ns(clockid_t clock = CLOCK_MONOTONIC) {
  timespec now;
  clock_gettime(clock, &now);
  return now.tv_sec * s + now.tv_nsec;
}

void shell(const std::string& command) { ASSERT_EQ(std::system(command.c_str()), 0) << command; }

std::unique_ptr<Transport> open(const OpenOptions& options = {}, const std::string& interface = "vcan0") {
  auto bus = open_socketcan(interface, options);
  if (!bus) throw std::runtime_error(bus.error().message);
  return std::move(*bus);
}

std::string failure(const std::string& interface, const OpenOptions& options = {}) {
  const auto bus = open_socketcan(interface, options);
  return bus ? "" : bus.error().message;
}

Frame numbered(std::uint32_t id, std::uint32_t number) {
  const std::uint8_t bytes[] = {std::uint8_t(number), std::uint8_t(number >> 8), std::uint8_t(number >> 16)};
  return classic(id, bytes);
}

/// The next frame; an error frame of class 0 if none comes.
Frame next(Transport& bus) {
  Frame frame;
  for (const auto end = now_ns() + patience; now_ns() < end; bus.wait(end))
    if (bus.receive(frame)) return frame;
  frame = {};
  frame.error = true;
  return frame;
}

void wait_until(Transport& bus, bool up) {
  for (const auto end = now_ns() + patience; bus.up() != up && now_ns() < end;) bus.wait(end);
  ASSERT_EQ(bus.up(), up) << bus.state();
}

void expect_silence(Transport& bus) {
  Frame frame;
  bus.wait(now_ns() + 50 * ms);
  EXPECT_FALSE(bus.receive(frame)) << text(frame);
}

class SocketCan : public testing::Test {
 protected:
  void SetUp() override {
    if (!std::getenv("CAN_VM")) GTEST_SKIP() << "breaks buses, so only by tests/can_vm/run.sh";
    shell("ip link del dev vcan0 2>/dev/null; ip link add dev vcan0 type vcan && ip link set dev vcan0 mtu 72 up");
  }
};

TEST_F(SocketCan, CarriesEveryKindOfFrame) {
  const auto a = open({.fd = true}), b = open({.fd = true});
  std::vector<Frame> frames(7);
  frames[1] = numbered(0x7FF, 0x123456);
  frames[2] = {.id = 0x7FF, .extended = true, .size = 8, .data = {1, 2, 3, 4, 5, 6, 7, 8}};
  frames[3] = {.id = 0x1FFFFFFF, .extended = true, .size = 1, .data = {9}};
  frames[4] = {.id = 0x123, .remote = true, .size = 8};
  frames[5] = {.id = 0x123, .fd = true, .size = 0};
  frames[6] = {.id = 0x456, .extended = true, .fd = true, .bit_rate_switch = true, .error_passive = true, .size = 64};
  for (std::size_t i = 0; i < 64; ++i) frames[6].data[i] = std::uint8_t(i);
  for (const auto& frame : frames) ASSERT_EQ(a->send(frame), Sent::done) << text(frame);
  for (const auto& frame : frames) EXPECT_EQ(text(next(*b)), text(frame));
  EXPECT_EQ(b->send(frames[6]), Sent::done);
  EXPECT_EQ(text(next(*a)), text(frames[6])) << "its own frames come back";
  EXPECT_EQ(a->counters().sent, 7);
  EXPECT_EQ(b->counters().received, 7);
  EXPECT_EQ(a->name(), "vcan0");
  EXPECT_EQ(a->state(), "interface vcan0 is up");
}

TEST_F(SocketCan, FdFramesNeedTheOption) {
  const auto fd = open({.fd = true}), plain = open();
  const Frame frame{.id = 1, .fd = true, .size = 12};
  EXPECT_EQ(fd->send(frame), Sent::done);
  EXPECT_EQ(fd->send(numbered(2, 0)), Sent::done);
  EXPECT_EQ(next(*plain).id, 2) << "an FD frame came to a classic socket";
}

TEST_F(SocketCan, RefusesWhatTheBusCannotCarry) {
  const auto fd = open({.fd = true}), plain = open(), mute = open({.listen_only = true});
  const auto peer = open({.fd = true});
  EXPECT_EQ(plain->send({.id = 1, .size = 9}), Sent::refused);
  EXPECT_EQ(plain->send({.id = 1, .fd = true, .size = 8}), Sent::refused);
  EXPECT_EQ(plain->send({.id = 0x800, .size = 1}), Sent::refused);
  EXPECT_EQ(plain->send({.id = 0x20000000, .extended = true, .size = 1}), Sent::refused);
  EXPECT_EQ(plain->send({.id = 0x40, .error = true, .size = 8}), Sent::refused);
  EXPECT_EQ(plain->counters().send_refused, 5);
  EXPECT_EQ(fd->send({.id = 1, .fd = true, .size = 9}), Sent::refused);
  EXPECT_EQ(fd->send({.id = 1, .remote = true, .fd = true}), Sent::refused);
  EXPECT_EQ(mute->send(numbered(1, 0)), Sent::refused);
  shell("ip link set dev vcan0 down && ip link set dev vcan0 mtu 16 up");
  wait_until(*fd, true);
  EXPECT_EQ(fd->send({.id = 1, .fd = true, .size = 8}), Sent::refused) << "bus without FD";
  EXPECT_EQ(fd->send(numbered(7, 0)), Sent::done);
  EXPECT_EQ(fd->counters().send_refused, 3);
  EXPECT_EQ(next(*peer), numbered(7, 0)) << "a refused frame went out";
}

TEST_F(SocketCan, FiltersByIdentifier) {
  const auto bus = open({.identifiers = {0x181, 0x7FF}}), peer = open();
  peer->send(numbered(0x180, 0));
  peer->send({.id = 0x181, .extended = true});
  peer->send({.id = 0x181, .remote = true});
  peer->send(numbered(0x181, 1));
  peer->send(numbered(0x7FF, 2));
  shell("cansend vcan0 20000040#0000000000000000");
  EXPECT_EQ(next(*bus), numbered(0x181, 1));
  EXPECT_EQ(next(*bus), numbered(0x7FF, 2));
  EXPECT_TRUE(next(*bus).error);
  expect_silence(*bus);
}

TEST_F(SocketCan, CountsErrorFrames) {
  const auto bus = open();
  shell("cansend vcan0 20000004#0010000000000000 && cansend vcan0 20000040#0000000000000000");  // controller problem,
                                                                                                // bus-off
  EXPECT_EQ(text(next(*bus)), "20000004#0010000000000000");
  const Frame bus_off = next(*bus);
  EXPECT_TRUE(bus_off.error);
  EXPECT_EQ(bus_off.id, 0x40);
  EXPECT_EQ(bus->counters().error_frames, 2);
  EXPECT_EQ(bus->counters().bus_off, 1);
  EXPECT_EQ(bus->counters().received, 0);
}

TEST_F(SocketCan, TimesAreOfTheKernelInRealTime) {
  const auto bus = open(), peer = open();
  auto earliest = now_ns(CLOCK_REALTIME);
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(peer->send(numbered(1, i)), Sent::done);
    const auto sent = now_ns(CLOCK_REALTIME);
    if (i == 0)
      std::this_thread::sleep_for(100ms);  // the kernel needs some time to start stamping: the first may be late
    const Frame frame = next(*bus);
    EXPECT_GE(frame.time_ns, earliest);
    EXPECT_LE(frame.time_ns, i == 0 ? now_ns(CLOCK_REALTIME) : sent) << "the time of reading, not that of the frame";
    earliest = frame.time_ns;
  }
}

TEST_F(SocketCan, WaitsForFramesDeadlinesAndSignals) {
  const auto bus = open(), peer = open();
  const auto start = now_ns();
  bus->wait(start + 30 * ms);
  EXPECT_GE(now_ns(), start + 30 * ms);
  bus->wait(start);
  bus->wait(INT64_MIN);
  peer->send(numbered(1, 0));
  bus->wait(INT64_MAX);
  Frame frame;
  EXPECT_TRUE(bus->receive(frame));
  EXPECT_FALSE(bus->receive(frame));

  struct sigaction nothing {
  }, before;
  nothing.sa_handler = [](int) {};
  sigaction(SIGALRM, &nothing, &before);
  const itimerval soon{.it_interval = {0, 50'000}, .it_value = {0, 50'000}}, never{};
  setitimer(ITIMER_REAL, &soon, nullptr);
  bus->wait(INT64_MAX);  // if the signal does not end it, nothing does
  setitimer(ITIMER_REAL, &never, nullptr);
  sigaction(SIGALRM, &before, nullptr);
}

TEST_F(SocketCan, LinkDownWakesAndUpRecovers) {
  const auto bus = open({.identifiers = {2}}), peer = open();
  std::thread breaker([] {
    std::this_thread::sleep_for(100ms);
    shell("ip link set dev vcan0 down");
  });
  while (bus->up()) bus->wait(INT64_MAX);
  breaker.join();
  EXPECT_EQ(bus->state(), "interface vcan0 is down");
  EXPECT_EQ(bus->counters().link_losses, 1);
  Frame frame;
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(bus->send(numbered(1, 100 + i)), Sent::down);
    EXPECT_FALSE(bus->receive(frame));
  }
  EXPECT_EQ(bus->counters().send_down, 3);
  const auto start = now_ns();
  while (now_ns() < start + 30 * ms)
    bus->wait(start + 30 * ms);  // must not spin on POLLERR, which only a profiler shows
  EXPECT_FALSE(bus->up());

  shell("ip link set dev vcan0 up");
  wait_until(*bus, true);
  EXPECT_EQ(bus->send(numbered(1, 1)), Sent::done);
  EXPECT_EQ(next(*peer), numbered(1, 1)) << "a frame of the time when the link was down";
  EXPECT_EQ(peer->send(numbered(2, 2)), Sent::done);
  EXPECT_EQ(next(*bus), numbered(2, 2));
  EXPECT_EQ(bus->counters().link_losses, 1);
  EXPECT_EQ(peer->counters().link_losses, 1);
  EXPECT_EQ(bus->counters().send_down, 3);
}

TEST_F(SocketCan, ALossThatNobodySawIsCountedAndCostsNoFrame) {
  const auto sender = open(), receiver = open(), waiter = open({.identifiers = {2}});
  ASSERT_EQ(sender->send(numbered(1, 0)), Sent::done);
  for (unsigned times = 1; times <= 3; ++times) {
    shell("ip link set dev vcan0 down && ip link set dev vcan0 up");
    EXPECT_EQ(sender->send(numbered(1, times)), Sent::done) << "the stale ENETDOWN";
    Frame frame;
    ASSERT_TRUE(receiver->receive(frame)) << "the stale ENETDOWN";
    EXPECT_EQ(frame, numbered(1, times - 1)) << "what came before a loss stays";
    waiter->wait(now_ns() + s);
    EXPECT_TRUE(waiter->up());
    for (const auto& bus : {&sender, &receiver, &waiter}) EXPECT_EQ((*bus)->counters().link_losses, times);
  }
  EXPECT_EQ(sender->counters().send_down, 0);
}

TEST_F(SocketCan, ReceivingAloneFollowsTheLink) {
  const auto bus = open();
  Frame frame;
  shell("ip link set dev vcan0 down");
  EXPECT_FALSE(bus->receive(frame));
  EXPECT_FALSE(bus->up());
  shell("ip link set dev vcan0 up");
  EXPECT_FALSE(bus->receive(frame));
  EXPECT_TRUE(bus->up());
}

TEST_F(SocketCan, TakesUpADeviceThatIsMadeAgain) {
  const auto bus = open({.identifiers = {2}}), other = open();
  const unsigned index = if_nametoindex("vcan0");
  shell("ip link del dev vcan0");
  wait_until(*bus, false);
  EXPECT_EQ(bus->state(), "interface vcan0 is gone");
  EXPECT_EQ(bus->send(numbered(1, 0)), Sent::down);
  EXPECT_EQ(other->send(numbered(1, 0)), Sent::down) << "it had no time to see the loss";
  EXPECT_EQ(other->counters().link_losses, 1);
  shell("ip link add dev vcan0 type vcan");
  bus->wait(now_ns() + s);
  EXPECT_EQ(bus->state(), "interface vcan0 is down");
  shell("ip link set dev vcan0 up");
  ASSERT_NE(if_nametoindex("vcan0"), index);
  wait_until(*bus, true);
  wait_until(*other, true);

  EXPECT_EQ(bus->send(numbered(1, 1)), Sent::done);
  EXPECT_EQ(next(*other), numbered(1, 1));
  EXPECT_EQ(other->send(numbered(3, 0)), Sent::done);  // filtered as before
  EXPECT_EQ(other->send(numbered(2, 2)), Sent::done);
  shell("cansend vcan0 20000040#0000000000000000");
  EXPECT_EQ(next(*bus), numbered(2, 2));
  EXPECT_TRUE(next(*bus).error);
  EXPECT_EQ(bus->counters().link_losses, 1);
}

TEST_F(SocketCan, TakesUpADeviceThatWasReplacedBehindItsBack) {
  const auto sender = open(), receiver = open(), peer = open({}, "vcan1");
  const unsigned index = if_nametoindex("vcan0");
  for (unsigned times = 1; times <= 2; ++times) {  // with a new index, with the old one
    shell(fmt::format("ip link del dev vcan0 && ip link add dev vcan0 {} type vcan && ip link set dev vcan0 up",
                      times == 1 ? "" : fmt::format("index {}", index)));
    Frame frame;
    EXPECT_FALSE(receiver->receive(frame));
    EXPECT_EQ(sender->send(numbered(1, times)), Sent::done);
    EXPECT_EQ(next(*receiver), numbered(1, times));
    EXPECT_EQ(sender->counters().link_losses, times);
  }
  expect_silence(*peer);  // an unbound CAN socket would be one on all buses
}

TEST_F(SocketCan, ABusWithoutCarrierIsNotUp) {
  shell(
      "ip link del dev vxcan0 2>/dev/null; ip link add dev vxcan0 type vxcan peer name vxcan1 && ip link set dev "
      "vxcan0 up && ip link set dev vxcan1 up");
  const auto bus = open({}, "vxcan0"), peer = open({}, "vxcan1");
  wait_until(*bus, true);
  shell("ip link set dev vxcan1 down");
  wait_until(*bus, false);
  EXPECT_THAT(bus->state(), HasSubstr("no carrier"));
  EXPECT_EQ(bus->send(numbered(1, 1)), Sent::down);
  shell("ip link set dev vxcan1 up");
  wait_until(*bus, true);
  EXPECT_EQ(bus->send(numbered(1, 2)), Sent::done);
  EXPECT_EQ(next(*peer), numbered(1, 2));
  EXPECT_EQ(bus->counters().link_losses, 1);
  shell("ip link del dev vxcan0");
}

TEST_F(SocketCan, AFullQueueIsBusyAndNeverBlocks) {
  const auto bus = open(), peer = open();
  shell("tc qdisc add dev vcan0 root tbf rate 8kbit burst 32 limit 160");  // 62.5 classic frames per second, 10 of them
                                                                           // queued
  unsigned sent = 0, busy = 0;
  const auto start = now_ns();
  for (int i = 0; i < 1000; ++i) {
    const Sent result = bus->send(numbered(1, i));
    ASSERT_THAT(result, testing::AnyOf(Sent::done, Sent::busy));
    (result == Sent::done ? sent : busy) += 1;
  }
  EXPECT_LT(now_ns() - start, 10 * s) << "16 s had it blocked";
  EXPECT_GT(sent, 5);
  EXPECT_GT(busy, 100);
  EXPECT_EQ(bus->counters().sent, sent);
  EXPECT_EQ(bus->counters().send_busy, busy);
  EXPECT_TRUE(bus->up());

  for (const auto end = now_ns() + patience; bus->send(numbered(2, 0)) != Sent::done && now_ns() < end;)
    bus->wait(now_ns() + ms);
  for (unsigned i = 0; i < sent; ++i) EXPECT_EQ(next(*peer).id, 1);
  EXPECT_EQ(next(*peer), numbered(2, 0)) << "no recovery, or a dropped frame came";
}

TEST_F(SocketCan, CountsEveryFrameLostInItsBuffer) {
  const auto bus = open(), peer = open(), witness = open();
  constexpr unsigned total = 30'000;
  for (unsigned i = 0; i < total; ++i) {
    ASSERT_EQ(peer->send(numbered(1, i)), Sent::done);
    // The kernel's queue before all sockets (netdev_max_backlog, 1000) loses frames that no socket is told of: keep it
    // empty, so that only the buffer of `bus` overflows.
    ASSERT_EQ(next(*witness), numbered(1, i));
  }
  Frame frame;
  unsigned received = 0;
  for (; bus->receive(frame); ++received) ASSERT_EQ(frame, numbered(1, received));
  ASSERT_LT(received, total);
  EXPECT_GT(received, 250);
  if (std::getenv("CAN_VM") == std::string("vm")) {  // as root
    EXPECT_GT(received, 5000) << "SO_RCVBUFFORCE";
  }
  peer->send(numbered(1, total));  // brings the count along
  EXPECT_EQ(next(*bus), numbered(1, total));
  EXPECT_EQ(bus->counters().receive_lost, total - received);
  peer->send(numbered(1, 0));
  next(*bus);
  EXPECT_EQ(bus->counters().receive_lost, total - received) << "counted twice";
}

TEST_F(SocketCan, OpeningSaysWhatIsWrongAndWhatWouldHelp) {
  shell("ip link set dev vcan1 down");
  EXPECT_EQ(failure("vcan7"), "no interface \"vcan7\"; CAN interfaces here: vcan1 (down), vcan0");
  EXPECT_EQ(failure(""), "no interface \"\"; CAN interfaces here: vcan1 (down), vcan0");
  EXPECT_THAT(failure("vcan0 and a name that is too long"), HasSubstr("no interface"));
  EXPECT_EQ(failure("lo"), "lo is no CAN interface; CAN interfaces here: vcan1 (down), vcan0");
  EXPECT_THAT(failure("vcan1"), AllOf(HasSubstr("interface vcan1 is down"), HasSubstr("ip link set vcan1 up")));
  shell("ip link set dev vcan1 up");
  EXPECT_EQ(failure("vcan1"), "");
  EXPECT_EQ(failure("vcan0", {.identifiers = {0x800}}), "vcan0: 800 is no 11-bit identifier");
  EXPECT_THAT(failure("vcan0", {.identifiers = std::vector<std::uint32_t>(513)}), HasSubstr("512 at most"));
  EXPECT_EQ(failure("vcan0", {.identifiers = std::vector<std::uint32_t>(512)}), "");
  shell("ip link del dev vcan0 && ip link del dev vcan1");
  EXPECT_THAT(failure("vcan0"), HasSubstr("there is no CAN interface here; `ip link add dev vcan0 type vcan"));
  shell("for bus in vcan0 vcan1; do ip link add dev $bus type vcan && ip link set dev $bus mtu 72 up || exit 1; done");
}

// The part of tests/hil/can/can_utils_test.sh that is ours: sends back what it receives.
TEST(CanUtils, Echo) {
  const char* const count = std::getenv("CAN_ECHO_COUNT");
  if (!count) GTEST_SKIP() << "run by tests/hil/can/can_utils_test.sh";
  const auto bus = open({.fd = true});
  ASSERT_EQ(bus->send(numbered(0x7FF, 0)), Sent::done);  // ready
  for (int i = 0; i < std::atoi(count); ++i) {
    const Frame frame = next(*bus);
    ASSERT_EQ(bus->send(frame), Sent::done) << text(frame);
  }
}

TEST(Opening, SaysThatTheKernelHasNoCan) {
  if (const int probe = socket(PF_CAN, SOCK_RAW, 1); probe >= 0 || errno != EAFNOSUPPORT) {
    if (probe >= 0) close(probe);
    GTEST_SKIP() << "it has";
  }
  EXPECT_EQ(failure("can0"),
            "can0: this kernel has no SocketCAN; try `modprobe can_raw`, or serve the bus over TCP as "
            "socketcand://127.0.0.1:29536/can0");
}

TEST(OpeningDeathTest, SaysThatPermissionIsMissing) {
  const auto forbidden = [] {
    sock_filter filter[] = {BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
                            BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, __NR_socket, 0, 1),
                            BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
                            BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)};
    const sock_fprog program{.len = 4, .filter = filter};
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0)
      std::_Exit(2);
    const std::string message = failure("can0");
    std::fputs(message.c_str(), stderr);
    std::_Exit(1);
  };
  EXPECT_EXIT(forbidden(), testing::ExitedWithCode(1), "can0: no permission to open CAN sockets");
}

}  // namespace
}  // namespace tribotwin::hil
