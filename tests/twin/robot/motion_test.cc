#include <cmath>
#include <numbers>

#include <gmock/gmock.h>

#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/motion.hpp>

namespace tribotwin::twin {
namespace {

/// Largest |position change - integral of speed| and the largest speed over a motion.
void expect_consistent(const Motion& motion, std::span<const double> speed_limit) {
  std::vector<SetPoint> now(motion.joints()), before(motion.joints());
  const double dt = 1e-3;
  motion.at(0, before);
  for (double t = dt; t < motion.duration_s() + 1; t += dt) {
    motion.at(t, now);
    for (std::size_t j = 0; j < now.size(); ++j) {
      ASSERT_NEAR(now[j].position_rad - before[j].position_rad,
                  0.5 * (now[j].velocity_rad_s + before[j].velocity_rad_s) * dt, 2e-5)
          << t;
      ASSERT_LE(std::abs(now[j].velocity_rad_s), speed_limit[j] * (1 + 1e-12));
    }
    before = now;
  }
}

TEST(Motion, TrapezoidsAreContinuousAndKeepTheirLimits) {
  Motion motion({0, 0});
  const std::vector<double> speed{1, 2}, acceleration{4, 3};
  motion.move_to({1, -3}, speed, acceleration)
      .dwell(0.3)
      .move_to({1.001, 0}, speed, acceleration)
      .move_to({0, 0}, speed, acceleration);
  expect_consistent(motion, speed);
  std::vector<SetPoint> end(2);
  motion.at(motion.duration_s(), end);
  EXPECT_EQ(end[0].position_rad, 0);
}

TEST(Motion, RepetitionIsAWholeNumberOfSteps) {
  Motion motion = back_and_forth({0.2}, 0, 1, 0.7, 3, 0.1);
  motion.repeat(1e-3);
  EXPECT_NEAR(std::remainder(motion.period_s(), 1e-3), 0, 1e-9);
  std::vector<SetPoint> a(1), b(1);
  for (const double t : {0.0, 0.3, 1.1}) {
    motion.at(t, a);
    motion.at(t + 5 * motion.period_s(), b);
    EXPECT_NEAR(a[0].position_rad, b[0].position_rad, 1e-9);
  }
}

TEST(Motion, TestCycleRunsPaperTwosLevels) {
  constexpr double deg = std::numbers::pi / 180;
  const std::size_t joints[] = {0};
  const Motion motion = test_cycle({0}, joints, 400 * deg, 0.2);
  std::vector<double> time(15, 0);
  const double levels[] = {.1, .5, 1, 1.5, 2, 3, 5, 8, 10, 15, 30, 45, 60, 80, 100};
  std::vector<SetPoint> at(1);
  for (double t = 0; t < motion.duration_s(); t += 1e-3) {
    motion.at(t, at);
    for (int i = 0; i < 15; ++i)
      if (std::abs(at[0].velocity_rad_s - levels[i] * deg) < 1e-9) time[static_cast<std::size_t>(i)] += 1e-3;
  }
  // Zhou 2024, Table 1: sampling times 20 12 15 10 15 10 12 15 12 12 8 8 6 4.5 3.6 s are travel over speed.
  const double expected[] = {20, 12, 15, 10, 15, 10, 12, 15, 12, 12, 8, 8, 6, 4.5, 3.6};
  for (std::size_t i = 0; i < 15; ++i)
    if (levels[i] != 60) EXPECT_NEAR(time[i], expected[i], 0.3) << levels[i];  // 60 deg/s is the approach speed too
}

TEST(Arm, GravityTorqueIsTheEnginesBias) {
  for (const char* name : {"irb6620", "br609", "er3a_c60"}) {
    const auto model = mujoco::load_file(std::string(TRIBOTWIN_SOURCE_DIR "/mjcf/") + name + ".xml").value();
    const auto loaded = with_payload(*model, {.mass_kg = 3, .com_m = {0.05, 0.02, 0.1}}).value();
    for (const auto& m : {model, loaded}) {
      const mujoco::DataPtr d = m->make_data();
      for (int k = 0; k < 20; ++k) {
        for (int j = 0; j < (*m)->nq; ++j) d->qpos[j] = std::sin(3.1 * k + 1.7 * j);
        mj_forward(m->get(), d.get());
        for (const auto& drive : m->drives())
          EXPECT_NEAR(gravity_torque_nm(m->get(), d.get(), drive.dof), d->qfrc_bias[drive.dof],
                      1e-8 * (1 + std::abs(d->qfrc_bias[drive.dof])));
      }
    }
    EXPECT_NEAR((*loaded)->body_subtreemass[0] - (*model)->body_subtreemass[0], 3, 1e-9);
  }
  EXPECT_THAT(
      with_payload(*mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/br609.xml").value(), {.mass_kg = -1}).error().message,
      testing::HasSubstr("0 or more"));
}

TEST(Arm, PayloadMovesLikeABodyOfItsOwn) {
  const auto xml = [](const char* extra) {
    return std::string(R"(<mujoco><option timestep="0.001" tolerance="1e-12"/>
  <extension><plugin plugin="tribotwin.drive"><instance name="j"><config key="law" value="stribeck"/>
    <config key="Fc" value="0.01"/>
    <config key="Fs" value="0"/><config key="Fv" value="0"/><config key="vs" value="1"/><config key="alpha" value="1"/>
    <config key="torque_max_nm" value="100"/><config key="gear_ratio" value="1"/></instance></plugin></extension>
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="1" frictionloss="1"
    solreffriction=".001 1" solimpfriction=".9999 .9999 .001 .5 2"/>
    <inertial pos=".3 .02 .01" mass="4" fullinertia=".3 .2 .25 .01 .02 .03"/><site name="flange" pos=".6 0 0"/>)") +
           extra + R"(</body></worldbody>
  <actuator><plugin name="drive" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="3"/></actuator></mujoco>)";
  };
  // A steel ball of 5 kg: radius 53.36 mm, inertia 0.4 m r^2.
  const double inertia = 0.4 * 5 * std::pow(3 * 5 / (4 * std::numbers::pi * 7850), 2. / 3);
  const auto bare = mujoco::load_string(xml(""));
  ASSERT_TRUE(bare) << bare.error().message;
  const auto carried = with_payload(**bare, {.mass_kg = 5, .com_m = {0.1, 0.05, -0.02}});
  ASSERT_TRUE(carried) << carried.error().message;
  const std::string i = std::to_string(inertia);
  const auto welded = mujoco::load_string(
      xml(("<body><inertial pos=\".7 .05 -.02\" mass=\"5\" diaginertia=\"" + i + " " + i + " " + i + "\"/></body>")
              .c_str()));
  ASSERT_TRUE(welded) << welded.error().message;
  const mujoco::DataPtr a = (*carried)->make_data(), b = (*welded)->make_data();
  for (int k = 0; k < 2000; ++k) {
    (*carried)->step(a.get());
    (*welded)->step(b.get());
  }
  EXPECT_NEAR(a->qpos[0], b->qpos[0], 1e-5);
  EXPECT_GT(std::abs(a->qpos[0]), 0.1);
}

// Cubics through samples of a sine and its slope: fourth order in the step, h^4 / 384 of the fourth derivative.
TEST(Motion, PassesThroughPositionsAndVelocities) {
  Motion motion({0});
  const double h = 0.05, w = 3;
  for (int i = 0; i <= 100; ++i) motion.pass_through(i * h, {std::sin(w * i * h)}, {w * std::cos(w * i * h)});
  EXPECT_NEAR(motion.duration_s(), 5, 1e-12);
  std::vector<SetPoint> at(1);
  for (double t = h; t < 5; t += 0.0031) {
    motion.at(t, at);
    ASSERT_NEAR(at[0].position_rad, std::sin(w * t), 1.01 * std::pow(w * h, 4) / 384);
    ASSERT_NEAR(at[0].velocity_rad_s, w * std::cos(w * t), 2e-4);
  }
}

TEST(Motion, OneAfterTheOther) {
  const std::vector<double> speed{1}, acceleration{4};
  Motion first({0}), second({1});
  first.move_to({1}, speed, acceleration);
  second.move_to({-1}, speed, acceleration).dwell(0.5);
  const double half = first.duration_s();
  first.then(second);
  EXPECT_NEAR(first.duration_s(), half + second.duration_s(), 1e-12);
  std::vector<SetPoint> whole(1), part(1);
  for (const double t : {0.1, 0.9, 2.0, 2.6}) {
    first.at(half + t, whole);
    second.at(t, part);
    EXPECT_NEAR(whole[0].position_rad, part[0].position_rad, 1e-12);
  }
}

}  // namespace
}  // namespace tribotwin::twin
