#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include <tribotwin/twin/numerics/correlated_noise.hpp>

namespace tribotwin::twin {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Two series with uneven steps of 1 s on average.
struct Times {
  std::vector<double> time_s;
  Index second;
  SampleTimes span() const { return {time_s, {0, second}}; }
};

Times times_of(std::size_t n, std::mt19937_64& random) {
  std::uniform_real_distribution<double> step(0.5, 1.5);
  Times out{.time_s = {0}, .second = static_cast<Index>(2 * n / 3)};
  while (out.time_s.size() < n) out.time_s.push_back(out.time_s.back() + step(random));
  return out;
}

/// A level per series and a trend.
MatrixXd jacobian_of(const Times& times) {
  const auto n = static_cast<Index>(times.time_s.size());
  MatrixXd J = MatrixXd::Zero(n, 3);
  for (Index i = 0; i < n; ++i)
    J(i, i < times.second ? 0 : 1) = 1, J(i, 2) = 1e-3 * times.time_s[static_cast<std::size_t>(i)];
  return J;
}

VectorXd noise_of(const Times& times, const CorrelatedNoise& noise, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  VectorXd out(static_cast<Index>(times.time_s.size()));
  double slow = 0;
  for (Index i = 0; i < out.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const double kept = i == 0 || i == times.second || noise.correlation_s == 0
                            ? 0
                            : std::exp(-(times.time_s[k] - times.time_s[k - 1]) / noise.correlation_s);
    slow = kept * slow + std::sqrt(1 - kept * kept) * noise.slow * normal(random);
    out(i) = slow + noise.white * normal(random);
  }
  return out;
}

VectorXd residual_of(const MatrixXd& J, const VectorXd& y) {
  return y - J * (J.transpose() * J).inverse() * J.transpose() * y;
}

TEST(CorrelatedNoise, CovarianceIsThatOfTheWholeMatrix) {
  std::mt19937_64 random(1);
  const Times times = times_of(60, random);
  const MatrixXd J = jacobian_of(times), pseudo = (J.transpose() * J).inverse() * J.transpose();
  const CorrelatedNoise noise{.white = 0.5, .slow = 2, .correlation_s = 7};
  MatrixXd V = MatrixXd::Zero(60, 60);
  for (Index i = 0; i < 60; ++i)
    for (Index k = 0; k < 60; ++k)
      if ((i < times.second) == (k < times.second))
        V(i, k) = 4 * std::exp(-std::abs(times.time_s[static_cast<std::size_t>(i)] -
                                         times.time_s[static_cast<std::size_t>(k)]) /
                               7) +
                  (i == k ? 0.25 : 0);
  const MatrixXd expected = pseudo * V * pseudo.transpose();
  EXPECT_LT((least_squares_covariance(J, noise, times.span()) - expected).norm(), 1e-10 * expected.norm());
}

TEST(CorrelatedNoise, IsFoundInResiduals) {
  for (const CorrelatedNoise truth : {CorrelatedNoise{.white = 1},
                                      {.white = 1, .slow = 1, .correlation_s = 20},
                                      {.white = 0.1, .slow = 1, .correlation_s = 50}}) {
    std::mt19937_64 random(2);
    const Times times = times_of(3000, random);
    const MatrixXd J = jacobian_of(times);
    const auto found = correlated_noise(residual_of(J, noise_of(times, truth, random)), J, times.span());
    EXPECT_NEAR(found.white, truth.white, 0.1);
    EXPECT_NEAR(found.slow, truth.slow, 0.25) << truth.correlation_s;
    if (truth.slow > 0)
      EXPECT_NEAR(std::log(found.correlation_s / truth.correlation_s), 0, 0.7);  // 3 sigmas in 60 correlation times
    else
      EXPECT_EQ(found.samples_per_independent(1), 1);
  }
}

TEST(CorrelatedNoise, SigmasHoldWhereNoiseIsAsSlowAsTheRecordIsLong) {
  // 200 s with a time of 60 s: the fit absorbs most of the drift, which the autocorrelation of residuals cannot see.
  std::mt19937_64 random(3);
  const CorrelatedNoise truth{.white = 0.2, .slow = 1, .correlation_s = 60};
  double squares = 0;
  constexpr int repeats = 200;
  for (int k = 0; k < repeats; ++k) {
    const Times times = times_of(300, random);
    const MatrixXd J = jacobian_of(times);
    const VectorXd y = noise_of(times, truth, random), residual = residual_of(J, y);
    const VectorXd estimate = (J.transpose() * J).inverse() * J.transpose() * y;
    const MatrixXd C = least_squares_covariance(J, correlated_noise(residual, J, times.span()), times.span());
    squares += estimate(2) * estimate(2) / C(2, 2) / repeats;
  }
  EXPECT_GT(squares, 0.6);
  EXPECT_LT(squares, 1.6);
}

TEST(CorrelatedNoise, NothingIsNoNoise) {
  const std::vector<double> time_s{0, 1, 2, 3};
  const auto none = correlated_noise(VectorXd::Zero(4), MatrixXd::Ones(4, 1), {time_s});
  EXPECT_EQ(none.variance(), 0);
  EXPECT_EQ(none.samples_per_independent(1), 1);
}

}  // namespace
}  // namespace tribotwin::twin
