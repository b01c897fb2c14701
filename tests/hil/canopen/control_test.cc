// EMCY inhibit time, SYNC with a counter, TIME and node guarding (CiA 301) of one node.
#include <functional>
#include <limits>
#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {
namespace {

using Bytes = std::vector<std::uint8_t>;

class Control : public testing::Test {
 protected:
  std::vector<Frame> bus;
  std::int64_t now = 1000 * ms;
  Feedback robot;
  Node node{{.node = 5, .name = "joint5", .gear_ratio = 100, .rated_torque_nm = 2, .speed_max_rad_s = 300},
            record_in(bus)};

  void SetUp() override {
    node.start(now);
    bus.clear();
  }
  void send(std::uint32_t id, const Bytes& bytes) { node.receive(classic(id, bytes), now); }
  void nmt(std::uint8_t command) { send(0, {command, 5}); }
  void wait(std::int64_t milliseconds) {
    for (std::int64_t i = 0; i < milliseconds; ++i) node.tick(now += ms), obey(node, robot);
  }
  std::uint32_t write(std::uint16_t index, std::uint8_t sub, Type type, std::int64_t value) {
    const std::size_t before = bus.size();
    send(0x605, download(index, sub, type, value));
    const Frame answer = bus.at(before);
    bus.erase(bus.begin() + static_cast<std::ptrdiff_t>(before), bus.end());
    return answer.data[0] == 0x80 ? static_cast<std::uint32_t>(decode(Type::u32, answer.bytes().subspan(4))) : 0;
  }
  std::int64_t read(std::uint16_t index, std::uint8_t sub) {
    send(0x605, {0x40, static_cast<std::uint8_t>(index), static_cast<std::uint8_t>(index >> 8), sub, 0, 0, 0, 0});
    const Frame answer = bus.back();
    bus.pop_back();
    return decode(Type::u32, answer.bytes().subspan(4));
  }
  std::vector<std::string> take(std::uint32_t id) {
    std::vector<std::string> texts;
    for (const Frame& f : std::exchange(bus, {}))
      if (f.id == id) texts.push_back(text(f));
    return texts;
  }
  void enable() {
    nmt(1);
    for (const std::uint8_t word : {0x06, 0x07, 0x0F}) send(0x205, {word, 0});
    ASSERT_EQ(node.state(), DriveState::operation_enabled);
    bus.clear();
  }
  void guard() {
    Frame request = classic(0x705, {});
    request.remote = true;
    request.size = 1;
    node.receive(request, now);
  }
  void sync(std::optional<std::uint8_t> counter) {
    send(0x080, counter ? Bytes{*counter} : Bytes{});
    node.sync(now);
  }
};

// ---- EMCY.

TEST_F(Control, EmcyKeepsItsDistance) {
  ASSERT_EQ(write(0x1015, 0, Type::u16, 500), 0U);  // 50 ms
  nmt(1);
  nmt(0x80);  // nothing to report: not powered
  bus.clear();
  node.fail(0x4310, temperature_error, false, now);
  node.recovered(now);
  send(0x205, {0x80, 0});
  EXPECT_THAT(take(0x085), testing::ElementsAre("085#1043090000000000"));
  EXPECT_EQ(node.next_ns(), now + 50 * ms);
  wait(49);
  EXPECT_THAT(take(0x085), testing::IsEmpty());
  wait(1);
  EXPECT_THAT(take(0x085), testing::ElementsAre("085#4081190000000000"));
  wait(100);
  EXPECT_THAT(take(0x085), testing::IsEmpty());
  EXPECT_EQ(node.dictionary().get(0x1003), 2);  // the history has no inhibit time
}

TEST_F(Control, EmcyWithoutInhibitTimeComesAtOnce) {
  node.fail(0x4310, temperature_error, false, now);
  node.recovered(now);
  EXPECT_THAT(take(0x085), testing::SizeIs(2));
}

TEST_F(Control, HeldBackEmcyEndWithAReset) {
  for (const std::uint8_t command : {0x82, 0x81, 0x02}) {
    write(0x1015, 0, Type::u16, 500);
    node.recovered(now);
    node.recovered(now);
    nmt(command);
    bus.clear();
    wait(200);
    EXPECT_THAT(take(0x085), testing::IsEmpty()) << int{command};
    nmt(1);
  }
}

TEST_F(Control, AFloodOfErrorsIsBounded) {
  write(0x1015, 0, Type::u16, 100);
  for (int i = 0; i < 1000; ++i) node.recovered(now);
  wait(1000);
  EXPECT_THAT(take(0x085), testing::SizeIs(1 + 8));
}

// ---- SYNC.

TEST_F(Control, CounterOverflowOfTheSync) {
  const struct {
    std::int64_t period, value;
    std::uint32_t code;
  } rows[] = {{2000, 0, 0},
              {2000, 10, 0x08000022},
              {0, 1, 0x06090030},
              {0, 241, 0x06090031},
              {0, 240, 0},
              {2000, 240, 0},
              {2000, 0, 0x08000022},
              {0, 2, 0},
              {0, 0, 0},
              {0, 10, 0}};
  for (const auto& row : rows) {
    ASSERT_EQ(write(0x1006, 0, Type::u32, row.period), 0U);
    EXPECT_EQ(write(0x1019, 0, Type::u8, row.value), row.code) << row.period << " " << row.value;
  }
  EXPECT_EQ(node.dictionary().get(0x1019), 10);
}

TEST_F(Control, ATpdoBeginsWithItsSync) {
  write(0x1006, 0, Type::u32, 0), write(0x1019, 0, Type::u8, 10), write(0x1006, 0, Type::u32, 2000);
  EXPECT_EQ(write(0x1802, 6, Type::u8, 4), 0x08000022U);  // the PDO exists
  write(0x1802, 1, Type::u32, 0xC0000385);
  EXPECT_EQ(write(0x1802, 6, Type::u8, 241), 0x06090031U);
  EXPECT_EQ(write(0x1802, 6, Type::u8, 4), 0U);
  write(0x1802, 2, Type::u8, 3);
  write(0x1802, 1, Type::u32, 0x40000385);
  for (int round = 0; round < 2; ++round) {
    nmt(1);
    bus.clear();
    std::vector<int> sent;
    for (int i = 0; i < 25; ++i) {
      sync(static_cast<std::uint8_t>(i % 10 + 1));
      if (!take(0x385).empty()) sent.push_back(i + 1);
    }
    EXPECT_THAT(sent, testing::ElementsAre(4, 7, 10, 13, 16, 19, 22, 25));
    nmt(0x80);
  }
}

TEST_F(Control, ASyncOfTheWrongLengthIsReportedOnceAndCounts) {
  enable();
  const auto received = [&] { return take(0x385).size(); };
  sync(std::nullopt);
  EXPECT_EQ(received(), 1U);
  sync(3);
  EXPECT_THAT(take(0x085), testing::ElementsAre("085#4082110000000000", "085#0000000000000000"));
  sync(4);
  EXPECT_EQ(received(), 1U);
  sync(5);
  EXPECT_THAT(take(0x085), testing::IsEmpty());
  sync(std::nullopt);
  sync(6);
  EXPECT_THAT(take(0x085), testing::SizeIs(2));
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
}

// ---- TIME.

TEST_F(Control, TakesTheTime) {
  EXPECT_EQ(read(0x2181, 1), 0);
  send(0x100, {0x18, 0x58, 0x26, 0xA5, 0x34, 0x3C});  // 23:59:59.000, the upper 4 bits mean nothing
  EXPECT_EQ(read(0x2181, 1), 0x5265818);
  EXPECT_EQ(read(0x2181, 2) & 0xffff, 0x3C34);
  wait(1500);
  EXPECT_EQ(read(0x2181, 1), 500);
  EXPECT_EQ(read(0x2181, 2) & 0xffff, 0x3C35);
  for (const Bytes& none : {Bytes{}, Bytes{1, 0, 0, 0, 0}, Bytes{1, 0, 0, 0, 0, 0, 0}}) send(0x100, none);
  EXPECT_EQ(read(0x2181, 1), 500);
}

TEST_F(Control, IdentifierOfTheTime) {
  const struct {
    std::uint32_t value, code;
  } rows[] = {{0xC0000100, 0x06090030}, {0x40000100, 0x06090030}, {0xA0000100, 0x06090030}, {0x80000680, 0x08000022},
              {0x00000100, 0},          {0x00000123, 0},          {0x80000123, 0x06090030}, {0x80000680, 0},
              {0x00000681, 0x08000022}, {0x00000680, 0},          {0x80000800, 0x06090030}};
  for (const auto& row : rows) EXPECT_EQ(write(0x1012, 0, Type::u32, row.value), row.code) << std::hex << row.value;
  send(0x680, {1, 0, 0, 0, 2, 0});
  EXPECT_EQ(read(0x2181, 1), 0);  // not taken
  write(0x1012, 0, Type::u32, 0x80000680);
  send(0x100, {9, 0, 0, 0, 2, 0});
  send(0x680, {1, 0, 0, 0, 2, 0});
  EXPECT_EQ(read(0x2181, 1), 1);
}

// ---- Node guarding.

TEST_F(Control, GuardedByItsMaster) {
  guard();
  EXPECT_THAT(take(0x705), testing::IsEmpty());  // it has a heartbeat
  write(0x1017, 0, Type::u16, 0);
  const std::function<void()> states[] = {[] {}, [] {}, [&] { nmt(1); }, [&] { nmt(2); }, [&] { nmt(0x80); }};
  std::vector<std::string> answers;
  for (const auto& change : states) {
    change();
    bus.clear();
    guard();
    answers.push_back(text(bus.at(0)));
  }
  EXPECT_THAT(answers, testing::ElementsAre("705#7F", "705#FF", "705#05", "705#84", "705#7F"));
  nmt(0x82);
  write(0x1017, 0, Type::u16, 0);
  bus.clear();
  guard();
  EXPECT_EQ(text(bus.at(0)), "705#7F");  // the toggle bit begins again
}

TEST_F(Control, AMasterThatNoLongerGuardsIsLost) {
  write(0x1017, 0, Type::u16, 0);
  write(0x100C, 0, Type::u16, 20), write(0x100D, 0, Type::u8, 3);
  write(0x2120, 1, Type::u16, 0);
  enable();
  wait(1000);  // watched from the first request on
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  for (int i = 0; i < 50; ++i) guard(), wait(20);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  guard();
  bus.clear();
  EXPECT_EQ(node.next_ns(), now + 60 * ms + 1);
  wait(60);
  EXPECT_THAT(take(0x085), testing::IsEmpty());
  wait(1);
  EXPECT_THAT(take(0x085), testing::ElementsAre("085#3081110000000000"));
  wait(2000);
  EXPECT_EQ(node.state(), DriveState::fault);
  EXPECT_EQ(node.nmt(), Nmt::pre_operational);  // 1029h
  EXPECT_EQ(node.counters().heartbeats_lost, 1U);
  EXPECT_THAT(take(0x085), testing::IsEmpty());
}

TEST_F(Control, NobodyIsWatchedWithoutGuardTimeOrFactorOrWithAHeartbeat) {
  const struct { std::int64_t heartbeat, time, factor; } rows[] = {{0, 0, 3}, {0, 20, 0}, {300, 20, 3}};
  for (const auto& row : rows) {
    nmt(0x81);
    write(0x100C, 0, Type::u16, row.time), write(0x100D, 0, Type::u8, row.factor);
    write(0x1017, 0, Type::u16, 0);
    write(0x2120, 1, Type::u16, 0);
    enable();
    guard();
    write(0x1017, 0, Type::u16, row.heartbeat);
    wait(5000);
    EXPECT_EQ(node.state(), DriveState::operation_enabled) << row.heartbeat << row.time << row.factor;
  }
}

TEST_F(Control, OtherRemoteFramesAreNotAnswered) {
  write(0x1017, 0, Type::u16, 0);
  for (std::uint32_t id = 0; id <= 0x7FF; ++id) {
    if (id == 0x705) continue;
    Frame request = classic(id, {});
    request.remote = true;
    node.receive(request, now);
  }
  EXPECT_TRUE(bus.empty());
}

// What is not the default after the next reset: all of it in the order that its rules ask for.
TEST_F(Control, IsKept) {
  KeptParameters memory;
  const NodeSetup setup{.keep = [&](const KeptParameters& p) { return memory = p, true; }};
  const DriveParameters parameters{.node = 5, .name = "joint5"};
  Node first(parameters, record_in(bus), setup);
  first.start(now);
  const std::tuple<std::uint16_t, std::uint8_t, Type, std::int64_t> values[] = {
      {0x1006, 0, Type::u32, 0},          {0x1019, 0, Type::u8, 10},     {0x1006, 0, Type::u32, 4000},
      {0x1012, 0, Type::u32, 0x100},      {0x1012, 0, Type::u32, 0x680}, {0x1012, 0, Type::u32, 0x80000680},
      {0x1802, 1, Type::u32, 0xC0000385}, {0x1802, 6, Type::u8, 2},      {0x1802, 1, Type::u32, 0x40000385},
      {0x1015, 0, Type::u16, 7},          {0x100C, 0, Type::u16, 8},     {0x1010, 1, Type::u32, 0x65766173}};
  for (const auto& [index, sub, type, value] : values) {
    bus.clear();
    first.receive(classic(0x605, download(index, sub, type, value)), now);
    ASSERT_EQ(bus.at(0).data[0], 0x60) << std::hex << index;
  }
  Node second(parameters, record_in(bus), {.kept = memory});
  EXPECT_FALSE(second.refused()) << second.refused()->text();
  for (const auto& [index, sub, value] : {std::tuple{0x1019, 0, 10LL},
                                          {0x1006, 0, 4000LL},
                                          {0x1012, 0, 0x80000680LL},
                                          {0x1802, 6, 2LL},
                                          {0x1802, 1, 0x40000385LL},
                                          {0x1015, 0, 7LL}})
    EXPECT_EQ(second.dictionary().get(static_cast<std::uint16_t>(index), static_cast<std::uint8_t>(sub)), value);
}

}  // namespace
}  // namespace tribotwin::hil
