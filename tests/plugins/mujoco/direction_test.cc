// Friction that differs between the directions, and a torque that acts at every speed.
#include <cmath>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>

namespace tribotwin::mujoco {
namespace {

constexpr double inertia_kg_m2 = 2, asymmetry = 0.3, offset_nm = 1.5, dt_s = 1e-3;
constexpr char lugre[] = R"(<config key="friction" value="lugre"/><config key="sigma0" value="5"/>
  <config key="sigma1" value="0.03"/><config key="vd" value="1"/>)";
constexpr char gear_loss[] = R"(<config key="friction" value="gear_loss"/><config key="mu_avg" value="0.08"/>
  <config key="mu_dif" value="0.03"/><config key="h" value="0.3"/>)";

struct Kind {
  const char* name;
  const char* integrator;
  const char* keys;
  int actdim;
};
constexpr Kind kinds[] = {
    {"static", "Euler", "", 3},   {"static implicit", "implicit", "", 3},   {"static RK4", "RK4", "", 3},
    {"lugre", "Euler", lugre, 4}, {"lugre implicit", "implicit", lugre, 4}, {"gear_loss", "Euler", gear_loss, 4}};

/// A flywheel, not moved by gravity, with the extremes of the Stribeck curve at 6 and 5 Nm and 5e-3 Nm s/rad per rad/s.
std::shared_ptr<const Model> flywheel(const Kind& kind, double a = asymmetry, double offset = offset_nm) {
  auto model = load_string(fmt::format(
      R"(<mujoco><option timestep="{}" tolerance="1e-14" iterations="100" integrator="{}"/>
  <extension><plugin plugin="tribotwin.drive"><instance name="j"><config key="law" value="stribeck"/>
    <config key="Fc" value="0.05"/><config key="Fs" value="0.01"/><config key="vs" value="5"/>
    <config key="alpha" value="1.3"/><config key="Fv" value="0.0005"/><config key="torque_max_nm" value="100"/>
    <config key="gear_ratio" value="10"/><config key="thermal" value="first_order"/><config key="R_th" value="2"/>
    <config key="kappa" value="600"/><config key="asymmetry" value="{}"/><config key="offset_nm" value="{}"/>{}
    </instance></plugin></extension>
  <worldbody><body><joint name="hinge" axis="0 0 1" armature="{}" frictionloss="1" solreffriction=".001 1"
    solimpfriction=".9999 .9999 .001 .5 2"/><geom type="sphere" size=".01" mass="1e-6" contype="0"/></body></worldbody>
  <actuator><plugin name="d" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="{}"/></actuator></mujoco>)",
      dt_s, kind.integrator, a, offset, kind.keys, inertia_kg_m2, kind.actdim));
  if (!model) throw std::runtime_error(model.error().message);
  return *model;
}

/// The friction of the law alone [Nm].
double level_nm(const Model& model, double speed, double load_norm = 0) {
  drive::Drive symmetric = model.drives()[0].drive;
  symmetric.asymmetry = 0;
  return friction_nm(symmetric, speed, load_norm, 25);
}

TEST(Direction, SlidingTakesTheLevelOfItsDirectionAndTheOffset) {
  for (const Kind& kind : kinds)
    for (const double sign : {1.0, -1.0}) {
      const auto model = flywheel(kind);
      const Binding& b = model->drives()[0];
      const DataPtr d = model->make_data();
      workspace(d.get(), b).temperature_held = 1;
      d->qvel[0] = sign * 4;
      double before = 0, load = 0;
      for (int i = 0; i < 300; ++i) {  // bristles bend first
        d->ctrl[0] = sign * 7;
        before = d->qvel[0], load = state(d.get(), b).load_nm;
        model->step(d.get());
      }
      const double taken = sign * 7 - inertia_kg_m2 * (d->qvel[0] - before) / dt_s;
      double level = level_nm(*model, before);
      if (kind.keys == gear_loss) level += 0.08 * std::abs(load) + 0.03 * sign * load;
      const double expected = sign * level * (1 + asymmetry * sign) + offset_nm;
      EXPECT_NEAR(taken, expected, 2e-5 * std::abs(expected)) << kind.name << " " << sign;
      EXPECT_NEAR(workspace(d.get(), b).friction_nm, expected - offset_nm, 2e-5 * std::abs(expected)) << kind.name;
      EXPECT_NEAR(state(d.get(), b).load_nm, 0, 2e-5 * std::abs(expected)) << "nothing is moved by this gear";
      if (kind.actdim == 3) EXPECT_NEAR(resistance_nm(b.drive, before, 0, 25), expected, 1e-9);
    }
}

TEST(Direction, StandsUpToTheBreakawayTorqueOfEachDirection) {
  for (const Kind& kind : kinds)
    for (const double sign : {1.0, -1.0})
      for (const double share : {0.02, 0.5, 0.98, 1.02}) {
        if (kind.actdim == 4 && share > 0.9 && share < 1) continue;  // bristles bend on the way
        const auto model = flywheel(kind);
        const Binding& b = model->drives()[0];
        const DataPtr d = model->make_data();
        const double breakaway = sign * level_nm(*model, 0) * (1 + asymmetry * sign);
        for (int i = 0; i < 4000; ++i) {
          d->ctrl[0] = offset_nm + share * breakaway * std::min(1.0, i / 1000.0);
          model->step(d.get());
        }
        const std::string at = fmt::format("{} {} {}", kind.name, sign, share);
        if (share > 1) {
          EXPECT_GT(sign * d->qvel[0], 1e-2) << at;
          continue;
        }
        if (kind.keys != gear_loss) EXPECT_LT(std::abs(d->qvel[0]), 1e-5) << at;  // those bristles swing, undamped
        EXPECT_LT(std::abs(d->qpos[0]), kind.actdim == 3 ? 1e-5 : 0.1) << at;
        EXPECT_GT(workspace(d.get(), b).stuck_s, 3.9) << at;
      }
}

TEST(Direction, FrictionNeverDrivesAndTheEnergyIsAccountedFor) {
  for (const Kind& kind : kinds) {
    const auto model = flywheel(kind);
    const Binding& b = model->drives()[0];
    const DataPtr d = model->make_data();
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> torque(-60, 60);
    const bool runge_kutta = std::string(kind.integrator) == "RK4";  // works with the speeds of its stages
    double work_J = 0, sliding = 0, before_J = 0;
    for (int i = 0; i < 20000; ++i) {
      if (i % 50 == 0) d->ctrl[0] = i % 400 < 200 ? torque(random) : 0.2 * torque(random);  // also stands
      const double v = d->qvel[0];
      model->step(d.get());
      const drive::Workspace& s = workspace(d.get(), b);
      work_J += (d->ctrl[0] - offset_nm) * 0.5 * (v + d->qvel[0]) * dt_s;
      if (v * d->qvel[0] > 0 && kind.actdim == 3 && !runge_kutta) {
        ASSERT_GE(s.friction_work_J - before_J, -1e-12) << kind.name << " step " << i;
        ++sliding;
      }
      before_J = s.friction_work_J;
    }
    const drive::Workspace& s = workspace(d.get(), b);
    if (kind.actdim == 3 && !runge_kutta) EXPECT_GT(sliding, 10000);
    EXPECT_GT(s.friction_work_J, 100) << kind.name;
    EXPECT_DOUBLE_EQ(s.heat_J, s.friction_work_J);
    if (runge_kutta) continue;
    EXPECT_NEAR(work_J, s.friction_work_J + 0.5 * inertia_kg_m2 * d->qvel[0] * d->qvel[0], 1e-6 * s.friction_work_J)
        << kind.name;
  }
}

TEST(Direction, TheOtherSignIsTheMirrorImage) {
  for (const Kind& kind : kinds) {
    const auto equal = flywheel(kind, 0, 0), mirrored = flywheel(kind, -asymmetry, -offset_nm), plain = flywheel(kind);
    const DataPtr a = equal->make_data(), m = mirrored->make_data(), p = plain->make_data();
    for (int i = 0; i < 2000; ++i) {
      a->ctrl[0] = p->ctrl[0] = 12 * std::sin(0.005 * i);
      m->ctrl[0] = -p->ctrl[0];
      equal->step(a.get());
      plain->step(p.get());
      mirrored->step(m.get());
      ASSERT_NEAR(m->qpos[0], -p->qpos[0], 1e-9) << kind.name;
    }
    EXPECT_GT(std::abs(a->qpos[0] - p->qpos[0]), 1e-2) << kind.name;
  }
}

TEST(Direction, WrongValuesAreNamed) {
  const auto error = [](const char* key, const char* value) {
    drive::Configuration c{{"law", "stribeck"}, {"Fc", "0.05"},   {"Fs", "0.01"},           {"vs", "5"},
                           {"alpha", "1.3"},    {"Fv", "0.0005"}, {"torque_max_nm", "100"}, {"gear_ratio", "10"},
                           {key, value}};
    const auto drive = drive::make_drive("j", c);
    return drive ? "accepted" : drive.error().message;
  };
  using testing::HasSubstr;
  EXPECT_EQ(error("asymmetry", "-0.99"), "accepted");
  EXPECT_THAT(error("asymmetry", "1"), testing::AllOf(HasSubstr("'asymmetry'"), HasSubstr("within -0.99 .. 0.99")));
  EXPECT_THAT(error("offset_nm", "nan"), testing::AllOf(HasSubstr("'offset_nm'"), HasSubstr("finite")));
  EXPECT_THAT(error("offset", "1"), HasSubstr("did you mean 'offset_nm'"));
}

}  // namespace
}  // namespace tribotwin::mujoco
