#include <cmath>
#include <filesystem>
#include <fstream>
#include <optional>

#include "../fmu_checks.hpp"
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/portable/robot/robot_fmu.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path shipped = fs::path(TRIBOTWIN_SOURCE_DIR) / "twin/scenarios";

Scenario scenario_of(const fs::path& file, const std::vector<std::string>& settings = {}) {
  return load_scenario(file, settings).value();
}

/// A robot's FMU as an importer has it: unpacked, its library loaded.
class RobotFmu {
 public:
  RobotFmu(const Scenario& scenario, RobotCommands commands, FmiVersion version) : version_(version) {
    const auto files = robot_fmu_files(scenario, commands, "robot", version, LIBRARY).value();
    for (const FmuFile& file : files) {
      const fs::path path = folder_.path() / file.name;
      fs::create_directories(path.parent_path());
      std::ofstream(path, std::ios::binary) << file.content;
      if (file.name == "modelDescription.xml") description.emplace(file.content);
    }
    library.emplace((folder_.path() / fmu_library_name("robot", version)).string());
  }
  unsigned operator[](const std::string& name) const { return description->references.at(name); }
  std::string resources() const {
    const std::string path = (folder_.path() / "resources").string();
    return version_ == FmiVersion::two ? "file://" + path : path + "/";
  }
  std::unique_ptr<Instance> instance() const {
    return instantiate(*library, version_, description->token, resources());
  }

  std::optional<Described> description;
  std::optional<Library> library;

 private:
  FmiVersion version_;
  TemporaryFolder folder_{"tribotwin robot"};  // a blank in the name
};

/// The outputs of all joints, in the order of Twin's drives.
std::vector<double> outputs(Instance& instance, const RobotFmu& fmu, const std::vector<std::string>& joints) {
  std::vector<unsigned> references;
  for (const auto& joint : joints)
    for (const char* name :
         {"position_rad", "velocity_rad_s", "torque_nm", "friction_nm", "load_nm", "temperature_degC", "heat_J"})
      references.push_back(fmu[joint + "." + name]);
  std::vector<double> values(references.size());
  EXPECT_EQ(instance.get(references, values.data()), ok);
  return values;
}

std::vector<double> expected_outputs(const Twin& t) {
  std::vector<double> values;
  for (std::size_t i = 0; i < t.model().drives().size(); ++i) {
    const auto& b = t.model().drives()[i];
    const auto& w = t.drive(i);
    values.insert(values.end(), {b.angle(t.data()), b.speed(t.data()), w.torque_nm, w.friction_nm, w.load_used_nm,
                                 t.temperature_degC(i), w.heat_J});
  }
  return values;
}

class Robot : public testing::TestWithParam<FmiVersion> {
 protected:
  void SetUp() override { reported().clear(); }
};
INSTANTIATE_TEST_SUITE_P(Fmi, Robot, testing::Values(FmiVersion::two, FmiVersion::three));

/// Events, faults, payload: every step of the run, bit by bit.
TEST_P(Robot, RunEqualsThatOfTheProgram) {
  const Scenario scenario = scenario_of(
      shipped / "irb6620_warmup.yaml",
      {"duration_s=1.5", "multirate.enabled=false", "telemetry_rate_hz=1000",
       "events=[{time_s: 0.4, type: fault, joint: joint2, fault: wear, severity: 0.3, growth_per_h: 5}, {time_s: 0.6, "
       "type: payload, mass_kg: 80}, {time_s: 0.8, type: ambient, temperature_degC: 5}]"});
  const RobotFmu fmu(scenario, RobotCommands::scenario, GetParam());
  const auto instance = fmu.instance();
  begin(*instance);
  const auto joints = joint_names(*scenario.model);
  double time_s = 0;
  int compared = 0;
  const auto compare = [&](const Twin& twin, double) {
    ASSERT_EQ(instance->step(time_s, 1e-3), ok);
    time_s += 1e-3;
    ASSERT_EQ(outputs(*instance, fmu, joints), expected_outputs(twin)) << compared;
    ++compared;
  };
  const auto summary = run(scenario, {.sample = compare});
  ASSERT_TRUE(summary);
  EXPECT_EQ(compared, 1500);
  EXPECT_EQ(instance->step(time_s, 1e-3), error);
  EXPECT_THAT(reported().back(), HasSubstr("the scenario ends at 1.5 s"));
  // Again, in longer steps.
  ASSERT_EQ(instance->reset(), ok);
  ASSERT_EQ(instance->enter(0), ok);
  ASSERT_EQ(instance->exit(), ok);
  for (int k = 0; k < 6; ++k) ASSERT_EQ(instance->step(0.25 * k, 0.25), ok);
  Twin twin(scenario);
  while (twin.step() == Status::running) continue;
  EXPECT_EQ(outputs(*instance, fmu, joints), expected_outputs(twin));
  EXPECT_EQ(instance->terminate(), ok);
}

/// Two instances at once with commands of their own, beside two commanded twins.
TEST_P(Robot, FollowsCommands) {
  const Scenario scenario = scenario_of(shipped / "irb6620_hold.yaml");
  const auto joints = joint_names(*scenario.model);
  const std::tuple<RobotCommands, const char*, double> kinds[] = {
      {RobotCommands::torque, "torque_command_nm", 900},
      {RobotCommands::velocity, "velocity_command_rad_s", 0.4},
      {RobotCommands::position, "position_command_rad", 0.1}};
  for (const auto& [commands, input, size] : kinds) {
    SCOPED_TRACE(input);
    const RobotFmu fmu(scenario, commands, GetParam());
    const auto one = fmu.instance(), two = fmu.instance();
    begin(*one), begin(*two);
    Instance* const instances[] = {one.get(), two.get()};
    Twin first(scenario, Twin::commanded), second(scenario, Twin::commanded);
    Twin* const twins[] = {&first, &second};
    EXPECT_EQ(one->get(fmu[joints[1] + "." + input]), commands == RobotCommands::position ? scenario.start_rad[1] : 0);
    for (int k = 0; k < 200; ++k)
      for (const int which : {0, 1}) {
        for (std::size_t i = 0; i < joints.size(); ++i) {
          const double value = size * std::sin(0.1 * k + which + static_cast<double>(i));
          ASSERT_EQ(instances[which]->set(fmu[joints[i] + "." + input], value), ok);
          DriveCommand& c = twins[which]->commands()[i];
          c.mode = commands == RobotCommands::torque     ? DriveCommand::Mode::torque
                   : commands == RobotCommands::velocity ? DriveCommand::Mode::velocity
                                                         : DriveCommand::Mode::position;
          (commands == RobotCommands::torque     ? c.torque_nm
           : commands == RobotCommands::velocity ? c.velocity_rad_s
                                                 : c.position_rad) = value;
        }
        ASSERT_EQ(instances[which]->step(2e-3 * k, 2e-3), ok);
        for (int twice = 0; twice < 2; ++twice) ASSERT_TRUE(twins[which]->step());
        ASSERT_EQ(outputs(*instances[which], fmu, joints), expected_outputs(*twins[which])) << k;
      }
    EXPECT_NE(outputs(*one, fmu, joints), outputs(*two, fmu, joints));
    EXPECT_EQ(one->set(fmu[joints[0] + "." + input], NAN), ok);
    EXPECT_EQ(one->step(0.4, 1e-3), error);
    EXPECT_THAT(reported().back(), HasSubstr("is not finite"));
    EXPECT_EQ(one->set(fmu[joints[0] + ".friction_nm"], 1), error);
  }
}

/// Into the same instance, and by bytes into another one: in the middle of growing faults, with events to come.
TEST_P(Robot, StatesAreRestoredBitByBit) {
  const Scenario scenario = scenario_of(
      shipped / "irb6620_warmup.yaml",
      {"duration_s=1.5", "multirate.enabled=false",
       "events=[{time_s: 0.1, type: fault, joint: joint2, fault: wear, severity: 0.3, growth_per_h: 50}, {time_s: 0.2, "
       "type: payload, mass_kg: 80}, {time_s: 0.5, type: ambient, temperature_degC: 5}, {time_s: 0.6, type: fault, "
       "joint: joint3, fault: pitted_bearing, severity: 0.2}]"});
  const RobotFmu fmu(scenario, RobotCommands::scenario, GetParam());
  const auto joints = joint_names(*scenario.model);
  const auto one = fmu.instance(), two = fmu.instance();
  begin(*one), begin(*two);
  const auto run = [&](Instance& instance, int from, int steps) {
    std::vector<std::vector<double>> rows;
    for (int k = from; k < from + steps; ++k) {
      EXPECT_EQ(instance.step(1e-3 * k, 1e-3), ok);
      rows.push_back(outputs(instance, fmu, joints));
    }
    return rows;
  };
  const auto past = run(*one, 0, 400);
  void *state = nullptr, *carried = nullptr;
  ASSERT_EQ(one->save(&state), ok) << testing::PrintToString(reported());
  const auto expected = run(*one, 400, 500);
  EXPECT_NE(expected.front(), expected.back());
  const std::vector<char> bytes = one->serialized(state);
  ASSERT_FALSE(bytes.empty());
  ASSERT_EQ(one->restore(state), ok);
  EXPECT_EQ(one->get(0), 0.4);
  EXPECT_EQ(outputs(*one, fmu, joints), past.back());
  EXPECT_EQ(run(*one, 400, 500), expected);
  ASSERT_EQ(two->deserialize(bytes, &carried), ok);
  EXPECT_EQ(two->serialized(carried), bytes);
  ASSERT_EQ(two->restore(carried), ok);
  EXPECT_EQ(run(*two, 400, 500), expected);
  for (const std::size_t at : {std::size_t{3}, bytes.size() / 2, bytes.size() - 1}) {
    std::vector<char> damaged = bytes;
    damaged[at] ^= 1;
    void* none = nullptr;
    EXPECT_EQ(two->deserialize(damaged, &none), error);
    EXPECT_EQ(none, nullptr);
  }
  const RobotFmu another(scenario_of(shipped / "irb6620_hold.yaml"), RobotCommands::scenario, GetParam());
  const auto stranger = another.instance();
  begin(*stranger);
  EXPECT_EQ(stranger->restore(state), error);
  EXPECT_THAT(reported().back(), HasSubstr("another FMU"));
  EXPECT_EQ(stranger->step(0, 1e-3), ok);
  EXPECT_EQ(one->release(&state), ok);
  EXPECT_EQ(two->release(&carried), ok);
  EXPECT_EQ(state, nullptr);
}

/// Two libraries in one process, the first one let go while the second one steps on.
TEST_P(Robot, LibrariesLiveBesideEachOther) {
  const Scenario scenario = scenario_of(shipped / "irb6620_warmup.yaml", {"multirate.enabled=false"});
  const auto joints = joint_names(*scenario.model);
  auto first = std::make_unique<RobotFmu>(scenario, RobotCommands::scenario, GetParam());
  const RobotFmu second(scenario, RobotCommands::scenario, GetParam());
  auto one = first->instance();
  const auto two = second.instance();
  begin(*one), begin(*two);
  Twin twin(scenario);
  for (int k = 0; k < 300; ++k) {
    ASSERT_TRUE(twin.step());
    if (one) ASSERT_EQ(one->step(1e-3 * k, 1e-3), ok);
    ASSERT_EQ(two->step(1e-3 * k, 1e-3), ok);
    if (one) ASSERT_EQ(outputs(*one, *first, joints), expected_outputs(twin));
    ASSERT_EQ(outputs(*two, second, joints), expected_outputs(twin));
    if (k == 150) one.reset(), first.reset();
  }
}

TEST_P(Robot, WrongCallsAreErrors) {
  const Scenario scenario = scenario_of(shipped / "irb6620_hold.yaml");
  const RobotFmu fmu(scenario, RobotCommands::scenario, GetParam());
  const auto instance = fmu.instance();
  const auto refused = [&](FmiStatus status, const std::string& why) {
    EXPECT_EQ(status, error) << why;
    ASSERT_FALSE(reported().empty()) << why;
    EXPECT_THAT(reported().back(), HasSubstr(why));
    reported().clear();
  };
  refused(instance->step(0, 1e-3), "not allowed before initialization");
  begin(*instance);
  refused(instance->step(0, 1.5e-3), "a multiple of the robot's time step, 0.001 s");
  refused(instance->step(0, 1e-9), "a multiple");
  refused(instance->step(0, NAN), "the step must be above 0");
  refused(instance->step(1, 1e-3), "communication point");
  double value = 0;
  refused(instance->get({9999}, &value), "no such value reference");
  refused(instance->get({fmu["outside"]}, &value), "no such value reference");
  bool outside = true;
  EXPECT_EQ(instance->outside(fmu["outside"], outside), ok);
  refused(instance->save(nullptr), "NULL");
  refused(instance->restore(nullptr), "NULL");
  EXPECT_EQ(instance->step(0, 1e-3), ok);
  EXPECT_EQ(instance->get(0), 1e-3);
  const auto create = [&](const std::string& token, const std::string& resources) {
    return instantiate(*fmu.library, GetParam(), token, resources)->exists();
  };
  EXPECT_FALSE(create("{another}", fmu.resources()));
  EXPECT_THAT(reported().back(), HasSubstr("modelDescription.xml"));
  EXPECT_FALSE(create(fmu.description->token, ""));
  EXPECT_THAT(reported().back(), HasSubstr("no folder of resources"));
  EXPECT_FALSE(create(fmu.description->token, "/nowhere"));
  EXPECT_THAT(reported().back(), HasSubstr("/nowhere/fmu.yaml"));
}

TEST_P(Robot, EveryFunctionAnswers) {
  const RobotFmu fmu(scenario_of(shipped / "irb6620_hold.yaml"), RobotCommands::scenario, GetParam());
  every_function_answers(*fmu.library, GetParam(), [&] { return fmu.instance(); });
}

constexpr const char* arm = R"(<mujoco>
  <compiler meshdir="shapes"/>
  <extension><plugin plugin="tribotwin.drive"><instance name="j">
    <config key="law" value="stribeck"/> <config key="Fc" value="0.03"/> <config key="Fs" value="0.02"/>
    <config key="Fv" value="4e-4"/> <config key="vs" value="10"/> <config key="alpha" value="1.3"/>
    <config key="torque_max_nm" value="100"/> <config key="gear_ratio" value="50"/>
  </instance></plugin></extension>
  <asset><mesh file="wedge.stl" scale=".3 .3 .3"/></asset>
  <include file="parts/body.xml"/>
  <actuator>
    <plugin name="drive" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="3" dyntype="user"/>
  </actuator>
</mujoco>
)";
constexpr const char* body = R"(<mujoco><worldbody><body>
  <joint name="hinge" axis="0 1 0" armature=".5" frictionloss="1" solreffriction=".001 1"
         solimpfriction=".9999 .9999 .001 .5 2"/>
  <geom type="mesh" mesh="wedge"/>
</body></worldbody></mujoco>
)";

/// A tetrahedron as binary STL.
std::string wedge() {
  const float corners[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const int sides[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  std::string bytes(80, ' ');
  const auto add = [&](const auto& x) { bytes.append(reinterpret_cast<const char*>(&x), sizeof x); };
  add(std::uint32_t{4});
  for (const auto& side : sides) {
    for (int i = 0; i < 3; ++i) add(0.f);
    for (const int corner : side) add(corners[corner]);
    add(std::uint16_t{0});
  }
  return bytes;
}

/// Includes, meshes and recordings travel with the FMU: what it was made of may be gone.
TEST_P(Robot, ResourcesAreWhole) {
  auto folder = std::make_unique<TemporaryFolder>("tribotwin-arm");
  const auto write = [&](const fs::path& name, const std::string& text) {
    fs::create_directories((folder->path() / name).parent_path());
    std::ofstream(folder->path() / name, std::ios::binary) << text;
  };
  write("models/arm.xml", arm), write("models/parts/body.xml", body), write("models/shapes/wedge.stl", wedge());
  write("data/moves.csv", "time_s,position_hinge_rad\n0,0\n0.1,0.2\n0.3,-0.1\n0.5,0.3\n");
  write("s.yaml",
        "model: models/arm.xml\nduration_s: 0.5\ntelemetry_rate_hz: 100\nmotion: {type: recording, file: "
        "data/moves.csv}\n");
  const Scenario scenario = scenario_of(folder->path() / "s.yaml");
  const RobotFmu fmu(scenario, RobotCommands::scenario, GetParam());
  folder.reset();
  const auto instance = fmu.instance();
  ASSERT_TRUE(instance->exists()) << testing::PrintToString(reported());
  begin(*instance);
  Twin twin(scenario);
  const double dt_s = (*scenario.model)->opt.timestep;
  for (int k = 0; twin.step() == Status::running; ++k) {
    ASSERT_EQ(instance->step(k * dt_s, dt_s), ok);
    ASSERT_EQ(outputs(*instance, fmu, {"hinge"}), expected_outputs(twin)) << k;
  }
}

/// A motor with a winding has three more outputs; their units are in the description, and they follow the twin's.
TEST_P(Robot, WindingsAreOutputs) {
  const Scenario scenario = scenario_of(shipped / "xl330_winding.yaml", {"duration_s=2"});
  const RobotFmu fmu(scenario, RobotCommands::scenario, GetParam());
  const auto instance = fmu.instance();
  begin(*instance);
  const std::vector<unsigned> references{fmu["hinge.winding_temperature_degC"], fmu["hinge.motor_current_A"],
                                         fmu["hinge.motor_current_limit_A"]};
  for (const auto& [name, unit] :
       {std::pair{"winding_temperature_degC", "degC"}, {"motor_current_A", "A"}, {"motor_current_limit_A", "A"}})
    EXPECT_EQ(fmu.description->unit(std::string("hinge.") + name), unit);
  Twin twin(scenario);
  for (int k = 0; k < 1000; ++k) {
    ASSERT_EQ(instance->step(1e-3 * k, 1e-3), ok);
    ASSERT_TRUE(twin.step());
    std::vector<double> values(3);
    ASSERT_EQ(instance->get(references, values.data()), ok);
    ASSERT_EQ(values, (std::vector{twin.winding_degC(0), twin.drive(0).current_A, twin.drive(0).current_limit_A})) << k;
  }
  EXPECT_GT(twin.winding_degC(0), 25.01);
  const RobotFmu plain(scenario_of(shipped / "irb6620_hold.yaml"), RobotCommands::scenario, GetParam());
  EXPECT_FALSE(plain.description->references.contains("joint1.winding_temperature_degC"));
}

TEST(RobotFiles, SameScenarioSameToken) {
  const auto token = [](const std::vector<std::string>& settings, RobotCommands commands) {
    const Scenario s = scenario_of(shipped / "irb6620_hold.yaml", settings);
    return Described(robot_fmu_files(s, commands, "robot", FmiVersion::two, LIBRARY).value()[0].content).token;
  };
  const std::string one = token({}, RobotCommands::scenario);
  EXPECT_EQ(one, token({}, RobotCommands::scenario));
  EXPECT_NE(one, token({"ambient_degC=51"}, RobotCommands::scenario));
  EXPECT_NE(one, token({}, RobotCommands::torque));
}

}  // namespace
}  // namespace tribotwin::twin
