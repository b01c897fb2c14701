#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <tribotwin/hil/canopen/node.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::int64_t ms = 1'000'000, never = std::numeric_limits<std::int64_t>::max();
constexpr std::uint32_t cob_off = 0x80000000, cob_extended = 0x20000000;
constexpr double standing_motor_rad_s = 0.5;  // slower than this, a motor counts as standing

enum Register : std::uint8_t { generic = 0x01, temperature = 0x08, communication = 0x10, profile = 0x20 };

bool is_mapping(std::uint16_t index) {
  return (index >= 0x1600 && index < 0x1600 + pdo_count) || (index >= 0x1A00 && index < 0x1A00 + pdo_count);
}
bool is_pdo(std::uint16_t index) {
  return (index >= 0x1400 && index < 0x1400 + pdo_count) || (index >= 0x1800 && index < 0x1800 + pdo_count);
}

}  // namespace

Node::Node(const DriveParameters& p, Send send)
    : parameters_(p), id_(p.node), send_(std::move(send)), dictionary_(p), sdo_(dictionary_) {
  increment_rad_ = 2 * std::numbers::pi / increments_per_turn / p.gear_ratio;
  milli_rpm_rad_s_ = 2e-3 * std::numbers::pi / 60 / p.gear_ratio;
  per_mille_nm_ = static_cast<double>(dictionary_.get(0x6076)) * 1e-6 * p.gear_ratio;
  const auto object = [&](std::uint16_t index) { return dictionary_.find(index, 0); };
  control_ = object(0x6040), status_ = object(0x6041), mode_ = object(0x6060), mode_shown_ = object(0x6061),
  target_position_ = object(0x607A);
  target_velocity_ = object(0x60FF), target_torque_ = object(0x6071), error_code_ = object(0x603F),
  error_register_ = object(0x1001), heartbeat_time_ = object(0x1017);
  sync_deadline_ = dictionary_.find(0x2120, 1);
  dictionary_.may_write = [this](const Object& o, std::int64_t value) { return may_write(o, value); };
  dictionary_.written = [this](const Object& o) { written(o); };
  reload();
  refresh_status();
}

// ---- The dictionary's rules.

tl::expected<int, Abort> Node::mapped_size(std::uint32_t entry, bool receive) {
  const auto index = static_cast<std::uint16_t>(entry >> 16);
  const auto sub = static_cast<std::uint8_t>(entry >> 8);
  const int bits = static_cast<int>(entry & 0xff);
  if (receive && sub == 0 && index >= 2 && index <= 7) {  // CiA 301: a gap of that data type
    constexpr int gap_bits[] = {8, 16, 32, 8, 16, 32};
    if (bits == gap_bits[index - 2]) return bits / 8;
    return tl::unexpected(Abort::not_mappable);
  }
  const Object* o = dictionary_.find(index, sub);
  if (!o) return tl::unexpected(dictionary_.has_index(index) ? Abort::no_sub_index : Abort::no_object);
  if (!o->mappable || (receive && o->access != Access::read_write) || bits != 8 * size_of(o->type))
    return tl::unexpected(Abort::not_mappable);
  return bits / 8;
}

tl::expected<void, Abort> Node::may_write(const Object& o, std::int64_t value) {
  if (o.index == 0x6060 && value != 8 && value != 9 && value != 10) return tl::unexpected(Abort::out_of_range);
  if (o.index == 0x605A && (value == 3 || value == 4)) return tl::unexpected(Abort::out_of_range);
  if (o.index == 0x1003 && value != 0) return tl::unexpected(Abort::out_of_range);
  if (is_mapping(o.index)) {
    const auto owner = static_cast<std::uint16_t>(o.index - 0x200);
    const bool receive = o.index < 0x1A00;
    if (!(dictionary_.get(owner, 1) & cob_off) && nmt_ == Nmt::operational)
      return tl::unexpected(Abort::not_now);  // only a PDO that does not exist is remapped
    if (o.sub > 0) {
      if (dictionary_.get(o.index, 0) != 0) return tl::unexpected(Abort::not_now);
      if (auto size = mapped_size(static_cast<std::uint32_t>(value), receive); value != 0 && !size)
        return tl::unexpected(size.error());
      return {};
    }
    int total = 0;
    for (std::uint8_t k = 1; k <= value; ++k) {
      auto size = mapped_size(static_cast<std::uint32_t>(dictionary_.get(o.index, k)), receive);
      if (!size) return tl::unexpected(size.error());
      total += *size;
    }
    if (total > 8) return tl::unexpected(Abort::pdo_too_long);
  }
  if (is_pdo(o.index) && o.sub == 1) {
    const auto id = static_cast<std::uint32_t>(value) & 0x1fffffff;
    if (value & cob_extended) return tl::unexpected(Abort::out_of_range);  // 11-bit identifiers only
    if (!(value & cob_off) && (id < 0x181 || id > 0x57F))
      return tl::unexpected(Abort::out_of_range);  // CiA 301: others are taken
    if (!(o.value & cob_off) && !(value & cob_off) && o.value != value) return tl::unexpected(Abort::not_now);
  }
  if (is_pdo(o.index) && o.sub == 2 && value > 240 && value < 254) return tl::unexpected(Abort::out_of_range);
  return {};
}

void Node::written(const Object& o) {
  changed_ = true;
  if (is_mapping(o.index) || is_pdo(o.index)) return reload();
  switch (o.index) {
    case 0x1003:
      for (std::uint8_t i = 1; i <= 8; ++i) dictionary_.set(0x1003, i, 0);
      return;
    case 0x1016: {
      Watched& w = watched_[static_cast<std::size_t>(o.sub - 1)];
      w = {static_cast<std::uint8_t>(o.value >> 16), (o.value & 0xffff) * ms, -1};
      if (w.node == 0) w.period_ns = 0;
      return;
    }
    case 0x6040:
      return apply_controlword();
    case 0x6060:
      return refresh_status();
    case 0x607A:
      fresh_[0] = true;
      return set_target();
    case 0x60FF:
      fresh_[1] = true;
      return;
    case 0x6071:
      fresh_[2] = true;
      return;
    default:
      return;
  }
}

void Node::load(Pdo& pdo, std::uint16_t index) {
  const bool receive = index < 0x1800;
  const auto cob = dictionary_.get(index, 1);
  const bool existed = pdo.exists;
  pdo.cob = static_cast<std::uint32_t>(cob) & 0x7ff;
  pdo.exists = !(cob & cob_off);
  pdo.type = static_cast<std::uint8_t>(dictionary_.get(index, 2));
  pdo.inhibit_ns = receive ? 0 : dictionary_.get(index, 3) * 100'000;
  pdo.timer_ns = dictionary_.get(index, 5) * ms;
  pdo.map.clear();
  pdo.sizes.clear();
  pdo.size = 0;
  const auto map = static_cast<std::uint16_t>(index + 0x200);
  for (std::uint8_t k = 1; k <= dictionary_.get(map, 0); ++k) {
    const auto entry = static_cast<std::uint32_t>(dictionary_.get(map, k));
    pdo.map.push_back(dictionary_.find(static_cast<std::uint16_t>(entry >> 16), static_cast<std::uint8_t>(entry >> 8)));
    pdo.sizes.push_back(static_cast<int>(entry & 0xff) / 8);
    pdo.size += pdo.sizes.back();
  }
  if (!existed || !pdo.exists) pdo.pending = pdo.sent_once = false, pdo.syncs = 0;
  if (!existed) pdo.last_ns = -1;
}

void Node::reload() {
  for (std::uint16_t i = 0; i < pdo_count; ++i) {
    load(receive_[i], static_cast<std::uint16_t>(0x1400 + i));
    load(transmit_[i], static_cast<std::uint16_t>(0x1800 + i));
  }
}

// ---- The bus.

bool Node::send(std::uint32_t id, std::span<const std::uint8_t> bytes) {
  return send_(classic(id, bytes)) == Sent::done;
}

std::vector<std::pair<std::string, std::uint64_t>> Node::counts() const {
  const NodeCounters& n = counters_;
  return {{"node", id_},
          {"error_code", error_code()},
          {"pdo_received", n.pdo_received},
          {"pdo_sent", n.pdo_sent},
          {"pdo_short", n.pdo_short},
          {"pdo_late", n.pdo_late},
          {"sdo_requests", n.sdo_requests},
          {"sdo_aborts", n.sdo_aborts},
          {"emergencies", n.emergencies},
          {"heartbeats_lost", n.heartbeats_lost},
          {"syncs_lost", n.syncs_lost},
          {"foreign", n.foreign}};
}

bool Node::sends(std::uint32_t id) const {
  return id == 0x700U + id_ || id == 0x580U + id_ || id == 0x80U + id_ ||
         std::ranges::any_of(transmit_, [&](const Pdo& p) { return p.exists && p.cob == id; });
}

void Node::start(std::int64_t now_ns) {
  now_ns_ = now_ns;
  nmt_ = Nmt::pre_operational;
  const std::uint8_t boot[] = {0};
  send(0x700U + id_, boot);
  heartbeat_ns_ = now_ns;
}

void Node::network(std::uint8_t command, std::int64_t now_ns) {
  const Nmt before = nmt_;
  switch (command) {
    case 0x01:
      nmt_ = Nmt::operational;
      break;
    case 0x02:
      nmt_ = Nmt::stopped;
      break;
    case 0x80:
      nmt_ = Nmt::pre_operational;
      break;
    case 0x81:
    case 0x82: {
      // Objects back to their defaults, those of communication only by 82h; the physics goes on. The brake holds from
      // here on.
      const Dictionary fresh(parameters_);
      for (const Object& o : fresh.objects())
        if ((o.access == Access::read_write || o.index == 0x1003) && (command == 0x81 || o.index < 0x2000))
          dictionary_.find(o.index, o.sub)->value = o.value;
      machine_.reset();
      sdo_.reset();
      watched_ = {};
      register_ = 0;
      error_register_->value = error_code_->value = 0;
      for (auto* pdos : {&receive_, &transmit_})
        for (Pdo& pdo : *pdos) pdo = {};
      reload();
      sync_ns_ = -1;
      start(now_ns);
      refresh_status();
      return;
    }
    default:
      return;
  }
  if (nmt_ == Nmt::operational && before != Nmt::operational) {
    sync_ns_ = -1;
    for (Pdo& pdo : receive_) pdo.last_ns = -1, pdo.pending = false;
    for (Pdo& pdo : transmit_) pdo.sent_once = false, pdo.syncs = 0, pdo.last_ns = -1;
    changed_ = true;
  }
  if (before == Nmt::operational && nmt_ != Nmt::operational) lose_commands(0x8100, now_ns);
  refresh_status();
}

void Node::receive(const Frame& frame, std::int64_t now_ns) {
  now_ns_ = now_ns;
  if (frame.extended || frame.remote || frame.error || frame.fd) return;
  const auto bytes = frame.bytes();
  if (frame.id == 0) {
    if (bytes.size() == 2 && (bytes[1] == 0 || bytes[1] == id_)) network(bytes[0], now_ns);
    return;
  }
  if (frame.id == 0x600U + id_) {
    if (nmt_ == Nmt::stopped) return;
    ++counters_.sdo_requests;
    if (auto answer = sdo_.request(bytes, now_ns)) {
      if ((*answer)[0] == 0x80) ++counters_.sdo_aborts;
      send(0x580U + id_, *answer);
    }
    refresh_status();
    return;
  }
  if (frame.id > 0x700 && frame.id < 0x780)
    for (Watched& w : watched_)
      if (w.period_ns && frame.id == 0x700U + w.node) w.last_ns = now_ns;
  if (frame.id == 0x700U + id_ || frame.id == 0x580U + id_ || frame.id == 0x80U + id_) {
    ++counters_.foreign;
    return;
  }
  if (nmt_ != Nmt::operational) return;
  for (Pdo& pdo : receive_) {
    if (!pdo.exists || pdo.cob != frame.id) continue;
    if (static_cast<int>(bytes.size()) < pdo.size) {
      ++counters_.pdo_short;
      const std::uint8_t extra[] = {static_cast<std::uint8_t>(bytes.size()), static_cast<std::uint8_t>(pdo.size)};
      forward(0x8210, extra);
      continue;
    }
    ++counters_.pdo_received;
    std::ranges::copy(bytes, pdo.data.begin());
    pdo.last_ns = now_ns;
    if (pdo.type <= 240)
      pdo.pending = true;
    else
      take(pdo, now_ns);
  }
}

void Node::take(Pdo& pdo, std::int64_t now_ns) {
  now_ns_ = now_ns;
  pdo.pending = false;
  std::size_t at = 0;
  for (std::size_t k = 0; k < pdo.map.size(); ++k) {
    const auto size = static_cast<std::size_t>(pdo.sizes[k]);
    // A value that the object does not accept stays unwritten, as it would by SDO.
    if (Object* o = pdo.map[k]) (void)dictionary_.write(o->index, o->sub, std::span(pdo.data).subspan(at, size));
    at += size;
  }
  refresh_status();
}

std::array<std::uint8_t, 8> Node::gather(const Pdo& pdo) const {
  std::array<std::uint8_t, 8> data{};
  std::size_t at = 0;
  for (std::size_t k = 0; k < pdo.map.size(); ++k) {
    encode(pdo.map[k]->value, std::span(data).subspan(at, static_cast<std::size_t>(pdo.sizes[k])));
    at += static_cast<std::size_t>(pdo.sizes[k]);
  }
  return data;
}

void Node::send_pdo(Pdo& pdo, std::int64_t now_ns) {
  pdo.data = gather(pdo);
  pdo.pending = false;
  pdo.sent_once = true;
  pdo.last_ns = now_ns;
  if (send(pdo.cob, std::span(pdo.data).first(static_cast<std::size_t>(pdo.size)))) ++counters_.pdo_sent;
}

void Node::sync(std::int64_t now_ns) {
  now_ns_ = now_ns;
  if (nmt_ != Nmt::operational) return;
  sync_ns_ = now_ns;
  for (Pdo& pdo : transmit_) {
    if (!pdo.exists || pdo.type > 240) continue;
    if (pdo.type == 0) {
      if (!pdo.sent_once || gather(pdo) != pdo.data) send_pdo(pdo, now_ns);
    } else if (++pdo.syncs >= pdo.type) {
      pdo.syncs = 0;
      send_pdo(pdo, now_ns);
    }
  }
  for (Pdo& pdo : receive_)
    if (pdo.pending) take(pdo, now_ns);
}

bool Node::rests(const Pdo& pdo, std::int64_t now_ns) {
  return pdo.exists && pdo.type >= 254 && pdo.sent_once && now_ns - pdo.last_ns < pdo.inhibit_ns;
}

void Node::tick(std::int64_t now_ns) {
  now_ns_ = now_ns;
  if (auto answer = sdo_.tick(now_ns)) send(0x580U + id_, *answer);
  if (const std::int64_t period = heartbeat_time_->value * ms; period > 0 && now_ns - heartbeat_ns_ >= period) {
    heartbeat_ns_ = now_ns - heartbeat_ns_ > 2 * period ? now_ns : heartbeat_ns_ + period;
    const std::uint8_t beat[] = {static_cast<std::uint8_t>(nmt_)};
    send(0x700U + id_, beat);
  }
  for (Watched& w : watched_)
    if (w.period_ns && w.last_ns >= 0 && now_ns - w.last_ns > w.period_ns) {
      w.last_ns = -1;  // watched again from its next beat on
      ++counters_.heartbeats_lost;
      lose_commands(0x8130, now_ns);
      const auto reaction = dictionary_.get(0x1029, 1);
      if (reaction == 0 && nmt_ == Nmt::operational) nmt_ = Nmt::pre_operational;
      if (reaction == 2) nmt_ = Nmt::stopped;
      refresh_status();
    }
  if (nmt_ != Nmt::operational) return;
  for (Pdo& pdo : receive_)
    if (pdo.exists && pdo.timer_ns && pdo.last_ns >= 0 && now_ns - pdo.last_ns > pdo.timer_ns) {
      pdo.last_ns = -1;
      ++counters_.pdo_late;
      lose_commands(0x8250, now_ns);
    }
  if (sync_ns_ >= 0 && now_ns - sync_ns_ > sync_deadline_->value * ms) {
    sync_ns_ = -1;
    // Only a drive that gets its set points by SYNC misses it.
    if (machine_.powered() && std::ranges::any_of(receive_, [](const Pdo& p) { return p.exists && p.type <= 240; })) {
      ++counters_.syncs_lost;
      lose_commands(0x8700, now_ns);
    }
  }
  for (Pdo& pdo : transmit_) {
    if (!pdo.exists || pdo.type < 254) continue;
    const bool due = pdo.timer_ns && pdo.sent_once && now_ns - pdo.last_ns >= pdo.timer_ns;
    if (!rests(pdo, now_ns) && (due || !pdo.sent_once || ((changed_ || held_back_) && gather(pdo) != pdo.data)))
      send_pdo(pdo, now_ns);
  }
  // What an inhibit time held back stays to be sent.
  changed_ = false;
  held_back_ = std::ranges::any_of(transmit_, [&](const Pdo& p) { return rests(p, now_ns); });
}

void Node::recovered(std::int64_t now_ns) {
  now_ns_ = now_ns;
  forward(0x8140);
}

std::int64_t Node::next_ns() const {
  std::int64_t next = never;
  const auto at = [&](std::int64_t t) { next = std::min(next, t); };
  if (const std::int64_t period = heartbeat_time_->value * ms) at(heartbeat_ns_ + period);
  for (const Watched& w : watched_)
    if (w.period_ns && w.last_ns >= 0) at(w.last_ns + w.period_ns + 1);
  if (nmt_ != Nmt::operational) return next;
  if (sync_ns_ >= 0) at(sync_ns_ + sync_deadline_->value * ms + 1);
  for (const Pdo& pdo : receive_)
    if (pdo.exists && pdo.timer_ns && pdo.last_ns >= 0) at(pdo.last_ns + pdo.timer_ns + 1);
  for (const Pdo& pdo : transmit_)
    if (pdo.exists && pdo.type >= 254 && pdo.sent_once) {
      if (pdo.timer_ns) at(pdo.last_ns + std::max(pdo.timer_ns, pdo.inhibit_ns));
      if (held_back_ && pdo.inhibit_ns) at(pdo.last_ns + pdo.inhibit_ns);
    }
  return changed_ ? now_ns_ : next;
}

void Node::emergency(std::uint16_t code, std::uint8_t register_bits, std::span<const std::uint8_t> extra) {
  if (code) ++counters_.emergencies;
  register_ = static_cast<std::uint8_t>(register_ | register_bits | (code ? generic : 0));
  error_register_->value = register_;
  std::array<std::uint8_t, 8> data{static_cast<std::uint8_t>(code), static_cast<std::uint8_t>(code >> 8), register_};
  std::copy_n(extra.begin(), std::min<std::size_t>(extra.size(), 5), data.begin() + 3);
  if (code) {
    for (std::uint8_t i = 8; i > 1; --i)
      dictionary_.set(0x1003, i, dictionary_.get(0x1003, static_cast<std::uint8_t>(i - 1)));
    dictionary_.set(0x1003, 1, code);
    dictionary_.set(0x1003, 0, std::min<std::int64_t>(8, dictionary_.get(0x1003, 0) + 1));
  }
  if (nmt_ != Nmt::stopped) send(0x80U + id_, data);
  changed_ = true;
}

void Node::forward(std::uint16_t code, std::span<const std::uint8_t> extra) {
  const std::uint8_t before = register_;
  emergency(code, communication, extra);
  register_ = before;
  error_register_->value = before;
  if (before == 0) emergency(0, 0);
}

// ---- The drive.

StopOptions Node::stop_options() const {
  return {static_cast<int>(dictionary_.get(0x605A)), static_cast<int>(dictionary_.get(0x605B)),
          static_cast<int>(dictionary_.get(0x605C)), static_cast<int>(dictionary_.get(0x605E))};
}

void Node::fail(std::uint16_t code, std::uint8_t register_bits, bool ramp, std::int64_t now_ns) {
  now_ns_ = now_ns;
  if (machine_.state() == DriveState::fault || machine_.state() == DriveState::fault_reaction_active) return;
  error_code_->value = code;
  machine_.fail(ramp);
  emergency(code, register_bits);
  refresh_status();
}

void Node::lose_commands(std::uint16_t code, std::int64_t now_ns) {
  if (!machine_.powered()) {
    if (code != 0x8100) forward(code);  // leaving operational without power is no error
    return;
  }
  const auto option = dictionary_.get(0x6007);
  const StopOptions o = stop_options();
  fail(code, communication, option == 1 ? o.fault_reaction != 0 : option == 3 && o.quick_stop != 0, now_ns);
}

void Node::apply_controlword() {
  const DriveState before = machine_.state();
  machine_.controlword(static_cast<std::uint16_t>(control_->value), stop_options());
  if (before == DriveState::fault && machine_.state() != DriveState::fault) {
    register_ = 0;
    error_code_->value = 0;
    emergency(0, 0);
  }
  refresh_status();
}

void Node::set_target() {
  if (!machine_.follows() || mode_shown_->value != 8) return;
  const auto target = std::clamp(target_position_->value, dictionary_.get(0x607D, 1), dictionary_.get(0x607D, 2));
  const double fastest = static_cast<double>(dictionary_.get(0x6080)) * 1e3 * milli_rpm_rad_s_;
  demand_left_s_ =
      static_cast<double>(dictionary_.get(0x60C2, 1)) * std::pow(10.0, static_cast<double>(dictionary_.get(0x60C2, 2)));
  demand_step_rad_s_ = std::clamp((joint_rad(target) - demand_rad_) / demand_left_s_, -fastest, fastest);
}

void Node::refresh_status() {
  const bool follows = machine_.follows();
  if ((follows && !follows_before_) || (follows && mode_shown_->value != mode_->value)) {
    // Taken up, or a new mode: what was not written for it begins at what the drive does now, so that nothing jumps.
    mode_shown_->value = mode_->value;
    demand_rad_ = feedback_.position_rad;
    demand_step_rad_s_ = demand_left_s_ = 0;
    if (!follows_before_) fresh_ = {};  // targets of another time
    if (!fresh_[0])
      target_position_->value = saturated(Type::i32, std::llround(feedback_.position_rad / increment_rad_));
    if (!fresh_[1])
      target_velocity_->value =
          follows_before_ ? saturated(Type::i32, std::llround(feedback_.velocity_rad_s / milli_rpm_rad_s_)) : 0;
    if (!fresh_[2]) target_torque_->value = saturated(Type::i16, std::llround(feedback_.torque_nm / per_mille_nm_));
    fresh_ = {};
    following_s_ = 0;
  }
  if (!follows) mode_shown_->value = mode_->value;
  if (machine_.ramping() && ramp_rad_s_ == 0) ramp_rad_s_ = feedback_.velocity_rad_s;
  follows_before_ = follows;

  std::int64_t word = machine_.status_bits() | 0x10;
  const double limit = 0.1 * static_cast<double>(dictionary_.get(0x2111, 1));
  if (feedback_.temperature_degC > limit - 10) word |= 0x80;
  if (nmt_ == Nmt::operational) word |= 0x200;
  if (feedback_.limited) word |= 0x800;
  if (follows) word |= 0x1000;
  if (follows && mode_shown_->value == 8 && following_s_ > 0) word |= 0x2000;
  if (status_->value != word) changed_ = true;
  status_->value = word;
}

std::optional<double> Node::measured_temperature_degC() const {
  const auto value = dictionary_.get(0x2110, 1);
  if (value == -32768) return std::nullopt;
  return 0.1 * static_cast<double>(value);
}

twin::DriveCommand Node::command(double dt) {
  using Mode = twin::DriveCommand::Mode;
  twin::DriveCommand c;
  c.torque_limit_nm = static_cast<double>(dictionary_.get(0x6072)) * per_mille_nm_;
  if (!machine_.powered()) return c;
  const double velocity_offset = static_cast<double>(dictionary_.get(0x60B1)) * milli_rpm_rad_s_,
               torque_offset = static_cast<double>(dictionary_.get(0x60B2)) * per_mille_nm_;
  const double fastest = static_cast<double>(dictionary_.get(0x6080)) * 1e3 * milli_rpm_rad_s_;
  if (!machine_.follows()) {
    // A ramp down to standstill, then held there.
    c.mode = Mode::velocity;
    const double step = static_cast<double>(dictionary_.get(0x6085)) * milli_rpm_rad_s_ * dt;
    ramp_rad_s_ = std::abs(ramp_rad_s_) <= step ? 0 : ramp_rad_s_ - std::copysign(step, ramp_rad_s_);
    c.velocity_rad_s = ramp_rad_s_;
    demand_rad_ = feedback_.position_rad;
    return c;
  }
  ramp_rad_s_ = 0;
  switch (mode_shown_->value) {
    case 8: {
      c.mode = Mode::position;
      const double step = std::min(dt, demand_left_s_);
      demand_rad_ += demand_step_rad_s_ * step;
      c.velocity_rad_s = (demand_left_s_ > 0 ? demand_step_rad_s_ : 0) + velocity_offset;
      demand_left_s_ = std::max(0.0, demand_left_s_ - dt);
      c.position_rad = demand_rad_;
      c.torque_nm = torque_offset;
      break;
    }
    case 9: {
      c.mode = Mode::velocity;
      double speed = std::clamp(static_cast<double>(target_velocity_->value) * milli_rpm_rad_s_ + velocity_offset,
                                -fastest, fastest);
      const double low = joint_rad(dictionary_.get(0x607D, 1)), high = joint_rad(dictionary_.get(0x607D, 2));
      if ((feedback_.position_rad >= high && speed > 0) || (feedback_.position_rad <= low && speed < 0)) speed = 0;
      c.velocity_rad_s = speed;
      c.torque_nm = torque_offset;
      break;
    }
    default:
      c.mode = Mode::torque;
      c.torque_nm = static_cast<double>(target_torque_->value) * per_mille_nm_ + torque_offset;
  }
  return c;
}

void Node::feedback(const Feedback& f, double dt) {
  feedback_ = f;
  const auto set = [&](std::uint16_t index, std::uint8_t sub, double counts) {
    Object* o = dictionary_.find(index, sub);
    const std::int64_t value = saturated(o->type, std::llround(counts));
    if (value != o->value) o->value = value, changed_ = true;
  };
  set(0x6064, 0, f.position_rad / increment_rad_);
  set(0x606C, 0, f.velocity_rad_s / milli_rpm_rad_s_);
  set(0x6077, 0, f.torque_nm / per_mille_nm_);
  set(0x6062, 0, demand_rad_ / increment_rad_);
  set(0x2100, 1, 10 * f.temperature_degC);
  set(0x2101, 1, 1e3 * f.friction_nm);
  set(0x2102, 1, 1e3 * f.load_nm);
  const bool position = machine_.follows() && mode_shown_->value == 8;
  const double lag = position ? demand_rad_ - f.position_rad : 0;
  set(0x60F4, 0, lag / increment_rad_);
  set(0x6074, 0, f.torque_nm / per_mille_nm_);
  if (position) {
    const auto window = dictionary_.get(0x6065);
    const bool outside = window != 0xffffffffLL && std::abs(lag) > joint_rad(window);
    following_s_ = outside ? following_s_ + dt : 0;
    if (following_s_ > 1e-3 * static_cast<double>(dictionary_.get(0x6066)))
      fail(0x8611, profile, stop_options().fault_reaction != 0, now_ns_);
  }
  if (machine_.ramping()) {
    standing_s_ = ramp_rad_s_ == 0 && std::abs(f.velocity_rad_s) * parameters_.gear_ratio < standing_motor_rad_s
                      ? standing_s_ + dt
                      : 0;
    if (standing_s_ > 0.02) {
      machine_.stopped();
      standing_s_ = 0;
    }
  }
  if (f.temperature_degC > 0.1 * static_cast<double>(dictionary_.get(0x2111, 1)))
    fail(0x4310, temperature, stop_options().fault_reaction != 0, now_ns_);
  refresh_status();
}

}  // namespace tribotwin::hil
