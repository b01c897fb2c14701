#include <algorithm>
#include <cmath>
#include <limits>

#include <gmock/gmock.h>

#include <tribotwin/twin/numerics/d_optimal.hpp>

namespace tribotwin::twin {
namespace {

using Eigen::MatrixXd, Eigen::Vector3d;

Experiment at(double x, double cost = 1, std::size_t group = 0) {
  const Vector3d row(1, x, x * x);
  return {.information = row * row.transpose(), .cost = cost, .group = group};
}

TEST(DOptimal, QuadraticRegressionMeasuresBothEndsAndTheMiddle) {
  // Atkinson 2007: a third of the measurements each at -1, 0 and 1.
  std::vector<Experiment> candidates;
  for (int k = -10; k <= 10; ++k) candidates.push_back(at(0.1 * k));
  const std::vector<double> free{0};
  const auto chosen = d_optimal(1e-6 * MatrixXd::Identity(3, 3), candidates, free, 30);
  ASSERT_EQ(chosen.size(), 30u);
  for (const std::size_t end : {0, 10, 20}) EXPECT_EQ(std::ranges::count(chosen, end), 10) << end;
}

TEST(DOptimal, FillsWhatIsLackingAndPaysForGroupsOnce) {
  const MatrixXd both_ends = 100 * (at(-1).information + at(1).information) + 1e-6 * MatrixXd::Identity(3, 3);
  const std::vector<Experiment> candidates{at(-1), at(0), at(1)};
  const std::vector<double> free{0}, dear{5};
  EXPECT_EQ(d_optimal(both_ends, candidates, free, 1), std::vector<std::size_t>{1});
  EXPECT_EQ(d_optimal(both_ends, candidates, dear, 5.5).size(), 0u);
  EXPECT_EQ(d_optimal(both_ends, candidates, dear, 8).size(), 3u);
}

TEST(DOptimal, SigmaOfSingularInformationIsInfinite) {
  EXPECT_DOUBLE_EQ(mean_log_sigma(4 * MatrixXd::Identity(3, 3)), -std::log(2.0));
  EXPECT_EQ(mean_log_sigma(at(1).information), std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace tribotwin::twin
