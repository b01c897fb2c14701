#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

/// What a live bench says to its page. The schema is in twin/live/protocol/README.md.
namespace tribotwin::twin::live {

struct Joint {
  std::string name, law;
  std::optional<double> limit_degC;
  double gear_ratio = 1;                     ///< motor turns per joint turn
  std::vector<std::string> parameters = {};  ///< of its law
};

struct Column {
  std::string joint;  ///< empty: of no joint
  std::string name, unit;
};

/// The friction limit of a joint over its speed.
struct Law {
  std::string joint;
  double temperature_degC = 0, load_norm = 0;
  std::vector<double> speed_rad_s, friction_nm;  ///< motor side; arm side, against the motion
};

/// The first message.
struct Hello {
  std::string program, version, scenario;
  double step_s = 0;
  std::vector<std::string> commands;                              ///< that the page may give
  std::vector<std::string> faults = {};                           ///< kinds that `fault` takes
  std::vector<std::pair<std::string, double>> joint_faults = {};  ///< that `joint_fault` takes, and their most
  std::vector<Joint> joints;
  std::vector<Column> columns;
  /// The law of joint `joint` in this state, for who asks for it. Called on the server's thread.
  std::function<Law(std::size_t joint, const drive::Workspace& state)> law = {};
  std::string geometry = {};  ///< geometry.json; empty: there is none
  std::size_t bodies = 0;     ///< of geometry.json, and of a pose
  /// What a file of its rows says of them; without: they cannot be recorded.
  std::optional<TelemetryOptions> head = {};
};

struct DriveStatus {
  std::string joint;
  std::size_t bus = 0;
  int node = 0;
  std::string nmt, state, mode;
  std::uint16_t error_code = 0;
  std::string error_text;
  std::optional<bool> brake;
  /// Of the last step: that which the drive follows. Arm side, but the torque as motor_torque_nm: motor side.
  std::optional<double> target_rad = {}, target_rad_s = {}, target_motor_nm = {};
  std::optional<double> following_error_rad = {};  ///< of a target position
  /// Until it reaches its limit, if its loss stays as it was lately; infinite: never; without: not known.
  std::optional<double> time_to_limit_s = {};
};

/// Of times since the start [us].
struct Spread {
  double median = 0, p99 = 0, max = 0;
  /// How many are below each limit [us], and not below the one before.
  std::vector<std::pair<std::int64_t, std::uint64_t>> histogram;
};

struct BusStatus {
  std::string name;
  std::optional<double> load, bit_rate;  ///< share of 1; [bit/s]
  std::uint64_t frames_in = 0, frames_out = 0, syncs = 0, lost = 0;
  std::optional<std::uint64_t> foreign = {};  ///< frames that mean none of our drives
  std::optional<Spread> sync_period = {}, sync_to_tpdo = {};
};

/// Of a shadow: how far the measured torque is from the predicted one, arm side.
struct Residual {
  std::string joint;
  std::optional<double> residual_nm;  ///< not now: not known, or not judged
  std::optional<double> limit_nm;     ///< none asked for
  bool exceeded = false;              ///< for longer than allowed, at some time since the start
};

/// A file of rows.
struct RowFile {
  std::string name;  ///< without its folder
  std::uint64_t rows = 0, lost_rows = 0;
  double from_s = 0, to_s = 0;  ///< of its first and last row
};

struct Status {
  double simulated_s = 0, wall_s = 0;
  bool paused = false;
  bool recording = false;            ///< by the program, or for a page
  std::optional<RowFile> file = {};  ///< that is recorded for a page; the server's
  std::uint64_t lost_frames = 0;
  std::uint64_t lost_events = 0;    ///< for which the way to the server had no room
  std::vector<DriveStatus> drives;  ///< empty: they have no bus
  std::vector<BusStatus> buses;
  std::vector<Residual> residual;        ///< of a shadow
  std::vector<drive::Workspace> joints;  ///< their states, for Hello::law
};

struct Event {
  double time_s = 0;
  std::string kind;   ///< emcy, fault, change, marker, note, health
  std::string joint;  ///< empty: of no joint
  std::string text;
};

/// A command of a page, which the thread of the steps obeys.
struct Command {
  std::uint64_t viewer = 0;
  nlohmann::json id, message;
  std::string name;
};

/// What came of it.
struct Done {
  std::uint64_t viewer = 0;
  nlohmann::json id;
  bool ok = true;
  std::string text;
  std::optional<RowFile> file = {};  ///< of `record` and `export`
};

/// `session`: a random name of this start of the server.
std::string to_json(const Hello& hello, const std::string& session, bool readonly);
std::string to_json(const Status& status);
std::string to_json(const Event& event);
std::string to_json(const Law& law);
std::string to_json(const Done& done);

/// A message of a page: a command, the joint whose law it wants to see, or why it is neither.
struct Asking {
  std::optional<Command> command;
  std::optional<std::size_t> watched;
  Done refusal;
};
Asking read_message(const std::string& text, const Hello& hello, bool readonly);

}  // namespace tribotwin::twin::live
