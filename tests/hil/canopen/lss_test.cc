// Node numbers from a master (CiA 305): drives on one bus, found by their identity.
#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint32_t product = 0x7477, revision = 0x10000;

class Lss : public testing::Test {
 protected:
  std::vector<Frame> bus;
  std::vector<std::unique_ptr<Node>> nodes;
  std::int64_t now = 0;

  void drives(std::initializer_list<std::uint8_t> serial_numbers, bool unconfigured) {
    for (const std::uint8_t serial : serial_numbers) {
      DriveParameters p{.node = serial, .name = "joint"};
      nodes.push_back(std::make_unique<Node>(p, record_in(bus), NodeSetup{.unconfigured = unconfigured}));
      nodes.back()->start(now);
    }
  }
  void send(std::uint32_t id, const Bytes& bytes) {
    for (const auto& node : nodes) node->receive(classic(id, bytes), now);
  }
  /// What the drives answer to an LSS command.
  std::vector<std::string> ask(Bytes request) {
    request.resize(8);
    bus.clear();
    send(0x7E5, request);
    std::vector<std::string> answers;
    for (const Frame& f : bus) answers.push_back(text(f));
    return answers;
  }
  std::vector<std::string> ask(std::uint8_t command, std::uint32_t value) {
    Bytes request(8);
    request[0] = command;
    encode(value, std::span(request).subspan(1, 4));
    return ask(request);
  }
  std::vector<std::string> select(std::uint32_t serial) {
    ask({0x04, 0});
    EXPECT_THAT(ask(0x40, 0), testing::IsEmpty());
    EXPECT_THAT(ask(0x41, product), testing::IsEmpty());
    EXPECT_THAT(ask(0x42, revision), testing::IsEmpty());
    return ask(0x43, serial);
  }
  bool scan(std::uint32_t id, int bit, int part, int next) {
    Bytes request{0x51,
                  0,
                  0,
                  0,
                  0,
                  static_cast<std::uint8_t>(bit),
                  static_cast<std::uint8_t>(part),
                  static_cast<std::uint8_t>(next)};
    encode(id, std::span(request).subspan(1, 4));
    const auto answers = ask(request);
    for (const auto& a : answers) EXPECT_EQ(a, "7E4#4F00000000000000");
    return !answers.empty();
  }
  /// The identity of one drive that has no number, as python-canopen finds it; that drive is selected then.
  std::optional<std::array<std::uint32_t, 4>> fastscan() {
    std::array<std::uint32_t, 4> id{};
    if (!scan(0, 128, 0, 0)) return std::nullopt;
    for (int part = 0; part < 4; ++part) {
      auto& bits = id[static_cast<std::size_t>(part)];
      for (int bit = 31; bit >= 0; --bit)
        if (!scan(bits, bit, part, part)) bits |= 1U << bit;
      if (!scan(bits, 0, part, (part + 1) % 4)) return std::nullopt;
    }
    return id;
  }
};

TEST_F(Lss, UnconfiguredDrivesAreSilent) {
  drives({1, 2}, true);
  EXPECT_TRUE(bus.empty());
  send(0, {0x01, 0});
  send(0, {0x81, 0});
  for (const std::uint8_t id : {1, 2, 0x7F}) send(0x600U + id, {0x40, 0, 0x10, 0, 0, 0, 0, 0});
  for (const auto& node : nodes) {
    node->sync(now);
    node->tick(now += 10'000 * ms);
    node->recovered(now);
    node->fail(0x4310, temperature_error, true, now);
    EXPECT_EQ(node->id(), 0xFF);
    EXPECT_FALSE(node->sends(0x581));
    EXPECT_FALSE(node->sends(0x67F));
    EXPECT_EQ(node->next_ns(), std::numeric_limits<std::int64_t>::max());
    EXPECT_TRUE(node->brake_engaged());
  }
  EXPECT_TRUE(bus.empty());
}

TEST_F(Lss, FastscanFindsOneDriveAfterTheOther) {
  drives({9, 1, 127, 64, 2, 3}, true);
  std::vector<std::uint32_t> found;
  std::uint8_t number = 20;
  while (const auto id = fastscan()) {
    EXPECT_EQ((std::array{(*id)[0], (*id)[1], (*id)[2]}), (std::array<std::uint32_t, 3>{0, product, revision}));
    found.push_back((*id)[3]);
    EXPECT_THAT(ask({0x11, number}), testing::ElementsAre("7E4#1100000000000000"));
    EXPECT_THAT(ask({0x5E}), testing::ElementsAre("7E4#5EFF000000000000"));
    bus.clear();
    EXPECT_THAT(ask({0x04, 0}), testing::ElementsAre(text(classic(0x700U + number, Bytes{0}))));  // it boots
    ++number;
    ASSERT_LE(found.size(), 6U);
  }
  EXPECT_THAT(found, testing::UnorderedElementsAre(9, 1, 127, 64, 2, 3));
  // Their services have the new numbers, also after a reset of the communication.
  send(0, {0x82, 0});
  for (const auto& node : nodes) {
    const std::uint8_t id = node->id();
    EXPECT_TRUE(id >= 20 && id < 26);
    EXPECT_EQ(node->dictionary().get(0x1014), 0x80 + id);
    EXPECT_EQ(node->dictionary().get(0x1200, 1), 0x600 + id);
    EXPECT_EQ(node->dictionary().get(0x1402, 1), 0x400 + id);
    bus.clear();
    send(0x600U + id, {0x40, 0x18, 0x10, 4, 0, 0, 0, 0});
    ASSERT_EQ(bus.size(), 1U);
    EXPECT_EQ(bus[0].id, 0x580U + id);
    EXPECT_NE(bus[0].data[4], id);  // the serial number stays
  }
}

TEST_F(Lss, FastscanIsForDrivesWithoutNumber) {
  drives({1}, false);
  EXPECT_FALSE(scan(0, 128, 0, 0));
  EXPECT_THAT(ask({0x4C}), testing::IsEmpty());
  drives({2}, true);
  EXPECT_TRUE(scan(0, 128, 0, 0));
  EXPECT_THAT(ask({0x4C}), testing::ElementsAre("7E4#5000000000000000"));
  ask({0x04, 1});
  EXPECT_THAT(ask({0x11, 7}), testing::SizeIs(2));  // both
  EXPECT_FALSE(scan(0, 128, 0, 0));                 // a number is pending
  EXPECT_THAT(ask({0x4C}), testing::IsEmpty());
}

TEST_F(Lss, FastscanRefusesWhatItDoesNotKnow) {
  drives({5}, true);
  ASSERT_TRUE(scan(0, 128, 0, 0));
  EXPECT_FALSE(scan(0, 32, 0, 0));
  EXPECT_FALSE(scan(0, 127, 0, 0));
  EXPECT_FALSE(scan(0, 31, 4, 0));
  EXPECT_FALSE(scan(0, 31, 0, 4));
  EXPECT_FALSE(scan(product, 0, 1, 1));      // not its turn
  EXPECT_FALSE(scan(0x80000000, 31, 0, 0));  // not its vendor
  EXPECT_TRUE(scan(0x7FFFFFFF, 31, 0, 1));   // lower bits are not looked at
  EXPECT_TRUE(scan(product, 0, 1, 2));
  EXPECT_FALSE(scan(product, 0, 1, 2));
  EXPECT_TRUE(scan(0, 128, 0, 0));  // from the start
}

TEST_F(Lss, SelectsByTheWholeIdentity) {
  drives({1, 2, 3}, false);
  EXPECT_THAT(select(2), testing::ElementsAre("7E4#4400000000000000"));
  EXPECT_THAT(ask({0x5A}), testing::ElementsAre("7E4#5A00000000000000"));
  EXPECT_THAT(ask({0x5B}), testing::ElementsAre("7E4#5B77740000000000"));
  EXPECT_THAT(ask({0x5C}), testing::ElementsAre("7E4#5C00000100000000"));
  EXPECT_THAT(ask({0x5D}), testing::ElementsAre("7E4#5D02000000000000"));
  EXPECT_THAT(ask({0x5E}), testing::ElementsAre("7E4#5E02000000000000"));
  EXPECT_THAT(select(4), testing::IsEmpty());
  EXPECT_THAT(ask({0x5E}), testing::IsEmpty());  // nobody is in configuration
  // Out of turn.
  ask(0x40, 0);
  ask(0x42, revision);
  ask(0x41, product);
  EXPECT_THAT(ask(0x43, 2), testing::IsEmpty());
  EXPECT_THAT(ask(0x43, 2), testing::IsEmpty());
  struct Row {
    std::uint32_t vendor, product, revision, serial;
  };
  for (const Row& r : {Row{1, product, revision, 2}, {0, 1, revision, 2}, {0, product, 1, 2}}) {
    ask(0x40, r.vendor), ask(0x41, r.product), ask(0x42, r.revision);
    EXPECT_THAT(ask(0x43, r.serial), testing::IsEmpty());
  }
}

TEST_F(Lss, IdentifiesDrivesInARange) {
  drives({1, 2, 3, 4}, false);
  const auto identify = [&](std::uint32_t from_revision, std::uint32_t to_revision, std::uint32_t from,
                            std::uint32_t to) {
    ask(0x46, 0), ask(0x47, product), ask(0x48, from_revision), ask(0x49, to_revision), ask(0x4A, from);
    return ask(0x4B, to).size();
  };
  EXPECT_EQ(identify(0, 0xFFFFFFFF, 0, 0xFFFFFFFF), 4U);
  EXPECT_EQ(identify(revision, revision, 2, 3), 2U);
  EXPECT_EQ(identify(revision, revision, 4, 4), 1U);
  EXPECT_EQ(identify(revision + 1, 0xFFFFFFFF, 0, 0xFFFFFFFF), 0U);
  EXPECT_EQ(identify(0, revision - 1, 0, 0xFFFFFFFF), 0U);
  EXPECT_EQ(identify(0, revision, 5, 0xFFFFFFFF), 0U);
  EXPECT_EQ(identify(0, revision, 3, 2), 0U);
  EXPECT_TRUE(ask(0x4B, 9).empty());  // the range is used up
}

TEST_F(Lss, ConfiguresOneDrive) {
  drives({1, 2}, false);
  select(2);
  struct Row {
    Bytes request;
    std::string answer;
  } rows[] = {{{0x11, 0}, "7E4#1101000000000000"},    {{0x11, 128}, "7E4#1101000000000000"},
              {{0x11, 254}, "7E4#1101000000000000"},  {{0x11, 127}, "7E4#1100000000000000"},
              {{0x13, 0, 0}, "7E4#1301000000000000"}, {{0x13, 0, 9}, "7E4#1301000000000000"},
              {{0x13, 1, 0}, "7E4#1301000000000000"}, {{0x17}, "7E4#1701000000000000"}};
  for (const Row& row : rows) EXPECT_THAT(ask(row.request), testing::ElementsAre(row.answer));
  EXPECT_THAT(ask({0x15, 10, 0}), testing::IsEmpty());
  EXPECT_THAT(ask({0x77}), testing::IsEmpty());
  EXPECT_THAT(ask({0x5E}), testing::ElementsAre("7E4#5E02000000000000"));  // until the next reset
  EXPECT_THAT(ask({0x04, 0}), testing::IsEmpty());                         // it has a number: no boot
  EXPECT_EQ(nodes[1]->id(), 2);
  send(0, {0x82, 2});
  EXPECT_EQ(nodes[1]->id(), 127);
  EXPECT_EQ(text(bus.back()), "77F#00");
  EXPECT_EQ(nodes[0]->id(), 1);
  send(0, {0x81, 127});  // nothing was kept
  EXPECT_EQ(nodes[1]->id(), 2);
  EXPECT_EQ(text(bus.back()), "702#00");
}

TEST_F(Lss, ANumberCanBeTakenAway) {
  drives({1}, false);
  ask({0x04, 1});
  EXPECT_THAT(ask({0x11, 255}), testing::ElementsAre("7E4#1100000000000000"));
  send(0, {0x01, 1});  // what it does goes on until then
  EXPECT_EQ(nodes[0]->nmt(), Nmt::operational);
  bus.clear();
  send(0, {0x82, 1});
  EXPECT_TRUE(bus.empty());
  EXPECT_EQ(nodes[0]->id(), 0xFF);
  EXPECT_EQ(fastscan()->at(3), 1U);
}

TEST_F(Lss, FramesThatAreNone) {
  drives({1}, true);
  for (const Frame& f : {classic(0x7E5, Bytes{0x4C}), classic(0x7E5, Bytes(7, 0x4C)), classic(0x7E5, Bytes(8, 0)),
                         classic(0x7E5, Bytes(8, 0xFF)), classic(0x7E4, Bytes{0x4C, 0, 0, 0, 0, 0, 0, 0})})
    nodes[0]->receive(f, now);
  Frame extended = classic(0x7E5, Bytes{0x4C, 0, 0, 0, 0, 0, 0, 0});
  extended.extended = true;
  nodes[0]->receive(extended, now);
  EXPECT_TRUE(bus.empty());
  EXPECT_THAT(ask({0x04, 2}), testing::IsEmpty());
  EXPECT_THAT(ask({0x5E}), testing::IsEmpty());
  EXPECT_THAT(ask({0x4C}), testing::SizeIs(1));
}

}  // namespace
}  // namespace tribotwin::hil
