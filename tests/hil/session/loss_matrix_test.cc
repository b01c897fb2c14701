// Every way of losing commands in every mode of operation: no torque stays, and the arm does not fall.
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {
namespace {

constexpr double degree = std::numbers::pi / 180;
constexpr int cycle_ms = 2, sync_deadline_ms = 100, set_point_deadline_ms = 20 * cycle_ms;
constexpr int joints[] = {1, 3};  // under gravity, and nearly balanced

/// A mode, its set point, and what the master sends in it.
struct Mode {
  const char* name;
  int number;
  od::Index target;
  int rpdo;  ///< 3, 4, 5: controlword and target
  /// Target in cycle k, from the counts at which the drive was enabled.
  std::int64_t (*command)(std::int64_t start, int k);
  bool handshake = false;  ///< each second cycle brings a new set point to be taken at once
};
const Mode modes[] = {
    {"CSP", 8, od::target_position, 3, [](std::int64_t start, int k) { return start + 60 * k; }},
    {"CSV", 9, od::target_velocity, 4, [](std::int64_t, int k) { return std::int64_t{2000} * std::min(k, 100); }},
    {"CST", 10, od::target_torque, 5, [](std::int64_t, int) { return std::int64_t{250}; }},
    {"PP", 1, od::target_position, 3, [](std::int64_t start, int) { return start + 500'000; }, true},
    {"PV", 3, od::target_velocity, 4, [](std::int64_t, int) { return std::int64_t{200'000}; }},
};

/// What the master still does once commands are lost, and when the drive must know.
struct Loss {
  const char* name;
  bool set_points, syncs, link;
  int nmt;  ///< command to all nodes; 0: none
  int deadline_ms;
};
const Loss losses[] = {
    {"master killed", false, false, true, 0, sync_deadline_ms},
    {"set points stop", false, true, true, 0, set_point_deadline_ms},
    {"SYNC stops", true, false, true, 0, sync_deadline_ms},
    {"link down", false, false, false, 0, sync_deadline_ms},
    {"node reset", true, true, true, 0x81, 0},
    {"NMT stop", true, true, true, 0x02, 0},
};

enum Reaction { fault_reaction = 1, no_voltage = 2, quick_stop = 3 };

/// One robot, its master and the bus between them, on one injected clock.
class Session {
 public:
  Session(const twin::Scenario& scenario, const Mode& mode, bool lockstep)
      : mode_(mode),
        lockstep_(lockstep),
        bench_(scenario, {.cycle_us = 1000 * cycle_ms, .lockstep = lockstep}, send()) {
    bench_.start(now_);
  }

  void enable(Reaction reaction) {
    for (const int j : joints) {
      write(j, od::abort_connection_option_code, 0, Type::i16, reaction);
      write(j, od::modes_of_operation, 0, Type::i8, mode_.number);
      switch_on(j);
    }
    give(0, {1, 0});
    for (const int j : joints)
      for (const std::uint8_t word : {0x06, 0x07, 0x0F}) give(rpdo(1, j), {word, 0});
    for (const int j : joints) {
      ASSERT_EQ(node(j).state(), DriveState::operation_enabled);
      start_.push_back(value(j, od::position_actual_value));
    }
  }

  /// The master at work for `count` cycles, as far as the loss leaves it.
  void run(int count, const Loss* loss = nullptr) {
    for (int i = 0; i < count; ++i, ++cycle_) {
      if (!loss || loss->set_points) command();
      for (int t = 0; t < cycle_ms; ++t) pass_ms();
      if (!loss || loss->syncs) give(cob::sync, {});
    }
  }
  void lose(const Loss& loss) {
    link_ = loss.link;
    if (loss.nmt) give(cob::nmt, {static_cast<std::uint8_t>(loss.nmt), 0});
  }

  Node& node(int joint) { return dynamic_cast<Node&>(*bench_.drives()[static_cast<std::size_t>(joint)]); }
  std::int64_t value(int joint, od::Index index) { return node(joint).dictionary().get(index); }
  double position_rad(int joint) { return bench_.plant().twin().data()->qpos[joint]; }
  double speed_rad_s(int joint) { return bench_.plant().twin().data()->qvel[joint]; }
  double torque_nm(int joint) { return bench_.plant().twin().drive(static_cast<std::size_t>(joint)).torque_nm; }
  /// 6085h at the joint.
  double deceleration_rad_s2(int joint) {
    const double motor = static_cast<double>(value(joint, od::quick_stop_deceleration)) * 1e-3 * std::numbers::pi / 30;
    return motor / node(joint).parameters().gear_ratio;
  }

 private:
  Send send() {
    return [this](const Frame&) { return link_ ? Sent::done : Sent::down; };
  }
  static std::uint32_t rpdo(int number, int joint) {
    return 0x100U * static_cast<unsigned>(number) + 0x101U + static_cast<unsigned>(joint);
  }
  /// RPDO 4 and 5 are off by default; 5 has no identifier of its own.
  std::uint32_t identifier(int joint) const {
    return mode_.rpdo == 5 ? 0x680U + static_cast<unsigned>(joint) : rpdo(mode_.rpdo, joint);
  }
  void switch_on(int joint) {
    const auto index = static_cast<od::Index>(od::rpdo_communication + mode_.rpdo - 1);
    write(joint, index, 1, Type::u32, 0x80000000 | identifier(joint));
    write(joint, index, 2, Type::u8, 1);
    write(joint, index, 1, Type::u32, identifier(joint));
  }
  void write(int joint, od::Index index, std::uint8_t sub, Type type, std::int64_t value) {
    give(cob::sdo_to_server + 1 + static_cast<unsigned>(joint), download(index, sub, type, value));
    ASSERT_EQ(node(joint).dictionary().get(index, sub), value);
  }
  void command() {
    for (std::size_t i = 0; i < std::size(joints); ++i) {
      const int size = mode_.rpdo == 5 ? 2 : 4;
      std::vector<std::uint8_t> bytes(2 + static_cast<std::size_t>(size));
      bytes[0] = mode_.handshake && cycle_ % 2 ? 0x3F : 0x0F;
      encode(mode_.command(start_[i], cycle_), std::span(bytes).subspan(2));
      give(identifier(joints[i]), bytes);
    }
  }
  void give(std::uint32_t id, std::vector<std::uint8_t> bytes) {
    if (link_) ASSERT_TRUE(bench_.receive(classic(id, bytes), now_));
  }
  void pass_ms() {
    now_ += ms;
    ASSERT_TRUE(bench_.tick(now_));
    if (!lockstep_) ASSERT_TRUE(bench_.plant().step(bench_.drives()));
  }

  const Mode& mode_;
  const bool lockstep_;
  bool link_ = true;
  std::int64_t now_ = 0;
  int cycle_ = 0;
  std::vector<std::int64_t> start_;
  Bench bench_;
};

class LostCommands : public testing::TestWithParam<Loss> {
 protected:
  static const twin::Scenario& scenario() {
    static const twin::Scenario one =
        twin::load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/irb6620_hold.yaml").value();
    return one;
  }
};

/// What must hold for one joint after the loss; `position_rad` and `speed_rad_s`: when the reaction was due.
struct Due {
  int joint;
  double position_rad, speed_rad_s;
};

void expect_reaction_begun(Session& session, const Loss& loss, Reaction reaction, int joint) {
  EXPECT_NE(session.node(joint).state(), DriveState::operation_enabled);
  if (reaction != no_voltage && loss.nmt != 0x81) return;
  EXPECT_EQ(session.torque_nm(joint), 0);
  EXPECT_TRUE(session.node(joint).brake_engaged());
}

/// The ramp ends after v / a, the brake holds, and the way is that of the ramp.
void expect_rest(Session& session, const Loss& loss, const Due& due) {
  const int j = due.joint;
  EXPECT_TRUE(session.node(j).brake_engaged());
  EXPECT_EQ(session.torque_nm(j), 0);
  EXPECT_EQ(session.value(j, od::torque_actual_value), 0);
  EXPECT_NEAR(session.speed_rad_s(j), 0, 1e-4);
  EXPECT_EQ(session.node(j).state(), loss.nmt == 0x81 ? DriveState::switch_on_disabled : DriveState::fault);
  constexpr double delay_s = 0.025 + 2e-3 * cycle_ms;  // of the speed loop, and two cycles
  const double speed = std::abs(due.speed_rad_s);
  const double way = speed * delay_s + speed * speed / (2 * session.deceleration_rad_s2(j));
  const double along = std::copysign(1, due.speed_rad_s) * (session.position_rad(j) - due.position_rad);
  EXPECT_LT(along, way + 0.1 * degree);
  EXPECT_GT(along, -0.1 * degree);
}

TEST_P(LostCommands, LeaveNoTorqueAndNoFallingArm) {
  const Loss& loss = GetParam();
  for (const Mode& mode : modes)
    for (const bool lockstep : {true, false})
      for (const Reaction reaction : {fault_reaction, no_voltage, quick_stop}) {
        SCOPED_TRACE(fmt::format("{} {} 6007h={}", mode.name, lockstep ? "lockstep" : "realtime", int(reaction)));
        Session session(scenario(), mode, lockstep);
        session.enable(reaction);
        session.run(100);
        for (const int j : joints) {
          ASSERT_GT(std::abs(session.speed_rad_s(j)), 0.005) << "at rest before anything was lost";
          ASSERT_NE(session.torque_nm(j), 0);
        }
        session.lose(loss);
        session.run(loss.deadline_ms / cycle_ms, &loss);
        std::vector<Due> due;
        for (const int j : joints) due.push_back({j, session.position_rad(j), session.speed_rad_s(j)});
        session.run(2, &loss);
        for (const int j : joints) expect_reaction_begun(session, loss, reaction, j);
        session.run(500, &loss);
        std::vector<double> rest_rad;
        for (const Due& one : due) {
          SCOPED_TRACE(one.joint);
          expect_rest(session, loss, one);
          rest_rad.push_back(session.position_rad(one.joint));
        }
        session.run(500, &loss);
        for (std::size_t i = 0; i < due.size(); ++i)
          EXPECT_NEAR(session.position_rad(due[i].joint), rest_rad[i], 0.1 * degree) << "fell";
      }
}

INSTANTIATE_TEST_SUITE_P(Losses, LostCommands, testing::ValuesIn(losses), [](const auto& info) {
  std::string name = info.param.name;
  std::erase(name, ' ');
  return name;
});

}  // namespace
}  // namespace tribotwin::hil
