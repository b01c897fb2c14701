#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

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

TEST(CmaEs, FindsTheMinimum) {
  Gaussian gaussian(5);
  const Minimum m = answered(cma_es(Eigen::VectorXd::Constant(4, -0.5), {.evaluations = 6000}, gaussian), rosenbrock);
  EXPECT_LT((m.z - Eigen::VectorXd::Ones(4)).norm(), 1e-3);
  EXPECT_LE(m.evaluations, 6000);
}

TEST(CmaEs, AsksForAGenerationAtOnce) {
  Gaussian gaussian(5);
  Search search = cma_es(Eigen::VectorXd::Zero(3), {.population = 6, .evaluations = 20}, gaussian);
  std::vector<std::size_t> asked;
  while (!search.over()) {
    Tried tried;
    for (const auto& z : search.question().points) tried.values.push_back(z.squaredNorm());
    asked.push_back(tried.values.size());
    search.answer(std::move(tried));
  }
  EXPECT_EQ(asked, (std::vector<std::size_t>{1, 6, 6, 6}));
  EXPECT_EQ(search.outcome().evaluations, 19);
}

TEST(CmaEs, PassesOnWhatTheObjectiveThrows) {
  Gaussian gaussian(5);
  const auto far = [](const Eigen::VectorXd& z) {
    if (z(0) > 0.1) throw std::runtime_error("far");
    return z.squaredNorm();
  };
  EXPECT_THROW(answered(cma_es(Eigen::VectorXd::Zero(3), {}, gaussian), far), std::runtime_error);
}

}  // namespace
}  // namespace tribotwin::twin
