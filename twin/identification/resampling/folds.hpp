#pragma once

#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include <Eigen/Dense>

namespace tribotwin::twin::identification {

/// Cross-validation of a motion: parts that are left out one at a time. Robots repeat their motion, within a file and
/// from file to file; a fit that has seen the same motion elsewhere is asked for nothing new. So with a part its
/// repetitions are left out too.
struct Fold {
  std::vector<std::size_t> held;   ///< blocks that are predicted
  std::vector<std::size_t> alike;  ///< blocks that are not, but repeat their motion: not fitted either
};

/// `q`, `qd`: joints x samples. `blocks`: samples [first, second), in order of time; `file`: of each block. Whole files
/// are held where there are three or more, else `count` stretches of time. A block is alike where 30 % of its samples
/// are close to a held one: within 0.2 standard deviations, rms over positions and speeds of all joints. With a fold
/// at most half of the blocks are left out, the closest first.
std::vector<Fold> folds_of(const Eigen::MatrixXd& q, const Eigen::MatrixXd& qd,
                           std::span<const std::pair<Eigen::Index, Eigen::Index>> blocks,
                           std::span<const std::size_t> file, unsigned count);

}  // namespace tribotwin::twin::identification
