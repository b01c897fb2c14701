#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/calibration.hpp>

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
    if (!watch_.progress) return;
    const std::lock_guard lock(mutex_);
    done_ += simulations;
    watch_.progress(std::min(1.0, done_ / total_));
  }

 private:
  const Watch& watch_;
  double total_, done_ = 0;
  std::mutex mutex_;
};

/// n ln(error) + 1/2 sum z^2 over the free quantities, after the training recordings; infinite where the twin is
/// refused or diverges.
class Posterior {
 public:
  Posterior(const VariantTwins& twins, const std::vector<Recording>& recordings, std::vector<std::size_t> training,
            const SearchOptions& options, Counter& counter)
      : twins_(twins),
        recordings_(recordings),
        training_(std::move(training)),
        options_(options),
        counter_(counter),
        free_(twins.free_quantities()) {
    for (const std::size_t i : training_)
      independent_ += std::max(1.0, recordings_[i].duration_s() / options.correlation_s);
  }

  Eigen::Index size() const { return static_cast<Eigen::Index>(free_.size()); }
  double independent() const { return independent_; }
  const Quantity& quantity(Eigen::Index i) const {
    return twins_.variant().quantities[free_[static_cast<std::size_t>(i)]];
  }

  std::vector<double> values(const Eigen::VectorXd& z) const {
    std::vector<double> all;
    for (const auto& q : twins_.variant().quantities) all.push_back(q.start);
    for (Eigen::Index i = 0; i < size(); ++i) all[free_[static_cast<std::size_t>(i)]] = quantity(i).value(z(i));
    return all;
  }

  /// Error of the training recordings: mean square [rad^2] or mean absolute [rad].
  double error(const Eigen::VectorXd& z) const {
    const auto candidate = twins_.candidate(values(z));
    counter_.add(static_cast<double>(training_.size()));
    if (!candidate) return impossible;
    double sum = 0;
    for (const std::size_t i : training_) {
      const auto positions = twins_.positions(*candidate, recordings_[i]);
      if (!positions) return impossible;
      sum += mean_error(options_.norm, recordings_[i], *positions);
    }
    return sum / static_cast<double>(training_.size());
  }

  double operator()(const Eigen::VectorXd& z) const {
    const double e = error(z);
    return e == impossible
               ? impossible
               : independent_ * (options_.norm == Norm::squared ? 0.5 : 1.0) * std::log(std::max(e, 1e-30)) + prior(z);
  }

  /// J^T J of the positions over their mean square error, every recording with the same weight.
  Eigen::MatrixXd information(const Eigen::VectorXd& z, double step) const {
    const double mean_square = mean_square_error(z);
    Moved moved;
    for (Eigen::Index j = 0; j < size(); ++j) {
      Eigen::VectorXd up = z, down = z;
      up(j) += step, down(j) -= step;
      moved.emplace_back(twins_.candidate(values(up)), twins_.candidate(values(down)));
    }
    Eigen::MatrixXd total = Eigen::MatrixXd::Zero(size(), size());
    for (const std::size_t i : training_) {
      counter_.add(2 * static_cast<double>(size()));
      const Eigen::MatrixXd J = jacobian(recordings_[i], moved, step);
      total += J.transpose() * J / static_cast<double>(J.rows());
    }
    return total * (independent_ / (mean_square * static_cast<double>(training_.size())));
  }

 private:
  using Moved = std::vector<std::pair<Result<VariantTwins::Candidate>, Result<VariantTwins::Candidate>>>;

  double mean_square_error(const Eigen::VectorXd& z) const {
    const auto candidate = twins_.candidate(values(z));
    if (!candidate) return impossible;
    double sum = 0;
    for (const std::size_t i : training_) {
      const auto positions = twins_.positions(*candidate, recordings_[i]);
      sum += positions ? mean_error(Norm::squared, recordings_[i], *positions) : impossible;
    }
    return sum / static_cast<double>(training_.size());
  }

  /// d position / d z by central differences, samples x z; 0 where a twin is refused or diverges.
  Eigen::MatrixXd jacobian(const Recording& recording, const Moved& moved, double step) const {
    const auto count = static_cast<Eigen::Index>(recording.points.time_s.size());
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(count, size());
    for (Eigen::Index j = 0; j < size(); ++j) {
      const auto& [high, low] = moved[static_cast<std::size_t>(j)];
      if (!high || !low) continue;
      const auto up = twins_.positions(*high, recording), down = twins_.positions(*low, recording);
      if (!up || !down) continue;
      for (Eigen::Index k = 0; k < count; ++k) {
        const double d = ((*up)[static_cast<std::size_t>(k)] - (*down)[static_cast<std::size_t>(k)]) / (2 * step);
        if (std::isfinite(d)) J(k, j) = d;
      }
    }
    return J;
  }

  double prior(const Eigen::VectorXd& z) const {
    double sum = 0;
    for (Eigen::Index i = 0; i < size(); ++i) {
      const Quantity& q = quantity(i);
      const double inside = std::clamp(z(i), q.coordinate(q.low), q.coordinate(q.high)), beyond = z(i) - inside;
      sum += (q.sigma > 0 ? 0.5 * inside * inside : 0) +
             10 * beyond * beyond;  // leads back to the range in which the value depends on z
    }
    return sum;
  }

  const VariantTwins& twins_;
  const std::vector<Recording>& recordings_;
  const std::vector<std::size_t> training_;
  const SearchOptions& options_;
  Counter& counter_;
  const std::vector<std::size_t> free_;
  double independent_ = 0;
};

}  // namespace tribotwin::twin::identification
