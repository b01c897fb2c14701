#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <optional>
#include <regex>
#include <sstream>

#include "fmu_checks.hpp"
#include "joints.hpp"
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/twin/portable/joint_parameters.hpp>

namespace tribotwin::twin {
namespace {

using testing::HasSubstr;

/// With UBSan, whose findings end the program, and as strict as the issue asks for.
std::string compile_command(FmiVersion version, const std::string& compiler) {
  const std::string trap = compiler == "gcc" ? "-fsanitize-undefined-trap-on-error" : "-fsanitize-trap=undefined";
  return fmt::format(
      "{} {} -O1 -ffp-contract=off -fsanitize=undefined {} -fPIC -shared -DFMI{}_OVERRIDE_FUNCTION_PREFIX", compiler,
      strict, trap, static_cast<int>(version));
}

/// An FMU as an importer has it: variables by name, from modelDescription.xml, and its compiled sources.
class Fmu {
 public:
  Fmu(const Drive& drive, FmiVersion version, const std::string& compiler = "gcc") {
    const auto files = fmu_files(drive, "joint", version).value();
    std::string sources;
    for (const FmuFile& file : files) {
      const std::string name = std::filesystem::path(file.name).filename();
      if (file.name.starts_with("sources/")) folder_.write(name, file.content);
      if (file.name.ends_with(".c")) sources += " " + name;
      if (file.name == "modelDescription.xml") description = file.content;
    }
    if (folder_.run(compile_command(version, compiler) + sources + " -o fmu.so -lm") != 0)
      throw std::runtime_error("the sources do not compile");
    library.emplace(folder_.file("fmu.so"));
    const Described described(description);
    references = described.references, token = described.token;
  }
  unsigned operator[](const std::string& name) const { return references.at(name); }

  std::string description, token;
  std::map<std::string, unsigned> references;
  std::optional<Library> library;

 private:
  Folder folder_;
};

class Standard : public testing::TestWithParam<FmiVersion> {
 protected:
  void SetUp() override { reported().clear(); }
  static inline std::vector<Drive> all = drives(1);
};
INSTANTIATE_TEST_SUITE_P(Fmi, Standard, testing::Values(FmiVersion::two, FmiVersion::three));

/// A drive in C++ beside an instance of its FMU, with the same inputs.
struct Pair {
  Drive drive;
  Instance& instance;
  const Fmu& fmu;
  Random random;
  drive::Sliding s{};
  double time_s = 0;
  int windings = 0;  ///< steps with a current below its limit

  bool heats() const { return drive.thermal.order != thermal::Order::prescribed; }
  bool in_range() const {
    return std::ranges::all_of(joint_parameters(drive),
                               [](const JointParameter& p) { return p.value >= p.minimum && p.value <= p.maximum; });
  }
  /// Other numbers of every kind, within their ranges, and faults.
  void tune() {
    const Drive before = drive;
    for (int tries = 0; tries == 0 || !in_range(); ++tries) {
      ASSERT_LT(tries, 10'000);
      drive = tuned(before, random);
    }
    const drive::Faults f = faults_of(random);
    drive::set_faults(s.workspace, f);
    std::vector<unsigned> references;
    std::vector<double> values;
    const auto add = [&](std::string_view name, double value) {
      references.push_back(fmu[std::string(name)]), values.push_back(value);
    };
    for (const JointParameter& p : joint_parameters(drive)) add(p.name, p.value);
    add("fault_boundary", f.boundary), add("fault_stribeck_velocity", f.stribeck_velocity);
    add("fault_viscous", f.viscous), add("fault_ripple", f.ripple), add("fault_backlash_rad", f.backlash_rad);
    if (drive.winding.present()) add("fault_torque_loss", f.torque_loss);
    ASSERT_EQ(instance.set(references, values.data()), ok);
  }
  void step(int k) {
    const double ambient = drive.thermal.T_amb_degC + uniform(random, -20, 20);
    const double speed = (random() % 8 ? uniform(random, -200, 200) : 0) / drive.speed_scale(),
                 load = random() % 64 ? drive.torque_max_nm * uniform(random, -1.5, 1.5) : INFINITY,
                 dt = coin(random) ? 1e-3 : uniform(random, 1e-5, 10);
    const std::vector<unsigned> inputs{fmu["speed_rad_s"], fmu["load_nm"],
                                       fmu[heats() ? "ambient_degC" : "temperature_degC"]};
    const double values[] = {speed, load, ambient};
    ASSERT_EQ(instance.set(inputs, values), ok);
    if (heats())
      s.workspace.ambient_offset_K = ambient - drive.thermal.T_amb_degC;
    else
      drive::set_temperature(drive, s.state, ambient);
    const double friction = drive::slide(drive, thermal::decay(drive.thermal, dt), speed, load, s);
    ASSERT_EQ(instance.step(time_s, dt), ok) << k;
    time_s += dt;
    ASSERT_EQ(instance.get(fmu["friction_nm"]), friction) << k << " " << drive.law.info->name;
    ASSERT_EQ(instance.get(fmu["limit_nm"]), s.workspace.limit_nm) << k;
    ASSERT_EQ(instance.get(fmu["heat_W"]), friction * speed) << k;
    ASSERT_EQ(instance.get(fmu["heat_J"]), s.workspace.heat_J) << k;
    if (heats()) ASSERT_EQ(instance.get(fmu["temperature_degC"]), drive::temperature_degC(drive, s.state)) << k;
    bool outside = false;
    ASSERT_EQ(instance.outside(fmu["outside"], outside), ok);
    ASSERT_EQ(outside, s.workspace.outside != 0) << k;
    if (drive.winding.present()) compare_winding(k);
  }
  void compare_winding(int k) {
    ASSERT_EQ(instance.get(fmu["winding_temperature_degC"]), drive::winding_degC(drive, s.state)) << k;
    ASSERT_EQ(instance.get(fmu["motor_current_A"]), s.workspace.current_A) << k;
    ASSERT_EQ(instance.get(fmu["motor_current_limit_A"]), s.workspace.current_limit_A) << k;
    ASSERT_EQ(instance.get(fmu["overload"]), s.state.winding.overload) << k;
    ASSERT_EQ(instance.get(fmu["copper_loss_J"]), s.workspace.copper_loss_J) << k;
    ASSERT_EQ(instance.get(fmu["winding_heat_J"]), s.workspace.winding_heat_J) << k;
    windings += s.workspace.current_A != 0 && std::abs(s.workspace.current_A) < s.workspace.current_limit_A;
  }
};

/// Two instances of each FMU at once, with inputs of their own; both compilers. By day half of the joints by each of
/// the two standards, the other half by the other one.
TEST_P(Standard, StepsEqualCppBitByBit) {
  ASSERT_EQ(all.size(), 3 * friction::laws().size());
  int windings = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!std::getenv("TRIBOTWIN_NIGHTLY") && (i / 2 % 2 == 0) != (GetParam() == FmiVersion::two)) continue;
    SCOPED_TRACE(fmt::format("joint {}", i));
    const Fmu fmu(all[i], GetParam(), i % 2 ? "clang" : "gcc");
    const auto one = instantiate(*fmu.library, GetParam(), fmu.token),
               two = instantiate(*fmu.library, GetParam(), fmu.token);
    begin(*one), begin(*two);
    Pair pairs[] = {{all[i], *one, fmu, Random(i)}, {all[i], *two, fmu, Random(1000 + i)}};
    for (int k = 0; k < 2200; ++k)
      for (Pair& pair : pairs) {
        if (k == 1100) pair.tune();
        pair.step(k);
        if (HasFatalFailure()) return;
      }
    EXPECT_EQ(one->terminate(), ok);
    for (const Pair& pair : pairs) windings += pair.windings;
  }
  EXPECT_GT(windings, 1000);
  EXPECT_THAT(reported(), testing::IsEmpty());
}

std::vector<double> everything(Instance& instance, const Fmu& fmu) {
  std::vector<unsigned> references;
  for (const auto& [name, reference] : fmu.references)
    if (name != "outside") references.push_back(reference);
  std::vector<double> values(references.size());
  EXPECT_EQ(instance.get(references, values.data()), ok);
  return values;
}

std::vector<std::vector<double>> run_on(Instance& instance, const Fmu& fmu, double time_s) {
  std::vector<std::vector<double>> rows;
  for (int k = 0; k < 50; ++k, time_s += 0.5) {
    EXPECT_EQ(instance.set(fmu["speed_rad_s"], std::sin(0.3 * k)), ok);
    EXPECT_EQ(instance.step(time_s, 0.5), ok);
    rows.push_back(everything(instance, fmu));
  }
  return rows;
}

TEST_P(Standard, StatesAreRestoredBitByBit) {
  bool winding = false;
  for (std::size_t i = 0; i < all.size(); i += 5) {
    winding = winding || all[i].winding.present();
    const Fmu fmu(all[i], GetParam());
    const auto one = instantiate(*fmu.library, GetParam(), fmu.token),
               two = instantiate(*fmu.library, GetParam(), fmu.token);
    begin(*one);
    EXPECT_EQ(one->set(fmu["load_nm"], 0.3 * all[i].torque_max_nm), ok);
    EXPECT_EQ(one->set(fmu["fault_viscous"], 0.25), ok);
    run_on(*one, fmu, 0);
    void *state = nullptr, *carried = nullptr;
    ASSERT_EQ(one->save(&state), ok);
    const auto now = everything(*one, fmu);
    const auto expected = run_on(*one, fmu, 25);
    const std::vector<char> bytes = one->serialized(state);
    ASSERT_FALSE(bytes.empty());
    ASSERT_EQ(one->restore(state), ok);
    EXPECT_EQ(everything(*one, fmu), now);
    EXPECT_EQ(run_on(*one, fmu, 25), expected);
    // Into another instance, which has done nothing yet.
    ASSERT_EQ(two->deserialize(bytes, &carried), ok);
    EXPECT_EQ(two->serialized(carried), bytes);
    ASSERT_EQ(two->restore(carried), ok);
    EXPECT_EQ(run_on(*two, fmu, 25), expected);
    // A state that exists is written anew, not leaked.
    void* const place = state;
    EXPECT_EQ(one->save(&state), ok);
    EXPECT_EQ(state, place);
    for (std::size_t at : {std::size_t{3}, bytes.size() / 2, bytes.size() - 1}) {
      std::vector<char> damaged = bytes;
      damaged[at] ^= 1;
      void* none = nullptr;
      EXPECT_EQ(two->deserialize(damaged, &none), error);
      EXPECT_EQ(none, nullptr);
    }
    EXPECT_EQ(one->release(&state), ok);
    EXPECT_EQ(two->release(&carried), ok);
    EXPECT_EQ(state, nullptr);
  }
  EXPECT_TRUE(winding);
}

TEST_P(Standard, WrongCallsAreErrors) {
  const Fmu fmu(all[0], GetParam());
  const auto one = instantiate(*fmu.library, GetParam(), fmu.token);
  const auto refused = [&](FmiStatus status, const std::string& why, FmiStatus expected = error) {
    EXPECT_EQ(status, expected) << why;
    EXPECT_FALSE(reported().empty()) << why;
    if (!reported().empty()) EXPECT_THAT(reported().back(), HasSubstr(why));
    reported().clear();
  };
  refused(one->step(0, 1e-3), "not allowed before initialization");
  refused(one->exit(), "not allowed before initialization");
  refused(one->terminate(), "not allowed before initialization");
  refused(one->enter(NAN), "the start time");
  refused(one->enter(0, true, -1), "the stop time");
  ASSERT_EQ(one->enter(1, true, 2), ok);
  refused(one->call("EnterInitializationMode"), "not allowed in initialization mode");
  refused(one->step(1, 1e-3), "not allowed in initialization mode");
  ASSERT_EQ(one->exit(), ok);
  refused(one->enter(0), "not allowed after initialization");
  refused(one->step(0, 1e-3), "communication point");
  refused(one->step(NAN, 1e-3), "communication point");
  for (const double dt : {0.0, -1.0, double(NAN), double(INFINITY)})
    refused(one->step(1, dt), "the step must be above 0");
  refused(one->step(1, 1.5), "after the stop time");
  EXPECT_EQ(one->step(1, 0.5), ok);
  double value = 0;
  refused(one->get({9999}, &value), "no such value reference");
  refused(one->get({0}, nullptr), "NULL");
  refused(one->set(fmu["friction_nm"], 1), "is a result");
  refused(one->set(fmu["outside"], 1), "no such value reference");
  const std::string parameter(all[0].law.info->parameters[0].name);
  const double before = one->get(fmu[parameter]);
  refused(one->set(fmu[parameter], 1e300), parameter, discard);
  refused(one->set(fmu[parameter], NAN), "must be within", discard);
  const double two_values[] = {0.5, 1e300};
  refused(one->set({fmu["load_nm"], fmu[parameter]}, two_values), "must be within", discard);
  EXPECT_EQ(one->get(fmu["load_nm"]), 0);
  EXPECT_EQ(one->get(fmu[parameter]), before);
  refused(one->restore(nullptr), "NULL");
  refused(one->save(nullptr), "NULL");
  ASSERT_EQ(one->terminate(), ok);
  refused(one->step(1.5, 1e-3), "not allowed after termination");
  refused(one->set(fmu["load_nm"], 1), "not allowed after termination");
  EXPECT_EQ(one->get(fmu["time"]), 1.5);
  ASSERT_EQ(one->reset(), ok);
  EXPECT_EQ(one->get(fmu["time"]), 0);
  begin(*one);
  EXPECT_EQ(one->step(0, 1e-3), ok);
}

TEST_P(Standard, RefusesInstancesThatAreNotMeant) {
  const Fmu fmu(all[0], GetParam());
  EXPECT_FALSE(instantiate(*fmu.library, GetParam(), "{another}")->exists());
  ASSERT_FALSE(reported().empty());
  EXPECT_THAT(reported().back(), HasSubstr("modelDescription.xml"));
  reported().clear();
  if (GetParam() == FmiVersion::two)
    EXPECT_FALSE(Instance2(*fmu.library, fmu.token, 0).exists());  // model exchange
  else
    EXPECT_FALSE(Instance3(*fmu.library, fmu.token, true).exists());  // event mode
  EXPECT_EQ(reported().size(), 1u);
}

/// Start values, ranges and temperatures before the first step.
TEST_P(Standard, StartsAsDescribed) {
  for (const Drive& drive : all) {
    if (drive.thermal.order == thermal::Order::prescribed || !drive.winding.present()) continue;
    const Fmu fmu(drive, GetParam());
    const auto one = instantiate(*fmu.library, GetParam(), fmu.token);
    ASSERT_TRUE(one->exists());
    for (const JointParameter& p : joint_parameters(drive)) EXPECT_EQ(one->get(fmu[std::string(p.name)]), p.value);
    EXPECT_EQ(one->get(fmu["ambient_degC"]), drive.thermal.T_amb_degC);
    ASSERT_EQ(one->set(fmu["temperature_start_degC"], 61), ok);
    ASSERT_EQ(one->set(fmu["winding_temperature_start_degC"], 75), ok);
    ASSERT_EQ(one->set(fmu["speed_rad_s"], 0.5), ok);
    ASSERT_EQ(one->enter(0), ok);
    drive::Sliding s;
    drive::set_temperature(drive, s.state, 61);
    drive::set_winding(drive, s.state, 75);
    const double friction = drive::slide(drive, thermal::decay(drive.thermal, 0), 0.5, 0, s);
    EXPECT_EQ(one->get(fmu["friction_nm"]), friction);  // of the inputs, in initialization mode
    ASSERT_EQ(one->exit(), ok);
    EXPECT_EQ(one->get(fmu["temperature_degC"]), drive::temperature_degC(drive, s.state));
    EXPECT_EQ(one->get(fmu["winding_temperature_degC"]), drive::winding_degC(drive, s.state));
    EXPECT_EQ(one->get(fmu["motor_current_limit_A"]), s.workspace.current_limit_A);
    EXPECT_EQ(one->set(fmu["temperature_start_degC"], 20), error);
    return;
  }
  FAIL() << "no drive with heat and a winding";
}

TEST_P(Standard, EveryFunctionAnswers) {
  const Fmu fmu(all[0], GetParam());
  const std::string prefix = GetParam() == FmiVersion::two ? "fmi2" : "fmi3";
  every_function_answers(*fmu.library, GetParam(), [&] { return instantiate(*fmu.library, GetParam(), fmu.token); });
  EXPECT_STREQ(fmu.library->function<const char*()>(prefix + "GetVersion")(), prefix == "fmi2" ? "2.0" : "3.0");
}

TEST_P(Standard, FunctionsThatItLacksSaySo) {
  const Fmu fmu(all[0], GetParam());
  const auto one = instantiate(*fmu.library, GetParam(), fmu.token);
  begin(*one);
  const std::vector<std::string> lacking =
      GetParam() == FmiVersion::two
          ? std::vector<std::string>{"CancelStep"}
          : std::vector<std::string>{"EnterEventMode",        "EnterStepMode",          "EnterConfigurationMode",
                                     "ExitConfigurationMode", "EvaluateDiscreteStates", "EnterContinuousTimeMode"};
  for (const std::string& name : lacking) {
    reported().clear();
    EXPECT_EQ(one->call(name), error) << name;
    EXPECT_EQ(reported().size(), 1u) << name;
  }
  EXPECT_EQ(one->step(0, 1e-3), ok);
}

TEST_P(Standard, SourcesHaveThePrefixOfTheJoint) {
  const Folder folder;
  const std::string prefix = GetParam() == FmiVersion::two ? "fmi2" : "fmi3";
  std::string sources, user;
  for (const char* joint : {"one", "two"}) {
    const auto files = fmu_files(all[0], joint, GetParam()).value();
    std::filesystem::create_directory(folder.file(joint));
    for (const FmuFile& file : files)
      if (file.name.starts_with("sources/") && file.name.ends_with(".c")) {
        const std::string name = fmt::format("{}/{}", joint, file.name.substr(8));
        folder.write(name, file.content);
        sources += " " + name;
      }
    user += fmt::format("const char *{}_{}GetVersion(void);\n", joint, prefix);
  }
  user += fmt::format("int main(void)\n{{\n  return one_{0}GetVersion()[0] != two_{0}GetVersion()[0];\n}}\n", prefix);
  folder.write("user.c", user);
  for (const char* compiler : {"gcc", "clang"})
    EXPECT_EQ(folder.run(fmt::format("{} {} user.c {} -o user -lm && ./user", compiler, strict, sources)), 0);
}

TEST_P(Standard, SameJointSameBytes) {
  const auto files = fmu_files(all[0], "joint", GetParam()).value();
  EXPECT_EQ(zipped(files).value(), zipped(fmu_files(all[0], "joint", GetParam()).value()).value());
  Drive other = all[0];
  other.torque_max_nm *= 1 + 1e-15;
  EXPECT_NE(Fmu(all[0], GetParam()).token, Fmu(other, GetParam()).token);
  const auto library = fmu_library(files, "joint", GetParam());
  ASSERT_TRUE(library) << library.error().message;
  EXPECT_TRUE(
      library->starts_with("\x7f"
                           "ELF"));
}

}  // namespace
}  // namespace tribotwin::twin
