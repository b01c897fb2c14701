// Drives and robot on one imaginary bus.
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {
namespace {

class OneBench : public testing::Test {
 protected:
  twin::Scenario scenario =
      twin::load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/irb6620_hold.yaml").value();
  std::vector<Frame> bus;
  std::int64_t now = 0;
  Send send = record_in(bus);

  void give(Bench& bench, std::uint32_t id, std::vector<std::uint8_t> bytes = {}) {
    ASSERT_TRUE(bench.receive(classic(id, bytes), now));
  }
  void must_tick(Bench& bench) { ASSERT_TRUE(bench.tick(now)); }
  double position(Bench& bench, std::size_t drive) { return bench.plant().twin().data()->qpos[drive]; }
};

TEST_F(OneBench, EverySyncIsOneCycle) {
  Bench bench(scenario, {.cycle_us = 2000}, send);
  bench.start(now);
  EXPECT_EQ(bus.size(), 6U);
  for (int i = 0; i < 50; ++i) now += 2 * ms, give(bench, 0x80);
  EXPECT_NEAR(bench.plant().twin().time_s(), 0.1, 1e-9);
  EXPECT_EQ(bench.counters().sync_fast, 0U);
  // Twice the rate, or a second master: twice the simulated time, and counted.
  for (int i = 0; i < 100; ++i) now += i % 2 ? 2 * ms - 1000 : 1000, give(bench, 0x80);
  EXPECT_NEAR(bench.plant().twin().time_s(), 0.3, 1e-9);
  EXPECT_EQ(bench.counters().sync_fast, 50U);
  // Frames that resemble a SYNC.
  Frame remote = classic(0x80, {});
  remote.remote = true;
  ASSERT_TRUE(bench.receive(remote, now));
  give(bench, 0x80, {1, 2});
  EXPECT_NEAR(bench.plant().twin().time_s(), 0.3, 1e-9);
}

// CiA 301: a SYNC with a counter that nobody asked for is an error of the moment: EMCY 8240h, and at once 0.
TEST_F(OneBench, TellsEveryEmcyWhenItIsSent) {
  using Told = std::vector<std::pair<std::size_t, std::uint16_t>>;
  Told told;
  Bench bench(scenario, {.emcy = [&](std::size_t drive, std::uint16_t code) { told.emplace_back(drive, code); }}, send);
  bench.start(now);
  EXPECT_TRUE(told.empty());
  give(bench, 0, {1, 3});  // NMT: start node 3 alone
  now += 2 * ms, give(bench, 0x80, {1});
  EXPECT_EQ(told, (Told{{2, 0x8240}, {2, 0}}));
  EXPECT_EQ(std::ranges::count(bus, 0x083u, &Frame::id), 2);
}

// While a bench is held, each SYNC is answered with the same position; then it goes on as if there had been no pause.
TEST_F(OneBench, IsHeldAndGoesOnCycleByCycle) {
  Bench bench(scenario, {.cycle_us = 2000}, send),
      alone(scenario, {.cycle_us = 2000}, [](const Frame&) { return Sent::done; });
  bench.start(now), alone.start(now);
  const auto sync = [&] {
    now += 2 * ms;
    must_tick(bench);
    bus.clear();
    give(bench, 0x80);
  };
  const auto alone_too = [&](int cycles) {
    for (int i = 0; i < cycles; ++i) ASSERT_TRUE(alone.receive(classic(0x80, {}), now));
    for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(position(bench, i), position(alone, i)) << i;
    EXPECT_EQ(bench.plant().twin().steps(), alone.plant().twin().steps());
  };
  for (Bench* one : {&bench, &alone}) give(*one, 0, {1, 0});
  for (int i = 0; i < 10; ++i) sync();
  alone_too(10);
  EXPECT_EQ(bench.left(), std::nullopt);
  bench.hold(0);
  EXPECT_EQ(bench.left(), 0);
  sync();
  const auto answer = bus;
  EXPECT_GE(answer.size(), 6U);
  for (int i = 0; i < 100; ++i) {
    sync();
    EXPECT_EQ(bus, answer);
  }
  alone_too(0);
  bench.hold(3);
  EXPECT_EQ(bench.left(), 3);
  sync();
  EXPECT_EQ(bench.left(), 2);
  for (int i = 0; i < 5; ++i) sync();
  EXPECT_EQ(bench.left(), 0);
  alone_too(3);
  bench.hold(std::nullopt);
  for (int i = 0; i < 10; ++i) sync();
  alone_too(10);
}

// A drive that lost its commands stops when the bench goes on; the clock moves the robot then, from that time on.
TEST_F(OneBench, IsHeldWhileADriveStopsAlone) {
  Bench bench(scenario, {.cycle_us = 2000}, send);
  bench.start(now);
  give(bench, 0, {1, 0});
  for (const std::uint8_t word : {0x06, 0x07, 0x0F})
    give(bench, 0x204, {word, 0}), now += 2 * ms, must_tick(bench), give(bench, 0x80);
  const auto node = [&] { return dynamic_cast<Node*>(bench.drives()[3].get()); };
  const auto here = static_cast<std::int32_t>(node()->dictionary().get(0x6064));
  for (int k = 1; k <= 100; ++k) {
    std::vector<std::uint8_t> data{0x0F, 0, 0, 0, 0, 0};
    encode(here + 2000 * k, std::span(data).subspan(2));
    give(bench, 0x404, data);
    now += 2 * ms, must_tick(bench), give(bench, 0x80);
  }
  bench.hold(0);
  const double held_s = bench.plant().twin().time_s();
  for (int i = 0; i < 1000; ++i) now += ms, must_tick(bench);  // no SYNC
  EXPECT_TRUE(node()->stops_alone());
  EXPECT_EQ(bench.plant().twin().time_s(), held_s);
  EXPECT_GT(bench.next_ns(), now);
  bench.hold(5);
  for (int i = 0; i < 100; ++i) now += ms, must_tick(bench);
  EXPECT_NEAR(bench.plant().twin().time_s(), held_s + 0.01, 1e-9);
  bench.hold(std::nullopt);
  must_tick(bench);
  EXPECT_NEAR(bench.plant().twin().time_s(), held_s + 0.01, 1e-9);  // it catches up with nothing
  for (int i = 0; i < 2000 && node()->stops_alone(); ++i) now += ms, must_tick(bench);
  EXPECT_FALSE(node()->stops_alone());
}

// A store is a file that is forced to disk, while no frame is answered: not while any drive of the bus has power.
TEST_F(OneBench, KeepsNothingWhileADriveHasPower) {
  int writes = 0;
  bool disk_works = true;
  std::vector<bool> told;
  NodeSetup second;
  second.keep = [&](const KeptParameters&) { return ++writes, disk_works; };
  Bench bench(scenario, {.nodes = {{}, second}, .kept = [&](bool done) { return told.push_back(done), done; }}, send);
  bench.start(now);
  const auto answer = [&](std::uint32_t request_id, std::uint32_t id, const std::vector<std::uint8_t>& bytes) {
    bus.clear();
    give(bench, request_id, bytes);
    const auto found = std::ranges::find(bus, id, &Frame::id);
    return found == bus.end() ? std::string("no answer") : text(*found);
  };
  const auto store = [&] { return answer(0x602, 0x582, download(0x1010, 1, Type::u32, 0x65766173)); };
  const auto store_number = [&] { return answer(0x7E5, 0x7E4, {0x17, 0, 0, 0, 0, 0, 0, 0}); };
  const auto control = [&](std::uint8_t word) { give(bench, 0x201, {word, 0}), now += 2 * ms, give(bench, 0x80); };
  const std::string stored = "582#6010100100000000", not_now = "582#8010100122000008",
                    no_access = "582#8010100100000606";
  for (const auto& [part, value] : {std::pair<std::uint8_t, std::uint8_t>{0x40, 0}, {0x41, 0}, {0x42, 0}, {0x43, 2}}) {
    const std::uint32_t identity = part == 0x41 ? 0x7477 : part == 0x42 ? 0x10000 : value;
    std::vector<std::uint8_t> request(8);
    request[0] = part;
    encode(identity, std::span(request).subspan(1, 4));
    give(bench, 0x7E5, request);
  }
  EXPECT_EQ(store(), stored);
  EXPECT_EQ(store_number(), "7E4#1700000000000000");
  EXPECT_EQ(writes, 2);
  give(bench, 0, {1, 1});
  for (const std::uint8_t word : {0x06, 0x07, 0x0F}) control(word);
  ASSERT_TRUE(bench.drives()[0]->enabled());
  EXPECT_EQ(store(), not_now);
  EXPECT_EQ(store_number(), "7E4#1702000000000000");
  EXPECT_EQ(writes, 2);
  for (int k = 0; k < 1000; ++k) control(0x00);
  ASSERT_FALSE(bench.drives()[0]->enabled());
  disk_works = false;
  EXPECT_EQ(store(), no_access);
  EXPECT_EQ(store_number(), "7E4#1702000000000000");
  EXPECT_EQ(writes, 4);
  EXPECT_EQ(told, (std::vector<bool>{true, true, false, false}));
}

// Of all frames of others those that mean none of our drives: SYNC, NMT, LSS, SDO and PDO of ours do.
TEST_F(OneBench, CountsForeignFrames) {
  Bench bench(scenario, {}, send);
  bench.start(now);
  const auto foreign = [&](const Frame& frame) {
    const auto before = bench.counters().foreign;
    EXPECT_TRUE(bench.receive(frame, now));
    return bench.counters().foreign - before;
  };
  for (const std::uint32_t id : {0x000u, 0x080u, 0x201u, 0x206u, 0x401u, 0x606u, 0x7E5u, 0x100u})
    EXPECT_EQ(foreign(classic(id, {})), 0U) << id;
  for (const std::uint32_t id : {0x081u, 0x181u, 0x207u, 0x407u, 0x581u, 0x607u, 0x701u, 0x77Fu, 0x7E4u})
    EXPECT_EQ(foreign(classic(id, {})), 1U) << id;
  Frame guard = classic(0x701, {}), extended = classic(0x201, {}), fd = classic(0x201, {}), error = classic(0x201, {});
  guard.remote = extended.extended = fd.fd = error.error = true;
  EXPECT_EQ(foreign(guard), 0U);
  EXPECT_EQ(foreign(extended) + foreign(fd), 2U);
  EXPECT_EQ(foreign(error), 0U);
  EXPECT_EQ(foreign(classic(0x080, std::vector<std::uint8_t>{1, 2})), 1U);  // resembles a SYNC
  EXPECT_EQ(bench.counters().frames_in, 22U);
  // A heartbeat that a drive watches is foreign no more.
  EXPECT_EQ(foreign(classic(0x602, download(0x1016, 1, Type::u32, 0x007F03E8))), 0U);
  EXPECT_EQ(foreign(classic(0x77F, {})), 0U);
}

TEST_F(OneBench, BrakesHoldTheArmUntilDrivesAreEnabled) {
  Bench bench(scenario, {}, send);
  bench.start(now);
  const double before = position(bench, 1);
  for (int i = 0; i < 500; ++i) now += 2 * ms, give(bench, 0x80);
  EXPECT_NEAR(position(bench, 1), before, 1e-5);
}

// Two masters: of two set points before one SYNC the later counts.
TEST_F(OneBench, OfTwoMastersTheLaterCounts) {
  Bench bench(scenario, {}, send);
  bench.start(now);
  give(bench, 0, {1, 0});
  for (const std::uint8_t word : {0x06, 0x07, 0x0F}) give(bench, 0x201, {word, 0});
  auto* node = dynamic_cast<Node*>(bench.drives()[0].get());
  ASSERT_NE(node, nullptr);
  ASSERT_EQ(node->state(), DriveState::operation_enabled);
  const auto here = static_cast<std::int32_t>(node->dictionary().get(0x6064));
  const auto target = [&](std::int32_t counts) {
    std::vector<std::uint8_t> data{0x0F, 0, 0, 0, 0, 0};
    encode(counts, std::span(data).subspan(2));
    give(bench, 0x401, data);
  };
  target(here - 5000);
  target(here + 5000);
  now += 2 * ms;
  give(bench, 0x80);
  EXPECT_EQ(node->dictionary().get(0x607A), here + 5000);
  EXPECT_NEAR(static_cast<double>(node->dictionary().get(0x6062)), here + 5000, 2);
}

class MirrorBench : public OneBench, public testing::WithParamInterface<Profile> {};
INSTANTIATE_TEST_SUITE_P(Formats, MirrorBench, testing::Values(Profile::mirror, Profile::mirror_fd),
                         [](const auto& info) { return info.param == Profile::mirror ? "classic" : "fd"; });

TEST_P(MirrorBench, DrivesFollow) {
  const MirrorFormat format = mirror_format(GetParam());
  Bench bench(scenario, {.profile = GetParam(), .lockstep = false}, send);
  bench.start(now);
  const double start = position(bench, 3);
  std::uint8_t counter = 0;
  for (int k = 0; k < 500; ++k) {
    now += 2 * ms;
    for (int node = 1; node <= 6; ++node) {
      const auto i = static_cast<std::size_t>(node - 1);
      const double target =
          (node == 4 ? start + 0.1 * (1 - std::cos(M_PI * std::min(1.0, k / 400.0))) : scenario.start_rad[i]);
      ASSERT_TRUE(bench.receive(encode(MirrorCommand{counter, MirrorMode::position, target}, node, format), now));
    }
    ++counter;
    must_tick(bench);
    for (int step = 0; step < 2; ++step) ASSERT_TRUE(bench.plant().step(bench.drives()));
  }
  EXPECT_NEAR(position(bench, 3), start + 0.2, 5e-3);
  EXPECT_NEAR(position(bench, 1), scenario.start_rad[1], 2e-3);
  const auto status = decode_status(bus.back());
  ASSERT_TRUE(status);
  EXPECT_EQ(status->state, MirrorMode::position);
  // Commands stop: no drive keeps its torque.
  for (int k = 0; k < 1000; ++k) {
    now += ms;
    must_tick(bench);
    ASSERT_TRUE(bench.plant().step(bench.drives()));
  }
  for (const auto& drive : bench.drives()) EXPECT_TRUE(drive->failed());
}

// A torque accelerates no joint beyond the maximum speed of its drive.
TEST_P(MirrorBench, TheMaxMotorSpeedHoldsInTorqueMode) {
  Bench bench(scenario, {.profile = GetParam()}, send);
  bench.start(now);
  const auto p = drive_parameters(scenario, 1, 2000)[3];
  const double speed_max_rad_s = p.speed_max_rad_s / p.gear_ratio;
  double fastest_rad_s = 0;
  for (int k = 0; k < 400; ++k) {
    now += 2 * ms;
    const MirrorCommand command{static_cast<std::uint8_t>(k), MirrorMode::torque, 200};
    ASSERT_TRUE(bench.receive(encode(command, 4, mirror_format(GetParam())), now));
    give(bench, 0x80);
    fastest_rad_s = std::max(fastest_rad_s, std::abs(bench.plant().twin().data()->qvel[3]));
  }
  EXPECT_GT(fastest_rad_s, 0.95 * speed_max_rad_s);
  EXPECT_LT(fastest_rad_s, 1.05 * speed_max_rad_s);
}

// In lockstep too: the last command is not held, whether SYNCs come or not.
TEST_F(OneBench, MirrorDrivesStopWithoutSync) {
  Bench bench(scenario, {.profile = Profile::mirror}, send);
  bench.start(now);
  for (std::uint8_t counter = 0; counter < 20; ++counter) {
    now += 2 * ms;
    ASSERT_TRUE(bench.receive(encode(MirrorCommand{counter, MirrorMode::torque, 50}, 4), now));
    give(bench, 0x80);
  }
  EXPECT_NEAR(bench.plant().twin().drive(3).torque_nm, 50, 1e-9);
  for (int k = 0; k < 1000; ++k) now += ms, must_tick(bench);
  EXPECT_TRUE(bench.drives()[3]->failed());
  EXPECT_EQ(bench.plant().twin().drive(3).torque_nm, 0);
}

/// A bench whose joint4 accelerates by 400 per mille, sent by RPDO5 before each SYNC.
class OneTorque : public OneBench {
 protected:
  Bench bench{scenario, {}, send};
  Node& node = dynamic_cast<Node&>(*bench.drives()[3]);

  void write(std::uint16_t index, std::uint8_t sub, Type type, std::int64_t value) {
    give(bench, 0x604, download(index, sub, type, value));
    for (const Frame& frame : bus)
      if (frame.id == 0x584) EXPECT_NE(frame.data[0], 0x80) << text(frame);
    bus.clear();
  }
  void control(std::uint8_t word) { give(bench, 0x204, {word, 0}); }
  void enable() {
    give(bench, 0, {1, 0});
    for (const std::uint8_t word : {0x06, 0x07, 0x0F}) control(word);
    ASSERT_EQ(node.state(), DriveState::operation_enabled);
  }
  void cycle(std::int16_t per_mille) {
    std::vector<std::uint8_t> data{0x0F, 0, 0, 0};
    encode(per_mille, std::span(data).subspan(2));
    give(bench, 0x47F, data);
    sync();
  }
  void sync() {
    now += 2 * ms;
    must_tick(bench);
    give(bench, 0x80);
  }
  /// The wall clock of a master that says nothing [ms].
  void wait(int milliseconds) {
    for (int i = 0; i < milliseconds; ++i) now += ms, must_tick(bench);
  }
  std::int64_t value(std::uint16_t index) { return node.dictionary().get(index); }

  void SetUp() override {
    bench.start(now);
    write(0x1404, 1, Type::u32, 0x8000047F);
    write(0x1404, 1, Type::u32, 0x47F);
    write(0x6060, 0, Type::i8, 10);
  }
};

// In lockstep the robot stands still between SYNCs, but a reaction ends: brake, torque 0, fault.
TEST_F(OneTorque, TheReactionNeedsNoSync) {
  for (const int option : {1, 2, 3}) {
    SCOPED_TRACE(option);
    write(0x6007, 0, Type::i16, option);
    enable();
    for (int k = 0; k < 20; ++k) cycle(400);
    ASSERT_EQ(value(0x6077), 400);
    const double held_s = bench.plant().twin().time_s();
    wait(99);
    EXPECT_EQ(bench.plant().twin().time_s(), held_s);  // nothing is lost yet: lockstep
    wait(900);
    EXPECT_EQ(node.state(), DriveState::fault);
    EXPECT_TRUE(node.brake_engaged());
    EXPECT_EQ(value(0x6077), 0);
    EXPECT_NEAR(static_cast<double>(value(0x606C)), 0, 5000);
    EXPECT_EQ(node.error_code(), 0x8700);
    EXPECT_LT(bench.plant().twin().time_s(), held_s + 0.8);  // and then it stands still again
    const double ended_s = bench.plant().twin().time_s();
    wait(1000);
    EXPECT_EQ(bench.plant().twin().time_s(), ended_s);
    control(0x80);
    EXPECT_EQ(node.state(), DriveState::switch_on_disabled);
    control(0x00);
  }
}

TEST_F(OneTorque, ALostHeartbeatEndsInFaultWithoutAnySync) {
  write(0x1016, 1, Type::u32, 0x7F << 16 | 50);
  enable();
  give(bench, 0x77F, {5});
  wait(1000);
  EXPECT_EQ(node.state(), DriveState::fault);
  EXPECT_EQ(value(0x6077), 0);
}

TEST_F(OneTorque, LeavingOperationalEndsInFaultWithoutAnySync) {
  for (const std::uint8_t command : {0x02, 0x80, 0x81}) {
    SCOPED_TRACE(int(command));
    write(0x1404, 1, Type::u32, 0x47F);
    write(0x6060, 0, Type::i8, 10);
    enable();
    for (int k = 0; k < 20; ++k) cycle(400);
    give(bench, 0, {command, 0});
    wait(1000);
    EXPECT_EQ(value(0x6077), 0);
    EXPECT_TRUE(node.brake_engaged());
    give(bench, 0, {0x81, 0});
  }
}

// NMT stop takes the power from a drive, too, that SDOs have enabled before any NMT start.
TEST_F(OneTorque, StopEndsWhatSdosHaveEnabled) {
  write(0x6060, 0, Type::i8, 3);
  for (const std::uint8_t word : {0x06, 0x07, 0x0F}) write(0x6040, 0, Type::u16, word);
  write(0x60FF, 0, Type::i32, 500'000);
  ASSERT_EQ(node.state(), DriveState::operation_enabled);
  for (int k = 0; k < 200; ++k) sync();
  ASSERT_GT(value(0x606C), 100'000);
  give(bench, 0, {0x02, 0});
  wait(1000);
  EXPECT_EQ(node.state(), DriveState::fault);
  EXPECT_EQ(value(0x6077), 0);
  EXPECT_TRUE(node.brake_engaged());
}

// A reaction that cannot stop the motor ends at the brake.
TEST_F(OneTorque, AReactionIsNotEndless) {
  write(0x6085, 0, Type::u32, 1);
  enable();
  for (int k = 0; k < 20; ++k) cycle(400);
  wait(9000);
  EXPECT_EQ(node.state(), DriveState::fault_reaction_active);
  wait(2000);
  EXPECT_EQ(node.state(), DriveState::fault);
  EXPECT_EQ(value(0x6077), 0);
  EXPECT_TRUE(node.brake_engaged());
}

// A master that goes on sending SYNCs stays the clock, whatever a drive does.
TEST_F(OneTorque, ALivingMasterIsTheClock) {
  enable();
  for (int k = 0; k < 20; ++k) cycle(400);
  const double before_s = bench.plant().twin().time_s();
  for (int k = 0; k < 200; ++k) sync();  // no set points: their own reaction
  EXPECT_EQ(node.state(), DriveState::fault);
  EXPECT_EQ(node.error_code(), 0x8250);
  EXPECT_NEAR(bench.plant().twin().time_s(), before_s + 0.4, 1e-9);
  EXPECT_EQ(value(0x6077), 0);
}

// How often the session looks at the clock does not matter: a replay looks as often as frames were recorded.
TEST_F(OneTorque, TheReactionDoesNotDependOnTheTicks) {
  enable();
  for (int k = 0; k < 20; ++k) cycle(400);
  const std::int64_t began = now;
  const auto position_after = [&](Bench& one, const std::vector<int>& ticks_ms) {
    for (const int t : ticks_ms) now = began + t * ms, must_tick(one);
    return position(one, 3);
  };
  Bench other(scenario, {}, send);
  now = 0;
  other.start(now);
  const auto tell = [&](std::uint32_t id, std::vector<std::uint8_t> bytes) { give(other, id, std::move(bytes)); };
  tell(0x604, {0x23, 0x04, 0x14, 1, 0x7F, 0x04, 0, 0x80});
  tell(0x604, {0x23, 0x04, 0x14, 1, 0x7F, 0x04, 0, 0});
  tell(0x604, {0x2F, 0x60, 0x60, 0, 10, 0, 0, 0});
  tell(0, {1, 0});
  for (const std::uint8_t word : {0x06, 0x07, 0x0F}) tell(0x204, {word, 0});
  for (int k = 0; k < 20; ++k) {
    tell(0x47F, {0x0F, 0, 0x90, 0x01});
    now += 2 * ms;
    must_tick(other);
    tell(0x80, {});
  }
  ASSERT_EQ(position(other, 3), position(bench, 3));
  std::vector<int> often{101}, rarely{101, 117, 180, 400};
  for (int t = 102; t <= 400; ++t) often.push_back(t);
  EXPECT_EQ(position_after(bench, often), position_after(other, rarely));
}

// 6080h limits the speed in torque mode, whoever accelerates: the motor, or gravity against it.
TEST_F(OneTorque, TheMaxMotorSpeedHolds) {
  const double limit_rpm = static_cast<double>(value(0x6080));
  for (const std::int16_t per_mille : {-400, 1000}) {
    SCOPED_TRACE(per_mille);
    enable();
    double fastest_rpm = 0;
    for (int k = 0; k < 200; ++k) {
      cycle(per_mille);
      fastest_rpm = std::max(fastest_rpm, std::abs(1e-3 * static_cast<double>(value(0x606C))));
    }
    EXPECT_LT(fastest_rpm, 1.05 * limit_rpm);
    EXPECT_NEAR(1e-3 * static_cast<double>(value(0x606C)), std::copysign(limit_rpm, per_mille), 0.02 * limit_rpm);
    EXPECT_TRUE(value(0x6041) & 0x0800);  // internal limit active
    // Less torque than the speed needs, or the other way: the master has its torque again at once.
    cycle(0);
    EXPECT_EQ(value(0x6077), 0);
    cycle(static_cast<std::int16_t>(-per_mille / 4));
    EXPECT_EQ(value(0x6077), -per_mille / 4);
    EXPECT_FALSE(value(0x6041) & 0x0800);
    for (int k = 0; k < 400; ++k) cycle(0);
    control(0x06);
    sync();
  }
}

// A motor that is too fast already is braked, if the master does not brake it.
TEST_F(OneTorque, ALowerMaxMotorSpeedHolds) {
  enable();
  for (int k = 0; k < 30; ++k) cycle(400);
  ASSERT_GT(1e-3 * static_cast<double>(value(0x606C)), 1000);
  write(0x6080, 0, Type::u32, 500);
  for (int k = 0; k < 100; ++k) cycle(90);  // a little less than friction
  EXPECT_LT(1e-3 * static_cast<double>(value(0x606C)), 510);
}

TEST_F(OneBench, TheMaxMotorSpeedHoldsAFallingArm) {
  scenario.start_rad[1] = 0.8;
  Bench bench(scenario, {}, send);
  bench.start(now);
  auto& arm = dynamic_cast<Node&>(*bench.drives()[1]);
  const auto set = [&](std::uint16_t index, Type type, std::int64_t value) {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size_of(type)));
    encode(value, bytes);
    ASSERT_TRUE(arm.dictionary().write(index, 0, bytes));
  };
  set(0x6080, Type::u32, 200);
  set(0x6060, Type::i8, 10);
  give(bench, 0, {1, 0});
  for (const std::uint8_t word : {0x06, 0x07, 0x0F}) give(bench, 0x202, {word, 0});
  ASSERT_EQ(arm.state(), DriveState::operation_enabled);
  set(0x6071, Type::i16, 0);
  double fastest_rpm = 0;
  for (int k = 0; k < 250; ++k) {
    now += 2 * ms;
    give(bench, 0x80);
    fastest_rpm = std::max(fastest_rpm, std::abs(1e-3 * static_cast<double>(arm.dictionary().get(0x606C))));
  }
  EXPECT_GT(fastest_rpm, 190);
  EXPECT_LT(fastest_rpm, 210);
}

// Halt in torque mode: the torque of the master is not held, the arm stands and stays enabled.
TEST_F(OneTorque, HaltHoldsTheJoint) {
  enable();
  for (int k = 0; k < 20; ++k) cycle(400);
  give(bench, 0x204, {0x0F, 1});
  for (int k = 0; k < 1000; ++k) sync();
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  EXPECT_NEAR(1e-3 * static_cast<double>(value(0x606C)), 0, 5);
  EXPECT_EQ(value(0x6041) & 0x1400, 0x0400);
}

}  // namespace
}  // namespace tribotwin::hil
