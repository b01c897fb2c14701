#include <cmath>
#include <fstream>
#include <functional>
#include <numbers>
#include <random>
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

/// Canudas de Wit 1995, Table I, with the fading damping of the RH380-N study, as a drive of gear ratio 1.
drive::Configuration textbook() {
  return {{"law", "steady_state"}, {"Fc", "1"},           {"Fs", "1.5"},     {"Vs", "0.001"},
          {"alpha", "2"},          {"Fv", "0.4"},         {"beta", "1"},     {"torque_max_nm", "1"},
          {"gear_ratio", "1"},     {"friction", "lugre"}, {"sigma0", "1e5"}, {"sigma1", "316"},
          {"vd", "0.02"}};
}

std::string keys(const drive::Configuration& configuration) {
  std::string text;
  for (const auto& [key, value] : configuration) text += fmt::format("<config key=\"{}\" value=\"{}\"/>", key, value);
  return text;
}

/// 1 kg on a slide with the textbook drive.
struct Slide {
  std::string option = R"(timestep="0.0001")";
  std::string config = keys(textbook());
  std::string more;
  std::string actdim = "4";

  Result<std::shared_ptr<const Model>> load() const {
    return load_string(fmt::format(R"(<mujoco><option {} gravity="0 0 0" tolerance="1e-10"/>
  <extension><plugin plugin="tribotwin.drive"><instance name="j">{}</instance></plugin></extension>
  <worldbody><body><joint name="rail" type="slide" axis="1 0 0" frictionloss="1"
    solreffriction=".001 1" solimpfriction=".9999 .9999 .001 .5 2"/>
    <geom type="sphere" size=".1" mass="1"/></body></worldbody>
  <actuator><plugin name="drive" joint="rail" plugin="tribotwin.drive" instance="j" actdim="{}"/></actuator>
  {}</mujoco>)",
                                   option, config, actdim, more));
  }
  std::string error() const {
    const auto model = load();
    return model ? "loaded" : model.error().message;
  }
};

/// Largest deviation from the reference of a drive led along a prescribed displacement x(t), speed v(t).
double deviation(const std::vector<std::vector<double>>& rows, const std::function<double(double)>& x,
                 const std::function<double(double)>& v, int steps_per_row) {
  const drive::Drive drive = *drive::make_drive("j", textbook());
  const double dt = (rows[1][0] - rows[0][0]) / steps_per_row;
  const auto decay = thermal::decay(drive.thermal, dt);
  drive::BristleState state;
  drive::Workspace workspace{};
  double largest = 0;
  for (std::size_t k = 0; k < rows.size(); ++k)
    for (int n = 0; n < steps_per_row; ++n) {
      const double t = rows[k][0] + n * dt;
      drive::begin_step(drive, state, workspace, t, v(t), x(t));
      if (n == 0)
        largest = std::max(largest,
                           std::abs(workspace.applied_nm + std::copysign(workspace.gear_limit_nm, v(t)) - rows[k][1]));
      drive::end_step(drive, decay, {0, 0, v(t + dt), x(t + dt), 0}, dt, state, workspace);
    }
  return largest;
}

TEST(Lugre, PreslidingHysteresisEqualsTheReference) {
  const auto rows = reference("presliding");
  const double a = 6e-6, f = 2 * pi * 5;
  // x' = a f cos(ft) (1 + sin(0.37 ft) / 2)
  const auto v = [&](double t) { return a * f * std::cos(f * t) * (1 + 0.5 * std::sin(0.37 * f * t)); };
  const auto x = [&](double t) {
    return a * std::sin(f * t) +
           a / 4 * ((1 - std::cos(1.37 * f * t)) / 1.37 - (1 - std::cos(0.63 * f * t)) / 0.63 * 1.0);
  };
  const double coarse = deviation(rows, x, v, 5), fine = deviation(rows, x, v, 50);
  EXPECT_LT(coarse, 2e-6);       // of a breakaway level of 1.5, at 1 ms
  EXPECT_LT(fine, coarse / 50);  // second order
  std::printf("presliding: %.2e at 1 ms, %.2e at 0.1 ms\n", coarse, fine);
}

TEST(Lugre, FrictionalLagEqualsTheReference) {
  for (const double frequency : {1.0, 5.0, 25.0}) {
    const auto rows = reference(fmt::format("lag {}", frequency));
    const double f = 2 * pi * frequency;
    const auto v = [&](double t) { return 1.5e-3 + 1.2e-3 * std::sin(f * t); };
    const auto x = [&](double t) { return 1.5e-3 * t + 1.2e-3 / f * (1 - std::cos(f * t)); };
    const double coarse = deviation(rows, x, v, 20), fine = deviation(rows, x, v, 200);
    EXPECT_LT(coarse, 3e-5) << frequency;
    EXPECT_LT(fine, coarse / 50) << frequency;
    std::printf("lag at %g Hz: %.2e at %g ms, %.2e at a tenth\n", frequency, coarse, 1e3 / (50 * frequency * 20), fine);
  }
}

TEST(Lugre, StickSlipOfADraggedMassEqualsTheReference) {
  const auto rows = reference("stick_slip");
  const auto run = [&](double dt) {
    Slide slide;
    slide.option = fmt::format(R"(timestep="{}")", dt);
    const auto model = slide.load();
    if (!model) throw std::runtime_error(model.error().message);
    const DataPtr d = (*model)->make_data();
    const auto drag = [](void*, const mjModel*, mjData* at) { at->ctrl[0] = 2 * (0.1 * at->time - at->qpos[0]); };
    double largest = 0;
    for (const auto& row : rows) {
      while (d->time < row[0] - dt / 2) (*model)->step(d.get(), {.call = drag});
      largest = std::max(largest, std::abs(d->qpos[0] - row[1]));
    }
    return largest;
  };
  const double at_1ms = run(1e-3), fine = run(1e-4);
  std::printf("stick-slip over 40 s, 4 m: %.2e m at 1 ms, %.2e m at 0.1 ms\n", at_1ms, fine);
  EXPECT_LT(at_1ms, 3e-3);
  EXPECT_LT(fine, at_1ms / 5);
}

TEST(Lugre, BreakawayFallsWithTheRateOfTheLoadAsInTheReference) {
  Slide slide;
  slide.option = R"(timestep="0.00005")";
  const auto model = slide.load();
  ASSERT_TRUE(model) << model.error().message;
  double before = 2;
  for (const auto& row : reference("breakaway")) {
    const DataPtr d = (*model)->make_data();
    while (d->qvel[0] < 1e-3 && d->time < 100) {
      d->ctrl[0] = row[0] * (d->time + 0.5 * (*model)->get()->opt.timestep);
      (*model)->step(d.get());
    }
    const double force = row[0] * d->time;
    EXPECT_NEAR(force, row[1], 2e-3 * row[1]) << row[0];
    EXPECT_LT(force, before);
    before = force;
  }
}

TEST(Lugre, SteadyStateIsTheStaticLaw) {
  std::vector<drive::Configuration> all{textbook()};
  drive::Configuration extended{
      {"law", "extended"}, {"torque_max_nm", "7000"}, {"gear_ratio", "178"}, {"friction", "lugre"},
      {"sigma0", "0.1"},   {"sigma1", "1e-4"},        {"vd", "0.3"},         {"T_amb", "50"}};
  const auto law = *friction::published_law("extended");
  for (std::size_t i = 0; i < law.info->parameters.size(); ++i)
    extended.emplace_back(law.info->parameters[i].name, fmt::format("{}", law.parameters[i]));
  all.push_back(extended);
  all.push_back({{"law", "polynomial"},
                 {"f1", "4"},
                 {"f2", "3"},
                 {"f3", "-.4"},
                 {"f4", ".05"},
                 {"a", "-.012"},
                 {"T0", "20"},
                 {"torque_max_nm", "100"},
                 {"gear_ratio", "50"},
                 {"friction", "lugre"},
                 {"sigma0", "1e4"},
                 {"sigma1", "1"},
                 {"vd", "0.01"}});
  for (const auto& configuration : all) {
    const auto drive = drive::make_drive("j", configuration);
    ASSERT_TRUE(drive) << drive.error().message;
    for (const double speed : {1e-4, 1e-3, 0.01, 0.1, 1.0})
      for (const double sign : {1.0, -1.0}) {
        const double qd = sign * speed, dt = 1e-3;
        drive::BristleState state;
        drive::Workspace workspace{};
        const auto decay = thermal::decay(drive->thermal, dt);
        // Where z settles: some 30 relaxation lengths.
        const int steps =
            std::min(2'000'000, 1000 + static_cast<int>(30 * friction_nm(*drive, 0, 0, 50) /
                                                        (drive->bristles.sigma0 * drive->torque_scale_nm() *
                                                         drive->speed_scale() * speed * dt)));
        for (int i = 0; i < steps; ++i) {
          state.load_nm = 0;
          drive::begin_step(*drive, state, workspace, i * dt, qd, i * qd * dt);
          drive::end_step(*drive, decay, {std::copysign(workspace.gear_limit_nm, qd), 0, qd, (i + 1) * qd * dt, 0}, dt,
                          state, workspace);
        }
        const double expected = sign * friction_nm(*drive, qd, 0, drive->thermal.T_amb_degC);
        EXPECT_NEAR(workspace.friction_nm, expected, 1e-6 * std::abs(expected)) << drive->law.info->name << " " << qd;
      }
  }
}

TEST(Lugre, PreslidingStiffnessIsSigma0) {
  Slide slide;
  const auto model = slide.load();
  const DataPtr d = (*model)->make_data();
  d->ctrl[0] = 0.01;
  while (d->time < 1) (*model)->step(d.get());
  EXPECT_NEAR(d->qpos[0], 1e-7, 1e-9);  // creep towards the level: z' = w (1 - sigma0 z / g)
  EXPECT_NEAR(d->qvel[0], 0, 1e-12);
}

TEST(Lugre, BristleStaysWithinItsLimitAndNeverCreatesEnergy) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<> exponent(-9, 6), sign(-1, 1);
  const drive::Bristles b{.sigma0 = 1e5, .sigma1 = 316, .vd = 0.02};
  for (int i = 0; i < 200000; ++i) {
    const double z0 = sign(random) * 1e-4, w = std::copysign(std::pow(10, exponent(random)), sign(random)),
                 g = std::pow(10, exponent(random) / 4), dt = std::pow(10, exponent(random) / 2 - 3);
    const double z = drive::advance(b, z0, w, g, dt);
    ASSERT_LE(std::abs(b.sigma0 * z), std::max(g, std::abs(b.sigma0 * z0)) * (1 + 1e-12));
    // Two halves make the whole: the solution is exact.
    ASSERT_NEAR(drive::advance(b, drive::advance(b, z0, w, g, dt / 2), w, g, dt / 2), z,
                1e-12 * std::max(g / b.sigma0, std::abs(z0)));
  }
  EXPECT_EQ(drive::advance(b, 1, 1, 0, 1), 0);

  // A mass that nobody drives: what it and its bristles hold only ever falls, from random speeds, 1 ms steps.
  for (const char* integrator : {"Euler", "implicit", "RK4"}) {
    Slide slide;
    slide.option = fmt::format(R"(timestep="0.001" integrator="{}")", integrator);
    const auto model = slide.load();
    ASSERT_TRUE(model) << model.error().message;
    const Binding& drive = (*model)->drives()[0];
    for (int k = 0; k < 50; ++k) {
      const DataPtr d = (*model)->make_data();
      d->qvel[0] = std::copysign(std::pow(10, exponent(random) / 3 - 2), sign(random));
      const double start = 0.5 * d->qvel[0] * d->qvel[0];
      for (int i = 0; i < 3000; ++i) {
        (*model)->step(d.get());
        const double z = static_cast<const drive::BristleState&>(state(d.get(), drive)).z;
        ASSERT_LE(0.5 * d->qvel[0] * d->qvel[0] + 0.5e5 * z * z, start * 1.05) << integrator << " step " << i;
        // What left the motion is the friction work, is the heat. (Of the viscous part, RK4 shows the last stage's
        // force alone.)
        ASSERT_NEAR(workspace(d.get(), drive).friction_work_J, start - 0.5 * d->qvel[0] * d->qvel[0],
                    (integrator == std::string("RK4") ? 1e-3 : 1e-9) * start)
            << integrator;
        ASSERT_NEAR(workspace(d.get(), drive).heat_J, workspace(d.get(), drive).friction_work_J, 1e-12 * start);
      }
      EXPECT_LT(std::abs(d->qvel[0]), 1e-3 + 0.7 * std::sqrt(2 * start)) << integrator;
    }
  }
}

TEST(Lugre, StateIsResetCopiedAndRestoredWithTheData) {
  Slide slide;
  slide.more = TRIBOTWIN_ENGINE_PLUGINS ? R"(<keyframe><key name="held" qpos="0" act="0 0 0 5e-6"/></keyframe>)" : "";
  const auto loaded = slide.load();
  ASSERT_TRUE(loaded) << loaded.error().message;
  const Model& model = **loaded;
  const Binding& drive = model.drives()[0];
  const auto z = [&](const mjData* d) { return static_cast<const drive::BristleState&>(state(d, drive)).z; };
  const auto run = [&](mjData* d) {
    for (int i = 0; i < 3000; ++i) {
      d->ctrl[0] = 1.4 * std::sin(20 * d->time);
      model.step(d);
    }
  };
  const DataPtr a = model.make_data();
  run(a.get());
  EXPECT_NE(z(a.get()), 0);
  const DataPtr b(mj_copyData(nullptr, model.get(), a.get()));
  EXPECT_EQ(z(a.get()), z(b.get()));
  run(a.get());
  run(b.get());
  EXPECT_EQ(a->qpos[0], b->qpos[0]);
  EXPECT_EQ(z(a.get()), z(b.get()));
  mj_resetData(model.get(), b.get());
  EXPECT_EQ(z(b.get()), 0);
#if TRIBOTWIN_ENGINE_PLUGINS
  mj_resetDataKeyframe(model.get(), b.get(), 0);
  EXPECT_EQ(z(b.get()), 5e-6);
#endif
}

TEST(Lugre, ConfigurationSurvivesTheRoundTrip) {
  const auto drive = *drive::make_drive("j", textbook());
  EXPECT_EQ(drive::configuration_of(*drive::make_drive("j", drive::configuration_of(drive))),
            drive::configuration_of(drive));
  EXPECT_EQ(drive.bristles.sigma1, 316);
}

TEST(Lugre, MistakesAreNamedWithTheRemedy) {
  const auto with = [](auto change) {
    Slide slide;
    change(slide);
    return slide.error();
  };
  const auto replaced = [](Slide& s, const char* key, const char* value) {
    auto c = textbook();
    std::erase_if(c, [&](const auto& entry) { return entry.first == key; });
    if (value) c.emplace_back(key, value);
    s.config = keys(c);
  };
  EXPECT_EQ(Slide().error(), "loaded");
  EXPECT_THAT(
      with([](Slide& s) { s.actdim = "3"; }),
      testing::AllOf(HasSubstr("<plugin name=\"drive\">"), HasSubstr("actdim=\"4\""), HasSubstr("friction=\"lugre\"")));
  EXPECT_THAT(with([&](Slide& s) { replaced(s, "sigma0", nullptr); }),
              HasSubstr("friction 'lugre': key 'sigma0' is missing"));
  EXPECT_THAT(with([&](Slide& s) { replaced(s, "friction", "lugree"); }),
              HasSubstr("must be static, lugre or gear_loss"));
  EXPECT_THAT(with([&](Slide& s) { replaced(s, "friction", nullptr); }), HasSubstr("is not known"));
  EXPECT_THAT(with([](Slide& s) { s.option = R"(timestep="0.002")"; }),
              testing::AllOf(HasSubstr("joint 'rail'"), HasSubstr("time step 0.002 s"), HasSubstr("0.001 s works")));
  EXPECT_THAT(with([&](Slide& s) {
                replaced(s, "sigma1", "0");
                s.option = R"(timestep="0.001" integrator="RK4")";
              }),
              HasSubstr("no damping"));
  EXPECT_THAT(with([&](Slide& s) { replaced(s, "sigma1", "1000"); }),
              testing::AllOf(HasSubstr("must not be above"), HasSubstr("vd")));
  // The named step loads.
  Slide s;
  s.option = R"(timestep="0.001")";
  EXPECT_EQ(s.error(), "loaded");
}

/// The shipped robots with bristles as stiff as the check at load admits at 1 ms: no chatter, held still by friction.
class Shipped : public testing::TestWithParam<const char*> {};
TEST_P(Shipped, HoldsStillAndMovesWithBristlesAtOneMillisecond) {
  const std::string path = std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/" + GetParam() + ".xml";
  const auto plain = load_file(path);
  ASSERT_TRUE(plain) << plain.error().message;
  std::ifstream stream(path);
  std::string text(std::istreambuf_iterator<char>(stream), {});
  text = std::regex_replace(text, std::regex("actdim=\"3\""), "actdim=\"4\"");
  for (const Binding& b : (*plain)->drives()) {
    const double to_joint = b.drive.torque_scale_nm() * b.drive.speed_scale() * (*plain)->get()->dof_invweight0[b.dof];
    const double sigma0 = 0.49 * 0.49 * 1e6 / (to_joint * b.drive.speed_scale()), sigma1 = 0.8 * 490 / to_joint;
    const double g = friction_nm(b.drive, 0, 0, 50) / b.drive.torque_scale_nm();
    const std::string begin = "<instance name=\"" + b.drive.name + "\">";
    text.replace(text.find(begin), begin.size(),
                 begin + fmt::format(R"(<config key="friction" value="lugre"/><config key="sigma0" value="{}"/>)"
                                     R"(<config key="sigma1" value="{}"/><config key="vd" value="{}"/>)",
                                     sigma0, sigma1, 2 * g / sigma1));
  }
  const auto model = load_string(text, {}, std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf");
  ASSERT_TRUE(model) << model.error().message;
  const DataPtr d = (*model)->make_data();
  // Moves, then is let go to a torque that gravity alone does not need: everything comes to rest on its bristles.
  for (int i = 0; i < 10000; ++i) {
    for (const Binding& b : (*model)->drives()) {
      const double swing = i < 3000 ? 0.15 * b.drive.torque_max_nm * std::sin(0.004 * i) : 0;
      d->ctrl[b.control] = d->qfrc_bias[b.dof] + swing;
      const double limit = (*model)->get()->actuator_ctrllimited[b.control]
                               ? (*model)->get()->actuator_ctrlrange[2 * b.control + 1]
                               : 1e9;
      d->ctrl[b.control] = std::clamp(d->ctrl[b.control], -limit, limit);
    }
    (*model)->step(d.get());
  }
  for (const Binding& b : (*model)->drives()) {
    EXPECT_LT(std::abs(b.speed(d.get())), 1e-5) << b.drive.name;
    const auto& s = workspace(d.get(), b);
    EXPECT_GT(s.heat_J, 0);
    EXPECT_NEAR(s.heat_J, s.friction_work_J, 1e-12 * s.heat_J);
  }
}
INSTANTIATE_TEST_SUITE_P(Robots, Shipped, testing::Values("irb6620", "br609", "er3a_c60", "xl330_pendulum"),
                         [](const auto& info) { return info.param; });

}  // namespace
}  // namespace tribotwin::mujoco
