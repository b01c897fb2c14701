#pragma once

#include <cmath>
#include <random>

#include <Eigen/Dense>

/// The motion of a test's arm in closed form: some sines per joint, the k-th with the first's amplitude / k.
namespace tribotwin::twin::identification {

class Multisine {
 public:
  struct Shape {
    double first_hz = 0.17, next_hz = 0.13, per_joint_hz = 0.05, amplitude_rad = 0.8;
    int sines = 3;
  };
  struct State {
    Eigen::VectorXd q, qd, qdd;
  };

  /// Phases from `random`, joint by joint.
  Multisine(Eigen::Index joints, std::mt19937_64& random, Shape shape) : shape_(shape), phase_(shape.sines, joints) {
    std::uniform_real_distribution<double> uniform(0, 2 * M_PI);
    for (double& p : phase_.reshaped()) p = uniform(random);
  }
  Multisine(Eigen::Index joints, std::mt19937_64& random) : Multisine(joints, random, Shape{}) {}

  State at(double time_s) const {
    State s{Eigen::VectorXd::Zero(phase_.cols()), Eigen::VectorXd::Zero(phase_.cols()),
            Eigen::VectorXd::Zero(phase_.cols())};
    for (Eigen::Index j = 0; j < phase_.cols(); ++j)
      for (int k = 0; k < shape_.sines; ++k) {
        const double w =
            2 * M_PI * (shape_.first_hz + shape_.next_hz * k + shape_.per_joint_hz * static_cast<double>(j));
        const double a = shape_.amplitude_rad / (1 + k), x = w * time_s + phase_(k, j);
        s.q(j) += a * std::sin(x), s.qd(j) += a * w * std::cos(x), s.qdd(j) -= a * w * w * std::sin(x);
      }
    return s;
  }
  double phase(Eigen::Index joint, int sine) const { return phase_(sine, joint); }

 private:
  Shape shape_;
  Eigen::MatrixXd phase_;  ///< sines x joints
};

}  // namespace tribotwin::twin::identification
