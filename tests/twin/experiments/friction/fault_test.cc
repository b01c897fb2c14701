// Faults in a run and on the laboratory's curves: each against the same without it.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <sstream>

#include <gmock/gmock.h>

#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/tests/twin/experiments/temporary_file.hpp>
#include <tribotwin/twin/experiments/friction/curve_rows.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace tribotwin::twin {
namespace {

using testing::HasSubstr;

const std::string model = std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/br609.xml";

/// A curve of joint 3 at 40 degC under its own weight, by column.
std::map<std::string, std::vector<double>> curve(const std::string& fault, double noise_nm = 0.3) {
  const TemporaryFile file(
      "model: " + model +
      "\njoint: joint3\nprocedure: test_cycle\n"
      "sensors: {encoder_increments_per_turn: 409600, torque_noise_nm: " +
      std::to_string(noise_nm) +
      ", lag_s: 0.02}\n"
      "series:\n  - {name: a, load: {by: payload, mass_kg: 0}, temperature: {prescribed_degC: 40}" +
      (fault.empty() ? "" : ", fault: " + fault) + "}\n");
  const Campaign campaign = load_campaign(file.path).value();
  const auto rows = measured_rows(campaign, campaign.curves.at(0));
  EXPECT_TRUE(rows) << rows.error().message;
  std::map<std::string, std::vector<double>> columns;
  std::vector<std::string> names;
  std::istringstream header{std::string(curve_columns)}, table(*rows);
  for (std::string name; std::getline(header, name, ',');) names.push_back(name.substr(0, name.find('\n')));
  for (std::string row; std::getline(table, row);) {
    std::istringstream cells(row);
    std::string cell;
    for (const auto& name : names)
      if (std::getline(cells, cell, ',') && name != "series") columns[name].push_back(std::stod(cell));
  }
  EXPECT_EQ(columns["lost_motion_rad"].size(), 15u);
  return columns;
}

class FaultyCurve : public testing::Test {
 protected:
  static void SetUpTestSuite() { healthy = curve(""); }
  /// Ratio of a column to the healthy one's, level by level, must be `expected` within `tolerance`.
  static void expect_ratio(const std::map<std::string, std::vector<double>>& faulty, const std::string& column,
                           double expected, double tolerance, std::size_t from = 0, std::size_t to = 15) {
    for (std::size_t i = from; i < to; ++i)
      EXPECT_NEAR(faulty.at(column)[i] / healthy[column][i], expected, tolerance) << column << ", level " << i + 1;
  }
  static inline std::map<std::string, std::vector<double>> healthy;
};

TEST_F(FaultyCurve, HealthyOnesHaveNeitherRippleNorLostMotion) {
  EXPECT_THAT(healthy["ripple_nm"], testing::Each(0));
  EXPECT_THAT(healthy["lost_motion_rad"], testing::Each(testing::Lt(5e-5)));  // three increments of the encoder
}

TEST_F(FaultyCurve, WeakMotorsRaiseFrictionAndLoadAlike) {
  const auto weak = curve("{type: torque_constant, severity: 0.1}");
  expect_ratio(weak, "friction_nm", 1 / 0.9, 0.005);
  expect_ratio(weak, "load_norm", 1 / 0.9, 0.005, 0, 10);
  EXPECT_THAT(weak.at("ripple_nm"), testing::Each(0));
}

TEST_F(FaultyCurve, PitsShowAsRippleOncePerMotorTurn) {
  const auto pitted = curve("{type: pitted_bearing, severity: 0.1}");
  const double Fc = 4.752 + 0.0162 * 40 + 3.24 * 0.39;
  EXPECT_NEAR(std::ranges::max(pitted.at("ripple_nm")), 0.1 * Fc, 0.015 * Fc);
  expect_ratio(pitted, "friction_nm", 1, 0.01, 6);  // where the travel has whole turns of the motor
  EXPECT_THAT(pitted.at("lost_motion_rad"), testing::Each(testing::Lt(5e-5)));
}

TEST_F(FaultyCurve, BacklashShowsAsLostMotionOfItsWidth) {
  for (const double width : {3e-4, 2e-3}) {
    const auto loose = curve("{type: backlash, severity: " + std::to_string(width) + "}");
    expect_ratio(loose, "friction_nm", 1, 0.005);
    std::vector<double> measured = loose.at("lost_motion_rad");
    std::erase(measured, 0.0);
    ASSERT_GE(measured.size(), 2u);
    EXPECT_THAT(measured, testing::Each(testing::DoubleNear(width, 0.1 * width + 5e-5)));
    EXPECT_THAT(loose.at("ripple_nm"), testing::Each(0));
  }
}

TEST_F(FaultyCurve, SurfacesAndLubricantMoveTheirEndsOfTheCurve) {
  const auto worn = curve("{type: wear, severity: 0.2}"), thick = curve("{type: thickening, severity: 0.2}"),
             dry = curve("{type: lubricant_loss, severity: 0.2}"), loose = curve("{type: preload_loss, severity: 0.2}"),
             both = curve("[{type: wear, severity: 0.2}, {type: preload_loss, severity: 0.2}]");
  const auto at = [&](const auto& c, std::size_t level) {
    return c.at("friction_nm")[level] - healthy["friction_nm"][level];
  };
  const double boundary = 9.9, viscous = 28.1 - 6.6;  // of level 1 and 15
  EXPECT_NEAR(at(worn, 0), 0.2 * boundary, 0.2);
  EXPECT_NEAR(at(loose, 0), -0.2 * boundary, 0.2);
  EXPECT_NEAR(at(thick, 14), 0.2 * viscous, 0.2);
  EXPECT_NEAR(at(dry, 14), -0.2 * viscous, 0.2);
  EXPECT_LT(std::abs(at(thick, 0)), 0.4);
  EXPECT_NEAR(at(both, 0), (1.2 * 0.8 - 1) * boundary, 0.2);
}

TEST(Faults, AreRefusedWithPlaceAndRemedy) {
  const auto error = [](const std::string& event) -> std::string {
    const TemporaryFile file("model: " + model +
                             "\nduration_s: 3600\nmotion: {type: hold}\nevents: [{time_s: 0, type: fault, " + event +
                             "}]\n");
    const auto scenario = load_scenario(file.path);
    return scenario ? "accepted" : scenario.error().message;
  };
  EXPECT_EQ(error("joint: joint3, fault: wear, severity: 0.1, growth_per_h: 0.1"), "accepted");
  EXPECT_THAT(error("joint: joint3, fault: waer, severity: 0.1"), HasSubstr("did you mean 'wear'"));
  EXPECT_THAT(error("joint: joint7, fault: wear, severity: 0.1"), HasSubstr("joint"));
  EXPECT_THAT(error("joint: joint3, fault: wear"), HasSubstr("severity: is missing"));
  EXPECT_THAT(error("joint: joint3, fault: torque_constant, severity: 1"), HasSubstr("must be within"));
  EXPECT_THAT(error("joint: joint3, fault: pitted_bearing, severity: 0.5, growth_per_h: 0.6"),
              HasSubstr("1.1 by the end"));
  EXPECT_THAT(error("joint: joint3, fault: wear, severity: 0.1, growth: 1"), HasSubstr("growth"));
}

const std::string cycle = "model: " + model +
                          "\nstart_rad: {joint3: -0.5}\nmotion: {type: back_and_forth, joint: joint3, travel_rad: 1, "
                          "speed_rad_s: 0.5, dwell_s: 0.2}\n";

Summary ran(const std::string& text) {
  const TemporaryFile file(text);
  auto summary = run(load_scenario(file.path).value(), {});
  EXPECT_TRUE(summary) << summary.error().message;
  return *summary;
}

TEST(Faults, CloseTheEnergyBalance) {
  for (const auto& fault : drive::faults()) {
    const double severity = fault.unit == "rad" ? 0.005 : 0.3;
    const Summary s = ran(cycle + "duration_s: 20\nevents: [{time_s: 3, type: fault, joint: joint3, fault: " +
                          std::string(fault.name) + ", severity: " + std::to_string(severity) + "}]\n");
    EXPECT_LT(std::abs(s.energy_balance_J), 1e-3 * s.friction_work_J) << fault.name;
    EXPECT_NEAR(s.heat_J, s.friction_work_J, 1e-9 * s.friction_work_J) << fault.name;
  }
}

TEST(Faults, OfSeverityZeroChangeNoBit) {
  const Summary none = ran(cycle + "duration_s: 5\n");
  for (const auto& fault : drive::faults()) {
    const Summary s = ran(cycle + "duration_s: 5\nevents: [{time_s: 1, type: fault, joint: joint3, fault: " +
                          std::string(fault.name) + ", severity: 0}]\n");
    EXPECT_EQ(s.friction_work_J, none.friction_work_J) << fault.name;
    EXPECT_EQ(s.motor_work_J, none.motor_work_J) << fault.name;
  }
}

TEST(Faults, GrowWithTheHoursUnderMultirateToo) {
  const std::string worn = cycle +
                           "duration_s: 600\nevents: [{time_s: 60, type: fault, joint: joint3, fault: wear, severity: "
                           "0.1, growth_per_h: 1.2}]\n";
  const Summary full = ran(worn), fast = ran(worn + "multirate: {tolerance_K: 2}\n"),
                healthy = ran(cycle + "duration_s: 600\nmultirate: {tolerance_K: 2}\n");
  EXPECT_LT(fast.steps_computed * 5, full.steps_computed);
  EXPECT_NEAR(fast.friction_work_J, full.friction_work_J, 2e-3 * full.friction_work_J);
  EXPECT_GT(full.friction_work_J, 1.04 * healthy.friction_work_J);
}

}  // namespace
}  // namespace tribotwin::twin
