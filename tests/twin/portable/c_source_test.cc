#include <array>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "joints.hpp"
#include <dlfcn.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/twin/portable/c_source.hpp>
#include <tribotwin/twin/portable/joint_parameters.hpp>

namespace tribotwin::twin {
namespace {

/// The state of a joint as its C file declares it.
struct CState {
  double ambient_K, boundary, stribeck_velocity, viscous, ripple, backlash_rad;
  double node_K[2], load_nm, bristle, position_rad, backlash_position, dt_s, decay[2];
  double temperature_degC, friction_nm, limit_nm, heat_J;
  int outside;
};
/// Follows where the motor has a winding.
struct CMotor {
  double torque_loss, winding_K, overload, current_A, current_limit_A, copper_loss_J, winding_heat_J;
};
/// With JointNumbers::members its parameters follow, and what follows from them.
struct Room : CState {
  std::array<double, 120> more;
  CMotor& motor() { return *reinterpret_cast<CMotor*>(more.data()); }
  double* parameters(bool winding) { return more.data() + (winding ? sizeof(CMotor) / sizeof(double) : 0); }
};

std::string name_of(std::size_t i) { return fmt::format("joint{}", i); }

/// All joints in one file, each with its self test.
std::string source_of(const std::vector<Drive>& all, JointNumbers numbers = JointNumbers::literal) {
  std::string text;
  for (std::size_t i = 0; i < all.size(); ++i) {
    text += fmt::format("#define JOINT{}_SELF_TEST\n", i);
    text += c_source(all[i], name_of(i), numbers).value();
  }
  text += "int wrong_rows(void);\nint wrong_rows(void)\n{\n  int wrong = 0;\n";
  for (std::size_t i = 0; i < all.size(); ++i) text += fmt::format("  wrong += {}_self_test();\n", name_of(i));
  return text + "  return wrong;\n}\n#ifdef MAIN\nint main(void) { return wrong_rows() != 0; }\n#endif\n";
}

class CSource : public testing::Test {
 protected:
  static inline std::vector<Drive> all = drives(2);
  Folder folder;
};

TEST_F(CSource, CoversEveryLawAndDynamicsWithWindingAndWithout) {
  ASSERT_EQ(all.size(), 2 * 3 * friction::laws().size());
  const auto windings = std::ranges::count_if(all, [](const Drive& d) { return d.winding.present(); });
  EXPECT_GT(windings, static_cast<long>(all.size() / 3));
  EXPECT_LT(windings, static_cast<long>(2 * all.size() / 3));
  EXPECT_TRUE(std::ranges::any_of(all, [](const Drive& d) { return d.winding.current_rated_A > 0; }));
}

/// What a joint's winding has done in C and in C++.
void compare_windings(const CMotor& c, const drive::Sliding& s) {
  EXPECT_EQ(c.winding_K, s.state.winding.rise_K);
  EXPECT_EQ(c.overload, s.state.winding.overload);
  EXPECT_EQ(c.current_A, s.workspace.current_A);
  EXPECT_EQ(c.current_limit_A, s.workspace.current_limit_A);
  EXPECT_EQ(c.copper_loss_J, s.workspace.copper_loss_J);
  EXPECT_EQ(c.winding_heat_J, s.workspace.winding_heat_J);
}

/// The same doubles as drive::slide, over 10^5 random steps with faults, inputs beyond the range and no numbers. With
/// `tune` other numbers are set first.
void compare(std::vector<Drive> all, void* library, bool tune = false) {
  std::size_t steps = 0, sliding = 0, outside = 0, flowing = 0, limited = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto find = [&](const char* what) { return dlsym(library, (name_of(i) + what).c_str()); };
    const auto step = reinterpret_cast<double (*)(CState*, double, double, double)>(find("_step"));
    const auto temperature = reinterpret_cast<double (*)(const CState*)>(find("_temperature"));
    const auto heat_up = reinterpret_cast<void (*)(CState*, double)>(find("_set_temperature"));
    const bool winding = all[i].winding.present();
    const auto heat_winding =
        winding ? reinterpret_cast<void (*)(CState*, double)>(find("_set_winding_temperature")) : nullptr;
    Room c;
    reinterpret_cast<void (*)(CState*)>(find("_init"))(&c);
    drive::Sliding s;
    Random random(i);
    if (tune) {
      all[i] = tuned(all[i], random);
      const auto parameters = joint_parameters(all[i]);
      for (std::size_t k = 0; k < parameters.size(); ++k) c.parameters(winding)[k] = parameters[k].value;
      reinterpret_cast<void (*)(CState*)>(find("_changed"))(&c);
    }
    for (int k = 0; k < 2200; ++k, ++steps) {
      if (k % 100 == 0) {
        const drive::Faults f = faults_of(random);
        drive::set_faults(s.workspace, f);
        c.boundary = f.boundary, c.stribeck_velocity = f.stribeck_velocity, c.viscous = f.viscous;
        c.ripple = f.ripple, c.backlash_rad = f.backlash_rad;
        if (winding) c.motor().torque_loss = f.torque_loss;
        const double degC = uniform(random, -20, 120);
        drive::set_temperature(all[i], s.state, degC), heat_up(&c, degC);
        if (winding) drive::set_winding(all[i], s.state, degC + 30), heat_winding(&c, degC + 30);
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
      if (!winding) continue;
      compare_windings(c.motor(), s);
      if (testing::Test::HasFailure()) FAIL() << i << " step " << k;
      const double current = std::abs(c.motor().current_A);
      flowing += current > 0 && current < c.motor().current_limit_A;
      limited += current > 0 && current == c.motor().current_limit_A;
    }
    ASSERT_EQ(c.heat_J, s.workspace.heat_J) << i;
  }
  EXPECT_GT(steps, 100'000u);
  EXPECT_GT(sliding, steps / 2);
  EXPECT_GT(outside, steps / 100);
  EXPECT_GT(flowing, steps / 20);
  EXPECT_GT(limited, steps / 20);
}

class CSourceWith : public CSource, public testing::WithParamInterface<JointNumbers> {};
INSTANTIATE_TEST_SUITE_P(Numbers, CSourceWith, testing::Values(JointNumbers::literal, JointNumbers::members));

TEST_P(CSourceWith, EqualsCppBitByBit) {
  folder.write("all.c", source_of(all, GetParam()));
  for (const char* compiler : {"gcc -O2", "clang -O2"}) {
    SCOPED_TRACE(compiler);
    ASSERT_EQ(folder.run(fmt::format("{} {} -fPIC -shared all.c -o {}.so -lm", compiler, strict, compiler[0])), 0);
    void* library = dlopen(folder.file(fmt::format("{}.so", compiler[0])).c_str(), RTLD_NOW | RTLD_LOCAL);
    ASSERT_TRUE(library) << dlerror();
    compare(all, library);
    if (GetParam() == JointNumbers::members) compare(all, library, true);
    EXPECT_EQ(reinterpret_cast<int (*)()>(dlsym(library, "wrong_rows"))(), 0);
    dlclose(library);
  }
}

// By day either kind of source with one compiler.
TEST_P(CSourceWith, SelfTestsPassUnderSanitizer) {
  folder.write("all.c", source_of(all, GetParam()));
  std::vector<std::string> compilers{GetParam() == JointNumbers::literal ? "gcc" : "clang"};
  if (std::getenv("TRIBOTWIN_NIGHTLY")) compilers = {"gcc", "clang"};
  for (const std::string& compiler : compilers) {
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
