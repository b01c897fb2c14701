#pragma once

#include <atomic>
#include <cstdint>
#include <random>

#include <Eigen/Dense>

#include <tribotwin/twin/numerics/search.hpp>

/// Minimum of a function without derivatives.
namespace tribotwin::twin {

/// Independent normal numbers of one seed.
class Gaussian {
 public:
  explicit Gaussian(std::uint64_t seed) : random_(seed) {}
  Eigen::VectorXd operator()(Eigen::Index n) {
    Eigen::VectorXd z(n);
    for (Eigen::Index i = 0; i < n; ++i) z(i) = normal_(random_);
    return z;
  }

 private:
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

struct CmaOptions {
  int population = 8;
  double first_step = 0.3, last_step = 1e-4;  ///< standard deviation of the search; it ends below the last
  int evaluations = 1000;                     ///< at most
  const std::atomic<bool>* stop = nullptr;    ///< ends after the generation under way
};

/// CMA-ES with rank-one and rank-mu updates and cumulative step-size adaptation, constants as in Hansen 2016.
/// Coordinates should be of order 1. The best point that was tried, `start` among them. It asks for a generation at
/// once; `gaussian` is used until it is over.
Search cma_es(Eigen::VectorXd start, CmaOptions options, Gaussian& gaussian);

}  // namespace tribotwin::twin
