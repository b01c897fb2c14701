#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <random>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/model/base_parameters.hpp>
#include <tribotwin/twin/model/regressor.hpp>
#include <tribotwin/twin/model/triangular_factor.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Largest difference between Y phi and mj_inverse over random states, relative to the largest torque of the state.
double worst_difference(const mjModel* given, int states) {
  mujoco::ModelPtr m(mj_copyModel(nullptr, given));
  m->opt.disableflags |= mjDSBL_CONSTRAINT | mjDSBL_PASSIVE | mjDSBL_ACTUATION;
  mujoco::DataPtr d(mj_makeData(m.get()));
  auto regressor = Regressor::create(m.get());
  EXPECT_TRUE(regressor) << regressor.error();
  const VectorXd phi = regressor->model_parameters();
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  VectorXd q(m->nv), qd(m->nv), qdd(m->nv);
  double worst = 0;
  for (int s = 0; s < states; ++s) {
    for (int j = 0; j < m->nv; ++j) d->qpos[j] = q(j) = 2 * normal(random), d->qvel[j] = qd(j) = 3 * normal(random), d->qacc[j] = qdd(j) = 10 * normal(random);
    mj_inverse(m.get(), d.get());
    const Eigen::Map<const VectorXd> tau(d->qfrc_inverse, m->nv);
    worst = std::max(worst, (regressor->at(q, qd, qdd) * phi - tau).cwiseAbs().maxCoeff() / tau.cwiseAbs().maxCoeff());
  }
  return worst;
}

bool hinges_and_slides(const mjModel* m) {
  if (m->njnt == 0) return false;
  for (int j = 0; j < m->njnt; ++j)
    if (m->jnt_type[j] != mjJNT_HINGE && m->jnt_type[j] != mjJNT_SLIDE) return false;
  return true;
}

void expect_base_is_the_rank(const mjModel* m) {
  auto regressor = Regressor::create(m);
  ASSERT_TRUE(regressor) << regressor.error();
  const BaseParameters base = base_parameters(*regressor);
  // By singular values of the regressor at states of its own.
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  const Index n = regressor->joints(), columns = static_cast<Index>(regressor->columns().size()), states = 20 + 3 * columns / n;
  MatrixXd W(states * n, columns);
  VectorXd q(n), qd(n), qdd(n);
  for (Index s = 0; s < states; ++s) {
    for (Index j = 0; j < n; ++j) q(j) = normal(random), qd(j) = normal(random), qdd(j) = 3 * normal(random);
    W.middleRows(s * n, n) = regressor->at(q, qd, qdd);
  }
  const VectorXd phi = regressor->model_parameters();
  EXPECT_LT((W(Eigen::all, base.independent) * (base.from_all * phi) - W * phi).norm(), 1e-9 * (W * phi).norm());
  const double longest = W.colwise().norm().maxCoeff();
  for (Index c = 0; c < columns; ++c) {
    const double length = W.col(c).norm();
    W.col(c) *= length > 1e-12 * longest ? 1 / length : 0;
  }
  Eigen::BDCSVD<MatrixXd> svd(W);
  svd.setThreshold(1e-9);
  EXPECT_EQ(base.size(), svd.rank());
  EXPECT_EQ(base.numerical_rank, svd.rank());
}

TEST(Regressor, IsInverseDynamicsOfEveryShippedRobot) {
  int robots = 0;
  for (const auto& file : fs::directory_iterator(TRIBOTWIN_SOURCE_DIR "/mjcf")) {
    if (file.path().filename() == "scene.xml") continue;
    SCOPED_TRACE(file.path().filename());
    const auto model = mujoco::load_file(file.path());
    ASSERT_TRUE(model) << model.error();
    EXPECT_LT(worst_difference(model->get()->get(), 1000), 1e-10);
    expect_base_is_the_rank(model->get()->get());
    ++robots;
  }
  EXPECT_GE(robots, 6);
}

}  // namespace
}  // namespace tribotwin::twin
