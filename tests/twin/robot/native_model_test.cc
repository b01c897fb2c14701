// A model with drives as one of MuJoCo's own elements.
#include <cmath>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/robot/native_model.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;
const fs::path mjcf = fs::path(TRIBOTWIN_SOURCE_DIR) / "mjcf";

mujoco::ModelPtr compiled(const std::string& xml) {
  const auto model = mujoco::load_string(xml);
  if (!model) throw std::runtime_error(model.error().message);
  EXPECT_TRUE((*model)->drives().empty());
  return mujoco::ModelPtr(mj_copyModel(nullptr, (*model)->get()));
}

class Written : public testing::Test {
 protected:
  fs::path file = fs::temp_directory_path() / fmt::format("tribotwin_native_{}.xml", ::getpid());
  void write(std::string_view keys, std::string_view joint = "") {
    std::ofstream(file) << fmt::format(
        R"(<mujoco><option timestep="0.001" tolerance="1e-14" iterations="100"/>
  <extension><plugin plugin="tribotwin.drive"><instance name="j"><config key="law" value="stribeck"/>
    <config key="vs" value="10"/><config key="alpha" value="1.3"/><config key="torque_max_nm" value="100"/>
    <config key="gear_ratio" value="50"/>{}</instance></plugin></extension>
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="0.7" frictionloss="1" solreffriction=".001 1"
    solimpfriction=".9999 .9999 .001 .5 2" {}/><geom size="0.1" pos="0.5 0 0" mass="4"/></body></worldbody>
  <actuator><plugin name="d" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="3" gear="2"/></actuator>
  <keyframe><key name="up" qpos="0.3" {} ctrl="4"/></keyframe></mujoco>)",
        keys, joint, TRIBOTWIN_ENGINE_PLUGINS ? "act=\"1 2 3\"" : "");
  }
  ~Written() override { fs::remove(file); }
};

TEST_F(Written, ALinearLawIsMetExactly) {
  write(R"(<config key="Fc" value="0.03"/><config key="Fs" value="0"/><config key="Fv" value="0.0005"/>)",
        R"(damping="0.25")");
  const auto native = native_model(file, {}, 3);
  ASSERT_TRUE(native) << native.error().message;
  const NativeFriction& n = native->joints.at(0);
  EXPECT_EQ(n.joint, "hinge");
  EXPECT_NEAR(n.frictionloss_nm, 3, 1e-9);
  EXPECT_NEAR(n.damping_nm_s_rad, 0.0005 * 50 * 100, 1e-9);
  EXPECT_LT(n.max_error_nm, 1e-9);
  const auto m = compiled(native->xml);
  EXPECT_NEAR(m->dof_frictionloss[0], 3, 1e-9);
  EXPECT_NEAR(m->dof_damping[0], 2.5 + 0.25, 1e-9);
  EXPECT_EQ(m->na, 0);
  EXPECT_EQ(m->actuator_gear[0], 2);
  EXPECT_EQ(m->key_qpos[0], 0.3);
  EXPECT_EQ(m->key_ctrl[0], 4);
  EXPECT_THAT(native->xml, Not(HasSubstr("tribotwin")));

  // The same motion: the law takes the speed of the step's start, damping that of its end.
  const auto drives = mujoco::load_file(file).value();
  const auto ours = drives->make_data();
  const mujoco::DataPtr theirs(mj_makeData(m.get()));
  double largest = 0;
  for (int i = 0; i < 2000; ++i) {
    ours->ctrl[0] = theirs->ctrl[0] = -4 * std::sin(0.005 * i) - 9.8;
    drives->step(ours.get());
    mj_step(m.get(), theirs.get());
    largest = std::max(largest, std::abs(theirs->qpos[0]));
    ASSERT_NEAR(ours->qpos[0], theirs->qpos[0], 2e-3) << "step " << i;
  }
  EXPECT_GT(largest, 0.2);
}

TEST_F(Written, TheErrorIsThatOfTheFit) {
  write(R"(<config key="Fc" value="0.03"/><config key="Fs" value="0.06"/><config key="Fv" value="0.0005"/>)");
  const auto native = native_model(file, {}, 2);
  ASSERT_TRUE(native) << native.error().message;
  const NativeFriction& n = native->joints.at(0);
  const auto model = mujoco::load_file(file).value();
  double largest = 0;
  for (int i = 1; i <= 200; ++i) {
    const double qd = 0.01 * i;
    largest = std::max(largest, std::abs(mujoco::friction_nm(model->drives()[0].drive, qd, 0, 25) - n.frictionloss_nm -
                                         n.damping_nm_s_rad * qd));
  }
  EXPECT_GT(largest, 0.5);
  EXPECT_NEAR(n.max_error_nm, largest, 1e-9);
  EXPECT_LT(n.rms_error_nm, largest);
  EXPECT_THAT(native->xml, HasSubstr(fmt::format("{:.3g} Nm at most", largest)));
}

TEST_F(Written, MistakesAreNamed) {
  write(R"(<config key="Fc" value="0.03"/><config key="Fs" value="0"/><config key="Fv" value="0.0005"/>
           <config key="control" value="position"/><config key="kp" value="30"/>)");
  EXPECT_TRUE(native_model(file, {}, 3));
  EXPECT_THAT(native_model(file, {}, 3)->xml, HasSubstr("biasprm=\"0 -30"));
  write(R"(<config key="Fc" value="x"/>)");
  EXPECT_THAT(native_model(file, {}, 3).error().message, HasSubstr("'Fc'"));
}

TEST(NativeModel, EveryShippedRobotBecomesOne) {
  for (const char* name : {"br609", "er3a_c60", "irb6620", "rh380n_bench", "xl330_pendulum"}) {
    SCOPED_TRACE(name);
    const auto native = native_model(mjcf / (std::string(name) + ".xml"), {}, 1);
    ASSERT_TRUE(native) << native.error().message;
    const auto with = mujoco::load_file(mjcf / (std::string(name) + ".xml")).value();
    EXPECT_EQ(native->joints.size(), with->drives().size());
    const auto m = compiled(native->xml);
    EXPECT_EQ(m->nv, with->get()->nv);
    for (const NativeFriction& n : native->joints) {
      EXPECT_GT(n.frictionloss_nm + n.damping_nm_s_rad, 0);
      EXPECT_LE(n.rms_error_nm, n.max_error_nm);
      EXPECT_LT(n.max_error_nm, n.friction_max_nm);
    }
  }
  const auto bench = native_model(mjcf / "rh380n_bench.xml", 40, 1);
  const auto springs = mujoco::load_file(mjcf / "rh380n_bench.xml").value();
  EXPECT_NEAR(compiled(bench->xml)->tendon_stiffness[0], springs->springs()[0].hysteresis.stiffness(0, 40), 10);

  EXPECT_THAT(native_model(mjcf / "irb6620.xml", 300, {}).error().message,
              testing::AllOf(HasSubstr("joint '"), HasSubstr("not for 300 degC")));
  EXPECT_THAT(native_model(mjcf / "xl330_native.xml", {}, {}).error().message, HasSubstr("has no tribotwin.drive"));
}

}  // namespace
}  // namespace tribotwin::twin
