#pragma once

#include <Eigen/Dense>

#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

/// Physical consistency of base parameters: bodies of positive mass with a pseudo-inertia [[tr(I)/2 - I, mc], [mc', m]]
/// that is positive definite (Wensing 2018), rotor inertias > 0.
///
/// The bodies nearest to the data are the minimum of a convex problem: the quadratic |W (from_all phi - beta)|^2 over
/// the cone of such phi. It is followed to mu = 1e-4 of
///
///   |W (from_all phi - beta)|^2 + mu sum of d(J, J_model),  d(J, K) = tr(J K^-1) - log det(J K^-1) - 4,
///
/// by Newton's method, in coordinates in which d has the same curvature everywhere: J(D) = L (I + D) L', J = L L'. The
/// divergence d (Lee, Wensing, Park 2019) keeps J positive definite and leaves to the model what W does not determine;
/// its part of the minimum is below 1e-3 per body.
namespace tribotwin::twin::identification {

struct Consistency {
  bool possible = false;       ///< within the noise: a chance above 5 %
  double distance_sigma = 0;   ///< Mahalanobis distance of the estimate from the nearest consistent one
  double chance = 1;           ///< that noise makes real bodies as distant: of chi-squared with one degree of freedom
                               ///< per base parameter; or, where that is less, a rotor inertia so far below 0
  Eigen::VectorXd base;        ///< the nearest consistent base parameters
  Eigen::VectorXd parameters;  ///< of bodies that have them, those nearest to the model's; order of the regressor
};

/// Whether the data contradict every real body beyond doubt: the distance is over 1.5 times its 95 % quantile. Sigmas
/// of a model that does not fit are too small by a factor of up to two (UR10e), and bodies are real: within that
/// the misfit is rather another's, of friction or signals.
bool contradicted(double distance_sigma, Eigen::Index base_size);

/// The nearest consistent set: minimises (from_all phi - beta)' information (from_all phi - beta). Where `information`
/// is 0 the model's parameters decide.
Consistency nearest_consistent(const Regressor& regressor, const BaseParameters& base, const Eigen::VectorXd& beta,
                               const Eigen::MatrixXd& information);

/// The identified dynamics of bodies that can be real.
struct ConsistentDynamics {
  bool same = false;           ///< the least-squares base parameters are those of real bodies already
  RobotParameters parameters;  ///< where `same`, exactly those of the fit
  Eigen::VectorXd bodies;      ///< that have these base parameters; order of the regressor
  bool predict_worse = false;  ///< than least squares, of samples that neither has seen (DynamicsChoice::real_bodies)
  Eigen::VectorXd growth;  ///< per joint, rms of the residual / that of the least-squares parameters, in the samples of
                           ///< the fit; NaN where the joint was left out. Empty: not measured
};

/// The minimum of the fit's own weighted sum of squares (DynamicsFit::objective) over real bodies; friction has its
/// conditional optimum given these, within the bounds of its law, to first order where the law is not linear.
ConsistentDynamics consistent_dynamics(const Regressor& regressor, const BaseParameters& base,
                                       const RobotFriction& friction, const DynamicsFit& fit);

/// DynamicsFit::held_out of a fit with folds, but of the real bodies that the samples outside of each fold foretell.
Eigen::MatrixXd held_out_of_real_bodies(const Regressor& regressor, const BaseParameters& base,
                                        const RobotFriction& friction, const DynamicsFit& fit,
                                        const JointMotion& motion, unsigned threads);

/// Measures `growth` on the samples of the fit.
void measure_growth(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                    const DynamicsFit& fit, const JointMotion& motion, unsigned threads, ConsistentDynamics& dynamics);

}  // namespace tribotwin::twin::identification
