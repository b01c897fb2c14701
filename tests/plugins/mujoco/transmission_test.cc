#include <cmath>
#include <fstream>
#include <numbers>
#include <regex>

#include "reference.hpp"
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>

namespace tribotwin::mujoco {
namespace {

using testing::HasSubstr;
constexpr double pi = std::numbers::pi;
const std::string bench = std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/rh380n_bench.xml";

transmission::Configuration spring() {
  return {{"drive", "j"},   {"k00", "1.2e6"}, {"k10", "4e7"},
          {"k20", "3e12"},  {"w", "0.6"},     {"beta", "1500"},
          {"gamma", "300"}, {"n", "1.3"},     {"torsion_max_rad", "0.01"}};
}

TEST(Hysteresis, EqualsTheReference) {
  const auto h = *transmission::make_hysteresis("h", spring());
  const auto rows = reference("hysteresis");
  const auto phi = [](double t) { return 1.5e-3 * std::sin(2 * pi * t) + 0.4e-3 * std::sin(2 * pi * 3.3 * t); };
  for (const int steps : {5, 50}) {  // 1 ms, 0.1 ms
    double x = 0, heat = 0, torque_error = 0, heat_error = 0;
    const double dt = 0.005 / steps;
    for (std::size_t k = 0; k < rows.size(); ++k) {
      const double t0 = 0.005 * static_cast<double>(k);
      torque_error = std::max(torque_error, std::abs(transmission::torque_nm(h, phi(t0), x, 20) - rows[k][1]));
      heat_error = std::max(heat_error, std::abs(heat - rows[k][2]));
      for (int n = 0; n < steps; ++n) {
        const auto after = transmission::advance(h, x, phi(t0 + n * dt), phi(t0 + (n + 1) * dt), 20);
        x = after.x_rad;
        heat += after.heat_J;
      }
    }
    std::printf("Bouc-Wen at %g ms: torque %.1e of 3000 Nm, heat %.1e of %.2f J\n", 1e3 * dt, torque_error, heat_error,
                rows.back()[2]);
    EXPECT_LT(torque_error, steps == 5 ? 0.5 : 0.005);
    EXPECT_LT(heat_error, steps == 5 ? 2e-3 : 2e-5);
  }
}

TEST(Hysteresis, IsStableAndBoundedForAnyIncrement) {
  const auto h = *transmission::make_hysteresis("h", spring());
  for (const double way : {1e-9, 1e-5, 1e-3, 1.0, 1e6})
    for (const double x0 : {-h.limit_rad(), -1e-4, 0.0, 2e-3, h.limit_rad()})
      for (const double sign : {1.0, -1.0}) {
        const double x = transmission::advance(h, x0, sign * way);
        ASSERT_LE(std::abs(x), h.limit_rad());
        ASSERT_NEAR(transmission::advance(h, transmission::advance(h, x0, sign * way / 2), sign * way / 2), x,
                    1e-5 * h.limit_rad());
        if (way >= 1) ASSERT_NEAR(x, sign * h.limit_rad(), 1e-12);
      }
}

TEST(Hysteresis, MistakesAreNamed) {
  const auto error = [](const char* key, const char* value) {
    auto c = spring();
    std::erase_if(c, [&](const auto& entry) { return entry.first == key; });
    if (value) c.emplace_back(key, value);
    const auto h = transmission::make_hysteresis("h", c);
    return h ? std::string("accepted") : h.error().message;
  };
  EXPECT_THAT(error("w", nullptr), HasSubstr("'w' is missing"));
  EXPECT_THAT(error("w", "1.1"), HasSubstr("within 0 .. 1"));
  EXPECT_THAT(error("gamma", "1501"), HasSubstr("deliver energy"));
  EXPECT_THAT(error("k10", "-4e9"), HasSubstr("must be above 0 in the whole range"));
  EXPECT_THAT(error("k30", "1"), HasSubstr("not known"));
  EXPECT_THAT(error("n", "x"), HasSubstr("finite number"));
}

std::shared_ptr<const Model> load(const Options& options = {}) {
  auto model = load_file(bench, options);
  if (!model) throw std::runtime_error(model.error().message);
  return *model;
}

/// The motor shaft held by force, the load motor pulling a sine of 3 kNm: one settled loop of torsion and torque.
struct Loop {
  double area_J = 0, heat_J = 0;
};
Loop loop(double frequency, double T) {
  const auto model = load();
  const DataPtr d = model->make_data();
  const Spring& s = model->springs()[0];
  const Binding& drive = model->drives()[0];
  const double period = 1 / frequency, dt = model->get()->opt.timestep;
  drive::set_temperature(drive.drive, state(d.get(), drive), T);
  workspace(d.get(), drive).temperature_held = 1;
  Loop result;
  double torsion = 0, torque = 0, heat = 0;
  const auto cycle = [&] {
    result = {};
    heat = workspace(d.get(), s).heat_J;
    const int steps = static_cast<int>(std::lround(period / dt));
    for (int i = 0; i < steps; ++i) {
      const double t = i * dt;
      // Less what 25 kg m^2 add at 2e6 Nm/rad: the gear, not the load motor, is to see 3 kNm at every rate.
      const double amplitude = 3000 * (1 - 25 * std::pow(2 * pi * frequency, 2) / 2e6);
      d->ctrl[1] = amplitude * std::sin(2 * pi * frequency * t) -
                   4000 * d->qvel[model->get()->jnt_dofadr[1]];  // damped: no ringing
      d->ctrl[0] = std::clamp(-400 * d->qpos[0] - 4 * d->qvel[0] + workspace(d.get(), s).torque_nm / 185, -50.0, 50.0);
      model->step(d.get());
      const auto& now = workspace(d.get(), s);
      result.area_J += 0.5 * (now.torque_nm + torque) * (now.torsion_rad - torsion);
      torsion = now.torsion_rad;
      torque = now.torque_nm;
    }
    result.heat_J = workspace(d.get(), s).heat_J - heat;
  };
  cycle();
  cycle();
  cycle();
  return result;
}

TEST(Bench, LoopsAreTheSameAtEveryRateAndTheirAreaIsTheHeat) {
  std::vector<double> areas;
  for (const double frequency : {0.05, 0.125, 0.5, 2.0}) {
    const Loop l = loop(frequency, 20);
    std::printf("%5.3f Hz: loop %.6f J, heat %.6f J\n", frequency, l.area_J, l.heat_J);
    EXPECT_GT(l.area_J, 0.1);
    EXPECT_NEAR(l.heat_J, l.area_J, 0.005 * l.area_J) << frequency;
    areas.push_back(l.area_J);
  }
  for (const double area : areas) EXPECT_NEAR(area, areas[0], 0.005 * areas[0]);
}

TEST(Bench, ReactionsBalanceAndHeatReachesTheDrive) {
  for (const char* integrator : {"Euler", "implicit", "RK4"}) {
    const auto model = load({.integrator = integrator});
    const DataPtr d = model->make_data();
    const Spring& s = model->springs()[0];
    const Binding& drive = model->drives()[0];
    for (int i = 0; i < 4000; ++i) {
      d->ctrl[0] = 15 * std::sin(0.004 * i);
      d->ctrl[1] = 2500 * std::sin(0.001 * i);
      model->step(d.get());
      const double tau = -d->actuator_force[s.force];
      // Motor and load motor act on their joints directly; what is left of qfrc_actuator is the gear's.
      const double on_motor = d->qfrc_actuator[0] - d->actuator_force[drive.force],
                   on_arm = d->qfrc_actuator[1] - d->actuator_force[1];
      ASSERT_NEAR(on_arm, tau, 1e-9 * std::abs(tau) + 1e-9) << integrator;
      ASSERT_NEAR(on_motor * 185 + on_arm, 0, 1e-9 * std::abs(tau) + 1e-9) << integrator;
    }
    const auto& gear = workspace(d.get(), drive);
    const double hysteretic = workspace(d.get(), s).heat_J;
    EXPECT_GT(hysteretic, 0);
    EXPECT_NEAR(gear.heat_J + gear.added_heat_J, gear.friction_work_J + hysteretic, 1e-9 * gear.heat_J);
    EXPECT_GT(state(d.get(), drive).rise.total_K(), 0);
  }
}

TEST(Bench, StiffnessFollowsTheTemperatureOfTheDrive) {
  const auto model = load();
  const auto& h = model->springs()[0].hysteresis;
  EXPECT_GT(h.stiffness(1e-3, 50), 1.03 * h.stiffness(1e-3, 20));
  EXPECT_EQ(h.stiffness(1e-3, 90), h.stiffness(1e-3, 50));
  EXPECT_LT(loop(0.5, 50).area_J, loop(0.5, 20).area_J);
}

TEST(Bench, WarmsAsPaperFourSaysAndKeepsItsStateWithTheData) {
  // 20 to 50 degC in about 30 min at 150 rad/s, without load: the friction power along the way, by the heat model.
  const auto model = load();
  const auto& drive = model->drives()[0].drive;
  drive::BristleState m;
  drive::Workspace s{};
  double minutes = 0;
  for (const auto decay = thermal::decay(drive.thermal, 1); drive::temperature_degC(drive, m) < 50 && minutes < 90;
       minutes += 1.0 / 60) {
    const double f = friction_nm(drive, 150, 0, drive::temperature_degC(drive, m));
    thermal::step(drive.thermal, decay, f * 150, 0, m.rise);
  }
  EXPECT_NEAR(minutes, 30, 6);

  const DataPtr a = model->make_data();
  const auto run = [&](mjData* d) {
    for (int i = 0; i < 1000; ++i) {
      d->ctrl[1] = 3000 * std::sin(0.005 * i);
      model->step(d);
    }
  };
  run(a.get());
  const DataPtr b(mj_copyData(nullptr, model->get(), a.get()));
  EXPECT_NE(hysteretic_rad(a.get(), model->springs()[0]), 0);
  run(a.get());
  run(b.get());
  EXPECT_EQ(a->qpos[1], b->qpos[1]);
  EXPECT_EQ(hysteretic_rad(a.get(), model->springs()[0]), hysteretic_rad(b.get(), model->springs()[0]));
  mj_resetData(model->get(), b.get());
  EXPECT_EQ(hysteretic_rad(b.get(), model->springs()[0]), 0);
  EXPECT_TRUE(variant(*model, [](mjModel* copy) { copy->opt.timestep = 2.5e-4; }));
}

TEST(Bench, MistakesNameTheElementAndTheRemedy) {
  std::ifstream stream(bench);
  const std::string text(std::istreambuf_iterator<char>(stream), {});
  const auto with = [&](const char* what, const char* instead) {
    const auto model = load_string(std::regex_replace(text, std::regex(what), instead), {},
                                   std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf");
    return model ? std::string("loaded") : model.error().message;
  };
  EXPECT_EQ(with("nothing at all", ""), "loaded");
  EXPECT_THAT(with("instance=\"gear\" actdim=\"1\"", "instance=\"gear\" actdim=\"2\""),
              testing::AllOf(HasSubstr("<plugin name=\"gear\">"), HasSubstr("actdim=\"1\"")));
  EXPECT_THAT(with("key=\"drive\" value=\"motor\"", "key=\"drive\" value=\"moter\""),
              testing::AllOf(HasSubstr("<instance name=\"gear\">"), HasSubstr("'moter'")));
  EXPECT_THAT(with("timestep=\"0.0005\"", "timestep=\"0.005\""),
              testing::AllOf(HasSubstr("tendon 'torsion'"), HasSubstr("works")));
  EXPECT_THAT(with("tendon=\"torsion\" plugin", "joint=\"output\" plugin"), HasSubstr("tendon"));
}

}  // namespace
}  // namespace tribotwin::mujoco
