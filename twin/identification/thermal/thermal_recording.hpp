#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>

/// Recordings of the heat in joints and of their temperature.
namespace tribotwin::twin::identification {

/// Samples without a gap that is too long to be bridged; columns of equal length.
struct HeatSession {
  std::size_t file = 0;                  ///< index of the recording it is from
  std::vector<double> time_s;            ///< strictly increasing; the middle of a cycle where there are cycles
  std::vector<double> power_w;           ///< mean since the sample before; the first is 0, or the mean since start_s
  std::vector<double> temperature_degC;  ///< empty where the recording has none
  double cycle_s = 0;                    ///< length of the working cycle; 0: no cycles
  std::vector<double> cycle_power_w;     ///< mean over the cycle around the sample; empty without cycles
  std::optional<double> start_s;         ///< start of the power, where that is before the first sample
};

struct JointHeat {
  std::string name;
  std::vector<HeatSession> sessions;
};

struct ThermalRecording {
  std::filesystem::path file;
  std::vector<JointHeat> joints;  ///< those that have a temperature, or all where none has, in the order of the header
  std::vector<std::string> notes;
};

/// Reads `time_s, temperature_JOINT_degC` and for each such joint `power_JOINT_w`, or `torque_JOINT_nm|_n` with
/// `velocity_JOINT_rad_s|_m_s` or `position_JOINT_rad|_m`. The power of torque and speed is the net work: what gravity
/// and inertia store on the way out they return on the way back, so that its average over exactly `cycle_s` (0: none)
/// is the friction heat; cycles are counted from the first sample after a gap. Samples are averaged over cycles, and
/// further until at most 5,000 are left. Across a gap (2.5 typical steps) of up to a minute the power is the mean
/// of the stretches on both sides; with `cycle_s` the same cycle is taken to have gone on for up to an hour. After a
/// longer gap a new session begins, and where such gaps outweigh the stretches between them the file is refused. Of a
/// run's record its work cycles are read, not its samples. Only with cycles may a file have no temperature. `index`:
/// HeatSession::file. ErrorKind::input with file, column and what would be right: also where a temperature is
/// implausible for a gearbox or where none changes. Where some do, the joints of the others are left out with a note.
Result<ThermalRecording> read_thermal_recording(const std::filesystem::path& file, std::size_t index,
                                                double cycle_s = 0, const TableOptions& options = {});

/// All joints of several recordings, each with the sessions of the files that have it.
struct ThermalRecordings {
  std::vector<std::string> files;
  std::vector<JointHeat> joints;
  std::vector<std::string> notes;
};
/// `cycle_s`: of no file, of all, or of each (ErrorKind::input where there is another number of them).
Result<ThermalRecordings> read_thermal_recordings(const std::vector<std::string>& files,
                                                  std::span<const double> cycle_s = {},
                                                  const TableOptions& options = {});

}  // namespace tribotwin::twin::identification
