#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/dynamics_choice/held_out.hpp>

/// Chooses how to identify a robot's dynamics by what predicts best: coupled motors, signals, friction, outliers, rotor
/// inertias and a prior, one after the other, each by the error of samples that the fit has not seen (files where there
/// are three or more, else stretches of time). A setting replaces a simpler one only where its error is smaller by more
/// than 2.5 standard errors, some kinds by other bars (README.md).
namespace tribotwin::twin::identification {

/// What the user decided; the rest is chosen.
struct Decided {
  std::optional<double> cutoff_hz;
  std::optional<unsigned> decimation;
  const friction::LawInfo* law = nullptr;
  std::optional<bool> asymmetry, offset, rotor_inertia;
  std::optional<double> prior;
  std::optional<std::vector<std::string>> by_position;  ///< Setting::by_position
  bool coupling = false;      ///< no motor turns with several joints but those of the regressor
  bool lag = false;           ///< of torques is none, or known
  std::vector<double> lag_s;  ///< the known one, as in Preparation
  bool take_lag = false;      ///< one that its sigmas prove is taken whatever it brings
  std::optional<Robust> robust;
  bool instruments = false;  ///< only what instrumental variables know: knows_instruments() of the law, and no
                             ///< asymmetry, torque by position, robust loss, prior and lag
};

struct Trial {
  std::string what;     ///< "cut-off 10 Hz", "friction stribeck", ...
  double change = 0;    ///< of the held-out error against the best before it, as a share; NaN where it failed
  double sigma = 0;     ///< standard error of the change
  Eigen::VectorXd rms;  ///< held-out error per joint with torque [Nm; N]; empty where it failed
  bool taken = false;
  std::string failure;  ///< why there is no result; else empty
  std::string remark;   ///< "contains coulomb_viscous, yet worse: overfits or did not converge"; mostly empty
};

struct DynamicsChoice {
  Setting setting;
  DynamicsFit fit;            ///< of the samples that were compared: the start of the fit with the setting
  std::vector<Trial> trials;  ///< in the order in which they were made; the first is the start
  unsigned folds = 0;
  bool by_file = false;      ///< folds are files
  bool real_bodies = true;   ///< do not predict clearly worse than least squares
  double target_hz = 0;      ///< band of the torque that errors are counted against
  double lag_target_hz = 0;  ///< the same from the trial on that took a lag; 0: none was taken
};

/// What is wrong with a setting that contains another (a law with more terms, asymmetry beside it, all else alike) and
/// predicts worse than it by more than two standard errors; else empty.
std::string remark_of(const Setting& setting, const Setting& narrower, const Comparison& comparison);

/// ErrorKind::input where not even the first setting can be fitted. `torque_max_nm`: of joints without a drive, as for
/// robot_friction. `progress` gets a share of 0 .. 1.
Result<DynamicsChoice> choose_dynamics(const mujoco::Model& model, const Regressor& regressor,
                                       const BaseParameters& base, std::span<const RobotRecording> recordings,
                                       const Decided& decided, std::span<const double> torque_max_nm, unsigned threads,
                                       const std::function<void(double share)>& progress = {});

}  // namespace tribotwin::twin::identification
