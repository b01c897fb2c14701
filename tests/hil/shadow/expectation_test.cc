// What a shadow expects of a motor with a winding, beside the twin whose motion it hears.
#include <cmath>

#include <gtest/gtest.h>

#include <tribotwin/hil/shadow/expectation.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

namespace tribotwin::hil {
namespace {

TEST(Expectation, HeatsAWindingAndItsGear) {
  const auto scenario =
      twin::load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/xl330_winding.yaml",
                          {"duration_s=40", "motion.dwell_s=0", "temperature_degC=45", "ambient_degC=25"})
          .value();
  twin::Twin twin(scenario);
  Expectation expectation(scenario);
  const double dt_s = twin.model()->opt.timestep;
  double friction_J = 0, copper_J = 0, error = 0, torque = 0;
  bool first = true;
  while (twin.step() == twin::Status::running) {
    const double speed = twin.velocity_rad_s(0), acceleration = (twin.data()->qvel[0] - speed) / dt_s;
    const Motion motion{twin.position_rad(0), speed, acceleration};
    expectation.set({&motion, 1}, first ? 0 : dt_s);
    first = false;
    const double expected =
        expectation.rigid_nm(0) + (expectation.friction_low_nm(0) + expectation.friction_high_nm(0)) / 2;
    if (std::abs(speed) > 0.1) {
      error += std::pow(expected - twin.drive(0).torque_nm, 2);
      torque += std::pow(twin.drive(0).torque_nm, 2);
    }
    friction_J = twin.drive(0).friction_work_J, copper_J = twin.drive(0).winding_heat_J;
  }
  EXPECT_GT(copper_J, friction_J);
  EXPECT_LT(std::sqrt(error / torque), 0.002);
  // The winding's heat keeps the gear warmer than a gear without one by copper_J over its heat capacity, 16 J/K. Of it
  // 0.42 arises while the joint hardly moves, when friction may be anything up to its limit: by the load alone, 14 %
  // too much.
  EXPECT_NEAR(expectation.temperature_degC(0), twin.temperature_degC(0), 0.08 * copper_J / 16);
}

}  // namespace
}  // namespace tribotwin::hil
