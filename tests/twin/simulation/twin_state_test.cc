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

}  // namespace
}  // namespace tribotwin::twin
