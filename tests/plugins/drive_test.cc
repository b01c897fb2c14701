#include <gmock/gmock.h>

#include <tribotwin/plugins/drive/configuration.hpp>

namespace tribotwin::drive {
namespace {

using testing::HasSubstr;

Configuration extended() {
  Configuration c{{"law", "extended"}, {"torque_max_nm", "7000"}, {"gear_ratio", "178"}, {"thermal", "first_order"},
                  {"R_th", "0.15"}, {"kappa", "10944"}};
  const auto law = *friction::published_law("extended");
  for (std::size_t i = 0; i < law.info->parameters.size(); ++i)
    c.emplace_back(law.info->parameters[i].name, std::to_string(law.parameters[i]));
  return c;
}

TEST(Configuration, SurvivesTheRoundTrip) {
  const auto drive = make_drive("j2", extended());
  ASSERT_TRUE(drive) << drive.error();
  const auto again = make_drive("j2", configuration_of(*drive));
  ASSERT_TRUE(again) << again.error();
  EXPECT_EQ(configuration_of(*again), configuration_of(*drive));
  EXPECT_EQ(again->law.parameters, drive->law.parameters);
}

TEST(Configuration, MistakesAreNamedWithTheRemedy) {
  const auto error = [](const char* key, const char* value) {
    Configuration c = extended();
    std::erase_if(c, [&](const auto& entry) { return entry.first == key; });
    if (value) c.emplace_back(key, value);
    const auto drive = make_drive("j2", c);
    return drive ? std::string("accepted") : drive.error();
  };
  EXPECT_THAT(error("Fc00", "1"), HasSubstr("did you mean 'Fc0'"));
  EXPECT_THAT(error("torque_max_nm", nullptr), HasSubstr("'torque_max_nm' is missing"));
  EXPECT_THAT(error("torque_max_nm", "-1"), HasSubstr("must be within"));
  EXPECT_THAT(error("torque_max_nm", "nan"), HasSubstr("finite number"));
  EXPECT_THAT(error("torque_max_nm", "7e3x"), HasSubstr("finite number"));
  EXPECT_THAT(error("Fc0", nullptr), HasSubstr("lacks its parameter 'Fc0'"));
  EXPECT_THAT(error("kappa", nullptr), HasSubstr("thermal 'first_order': key 'kappa' is missing"));
  EXPECT_THAT(error("thermal", "third_order"), HasSubstr("prescribed, first_order or second_order"));
  EXPECT_THAT(error("validity", "ignore"), HasSubstr("clamp, extrapolate or error"));
  EXPECT_THAT(error("law", nullptr), HasSubstr("'law' is missing"));
  EXPECT_THAT(error("Fsl", "0.99"), HasSubstr("lock itself"));
  EXPECT_THAT(error("temperature_min_degC", "99"), HasSubstr("lies above"));
}

TEST(Configuration, SelfLockingCountsTorqueOfFrictionPerTorqueOfLoad) {
  // A law in Nm: 40 and 60 Nm of friction at a load of 50 Nm.
  const auto error = [](const char* Fsl) {
    const auto drive = make_drive("j3", {{"law", "steady_state_extended"}, {"Fc0", "5"}, {"FcT", "0"}, {"Fcl", "3"}, {"Fs0", "8"}, {"Fsl", Fsl}, {"Vs0", "3"},
                                         {"VsT", "0"}, {"alpha", "1.3"}, {"FvT", "1"}, {"TV0", "30"}, {"beta0", "0.6"}, {"betaT", "0"},
                                         {"torque_max_nm", "50"}, {"gear_ratio", "100"}});
    return drive ? std::string("accepted") : drive.error();
  };
  EXPECT_EQ(error("40"), "accepted");
  EXPECT_THAT(error("60"), testing::AllOf(HasSubstr("1.2 Nm per Nm"), HasSubstr("lock itself")));
}

TEST(Drive, WearScalesTheChosenParameterOnly) {
  const Drive drive = *make_drive("j2", extended());
  Scratch scratch{};
  EXPECT_EQ(current_law(drive, scratch).parameters, drive.law.parameters);
  set_wear(scratch, 0, 1.5);
  EXPECT_DOUBLE_EQ(current_law(drive, scratch).parameters[0], 1.5 * drive.law.parameters[0]);
  EXPECT_EQ(current_law(drive, scratch).parameters[1], drive.law.parameters[1]);
  set_wear(scratch, 0, 1);
  EXPECT_EQ(scratch.worn, 0);
}

TEST(Drive, WearReachesEveryParameterOfTheLaw) {
  const Drive drive = *make_drive("j3", {{"law", "steady_state"}, {"Fc", "5"}, {"Fs", "8"}, {"Vs", "3"}, {"alpha", "1.3"}, {"Fv", "1"},
                                         {"beta", "0.6"}, {"torque_max_nm", "130"}, {"gear_ratio", "100"}});
  for (std::size_t i = 0; i < drive.law.values().size(); ++i) {
    Scratch scratch{};
    set_wear(scratch, i, 1.2);
    const double limit = begin_step(drive, {}, scratch, 0, 0.04), worn = friction::torque(current_law(drive, scratch), 4, 0, 25);
    EXPECT_DOUBLE_EQ(limit, worn) << drive.law.info->parameters[i].name;
    EXPECT_GT(std::abs(limit - friction::torque(drive.law, 4, 0, 25)), 0.01) << drive.law.info->parameters[i].name;
  }
}

TEST(Drive, HeatEqualsFrictionWorkAndReachesTheOil) {
  const Drive drive = *make_drive("j2", extended());
  Memory memory;
  Scratch scratch{};
  const double dt = 1e-3;
  const auto decay = thermal::decay(drive.thermal, dt);
  double out_J = 0;
  for (int i = 0; i < 100000; ++i) {
    const double qd = std::sin(i * 1e-3);
    const double limit = begin_step(drive, memory, scratch, i * dt, qd);
    out_J += memory.rise.total_K() / 0.15 * dt;
    end_step(drive, decay, {std::copysign(limit, qd), 0, std::sin((i + 1) * 1e-3), 0}, dt, memory, scratch);
  }
  EXPECT_GT(scratch.heat_J, 1000);
  EXPECT_NEAR(scratch.heat_J, scratch.friction_work_J, 1e-9 * scratch.heat_J);
  // What the oil holds plus what it gave away is what it got (rectangle rule over 1e5 steps).
  EXPECT_NEAR(memory.rise.total_K() * 10944 / 0.15 + out_J, scratch.heat_J, 1e-6 * scratch.heat_J);
}

TEST(Reference, NamesEveryKeyALawTakes) {
  const std::string text = reference_markdown();
  for (const char* key : all_keys()) EXPECT_THAT(text, HasSubstr("`" + std::string(key) + "`"));
}

}  // namespace
}  // namespace tribotwin::drive
