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
  bool cyclic = true;                ///< set points by themselves keep it going
  std::uint8_t word = 0x0F;          ///< low byte of the controlword
  std::uint8_t every_second = word;  ///< and of each second cycle
};
constexpr std::int64_t ramp(std::int64_t start, int k) { return start + 60 * k; }
const Mode modes[] = {
    {"CSP", 8, od::target_position, 3, ramp},
    {"CSV", 9, od::target_velocity, 4, [](std::int64_t, int k) { return std::int64_t{2000} * std::min(k, 100); }},
    {"CST", 10, od::target_torque, 5, [](std::int64_t, int) { return std::int64_t{250}; }},
    {"IP", 7, od::interpolation_data_record, 3, ramp, true, 0x1F, 0x1F},
    // Each second cycle brings a new set point to be taken at once.
    {"PP", 1, od::target_position, 3, [](std::int64_t start, int) { return start + 500'000; }, false, 0x0F, 0x3F},
    {"PV", 3, od::target_velocity, 4, [](std::int64_t, int) { return std::int64_t{200'000}; }, false},
    {"HM", 6, od::target_position, 3, [](std::int64_t start, int) { return start; }, false, 0x1F, 0x1F},
};

/// What the master does beside set points and SYNC, so that the drive knows it is there.
enum class Sign { none, heartbeat, guarding };
constexpr int heartbeat_ms = 60, guard_ms = 25, life_factor = 2, rpdo_deadline_ms = 50, event_deadline_ms = 100;
constexpr int master_node = 100;

/// What the master still does once commands are lost, and when the drive must know.
struct Loss {
  const char* name;
  bool set_points, syncs, link;
  int nmt;  ///< command to all nodes; 0: none
  int deadline_ms;
  bool (*happens)(const Mode&) = nullptr;  ///< where the drive can tell it from a master at work; null: in every mode
  int transmission_type = 1;               ///< of the RPDO with the set points
  int rpdo_deadline_ms = 0;                ///< its 140xh:05
  Sign sign = Sign::none;                  ///< that ends
};
bool is_cyclic(const Mode& mode) { return mode.cyclic; }
bool has_set_points(const Mode& mode) { return mode.number != 6; }
const Loss losses[] = {
    {"master killed", false, false, true, 0, sync_deadline_ms},
    {"set points stop", false, true, true, 0, set_point_deadline_ms, has_set_points},
    {"SYNC stops", true, false, true, 0, sync_deadline_ms},
    {"link down", false, false, false, 0, sync_deadline_ms},
    {"node reset", true, true, true, 0x81, 0},
    {"NMT stop", true, true, true, 0x02, 0},
    {"heartbeat stops", true, true, true, 0, heartbeat_ms, nullptr, 1, 0, Sign::heartbeat},
    {"guarding stops", true, true, true, 0, guard_ms* life_factor, nullptr, 1, 0, Sign::guarding},
    {"RPDO late", false, true, true, 0, rpdo_deadline_ms, nullptr, 1, rpdo_deadline_ms},
    {"event RPDO late", false, true, true, 0, rpdo_deadline_ms, nullptr, 255, rpdo_deadline_ms},
    {"event RPDO stops", false, true, true, 0, event_deadline_ms, is_cyclic, 255},
};
void PrintTo(const Loss& loss, std::ostream* out) { *out << loss.name; }

enum Reaction { fault_reaction = 1, no_voltage = 2, quick_stop = 3 };

/// One robot, its master and the bus between them, on one injected clock.
class Session {
 public:
  Session(const twin::Scenario& scenario, const Mode& mode, const Loss& loss, bool lockstep)
      : mode_(mode),
        loss_(loss),
        lockstep_(lockstep),
        bench_(scenario, {.cycle_us = 1000 * cycle_ms, .lockstep = lockstep}, send()) {
    bench_.start(now_);
  }

  void enable(Reaction reaction) {
    for (const int j : joints) {
      write(j, od::abort_connection_option_code, 0, Type::i16, reaction);
      write(j, od::modes_of_operation, 0, Type::i8, mode_.number);
      if (mode_.number == 6) write(j, od::homing_method, 0, Type::i8, 17);
      expect_sign(j);
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
  void run(int count) {
    for (int i = 0; i < count; ++i, ++cycle_) {
      if (!lost_) give_sign();
      if (!lost_ || loss_.set_points) command();
      for (int t = 0; t < cycle_ms; ++t) pass_ms();
      if (!lost_ || loss_.syncs) give(cob::sync, {});
    }
  }
  void lose() {
    lost_ = true;
    link_ = loss_.link;
    if (loss_.nmt) give(cob::nmt, {static_cast<std::uint8_t>(loss_.nmt), 0});
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
    const auto mapping = static_cast<od::Index>(od::rpdo_mapping + mode_.rpdo - 1);
    write(joint, index, 1, Type::u32, 0x80000000 | identifier(joint));
    write(joint, index, 2, Type::u8, loss_.transmission_type);
    write(joint, index, 5, Type::u16, loss_.rpdo_deadline_ms);
    if (mode_.target == od::interpolation_data_record) {
      write(joint, mapping, 0, Type::u8, 0);
      write(joint, mapping, 2, Type::u32, od::interpolation_data_record << 16 | 0x0120);
      write(joint, mapping, 0, Type::u8, 2);
    }
    write(joint, index, 1, Type::u32, identifier(joint));
  }
  void expect_sign(int joint) {
    if (loss_.sign == Sign::heartbeat)
      write(joint, od::consumer_heartbeat_time, 1, Type::u32, master_node << 16 | heartbeat_ms);
    if (loss_.sign != Sign::guarding) return;
    write(joint, od::producer_heartbeat_time, 0, Type::u16, 0);
    write(joint, od::guard_time, 0, Type::u16, guard_ms);
    write(joint, od::life_time_factor, 0, Type::u8, life_factor);
  }
  void give_sign() {
    if (loss_.sign == Sign::heartbeat) give(cob::heartbeat + master_node, {0x05});
    if (loss_.sign != Sign::guarding) return;
    for (const int j : joints) {
      Frame request = classic(cob::heartbeat + 1 + static_cast<unsigned>(j), std::vector<std::uint8_t>{});
      request.remote = true;
      ASSERT_TRUE(bench_.receive(request, now_));
    }
  }
  void write(int joint, od::Index index, std::uint8_t sub, Type type, std::int64_t value) {
    give(cob::sdo_to_server + 1 + static_cast<unsigned>(joint), download(index, sub, type, value));
    ASSERT_EQ(node(joint).dictionary().get(index, sub), value);
  }
  void command() {
    for (std::size_t i = 0; i < std::size(joints); ++i) {
      const int size = mode_.rpdo == 5 ? 2 : 4;
      std::vector<std::uint8_t> bytes(2 + static_cast<std::size_t>(size));
      bytes[0] = cycle_ % 2 ? mode_.every_second : mode_.word;
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
  const Loss& loss_;
  const bool lockstep_;
  bool link_ = true, lost_ = false;
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

void expect_no_torque_and_no_fall(Session& session, const Loss& loss, Reaction reaction) {
  session.enable(reaction);
  session.run(100);
  for (const int j : joints) {
    ASSERT_EQ(session.node(j).state(), DriveState::operation_enabled);
    ASSERT_GT(std::abs(session.speed_rad_s(j)), 0.005) << "at rest before anything was lost";
    ASSERT_NE(session.torque_nm(j), 0);
  }
  session.lose();
  session.run(loss.deadline_ms / cycle_ms);
  std::vector<Due> due;
  for (const int j : joints) due.push_back({j, session.position_rad(j), session.speed_rad_s(j)});
  session.run(2);
  for (const int j : joints) expect_reaction_begun(session, loss, reaction, j);
  session.run(500);
  std::vector<double> rest_rad;
  for (const Due& one : due) {
    SCOPED_TRACE(one.joint);
    expect_rest(session, loss, one);
    rest_rad.push_back(session.position_rad(one.joint));
  }
  session.run(500);
  for (std::size_t i = 0; i < due.size(); ++i)
    EXPECT_NEAR(session.position_rad(due[i].joint), rest_rad[i], 0.1 * degree) << "fell";
}

TEST_P(LostCommands, LeaveNoTorqueAndNoFallingArm) {
  const Loss& loss = GetParam();
  for (const Mode& mode : modes)
    for (const bool lockstep : {true, false})
      for (const Reaction reaction : {fault_reaction, no_voltage, quick_stop}) {
        if (loss.happens && !loss.happens(mode)) continue;
        SCOPED_TRACE(fmt::format("{} {} 6007h={}", mode.name, lockstep ? "lockstep" : "realtime", int(reaction)));
        Session session(scenario(), mode, loss, lockstep);
        expect_no_torque_and_no_fall(session, loss, reaction);
      }
}

INSTANTIATE_TEST_SUITE_P(Losses, LostCommands, testing::ValuesIn(losses), [](const auto& info) {
  std::string name = info.param.name;
  std::erase(name, ' ');
  return name;
});

}  // namespace
}  // namespace tribotwin::hil
