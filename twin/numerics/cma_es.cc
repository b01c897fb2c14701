#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <tribotwin/twin/numerics/cma_es.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

Search cma_es(VectorXd start, CmaOptions options, Gaussian& gaussian) {
  const int population = options.population, parents = population / 2;
  const Index n = start.size();
  VectorXd mean = start;
  Trial trial{{mean}};
  const Tried first = co_await trial;
  Minimum best{mean, first.values[0], 1};
  if (n == 0) co_return best;

  VectorXd weight(parents);
  for (int i = 0; i < parents; ++i) weight(i) = std::log((population + 1) / 2.0) - std::log(i + 1.0);
  weight /= weight.sum();
  const double N = static_cast<double>(n), mu = 1 / weight.squaredNorm();
  const double c_path = (4 + mu / N) / (N + 4 + 2 * mu / N), c_step = (mu + 2) / (N + mu + 5);
  const double c_one = 2 / (std::pow(N + 1.3, 2) + mu),
               c_mu = std::min(1 - c_one, 2 * (mu - 2 + 1 / mu) / (std::pow(N + 2, 2) + mu));
  const double damping = 1 + 2 * std::max(0.0, std::sqrt((mu - 1) / (N + 1)) - 1) + c_step;
  const double expected_length = std::sqrt(N) * (1 - 1 / (4 * N) + 1 / (21 * N * N));
  VectorXd path = VectorXd::Zero(n), step_path = VectorXd::Zero(n), axes = VectorXd::Ones(n);
  MatrixXd C = MatrixXd::Identity(n, n), B = C;
  double step = options.first_step;
  for (int generation = 1; best.evaluations + population <= options.evaluations &&
                           step * axes.maxCoeff() > options.last_step && !(options.stop && *options.stop);
       ++generation) {
    std::vector<std::pair<double, VectorXd>> tried;
    trial.points.clear();
    for (int k = 0; k < population; ++k) {
      tried.emplace_back(0, B * axes.cwiseProduct(gaussian(n)));
      trial.points.push_back(mean + step * tried.back().second);
    }
    const Tried found = co_await trial;
    for (std::size_t k = 0; k < tried.size(); ++k, ++best.evaluations) {
      tried[k].first = found.values[k];
      if (found.values[k] < best.objective) best.z = trial.points[k], best.objective = found.values[k];
    }
    std::ranges::stable_sort(tried, {}, [](const auto& t) { return t.first; });
    VectorXd move = VectorXd::Zero(n);
    MatrixXd spread = MatrixXd::Zero(n, n);
    for (int i = 0; i < parents; ++i) {
      const VectorXd& y = tried[static_cast<std::size_t>(i)].second;
      move += weight(i) * y;
      spread += weight(i) * y * y.transpose();
    }
    mean += step * move;
    step_path = (1 - c_step) * step_path +
                std::sqrt(c_step * (2 - c_step) * mu) * (B * (B.transpose() * move).cwiseQuotient(axes));
    const bool steady =
        step_path.norm() / std::sqrt(1 - std::pow(1 - c_step, 2 * generation)) / expected_length < 1.4 + 2 / (N + 1);
    path = (1 - c_path) * path + (steady ? std::sqrt(c_path * (2 - c_path) * mu) : 0) * move;
    C = (1 - c_one - c_mu) * C + c_one * (path * path.transpose() + (steady ? 0 : c_path * (2 - c_path)) * C) +
        c_mu * spread;
    step *= std::exp(c_step / damping * (step_path.norm() / expected_length - 1));
    const SymmetricEigen eigen = symmetric_eigen(C);
    B = eigen.vectors;
    axes = eigen.values.cwiseMax(1e-20).cwiseSqrt();
  }
  co_return best;
}

}  // namespace tribotwin::twin
