// Robots of other people get drives; what the engine makes of the result is compared with what went in.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/twin/gears/add_drives.hpp>
#include <tribotwin/twin/gears/drive_elements.hpp>
#include <tribotwin/twin/gears/starter_scenario.hpp>
#include <tribotwin/twin/robot/starting_points.hpp>
#include <tribotwin/twin/simulation/run.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

/// An arm of two links, whose joints and actuators a test puts in.
constexpr const char* arm = R"(<mujoco model="arm"><compiler angle="radian" autolimits="true"/>
  <default><joint damping="3" frictionloss="0.7"/>
    <general forcerange="-40 40" ctrlrange="-6.28 6.28" gainprm="200" biastype="affine" biasprm="0 -200 -10"/></default>
  <worldbody><body name="one" pos="0 0 1"><joint name="lift" {0}/>
    <geom size=".05" fromto="0 0 0 .4 0 0" type="capsule"/>
    <body name="two" pos=".4 0 0"><joint {1}/><geom size=".04" fromto="0 0 0 .3 0 0" type="capsule"/></body></body>
  </worldbody>{2}</mujoco>)";

class AddDrivesTest : public testing::Test {
 protected:
  fs::path folder = fs::temp_directory_path() / fmt::format("tribotwin_add_{}", ::getpid());
  AddDrivesTest() { fs::create_directories(folder / "parts"); }
  ~AddDrivesTest() override { fs::remove_all(folder); }
  fs::path write(const std::string& name, const std::string& text) {
    std::ofstream(folder / name) << text;
    return folder / name;
  }
  fs::path two_links(const std::string& first, const std::string& second, const std::string& rest) {
    return write("arm.xml", fmt::format(fmt::runtime(arm), first, second, rest));
  }
  std::string refusal(const fs::path& file, const AddDrives& choice = {}) {
    const auto robot = add_drives(file, choice, folder);
    EXPECT_FALSE(robot);
    return robot ? "" : robot.error().message;
  }
};

constexpr const char* position_pair = R"(<actuator><position name="p1" joint="lift" kp="50" forcerange="-30 20"/>
  <general name="g2" joint="elbow"/></actuator>
  <keyframe><key name="up" qpos="-.5 .3" ctrl="-.5 .3"/></keyframe>)";

TEST_F(AddDrivesTest, OverridesWhatDefaultClassesSay) {
  const auto robot = add_drives(two_links("axis='0 1 0'", "name='elbow' axis='0 1 0'", position_pair), {}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  const mjModel* m = robot->model->get();
  ASSERT_EQ(robot->model->drives().size(), 2u);
  EXPECT_EQ(m->nu, 2);
  EXPECT_STREQ(mj_id2name(m, mjOBJ_ACTUATOR, 0), "p1");
  EXPECT_STREQ(mj_id2name(m, mjOBJ_ACTUATOR, 1), "g2");
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(m->dof_damping[i], 0);
    EXPECT_EQ(m->dof_frictionloss[i], 1);
    EXPECT_FALSE(m->actuator_forcelimited[i]);
    EXPECT_GT(m->dof_armature[i], 0);
    EXPECT_EQ(m->actuator_gear[6 * i], 1);
  }
  EXPECT_EQ(m->actuator_ctrlrange[0], -30);
  EXPECT_EQ(m->actuator_ctrlrange[1], 20);
  EXPECT_EQ(m->actuator_ctrlrange[3], 40);
  EXPECT_EQ(robot->drives[0].removed_damping, 3);
  EXPECT_EQ(robot->drives[0].removed_frictionloss, 0.7);
  EXPECT_EQ(robot->drives[0].replaced, "position");
  EXPECT_EQ(robot->drives[1].effort_source, "forcerange");
  EXPECT_THAT(robot->mjcf, HasSubstr("starting points"));
}

TEST_F(AddDrivesTest, KeyframesHoldTheirPose) {
  const auto robot = add_drives(two_links("axis='0 1 0'", "name='elbow' axis='0 1 0'", position_pair), {}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  const mjModel* m = robot->model->get();
  const auto d = robot->model->make_data();
  mj_resetDataKeyframe(m, d.get(), 0);
  EXPECT_EQ(d->qpos[0], -0.5);
  for (int i = 0; i < 2000; ++i) robot->model->step(d.get());
  EXPECT_NEAR(d->qpos[0], -0.5, 1e-4);
  EXPECT_NEAR(d->qpos[1], 0.3, 1e-4);
}

TEST_F(AddDrivesTest, AMotorsControlBecomesTorque) {
  const auto robot = add_drives(
      two_links(
          "axis='0 1 0'", "name='elbow' axis='0 1 0'",
          R"(<actuator><motor name="m" joint="elbow" gear="50" ctrlrange="-.5 .5" forcelimited="false"/></actuator>)"),
      {}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  ASSERT_EQ(robot->drives.size(), 1u);  // the other joint has no actuator
  EXPECT_EQ(robot->drives[0].joint, "elbow");
  EXPECT_EQ(robot->drives[0].effort_nm, 25);
  EXPECT_EQ(robot->model->get()->actuator_ctrlrange[1], 25);
}

TEST_F(AddDrivesTest, JointsWithoutNamesOrActuatorsGetBoth) {
  const auto robot = add_drives(two_links("axis='0 1 0' range='-1 1'", "axis='0 1 0'", ""), {}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  ASSERT_EQ(robot->drives.size(), 2u);
  EXPECT_EQ(robot->drives[1].joint, "joint2");
  EXPECT_THAT(robot->drives[0].effort_source, HasSubstr("estimated"));
  const mjModel* m = robot->model->get();
  // One and a half times what the stretched arm weighs, at least.
  const auto d = robot->model->make_data();
  mj_forward(m, d.get());
  EXPECT_GE(robot->drives[0].effort_nm, 1.5 * std::abs(d->qfrc_bias[0]));
}

TEST_F(AddDrivesTest, OneDriveTakesThePlaceOfSeveralActuators) {
  const auto robot = add_drives(two_links("axis='0 1 0'", "name='elbow' axis='0 1 0'",
                                          R"(<actuator><position name="p" joint="lift" kp="9"/>
    <velocity name="v" joint="lift" kv="2"/><motor name="m" joint="elbow" ctrlrange="-9 9"/></actuator>
    <keyframe><key qpos="0 0" ctrl="0 0 4"/></keyframe>)"),
                                AddDrives{.joints = {{"lift", ""}}}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  const mjModel* m = robot->model->get();
  ASSERT_EQ(m->nu, 2);
  EXPECT_STREQ(mj_id2name(m, mjOBJ_ACTUATOR, 1), "m");
  EXPECT_EQ(m->key_ctrl[1], 4);
  EXPECT_THAT(robot->notes, Contains(HasSubstr("'v' is gone as well")));
}

TEST_F(AddDrivesTest, AssetsAndIncludesAreFoundFromTheNewFolder) {
  const std::string obj = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
  write("parts/link.obj", obj);
  write("parts.xml",
        R"(<mujoco><compiler meshdir="parts"/><asset><mesh name="link" file="link.obj"/></asset></mujoco>)");
  const auto file = write("arm.xml", R"(<mujoco><include file="parts.xml"/><worldbody><body>
    <joint name="j" axis="0 1 0"/><geom type="mesh" mesh="link" pos=".2 0 0"/></body></worldbody></mujoco>)");
  fs::create_directories(folder / "out/deep");
  const auto robot = add_drives(file, {}, folder / "out/deep");
  ASSERT_TRUE(robot) << robot.error().message;
  EXPECT_THAT(robot->mjcf, HasSubstr("../../parts\""));
  EXPECT_THAT(robot->mjcf, Not(HasSubstr(folder.string())));
  std::ofstream(folder / "out/deep/robot.xml") << robot->mjcf;
  const auto again = mujoco::load_file(folder / "out/deep/robot.xml");
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ((*again)->get()->nmesh, 1);
  EXPECT_EQ(robot->files.size(), 2u);
}

TEST_F(AddDrivesTest, AUrdfGivesEffortSpeedAndScene) {
  const auto robot = add_drives(fs::path(TRIBOTWIN_SOURCE_DIR) / "tests/twin/gears/arm.urdf", {}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  ASSERT_EQ(robot->drives.size(), 3u);
  EXPECT_EQ(robot->drives[0].effort_nm, 60);
  EXPECT_EQ(robot->drives[0].removed_damping, 0.5);
  EXPECT_EQ(robot->drives[1].parameters, "harmonic_130");
  EXPECT_EQ(robot->drives[1].speed_max_rad_s, 1.2);
  EXPECT_TRUE(robot->drives[2].slide);
  EXPECT_EQ(robot->drives[2].parameters, "ball_screw_1000, scaled by 0.4 from 1000 N");
  EXPECT_EQ(robot->model->get()->nlight, 1);
  EXPECT_THAT(robot->notes, Contains(HasSubstr("floor")));
}

/// arm.urdf with other efforts, and masses that are all alike.
std::string arm_urdf(const std::string& effort, bool equal_masses) {
  std::ifstream file(fs::path(TRIBOTWIN_SOURCE_DIR) / "tests/twin/gears/arm.urdf");
  std::string text(std::istreambuf_iterator<char>(file), {});
  const auto replace = [&](const std::string& from, const std::string& to) {
    ASSERT_NE(text.find(from), text.npos) << from;
    text.replace(text.find(from), from.size(), to);
  };
  for (const char* given : {"60", "130", "400"})
    if (!effort.empty()) replace(fmt::format("effort=\"{}\"", given), effort);
  for (const char* mass : {"6", "4"})
    if (equal_masses) replace(fmt::format("mass value=\"{}\"", mass), "mass value=\"2\"");
  return text;
}

PerJoint efforts(const std::vector<std::string>& texts) { return PerJoint::of("--effort", texts).value(); }

TEST_F(AddDrivesTest, EffortsThatAreGuessedAndGearsThatDoNotFitAreNamed) {
  struct {
    std::string effort;
    bool equal_masses;
    AddDrives choice;
    std::vector<std::string> says;  ///< one for each warning
  } const cases[] = {
      {"", false, {}, {}},
      {"effort=\"0\"",
       true,
       {},
       {"guess by gravity and inertia of masses that are all 2 kg: turntable ",
        "hardly a guess: turntable (harmonic_30, scaled by 0.247 from 30 Nm)"}},
      {"effort=\"inf\"", false, {.joints = {{"shoulder", ""}}}, {"guess by gravity and inertia: shoulder "}},
      {"", false, {.joints = {{"shoulder", "xl330"}}}, {"the gear is too small", "gravity alone needs up to 20"}},
      {"",
       false,
       {.joints = {{"shoulder", "harmonic_130"}}, .effort_nm = efforts({"shoulder=4000"})},
       {"harmonic_130 is made for 130 Nm, but the joint's effort is 4000 Nm (given)"}},
      {"",
       false,
       {.joints = {{"shoulder", "harmonic"}}, .effort_nm = efforts({"shoulder=4000"})},
       {"hardly a guess: shoulder (harmonic_345, scaled by 11.6 from 345 Nm)"}},
      {"", false, {.joints = {{"shoulder", ""}}, .effort_nm = efforts({"20"})}, {"its effort is 20 Nm; choose"}},
  };
  for (const auto& c : cases) {
    const auto robot = add_drives(write("arm.urdf", arm_urdf(c.effort, c.equal_masses)), c.choice, folder);
    ASSERT_TRUE(robot) << robot.error().message;
    EXPECT_EQ(robot->warnings.size(), c.says.size()) << testing::PrintToString(robot->warnings);
    for (std::size_t i = 0; i < std::min(c.says.size(), robot->warnings.size()); ++i)
      EXPECT_THAT(robot->warnings[i], HasSubstr(c.says[i]));
  }
}

/// MuJoCo 2.2.2 ends the program on it.
TEST_F(AddDrivesTest, AUrdfWithAnUnknownTypeOfJointIsRefused) {
  std::string urdf = arm_urdf("effort=\"100\"", false);
  urdf.replace(urdf.find("\"revolute\""), 10, "\"revolut\x7F\"");
  EXPECT_THAT(
      refusal(write("arm.urdf", urdf), {}),
      AllOf(HasSubstr("arm.urdf:"), HasSubstr("type 'revolut\\x7f' of joint 'turntable' is not known: revolute,"),
            HasSubstr("did you mean 'revolute'?")));
}

TEST_F(AddDrivesTest, AnEffortThatIsGivenReplacesTheModels) {
  const auto file = write("arm.urdf", arm_urdf("effort=\"0\"", true));
  const auto robot = add_drives(file, {.effort_nm = efforts({"80", "shoulder=150"})}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  EXPECT_EQ(robot->drives[0].effort_nm, 80);
  EXPECT_EQ(robot->drives[1].effort_nm, 150);
  EXPECT_EQ(robot->model->get()->actuator_ctrlrange[3], 150);
  EXPECT_THAT(refusal(file, {.effort_nm = efforts({"elbow=80"})}),
              AllOf(HasSubstr("--effort elbow=80"), HasSubstr("turntable, shoulder, telescope")));
}

/// The model says which of its parameters nobody measured.
TEST_F(AddDrivesTest, StartingPointsAreMarked) {
  const auto file = fs::path(TRIBOTWIN_SOURCE_DIR) / "tests/twin/gears/arm.urdf";
  const auto robot = add_drives(file, {}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  EXPECT_EQ(starting_point(*robot->model, robot->model->drives()[0]), robot->drives[0].parameters);
  identification::ParameterFile parameters{.law = friction::published_law("extended").value()};
  const auto known = add_drives(file, {.identified = {{"shoulder", "p.yaml", parameters}}}, folder);
  ASSERT_TRUE(known) << known.error().message;
  EXPECT_EQ(starting_point(*known->model, known->model->drives()[1]), "");
  EXPECT_NE(starting_point(*known->model, known->model->drives()[2]), "");
}

TEST_F(AddDrivesTest, AFloatingBaseCanBeFixed) {
  const std::string text = R"(<mujoco><worldbody><body name="trunk" pos="0 0 .5"><freejoint/><geom size=".1"/>
    <body pos=".1 0 0"><joint name="hip" axis="0 1 0" range="-60 60" limited="true"/>
    <geom size=".02" pos="0 0 -.2" mass=".5"/></body></body></worldbody>
    <actuator><motor name="hip" joint="hip" ctrllimited="true" ctrlrange="-20 20"/></actuator>
    <keyframe><key qpos="0 0 .5 1 0 0 0 .3" ctrl="0"/></keyframe></mujoco>)";
  const auto file = write("leg.xml", text);
  const auto floats = add_drives(file, {}, folder);
  ASSERT_TRUE(floats) << floats.error().message;
  EXPECT_THAT(floats->drives[0].parameters, HasSubstr("planetary"));
  EXPECT_THAT(starter_scenario(*floats, "x.xml").error().message, HasSubstr("--fix-base"));
  const auto fixed = add_drives(file, AddDrives{.fix_base = true}, folder);
  ASSERT_TRUE(fixed) << fixed.error().message;
  EXPECT_EQ(fixed->model->get()->nq, 1);
  EXPECT_EQ(fixed->model->get()->key_qpos[0], 0.3);
  EXPECT_TRUE(starter_scenario(*fixed, "x.xml"));
}

TEST_F(AddDrivesTest, NeighboursThatOverlapDoNotCollide) {
  const auto file =
      write("arm.xml", R"(<mujoco><worldbody><body name="base"><geom size=".2"/><body name="link" pos="0 0 .1">
    <joint name="j" axis="0 1 0"/><geom size=".2"/></body></body></worldbody></mujoco>)");
  const auto robot = add_drives(file, {}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  const auto d = robot->model->make_data();
  mj_forward(robot->model->get(), d.get());
  EXPECT_EQ(d->ncon, 0);
  EXPECT_THAT(robot->notes, Contains(HasSubstr("'base' and 'link' overlap")));
}

TEST_F(AddDrivesTest, NonsenseIsRefusedWithPlaceAndRemedy) {
  const std::string body = "<body><joint name='j' {}/><geom size='.1' pos='.1 0 0'/></body>";
  const auto model = [&](const std::string& joint, const std::string& rest) {
    return write("m.xml",
                 "<mujoco><worldbody>" + fmt::format(fmt::runtime(body), joint) + "</worldbody>" + rest + "</mujoco>");
  };
  EXPECT_THAT(refusal(write("m.xml", "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")),
              AllOf(HasSubstr("m.xml"), HasSubstr("no joints")));
  EXPECT_THAT(refusal(model("type='ball'", "")), HasSubstr("neither hinges nor slides"));
  EXPECT_THAT(refusal(model("type='ball'", ""), {.joints = {{"j", ""}}}), HasSubstr("is a ball joint"));
  EXPECT_THAT(refusal(model("", ""), {.joints = {{"k", ""}}}), AllOf(HasSubstr("no joint 'k'"), HasSubstr(" j")));
  EXPECT_THAT(refusal(model("", ""), {.joints = {{"j", "harmonik"}}}), HasSubstr("did you mean 'harmonic'"));
  EXPECT_THAT(refusal(model("type='slide'", ""), {.joints = {{"j", "harmonic"}}}), HasSubstr("is for hinges"));
  EXPECT_THAT(refusal(model("", ""), {.joints = {{"j", ""}, {"j", ""}}}), HasSubstr("twice"));
  const std::string tendon =
      "<tendon><fixed name='t'><joint joint='j' coef='1'/></fixed></tendon>"
      "<actuator><position name='pull' tendon='t'/></actuator>";
  EXPECT_THAT(refusal(model("", tendon)), HasSubstr("through tendons"));
  EXPECT_THAT(refusal(model("", tendon), {.joints = {{"j", ""}}}), HasSubstr("'pull' through a tendon"));
  EXPECT_THAT(refusal(write("m.xml", "<mujoco><worldbody>")), HasSubstr("not well-formed"));
  EXPECT_THAT(refusal(write("m.xml", "<sdf/>")), HasSubstr("its root is <sdf>"));
  EXPECT_THAT(refusal(fs::path(TRIBOTWIN_SOURCE_DIR) / "mjcf/irb6620.xml"), HasSubstr("has drives already"));
  EXPECT_THAT(refusal(write("m.xml", "<mujoco><option integrator='no_such'/></mujoco>")), HasSubstr("m.xml:1"));
  if (!TRIBOTWIN_ENGINE_PLUGINS)
    EXPECT_THAT(refusal(write("m.xml", "<mujoco><option integrator='implicitfast'/></mujoco>")),
                HasSubstr("needs MuJoCo 2.3.3 or newer"));
}

TEST_F(AddDrivesTest, LimitsFollowFromRangesAsInNewerEngines) {
  const auto robot = add_drives(write("m.xml", R"(<mujoco><worldbody><body><joint name="j" range="-60 60"/>
    <geom size=".1" pos=".1 0 0"/></body></worldbody></mujoco>)"),
                                {}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  EXPECT_TRUE(robot->model->get()->jnt_limited[0]);
}

/// The demonstration: the first hour of work, cut to two minutes of every step.
TEST_F(AddDrivesTest, TheFirstWorkKeepsItsEnergyAndItsTorques) {
  const auto robot = add_drives(fs::path(TRIBOTWIN_SOURCE_DIR) / "tests/twin/gears/arm.urdf", {}, folder);
  ASSERT_TRUE(robot) << robot.error().message;
  std::ofstream(folder / "robot.xml") << robot->mjcf;
  const auto work = starter_scenario(*robot, "robot.xml");
  ASSERT_TRUE(work) << work.error().message;
  std::ofstream(folder / "robot.yaml") << *work;
  auto scenario = load_scenario(folder / "robot.yaml", {"multirate.enabled=false", "duration_s=120"});
  ASSERT_TRUE(scenario) << scenario.error().message;
  Twin twin(std::move(*scenario));
  double largest_share = 0;
  const mjModel* m = robot->model->get();
  while (twin.step() == Status::running)
    for (int i = 0; i < 3; ++i)
      largest_share = std::max(largest_share, std::abs(twin.data()->ctrl[i]) / m->actuator_ctrlrange[2 * i + 1]);
  EXPECT_LT(largest_share, 0.95);
  EXPECT_GT(largest_share, 0.05);
  double friction_work_J = 0;
  for (std::size_t i = 0; i < 3; ++i) friction_work_J += twin.drive(i).friction_work_J;
  EXPECT_GT(friction_work_J, 10);
  EXPECT_LT(std::abs(twin.balance_J()), 1e-3 * friction_work_J);
}

TEST(DriveElements, AreWhatAModelLoads) {
  const auto law = friction::published_law("extended");
  ASSERT_TRUE(law) << law.error().message;
  drive::Drive drive;
  drive.law = *law;
  drive.torque_max_nm = 100;
  drive.gear_ratio = 50;
  std::string text = drive_elements("elbow", drive);
  const std::string body = "<body>";
  text.insert(text.find(body) + body.size(),
              "<geom size='.1' pos='.3 0 0' mass='9'/><inertial pos='.1 0 0' mass='9' "
              "diaginertia='1 1 1'/>");
  const auto model = mujoco::load_string(text);
  ASSERT_TRUE(model) << model.error().message << text;
  ASSERT_EQ((*model)->drives().size(), 1u);
  EXPECT_EQ((*model)->get()->actuator_ctrlrange[1], 100);
}

}  // namespace
}  // namespace tribotwin::twin
