#include <algorithm>
#include <cmath>
#include <functional>

#include <tribotwin/twin/identification/resampling/folds.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Rows in units of their standard deviation; rows that do not vary are 0.
MatrixXd standardised(const MatrixXd& X) {
  MatrixXd out = X.colwise() - X.rowwise().mean();
  for (Index r = 0; r < out.rows(); ++r)
    if (const double spread = out.row(r).norm() / std::sqrt(static_cast<double>(out.cols())); spread > 0)
      out.row(r) /= spread;
  return out;
}

/// States of the motion, thinned: a column per kept sample, and the columns of each block.
struct States {
  MatrixXd x;
  std::vector<std::vector<Index>> of_block;
};

States states_of(const MatrixXd& q, const MatrixXd& qd, std::span<const std::pair<Index, Index>> blocks) {
  constexpr Index enough = 2500;
  const Index every = std::max<Index>(1, q.cols() / enough);
  std::vector<Index> kept;
  States out;
  for (const auto& [first, last] : blocks) {
    auto& own = out.of_block.emplace_back();
    for (Index i = first; i < last; i += every) own.push_back(static_cast<Index>(kept.size())), kept.push_back(i);
  }
  out.x.resize(2 * q.rows(), static_cast<Index>(kept.size()));
  out.x << standardised(q)(Eigen::all, kept), standardised(qd)(Eigen::all, kept);
  return out;
}

/// The share of a block's samples that are close to one of `held`.
double likeness(const States& states, std::size_t block, const MatrixXd& held) {
  constexpr double near = 0.2;
  const double limit = near * near * static_cast<double>(held.rows());
  const auto& own = states.of_block[block];
  const auto close = std::ranges::count_if(
      own, [&](Index i) { return (held.colwise() - states.x.col(i)).colwise().squaredNorm().minCoeff() < limit; });
  return static_cast<double>(close) / static_cast<double>(own.size());
}

std::vector<std::size_t> alike_to(const States& states, const std::vector<std::size_t>& held) {
  constexpr double enough = 0.3;
  const std::size_t blocks = states.of_block.size();
  std::vector<Index> columns;
  for (const std::size_t b : held) columns.insert(columns.end(), states.of_block[b].begin(), states.of_block[b].end());
  const MatrixXd x = states.x(Eigen::all, columns);
  std::vector<std::pair<double, std::size_t>> found;
  for (std::size_t b = 0; b < blocks; ++b)
    if (!std::ranges::binary_search(held, b))
      if (const double share = likeness(states, b, x); share > enough) found.emplace_back(share, b);
  std::ranges::sort(found, std::greater{});
  const std::size_t most = blocks / 2 > held.size() ? blocks / 2 - held.size() : 0;
  std::vector<std::size_t> out;
  for (std::size_t k = 0; k < std::min(most, found.size()); ++k) out.push_back(found[k].second);
  return out;
}

}  // namespace

std::vector<Fold> folds_of(const MatrixXd& q, const MatrixXd& qd, std::span<const std::pair<Index, Index>> blocks,
                           std::span<const std::size_t> file, unsigned count) {
  const bool by_file = file.back() + 1 >= 3;
  std::vector<Fold> folds(by_file ? std::min<std::size_t>(count, file.back() + 1) : count);
  for (std::size_t b = 0; b < blocks.size(); ++b)
    folds[by_file ? file[b] % folds.size() : b * folds.size() / blocks.size()].held.push_back(b);
  std::erase_if(folds, [](const Fold& fold) { return fold.held.empty(); });
  const States states = states_of(q, qd, blocks);
  for (Fold& fold : folds) fold.alike = alike_to(states, fold.held);
  return folds;
}

}  // namespace tribotwin::twin::identification
