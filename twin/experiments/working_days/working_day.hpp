#pragma once

#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/working_days/campaign.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>

/// One test of a campaign: after a night's rest a robot repeats Hao 2021's cycle while its controller records positions
/// and motor torques. From these alone its parameters are identified, per cycle and for the whole day.
///
/// 1. Each cycle's sections of inertia and friction, as by `tribotwin dynamics`, without temperature.
/// 2. With the mean of the inertial parameters, friction over the day in windows of some seconds, which stands for the
///    temperature. Its power is that of the motor without rigid dynamics.
/// 3. The thermal model of each joint from both (thermal_fit.hpp), and with the temperatures it predicts one fit over
///    all cycles, whose friction curves and inertial parameters replace those of 2 for some rounds.
namespace tribotwin::twin::repeatability {

struct Measured {
  double value = 0, sigma = 0;  ///< sigma: NaN where not known
};

struct Cycle {
  double start_s = 0;
  std::vector<Measured> base;  ///< in the order of BaseParameters
  std::vector<std::vector<Measured>>
      friction;                    ///< per joint: torque_parameters of the law at the mean temperature of the cycle
  std::vector<Measured> level_nm;  ///< per joint: friction at `level_share` of the largest speed, from the joint's own
                                   ///< part of the friction section
};

/// Friction of a joint over the day. Columns of equal length.
struct Warming {
  std::vector<double> time_s;
  std::vector<double> power_w;  ///< friction heat, mean since the entry before, the first since the start of the day
  std::vector<double> friction_nm;  ///< at `level_share` of the largest speed
};

/// Torques of some seconds of motion, per joint.
struct Stretch {
  std::vector<double> time_s;
  std::vector<std::vector<double>> measured_nm, predicted_nm;
  std::vector<std::vector<bool>> moving;  ///< at rest friction is indeterminate, and no torque is predicted
};

struct WorkingDay {
  double ambient_degC = 0;
  std::vector<Cycle> cycles;
  std::vector<Warming> warming;                 ///< per joint
  std::vector<Measured> base;                   ///< of all cycles
  std::vector<std::vector<Measured>> friction;  ///< per joint: torque_parameters at the start of the day
  std::vector<double> base_of_robot;            ///< true values of the simulated robot
  std::vector<std::vector<double>> friction_of_robot;
  std::vector<std::string> warnings;  ///< of the health check of the simulation
  Stretch cold, hot;  ///< the first series of the first and of the last cycle, predicted by the parameters of the day
};

/// Hao 2021 compares friction at 60 % of the speed.
inline constexpr double level_share = 0.6;

/// Simulates and identifies a test. A function of its arguments alone. ErrorKind::work with the test and the reason.
Result<WorkingDay> working_day(const Campaign& campaign, const Excitation& excitation, std::size_t test);

/// Friction [Nm] in place of a temperature, for fit_thermal: negative unless `rising`, so that it increases with the
/// heat.
identification::HeatSession as_heat(const Warming& warming, std::size_t file, bool rising);
/// Whether friction is higher at the end of the day.
bool rises(const Warming& warming);

}  // namespace tribotwin::twin::repeatability
