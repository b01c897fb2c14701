// Settings of the engine that change what a drive's motor gives or carries: each counts, or is refused by name.
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>

namespace tribotwin::mujoco {
namespace {

using testing::HasSubstr;

constexpr double mass_kg = 4, arm_m = 0.5, radius_m = 0.1;

/// A sphere on a hinge, driven, in a slow fall.
struct Arm {
  std::string option, joint, drive, actuators;

  Result<std::shared_ptr<const Model>> load() const {
    return load_string(fmt::format(
        R"(<mujoco><option timestep="0.001" tolerance="1e-14" iterations="100" {}/>
  <extension><plugin plugin="tribotwin.drive"><instance name="j"><config key="law" value="stribeck"/>
    <config key="Fc" value="0.03"/><config key="Fs" value="0.05"/><config key="vs" value="10"/>
    <config key="alpha" value="1.3"/><config key="Fv" value="0.0005"/><config key="torque_max_nm" value="100"/>
    <config key="gear_ratio" value="50"/></instance></plugin></extension>
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="0.7" frictionloss="1" solreffriction=".001 1"
    solimpfriction=".9999 .9999 .001 .5 2" {}/><geom type="sphere" size="{}" pos="{} 0 0" mass="{}"/></body></worldbody>
  <actuator>{}<plugin name="d" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="3" {}/></actuator>
  </mujoco>)",
        option, joint, radius_m, arm_m, mass_kg, actuators, drive));
  }
  std::string error() const {
    const auto model = load();
    return model ? "loaded" : model.error().message;
  }
};

/// Torque between gear and arm: what moves the sphere, computed from its motion.
double link_torque_nm(double q_rad, double acceleration) {
  const double inertia = mass_kg * (arm_m * arm_m + 0.4 * radius_m * radius_m);
  return inertia * acceleration - mass_kg * 9.81 * arm_m * std::cos(q_rad);
}

/// Largest error of the load over 100 steps, relative to the largest load.
void expect_true_load(const Arm& arm, double control = 12) {
  const auto model = arm.load();
  ASSERT_TRUE(model) << model.error().message;
  const DataPtr d = (*model)->make_data();
  const Binding& b = (*model)->drives()[0];
  double largest = 0, error = 0;
  for (int i = 0; i < 100; ++i) {
    d->ctrl[b.control] = control;
    const double q = d->qpos[0], before = d->qvel[0];
    (*model)->step(d.get());
    const double truth = link_torque_nm(q, (d->qvel[0] - before) / (*model)->get()->opt.timestep);
    largest = std::max(largest, std::abs(truth));
    error = std::max(error, std::abs(state(d.get(), b).load_nm - truth));
  }
  EXPECT_GT(largest, 1);
  EXPECT_LT(error, 1e-6 * largest);
}

TEST(Settings, TheLoadIsWhatMovesTheArm) {
  expect_true_load({});
  expect_true_load({.drive = R"(ctrllimited="true" ctrlrange="-8 8")"});
}

TEST(Settings, ANotANumberInTheControlIsNoTorque) {
  const auto model = Arm{}.load();
  ASSERT_TRUE(model) << model.error().message;
  const DataPtr d = (*model)->make_data();
  for (int i = 0; i < 10; ++i) {
    d->ctrl[0] = std::nan("");
    (*model)->step(d.get());
  }
  EXPECT_NEAR(d->time, 0.01, 1e-12) << "the engine reset the simulation";
  EXPECT_EQ(d->actuator_force[0], 0);
  EXPECT_GT(d->warning[mjWARN_BADCTRL].number, 0);
}

TEST(Settings, ASecondActuatorOnTheJointIsRefusedByName) {
  EXPECT_THAT(Arm{.actuators = R"(<position name="servo" joint="hinge" kp="100"/>)"}.error(),
              testing::AllOf(HasSubstr("joint 'hinge'"), HasSubstr("actuator 'servo'"), HasSubstr("remove")));
}

/// A chain of three joints whose drives have the instances that `actuators` names.
std::string chain(std::string_view instances, std::array<const char*, 3> of_actuators) {
  std::string bodies, ends, actuators;
  for (int j = 0; j < 3; ++j) {
    bodies += fmt::format(
        R"(<body pos="0 0 -.5"><joint name="joint{}" axis="0 1 0" armature="1" frictionloss="1"
           solreffriction=".001 1" solimpfriction=".9999 .9999 .001 .5 2"/>
           <geom type="capsule" size=".05" fromto="0 0 0 0 0 -.5" mass="4"/>)",
        j);
    ends += "</body>";
    actuators +=
        fmt::format(R"(<plugin name="drive{0}" joint="joint{0}" plugin="tribotwin.drive" instance="{1}" actdim="3"/>)",
                    j, of_actuators[static_cast<std::size_t>(j)]);
  }
  return fmt::format(
      R"(<mujoco><option timestep="0.001" tolerance="1e-14" iterations="100"/>
         <extension><plugin plugin="tribotwin.drive">{}</plugin><plugin plugin="tribotwin.sensor"/></extension>
         <worldbody>{}{}</worldbody><actuator>{}</actuator>
         <sensor><plugin name="friction" plugin="tribotwin.sensor" objtype="actuator" objname="drive2">
           <config key="quantity" value="friction"/></plugin></sensor></mujoco>)",
      instances, bodies, ends, actuators);
}

std::string instance(std::string_view name, std::string_view torque_max, std::string_view gear, std::string_view Fc) {
  return fmt::format(
      R"(<instance name="{}"><config key="law" value="stribeck"/><config key="Fc" value="{}"/>
         <config key="Fs" value="0.02"/><config key="vs" value="10"/><config key="alpha" value="1.3"/>
         <config key="Fv" value="0.0005"/><config key="torque_max_nm" value="{}"/><config key="gear_ratio" value="{}"/>
         <config key="thermal" value="first_order"/><config key="R_th" value="2"/><config key="kappa" value="600"/>
         <config key="T_amb" value="20"/></instance>)",
      name, Fc, torque_max, gear);
}

TEST(Settings, DrivesOfOneInstanceAreThoseOfSeveral) {
  const auto several = load_string(
      chain(instance("a", "100", "50", "0.03") + instance("b", "80", "60", "0.03") + instance("c", "30", "70", "0.05"),
            {"a", "b", "c"}));
  const auto one =
      load_string(chain(instance("arm", "100 80 30", " 50 60  70 ", "0.03 0.03 0.05"), {"arm", "arm", "arm"}));
  ASSERT_TRUE(several) << several.error().message;
  ASSERT_TRUE(one) << one.error().message;
  EXPECT_EQ((*one)->drives()[1].drive.name, "arm/joint1");
  const DataPtr d = (*several)->make_data(), e = (*one)->make_data();
  for (int i = 0; i < 1000; ++i) {
    for (int j = 0; j < 3; ++j) d->ctrl[j] = e->ctrl[j] = 30 * std::sin(0.003 * i + j);
    (*several)->step(d.get());
    (*one)->step(e.get());
  }
  for (int j = 0; j < 3; ++j) {
    EXPECT_EQ(d->qpos[j], e->qpos[j]);
    const std::size_t k = static_cast<std::size_t>(j);
    EXPECT_EQ(workspace(d.get(), (*several)->drives()[k]).friction_work_J,
              workspace(e.get(), (*one)->drives()[k]).friction_work_J);
    EXPECT_GT(workspace(e.get(), (*one)->drives()[k]).friction_work_J, 0.01);
  }
  EXPECT_EQ(d->sensordata[0], e->sensordata[0]);
  EXPECT_EQ(e->sensordata[0], workspace(e.get(), (*one)->drives()[2]).friction_nm);

  mj_resetData((*one)->get(), e.get());
  for (const Binding& b : (*one)->drives()) EXPECT_EQ(workspace(e.get(), b).friction_work_J, 0);

  const auto wrong = load_string(chain(instance("arm", "100 80", "50", "0.03"), {"arm", "arm", "arm"}));
  ASSERT_FALSE(wrong);
  EXPECT_THAT(wrong.error().message,
              testing::AllOf(HasSubstr("<instance name=\"arm\">"), HasSubstr("key 'torque_max_nm' has 2 values"),
                             HasSubstr("must have 1 for all or 3")));
}

/// A pendulum on a servo, MuJoCo's own or that of a drive without friction; 2 s of a moving set point.
std::vector<double> servo(std::string_view extension, std::string_view actuator) {
  const auto model = load_string(fmt::format(
      R"(<mujoco><option timestep="0.001" tolerance="1e-14" iterations="100"/>{}
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="0.7" frictionloss="1e-12" solreffriction=".001 1"
    solimpfriction=".9999 .9999 .001 .5 2"/><geom type="sphere" size="0.1" pos="0.5 0 0" mass="4"/></body></worldbody>
  <actuator>{}</actuator></mujoco>)",
      extension, actuator));
  if (!model) return ADD_FAILURE() << model.error().message, std::vector<double>{};
  const DataPtr d = (*model)->make_data();
  std::vector<double> out;
  for (int i = 0; i < 2000; ++i) {
    d->ctrl[0] = 2 * std::sin(0.004 * i);
    (*model)->step(d.get());
    out.insert(out.end(), {d->qpos[0], d->actuator_force[0]});
  }
  return out;
}

TEST(Settings, APositionControlIsThatOfTheEngine) {
  constexpr char extension[] =
      R"(<extension><plugin plugin="tribotwin.drive"><instance name="j"><config key="law" value="stribeck"/>
         <config key="Fc" value="0"/><config key="Fs" value="0"/><config key="vs" value="10"/>
         <config key="alpha" value="1"/><config key="Fv" value="0"/><config key="torque_max_nm" value="100"/>
         <config key="gear_ratio" value="50"/><config key="control" value="position"/><config key="kp" value="300"/>
         <config key="kv" value="20"/></instance></plugin></extension>)";
  for (const char* given :
       {"", R"(gear="2")", R"(ctrllimited="true" ctrlrange="-1 1.2")", R"(forcelimited="true" forcerange="-60 80")"}) {
    const auto ours = servo(
        extension,
        fmt::format(R"(<plugin name="d" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="3" {}/>)", given));
    const auto engine = servo(
        "", fmt::format(R"(<general name="d" joint="hinge" gainprm="300" biastype="affine" biasprm="0 -300 -20" {}/>)",
                        given));
    ASSERT_EQ(ours.size(), engine.size());
    double largest = 0;
    for (std::size_t i = 0; i < ours.size(); ++i) largest = std::max(largest, std::abs(ours[i] - engine[i]));
    EXPECT_LT(largest, 1e-7) << given;
  }
}

TEST(Settings, KeysOfAPositionControlGoTogether) {
  const auto error = [](drive::Configuration keys) {
    drive::Configuration all{
        {"law", "stribeck"},    {"Fc", "1"},        {"Fs", "1"}, {"vs", "1"}, {"alpha", "1"}, {"Fv", "0"},
        {"torque_max_nm", "1"}, {"gear_ratio", "1"}};
    all.insert(all.end(), keys.begin(), keys.end());
    const auto drive = drive::make_drive("j", all);
    return drive ? "accepted" : drive.error().message;
  };
  EXPECT_EQ(error({{"control", "position"}, {"kp", "3"}}), "accepted");
  EXPECT_THAT(error({{"control", "position"}}), HasSubstr("key 'kp' must be above 0"));
  EXPECT_THAT(error({{"kp", "3"}}), HasSubstr("belong to control 'position'"));
  EXPECT_THAT(error({{"control", "speed"}}), HasSubstr("must be torque or position"));
}

#if TRIBOTWIN_ENGINE_PLUGINS
TEST(Settings, OfTodaysEnginesCountInTheLoad) {
  expect_true_load({.joint = R"(actuatorfrclimited="true" actuatorfrcrange="-8 8")"});
  expect_true_load({.drive = R"(forcelimited="true" forcerange="-8 8")"});
#if mjVERSION_HEADER >= 3007000
  expect_true_load({.drive = R"(armature="0.4")"});
  expect_true_load({.drive = R"(armature="0.4" gear="3")"});
#endif
#if mjVERSION_HEADER >= 3005000
  expect_true_load({.drive = R"(nsample="20" delay="0.01")"});
#endif
  expect_true_load({.option = R"(actuatorgroupdisable="2")", .drive = R"(group="2")"});
}

TEST(Settings, ADisabledGroupGivesNoTorqueAndKeepsItsFriction) {
  const auto model = Arm{.option = R"(actuatorgroupdisable="2")", .drive = R"(group="2")"}.load();
  ASSERT_TRUE(model) << model.error().message;
  const DataPtr d = (*model)->make_data();
  for (int i = 0; i < 100; ++i) {
    d->ctrl[0] = 12;
    (*model)->step(d.get());
  }
  EXPECT_EQ(d->actuator_force[0], 0);
  EXPECT_GT(workspace(d.get(), (*model)->drives()[0]).friction_nm, 1);
}

#if mjVERSION_HEADER >= 3005000
TEST(Settings, ADelayedControlComesLate) {
  const auto model = Arm{.drive = R"(nsample="20" delay="0.01")"}.load();
  ASSERT_TRUE(model) << model.error().message;
  const DataPtr d = (*model)->make_data();
  for (int i = 0; i < 5; ++i) {
    d->ctrl[0] = 12;
    (*model)->step(d.get());
  }
  EXPECT_EQ(d->actuator_force[0], 0);
  for (int i = 0; i < 20; ++i) (*model)->step(d.get());
  EXPECT_EQ(d->actuator_force[0], 12);
}
#endif

TEST(Settings, OptionsChangedAtRunTimeAreCheckedAgain) {
  const auto loaded = Arm{}.load();
  ASSERT_TRUE(loaded) << loaded.error().message;
  const ModelPtr m(mj_copyModel(nullptr, (*loaded)->get()));
  const DataPtr d(mj_makeData(m.get()));
  mj_step(m.get(), d.get());
  m->opt.timestep = 0.0005;
  m->opt.integrator = mjINT_RK4;
  mj_step(m.get(), d.get());
  EXPECT_NEAR(d->time, 0.0015, 1e-12);
  mju_user_error = [](const char* text) { throw std::runtime_error(text); };
  const auto said = [&] {
    try {
      mj_step(m.get(), d.get());
    } catch (const std::runtime_error& e) {
      return std::string(e.what());
    }
    return std::string("nothing");
  };
  m->opt.disableflags |= mjDSBL_FRICTIONLOSS;
  EXPECT_THAT(said(), testing::AllOf(HasSubstr("drive 'j'"), HasSubstr("frictionloss"), HasSubstr("stay enabled")));
  m->opt.disableflags = 0;
  m->opt.tolerance = 1e-3;
  EXPECT_THAT(said(), testing::AllOf(HasSubstr("drive 'j'"), HasSubstr("tolerance")));
  mju_user_error = nullptr;
}

TEST(Settings, GravityCompensationByTheActuatorIsRefused) {
  EXPECT_THAT(Arm{.joint = R"(actuatorgravcomp="true")"}.error(),
              testing::AllOf(HasSubstr("joint 'hinge'"), HasSubstr("actuatorgravcomp")));
}
#endif

}  // namespace
}  // namespace tribotwin::mujoco
