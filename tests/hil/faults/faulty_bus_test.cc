#include <chrono>
#include <cmath>
#include <thread>

#include <gtest/gtest.h>

#include <tribotwin/hil/faults/faulty_bus.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::hil {
namespace {

struct Bus {
  double time_s = 0;
  int asked = 0;
  std::unique_ptr<Transport> ours = open_bus("memory:faulty_bus").value(),
                             theirs = open_bus("memory:faulty_bus").value();
  FaultyBus bus{*ours, {}, 1, [this] { return ++asked, time_s; }};
  /// How many of these frames the other end gets.
  int passed(int frames, std::uint32_t id) {
    Frame frame;
    int count = 0;
    for (int i = 0; i < frames; ++i) bus.send(Frame{.id = id});
    while (theirs->receive(frame)) ++count;
    return count;
  }
};

constexpr Fault silent_node_3{.kind = FaultKind::silence, .to_s = 2, .node = 3};

TEST(FaultyBus, AnInjectedFaultBeginsNowAndEndsInTime) {
  Bus b;
  b.time_s = 100;
  EXPECT_EQ(b.passed(10, 0x183), 10);
  b.bus.inject(silent_node_3);
  EXPECT_EQ(b.passed(10, 0x183), 0);
  EXPECT_EQ(b.passed(10, 0x184), 10);
  b.time_s = 101.9;
  EXPECT_EQ(b.passed(10, 0x183), 0);
  b.time_s = 102.1;
  EXPECT_EQ(b.passed(10, 0x183), 10);
}

TEST(FaultyBus, TellsWhenAnInjectedFaultOfADriveBeginsAndEnds) {
  Bus b;
  b.bus.inject({.kind = FaultKind::over_temperature, .to_s = 1, .node = 5, .temperature_degC = 140});
  const DriveFault on{FaultKind::over_temperature, 4, true, 140}, off{FaultKind::over_temperature, 4, false, 0};
  EXPECT_EQ(b.bus.changed(1), std::vector{on});
  EXPECT_EQ(b.bus.changed(1), std::vector<DriveFault>{});
  b.time_s = 1.5;
  EXPECT_FALSE(b.bus.is_full());  // forgets those that are over, but for one whose end was not told yet
  EXPECT_EQ(b.bus.changed(1), std::vector{off});
}

TEST(FaultyBus, AFaultOfADriveThatIsShorterThanAStepIsToldAllTheSame) {
  Bus b;
  const Fault shorter{.kind = FaultKind::encoder_freeze, .from_s = 0.0011, .to_s = 0.0015, .node = 2};
  FaultyBus bus(*b.ours, {shorter, {.kind = FaultKind::silence, .to_s = 0.0005, .node = 3}}, 1,
                [&b] { return b.time_s; });
  const DriveFault on{FaultKind::encoder_freeze, 1, true, shorter.temperature_degC},
      off{FaultKind::encoder_freeze, 1, false, 0};
  const std::vector<DriveFault> nothing;
  for (const auto& [time_s, told] :
       {std::pair{0., nothing}, {0.001, nothing}, {0.002, {on}}, {0.002, nothing}, {0.003, {off}}, {0.004, nothing}}) {
    b.time_s = time_s;
    EXPECT_EQ(bus.changed(1), told) << time_s;
  }
}

TEST(FaultyBus, ADelayedFrameArrivesThoughItsFaultIsOver) {
  for (const bool outgoing : {true, false}) {
    Bus b;
    FaultyBus bus(*b.ours, {{.kind = FaultKind::delay, .to_s = 1, .delay_s = 1e-3}}, 1, [&b] { return b.time_s; });
    Transport &from = outgoing ? static_cast<Transport&>(bus) : *b.theirs, &to = outgoing ? *b.theirs : bus;
    from.send({.id = 0x183});
    Frame frame;
    EXPECT_FALSE(bus.receive(frame));  // a delayed frame leaves or arrives when somebody asks for frames
    b.time_s = 2;
    EXPECT_TRUE(bus.changed(1).empty());
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const bool received = bus.receive(frame);
    EXPECT_TRUE(outgoing ? to.receive(frame) : received) << outgoing;
  }
}

TEST(FaultyBus, TakesOnlySoManyAtOnce) {
  Bus b;
  for (int i = 0; i < 64; ++i) {
    EXPECT_FALSE(b.bus.is_full());
    b.bus.inject(silent_node_3);
  }
  EXPECT_TRUE(b.bus.is_full());
  b.time_s = 3;
  EXPECT_FALSE(b.bus.is_full());
}

// A list of an hour's faults made the drives so slow that the bus stood still.
TEST(FaultyBus, AFrameDoesNotAskTheTimeOncePerFaultOfALongList) {
  Bus b;
  std::vector<Fault> list(2000, silent_node_3);
  for (std::size_t i = 0; i < list.size(); ++i) list[i].from_s = 10.0 * i, list[i].to_s = list[i].from_s + 2;
  FaultyBus bus(*b.ours, list, 1, [&b] { return ++b.asked, b.time_s; });
  for (const double t : {1., 5., 101., 105., 19991., 19995., 19999.}) {
    b.time_s = t, b.asked = 0;
    EXPECT_EQ(bus.send({.id = 0x183}), Sent::done);
    EXPECT_LE(b.asked, 3);
    Frame frame;
    EXPECT_EQ(b.theirs->receive(frame), std::fmod(t, 10) > 2) << t;
    EXPECT_FALSE(bus.is_full());
  }
}

Fault read(const char* yaml, const Wiring& wiring = {}) {
  twin::Mapping keys("fault", "", YAML::Load(yaml));
  return read_fault(keys, {"shoulder", "elbow", "wrist"}, 10, wiring);
}

TEST(ReadFault, FindsTheNodeOfAJointOnItsBus) {
  const Fault one = read("{kind: silence, duration_s: 2, joint: wrist}");
  EXPECT_EQ(one.node, 12);
  EXPECT_EQ(one.bus, std::nullopt);
  EXPECT_EQ(one.to_s - one.from_s, 2);
  const Fault two = read("{kind: safe_torque_off, duration_s: 2, joint: shoulder}", {{2, 1}, {0}});
  EXPECT_EQ(two.node, 10);
  EXPECT_EQ(two.bus, 1U);
  EXPECT_EQ(read("{kind: drop, duration_s: 1, probability: .25}").node, 0);
}

TEST(ReadFault, RefusesWhatItCannotDo) {
  EXPECT_THROW(read("{kind: link_down, duration_s: 2, joint: wrist}"), twin::InputError);
  EXPECT_THROW(read("{kind: encoder_freeze, duration_s: 2}"), twin::InputError);
  EXPECT_THROW(read("{kind: silence, duration_s: 2, node: 3}"), twin::InputError);
  EXPECT_THROW(read("{kind: silence, duration_s: -2, joint: wrist}"), twin::InputError);
  EXPECT_THROW(read("{kind: drop, duration_s: 2, probability: 1.5}"), twin::InputError);
}

}  // namespace
}  // namespace tribotwin::hil
