// What the engine computes from the middle of a step: repeated stages, inverse dynamics, transition matrices. A drive
// adds to qfrc_passive and rewrites constraint rows; each of these must come out as if that were the engine's own.
#include <cmath>
#include <functional>

#include <Eigen/Core>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>

namespace tribotwin::mujoco {
namespace {

using Matrix = Eigen::Matrix<mjtNum, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Vector = Eigen::Matrix<mjtNum, Eigen::Dynamic, 1>;

struct Friction {
  const char* name;
  const char* keys;
  bool bristles;
  double torque_loss = 0;
};

const Friction frictions[] = {
    {"Static", "", false},
    {"Lugre",
     R"(<config key="friction" value="lugre"/><config key="sigma0" value="1"/><config key="sigma1" value="0.002"/>
        <config key="vd" value="2"/>)",
     true},
    {"GearLoss",
     R"(<config key="friction" value="gear_loss"/><config key="mu_avg" value="0.05"/>
        <config key="mu_dif" value="0.02"/><config key="h" value="1"/>)",
     true},
    {"WeakMotor", "", false, 0.2},
};

/// Two drives under gravity, in motion, warm.
class Derivatives : public testing::TestWithParam<std::tuple<Friction, const char*>> {
 protected:
  void SetUp() override {
    const auto& [friction, integrator] = GetParam();
    std::string instances, joints, actuators, ends;
    for (const char* j : {"1", "2"}) {
      instances += fmt::format(
          R"(<instance name="j{}"><config key="law" value="stribeck"/><config key="Fc" value="0.03"/>
             <config key="Fs" value="0.05"/><config key="vs" value="10"/><config key="alpha" value="1.3"/>
             <config key="Fv" value="0.0005"/><config key="torque_max_nm" value="100"/>
             <config key="gear_ratio" value="50"/>{}</instance>)",
          j, friction.keys);
      joints += fmt::format(
          R"(<body pos="0 0 -.5"><joint name="j{}" axis="0 1 0" armature="1" frictionloss="1"
             solreffriction=".001 1" solimpfriction=".9999 .9999 .001 .5 2"/>
             <geom type="capsule" size=".05" fromto="0 0 0 0 0 -.5" mass="4"/>)",
          j);
      actuators +=
          fmt::format(R"(<plugin name="d{0}" joint="j{0}" plugin="tribotwin.drive" instance="j{0}" actdim="{1}"/>)", j,
                      friction.bristles ? 4 : 3);
      ends += "</body>";
    }
    auto loaded = load_string(fmt::format(
        R"(<mujoco><option timestep="0.001" tolerance="1e-15" iterations="200" integrator="{}"/>
           <extension><plugin plugin="tribotwin.drive">{}</plugin></extension>
           <worldbody>{}{}</worldbody><actuator>{}</actuator></mujoco>)",
        integrator, instances, joints, ends, actuators));
    ASSERT_TRUE(loaded) << loaded.error().message;
    model_ = *loaded;
    data_ = model_->make_data();
    data_->qpos[0] = 0.4, data_->qpos[1] = -0.7;
    data_->qvel[0] = 0.5, data_->qvel[1] = -0.8;
    for (const Binding& b : model_->drives()) {
      drive::set_temperature(b.drive, state(data_.get(), b), 45);
      drive::set_faults(workspace(data_.get(), b), {.torque_loss = friction.torque_loss});
    }
    for (int i = 0; i < 50; ++i) {
      command();
      model_->step(data_.get());
    }
  }

  void command() { data_->ctrl[0] = 40, data_->ctrl[1] = -15; }

  const mjModel* m() const { return model_->get(); }
  mjData* d() const { return data_.get(); }

  static Vector of(const mjtNum* values, int size) { return Eigen::Map<const Vector>(values, size); }

  std::shared_ptr<const Model> model_;
  DataPtr data_;
};

TEST_P(Derivatives, ARepeatedStageChangesNothing) {
  mj_forward(m(), d());
  const Vector passive = of(d()->qfrc_passive, m()->nv), acceleration = of(d()->qacc, m()->nv);
  for (const int stage : {mjSTAGE_NONE, mjSTAGE_POS, mjSTAGE_VEL, mjSTAGE_VEL, mjSTAGE_VEL}) {
    mj_forwardSkip(m(), d(), stage, 0);
    EXPECT_EQ(of(d()->qfrc_passive, m()->nv), passive) << "stage " << stage;
    EXPECT_LE((of(d()->qacc, m()->nv) - acceleration).norm(), 1e-12 * acceleration.norm()) << "stage " << stage;
  }
  if constexpr (TRIBOTWIN_ENGINE_PLUGINS) {
    mj_fwdActuation(m(), d());
    EXPECT_EQ(of(d()->qfrc_passive, m()->nv), passive);
  }
}

TEST_P(Derivatives, InverseDynamicsReturnsTheAppliedTorques) {
  mj_forward(m(), d());
  const Vector applied = of(d()->qfrc_actuator, m()->nv);
  ASSERT_GT(applied.norm(), 1);
  for (int repeat = 0; repeat < 2; ++repeat) {
    mj_inverse(m(), d());
    EXPECT_LE((of(d()->qfrc_inverse, m()->nv) - applied).norm(), 1e-9 * applied.norm())
        << of(d()->qfrc_inverse, m()->nv).transpose() << " for " << applied.transpose();
  }
}

/// Position, velocity and activation after one step of a copy.
Vector after_step(const mjModel* m, const mjData* from, const std::function<void(mjData*)>& change) {
  const DataPtr d(mj_copyData(nullptr, m, from));
  change(d.get());
  mj_step(m, d.get());
  Vector y(m->nq + m->nv + m->na);
  y << Eigen::Map<const Vector>(d->qpos, m->nq), Eigen::Map<const Vector>(d->qvel, m->nv),
      Eigen::Map<const Vector>(d->act, m->na);
  return y;
}

TEST_P(Derivatives, TransitionMatricesAreThoseOfWholeSteps) {
  constexpr double eps = 1e-5;
  const int n = m()->nq + m()->nv + m()->na;
  const auto column = [&](const std::function<double&(mjData*)>& entry) -> Vector {
    return (after_step(m(), d(), [&](mjData* x) { entry(x) += eps; }) -
            after_step(m(), d(), [&](mjData* x) { entry(x) -= eps; })) /
           (2 * eps);
  };
  Matrix A(n, n), B(n, m()->nu);
  for (int i = 0; i < m()->nq; ++i) A.col(i) = column([&](mjData* x) -> double& { return x->qpos[i]; });
  for (int i = 0; i < m()->nv; ++i) A.col(m()->nq + i) = column([&](mjData* x) -> double& { return x->qvel[i]; });
  for (int i = 0; i < m()->na; ++i)
    A.col(m()->nq + m()->nv + i) = column([&](mjData* x) -> double& { return x->act[i]; });
  for (int i = 0; i < m()->nu; ++i) B.col(i) = column([&](mjData* x) -> double& { return x->ctrl[i]; });

  const Vector before = after_step(m(), d(), [](mjData*) {});
  for (int repeat = 0; repeat < 2; ++repeat) {
    Matrix a(n, n), b(n, m()->nu);
    mjd_transitionFD(m(), d(), eps, 1, a.data(), b.data(), nullptr, nullptr);
    for (int c = 0; c < n; ++c)
      EXPECT_LE((a.col(c) - A.col(c)).norm(), 1e-5 * std::max(1.0, A.col(c).norm())) << "A, column " << c;
    for (int c = 0; c < m()->nu; ++c)
      EXPECT_LE((b.col(c) - B.col(c)).norm(), 1e-5 * std::max(1e-3, B.col(c).norm())) << "B, column " << c;
  }
  EXPECT_EQ(after_step(m(), d(), [](mjData*) {}), before) << "the state was touched";
}

/// The engine restores a state in which a step is open already, and the next difference starts from it.
TEST_P(Derivatives, TransitionMatricesDoNotDependOnAForwardBefore) {
  const int n = m()->nq + m()->nv + m()->na;
  Matrix A(n, n), B(n, m()->nu), a(n, n), b(n, m()->nu);
  mjd_transitionFD(m(), d(), 1e-5, 0, A.data(), B.data(), nullptr, nullptr);
  mj_forward(m(), d());
  mjd_transitionFD(m(), d(), 1e-5, 0, a.data(), b.data(), nullptr, nullptr);
  EXPECT_LE((a - A).norm(), 1e-5 * A.norm()) << "was\n" << A << "\nis\n" << a;
  EXPECT_LE((b - B).norm(), 1e-5 * B.norm()) << "was\n" << B << "\nis\n" << b;
}

INSTANTIATE_TEST_SUITE_P(Everywhere, Derivatives,
                         testing::Combine(testing::ValuesIn(frictions), testing::Values("Euler", "implicit")),
                         [](const auto& info) {
                           return std::string(std::get<0>(info.param).name) + "_" + std::get<1>(info.param);
                         });

}  // namespace
}  // namespace tribotwin::mujoco
