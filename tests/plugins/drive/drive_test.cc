#include <cmath>
#include <numbers>

#include <gmock/gmock.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/fault.hpp>

namespace tribotwin::drive {
namespace {

using testing::HasSubstr;

Configuration extended() {
  Configuration c{{"law", "extended"},        {"torque_max_nm", "7000"}, {"gear_ratio", "178"},
                  {"thermal", "first_order"}, {"R_th", "0.15"},          {"kappa", "10944"}};
  const auto law = *friction::published_law("extended");
  for (std::size_t i = 0; i < law.info->parameters.size(); ++i)
    c.emplace_back(law.info->parameters[i].name, std::to_string(law.parameters[i]));
  return c;
}

/// A drive with a law in Nm that depends on speed alone.
Drive steady_state_drive(double Fc = 5, double Fs = 8, double Vs = 3, double Fv = 1) {
  return *make_drive("j3", {{"law", "steady_state"},
                            {"Fc", std::to_string(Fc)},
                            {"Fs", std::to_string(Fs)},
                            {"Vs", std::to_string(Vs)},
                            {"alpha", "1.3"},
                            {"Fv", std::to_string(Fv)},
                            {"beta", "0.6"},
                            {"torque_max_nm", "130"},
                            {"gear_ratio", "100"}});
}

/// What make_drive says to this configuration with another value of the key, nullptr: without it.
std::string error_with(Configuration c, const char* key, const char* value) {
  std::erase_if(c, [&](const auto& entry) { return entry.first == key; });
  if (value) c.emplace_back(key, value);
  const auto drive = make_drive("j2", c);
  return drive ? "accepted" : drive.error().message;
}

TEST(Configuration, SurvivesTheRoundTrip) {
  const auto drive = make_drive("j2", extended());
  ASSERT_TRUE(drive) << drive.error().message;
  const auto again = make_drive("j2", configuration_of(*drive));
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(configuration_of(*again), configuration_of(*drive));
  EXPECT_EQ(again->law.parameters, drive->law.parameters);
}

TEST(Configuration, KeysThatADriveMayLackComeBackAsGiven) {
  const Configuration given{{"asymmetry", "0.125"},
                            {"offset_nm", "2.5"},
                            {"control", "position"},
                            {"kp", "30"},
                            {"kv", "2"},
                            {"brake_torque_nm", "9"},
                            {"load_filter_s", "0.5"},
                            {"validity", "error"},
                            {"speed_max_rad_s", "300"},
                            {"load_max", "0.75"},
                            {"temperature_min_degC", "10"},
                            {"temperature_max_degC", "90"},
                            {"T_amb", "21"}};
  Configuration c = extended();
  c.insert(c.end(), given.begin(), given.end());
  const auto drive = make_drive("j2", c);
  ASSERT_TRUE(drive) << drive.error().message;
  EXPECT_THAT(configuration_of(*drive), testing::IsSupersetOf(given));
  for (const char* key : {"asymmetry", "offset_nm", "control", "kp"})
    for (const auto& [name, value] : configuration_of(*make_drive("j2", extended()))) EXPECT_NE(name, key);
}

TEST(Configuration, MistakesAreNamedWithTheRemedy) {
  const auto error = [](const char* key, const char* value) { return error_with(extended(), key, value); };
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
    const auto drive = make_drive("j3", {{"law", "steady_state_extended"},
                                         {"Fc0", "5"},
                                         {"FcT", "0"},
                                         {"Fcl", "3"},
                                         {"Fs0", "8"},
                                         {"Fsl", Fsl},
                                         {"Vs0", "3"},
                                         {"VsT", "0"},
                                         {"alpha", "1.3"},
                                         {"FvT", "1"},
                                         {"TV0", "30"},
                                         {"beta0", "0.6"},
                                         {"betaT", "0"},
                                         {"torque_max_nm", "50"},
                                         {"gear_ratio", "100"}});
    return drive ? std::string("accepted") : drive.error().message;
  };
  EXPECT_EQ(error("40"), "accepted");
  EXPECT_THAT(error("60"), testing::AllOf(HasSubstr("1.2 Nm per Nm"), HasSubstr("lock itself")));
}

TEST(Drive, WearScalesTheChosenParameterOnly) {
  const Drive drive = *make_drive("j2", extended());
  Workspace workspace{};
  EXPECT_EQ(current_law(drive, workspace).parameters, drive.law.parameters);
  set_wear(workspace, 0, 1.5);
  EXPECT_DOUBLE_EQ(current_law(drive, workspace).parameters[0], 1.5 * drive.law.parameters[0]);
  EXPECT_EQ(current_law(drive, workspace).parameters[1], drive.law.parameters[1]);
  set_wear(workspace, 0, 1);
  EXPECT_EQ(workspace.worn, 0);
}

TEST(Drive, WearReachesEveryParameterOfTheLaw) {
  const Drive drive = steady_state_drive();
  for (std::size_t i = 0; i < drive.law.values().size(); ++i) {
    Workspace workspace{};
    set_wear(workspace, i, 1.2);
    const double limit = begin_step(drive, {}, workspace, 0, 0.04),
                 worn = friction::torque(current_law(drive, workspace), 4, 0, 25);
    EXPECT_DOUBLE_EQ(limit, worn) << drive.law.info->parameters[i].name;
    EXPECT_GT(std::abs(limit - friction::torque(drive.law, 4, 0, 25)), 0.01) << drive.law.info->parameters[i].name;
  }
}

/// Friction with a fault against that of the law with the parameters that the footprint says.
TEST(Fault, LeavesItsFootprintOnTheLaw) {
  const Drive healthy = steady_state_drive();
  const struct {
    const char* name;
    Drive drive;
  } expected[] = {{"wear", steady_state_drive(6, 9.6, 3.6, 1)},
                  {"thickening", steady_state_drive(5, 8, 3.2, 1.2)},
                  {"lubricant_loss", steady_state_drive(5, 8, 3.6, 0.8)},
                  {"preload_loss", steady_state_drive(4, 6.4, 3, 1)}};
  for (const auto& [name, drive] : expected) {
    Faults faults{};
    find_fault(name)->add(faults, 0.2);
    for (const double qd : {0.0, 0.001, 0.02, 0.1, 1.5}) {
      Workspace faulty{}, plain{};
      set_faults(faulty, faults);
      EXPECT_NEAR(begin_step(healthy, {}, faulty, 0, qd), begin_step(drive, {}, plain, 0, qd), 1e-9)
          << name << " at " << qd;
    }
  }
}

TEST(Fault, RippleFollowsTheMotorsAngleAndNeverPushes) {
  const Drive drive = steady_state_drive();
  Faults faults{};
  find_fault("pitted_bearing")->add(faults, 1);
  double mean = 0, minimum = 1e9, maximum = 0;
  for (int i = 0; i < 100; ++i) {
    Workspace workspace{};
    set_faults(workspace, faults);
    const double limit = begin_step(drive, {}, workspace, 0, 0.1, 0.02 * std::numbers::pi * i / 100);
    mean += limit / 100, minimum = std::min(minimum, limit), maximum = std::max(maximum, limit);
  }
  Workspace plain{};
  const double level = begin_step(drive, {}, plain, 0, 0.1), h = std::pow(10.0, 0.6), g = level - h;
  EXPECT_NEAR(mean, level, 1e-9);
  EXPECT_NEAR(maximum, 2 * g + h, 1e-9);
  EXPECT_NEAR(minimum, h, 1e-9);
  EXPECT_GT(minimum, 0);
}

TEST(Fault, TeethTransmitNothingWhileTheyCrossTheGap) {
  const Drive drive = steady_state_drive();
  Workspace workspace{};
  set_faults(workspace, {.backlash_rad = 0.01});
  State state;
  const auto decay = thermal::decay(drive.thermal, 1e-3);
  double q = 0;
  const auto go = [&](double qd) {  // travel until the flanks touch
    const double from = q;
    for (int i = 0; i < 100000; ++i) {
      const double limit = begin_step(drive, state, workspace, 0, qd, q);
      if (limit > 1) return std::abs(q - from);
      EXPECT_LT(limit, 1e-9);
      q += qd * 1e-3;
      end_step(drive, decay, {.qd_end_rad_s = qd, .q_end_rad = q}, 1e-3, state, workspace);
    }
    return -1.0;
  };
  const auto touch = [&](double qd) {  // one step on the flank
    begin_step(drive, state, workspace, 0, qd, q);
    q += qd * 1e-3;
    end_step(drive, decay, {.qd_end_rad_s = qd, .q_end_rad = q}, 1e-3, state, workspace);
  };
  EXPECT_NEAR(go(0.1), 0.005, 2e-4);  // from the middle
  touch(0.1);
  EXPECT_EQ(go(0.1), 0);
  touch(-0.1);
  EXPECT_NEAR(go(-0.1), 0.01, 3e-4);
  touch(0.1);
  EXPECT_NEAR(go(0.1), 0.01, 3e-4);
}

TEST(Drive, HeatEqualsFrictionWorkAndReachesTheOil) {
  const Drive drive = *make_drive("j2", extended());
  State state;
  Workspace workspace{};
  const double dt = 1e-3;
  const auto decay = thermal::decay(drive.thermal, dt);
  double out_J = 0;
  for (int i = 0; i < 100000; ++i) {
    const double qd = std::sin(i * 1e-3);
    const double limit = begin_step(drive, state, workspace, i * dt, qd);
    out_J += state.rise.total_K() / 0.15 * dt;
    end_step(drive, decay, {std::copysign(limit, qd), 0, std::sin((i + 1) * 1e-3), 0}, dt, state, workspace);
  }
  EXPECT_GT(workspace.heat_J, 1000);
  EXPECT_NEAR(workspace.heat_J, workspace.friction_work_J, 1e-9 * workspace.heat_J);
  // What the oil holds plus what it gave away is what it got (rectangle rule over 1e5 steps).
  EXPECT_NEAR(state.rise.total_K() * 10944 / 0.15 + out_J, workspace.heat_J, 1e-6 * workspace.heat_J);
}

Configuration with_table() {
  return {{"law", "stribeck"},
          {"Fc", "0.03"},
          {"Fs", "0.02"},
          {"Fv", "4e-4"},
          {"vs", "10"},
          {"alpha", "1.3"},
          {"torque_max_nm", "100"},
          {"gear_ratio", "50"},
          {"load_table_speeds", "0 10 100"},
          {"load_table_loads", "-0.8 -0.2 0 0.4"},
          {"load_table_values", "0.03 0.01 0 0.02  0.04 0.012 0 0.03  0.05 0.02 0 0.04"}};
}

TEST(LoadTable, IsBilinearHeldAtItsEdgesAndKnowsDriverFromDriven) {
  const auto made = make_drive("j", with_table());
  ASSERT_TRUE(made) << made.error().message;
  const LoadTable& t = made->load_table;
  EXPECT_DOUBLE_EQ(t(10, 0.4), 0.03);
  EXPECT_DOUBLE_EQ(t(5, 0.2), 0.0125);
  EXPECT_DOUBLE_EQ(t(55, -0.5), (0.04 + 0.012 + 0.05 + 0.02) / 4);
  EXPECT_DOUBLE_EQ(t(1e4, -9), 0.05);
  EXPECT_DOUBLE_EQ(t(1e4, 9), 0.04);
  EXPECT_DOUBLE_EQ(t(-10, -0.4), t(10, 0.4));  // the same, mirrored
  EXPECT_NE(t(10, -0.4), t(10, 0.4));
  EXPECT_DOUBLE_EQ(t(0, 0.4), 0.02);  // at standstill the larger of 0.02 (driven) and 0.01667 (driving)
  EXPECT_EQ(configuration_of(*make_drive("j", configuration_of(*made))), configuration_of(*made));
  // It reaches the limit of the step, on the arm side.
  Workspace workspace{};
  State state;
  state.load_nm = 40;
  const double law = friction::torque(made->law, 10, 0.4, 25);
  EXPECT_DOUBLE_EQ(begin_step(*made, state, workspace, 0, 0.2), 100 * (law + 0.03));
  state.load_nm = -40;
  EXPECT_DOUBLE_EQ(begin_step(*made, state, workspace, 0, 0.2), 100 * (law + 0.012 + (0.04 - 0.012) / 3));
}

TEST(LoadTable, MistakesAreNamed) {
  const auto error = [](const char* key, const char* value) { return error_with(with_table(), key, value); };
  EXPECT_THAT(error("load_table_loads", nullptr), HasSubstr("a load table needs"));
  EXPECT_THAT(error("load_table_loads", "0 0 1 2"), HasSubstr("ascending"));
  EXPECT_THAT(error("load_table_loads", "-1 0 1"), HasSubstr("has 12 numbers but must have 9"));
  EXPECT_THAT(error("load_table_speeds", "0 10 x"), HasSubstr("finite number"));
  EXPECT_THAT(error("load_table_values", "0.3 0.01 0 0.7 0.04 0.012 0 0.03 0.05 0.02 0 0.04"),
              HasSubstr("lock itself"));
}

TEST(GearLoss, FollowsItsEquationAndTheSignOfTheLoad) {
  // mu_avg 0.08, mu_dif 0.03 over a length of 0.2 rad on the motor side; a purely viscous law beside it.
  Configuration c{{"law", "stribeck"},      {"Fc", "0"},          {"Fs", "0"},
                  {"Fv", "4e-4"},           {"vs", "10"},         {"alpha", "1"},
                  {"torque_max_nm", "100"}, {"gear_ratio", "50"}, {"friction", "gear_loss"},
                  {"mu_avg", "0.08"},       {"mu_dif", "0.03"},   {"h", "0.2"}};
  const auto made = make_drive("j", c);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(configuration_of(*make_drive("j", configuration_of(*made))), configuration_of(*made));
  const auto decay = thermal::decay(made->thermal, 1e-3);
  BristleState state;
  Workspace workspace{};
  double x = 0, z = 0;
  for (int i = 0; i < 3000; ++i) {
    const double qd = i < 1500 ? 0.02 : -0.01, w = 50 * qd, tau = i % 2 ? 30 : -30;
    state.load_nm = tau;
    begin_step(*made, state, workspace, i * 1e-3, qd, x);
    ASSERT_NEAR(workspace.applied_nm, 0.08 * 30 * z + 0.03 * tau * z * z, 1e-12);
    ASSERT_NEAR(workspace.gear_limit_nm, 100 * 4e-4 * std::abs(w), 1e-12);
    x += qd * 1e-3;
    end_step(*made, decay, {std::copysign(workspace.gear_limit_nm, qd), 0, qd, x, 0}, 1e-3, state, workspace);
    const double sign = qd > 0 ? 1 : -1;
    z = sign + (z - sign) * std::exp(-std::abs(w) * 1e-3 / 0.2);
    ASSERT_NEAR(state.z, z, 1e-9);
  }
  const auto error = [&](const char* mu_dif) {
    c[9 + 1].second = mu_dif;
    return make_drive("j", c).error().message;
  };
  EXPECT_THAT(error("0.09"), HasSubstr("|mu_dif| <= mu_avg"));
}

TEST(Reference, NamesEveryKeyALawTakes) {
  const std::string text = reference_markdown();
  for (const char* key : all_keys()) EXPECT_THAT(text, HasSubstr("`" + std::string(key) + "`"));
}

}  // namespace
}  // namespace tribotwin::drive
