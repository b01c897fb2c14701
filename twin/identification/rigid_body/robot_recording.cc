#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/identification/rigid_body/robot_recording.hpp>
#include <tribotwin/twin/identification/time_series.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using Problem = std::optional<std::string>;

constexpr double degrees = 180 / std::numbers::pi;
/// No joint of an arm moves faster [rad/s; m/s].
constexpr double speed_max = 60;

/// Whether a sample comes after a step across which no raw slope is taken. Filtered, joint_motion.cc crosses more.
std::vector<bool> after_gap(const std::vector<double>& time) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < time.size(); ++i) steps.push_back(time[i] - time[i - 1]);
  const double longest = gap_steps * median_of(steps);
  std::vector<bool> out{true};
  for (const double step : steps) out.push_back(step > longest);
  return out;
}

/// The 95 % quantile of the speed: the maximum depends on noise.
double speed_hardly_exceeded(const std::vector<double>& time, const VectorXd& position) {
  std::vector<double> speeds;
  const std::vector<bool> gap = after_gap(time);
  for (std::size_t i = 1; i < time.size(); ++i)
    if (!gap[i])
      speeds.push_back(std::abs(position(static_cast<Index>(i)) - position(static_cast<Index>(i) - 1)) /
                       (time[i] - time[i - 1]));
  const auto at = speeds.begin() + static_cast<std::ptrdiff_t>(speeds.size() * 95 / 100);
  std::ranges::nth_element(speeds, at);
  return *at;
}

/// Angles within one turn, as some encoders count: they jump where the joint goes on, unless its limits keep it within
/// the turn. Removes the jumps; returns how many there were.
std::size_t unwrap(const Regressor& r, Index joint, RobotRecording& rec) {
  constexpr double turn = 2 * std::numbers::pi, slack = 0.01;
  const double *range = r.model()->jnt_range + 2 * joint, room = range[1] - range[0];
  auto angle = rec.position.row(joint);
  if (r.is_slide(joint) || (r.model()->jnt_limited[joint] && room < turn + slack) ||
      angle.maxCoeff() - angle.minCoeff() > turn + slack)
    return 0;
  const std::vector<bool> gap = after_gap(rec.time_s);
  std::size_t jumps = 0;
  double turns = 0, before = angle(0);
  for (Index i = 1; i < angle.size(); ++i) {
    const double step = angle(i) - std::exchange(before, angle(i));
    if (std::abs(step) > 0.75 * turn && !gap[static_cast<std::size_t>(i)]) turns -= std::copysign(1, step), ++jumps;
    angle(i) += turns * turn;
  }
  return jumps;
}

Problem implausible_position(const Regressor& r, const RobotRecording& rec, Index joint, const std::string& column) {
  const mjModel* m = r.model();
  const VectorXd q = rec.position.row(joint);
  const double lowest = q.minCoeff(), highest = q.maxCoeff(), low = m->jnt_range[2 * joint],
               high = m->jnt_range[2 * joint + 1], slack = 0.1 * (high - low);
  if (m->jnt_limited[joint] && (lowest < low - slack || highest > high + slack)) {
    const bool fits = !r.is_slide(joint) && lowest / degrees >= low - slack && highest / degrees <= high + slack &&
                      std::max(std::abs(lowest), std::abs(highest)) > 3;
    return fmt::format(
        "{}: {} goes from {:.4g} to {:.4g}, the joint's range is {:.4g} .. {:.4g}; {}", rec.file.string(), column,
        lowest, highest, low, high,
        fits ? "are these degrees, or is it another column, the torque?" : "is it another column, such as the torque?");
  }
  const double speed = speed_hardly_exceeded(rec.time_s, q);
  if (speed > speed_max)
    return fmt::format(
        "{}: {} moves at {:.4g} {}/s, where {:g} is beyond any robot; are these degrees, or is it another column, such "
        "as the torque?",
        rec.file.string(), column, speed, r.is_slide(joint) ? "m" : "rad", speed_max);
  return {};
}

Problem implausible_velocity(const RobotRecording& rec, Index joint, const std::vector<double>& velocity,
                             const std::string& column, const std::string& position) {
  const VectorXd q = rec.position.row(joint);
  const auto ratio = velocity_over_slope(rec.time_s, {q.data(), rec.time_s.size()}, velocity);
  if (!ratio || !ratio->contradicts()) return {};
  return fmt::format("{}: {} {}", rec.file.string(), column, ratio->text(position));
}

/// The columns of all joints, and where they are in the table.
class JointColumns {
 public:
  enum Kind : std::size_t { position, torque, velocity, temperature, current, kinds };

  JointColumns(const Regressor& r, bool currents) : currents_(currents) {
    for (Index j = 0; j < r.joints(); ++j) {
      const auto& name = r.joint_name(j);
      const bool slide = r.is_slide(j);
      for (const auto& column :
           {fmt::format("position_{}_{}", name, slide ? "m" : "rad"),
            fmt::format("torque_{}_{}", name, slide ? "n" : "nm"),
            fmt::format("velocity_{}_{}_s", name, slide ? "m" : "rad"), fmt::format("temperature_{}_degC", name),
            currents ? fmt::format("current_{}_a", name) : std::string()})
        names_.push_back(column);
    }
    for (const CoupledMotor& motor : r.motors())
      names_.push_back(fmt::format("torque_{}_{}", motor.name, r.is_slide(motor.joint) ? "n" : "nm"));
  }

  const std::vector<std::string>& names() const { return names_; }
  const std::string& name(Index joint, Kind kind) const { return names_[at(joint, kind)]; }
  /// Whether a joint's torque comes from its current.
  bool of_current(const Numbers& table, Index joint) const {
    return currents_ && !has(table, name(joint, torque)) && has(table, name(joint, current));
  }
  std::vector<double>& of(Numbers& table, Index joint, Kind kind) const { return table.columns[at(joint, kind)]; }

  /// The torque of a coupled motor.
  const std::string& motor_name(const Regressor& r, Index motor) const { return names_[at(r, motor)]; }
  std::vector<double>& of_motor(Numbers& table, const Regressor& r, Index motor) const {
    return table.columns[at(r, motor)];
  }

  /// Whether torques are the motors': that of a coupled motor stands in place of its joint's.
  bool of_motors(const Numbers& table, const Regressor& r) const {
    for (Index m = 0; m < std::ssize(r.motors()); ++m)
      if (has(table, motor_name(r, m))) return true;
    return false;
  }

  /// Why the torques of coupled motors cannot be told from those of joints.
  Problem mixed(const Numbers& table, const Regressor& r) const {
    if (!of_motors(table, r)) return {};
    for (Index m = 0; m < std::ssize(r.motors()); ++m) {
      const auto &own = motor_name(r, m), &joint = name(r.motors()[static_cast<std::size_t>(m)].joint, torque);
      if (!has(table, own))
        return fmt::format(
            "{}:1: no column '{}', but that of another coupled motor; give the torques of all motors, or of all joints "
            "(torque_JOINT_nm) and of no coupled motor",
            table.file.string(), own);
      if (has(table, joint))
        return fmt::format(
            "{}:1: columns '{}' and '{}': are these the torques of motors or of joints? Leave out the first for "
            "motors, "
            "the second for joints",
            table.file.string(), joint, own);
    }
    return {};
  }

  /// Why a required column is missing.
  Problem missing(const Numbers& table, const Regressor& r) const {
    const bool motors = of_motors(table, r);
    bool any_torque = false;
    for (Index j = 0; j < r.joints(); ++j) any_torque |= has(table, name(j, torque)) || of_current(table, j);
    for (std::size_t k = 0; k < 1 + kinds * static_cast<std::size_t>(r.joints()); ++k) {
      const auto kind = (k - 1) % kinds;
      bool optional =
          k > 0 && (kind == velocity || kind == temperature || kind == current ||
                    (kind == torque && any_torque && !motors && (currents_ || table.hint(names_[k]).empty())));
      for (const CoupledMotor& motor : r.motors()) optional = optional || (motors && k == at(motor.joint, torque));
      if (optional || has(table, names_[k])) continue;
      return fmt::format(
          "{}:1: no column '{}'; {}{}the header names {}", table.file.string(), names_[k], table.hint(names_[k]),
          k ? fmt::format("every joint of the model is needed, {} too, as its motion acts on the others; ",
                          r.joint_name(static_cast<Index>((k - 1) / kinds)))
            : "",
          table.header);
    }
    return {};
  }
  static bool has(const Numbers& table, const std::string& name) { return table.has(name); }

 private:
  static std::size_t at(Index joint, Kind kind) { return 1 + kinds * static_cast<std::size_t>(joint) + kind; }
  static std::size_t at(const Regressor& r, Index motor) {
    return 1 + kinds * static_cast<std::size_t>(r.joints()) + static_cast<std::size_t>(motor);
  }
  std::vector<std::string> names_{"time_s"};
  bool currents_;
};

/// Time, and what is wrong with it.
Problem read_time(Numbers& table, RobotRecording& rec) {
  rec.time_s = std::move(table.columns[0]);
  if (rec.time_s.size() < 10)
    return fmt::format("{}: {} rows of finite numbers; at least 10 are needed", rec.file.string(), rec.time_s.size());
  if (table.left_out)
    rec.notes.push_back(fmt::format("{}: {} rows with empty, NaN or infinite cells are gaps, the first in {} {}",
                                    rec.file.string(), table.left_out, table.row, table.first_left_out));
  return not_increasing(table, rec.time_s);
}

/// Positions, torques and, where `thermal`, temperatures of a joint, and what is wrong with them.
Problem read_joint(Numbers& table, const JointColumns& columns, const Regressor& r, Index joint, bool thermal,
                   RobotRecording& rec) {
  const auto row = [&](JointColumns::Kind kind) {
    return Eigen::Map<const VectorXd>(columns.of(table, joint, kind).data(), static_cast<Index>(rec.time_s.size()));
  };
  const auto name = [&](JointColumns::Kind kind) { return columns.name(joint, kind); };
  rec.position.row(joint) = row(JointColumns::position);
  if (!columns.of(table, joint, JointColumns::torque).empty()) rec.torque.row(joint) = row(JointColumns::torque);
  if (columns.of_current(table, joint)) rec.torque.row(joint) = row(JointColumns::current);
  if (const std::size_t jumps = unwrap(r, joint, rec))
    rec.notes.push_back(fmt::format("{}: {} jumps by a turn {} times, where the joint goes on; read without the jumps",
                                    rec.file.string(), name(JointColumns::position), jumps));
  if (Problem p = implausible_position(r, rec, joint, name(JointColumns::position))) return p;
  if (const auto& velocity = columns.of(table, joint, JointColumns::velocity); !velocity.empty())
    if (Problem p =
            implausible_velocity(rec, joint, velocity, name(JointColumns::velocity), name(JointColumns::position)))
      return p;
  if (rec.velocity.size() > 0) rec.velocity.row(joint) = row(JointColumns::velocity);
  if (!thermal) return {};
  rec.temperature_degC.row(joint) = row(JointColumns::temperature);
  return implausible_temperature(rec.file, name(JointColumns::temperature),
                                 columns.of(table, joint, JointColumns::temperature));
}

/// The joints whose torque was not recorded, themselves or by their coupled motor.
void note_without_torque(const Numbers& table, const JointColumns& columns, const Regressor& r, RobotRecording& rec) {
  std::vector<std::string> without;
  const bool motors = columns.of_motors(table, r);
  for (Index j = 0; j < r.joints(); ++j) {
    const auto& name = columns.name(j, JointColumns::torque);
    const bool by_motor = motors && std::ranges::any_of(r.motors(), [&](const auto& m) { return m.joint == j; });
    rec.of_current.push_back(columns.of_current(table, j));
    rec.without_torque.push_back(!by_motor && !JointColumns::has(table, name) && !rec.of_current.back());
    if (rec.without_torque.back()) without.push_back(name);
  }
  if (!without.empty())
    rec.notes.push_back(
        fmt::format("{}: no column {}: of these joints only the motion is used", rec.file.string(), joined(without)));
}

/// Torques of joints from those of motors.
void read_motor_torques(Numbers& table, const JointColumns& columns, const Regressor& r, RobotRecording& rec) {
  for (Index m = 0; m < std::ssize(r.motors()); ++m)
    rec.torque.row(r.motors()[static_cast<std::size_t>(m)].joint) =
        Eigen::Map<const VectorXd>(columns.of_motor(table, r, m).data(), static_cast<Index>(rec.time_s.size()));
  rec.torque = r.joint_torque(rec.torque);
}

}  // namespace

Result<RobotRecording> read_robot_recording(const std::filesystem::path& file, const Regressor& r,
                                            const TableOptions& options, std::span<const double> nm_per_a) {
  const JointColumns columns(r, !nm_per_a.empty());
  auto table = read_numbers(file, columns.names(), options);
  if (!table) return tl::unexpected(table.error());
  table->file = file;
  if (const Problem p = columns.mixed(*table, r)) return tl::unexpected(*p);
  if (const Problem p = columns.missing(*table, r)) return tl::unexpected(*p);
  RobotRecording rec{.file = file};
  rec.notes = table->notes;
  if (const Problem p = read_time(*table, rec)) return tl::unexpected(*p);

  const Index n = r.joints(), samples = static_cast<Index>(rec.time_s.size());
  Index with_temperature = 0;
  for (Index j = 0; j < n; ++j)
    with_temperature += JointColumns::has(*table, columns.name(j, JointColumns::temperature));
  if (with_temperature && with_temperature < n)
    rec.notes.push_back(
        fmt::format("{}: {} of {} joints have a temperature; none is used", file.string(), with_temperature, n));
  const bool thermal = with_temperature == n;
  rec.position.resize(n, samples);
  rec.torque.setZero(n, samples);
  note_without_torque(*table, columns, r, rec);
  if (thermal) rec.temperature_degC.resize(n, samples);
  bool velocities = true;
  for (Index j = 0; j < n; ++j) velocities &= JointColumns::has(*table, columns.name(j, JointColumns::velocity));
  if (velocities) rec.velocity.resize(n, samples);
  for (Index j = 0; j < n; ++j)
    if (const Problem p = read_joint(*table, columns, r, j, thermal, rec)) return tl::unexpected(*p);
  for (Index j = 0; j < n; ++j)
    if (rec.of_current[static_cast<std::size_t>(j)]) rec.torque.row(j) *= nm_per_a[static_cast<std::size_t>(j)];
  if (columns.of_motors(*table, r)) read_motor_torques(*table, columns, r, rec);
  if ((rec.position.rowwise().maxCoeff() - rec.position.rowwise().minCoeff()).maxCoeff() < 1e-3)
    return tl::unexpected(Error(
        fmt::format("{}: the robot stands still; dynamics are identified from motion (tribotwin excite makes one)",
                    file.string())));
  return rec;
}

bool same_recording(const RobotRecording& a, const RobotRecording& b) {
  constexpr double step_share = 0.01, span_share = 1e-5;  // tables have six digits
  if (a.time_s.size() != b.time_s.size() || a.position.rows() != b.position.rows()) return false;
  const double step = (a.time_s.back() - a.time_s.front()) / static_cast<double>(a.time_s.size());
  for (std::size_t i = 0; i < a.time_s.size(); ++i)
    if (std::abs((a.time_s[i] - a.time_s.front()) - (b.time_s[i] - b.time_s.front())) > step_share * step) return false;
  const auto equal = [](const MatrixXd& x, const MatrixXd& y) {
    for (Index j = 0; j < x.rows(); ++j)
      if ((x.row(j) - y.row(j)).cwiseAbs().maxCoeff() > span_share * (x.row(j).maxCoeff() - x.row(j).minCoeff()))
        return false;
    return true;
  };
  return equal(a.position, b.position) && equal(a.torque, b.torque);
}

}  // namespace tribotwin::twin::identification
