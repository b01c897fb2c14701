#include <cmath>
#include <set>

#include <gmock/gmock.h>

#include <tribotwin/twin/identification/resampling/folds.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd;

/// Two joints for `seconds` at 50 Hz; every period_s the motion repeats.
struct Motion {
  MatrixXd q, qd;
  std::vector<std::pair<Index, Index>> blocks;
  std::vector<std::size_t> file;

  Motion(double seconds, double period_s, std::size_t files, std::size_t block_count = 48) {
    const auto samples = static_cast<Index>(50 * seconds);
    q.resize(2, samples), qd.resize(2, samples);
    for (Index i = 0; i < samples; ++i)
      for (Index j = 0; j < 2; ++j) {
        double x = 0, v = 0;
        for (const double harmonic : {1.0, 2.0, 3.0, 5.0, 7.0}) {
          const double w = 2 * M_PI * harmonic / period_s, at = w * static_cast<double>(i) / 50 + harmonic * harmonic;
          x += std::sin(at + static_cast<double>(2 * j)), v += w * std::cos(at + static_cast<double>(2 * j));
        }
        q(j, i) = x, qd(j, i) = v;
      }
    for (std::size_t b = 0; b < block_count; ++b) {
      blocks.emplace_back(samples * static_cast<Index>(b) / static_cast<Index>(block_count),
                          samples * static_cast<Index>(b + 1) / static_cast<Index>(block_count));
      file.push_back(b * files / block_count);
    }
  }
  std::vector<Fold> folds(unsigned count) const { return folds_of(q, qd, blocks, file, count); }
};

TEST(Folds, ArePartsOfTimeThatHoldEveryBlockOnce) {
  const auto folds = Motion(48, 200, 2).folds(8);
  ASSERT_THAT(folds, testing::SizeIs(8));
  std::multiset<std::size_t> held;
  for (const Fold& fold : folds) {
    held.insert(fold.held.begin(), fold.held.end());
    EXPECT_EQ(fold.held.back() - fold.held.front() + 1, fold.held.size()) << "a fold is one stretch";
  }
  EXPECT_EQ(held.size(), 48u);
  EXPECT_EQ(std::set(held.begin(), held.end()).size(), 48u);
}

TEST(Folds, RepetitionsAreLeftOutWithThePartThatTheyRepeat) {
  // Four periods of 12 s, 12 blocks each: block b repeats in b + 12, b + 24, b + 36.
  for (const Fold& fold : Motion(48, 12, 2).folds(16)) {
    const std::set alike(fold.alike.begin(), fold.alike.end());
    for (const std::size_t b : fold.held)
      for (std::size_t k = 1; k < 4; ++k) EXPECT_TRUE(alike.contains((b + 12 * k) % 48)) << b << " + " << 12 * k;
  }
}

TEST(Folds, MotionThatDoesNotRepeatIsFittedButForTheNeighbours) {
  for (const Fold& fold : Motion(48, 200, 2).folds(8)) EXPECT_LE(fold.alike.size(), 4u);
}

TEST(Folds, ThreeFilesAreFoldsOfTheirOwnAndHalfOfTheBlocksStay) {
  const auto folds = Motion(48, 4, 3).folds(10);  // nothing but repetitions
  ASSERT_THAT(folds, testing::SizeIs(3));
  for (const Fold& fold : folds) {
    EXPECT_EQ(fold.held.size(), 16u);
    EXPECT_EQ(fold.held.size() + fold.alike.size(), 24u);
  }
}

}  // namespace
}  // namespace tribotwin::twin::identification
