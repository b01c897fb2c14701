#include <atomic>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <future>
#include <string_view>
#include <thread>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path scenarios = fs::path(TRIBOTWIN_SOURCE_DIR) / "twin" / "scenarios";
bool recordings_there() { return fs::exists(fs::path(TRIBOTWIN_SOURCE_DIR) / "../shared/data/bam_xl330"); }

struct Folder {
  fs::path path = [] {
    std::string name = (fs::temp_directory_path() / "tribotwin_XXXXXX").string();
    return fs::path(mkdtemp(name.data()));
  }();
  ~Folder() { fs::remove_all(path); }
};

class Shipped : public testing::TestWithParam<std::string> {};

TEST_P(Shipped, BalancesItsEnergy) {
  if (GetParam() == "xl330_replay" && !recordings_there())
    GTEST_SKIP() << "the recordings of ../shared/data are not beside this checkout";
  const Scenario scenario = load_scenario(scenarios / (GetParam() + ".yaml")).value();
  const auto s = run(scenario, {});
  ASSERT_TRUE(s) << s.error().message;
  EXPECT_GT(s->friction_work_J, 0);
  EXPECT_NEAR(s->heat_J, s->friction_work_J, 1e-9 * s->friction_work_J);
  EXPECT_LT(std::abs(s->energy_balance_J), 1e-3 * std::max(std::abs(s->motor_work_J), s->friction_work_J));
}
INSTANTIATE_TEST_SUITE_P(Scenarios, Shipped,
                         testing::Values("irb6620_warmup", "irb6620_hold", "br609_test_cycle", "er3a_c60_day",
                                         "xl330_replay"),
                         [](const auto& info) { return info.param; });

TEST(Warmup, EndsNearPaperOnesTemperature) {
  const auto s = run(load_scenario(scenarios / "irb6620_warmup.yaml").value(), {});
  EXPECT_NEAR(s->joints[1].temperature_degC.end, 81.2, 2);
}

TEST(MultiRate, FollowsTheFullRunAtEveryCycle) {
  // Steps of 2 ms: the same differences as with 1 ms, in half the time. By day the first 2.5 of 6 h, in which joint 2
  // warms by 41 of its 56 K.
  const char* const nightly = std::getenv("TRIBOTWIN_NIGHTLY");
  const double duration_s = nightly && std::string_view(nightly) == "1" ? 21888 : 9000;
  const auto warmup = [&](std::vector<std::string> more, const Folder& folder) {
    more.insert(more.end(), {"timestep_s=0.002", "telemetry_rate_hz=0.01", fmt::format("duration_s={}", duration_s)});
    return run(load_scenario(scenarios / "irb6620_warmup.yaml", more).value(), {.directory = folder.path});
  };
  const Folder a, b;
  const auto full = warmup({"multirate.enabled=false"}, a), fast = warmup({}, b);
  ASSERT_TRUE(full && fast);
  EXPECT_LT(fast->steps_computed * 100, full->steps_computed);
  const auto f = read_telemetry(a.path / "telemetry.h5"), g = read_telemetry(b.path / "telemetry.h5");
  ASSERT_TRUE(f && g);
  ASSERT_EQ(f->cycle_time_s.size(), g->cycle_time_s.size());
  ASSERT_GT(static_cast<double>(f->cycle_time_s.size()), duration_s / 4);
  const auto T1 = f->channel("joint2", "cycle_temperature_degC"), T2 = g->channel("joint2", "cycle_temperature_degC");
  const auto P1 = f->channel("joint2", "cycle_friction_power_W"), P2 = g->channel("joint2", "cycle_friction_power_W");
  double worst_T = 0, worst_P = 0;
  for (std::size_t i = 0; i < T1.size(); ++i) {
    ASSERT_NEAR(f->cycle_time_s[i], g->cycle_time_s[i], 1e-6);
    worst_T = std::max(worst_T, std::abs(T1[i] - T2[i]));
    worst_P = std::max(worst_P, std::abs(P1[i] - P2[i]) / P1[i]);
  }
  EXPECT_LT(worst_T, 0.1);
  EXPECT_LT(worst_P, 0.015);
  EXPECT_NEAR(fast->friction_work_J, full->friction_work_J, 2e-3 * full->friction_work_J);
  // Of all cycles, whichever were computed. Joint 3 hardly moves: its first cycle, from rest, is unlike the others.
  const auto rms = [](const auto& s, std::size_t joint) { return s->joints[joint].friction_nm.rms; };
  EXPECT_NEAR(rms(fast, 1), rms(full, 1), 2e-3 * rms(full, 1));
  EXPECT_NEAR(rms(fast, 2), rms(full, 2), 1e-2 * rms(full, 2));
  for (const std::size_t joint : {1, 2}) {
    EXPECT_NEAR(fast->joints[joint].outside_s, full->joints[joint].outside_s, 5e-3 * duration_s) << joint;
    EXPECT_NEAR(fast->joints[joint].stuck_s, full->joints[joint].stuck_s, 5e-3 * duration_s) << joint;
  }
  RecordProperty("worst_temperature_error_K", std::to_string(worst_T));
  RecordProperty("worst_power_error", std::to_string(worst_P));
  std::printf("worst temperature error %.4f K, worst power error %.4f %%\n", worst_T, 100 * worst_P);
}

TEST(Load, LagErrorHalvesWithTheTimeStep) {
  const auto lag = [](const char* dt) {
    const Scenario scenario = load_scenario(scenarios / "irb6620_warmup.yaml",
                                            {std::string("timestep_s=") + dt, "duration_s=8", "temperature_degC=50"})
                                  .value();
    Twin twin(scenario);
    double sum = 0, count = 0;
    while (twin.time_s() < 8) {
      EXPECT_TRUE(twin.step());
      // Away from reversals, where friction and with it the load jump whatever the step.
      if (std::abs(twin.velocity_rad_s(1)) < 0.1 || twin.time_s() < 1) continue;
      const double error = twin.state(1).load_nm - twin.drive(1).load_used_nm;
      sum += error * error;
      ++count;
    }
    return std::sqrt(sum / count);
  };
  const double coarse = lag("0.001"), fine = lag("0.0005");
  EXPECT_GT(coarse / fine, 1.8);
  EXPECT_LT(coarse / fine, 2.2);
}

TEST(Determinism, ParallelTwinsAndARerunOfTheResolvedScenarioRepeatEveryValue) {
  const Folder first, again;
  const std::vector<std::string> brief{"duration_s=20", "multirate.enabled=false"};
  ASSERT_TRUE(run(load_scenario(scenarios / "irb6620_warmup.yaml", brief).value(), {.directory = first.path}));
  const Scenario resolved = load_scenario(first.path / "scenario.yaml").value();
  std::vector<fs::path> paths;
  for (int i = 0; i < 4; ++i) paths.push_back(again.path / std::to_string(i));
  std::vector<std::thread> threads;
  for (const auto& path : paths)
    threads.emplace_back([&resolved, path] { EXPECT_TRUE(run(resolved, {.directory = path})); });
  for (auto& thread : threads) thread.join();
  const auto expected = read_telemetry(first.path / "telemetry.h5");
  ASSERT_TRUE(expected) << expected.error().message;
  EXPECT_EQ(expected->time_s.size(), 400u);
  for (const auto& path : paths) {
    const auto got = read_telemetry(path / "telemetry.h5");
    ASSERT_TRUE(got) << got.error().message;
    EXPECT_TRUE(got->complete);
    EXPECT_EQ(got->time_s, expected->time_s);
    EXPECT_EQ(got->values, expected->values);
  }
}

TEST(Telemetry, FrictionFollowsTheLawFromItsOwnRow) {
  const Folder folder;
  const Scenario scenario = load_scenario(scenarios / "irb6620_warmup.yaml",
                                          {"duration_s=20", "multirate.enabled=false", "telemetry_rate_hz=1000"})
                                .value();
  ASSERT_TRUE(run(scenario, {.directory = folder.path}));
  const auto r = read_telemetry(folder.path / "telemetry.h5");
  const auto& drive = scenario.model->drives()[1].drive;
  const auto v = r->channel("joint2", "velocity_rad_s"), f = r->channel("joint2", "friction_nm"),
             l = r->channel("joint2", "load_nm"), T = r->channel("joint2", "temperature_degC"),
             motor = r->channel("joint2", "motor_torque_nm"), arm = r->channel("joint2", "torque_nm");
  int compared = 0;
  for (std::size_t i = 0; i + 1 < v.size(); ++i) {
    EXPECT_DOUBLE_EQ(motor[i] * 178, arm[i]);
    if (std::abs(v[i]) < 0.02 || v[i] * v[i + 1] < 0) continue;
    const double law = mujoco::friction_nm(drive, v[i], l[i] / drive.torque_max_nm, T[i]);
    ASSERT_NEAR(std::abs(f[i]), law, 1e-6 * law) << i;
    ++compared;
  }
  EXPECT_GT(compared, 10000);
}

TEST(Events, PayloadAmbientAndWearShowInTheJoint) {
  const auto with = [](const char* event) {
    std::vector<std::string> set{"duration_s=12", "multirate.enabled=false", "temperature_degC=50"};
    if (*event) set.push_back(std::string("events=[") + event + "]");
    return run(load_scenario(scenarios / "irb6620_warmup.yaml", set).value(), {}).value();
  };
  const auto plain = with("");
  const auto worn = with("{time_s: 6, type: wear, joint: joint2, factors: {Fc0: 2}}");
  const auto loaded = with("{time_s: 6, type: payload, mass_kg: 100, com_m: [0, 0, 0.1]}");
  const auto warm = with("{time_s: 6, type: ambient, temperature_degC: 90}");
  EXPECT_GT(worn.friction_work_J, 1.1 * plain.friction_work_J);
  EXPECT_GT(loaded.joints[1].load_max_norm, 1.2 * plain.joints[1].load_max_norm);
  EXPECT_GT(warm.joints[1].temperature_degC.end, plain.joints[1].temperature_degC.end + 0.01);
  for (const auto& s : {plain, worn, loaded, warm}) EXPECT_LT(std::abs(s.energy_balance_J), 1e-3 * s.motor_work_J);
}

TEST(Events, WhatHappensIsWhatTheSameEventsOfAScenarioDo) {
  const std::string events =
                        "events=[{time_s: 0.5, type: wear, joint: joint2, factors: {Fc0: 2}}, "
                        "{time_s: 0.5, type: fault, joint: joint2, fault: wear, severity: 0.1, growth_per_h: 300}",
                    more =
                        ", {time_s: 0.5, type: wear, joint: joint2, factors: {Fc0: 3}}, "
                        "{time_s: 0.5, type: fault, joint: joint2, fault: wear, severity: 0.3, growth_per_h: 600}]";
  const auto load = [&](const std::string& what) {
    return load_scenario(scenarios / "irb6620_hold.yaml", {"duration_s=3", what}).value();
  };
  const Scenario foreseen = load(events + more);
  Twin before(foreseen), after(load(events + "]"));
  for (int k = 0; k < 3000; ++k) {
    if (k == 500) {
      after.happen(foreseen.events[2]);
      after.happen(foreseen.events[3]);
    }
    ASSERT_TRUE(before.step() && after.step()) << k;
    ASSERT_EQ(after.drive(1).friction_nm, before.drive(1).friction_nm) << k;
    ASSERT_EQ(after.temperature_degC(1), before.temperature_degC(1)) << k;
  }
}

TEST(Events, AMarkerChangesNothingAlsoWhereCyclesAreSkipped) {
  const std::string marker = "events=[{time_s: 3000, type: marker, text: 'new grease: joint 2'}]";
  const auto figures = [&](const std::vector<std::string>& settings) {
    const auto s = run(load_scenario(scenarios / "irb6620_warmup.yaml", settings).value(), {}).value();
    return std::pair(s.steps_computed, s.heat_J);
  };
  EXPECT_EQ(figures({marker}), figures({}));
  const auto nothing =
      load_scenario(scenarios / "irb6620_warmup.yaml", {"events=[{time_s: 1, type: marker, text: ''}]"});
  ASSERT_FALSE(nothing);
  EXPECT_THAT(nothing.error().message, HasSubstr("text: is empty but must be text"));
}

TEST(Bad, ScenariosAreRefusedWithPlaceAndRemedy) {
  const Folder folder;
  const auto error = [&](const std::string& text) -> std::string {
    const fs::path file = folder.path / "s.yaml";
    std::ofstream(file) << text;
    const auto scenario = load_scenario(file);
    return scenario ? "accepted" : scenario.error().message;
  };
  const std::string model = "model: " + std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/irb6620.xml\n";
  EXPECT_EQ(error(model + "duration_s: 1\nmotion: {type: hold}\n"), "accepted");
  EXPECT_THAT(error(model + "duration_s: 1\nmotoin: {type: hold}\n"),
              testing::AllOf(HasSubstr("s.yaml:3"), HasSubstr("did you mean 'motion'")));
  EXPECT_THAT(error(model + "duration_s: long\nmotion: {type: hold}\n"),
              testing::AllOf(HasSubstr("s.yaml:2"), HasSubstr("'long'"), HasSubstr("finite number")));
  EXPECT_THAT(error(model + "duration_s: -1\nmotion: {type: hold}\n"), HasSubstr("must be within"));
  EXPECT_THAT(error(model + "duration_s: .nan\nmotion: {type: hold}\n"), HasSubstr("finite number"));
  EXPECT_THAT(error(model + "motion: {type: hold}\n"), HasSubstr("duration_s: is missing"));
  EXPECT_THAT(error(model + "duration_s: 1\nmotion: {type: holt}\n"), HasSubstr("did you mean 'hold'"));
  EXPECT_THAT(error(model + "duration_s: 1\nduration_s: 2\nmotion: {type: hold}\n"), HasSubstr("twice"));
  EXPECT_THAT(error("model: nowhere.xml\nduration_s: 1\nmotion: {type: hold}\n"), HasSubstr("cannot be read"));
  EXPECT_THAT(error(model + "duration_s: 1\nstart_rad: {joint9: 1}\nmotion: {type: hold}\n"),
              HasSubstr("did you mean 'joint"));
  EXPECT_THAT(error(model + "duration_s: 1\nmotion: {type: hold}\nevents: [{time_s: 0, type: payload, mass_kg: -3}]\n"),
              HasSubstr("mass_kg"));
  EXPECT_THAT(
      error(
          model +
          "duration_s: 1\nmotion: {type: hold}\nevents: [{time_s: 0, type: wear, joint: joint2, factors: {Fc: 2}}]\n"),
      HasSubstr("did you mean 'Fc"));
  EXPECT_THAT(error(model + "duration_s: 1\nmotion: {type: hold}\nmultirate: {tolerance_K: 1}\n"),
              HasSubstr("repeats"));
  EXPECT_THAT(error(model + "duration_s: 1\ntimestep_s: 0.9\nmotion: {type: hold}\n"), HasSubstr("time step"));
  EXPECT_THAT(error(model + "duration_s: 1\nstart_rad: {joint2: 3}\nmotion: {type: hold}\n"),
              HasSubstr("joint2 to 3 .. 3 rad, but its range is"));
  EXPECT_THAT(
      error(model + "motion: {type: back_and_forth, joint: joint2, travel_rad: 100, speed_rad_s: 1}\nduration_s: 1\n"),
      HasSubstr("its range is"));
  EXPECT_THAT(error("model: [1\n"), HasSubstr("not well-formed YAML"));
  EXPECT_THAT(error("- 1\n"), HasSubstr("must be a mapping"));
  std::ofstream(folder.path / "empty.csv") << "";
  std::ofstream(folder.path / "header.csv") << "time_s,position_joint2_rad\n";
  std::ofstream(folder.path / "bad.csv") << "time_s,position_joint2_rad\n0,1\n1,x\n";
  std::ofstream(folder.path / "back.csv") << "time_s,position_joint2_rad\n0,1\n0,1\n";
  std::ofstream(folder.path / "empty.json") << R"({"entries": []})";
  const auto recording = [&](const char* file) {
    return error(model + "motion: {type: recording, file: " + file + "}\n");
  };
  EXPECT_THAT(recording("empty.csv"), HasSubstr("empty"));
  EXPECT_THAT(recording("header.csv"), HasSubstr("no samples"));
  EXPECT_THAT(recording("bad.csv"), testing::AllOf(HasSubstr("bad.csv:3"), HasSubstr("'x'")));
  EXPECT_THAT(recording("back.csv"), HasSubstr("does not come after"));
  EXPECT_THAT(recording("empty.json"), HasSubstr("empty"));
  EXPECT_THAT(recording("none.json"), HasSubstr("cannot be read"));
}

/// A model of one joint whose motor has a winding, and a scenario that moves it.
fs::path motor_scenario(const Folder& folder) {
  std::ofstream(folder.path / "arm.xml") << R"(<mujoco><option timestep="0.001" tolerance="1e-10"/>
  <extension><plugin plugin="tribotwin.drive"><instance name="j"><config key="law" value="stribeck"/>
      <config key="Fc" value="0.03"/><config key="Fs" value="0.02"/><config key="Fv" value="4e-4"/>
      <config key="vs" value="10"/><config key="alpha" value="1.3"/><config key="torque_max_nm" value="100"/>
      <config key="gear_ratio" value="50"/><config key="thermal" value="second_order"/><config key="c1" value="1e-2"/>
      <config key="c2" value="1e-3"/><config key="t1" value="20"/><config key="t2" value="300"/>
      <config key="winding_resistance_ohm" value="0.5"/><config key="torque_constant_nm_A" value="0.1"/>
      <config key="winding_heat_capacity_J_K" value="5"/><config key="winding_thermal_resistance_K_W" value="0.4"/>
      </instance></plugin></extension>
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="2" frictionloss="1" solreffriction=".001 1"
      solimpfriction=".9999 .9999 .001 .5 2"/><geom type="sphere" size=".1" pos=".5 0 0" mass="4"/></body></worldbody>
  <actuator><plugin name="drive" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="6" dyntype="user"/>
  </actuator></mujoco>)";
  std::ofstream(folder.path / "s.yaml")
      << "model: arm.xml\nduration_s: 4\nmotion: {type: back_and_forth, joint: hinge, "
         "travel_rad: 0.5, speed_rad_s: 1}\n";
  return folder.path / "s.yaml";
}

TEST(Winding, IsInTelemetryAndSummaryAndItsEnergyBalances) {
  const Folder folder, out;
  const auto scenario = load_scenario(motor_scenario(folder), {"temperature_degC=40"});
  ASSERT_TRUE(scenario) << scenario.error().message;
  const auto s = run(*scenario, {.directory = out.path});
  ASSERT_TRUE(s) << s.error().message;
  const auto& winding = s->joints[0].winding;
  ASSERT_TRUE(winding);
  EXPECT_EQ(winding->start_degC, 40);
  EXPECT_GT(winding->end_degC, 41);
  EXPECT_GE(winding->max_degC, winding->end_degC);
  EXPECT_LT(std::abs(s->energy_balance_J), 1e-3 * s->motor_work_J);
  const double flowed_J = s->heat_J - s->friction_work_J;
  EXPECT_GT(flowed_J, 0);
  EXPECT_NEAR(winding->copper_loss_J, flowed_J + 5 * (winding->end_degC - 40), 1e-9 * winding->copper_loss_J);
  const auto record = read_telemetry(out.path / "telemetry.h5");
  ASSERT_TRUE(record);
  const auto T = record->channel("hinge", "winding_temperature_degC"), I = record->channel("hinge", "motor_current_A"),
             torque = record->channel("hinge", "torque_nm"), limit = record->channel("hinge", "motor_current_limit_A");
  ASSERT_GT(T.size(), 100u);
  EXPECT_NEAR(T[0], 40, 1e-4);
  for (std::size_t i = 0; i < T.size(); ++i) {
    EXPECT_NEAR(I[i], torque[i] / 5, 1e-4 * std::abs(I[i]) + 1e-6);
    EXPECT_NEAR(limit[i], 20, 1e-4);
  }
  EXPECT_THAT(summary_json(*s), HasSubstr("copper_loss_J"));
}

/// The shipped servo against its equations, integrated here from the currents and the friction of the steps.
TEST(Winding, TheShippedServoHeatsAsItsLossesTell) {
  Twin twin(load_scenario(scenarios / "xl330_winding.yaml", {"duration_s=120"}).value());
  const double dt = 1e-3, R = 3.433, C = 0.4, to_gear_K_W = 15, R_th = 24, kappa = 384;
  double winding_K = 0, gear_K = 0, copper_J = 0, flowed_J = 0, friction_J = 0;  // over 25 degC
  while (twin.step() == Status::running) {
    const drive::Workspace& s = twin.drive(0);
    const double copper_W = s.current_A * s.current_A * R * (1 + 0.00393 * winding_K);
    const double flow_W = (winding_K - gear_K) / to_gear_K_W, friction_W = (s.friction_work_J - friction_J) / dt;
    friction_J = s.friction_work_J;
    winding_K += (copper_W - flow_W) / C * dt;
    gear_K += (R_th * (flow_W + friction_W) - gear_K) / kappa * dt;
    copper_J += copper_W * dt, flowed_J += flow_W * dt;
  }
  // Euler steps of 1 ms miss the exact ones of the plugin by dt over twice the shortest time constant.
  const double share = dt / (C * to_gear_K_W);
  EXPECT_NEAR(twin.winding_degC(0), 25 + winding_K, share * winding_K);
  EXPECT_NEAR(twin.temperature_degC(0), 25 + gear_K, share * gear_K);
  const Summary s = summarize(twin, 0);
  ASSERT_TRUE(s.joints[0].winding);
  EXPECT_NEAR(s.joints[0].winding->copper_loss_J, copper_J, share * copper_J);
  EXPECT_NEAR(s.joints[0].winding->to_gear_J, flowed_J, 2 * share * flowed_J);
  EXPECT_NEAR(s.heat_J, s.friction_work_J + s.joints[0].winding->to_gear_J, 1e-9 * s.heat_J);
  EXPECT_GT(s.joints[0].winding->to_gear_J, s.friction_work_J);  // copper makes more heat than friction
  EXPECT_LT(std::abs(s.energy_balance_J), 1e-3 * s.motor_work_J);
}

TEST(Winding, SkippedCyclesAreRefused) {
  const Folder folder;
  const auto scenario = load_scenario(motor_scenario(folder), {"multirate={tolerance_K: 2}"});
  ASSERT_FALSE(scenario);
  EXPECT_THAT(scenario.error().message, HasSubstr("winding"));
}

TEST(Twin, OwnsItsScenario) {
  // The scenario's events and motion are read in every step; the address sanitizer sees it if they are gone.
  Twin twin(load_scenario(scenarios / "irb6620_warmup.yaml").value());
  for (int i = 0; i < 100; ++i) ASSERT_EQ(twin.step(), Status::running);
  Twin copy(twin.scenario());
  for (int i = 0; i < 100; ++i) ASSERT_EQ(copy.step(), Status::running);
  EXPECT_EQ(copy.temperature_degC(1), twin.temperature_degC(1));
}

TEST(Twin, FinishesAtTheScenariosEnd) {
  Twin twin(load_scenario(scenarios / "irb6620_hold.yaml", {"duration_s=0.1", "timestep_s=0.002"}).value());
  int steps = 0;
  while (twin.step() == Status::running) ++steps;
  EXPECT_EQ(steps, 50);
  EXPECT_EQ(twin.steps(), twin.steps_total());
  EXPECT_EQ(twin.status(), Status::finished);
  EXPECT_EQ(twin.step(), Status::finished);
  EXPECT_EQ(twin.steps(), 50);
}

TEST(Realtime, StopsWhileItWaitsForSkippedCycles) {
  std::atomic<bool> stop = false;
  std::atomic<int> cycles = 0;
  auto ran = std::async(std::launch::async, [&] {
    return run(load_scenario(scenarios / "irb6620_warmup.yaml").value(),
               {.realtime = true, .stop = &stop, .cycle = [&](double, std::span<const CycleSample>) { ++cycles; }});
  });
  while (cycles < 1)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));  // it is computed, others follow from it
  std::this_thread::sleep_for(std::chrono::seconds(1));
  stop = true;
  EXPECT_EQ(ran.wait_for(std::chrono::seconds(30)), std::future_status::ready);
  EXPECT_TRUE(ran.get()->interrupted);
}

TEST(Divergence, StopsWithStepJointAndState) {
  const auto s = run(
      load_scenario(scenarios / "irb6620_hold.yaml", {"control.torque_nm={joint6: 1e9}", "duration_s=10"}).value(), {});
  // The actuator's range limits the torque; without it the arm would leave the world. A velocity set by hand does.
  Scenario scenario = load_scenario(scenarios / "irb6620_hold.yaml").value();
  Twin twin(scenario);
  ASSERT_TRUE(twin.step());
  twin.data()->qvel[2] = std::nan("");
  const auto stopped = twin.step();
  ASSERT_FALSE(stopped);
  EXPECT_THAT(stopped.error().message,
              testing::AllOf(HasSubstr("diverged at step 1"), HasSubstr("joint3"), HasSubstr("State before the step")));
  EXPECT_EQ(stopped.error().kind, ErrorKind::work);
  EXPECT_FALSE(twin.status());
  EXPECT_FALSE(twin.step()) << "a failed twin stays failed";
  EXPECT_EQ(twin.steps(), 1);
  EXPECT_TRUE(s);
}

}  // namespace
}  // namespace tribotwin::twin
