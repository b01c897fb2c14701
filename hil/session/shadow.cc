#include <tribotwin/hil/session/shadow.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <fstream>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/node.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/twin/model/arm.hpp>

namespace tribotwin::hil {
namespace {

/// What a listener understands of one drive.
class Listener {
 public:
  virtual ~Listener() = default;
  /// Whether the frame held a position of this drive.
  virtual bool hear(const Frame& frame) = 0;
  std::optional<double> position_rad, torque_nm;   // arm side
};

/// Follows the master's SDO writes too, so that it knows a mapping that was changed while it listened.
class CanopenListener final : public Listener {
 public:
  explicit CanopenListener(const DriveParameters& p) : gear_(p.gear_ratio), node_(p, [](const Frame&) { return Sent::done; }) { node_.start(0); }
  bool hear(const Frame& frame) override {
    if (frame.id == 0 || frame.id == 0x600U + node_.id()) node_.receive(frame, frame.time_ns);
    Dictionary& d = node_.dictionary();
    bool position = false;
    for (std::uint16_t i = 0; i < pdo_count; ++i) {
      const auto cob = d.get(static_cast<std::uint16_t>(0x1800 + i), 1);
      if (cob & 0x80000000 || (cob & 0x7ff) != frame.id || frame.extended) continue;
      std::size_t at = 0;
      const auto map = static_cast<std::uint16_t>(0x1A00 + i);
      for (std::uint8_t k = 1; k <= d.get(map, 0); ++k) {
        const auto entry = static_cast<std::uint32_t>(d.get(map, k));
        const std::size_t size = (entry & 0xff) / 8;
        if (at + size > frame.size) break;
        if (const Object* o = d.find(static_cast<std::uint16_t>(entry >> 16), static_cast<std::uint8_t>(entry >> 8))) {
          const auto value = static_cast<double>(decode(o->type, frame.bytes().subspan(at, size))) * o->scale;
          if (o->index == 0x6064) position_rad = value / gear_, position = true;
          if (o->index == 0x6077) torque_nm = value * gear_;
        }
        at += size;
      }
    }
    return position;
  }

 private:
  double gear_;
  Node node_;
};

class MirrorListener final : public Listener {
 public:
  explicit MirrorListener(const DriveParameters& p) : id_(0x180U + p.node), torque_max_nm_(p.rated_torque_nm * p.gear_ratio) {}
  bool hear(const Frame& frame) override {
    if (frame.id != id_) return false;
    const auto status = decode_status(frame);
    if (!status) return false;
    position_rad = status->position_rad;
    torque_nm = status->torque_norm * torque_max_nm_;
    return true;
  }

 private:
  std::uint32_t id_;
  double torque_max_nm_;
};

/// What the drives must do for a motion that was measured: rigid-body dynamics for the gear torques, the law for friction,
/// its heat for the temperature. Speeds and accelerations are those of a parabola through the last samples, so that what is
/// said holds for the middle one, `delay` samples ago.
class Expectation {
 public:
  static constexpr int half = 5, window = 2 * half + 1;

  Expectation(const twin::Scenario& scenario, double cycle_s) : model_(*scenario.model), data_(model_.make_data()), cycle_s_(cycle_s), drives_(model_.drives().size()) {
    for (std::size_t i = 0; i < drives_.size(); ++i) {
      const auto& thermal = model_.drives()[i].drive.thermal;
      drives_[i].decay = thermal::decay(thermal, cycle_s);
      drives_[i].rise = thermal::settled(thermal, scenario.temperature_degC[i] - thermal.T_amb_degC);
      drives_[i].ambient_offset_K = scenario.ambient_degC ? *scenario.ambient_degC - thermal.T_amb_degC : 0;
    }
  }

  /// Takes the next positions; false while there are too few for a statement.
  bool take(std::span<const double> position_rad) {
    const mjModel* m = model_.get();
    mjData* d = data_.get();
    ++samples_;
    for (std::size_t i = 0; i < drives_.size(); ++i) {
      auto& q = drives_[i].q;
      std::rotate(q.begin(), q.begin() + 1, q.end());
      q.back() = position_rad[i];
    }
    if (samples_ < window) return false;
    constexpr double n = window, s2 = 110, s4 = 1958, det = n * s4 - s2 * s2;   // sums of k^2 and k^4 over -5..5
    for (std::size_t i = 0; i < drives_.size(); ++i) {
      double sum = 0, first = 0, second = 0;
      for (int k = -half; k <= half; ++k) {
        const double q = drives_[i].q[static_cast<std::size_t>(k + half)];
        sum += q, first += k * q, second += k * k * q;
      }
      const auto& b = model_.drives()[i];
      d->qpos[twin::position_address(m, b)] = (s4 * sum - s2 * second) / det;
      d->qvel[b.dof] = first / s2 / cycle_s_;
      d->qacc[b.dof] = 2 * (n * second - s2 * sum) / det / (cycle_s_ * cycle_s_);
    }
    mj_kinematics(m, d);
    mj_comPos(m, d);
    mj_comVel(m, d);
    gear_nm_.resize(static_cast<std::size_t>(m->nv));
    mj_rne(m, d, 1, gear_nm_.data());   // without the rotors: what the gears carry
    for (std::size_t i = 0; i < drives_.size(); ++i) {
      const auto& b = model_.drives()[i];
      One& one = drives_[i];
      const double load = gear_nm_[static_cast<std::size_t>(b.dof)], speed = d->qvel[b.dof], rotor = m->dof_armature[b.dof] * d->qacc[b.dof];
      const bool slides = std::abs(speed) * b.drive.gear_ratio > standing_motor_rad_s;
      const double friction = mujoco::friction_nm(b.drive, slides ? speed : 0, load / b.drive.torque_max_nm, temperature_degC(i));
      one.low_nm = load + rotor + (slides && speed > 0 ? friction : -friction);
      one.high_nm = load + rotor + (slides && speed < 0 ? -friction : friction);
      thermal::step(b.drive.thermal, one.decay, slides ? friction * std::abs(speed) : 0, one.ambient_offset_K, one.rise);
    }
    return true;
  }
  /// The expected torque [Nm, arm side]: one value while the joint slides; while it stands, all that stiction can hold.
  double low_nm(std::size_t i) const { return drives_[i].low_nm; }
  double high_nm(std::size_t i) const { return drives_[i].high_nm; }
  double temperature_degC(std::size_t i) const { return model_.drives()[i].drive.thermal.T_amb_degC + drives_[i].rise.total_K(); }

 private:
  static constexpr double standing_motor_rad_s = 0.5;   // slower motors count as standing
  struct One {
    std::array<double, window> q{};
    thermal::Decay decay;
    thermal::Rise rise;
    double ambient_offset_K = 0, low_nm = 0, high_nm = 0;
  };
  const mujoco::Model& model_;
  mujoco::DataPtr data_;
  double cycle_s_;
  int samples_ = 0;
  std::vector<One> drives_;
  std::vector<double> gear_nm_;
};

/// By how many samples `b` follows `a`: the place of the largest cross-correlation within +-most.
int lag(const std::vector<double>& a, const std::vector<double>& b, int most) {
  const auto n = static_cast<int>(std::min(a.size(), b.size()));
  if (n < 4 * most) return 0;
  double mean_a = 0, mean_b = 0;
  for (int i = 0; i < n; ++i) mean_a += a[static_cast<std::size_t>(i)] / n, mean_b += b[static_cast<std::size_t>(i)] / n;
  int best = 0;
  double most_alike = -1;
  for (int shift = -most; shift <= most; ++shift) {
    double sum = 0;
    for (int i = most; i < n - most; ++i) sum += (a[static_cast<std::size_t>(i)] - mean_a) * (b[static_cast<std::size_t>(i + shift)] - mean_b);
    if (sum > most_alike * (1 + 1e-12)) most_alike = sum, best = shift;
  }
  return best;
}

}  // namespace

bool ShadowResult::exceeded() const { return std::ranges::any_of(joints, &ShadowJoint::exceeded); }

std::string ShadowResult::table() const {
  std::string s = fmt::format("{:.2f} s\n{:<12} {:>8} {:>14} {:>14} {:>14} {:>9} {:>12}\n", seconds, "joint", "samples", "mean [Nm]", "RMS [Nm]", "largest [Nm]", "lag [ms]", "lubricant");
  for (const auto& j : joints)
    s += fmt::format("{:<12} {:>8} {:>14.4g} {:>14.4g} {:>14.4g} {:>9.1f} {:>7.2f} degC{}\n", j.name, j.samples, j.residual_mean_nm, j.residual_rms_nm, j.residual_max_nm, 1e3 * j.lag_s, j.temperature_degC,
                     j.exceeded ? "  limit exceeded" : "");
  return s;
}

tl::expected<ShadowResult, std::string> shadow(const twin::Scenario& scenario, const NextFrame& next, const ShadowOptions& o) {
  const auto parameters = drive_parameters(scenario, o.first_node, o.cycle_us);
  std::vector<std::unique_ptr<Listener>> listeners;
  for (const auto& p : parameters) {
    if (o.profile == Profile::mirror) listeners.push_back(std::make_unique<MirrorListener>(p));
    else listeners.push_back(std::make_unique<CanopenListener>(p));
  }
  const std::size_t n = listeners.size();
  const double cycle_s = 1e-6 * o.cycle_us;
  ShadowResult result;
  for (const auto& p : parameters) result.joints.push_back({.name = p.name});
  std::vector<std::vector<double>> measured(n), predicted(n);
  std::vector<double> beyond_s(n);
  std::ofstream csv;
  if (!o.csv.empty()) {
    csv.open(o.csv);
    csv << "time_s";
    for (const auto& p : parameters) csv << fmt::format(",{0}.measured_nm,{0}.predicted_nm,{0}.residual_nm,{0}.temperature_degC", p.name);
    csv << '\n';
    if (!csv) return tl::unexpected(fmt::format("{}: cannot be written", o.csv.string()));
  }

  Expectation expectation(scenario, cycle_s);
  std::vector<double> position(n);
  std::deque<std::vector<double>> torques;   // measured, waiting for what is expected of them
  bool heard_all = false;
  bool synced = false;
  std::int64_t first_ns = -1;
  Frame frame;
  while (!(o.stop && o.stop())) {
    auto more = next(frame);
    if (!more) return tl::unexpected(more.error());
    if (!*more) break;
    if (frame.error) continue;
    if (first_ns < 0) first_ns = frame.time_ns;
    if (o.duration_s && 1e-9 * static_cast<double>(frame.time_ns - first_ns) >= *o.duration_s) break;
    const bool sync = frame.id == 0x80 && !frame.extended && frame.size <= 1;
    synced |= sync;
    bool heard_first = false;
    for (std::size_t i = 0; i < n; ++i) heard_first |= listeners[i]->hear(frame) && i == 0;
    if (!(synced ? sync : heard_first)) continue;

    // A cycle is over: what was heard in it is where the robot was at its beginning.
    if (std::ranges::any_of(listeners, [](const auto& l) { return !l->position_rad; })) continue;
    heard_all = true;
    std::vector<double> torque(n);
    for (std::size_t i = 0; i < n; ++i) position[i] = *listeners[i]->position_rad, torque[i] = listeners[i]->torque_nm.value_or(std::nan(""));
    torques.push_back(std::move(torque));
    if (!expectation.take(position)) continue;
    while (torques.size() > Expectation::half + 1) torques.pop_front();
    result.seconds += cycle_s;
    if (csv.is_open()) csv << fmt::format("{:.6f}", result.seconds);
    for (std::size_t i = 0; i < n; ++i) {
      ShadowJoint& j = result.joints[i];
      j.temperature_degC = expectation.temperature_degC(i);
      const double seen = torques.front()[i], low = expectation.low_nm(i), high = expectation.high_nm(i);
      const double expected = std::isnan(seen) ? (low + high) / 2 : std::clamp(seen, low, high), residual = seen - expected;
      if (csv.is_open()) csv << fmt::format(",{:.6g},{:.6g},{:.6g},{:.3f}", seen, expected, residual, j.temperature_degC);
      if (std::isnan(seen)) continue;
      measured[i].push_back(seen);
      predicted[i].push_back(expected);
      ++j.samples;
      j.residual_mean_nm += (residual - j.residual_mean_nm) / static_cast<double>(j.samples);
      j.residual_rms_nm += (residual * residual - j.residual_rms_nm) / static_cast<double>(j.samples);   // its square, until the end
      j.residual_max_nm = std::max(j.residual_max_nm, std::abs(residual));
      beyond_s[i] = o.limit_nm && std::abs(residual) > *o.limit_nm ? beyond_s[i] + cycle_s : 0;
      if (beyond_s[i] > o.limit_time_s && !std::exchange(j.exceeded, true) && o.note)
        o.note(fmt::format("{}: residual {:.4g} Nm beyond {:.4g} Nm for {:.3g} s, at {:.3f} s", j.name, residual, *o.limit_nm, o.limit_time_s, result.seconds));
    }
    if (csv.is_open()) csv << '\n';
  }
  if (!heard_all) {
    std::vector<std::string> silent;
    for (std::size_t i = 0; i < n; ++i)
      if (!listeners[i]->position_rad) silent.push_back(parameters[i].name);
    return tl::unexpected(fmt::format("no position was heard of {}: is --first-node right, and is a PDO with 6064h on the bus?", fmt::join(silent, ", ")));
  }
  for (std::size_t i = 0; i < n; ++i) {
    ShadowJoint& j = result.joints[i];
    j.residual_rms_nm = std::sqrt(j.residual_rms_nm);
    j.lag_s = cycle_s * lag(predicted[i], measured[i], 50);
  }
  if (csv.is_open() && !csv.flush()) return tl::unexpected(fmt::format("{}: cannot be written", o.csv.string()));
  return result;
}

}  // namespace tribotwin::hil
