#include <tribotwin/hil/session/shadow.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/node.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>

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

/// A drive that does what was measured.
class Follower final : public BusDrive {
 public:
  void aim(double position_rad, double cycle_s) {
    step_rad_s_ = (position_rad - demand_rad_) / cycle_s;
    left_s_ = cycle_s;
  }
  explicit Follower(double position_rad) : demand_rad_(position_rad) {}
  void start(std::int64_t) override {}
  void receive(const Frame&, std::int64_t) override {}
  void sync(std::int64_t) override {}
  void tick(std::int64_t) override {}
  std::int64_t next_ns() const override { return 0; }
  bool sends(std::uint32_t) const override { return false; }
  twin::DriveCommand command(double dt) override {
    demand_rad_ += step_rad_s_ * std::min(dt, left_s_);
    left_s_ -= dt;
    return {.mode = twin::DriveCommand::Mode::position, .position_rad = demand_rad_, .velocity_rad_s = step_rad_s_};
  }
  void feedback(const Feedback& f, double dt) override {
    torque_sum_ += f.torque_nm * dt;
    time_ += dt;
    temperature_degC = f.temperature_degC;
  }
  /// Mean torque since it was last asked.
  double torque_nm() {
    const double mean = time_ > 0 ? torque_sum_ / time_ : 0;
    torque_sum_ = time_ = 0;
    return mean;
  }
  bool brake_engaged() const override { return false; }
  std::string state_name() const override { return "following"; }
  bool enabled() const override { return true; }
  bool failed() const override { return false; }
  std::vector<std::pair<std::string, std::uint64_t>> counts() const override { return {}; }
  double temperature_degC = 0;

 private:
  double demand_rad_, step_rad_s_ = 0, left_s_ = 0, torque_sum_ = 0, time_ = 0;
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

tl::expected<ShadowResult, std::string> shadow(const twin::Scenario& given, const NextFrame& next, const ShadowOptions& o) {
  const auto parameters = drive_parameters(given, o.first_node, o.cycle_us);
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

  std::optional<twin::Scenario> scenario;   // the robot where it was first heard
  std::unique_ptr<Plant> plant;
  std::vector<std::unique_ptr<BusDrive>> followers;
  const auto follower = [&](std::size_t i) -> Follower& { return static_cast<Follower&>(*followers[i]); };
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
    if (!plant) {
      scenario = given;
      for (std::size_t i = 0; i < n; ++i) scenario->start_rad[i] = *listeners[i]->position_rad;
      plant = std::make_unique<Plant>(*scenario);
      for (std::size_t i = 0; i < n; ++i) followers.push_back(std::make_unique<Follower>(*listeners[i]->position_rad));
      continue;
    }
    for (std::size_t i = 0; i < n; ++i) follower(i).aim(*listeners[i]->position_rad, cycle_s);
    if (auto ok = plant->advance(followers, o.cycle_us); !ok) return tl::unexpected(ok.error());
    result.seconds += cycle_s;
    if (csv.is_open()) csv << fmt::format("{:.6f}", result.seconds);
    for (std::size_t i = 0; i < n; ++i) {
      const double expected = follower(i).torque_nm();
      ShadowJoint& j = result.joints[i];
      j.temperature_degC = follower(i).temperature_degC;
      const double seen = listeners[i]->torque_nm.value_or(std::nan("")), residual = seen - expected;
      if (csv.is_open()) csv << fmt::format(",{:.6g},{:.6g},{:.6g},{:.3f}", seen, expected, residual, j.temperature_degC);
      if (!listeners[i]->torque_nm) continue;
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
  if (!plant) {
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
