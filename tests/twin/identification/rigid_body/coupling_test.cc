#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/twin/identification/swing_recording.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/robot/coupling/coupling.hpp>

/// A wrist whose second motor turns with both joints, as its belt goes through the first: recordings of it are joint
/// torques, or motor torques.
namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

std::string wrist_xml(const std::string& below) {
  return R"(<mujoco><worldbody>
  <body><joint name="yaw" axis="0 0 1" armature=".1"/><geom type="capsule" size=".05" fromto="0 0 0 .2 0 0" mass="3"/>
  <body pos=".2 0 0"><joint name="pitch" axis="0 1 0" armature=".05"/>
    <geom type="capsule" size=".04" fromto="0 0 0 .2 0 0" mass="2"/>
  <body pos=".2 0 0"><joint name="roll" axis="1 0 0" armature=".02"/>
    <geom type="box" size=".05 .1 .03" pos=".05 .05 .02" mass="1"/></body></body></body></worldbody>)" +
         below + "</mujoco>";
}

const std::string belt =
    "<tendon><fixed name='belt'><joint joint='pitch' coef='1'/><joint joint='roll' coef='1'/></fixed></tendon>"
    "<actuator><motor name='m1' joint='yaw'/><motor name='m2' joint='pitch'/><motor name='m3' "
    "tendon='belt'/></actuator>";

class Wrist {
 public:
  explicit Wrist(const std::string& below = belt) : model(*mujoco::load_string(wrist_xml(below))) {}

  std::shared_ptr<const mujoco::Model> model;
  Regressor plain = *Regressor::create(model->get());
};

/// With the motor on the belt, whose rotor and friction are known.
class CoupledWrist : public Wrist {
 public:
  static constexpr double coulomb_nm[] = {2, 1.5, 0.5, 1.2}, viscous_nm_s[] = {1, 0.8, 0.1, 0.6};

  CoupledWrist() {
    auto motors = motors_on_tendons(plain);
    motors.front().rotor_inertia = 0.08;
    coupled = *Regressor::create(model->get(), std::move(motors));
  }
  Regressor coupled = plain;

  RobotRecording recording(unsigned seed, double stribeck_nm = 0, double per_load = 0) {
    std::normal_distribution<double> noise(0, 0.02);
    return swing_recording(seed, 3, 1500, [&](const auto& state, auto& random) {
      const auto& [q, qd, qdd] = state;
      const VectorXd rigid = coupled.at(q, qd, qdd) * coupled.model_parameters();
      VectorXd torque = rigid;
      for (Index rotor = 0; rotor < 4; ++rotor) {
        const double v = coupled.speed(rotor, qd);
        const double level = coulomb_nm[rotor] + viscous_nm_s[rotor] * std::abs(v) +
                             stribeck_nm * std::exp(-std::abs(v) / 0.3) +
                             per_load * std::abs(coupled.load(rotor, rigid, qdd));
        for (Index j = 0; j < 3; ++j) torque(j) += coupled.turns(rotor, j) * std::copysign(level, v);
      }
      for (Index j = 0; j < 3; ++j) torque(j) += noise(random);
      return torque;
    });
  }
};

struct Fitted {
  BaseParameters base;
  RobotFriction friction;
  JointMotion motion;
  DynamicsFit fit;
};

Fitted fitted(const Wrist& wrist, const Regressor& regressor, const RobotRecording& recording, const char* law) {
  const std::vector<double> torque_max(3, 10);
  Fitted out{
      .base = base_parameters(regressor),
      .friction = *robot_friction(*wrist.model, regressor, **dynamics_law(law, "law"), {.offset = true}, torque_max),
      .motion = *prepare({&recording, 1}, regressor),
      .fit = {}};
  auto fit = fit_dynamics(regressor, out.base, out.friction, out.motion);
  EXPECT_TRUE(fit) << fit.error().message;
  out.fit = *std::move(fit);
  return out;
}

TEST(Coupling, IsThatOfActuatorsOnFixedTendons) {
  const auto fixed = [](const char* name, double pitch, double roll) {
    return fmt::format("<fixed name='{}'><joint joint='pitch' coef='{}'/>{}</fixed>", name, pitch,
                       roll == 0 ? "" : fmt::format("<joint joint='roll' coef='{}'/>", roll));
  };
  struct Case {
    std::string name, tendons, actuators;
    std::vector<std::string> motors;
  };
  const std::string yaw = "<motor joint='yaw'/>", pitch = "<motor joint='pitch'/>", roll = "<motor joint='roll'/>";
  const std::vector<Case> cases{
      {"none", "", yaw + pitch + roll, {}},
      {"belt", fixed("t", 1, 1), yaw + pitch + "<motor name='m' tendon='t'/>", {"m of roll: pitch + roll"}},
      {"half a turn back",
       fixed("t", -0.5, 1),
       yaw + pitch + "<motor tendon='t'/>",
       {"motor_roll of roll: -0.5*pitch + roll"}},
      {"the first joint's",
       fixed("t", 1, 1),
       yaw + roll + "<general name='m' tendon='t'/>",
       {"m of pitch: pitch + roll"}},
      {"differential",
       fixed("a", 1, 1) + fixed("b", 1, -1),
       yaw + "<motor name='a' tendon='a'/><motor name='b' tendon='b'/>",
       {"a of roll: pitch + roll", "b of pitch: pitch - roll"}},
      {"a joint's name",
       fixed("t", 1, 1),
       yaw + pitch + "<motor name='roll' tendon='t'/>",
       {"motor_roll of roll: pitch + roll"}},
      {"one joint", fixed("t", 1, 0), yaw + "<motor name='m' tendon='t'/>" + roll, {}},
      {"no actuator", fixed("t", 1, 1), yaw + pitch + roll, {}},
      {"two actuators of one",
       fixed("t", 1, 1),
       yaw + pitch + "<motor name='m' tendon='t'/><motor name='n' tendon='t'/>",
       {"m of roll: pitch + roll"}},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    const Wrist wrist("<tendon>" + c.tendons + "</tendon><actuator>" + c.actuators + "</actuator>");
    std::vector<std::string> found;
    for (const CoupledMotor& m : motors_on_tendons(wrist.plain))
      found.push_back(fmt::format("{} of {}: {}", m.name, wrist.plain.joint_name(m.joint), sum_of(m, wrist.plain)));
    EXPECT_EQ(found, c.motors);
    EXPECT_TRUE(Regressor::create(wrist.model->get(), motors_on_tendons(wrist.plain)));
  }
}

TEST(Coupling, IsReadFromASumAndRefusedWithItsPlace) {
  const Wrist wrist;
  const struct {
    const char *text, *sum, *says;
  } cases[] = {
      {"roll=pitch+roll", "pitch + roll", ""},
      {" roll =  - 0.5 * pitch + roll ", "-0.5*pitch + roll", ""},
      {"roll = roll - yaw + 2*pitch", "-yaw + 2*pitch + roll", ""},
      {"roll", "", "no '='"},
      {"rol=pitch+roll", "", "'rol' is no joint of the model; did you mean 'roll'?"},
      {"roll=pich+roll", "", "'pich' is no joint of the model; did you mean 'pitch'?"},
      {"roll=", "", "a joint is missing"},
      {"roll=pitch+", "", "a joint is missing"},
      {"roll=pitch roll", "", "'+' or '-' was expected before 'roll'"},
      {"roll=roll", "", "no coupling"},
      {"roll=pitch", "", "does not turn with roll"},
      {"roll=pitch+roll-roll", "", "does not turn with roll"},
      {"roll=nan*pitch+roll", "", "finite"},
  };
  for (const auto& c : cases) {
    SCOPED_TRACE(c.text);
    const auto motor = coupled_motor("--coupling", c.text, wrist.plain);
    EXPECT_EQ(motor.has_value(), !*c.says);
    if (motor)
      EXPECT_EQ(sum_of(*motor, wrist.plain), c.sum);
    else
      EXPECT_THAT(motor.error().message, testing::AllOf(testing::StartsWith(fmt::format("--coupling '{}': ", c.text)),
                                                        testing::HasSubstr(c.says)));
  }
}

TEST(Coupling, MustDetermineTheJoints) {
  const Wrist wrist;
  const auto motor = [&](const char* text) { return *coupled_motor("--coupling", text, wrist.plain); };
  const auto create = [&](std::vector<CoupledMotor> motors) {
    return Regressor::create(wrist.model->get(), std::move(motors));
  };
  EXPECT_TRUE(create({motor("roll=pitch+roll"), motor("pitch=pitch-roll")}));
  const auto singular = create({motor("roll=pitch+roll"), motor("pitch=2*pitch+2*roll")}),
             twice = create({motor("roll=pitch+roll"), motor("roll=pitch-roll")});
  ASSERT_FALSE(singular || twice);
  EXPECT_THAT(singular.error().message, testing::HasSubstr("do not determine the joints"));
  EXPECT_THAT(twice.error().message, testing::HasSubstr("'roll' has two coupled motors"));
}

// The motor's rotor is an inertia about the sum of the joints, and its load is what joint torques leave to it.
TEST(Coupling, AddsARotorThatTurnsWithTheSum) {
  CoupledWrist wrist;
  const VectorXd q{{0.3, -0.4, 0.9}}, qd{{1, 2, -3}}, qdd{{4, -5, 7}};
  const VectorXd rigid = wrist.coupled.at(q, qd, qdd) * wrist.coupled.model_parameters(),
                 without = wrist.plain.at(q, qd, qdd) * wrist.plain.model_parameters();
  const double torque = 0.08 * (qdd(1) + qdd(2));
  EXPECT_TRUE((rigid - without).isApprox(VectorXd{{0, torque, torque}}));
  EXPECT_EQ(wrist.coupled.speed(3, qd), -1);

  const MatrixXd motors{{1}, {2}, {5}}, joints{{1}, {7}, {5}};
  EXPECT_EQ(wrist.coupled.joint_torque(motors), joints);
  const VectorXd still = VectorXd::Zero(3);
  EXPECT_EQ(wrist.coupled.load(3, joints.col(0), still), 5);
  EXPECT_EQ(wrist.coupled.load(1, joints.col(0), still), 7);
  EXPECT_NEAR(wrist.coupled.load(1, rigid, qdd), without(1) - 0.05 * qdd(1), 1e-12);
}

TEST(Coupling, IsFoundWithinItsSigmasAndItsLackIsSeen) {
  CoupledWrist wrist;
  const auto recording = wrist.recording(1);
  const auto with = fitted(wrist, wrist.coupled, recording, "coulomb_viscous"),
             without = fitted(wrist, wrist.plain, recording, "coulomb_viscous");
  EXPECT_GT(without.fit.joints[2].relative_error, 0.15);
  for (const JointResult& joint : with.fit.joints) EXPECT_LT(joint.relative_error, 0.02) << joint.name;

  ASSERT_THAT(with.fit.friction, testing::SizeIs(4));
  for (std::size_t r = 0; r < 4; ++r) {
    const auto& of = with.fit.friction[r];
    ASSERT_THAT(of, testing::SizeIs(r < 3 ? 3 : 2));
    EXPECT_NEAR(of[0].value, CoupledWrist::coulomb_nm[r], 4 * of[0].sigma) << r;
    EXPECT_NEAR(of[1].value, CoupledWrist::viscous_nm_s[r], 4 * of[1].sigma) << r;
    EXPECT_LT(of[0].sigma + of[1].sigma, 0.05) << r;
  }
  const VectorXd truth = with.base.from_all * wrist.coupled.model_parameters();
  for (Index k = 0; k < truth.size(); ++k) {
    const Estimate& e = with.fit.base[static_cast<std::size_t>(k)];
    EXPECT_NEAR(e.value, truth(k), 4.5 * e.sigma) << e.name;
  }
  EXPECT_EQ(with.fit.base.back().name, "m3.Ia");
  EXPECT_LT(with.fit.base.back().sigma, 0.01);
}

class CoupledLaw : public testing::TestWithParam<std::tuple<const char*, double, double>> {};

// Laws that start from samples of their own, and laws of load, which the motor has of what it transmits itself.
TEST_P(CoupledLaw, PredictsAnotherMotionAsWellAsTheNoiseLets) {
  const auto [law, stribeck_nm, per_load] = GetParam();
  CoupledWrist wrist;
  const auto with = fitted(wrist, wrist.coupled, wrist.recording(2, stribeck_nm, per_load), law);
  const auto unseen = wrist.recording(3, stribeck_nm, per_load);
  const auto motion = *prepare({&unseen, 1}, wrist.coupled);
  const MatrixXd predicted = predicted_torque(wrist.coupled, with.base, with.friction, with.fit.parameters, motion, 2);
  for (Index j = 0; j < 3; ++j) {
    double squares = 0, count = 0;
    for (Index i = 0; i < motion.size(); ++i)
      if (motion.moving(j, i)) squares += std::pow(predicted(j, i) - motion.torque(j, i), 2), ++count;
    ASSERT_GT(count, 30);
    EXPECT_LT(std::sqrt(squares / count), 0.06) << j;
  }
}

INSTANTIATE_TEST_SUITE_P(Laws, CoupledLaw,
                         testing::Values(std::tuple{"coulomb_viscous", 0.0, 0.0}, std::tuple{"stribeck", 0.8, 0.0},
                                         std::tuple{"coulomb_viscous_load", 0.0, 0.2}),
                         [](const auto& info) { return std::string(std::get<0>(info.param)); });

TEST(Coupling, AMotorsStribeckSpeedIsHeldAsThatOfAJoint) {
  CoupledWrist wrist;
  const auto with = fitted(wrist, wrist.coupled, wrist.recording(2, 0.8), "coulomb_viscous_stribeck");
  ASSERT_THAT(with.fit.friction, testing::SizeIs(4));
  for (std::size_t r = 0; r < 4; ++r) {
    const Estimate& vs = with.fit.friction[r][3];
    EXPECT_EQ(vs.name, "vs");
    EXPECT_EQ(vs.status, Status::held) << r;
    EXPECT_EQ(vs.value, with.friction[r].held(3)) << r;
  }
}

TEST(Coupling, IsInTheFileThatPredictReads) {
  CoupledWrist wrist;
  const auto with = fitted(wrist, wrist.coupled, wrist.recording(1), "coulomb_viscous");
  const auto file = std::filesystem::path(testing::TempDir()) / "coupled.yaml";
  std::ofstream(file) << to_yaml(
      with.fit, with.base, coulomb_viscous(), wrist.coupled,
      nearest_consistent(wrist.coupled, with.base, with.fit.parameters.base, with.fit.information),
      {.model = "wrist.xml", .torque_max_nm = {10, 10, 10}});
  const auto motors = read_coupling(file, wrist.plain);
  ASSERT_TRUE(motors) << motors.error().message;
  const auto regressor = Regressor::create(wrist.model->get(), *motors);
  ASSERT_TRUE(regressor) << regressor.error().message;
  const auto read = read_dynamics(file, *regressor, base_parameters(*regressor));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->parameters.base, with.fit.parameters.base);
  EXPECT_EQ(read->parameters.friction, with.fit.parameters.friction);
}

/// A recording with these names of its torque columns, in the order of `torque`'s rows.
std::filesystem::path written(const char* name, const RobotRecording& r, const MatrixXd& torque,
                              const std::vector<std::string>& names) {
  const auto file = std::filesystem::path(testing::TempDir()) / name;
  std::ofstream out(file);
  out << "time_s,position_yaw_rad,position_pitch_rad,position_roll_rad";
  for (const auto& n : names) out << fmt::format(",torque_{}_nm", n);
  out << '\n';
  for (std::size_t i = 0; i < r.time_s.size(); ++i) {
    out << fmt::format("{}", r.time_s[i]);
    for (Index j = 0; j < 3; ++j) out << fmt::format(",{}", r.position(j, static_cast<Index>(i)));
    for (Index j = 0; j < torque.rows(); ++j) out << fmt::format(",{}", torque(j, static_cast<Index>(i)));
    out << '\n';
  }
  return file;
}

TEST(Coupling, TorquesOfMotorsBecomeThoseOfJoints) {
  CoupledWrist wrist;
  const auto recording = wrist.recording(1);
  MatrixXd of_motors = recording.torque;
  of_motors.row(1) -= of_motors.row(2);
  const auto read = [&](const char* name, const MatrixXd& torque, const std::vector<std::string>& names) {
    return read_robot_recording(written(name, recording, torque, names), wrist.coupled);
  };
  const auto joints = read("joints.csv", recording.torque, {"yaw", "pitch", "roll"}),
             motors = read("motors.csv", of_motors, {"yaw", "pitch", "m3"});
  ASSERT_TRUE(joints && motors);
  EXPECT_EQ(joints->torque, recording.torque);
  EXPECT_TRUE(motors->torque.isApprox(recording.torque, 1e-12));

  MatrixXd both(4, of_motors.cols());
  both << of_motors, of_motors.row(2);
  const auto mixed = read("mixed.csv", both, {"yaw", "pitch", "roll", "m3"}),
             missing = read("missing.csv", of_motors.topRows(2), {"yaw", "m3"});
  ASSERT_FALSE(mixed || missing);
  EXPECT_THAT(mixed.error().message,
              testing::AllOf(testing::HasSubstr("mixed.csv:1: "), testing::HasSubstr("'torque_roll_nm'"),
                             testing::HasSubstr("'torque_m3_nm'")));
  EXPECT_THAT(missing.error().message, testing::HasSubstr("no column 'torque_pitch_nm'"));
}

}  // namespace
}  // namespace tribotwin::twin::identification
