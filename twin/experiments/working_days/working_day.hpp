#pragma once

#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/working_days/campaign.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>

/// One test of a campaign: a robot that rested for a night repeats paper 3's cycle, its controller records positions
/// and motor torques, and from these alone come its parameters, cycle by cycle and of the whole day.
///
/// 1. Each cycle's sections of inertia and friction, as `tribotwin dynamics` fits them, without temperature.
/// 2. With the mean of the inertial parameters, friction over the day in windows of some seconds: it is the
/// thermometer. Its power is that of
///    the motor less what rigid dynamics take.
/// 3. The thermal model of each joint from both (thermal_fit.hpp), and with the temperatures it predicts one fit over
/// all cycles,
///    whose friction curves and inertial parameters serve 2 again, for some rounds.
namespace tribotwin::twin::repeatability {

struct Measured {
  double value = 0, sigma = 0;  ///< sigma: NaN where it is not known
};

struct Cycle {
  double start_s = 0;
  std::vector<Measured> base;  ///< in the order of BaseParameters
  std::vector<std::vector<Measured>>
      friction;                    ///< per joint: f1 .. f4 of law 'polynomial' at the mean temperature of the cycle
  std::vector<Measured> level_nm;  ///< per joint: friction at `level_share` of the largest speed, from the joint's own
                                   ///< part of the friction section
};

/// Friction of a joint over the day. All of one length.
struct Warming {
  std::vector<double> time_s;
  std::vector<double> power_w;  ///< friction heat, mean since the entry before, the first since the start of the day
  std::vector<double> friction_nm;  ///< at `level_share` of the largest speed
};

/// Torques of some seconds of motion, per joint.
struct Stretch {
  std::vector<double> time_s;
  std::vector<std::vector<double>> measured_nm, predicted_nm;
  std::vector<std::vector<bool>> moving;  ///< at rest friction is whatever holds the joint, and no torque is predicted
};

struct WorkingDay {
  double ambient_degC = 0;
  std::vector<Cycle> cycles;
  std::vector<Warming> warming;                 ///< per joint
  std::vector<Measured> base;                   ///< of all cycles
  std::vector<std::vector<Measured>> friction;  ///< per joint: f1 .. f4 at the start of the day
  std::vector<double> base_of_robot;            ///< as the simulated robot has it
  std::vector<std::vector<double>> friction_of_robot;
  Stretch cold, hot;  ///< the first series of the first and the last cycle; predicted by the parameters of the day
};

/// Paper 3 compares friction at 60 % of the speed.
inline constexpr double level_share = 0.6;

/// Simulates and identifies a test. A function of its arguments alone. Fails with the test and what went wrong.
Result<WorkingDay> working_day(const Campaign& campaign, const Excitation& excitation, std::size_t test);

std::string to_text(const WorkingDay& day);
/// How many of each a day of a robot has.
struct Shape {
  std::size_t joints, base;
};
/// Fails on text that is no day of such a robot, with the key and what it must be; every number is finite and of its
/// range.
Result<WorkingDay> from_text(const std::string& text, const Shape& shape);

/// Friction as a temperature, for fit_thermal: higher where heat made friction lower (or, `rising`, higher). In Nm in
/// place of K.
identification::HeatSession as_heat(const Warming& warming, std::size_t file, bool rising);
/// Whether friction is higher at the end of the day.
bool rises(const Warming& warming);

}  // namespace tribotwin::twin::repeatability
