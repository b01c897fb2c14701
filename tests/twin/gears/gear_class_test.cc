// The table of gear classes.
#include <cmath>
#include <fstream>
#include <set>
#include <sstream>

#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/twin/gears/gear_class.hpp>

namespace tribotwin::twin {
namespace {

using testing::HasSubstr;

drive::Drive drive_of(const GearClass& gear, double scale) {
  return drive::make_drive("j", configuration_of(gear, scale)).value();
}

TEST(GearClass, EveryRowIsADriveAndNamesItsSource) {
  std::set<std::string_view> names;
  for (const GearClass& g : gear_classes()) {
    SCOPED_TRACE(g.name);
    EXPECT_TRUE(names.insert(g.name).second);
    const auto drive = drive::make_drive("j", configuration_of(g, 1));
    ASSERT_TRUE(drive) << drive.error().message;
    EXPECT_DOUBLE_EQ(drive->torque_max_nm, g.torque_max_nm);
    EXPECT_GT(mujoco::friction_nm(*drive, 0.5 * g.speed_max_rad_s, 0, 30), 0);
    // A gear that loses more than it transmits is a mistake in the row.
    EXPECT_LT(mujoco::friction_nm(*drive, g.speed_max_rad_s, 0.5, 30), 0.5 * g.torque_max_nm);
    EXPECT_EQ(drive->thermal.order, thermal::Order::first);
    EXPECT_THAT(std::string(g.source), testing::AnyOf(HasSubstr("20"), HasSubstr("choice")));
    EXPECT_GT(g.rotor_inertia_kg_m2, 0);
  }
}

TEST(GearClass, ScalesTorquesAndHeatAndNothingElse) {
  for (const GearClass& g : gear_classes()) {
    SCOPED_TRACE(g.name);
    const drive::Drive one = drive_of(g, 1), two = drive_of(g, 2);
    for (const double speed : {0.0, 0.1, 0.8})
      for (const double load : {0.0, 0.4})
        EXPECT_NEAR(mujoco::friction_nm(two, speed * g.speed_max_rad_s, load, 40),
                    2 * mujoco::friction_nm(one, speed * g.speed_max_rad_s, load, 40), 2e-5 * g.torque_max_nm);
    EXPECT_DOUBLE_EQ(two.torque_max_nm, 2 * one.torque_max_nm);
    EXPECT_NEAR(two.thermal.resistance_K_W(), one.thermal.resistance_K_W() / 2, 1e-5 * one.thermal.resistance_K_W());
    EXPECT_EQ(two.gear_ratio, one.gear_ratio);
  }
}

// Zhou 2024: joint 1 of the BR609 needs 15.0 Nm at 5 deg/s; Bittencourt 2012, Tables 2 and 3, at 50 degC and 200 rad/s.
TEST(GearClass, GivesThePublishedFriction) {
  const GearClass& harmonic = **find_gear_class("harmonic_220", 1);
  EXPECT_NEAR(mujoco::friction_nm(drive_of(harmonic, 1), 5 * M_PI / 180, 0, 40), 15.0, 0.1);
  const GearClass& cycloidal = **find_gear_class("cycloidal_7500", 1);
  const double viscous = (1.30e-4 + 1.32e-3 * std::exp(-50 / 20.71)) * 200;
  EXPECT_NEAR(mujoco::friction_nm(drive_of(cycloidal, 1), 200 / 178.0, 0, 50), 7500 * (3.11e-2 + viscous), 1);
}

TEST(GearClass, IsFoundByNameAndByFamily) {
  EXPECT_EQ((*find_gear_class("harmonic", 150))->name, "harmonic_130");
  EXPECT_EQ((*find_gear_class("harmonic", 1))->name, "harmonic_30");
  EXPECT_EQ((*find_gear_class("harmonic_345", 1))->name, "harmonic_345");
  EXPECT_EQ((*find_gear_class("cycloidal", 1e6))->name, "cycloidal_7500");
  EXPECT_THAT(find_gear_class("harmonik", 1).error().message, HasSubstr("did you mean 'harmonic'?"));
  EXPECT_EQ(usual_family(1, false, false), "hobby_servo");
  EXPECT_EQ(usual_family(20, false, true), "planetary");
  EXPECT_EQ(usual_family(20, false, false), "harmonic");
  EXPECT_EQ(usual_family(900, false, false), "cycloidal");
  EXPECT_EQ(usual_family(900, true, false), "ball_screw");
}

TEST(GearClass, ReadmeShowsTheTable) {
  std::ifstream file(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/gears/README.md");
  std::ostringstream text;
  text << file.rdbuf();
  EXPECT_THAT(text.str(), HasSubstr(gear_classes_markdown())) << "put this into twin/gears/README.md:\n"
                                                              << gear_classes_markdown();
}

}  // namespace
}  // namespace tribotwin::twin
