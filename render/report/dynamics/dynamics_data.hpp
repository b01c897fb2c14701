#pragma once

#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/identification/verdict/joint_verdict.hpp>

namespace tribotwin::render {

/// How far predicted torques of a joint are from recorded ones, as tribotwin predict found it.
struct JointPrediction {
  std::string name, unit;                                    ///< Nm, or N of a slide
  std::string lacking;                                       ///< why there is no error; empty: there is one if it moves
  double rms = 0, of_range = 0, range = 0, largest = 0;      ///< [unit], of_range: 0 .. 1; NaN where the joint rests
  bool badly_explained = false;                              ///< 30 % of the torque's variation or more
  double of_variation = 0;                                   ///< unexplained share of it, 0 .. 1; NaN where not judged
  std::vector<twin::identification::Dependence> dependence;  ///< of the residual
  double outside = 0;      ///< largest share of samples outside the training's range of a quantity; NaN: not known
  std::string outside_of;  ///< which quantity that is
  double half_width = std::numeric_limits<double>::quiet_NaN();  ///< of the 95 % band [unit]; NaN: there is none
  /// Share of the samples in the training whose recorded torque is not in the band, 0 .. 1; NaN: there are none.
  double beside_band = std::numeric_limits<double>::quiet_NaN();
  bool band_fails = false;                          ///< so many that there is a warning
  std::vector<double> time_s, recorded, predicted;  ///< [s; unit]; predicted NaN at rest
  std::vector<double> band;                         ///< half_width; NaN where it does not hold. Empty: no band
};

struct DynamicsData {
  std::vector<std::filesystem::path> files;  ///< that were read: the JSON, its table, the parameter file
  std::string model, parameters;             ///< as named in the call of tribotwin predict
  std::vector<std::string> recordings;
  std::vector<JointPrediction> joints;
  std::vector<std::string> warnings, badly_explained;             ///< sentences
  std::vector<twin::identification::FrictionEstimates> friction;  ///< of the parameter file; empty where it is missing
  std::vector<std::string> missing;                               ///< what is not there, and why: for the reader
};

/// `file`: JSON of tribotwin predict; its table and parameter file are looked for in the working directory and beside
/// it, and `missing` says which is not there. ErrorKind::input with file, key and what would be right.
Result<DynamicsData> load_dynamics(const std::filesystem::path& file);

}  // namespace tribotwin::render
