#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>

#include <dlfcn.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/plugins/drive/slide.hpp>
#include <tribotwin/twin/portable/c_source.hpp>

namespace tribotwin::twin {
namespace {

using drive::Configuration, drive::Drive;
using Random = std::mt19937_64;

double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
bool coin(Random& random) { return random() & 1; }

/// A value that a parameter may have, of any size that a joint may have.
double value_of(const friction::Parameter& p, Random& random) {
  const double size = std::pow(10, uniform(random, -4, 1.5));
  return std::clamp(p.minimum < 0 && random() % 3 == 0 ? -size : size, p.minimum, p.maximum);
}

Configuration keys_of(const friction::LawInfo& law, Random& random) {
  Configuration keys{{"law", std::string(law.name)}};
  const auto add = [&](std::string_view key, double value) { keys.emplace_back(key, fmt::format("{}", value)); };
  for (const auto& p : law.parameters) add(p.name, value_of(p, random));
  add("torque_max_nm", uniform(random, 1, 1e4)), add("gear_ratio", uniform(random, 1, 300));
  add("T_amb", uniform(random, -10, 60));
  if (coin(random)) keys.emplace_back("validity", "extrapolate");
  if (coin(random)) add("asymmetry", uniform(random, -0.5, 0.5));
  if (coin(random)) add("load_filter_s", uniform(random, 1e-3, 1));
  add("offset_nm", uniform(random, -3, 3));
  switch (random() % 3) {
    case 0:
      keys.emplace_back("thermal", "prescribed");
      break;
    case 1:
      keys.emplace_back("thermal", "first_order");
      add("R_th", uniform(random, 1e-3, 1)), add("kappa", uniform(random, 1, 1e4));
      break;
    default:
      keys.emplace_back("thermal", "second_order");
      for (const char* c : {"c1", "c2"}) add(c, uniform(random, 1e-6, 1e-4));
      for (const char* t : {"t1", "t2"}) add(t, uniform(random, 1, 1e4));
  }
  if (coin(random)) {
    keys.emplace_back("load_table_speeds", "0 3.5 90");
    keys.emplace_back("load_table_loads", "-0.7 -0.1 0.2 0.9");
    keys.emplace_back("load_table_values", "0.1 0 0.01 0.2 0.1 0.05 0 -0.01 0.03 0.02 0.01 0.3");
  }
  return keys;
}

void add_dynamics(Configuration& keys, unsigned which, Random& random) {
  const auto add = [&](std::string_view key, double value) { keys.emplace_back(key, fmt::format("{}", value)); };
  if (which == 1) {
    keys.emplace_back("friction", "lugre");
    add("sigma0", uniform(random, 1, 100)), add("sigma1", 1e-3), add("vd", uniform(random, 1e-3, 1));
  } else if (which == 2) {
    keys.emplace_back("friction", "gear_loss");
    add("mu_avg", uniform(random, 0.1, 0.3)), add("mu_dif", uniform(random, -0.1, 0.1));
    add("h", uniform(random, 1e-3, 1));
  }
}

/// Drives of every law of the table, of every dynamics, whatever else a drive may have; the same for the same seed.
std::vector<Drive> drives(unsigned per_kind) {
  Random random(20261125);
  std::vector<Drive> all;
  for (const auto& law : friction::laws())
    for (unsigned dynamics = 0; dynamics < 3; ++dynamics)
      for (unsigned n = 0, tries = 0; n < per_kind && tries < 200'000; ++tries) {
        Configuration keys = keys_of(law, random);
        add_dynamics(keys, dynamics, random);
        if (auto made = drive::make_drive("joint", keys)) all.push_back(std::move(*made)), ++n;
      }
  return all;
}

/// The state of a joint as its C file declares it.
struct CState {
  double ambient_K, boundary, stribeck_velocity, viscous, ripple, backlash_rad;
  double node_K[2], load_nm, bristle, position_rad, backlash_position, dt_s, decay[2];
  double temperature_degC, friction_nm, limit_nm, heat_J;
  int outside;
};

class Folder {
 public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "tribotwin_c_XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  std::filesystem::path file(const std::string& name) const { return path_ / name; }
  void write(const std::string& name, const std::string& text) const { std::ofstream(file(name)) << text; }
  /// Exit code of a command in the folder.
  int run(const std::string& command) const {
    return std::system(fmt::format("cd {} && {}", path_.string(), command).c_str());
  }

 private:
  std::filesystem::path path_;
};

std::string name_of(std::size_t i) { return fmt::format("joint{}", i); }

/// All joints in one file, each with its self test.
std::string source_of(const std::vector<Drive>& all) {
  std::string text;
  for (std::size_t i = 0; i < all.size(); ++i) {
    text += fmt::format("#define JOINT{}_SELF_TEST\n", i);
    text += c_source(all[i], name_of(i)).value();
  }
  text += "int wrong_rows(void);\nint wrong_rows(void)\n{\n  int wrong = 0;\n";
  for (std::size_t i = 0; i < all.size(); ++i) text += fmt::format("  wrong += {}_self_test();\n", name_of(i));
  return text + "  return wrong;\n}\n#ifdef MAIN\nint main(void) { return wrong_rows() != 0; }\n#endif\n";
}

constexpr const char* strict = "-std=c99 -Wall -Wextra -Wpedantic -Werror";

class CSource : public testing::Test {
 protected:
  static inline std::vector<Drive> all = drives(2);
  Folder folder;
};

/// Faults of the table in an arbitrary mixture.
drive::Faults faults_of(Random& random) {
  drive::Faults faults{};
  for (const auto& fault : drive::faults())
    if (fault.fault != drive::Fault::torque_constant && random() % 4 == 0)
      fault.add(faults, uniform(random, 0, std::min(fault.maximum, fault.unit == "rad" ? 1e-2 : 1.0)));
  return faults;
}

TEST_F(CSource, CoversEveryLawAndDynamics) { ASSERT_EQ(all.size(), 2 * 3 * friction::laws().size()); }

/// The same doubles as drive::slide, over 10^5 random steps with faults, inputs beyond the range and no numbers.
void compare(const std::vector<Drive>& all, void* library) {
  std::size_t steps = 0, sliding = 0, outside = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto find = [&](const char* what) { return dlsym(library, (name_of(i) + what).c_str()); };
    const auto step = reinterpret_cast<double (*)(CState*, double, double, double)>(find("_step"));
    const auto temperature = reinterpret_cast<double (*)(const CState*)>(find("_temperature"));
    const auto heat_up = reinterpret_cast<void (*)(CState*, double)>(find("_set_temperature"));
    CState c;
    reinterpret_cast<void (*)(CState*)>(find("_init"))(&c);
    drive::Sliding s;
    Random random(i);
    for (int k = 0; k < 2200; ++k, ++steps) {
      if (k % 100 == 0) {
        const drive::Faults f = faults_of(random);
        drive::set_faults(s.workspace, f);
        c.boundary = f.boundary, c.stribeck_velocity = f.stribeck_velocity, c.viscous = f.viscous;
        c.ripple = f.ripple, c.backlash_rad = f.backlash_rad;
        const double degC = uniform(random, -20, 120);
        drive::set_temperature(all[i], s.state, degC), heat_up(&c, degC);
        s.workspace.ambient_offset_K = c.ambient_K = uniform(random, -20, 20);
      }
      const double scale = all[i].speed_scale();
      double speed = std::pow(10, uniform(random, -3, 2.8)) / scale * (coin(random) ? 1 : -1);
      if (random() % 16 == 0) speed = 0;
      if (random() % 64 == 0) speed = k % 2 ? std::nan("") : 1e300;
      const double load = random() % 64 ? all[i].torque_max_nm * uniform(random, -2, 2) : INFINITY;
      const double dt = random() % 64 ? (coin(random) ? 1e-3 : uniform(random, 1e-5, 10)) : 0;
      const double expected = drive::slide(all[i], thermal::decay(all[i].thermal, dt), speed, load, s);
      ASSERT_EQ(step(&c, speed, load, dt), expected) << all[i].law.info->name << " " << i << " step " << k;
      ASSERT_EQ(temperature(&c), drive::temperature_degC(all[i], s.state)) << i << " step " << k;
      ASSERT_EQ(c.bristle, s.state.z) << i << " step " << k;
      ASSERT_EQ(c.outside != 0, s.workspace.outside != 0) << i << " step " << k;
      ASSERT_EQ(c.limit_nm, s.workspace.limit_nm) << i << " step " << k;
      sliding += expected != 0, outside += c.outside != 0;
    }
    ASSERT_EQ(c.heat_J, s.workspace.heat_J) << i;
  }
  EXPECT_GT(steps, 100'000u);
  EXPECT_GT(sliding, steps / 2);
  EXPECT_GT(outside, steps / 100);
}

TEST_F(CSource, EqualsCppBitByBit) {
  folder.write("all.c", source_of(all));
  for (const char* compiler : {"gcc -O2", "clang -O2"}) {
    SCOPED_TRACE(compiler);
    ASSERT_EQ(folder.run(fmt::format("{} {} -fPIC -shared all.c -o {}.so -lm", compiler, strict, compiler[0])), 0);
    void* library = dlopen(folder.file(fmt::format("{}.so", compiler[0])).c_str(), RTLD_NOW | RTLD_LOCAL);
    ASSERT_TRUE(library) << dlerror();
    compare(all, library);
    EXPECT_EQ(reinterpret_cast<int (*)()>(dlsym(library, "wrong_rows"))(), 0);
    dlclose(library);
  }
}

TEST_F(CSource, SelfTestsPassUnderSanitizer) {
  folder.write("all.c", source_of(all));
  for (const char* compiler : {"gcc", "clang"}) {
    ASSERT_EQ(folder.run(fmt::format("{} {} -DMAIN -g -fsanitize=undefined -fno-sanitize-recover=all all.c -o all -lm",
                                     compiler, strict)),
              0);
    EXPECT_EQ(folder.run("./all"), 0) << compiler;
  }
}

TEST_F(CSource, SelfTestFindsAnotherLaw) {
  std::string text = source_of({all[0]});
  const std::size_t at = text.find(" * boundary;");
  ASSERT_NE(at, text.npos);
  text.insert(at, " * 1.001");
  folder.write("changed.c", text);
  ASSERT_EQ(folder.run(fmt::format("gcc {} -DMAIN changed.c -o changed -lm", strict)), 0);
  EXPECT_NE(folder.run("./changed"), 0);
}

TEST_F(CSource, DeclaresItself) {
  folder.write("joint0.c", c_source(all[0], "joint0").value());
  folder.write("user.c",
               "#define JOINT0_DECLARATIONS\n#include \"joint0.c\"\n"
               "int main(void)\n{\n  joint0_state s;\n  joint0_init(&s);\n"
               "  return joint0_step(&s, 1.0, 0.0, 1e-3) > 0.0 ? 0 : 1;\n}\n");
  EXPECT_EQ(folder.run(fmt::format("gcc {} user.c joint0.c -o user -lm && ./user", strict)), 0);
  EXPECT_EQ(folder.run("sed 's/user/user/' user.c > user.cpp && gcc -std=c99 -c joint0.c && "
                       "g++ -Wall -Wextra -Werror user.cpp joint0.o -o user && ./user"),
            0);
}

TEST_F(CSource, RefusesNamesThatAreNoneInC) {
  for (const char* name : {"", "joint-2", "2nd", "while", "class", "a b", "_x"}) {
    const auto text = c_source(all[0], name);
    ASSERT_FALSE(text) << name;
    EXPECT_THAT(text.error().message, testing::HasSubstr("becomes part of C"));
  }
}

}  // namespace
}  // namespace tribotwin::twin
