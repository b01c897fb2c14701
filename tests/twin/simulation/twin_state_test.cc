#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>

#include <gmock/gmock.h>

#include <tribotwin/twin/simulation/twin.hpp>

namespace tribotwin::twin {
namespace {

using testing::HasSubstr;

Scenario scenario_of(const char* name, std::vector<std::string> settings = {}) {
  const auto folder = std::filesystem::path(TRIBOTWIN_SOURCE_DIR) / "twin" / "scenarios";
  return load_scenario(folder / (std::string(name) + ".yaml"), settings).value();
}

/// Growing faults, another payload, wear and ambient temperature: some are over when the state is saved, some come.
const std::vector<std::string> eventful = {
    "duration_s=2", "multirate.enabled=false",
    "events=[{time_s: 0.2, type: fault, joint: joint2, fault: wear, severity: 0.3, growth_per_h: 50}, {time_s: 0.3, "
    "type: fault, joint: joint3, fault: backlash, severity: 0.001}, {time_s: 0.4, type: payload, mass_kg: 80}, "
    "{time_s: 0.9, type: ambient, temperature_degC: 5}, {time_s: 1.1, type: fault, joint: joint2, fault: wear, "
    "severity: 0.1}, {time_s: 1.2, type: payload, mass_kg: 10}]"};

/// The bits of a saved state, which holds numbers that are none.
std::vector<std::uint64_t> bits(const std::vector<double>& numbers) {
  std::vector<std::uint64_t> all(numbers.size());
  std::ranges::transform(numbers, all.begin(), [](double x) { return std::bit_cast<std::uint64_t>(x); });
  return all;
}

/// All that a twin tells of its drives, and the sums since its start.
std::vector<double> everything(const Twin& t) {
  std::vector<double> all{t.time_s(), t.balance_J(), t.motor_work_J()};
  for (std::size_t i = 0; i < t.model().drives().size(); ++i) {
    const auto& b = t.model().drives()[i];
    const drive::Workspace& w = t.drive(i);
    all.insert(all.end(), {b.angle(t.data()), b.speed(t.data()), t.temperature_degC(i), w.torque_nm, w.friction_nm,
                           w.load_used_nm, w.heat_J, w.friction_work_J, w.stuck_s, t.figures(i).friction_squared_sum,
                           t.watch().joints()[i].error_squared_sum});
  }
  return all;
}

/// Steps a twin goes on with, and what it tells after each.
std::vector<std::vector<double>> further(Twin& t, int steps) {
  std::vector<std::vector<double>> rows;
  for (int k = 0; k < steps; ++k) {
    EXPECT_TRUE(t.step());
    rows.push_back(everything(t));
  }
  return rows;
}

TEST(TwinState, StepsAfterRestoringAreTheSameDoubles) {
  for (const char* servo : {"{type: servo}", "{type: servo, encoder_counts: 4096}"}) {
    auto settings = eventful;
    settings.push_back(std::string("control=") + servo);
    const Scenario scenario = scenario_of("irb6620_warmup", settings);
    Twin one(scenario), two(scenario);
    for (int k = 0; k < 700; ++k) ASSERT_TRUE(one.step());
    const auto saved = one.save();
    ASSERT_TRUE(saved) << saved.error().message;
    const auto now = everything(one);
    const auto expected = further(one, 800);
    // Back in the same twin; and in one that has not begun; and in one that is over.
    ASSERT_TRUE(one.restore(*saved));
    EXPECT_EQ(everything(one), now);
    EXPECT_EQ(bits(one.save().value()), bits(*saved));
    EXPECT_EQ(further(one, 800), expected) << servo;
    ASSERT_TRUE(two.restore(*saved));
    EXPECT_EQ(further(two, 800), expected) << servo;
    while (two.step() == Status::running) continue;
    ASSERT_TRUE(two.restore(*saved));
    EXPECT_EQ(further(two, 800), expected) << servo;
  }
}

TEST(TwinState, HoldsControllersWithMemory) {
  for (const char* name : {"rh380n_tracking", "er3a_c60_day"}) {
    const Scenario scenario = scenario_of(name, {"duration_s=3"});
    Twin one(scenario), two(scenario);
    for (int k = 0; k < 600; ++k) ASSERT_TRUE(one.step());
    const auto saved = one.save();
    ASSERT_TRUE(saved);
    const auto expected = further(one, 500);
    ASSERT_TRUE(two.restore(*saved));
    EXPECT_EQ(further(two, 500), expected) << name;
  }
}

TEST(TwinState, HoldsCommands) {
  const Scenario scenario = scenario_of("irb6620_hold");
  Twin one(scenario, Twin::commanded), two(scenario, Twin::commanded);
  one.commands()[1] = {.mode = DriveCommand::Mode::velocity, .velocity_rad_s = 0.2};
  one.set_brake(0, true);
  for (int k = 0; k < 200; ++k) ASSERT_TRUE(one.step());
  const auto saved = one.save();
  ASSERT_TRUE(saved);
  const auto expected = further(one, 200);
  ASSERT_TRUE(two.restore(*saved));
  EXPECT_EQ(two.commands()[1].mode, DriveCommand::Mode::velocity);
  EXPECT_EQ(further(two, 200), expected);
  EXPECT_GT(one.velocity_rad_s(1), 0.1);
}

TEST(TwinState, WhatIsNoneOfThisScenarioIsRefusedAndChangesNothing) {
  Twin twin(scenario_of("irb6620_warmup", eventful)), other(scenario_of("br609_test_cycle"));
  for (int k = 0; k < 300; ++k) ASSERT_TRUE(twin.step());
  const auto saved = twin.save().value();
  const auto refused = [&](const std::vector<double>& numbers, const char* why) {
    const auto done = twin.restore(numbers);
    ASSERT_FALSE(done) << why;
    EXPECT_THAT(done.error().message, HasSubstr(why));
    EXPECT_EQ(bits(twin.save().value()), bits(saved));
  };
  refused({}, "another scenario");
  refused(other.save().value(), "another scenario");
  refused({saved.begin(), saved.end() - 1}, "numbers but one of this scenario has");
  for (const std::size_t at : {1u, 2u, 3u, 4u})
    for (const double wrong : {-1.0, 0.5, 1e9, std::nan("")}) {
      auto numbers = saved;
      numbers[at] = wrong;
      refused(numbers, "the state is damaged");
    }
  twin.happen({.time_s = twin.time_s(), .what = AmbientChange{30}});
  const auto none = twin.save();
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().message, HasSubstr("outside the scenario"));
  ASSERT_TRUE(twin.restore(saved));
  EXPECT_EQ(bits(twin.save().value()), bits(saved));
}

/// A value inside an event, a gain, the motion, the model, an engine's setting: none of it changes the size of a state.
TEST(TwinState, EveryDifferenceOfScenariosIsSeen) {
  const auto with = [](const std::string& fault, const std::string& more) {
    return std::vector<std::string>{"duration_s=2", "multirate.enabled=false",
                                    "events=[{time_s: 0.2, type: fault, joint: joint2, fault: wear, severity: " +
                                        fault + "}, {time_s: 0.3, type: wear, joint: joint3, factors: {Fc0: 1.1}}]",
                                    more};
  };
  const std::string none = "control={type: servo}";
  Twin one(scenario_of("irb6620_warmup", with("0.3", none)));
  ASSERT_TRUE(one.step());
  const auto saved = one.save().value();
  EXPECT_TRUE(Twin(scenario_of("irb6620_warmup", with("0.3", none))).restore(saved));
  for (const auto& different :
       {with("0.31", none), with("0.3, growth_per_h: 1", none), with("0.3", "control={type: servo, encoder_counts: 0}"),
        with("0.3", "control={type: servo, position_gain_1_s: 10.5}"), with("0.3", "events.1.factors.Fc0=1.2"),
        with("0.3", "seed=2"), with("0.3", "solver=CG"), with("0.3", "drives.joint1.Fc0=0.0312"),
        with("0.3", "temperature_degC=26"), with("0.3", "motion.dwell_s=0.3"), with("0.3", "ambient_degC=21")}) {
    const auto scenario = load_scenario(
        std::filesystem::path(TRIBOTWIN_SOURCE_DIR) / "twin" / "scenarios" / "irb6620_warmup.yaml", different);
    ASSERT_TRUE(scenario) << scenario.error().message;
    const auto done = Twin(*scenario).restore(saved);
    ASSERT_FALSE(done) << different[2] << ' ' << different[3];
    EXPECT_THAT(done.error().message, HasSubstr("another scenario"));
  }
  EXPECT_FALSE(Twin(scenario_of("irb6620_warmup", with("0.3", none)), Twin::commanded).restore(saved));
}

/// Gains that a program of its own changed have no key.
TEST(TwinState, GainsOfAProgramAreSeen) {
  Scenario scenario = scenario_of("irb6620_warmup", {"control={type: servo}"});
  const auto saved = Twin(scenario).save().value();
  EXPECT_TRUE(Twin(scenario).restore(saved));
  std::get<CascadedOptions>(scenario.control).integral_time_s *= 1.01;
  EXPECT_FALSE(Twin(scenario).restore(saved));
}

/// The files of a scenario lie elsewhere; its name and what they hold are the same.
TEST(TwinState, FilesMayLieElsewhere) {
  namespace fs = std::filesystem;
  const fs::path tree = TRIBOTWIN_SOURCE_DIR, folder = fs::temp_directory_path() / "tribotwin-state-elsewhere";
  fs::remove_all(folder);
  fs::create_directories(folder / "twin");
  fs::copy(tree / "mjcf", folder / "mjcf", fs::copy_options::recursive);
  fs::copy(tree / "twin" / "scenarios", folder / "twin" / "scenarios", fs::copy_options::recursive);
  const auto saved = Twin(scenario_of("irb6620_hold")).save().value();
  const auto scenario = load_scenario(folder / "twin" / "scenarios" / "irb6620_hold.yaml");
  fs::remove_all(folder);
  ASSERT_TRUE(scenario);
  const auto done = Twin(*scenario).restore(saved);
  EXPECT_TRUE(done) << done.error().message;
}

}  // namespace
}  // namespace tribotwin::twin
