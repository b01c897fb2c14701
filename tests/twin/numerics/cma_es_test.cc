#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include <tribotwin/twin/numerics/cma_es.hpp>

namespace tribotwin::twin {
namespace {

double rosenbrock(const Eigen::VectorXd& z) {
  double sum = 0;
  for (Eigen::Index i = 0; i + 1 < z.size(); ++i)
    sum += 100 * std::pow(z(i + 1) - z(i) * z(i), 2) + std::pow(1 - z(i), 2);
  return sum;
}

Minimum found(unsigned threads, int evaluations) {
  Gaussian gaussian(5);
  return cma_es(rosenbrock, Eigen::VectorXd::Constant(4, -0.5), {.evaluations = evaluations, .threads = threads},
                gaussian);
}

TEST(CmaEs, FindsTheMinimum) {
  const Minimum m = found(2, 6000);
  EXPECT_LT((m.z - Eigen::VectorXd::Ones(4)).norm(), 1e-3);
  EXPECT_LE(m.evaluations, 6000);
}

TEST(CmaEs, ThreadsChangeNoBit) {
  const Minimum one = found(1, 500);
  for (const unsigned threads : {2u, 3u, 8u, 13u}) {
    const Minimum many = found(threads, 500);
    EXPECT_EQ(many.objective, one.objective) << threads;
    EXPECT_EQ(many.z, one.z) << threads;
    EXPECT_EQ(many.evaluations, one.evaluations) << threads;
  }
}

TEST(CmaEs, PassesOnWhatTheObjectiveThrows) {
  for (const unsigned threads : {1u, 3u}) {
    Gaussian gaussian(5);
    const auto far = [](const Eigen::VectorXd& z) {
      if (z(0) > 0.1) throw std::runtime_error("far");
      return z.squaredNorm();
    };
    EXPECT_THROW(cma_es(far, Eigen::VectorXd::Zero(3), {.threads = threads}, gaussian), std::runtime_error);
  }
}

}  // namespace
}  // namespace tribotwin::twin
