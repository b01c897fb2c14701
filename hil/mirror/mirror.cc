#include <algorithm>
#include <cmath>

#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/motion/standstill.hpp>

namespace tribotwin::hil {
namespace {

constexpr double deceleration_s = 0.25;  ///< from the maximum speed to rest
constexpr double resting_torque_norm = 5e-4;

}  // namespace

MirrorDrive::MirrorDrive(const DriveParameters& p, Send send, MirrorFormat format)
    : parameters_(p),
      send_(std::move(send)),
      format_(format),
      torque_max_nm_(p.rated_torque_nm * p.gear_ratio),
      speed_max_rad_s_(p.speed_max_rad_s / p.gear_ratio),
      cycle_ns_(1000LL * p.cycle_us),
      deadline_ns_(patience_ns(p.cycle_us)) {}

void MirrorDrive::start(std::int64_t now_ns) { send_status(now_ns); }

bool MirrorDrive::sends(std::uint32_t id) const { return id == mirror_status_id(parameters_.node); }

bool MirrorDrive::takes(const Frame& frame) const {
  return frame.id == mirror_command_id(parameters_.node) && !frame.extended &&
         frame.fd == (format_ == MirrorFormat::fd);
}

void MirrorDrive::receive(const Frame& frame, std::int64_t now_ns) {
  if (!takes(frame)) return;
  const auto c = decode_command(frame);
  if (!c) {
    ++counters_.damaged;
    return;
  }
  if (last_) {
    const int ahead = (c->counter - last_->counter) & 15;
    if (ahead == 0) {  // a repeated frame does not reset the deadline
      ++counters_.repeated;
      return;
    }
    counters_.lost += static_cast<std::uint64_t>(ahead - 1);
  }
  ++counters_.received;
  last_ = c;
  commanded_ns_ = now_ns;
  if (state_ == MirrorMode::fault) {
    if (c->mode == MirrorMode::clear_fault) state_ = MirrorMode::off;
    return;
  }
  if (state_ == MirrorMode::stopping || c->mode == MirrorMode::clear_fault) return;
  if (c->mode == MirrorMode::off && enabled()) {
    state_ = MirrorMode::stopping;
    fault_next_ = false;
    ramp_rad_s_ = feedback_.velocity_rad_s;
    return;
  }
  if (c->mode == MirrorMode::position) {
    if (state_ != MirrorMode::position) demand_rad_ = feedback_.position_rad;
    const double target = parameters_.limited
                              ? std::clamp(c->set_point, parameters_.position_low_rad, parameters_.position_high_rad)
                              : c->set_point;
    left_s_ = 1e-9 * static_cast<double>(cycle_ns_);
    step_rad_s_ = std::clamp((target - demand_rad_) / left_s_, -speed_max_rad_s_, speed_max_rad_s_);
  }
  if (c->mode == MirrorMode::torque && state_ != MirrorMode::torque)
    torque_ = {.speed_rad_s = feedback_.velocity_rad_s};
  state_ = c->mode;
}

void MirrorDrive::send_status(std::int64_t now_ns) {
  sent_ns_ = now_ns;
  const double torque_nm = brake_engaged() ? feedback_.torque_nm : mean_torque_nm_.value();
  const Frame frame = encode(MirrorStatus{counter_++, state_, feedback_.position_rad, torque_nm / torque_max_nm_,
                                          feedback_.temperature_degC, feedback_.velocity_rad_s},
                             parameters_.node, format_);
  if (send_(frame) == Sent::done) ++counters_.sent;
}

void MirrorDrive::sync(std::int64_t now_ns) {
  synced_ns_ = now_ns;
  send_status(now_ns);
  mean_torque_nm_.sync();
}

void MirrorDrive::tick(std::int64_t now_ns) {
  if (enabled() && now_ns - commanded_ns_ > deadline_ns_) {
    ++counters_.late;
    state_ = MirrorMode::stopping;
    fault_next_ = stops_alone_ = true;
    ramp_rad_s_ = feedback_.velocity_rad_s;
  }
  const bool synced = synced_ns_ >= 0 && now_ns - synced_ns_ < 10 * cycle_ns_;
  if (!synced && now_ns - sent_ns_ >= cycle_ns_) {
    const std::int64_t due = sent_ns_ + cycle_ns_;
    send_status(now_ns);
    if (now_ns - due < cycle_ns_) sent_ns_ = due;  // the rate does not drift
  }
}

std::int64_t MirrorDrive::next_ns() const {
  return std::min(sent_ns_ + cycle_ns_,
                  enabled() ? commanded_ns_ + deadline_ns_ + 1 : std::numeric_limits<std::int64_t>::max());
}

twin::DriveCommand MirrorDrive::command(double dt) {
  using Mode = twin::DriveCommand::Mode;
  twin::DriveCommand c;
  switch (state_) {
    case MirrorMode::torque:
      c = torque_.command(last_->set_point, speed_max_rad_s_, feedback_);
      break;
    case MirrorMode::velocity:
      c.mode = Mode::velocity;
      c.velocity_rad_s = std::clamp(last_->set_point, -speed_max_rad_s_, speed_max_rad_s_);
      c.torque_nm = last_->feed_forward_nm;
      break;
    case MirrorMode::position:
      c.mode = Mode::position;
      demand_rad_ += step_rad_s_ * std::min(dt, left_s_);
      c.velocity_rad_s = left_s_ > 0 ? step_rad_s_ : 0;
      left_s_ = std::max(0.0, left_s_ - dt);
      c.position_rad = demand_rad_;
      c.torque_nm = last_->feed_forward_nm;
      break;
    case MirrorMode::stopping: {
      c.mode = Mode::velocity;
      const double step = speed_max_rad_s_ / deceleration_s * dt;
      ramp_rad_s_ = std::abs(ramp_rad_s_) <= step ? 0 : ramp_rad_s_ - std::copysign(step, ramp_rad_s_);
      c.velocity_rad_s = ramp_rad_s_;
      break;
    }
    default:
      break;
  }
  c.torque_limit_nm = torque_max_nm_;
  return c;
}

void MirrorDrive::feedback(const Feedback& f, double dt) {
  feedback_ = f;
  mean_torque_nm_.add(f.torque_nm, dt);
  const bool stands = hil::stands(f.velocity_rad_s, parameters_.gear_ratio);
  if (f.safe_torque_off && !brake_engaged()) state_ = MirrorMode::fault;
  if (brake_engaged() && stands && std::abs(f.torque_nm) < resting_torque_norm * torque_max_nm_) stops_alone_ = false;
  if (state_ != MirrorMode::stopping) return;
  standing_s_ = stands && ramp_rad_s_ == 0 ? standing_s_ + dt : 0;
  if (standing_s_ > 0.02) {
    state_ = fault_next_ ? MirrorMode::fault : MirrorMode::off;
    standing_s_ = 0;
  }
}

std::string MirrorDrive::state_name() const {
  switch (state_) {
    case MirrorMode::off:
      return "off";
    case MirrorMode::torque:
      return "torque";
    case MirrorMode::position:
      return "position";
    case MirrorMode::velocity:
      return "velocity";
    case MirrorMode::stopping:
      return "stopping";
    default:
      return "fault";
  }
}

std::vector<std::pair<std::string, std::uint64_t>> MirrorDrive::counts() const {
  return {{"node", parameters_.node}, {"received", counters_.received}, {"repeated", counters_.repeated},
          {"lost", counters_.lost},   {"damaged", counters_.damaged},   {"late", counters_.late},
          {"sent", counters_.sent}};
}

}  // namespace tribotwin::hil
