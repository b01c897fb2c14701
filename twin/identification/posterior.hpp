#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/calibration.hpp>
#include <tribotwin/twin/identification/gauss_newton.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>

/// Internal to this folder, not installed.
namespace tribotwin::twin::identification {

inline constexpr double impossible = std::numeric_limits<double>::infinity();

/// Thrown when the user wants to stop.
struct Interrupted {};

/// Counts simulations for the progress line.
class Counter {
 public:
  Counter(const Watch& watch, double total) : watch_(watch), total_(total) {}
  /// Throws Interrupted.
  void add(double simulations) {
    if (watch_.stop && *watch_.stop) throw Interrupted{};
    if (!watch_.progress || ranks().several()) return;
    const std::lock_guard lock(mutex_);
    done_ += simulations;
    watch_.progress(std::min(1.0, done_ / total_));
  }

 private:
  const Watch& watch_;
  double total_, done_ = 0;
  std::mutex mutex_;
};

/// n sum ln(error) over the joints + 1/2 sum z^2 over the free quantities, after the training recordings; infinite
/// where the twin is refused or diverges.
class Posterior {
 public:
  Posterior(const VariantTwins& twins, const std::vector<Recording>& recordings, std::vector<std::size_t> training,
            const SearchOptions& options, Counter& counter, unsigned threads)
      : twins_(twins),
        recordings_(recordings),
        training_(std::move(training)),
        options_(options),
        counter_(counter),
        threads_(threads),
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

  double operator()(const Eigen::VectorXd& z) const {
    counter_.add(static_cast<double>(training_.size()));
    const auto r = residuals(z);
    if (!r) return impossible;
    double sum = prior(z);
    for (Eigen::Index k = 0; k < joints(); ++k)
      sum += independent_ * (options_.norm == Norm::squared ? 0.5 : 1.0) * std::log(std::max(error(*r, k), 1e-30));
    return sum;
  }

  /// Of the squared norm, by forward differences.
  Quadratic quadratic(const Eigen::VectorXd& z, double step) const {
    const auto made = linearised(z, step, false);
    Quadratic q{Eigen::VectorXd::Zero(size()), Eigen::MatrixXd::Zero(size(), size())};
    for (const Block& block : made) q.gradient += block.gradient, q.curvature += block.curvature;
    for (Eigen::Index i = 0; i < size(); ++i)
      if (quantity(i).sigma > 0) q.gradient(i) += z(i), q.curvature(i, i) += 1;
    return q;
  }

  /// Covariance of the quantities `inner` at the minimum z: a jackknife over blocks of time, all joints together, so
  /// that errors which last and trajectories that disagree are counted. Quantities without a prior have one of three
  /// times their scale here: the bounds.
  Eigen::MatrixXd covariance(const Eigen::VectorXd& z, double step, const std::vector<Eigen::Index>& inner) const {
    const auto n = static_cast<Eigen::Index>(inner.size());
    if (n == 0) return Eigen::MatrixXd(0, 0);
    const auto blocks = linearised(z, step, true);
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
  /// Per training recording samples x drives: errors of position [rad] over the square root of their number, so that
  /// every recording has the same weight; 0 where nothing was measured.
  using Residuals = std::vector<Eigen::MatrixXd>;

  Eigen::Index joints() const { return std::ssize(drives_[0]); }

  std::optional<Residuals> residuals(const Eigen::VectorXd& z) const {
    const auto candidate = twins_.candidate(values(z));
    if (!candidate) return std::nullopt;
    Residuals all;
    for (std::size_t i = 0; i < training_.size(); ++i) {
      const auto positions = twins_.positions(*candidate, recordings_[training_[i]]);
      if (!positions) return std::nullopt;
      all.push_back(weighted(i, *positions));
    }
    return all;
  }

  Eigen::MatrixXd weighted(std::size_t training, const VariantTwins::Positions& positions) const {
    const SetPoints& r = recordings_[training_[training]].points;
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

  /// Of a joint: mean square [rad^2] or mean absolute [rad].
  double error(const Residuals& r, Eigen::Index joint) const {
    double sum = 0;
    for (const Eigen::MatrixXd& one : r) {
      const auto column = one.col(joint);
      const double count = static_cast<double>((column.array() != 0).count()) * static_cast<double>(r.size());
      sum += options_.norm == Norm::squared ? column.squaredNorm() : column.lpNorm<1>() / std::sqrt(count);
    }
    return sum;
  }

  /// Blocks of at most correlation_s, at least 24 of them. Each direction that cannot be simulated counts as flat.
  std::vector<Block> linearised(const Eigen::VectorXd& z, double step, bool central) const {
    const auto n = static_cast<std::size_t>(size());
    std::vector<Eigen::VectorXd> points{z};
    for (Eigen::Index j = 0; j < size(); ++j)
      for (const double sign : {1.0, -1.0}) {
        points.push_back(z);
        points.back()(j) += (z(j) + step > high(j) && !central ? -1 : 1) * sign * step;
      }
    std::vector<std::optional<Residuals>> at(points.size());
    counter_.add(static_cast<double>((central ? 2 * n + 1 : n + 1) * training_.size()));
    in_parallel(points.size(), threads_, [&](std::size_t i) {
      if (central || i == 0 || i % 2 == 1) at[i] = residuals(points[i]);
    });
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
        const auto &up = at[2 * j + 1], &down = central ? at[2 * j + 2] : at[0];
        const double way = points[2 * j + 1](static_cast<Eigen::Index>(j)) - z(static_cast<Eigen::Index>(j));
        Eigen::MatrixXd slope = Eigen::MatrixXd::Zero((*at[0])[i].rows(), joints());
        if (up && down) slope = ((*up)[i] - (*down)[i]) / (central ? 2 * way : way);
        J.push_back(std::move(slope));
      }
      add_blocks(recordings_[training_[i]].points.time_s, (*at[0])[i], J, weight, blocks);
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
  Counter& counter_;
  const unsigned threads_;
  const std::vector<std::size_t> free_;
  std::vector<std::vector<std::size_t>> drives_;  ///< of the joints of each training recording
  double independent_ = 0;
};

}  // namespace tribotwin::twin::identification
