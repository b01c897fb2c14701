// Samples with their times, and numbers in frames.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/shadow/bus_clock.hpp>
#include <tribotwin/hil/shadow/signal.hpp>

namespace tribotwin::hil {
namespace {

std::vector<double> times(const Channel& c) {
  std::vector<double> all;
  for (const Sample& s : c.samples()) all.push_back(s.time_s);
  return all;
}

void sync(Channel& c, std::int64_t cycle, double value, int every = 1) {
  c.add({1.0 * static_cast<double>(cycle), cycle, static_cast<double>(cycle) - 1}, value, Sending::with_sync, every);
}

TEST(Channel, CountsCyclesWithoutASample) {
  Channel c;
  for (const std::int64_t cycle : {0, 1, 4, 5}) sync(c, cycle, 0);
  EXPECT_EQ(c.lost(), 2U);
  EXPECT_EQ(c.heard(), 4U);
  Channel every_third;
  for (const std::int64_t cycle : {0, 3, 9}) sync(every_third, cycle, 0, 3);
  EXPECT_EQ(every_third.lost(), 1U);
}

// Of two in one cycle the first is the late one of the cycle before.
TEST(Channel, TakesALateFrameToItsOwnCycle) {
  Channel c;
  sync(c, 0, 10);
  sync(c, 2, 11);
  EXPECT_EQ(c.lost(), 1U);
  sync(c, 2, 12);
  EXPECT_EQ(c.lost(), 0U);
  EXPECT_THAT(times(c), testing::ElementsAre(0, 1, 2));
  sync(c, 2, 13);  // a repeated frame
  EXPECT_THAT(times(c), testing::ElementsAre(0, 1, 2));
  EXPECT_EQ(c.samples().back().value, 13);
}

TEST(Channel, HoldsOnlyWhatIsSentOnChange) {
  Channel on_change, periodic;
  on_change.add({1}, 7, Sending::on_change, 1);
  periodic.add({1}, 7, Sending::periodic, 1);
  for (Channel* c : {&on_change, &periodic}) c->hold(1.2, 0.5), c->hold(1.4, 0.5), c->hold(1.6, 0.5);
  EXPECT_THAT(times(on_change), testing::ElementsAre(1, 1.2, 1.4));
  EXPECT_THAT(times(periodic), testing::ElementsAre(1));
}

TEST(Channel, CountsLossesOfAPeriod) {
  Channel c;
  double t = 0;
  for (int k = 0; k < 200; ++k) t += k >= 100 && k % 10 == 0 ? 0.006 : 0.002, c.add({t}, 0, Sending::periodic, 1);
  EXPECT_EQ(c.lost(), 20U);
  c.add({t + 0.008}, 0, Sending::periodic, 1);  // a burst of late frames
  for (int k = 1; k < 4; ++k) c.add({t + 0.008 + 1e-5 * k}, 0, Sending::periodic, 1);
  EXPECT_EQ(c.lost(), 20U);
}

TEST(Channel, KeepsWhatAWindowNeeds) {
  Channel c;
  for (int k = 0; k < 200'000; ++k) c.add({1e-3 * k}, 0, Sending::periodic, 1);
  EXPECT_LE(c.samples().size(), 20'000U);
}

TEST(BusClock, FollowsStampsOrSyncs) {
  const auto at = [](std::int64_t ms) {
    Frame frame;
    frame.time_ns = 1'000'000 * ms;
    return frame;
  };
  BusClock stamps(std::nullopt), lockstep(0.002);
  for (BusClock* clock : {&stamps, &lockstep}) clock->hear(at(100), true), clock->hear(at(105), true);
  EXPECT_NEAR(stamps.now_s(), 0.005, 1e-12);
  EXPECT_NEAR(lockstep.now_s(), 0.002, 1e-12);
  stamps.hear(at(107), false);
  EXPECT_NEAR(stamps.stamp(Sending::with_sync).time_s, 0.005, 1e-12);
  EXPECT_NEAR(stamps.stamp(Sending::periodic).time_s, 0.007, 1e-12);
  stamps.hear(at(50), false);  // the clock was set back
  stamps.hear(at(51), false);
  EXPECT_NEAR(stamps.now_s(), 0.008, 1e-12);
}

TEST(Signal, ReadsBitsAsDbcFilesCountThem) {
  const auto frame = classic(0x123, std::vector<std::uint8_t>{0x12, 0x34, 0x56, 0x78, 0x9A, 0xBC, 0xDE, 0xF0});
  using Kind = Signal::Kind;
  struct Case {
    Signal signal;
    double value;
  };
  for (const Case& c :
       {Case{{.start = 0, .bits = 16}, 0x3412}, Case{{.start = 4, .bits = 8}, 0x41},
        Case{{.start = 7, .bits = 16, .big_endian = true}, 0x1234},
        Case{{.start = 3, .bits = 8, .big_endian = true}, 0x23},
        Case{{.start = 32, .bits = 8, .kind = Kind::is_signed}, 0x9A - 256},
        Case{{.start = 39, .bits = 16, .big_endian = true, .kind = Kind::is_signed}, 0x9ABC - 65536},
        Case{{.start = 0, .bits = 64, .kind = Kind::is_signed}, static_cast<double>(-0x0F21436587A9CBEELL)},
        Case{{.start = 0, .bits = 8, .factor = 0.5, .offset = -1}, 8},
        Case{{.start = 7, .bits = 1, .big_endian = true}, 0}, Case{{.start = 4, .bits = 1}, 1}})
    EXPECT_EQ(c.signal.value(frame), c.value);
  EXPECT_FALSE((Signal{.start = 57, .bits = 8}.value(frame)));
  EXPECT_FALSE((Signal{.start = 56, .bits = 16, .big_endian = true}.value(frame)));
  const auto floats = classic(1, std::vector<std::uint8_t>{0, 0, 0xC0, 0x3F, 0, 0, 0x80, 0x7F});  // 1.5, infinite
  EXPECT_EQ((Signal{.start = 0, .bits = 32, .kind = Kind::is_float}.value(floats)), 1.5);
  EXPECT_FALSE((Signal{.start = 32, .bits = 32, .kind = Kind::is_float}.value(floats)));
}

}  // namespace
}  // namespace tribotwin::hil
