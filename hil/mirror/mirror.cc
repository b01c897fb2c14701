#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/hil/mirror/mirror.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::uint32_t command_id = 0x100, status_id = 0x180;
constexpr double position_rad = 1e-5, torque_share = 1e-3, temperature_K = 0.1, temperature_from_degC = -50,
                 deceleration_s = 0.25;

double count_of(MirrorMode mode) { return mode == MirrorMode::torque ? 1e-3 : 1e-6; }

std::uint8_t crc_of(std::uint32_t id, std::span<const std::uint8_t> bytes) {
  const std::uint8_t head[] = {static_cast<std::uint8_t>(id), static_cast<std::uint8_t>(id >> 8)};
  return static_cast<std::uint8_t>(crc8_j1850(bytes, crc8_j1850(head)) ^ 0xFF);
}

void put(std::array<std::uint8_t, 8>& data, int bit, int bits, std::int64_t value) {
  for (int i = 0; i < bits; ++i)
    if (value >> i & 1)
      data[static_cast<std::size_t>((bit + i) / 8)] =
          static_cast<std::uint8_t>(data[static_cast<std::size_t>((bit + i) / 8)] | 1 << (bit + i) % 8);
}
std::int64_t get(const Frame& frame, int bit, int bits, bool is_signed) {
  std::int64_t value = 0;
  for (int i = 0; i < bits; ++i)
    value |= static_cast<std::int64_t>(frame.data[static_cast<std::size_t>((bit + i) / 8)] >> (bit + i) % 8 & 1) << i;
  return is_signed && value >> (bits - 1) & 1 ? value - (std::int64_t{1} << bits) : value;
}
std::int64_t held(double value, int bits, bool is_signed) {
  const double high = std::pow(2.0, is_signed ? bits - 1 : bits) - 1, low = is_signed ? -high - 1 : 0;
  return std::llround(std::isfinite(value) ? std::clamp(value, low, high) : 0);
}

bool whole(const Frame& frame) {
  return !frame.extended && !frame.remote && !frame.error && !frame.fd && frame.size == 8 &&
         frame.data[7] == crc_of(frame.id, frame.bytes().first(7));
}

Frame sealed(std::uint32_t id, std::array<std::uint8_t, 8> data) {
  data[7] = crc_of(id, std::span(data).first(7));
  return classic(id, data);
}

}  // namespace

std::uint8_t crc8_j1850(std::span<const std::uint8_t> bytes, std::uint8_t crc) {
  for (const std::uint8_t byte : bytes) {
    crc = static_cast<std::uint8_t>(crc ^ byte);
    for (int i = 0; i < 8; ++i) crc = static_cast<std::uint8_t>(crc & 0x80 ? crc << 1 ^ 0x1D : crc << 1);
  }
  return crc;
}

std::uint32_t mirror_status_id(int node) { return status_id + static_cast<std::uint32_t>(node); }

Frame encode(const MirrorCommand& c, int node) {
  std::array<std::uint8_t, 8> data{};
  put(data, 0, 4, c.counter & 15);
  put(data, 4, 4, static_cast<int>(c.mode));
  put(data, 8, 32, held(c.set_point / count_of(c.mode), 32, true));
  return sealed(command_id + static_cast<std::uint32_t>(node), data);
}

Frame encode(const MirrorStatus& s, int node) {
  std::array<std::uint8_t, 8> data{};
  put(data, 0, 4, s.counter & 15);
  put(data, 4, 4, static_cast<int>(s.state));
  put(data, 8, 24, held(s.position_rad / position_rad, 24, true));
  put(data, 32, 12, held(s.torque_norm / torque_share, 12, true));
  put(data, 44, 12, held((s.temperature_degC - temperature_from_degC) / temperature_K, 12, false));
  return sealed(mirror_status_id(node), data);
}

std::optional<MirrorCommand> decode_command(const Frame& frame) {
  if (!whole(frame)) return std::nullopt;
  MirrorCommand c{static_cast<std::uint8_t>(get(frame, 0, 4, false)), static_cast<MirrorMode>(get(frame, 4, 4, false)),
                  0};
  if (c.mode != MirrorMode::off && c.mode != MirrorMode::torque && c.mode != MirrorMode::position &&
      c.mode != MirrorMode::velocity && c.mode != MirrorMode::clear_fault)
    return std::nullopt;
  c.set_point = count_of(c.mode) * static_cast<double>(get(frame, 8, 32, true));
  return c;
}

std::optional<MirrorStatus> decode_status(const Frame& frame) {
  if (!whole(frame)) return std::nullopt;
  return MirrorStatus{static_cast<std::uint8_t>(get(frame, 0, 4, false)),
                      static_cast<MirrorMode>(get(frame, 4, 4, false)),
                      position_rad * static_cast<double>(get(frame, 8, 24, true)),
                      torque_share * static_cast<double>(get(frame, 32, 12, true)),
                      temperature_from_degC + temperature_K * static_cast<double>(get(frame, 44, 12, false))};
}

MirrorDrive::MirrorDrive(const DriveParameters& p, Send send)
    : parameters_(p),
      send_(std::move(send)),
      torque_max_nm_(p.rated_torque_nm * p.gear_ratio),
      speed_max_rad_s_(p.speed_max_rad_s / p.gear_ratio),
      cycle_ns_(1000LL * p.cycle_us),
      deadline_ns_(std::max<std::int64_t>(3 * cycle_ns_, 20'000'000)) {}

void MirrorDrive::start(std::int64_t now_ns) { send_status(now_ns); }

bool MirrorDrive::sends(std::uint32_t id) const { return id == mirror_status_id(parameters_.node); }

void MirrorDrive::receive(const Frame& frame, std::int64_t now_ns) {
  if (frame.id != command_id + parameters_.node || frame.extended) return;
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
  state_ = c->mode;
}

void MirrorDrive::send_status(std::int64_t now_ns) {
  sent_ns_ = now_ns;
  const Frame frame = encode(MirrorStatus{counter_++, state_, feedback_.position_rad,
                                          feedback_.torque_nm / torque_max_nm_, feedback_.temperature_degC},
                             parameters_.node);
  if (send_(frame) == Sent::done) ++counters_.sent;
}

void MirrorDrive::sync(std::int64_t now_ns) {
  synced_ns_ = now_ns;
  send_status(now_ns);
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
  c.torque_limit_nm = torque_max_nm_;
  switch (state_) {
    case MirrorMode::torque:
      c.mode = Mode::torque;
      c.torque_nm = last_->set_point;
      break;
    case MirrorMode::velocity:
      c.mode = Mode::velocity;
      c.velocity_rad_s = std::clamp(last_->set_point, -speed_max_rad_s_, speed_max_rad_s_);
      break;
    case MirrorMode::position:
      c.mode = Mode::position;
      demand_rad_ += step_rad_s_ * std::min(dt, left_s_);
      c.velocity_rad_s = left_s_ > 0 ? step_rad_s_ : 0;
      left_s_ = std::max(0.0, left_s_ - dt);
      c.position_rad = demand_rad_;
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
  return c;
}

void MirrorDrive::feedback(const Feedback& f, double dt) {
  feedback_ = f;
  const bool stands = std::abs(f.velocity_rad_s) * parameters_.gear_ratio < 0.5;
  if (f.safe_torque_off && !brake_engaged()) state_ = MirrorMode::fault;
  if (brake_engaged() && stands && std::abs(f.torque_nm) < 0.5 * torque_share * torque_max_nm_) stops_alone_ = false;
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

std::string mirror_dbc(std::span<const DescribedMirror> drives) {
  std::string s = "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: master";
  for (const auto& d : drives) s += fmt::format(" drive{}", d.node);
  s += "\n\n";
  std::string comments, values;
  for (const auto& d : drives) {
    const auto command = command_id + static_cast<std::uint32_t>(d.node),
               status = status_id + static_cast<std::uint32_t>(d.node);
    s += fmt::format(
        "BO_ {} command{}: 8 master\n SG_ counter : 0|4@1+ (1,0) [0|15] \"\" drive{}\n SG_ mode : 4|4@1+ (1,0) [0|15] "
        "\"\" drive{}\n SG_ set_point : 8|32@1- (1,0) [0|0] \"\" drive{}\n SG_ crc : 56|8@1+ (1,0) [0|255] \"\" "
        "drive{}\n\n",
        command, d.node, d.node, d.node, d.node, d.node);
    s += fmt::format(
        "BO_ {} status{}: 8 drive{}\n SG_ counter : 0|4@1+ (1,0) [0|15] \"\" master\n SG_ state : 4|4@1+ (1,0) [0|15] "
        "\"\" master\n SG_ position : 8|24@1- ({},0) [0|0] \"rad\" master\n SG_ torque : 32|12@1- ({},0) [0|0] \"Nm\" "
        "master\n"
        " SG_ temperature : 44|12@1+ ({},{}) [0|0] \"degC\" master\n SG_ crc : 56|8@1+ (1,0) [0|255] \"\" master\n\n",
        status, d.node, d.node, position_rad, torque_share * d.torque_max_nm, temperature_K, temperature_from_degC);
    comments += fmt::format(
        "CM_ SG_ {} set_point \"torque: mNm; position: 1e-6 rad; velocity: 1e-6 rad/s; arm side\";\n", command);
    for (const auto id : {command, status})
      comments +=
          fmt::format("CM_ SG_ {} crc \"SAE J1850 over identifier (2 bytes, low first) and bytes 0 to 6\";\n", id);
    values += fmt::format(
        "VAL_ {} mode 0 \"off\" 1 \"torque\" 2 \"position\" 3 \"velocity\" 15 \"clear fault\" ;\nVAL_ {} state 0 "
        "\"off\" 1 \"torque\" 2 \"position\" 3 \"velocity\" 8 \"stopping\" 15 \"fault\" ;\n",
        command, status);
  }
  return s + comments + values;
}

}  // namespace tribotwin::hil
