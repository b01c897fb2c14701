#include <gmock/gmock.h>

#include <tribotwin/twin/identification/resampling/jackknife.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::MatrixXd, Eigen::VectorXd;

// What a prior alone tells, in equal parts of every block, does not vary: its variance is moderated by that of others.
TEST(Jackknife, OfWhatNoBlockTellsIsFinite) {
  std::vector<MatrixXd> blocks;
  for (const double value : {0.9, 1.1, 1.0, 1.3, 0.7}) {
    MatrixXd N = MatrixXd::Zero(3, 3);  // normal matrix of [x, prior-only y, right-hand side]
    N(0, 0) = 1, N(1, 1) = 1;
    N(0, 2) = N(2, 0) = value, N(1, 2) = N(2, 1) = 2, N(2, 2) = value * value + 4;
    blocks.push_back(N);
  }
  const auto found = jackknife(blocks);
  ASSERT_TRUE(found);
  EXPECT_GT(found->variance(0), 0);
  EXPECT_EQ(found->variance(1), 0);
  EXPECT_TRUE(found->freedom.allFinite()) << found->freedom;
  const Jackknife with_others = moderated(*found, VectorXd::Constant(2, 0.2));
  EXPECT_TRUE(with_others.variance.allFinite()) << with_others.variance;
  EXPECT_GT(with_others.variance(1), 0);
}

}  // namespace
}  // namespace tribotwin::twin::identification
