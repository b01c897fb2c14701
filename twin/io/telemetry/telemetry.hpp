#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>

/// The record of a run, telemetry.h5. At the root: time_s [s], with work cycles cycle_time_s [s], `complete` (uint8, 1
/// once the run ended by itself) and one group per joint. In a joint's group: one dataset of doubles per channel with
/// the string attributes `unit`, `description` and `time` (the time column its rows belong to). Written in HDF5's SWMR
/// mode: other programs read it while it grows (h5py: swmr=True), and a killed run loses at most what came after the
/// last flush. A full disk is detected before it damages the record. Every chunk has a checksum (Fletcher32). A joint's
/// group is its percent-encoded name: '/' is %2F, '%' is %25; the first letter of ".", "time_s", "cycle_time_s" and
/// "complete" is encoded too, and the empty name is a lone '%'. Attribute `name` has the true one. All of HDF5 in this
/// process must go through here, or through no other thread: the serial library is not thread-safe.
namespace tribotwin::twin {

struct Channel {
  std::string name, unit, description;
};

using NumericAttributes = std::vector<std::pair<std::string, double>>;

struct TelemetryOptions {
  std::vector<std::pair<std::string, std::string>> attributes;  ///< of the root: engine, seed, ...
  std::vector<std::string> joints;
  std::vector<NumericAttributes> joint_attributes;  ///< of each joint's group: gear_ratio, ...; none if empty
  std::vector<Channel> channels;                    ///< per joint and sample
  /// units[joint][channel], where a joint has others than `channels` says; none if empty
  std::vector<std::vector<std::string>> units;
  std::vector<Channel> cycle_channels;   ///< per joint and work cycle; none if empty
  double flush_interval_s = 0.5;         ///< wall clock
  std::function<double()> wall_clock_s;  ///< monotonic; the system's if empty
};

/// Different objects may be used in different threads, one object in one thread at a time.
class Telemetry {
 public:
  /// Creates `file`, which appears with its channels and no samples. Fails with a message that names it and the reason,
  /// and leaves what was there as it was. A record that is still being written is never replaced.
  static Result<Telemetry> create(const std::filesystem::path& file, TelemetryOptions options,
                                  Existing existing = Existing::refuse);
  Telemetry(Telemetry&&) noexcept;
  Telemetry& operator=(Telemetry&&) noexcept;
  ~Telemetry();  ///< without finish(): keeps what is there, marked incomplete

  /// One sample: joints x channels values, joint by joint. Allocates nothing and writes once per block and flush
  /// interval. After a failed write (full disk) every further call fails alike; what was flushed before stays readable.
  Result<void> append(double time_s, std::span<const double> values);
  Result<void> append_cycle(double time_s, std::span<const double> values);
  /// Closes the record, which is then a plain HDF5 file on disk, and marks it complete unless the run was cut short.
  Result<void> finish(bool complete = true);

 private:
  struct Impl;
  explicit Telemetry(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// A record in memory.
struct Recording {
  bool complete = false;
  std::vector<std::pair<std::string, std::string>> attributes;
  std::vector<std::string> joints;                  ///< in the order of their creation
  std::vector<NumericAttributes> joint_attributes;  ///< of each joint
  std::vector<Channel> channels, cycle_channels;
  std::vector<std::vector<std::string>> units;  ///< units[joint][channel]; those in `channels` are of the first joint
  std::vector<double> time_s, cycle_time_s;
  /// values[joint][channel][sample]
  std::vector<std::vector<std::vector<double>>> values, cycle_values;

  /// One channel of one joint; empty when there is none of that name.
  std::span<const double> channel(std::string_view joint, std::string_view name) const;
};

/// What a table calls a channel: its own name, with the unit that the joint has: "position_m" for position_rad of a
/// slide.
std::string column_name(std::string_view channel, std::string_view unit);

/// Reads a finished, unfinished or growing record; all channels are cut to the shortest. Fails where a part of it is
/// damaged: cut off, changed (checksum) or of another shape; and where it refers to other files, which are not read.
Result<Recording> read_telemetry(const std::filesystem::path& file);

struct Recovered {
  std::size_t samples, cycles;            ///< kept
  std::size_t lost_samples, lost_cycles;  ///< known to the file, but damaged
  double last_time_s;                     ///< of the samples kept
  bool was_plain;                         ///< a plain HDF5 file without damage: nothing was written
};
/// Turns RUNDIR/telemetry.h5 of a killed or damaged run into a plain file, with the attribute `recovered` = 1 and
/// `complete` as it was. A row is kept only if all of it is proven: its chunks lie within the file, have their
/// checksums, no value is infinite, and its time is later than that of the row before. The original stays as
/// telemetry.h5.original. Fails while the run is still writing and where no sample can be proven; nothing is changed
/// then.
Result<Recovered> recover(const std::filesystem::path& run_dir);

/// Writes RUNDIR/telemetry.csv and, where there are work cycles, RUNDIR/cycles.csv, or with `file` this and, for
/// NAME.csv, NAME_cycles.csv beside it: `time_s`, then `JOINT.COLUMN`
/// (column_name), numbers in their shortest exact form. Returns the files written. `progress` gets 0..1.
Result<std::vector<std::filesystem::path>> export_csv(const std::filesystem::path& run_dir, Existing existing,
                                                      const std::function<void(double)>& progress = {},
                                                      const std::filesystem::path& file = {});
/// The names of these two files.
std::array<std::filesystem::path, 2> csv_files(const std::filesystem::path& run_dir, const std::filesystem::path& file);

/// What an MCAP file holds. rosbag2 refuses a file with both.
enum class McapMessages {
  ros2,  ///< of ROS 2, as CDR
  json   ///< as the live bench sends them by Foxglove's protocol
};

/// Writes RUNDIR/telemetry.h5 as an MCAP file. For ROS 2 (rosbag2), Foxglove and Lichtblick: `/joint_states`
/// (sensor_msgs/msg/JointState) with position_rad, velocity_rad_s and torque_nm, `/dynamic_joint_states`
/// (control_msgs/msg/DynamicJointState) with all other channels, and `/cycle_states` with those of work cycles; the
/// attributes as metadata. As JSON: `/joints/NAME` with all channels, `/cycles/joints/NAME`. Times are whole
/// nanoseconds from 0 s to 2^31 s. `progress` gets 0..1.
Result<void> export_mcap(const std::filesystem::path& run_dir, const std::filesystem::path& file, Existing existing,
                         McapMessages messages, const std::function<void(double)>& progress = {});

}  // namespace tribotwin::twin
