#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/calibration.hpp>
#include <tribotwin/twin/identification/gauss_newton.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

/// Internal to this folder, not installed.
namespace tribotwin::twin::identification {

inline constexpr double impossible = std::numeric_limits<double>::infinity();

/// n sum ln(error) over the joints + 1/2 sum z^2 over the free quantities, after the training recordings; infinite
/// where the twin is refused or diverges. Points are simulated by `simulated`, anywhere, some recordings at a time;
/// the other functions put that together.
class Posterior {
 public:
  /// Of a point, per training recording; none where its twin is refused or diverges. Samples x drives: errors of
  /// position [rad] over the square root of their number, so that every recording has the same weight; 0 where nothing
  /// was measured. Or one row: the share of each joint's error, in which they are squared or absolute.
  using Simulated = std::optional<std::vector<Eigen::MatrixXd>>;
  enum class Detail : std::uint8_t { errors, residuals };

  Posterior(const VariantTwins& twins, const std::vector<Recording>& recordings, std::vector<std::size_t> training,
            const SearchOptions& options)
      : twins_(twins),
        recordings_(recordings),
        training_(std::move(training)),
        options_(options),
        free_(twins.free_quantities()) {
    for (const std::size_t i : training_) {
      independent_ += std::max(1.0, recordings_[i].duration_s() / options.correlation_s);
      drives_.push_back(twins_.drives_of(recordings_[i]));
    }
  }

  Eigen::Index size() const { return static_cast<Eigen::Index>(free_.size()); }
  const Quantity& quantity(Eigen::Index i) const {
    return twins_.variant().quantities[free_[static_cast<std::size_t>(i)]];
  }
  double low(Eigen::Index i) const { return quantity(i).coordinate(quantity(i).low); }
  double high(Eigen::Index i) const { return quantity(i).coordinate(quantity(i).high); }

  std::vector<double> values(const Eigen::VectorXd& z) const {
    std::vector<double> all;
    for (const auto& q : twins_.variant().quantities) all.push_back(q.start);
    for (Eigen::Index i = 0; i < size(); ++i) all[free_[static_cast<std::size_t>(i)]] = quantity(i).value(z(i));
    return all;
  }

  std::size_t recordings() const { return training_.size(); }
  const Recording& recording(std::size_t i) const { return recordings_[training_[i]]; }

  /// The training recordings first <= i < last.
  Simulated simulated(const VariantTwins::Candidate& candidate, Detail detail, std::size_t first,
                      std::size_t last) const {
    std::vector<Eigen::MatrixXd> all;
    for (std::size_t i = first; i < last; ++i) {
      const auto positions = twins_.positions(candidate, recording(i));
      if (!positions) return std::nullopt;
      Eigen::MatrixXd r = weighted(i, *positions);
      all.push_back(detail == Detail::residuals ? std::move(r) : errors(r));
    }
    return all;
  }

  /// `of_z`: errors.
  double objective(const Eigen::VectorXd& z, const Simulated& of_z) const {
    if (!of_z) return impossible;
    double sum = prior(z);
    for (Eigen::Index k = 0; k < joints(); ++k) {
      double error = 0;
      for (const Eigen::MatrixXd& one : *of_z) error += one(0, k);
      sum += independent_ * (options_.norm == Norm::squared ? 0.5 : 1.0) * std::log(std::max(error, 1e-30));
    }
    return sum;
  }

  /// The points whose residuals `quadratic` and `covariance` need: z, and beside it one or (central) two per direction.
  std::vector<Eigen::VectorXd> neighbours(const Eigen::VectorXd& z, double step, bool central) const {
    std::vector<Eigen::VectorXd> points{z};
    for (Eigen::Index j = 0; j < size(); ++j)
      for (const double sign : {1.0, -1.0}) {
        if (sign < 0 && !central) continue;
        points.push_back(z);
        points.back()(j) += (z(j) + step > high(j) && !central ? -1 : 1) * sign * step;
      }
    return points;
  }

  /// Of the squared norm, by forward differences. `at`: residuals of the neighbours.
  Quadratic quadratic(const Eigen::VectorXd& z, double step, const std::vector<Simulated>& at) const {
    const auto made = linearised(neighbours(z, step, false), at, false);
    Quadratic q{Eigen::VectorXd::Zero(size()), Eigen::MatrixXd::Zero(size(), size())};
    for (const Block& block : made) q.gradient += block.gradient, q.curvature += block.curvature;
    for (Eigen::Index i = 0; i < size(); ++i)
      if (quantity(i).sigma > 0) q.gradient(i) += z(i), q.curvature(i, i) += 1;
    return q;
  }

  /// Covariance of the quantities `inner` at the minimum z: a jackknife over blocks of time, all joints together, so
  /// that errors which last and trajectories that disagree are counted. Quantities without a prior have one of three
  /// times their scale here: the bounds. `at`: residuals of the neighbours, central.
  Eigen::MatrixXd covariance(const Eigen::VectorXd& z, double step, const std::vector<Simulated>& at,
                             const std::vector<Eigen::Index>& inner) const {
    const auto n = static_cast<Eigen::Index>(inner.size());
    if (n == 0) return Eigen::MatrixXd(0, 0);
    const auto blocks = linearised(neighbours(z, step, true), at, true);
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(n, n), P = H;
    for (Eigen::Index a = 0; a < n; ++a) P(a, a) = quantity(inner[static_cast<std::size_t>(a)]).sigma > 0 ? 1 : 1.0 / 9;
    for (const Block& block : blocks) H += block.curvature(inner, inner);
    H += P;
    const Eigen::MatrixXd inverse = ShortestSolution(H).pseudo_inverse();
    Eigen::MatrixXd C = inverse * P * inverse;
    const double count = static_cast<double>(blocks.size());
    for (const Block& block : blocks) {
      const Eigen::VectorXd u = ShortestSolution(H - block.curvature(inner, inner))(block.gradient(inner));
      C += (count - 1) / count * u * u.transpose();
    }
    return C;
  }

 private:
  /// Share of a stretch of time in the slope and curvature of the likelihood.
  struct Block {
    Eigen::VectorXd gradient;
    Eigen::MatrixXd curvature;
  };
  Eigen::Index joints() const { return std::ssize(drives_[0]); }

  Eigen::MatrixXd weighted(std::size_t training, const VariantTwins::Positions& positions) const {
    const SetPoints& r = recording(training).points;
    const auto samples = std::ssize(r.time_s);
    Eigen::MatrixXd errors = Eigen::MatrixXd::Zero(samples, joints());
    for (std::size_t k = 0; k < positions.size(); ++k) {
      auto column = errors.col(static_cast<Eigen::Index>(drives_[training][k]));
      double count = 0;
      for (Eigen::Index s = 0; s < samples; ++s) {
        const auto at = static_cast<std::size_t>(s);
        const double e = positions[k][at] - r.measured_rad[k][at];
        if (std::isfinite(e)) column(s) = e, ++count;
      }
      column /= std::sqrt(count * static_cast<double>(training_.size()));
    }
    return errors;
  }

  /// Per joint the share of this recording in the mean square [rad^2] or mean absolute [rad].
  Eigen::MatrixXd errors(const Eigen::MatrixXd& residuals) const {
    Eigen::MatrixXd share(1, joints());
    for (Eigen::Index k = 0; k < joints(); ++k) {
      const auto column = residuals.col(k);
      const double count = static_cast<double>((column.array() != 0).count()) * static_cast<double>(training_.size());
      share(0, k) = options_.norm == Norm::squared ? column.squaredNorm() : column.lpNorm<1>() / std::sqrt(count);
    }
    return share;
  }

  /// Blocks of at most correlation_s, at least 24 of them. Each direction that cannot be simulated counts as flat.
  std::vector<Block> linearised(const std::vector<Eigen::VectorXd>& points, const std::vector<Simulated>& at,
                                bool central) const {
    const auto n = static_cast<std::size_t>(size());
    if (!at[0]) return {};
    Eigen::VectorXd weight(joints());
    for (Eigen::Index k = 0; k < joints(); ++k) {
      double square = 0;
      for (const auto& one : *at[0]) square += one.col(k).squaredNorm();
      weight(k) = independent_ / std::max(square, 1e-30);
    }
    std::vector<Block> blocks;
    for (std::size_t i = 0; i < training_.size(); ++i) {
      std::vector<Eigen::MatrixXd> J;  // per direction, samples x drives
      for (std::size_t j = 0; j < n; ++j) {
        const std::size_t beside = central ? 2 * j + 1 : j + 1;
        const auto &up = at[beside], &down = central ? at[beside + 1] : at[0];
        const auto direction = static_cast<Eigen::Index>(j);
        const double way = points[beside](direction) - points[0](direction);
        Eigen::MatrixXd slope = Eigen::MatrixXd::Zero((*at[0])[i].rows(), joints());
        if (up && down) slope = ((*up)[i] - (*down)[i]) / (central ? 2 * way : way);
        J.push_back(std::move(slope));
      }
      add_blocks(recording(i).points.time_s, (*at[0])[i], J, weight, blocks);
    }
    return blocks;
  }

  void add_blocks(const std::vector<double>& time_s, const Eigen::MatrixXd& r, const std::vector<Eigen::MatrixXd>& J,
                  const Eigen::VectorXd& weight, std::vector<Block>& blocks) const {
    double total_s = 0;
    for (const std::size_t i : training_) total_s += recordings_[i].duration_s();
    const double length_s = std::min(options_.correlation_s, total_s / 24);
    for (std::size_t first = 0; first < time_s.size();) {
      const auto last = std::ranges::lower_bound(time_s, time_s[first] + length_s) - time_s.begin();
      const auto from = static_cast<Eigen::Index>(first), rows = std::max<Eigen::Index>(1, last - from);
      Block block{Eigen::VectorXd::Zero(size()), Eigen::MatrixXd::Zero(size(), size())};
      for (Eigen::Index k = 0; k < joints(); ++k) {
        Eigen::MatrixXd columns(rows, size());
        for (Eigen::Index j = 0; j < size(); ++j)
          columns.col(j) = J[static_cast<std::size_t>(j)].col(k).segment(from, rows);
        block.gradient += weight(k) * columns.transpose() * r.col(k).segment(from, rows);
        block.curvature += weight(k) * columns.transpose() * columns;
      }
      blocks.push_back(std::move(block));
      first += static_cast<std::size_t>(rows);
    }
  }

  double prior(const Eigen::VectorXd& z) const {
    double sum = 0;
    for (Eigen::Index i = 0; i < size(); ++i) {
      const double inside = std::clamp(z(i), low(i), high(i)), beyond = z(i) - inside;
      sum += (quantity(i).sigma > 0 ? 0.5 * inside * inside : 0) +
             10 * beyond * beyond;  // leads back to the range in which the value depends on z
    }
    return sum;
  }

  const VariantTwins& twins_;
  const std::vector<Recording>& recordings_;
  const std::vector<std::size_t> training_;
  const SearchOptions& options_;
  const std::vector<std::size_t> free_;
  std::vector<std::vector<std::size_t>> drives_;  ///< of the joints of each training recording
  double independent_ = 0;
};

}  // namespace tribotwin::twin::identification
