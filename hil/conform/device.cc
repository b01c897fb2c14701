#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/device.hpp>

namespace tribotwin::hil {
namespace {

using S = DriveState;

constexpr std::uint32_t no_object = 0x06020000, no_sub_index = 0x06090011, no_data = 0x08000024;

Bytes little_endian(std::int64_t value, std::size_t size) {
  Bytes bytes(size);
  encode(value, bytes);
  return bytes;
}

/// The controlword of the next state on the way to operation enabled.
std::uint16_t next_word(S now) {
  switch (now) {
    case S::switch_on_disabled:
      return 0x06;
    case S::ready_to_switch_on:
      return 0x07;
    case S::switched_on:
      return 0x0F;
    default:
      return 0x00;
  }
}

}  // namespace

void expect(bool holds, std::string expected, std::string seen) {
  if (!holds) throw Mismatch{std::move(expected), std::move(seen)};
}

std::string hex(std::uint64_t value, int digits) { return fmt::format("{:0{}X}h", value, digits); }

std::optional<DriveState> state_of(std::uint16_t word) {
  if ((word & 0x4F) == 0x40) return S::switch_on_disabled;
  if ((word & 0x6F) == 0x21) return S::ready_to_switch_on;
  if ((word & 0x6F) == 0x23) return S::switched_on;
  if ((word & 0x6F) == 0x27) return S::operation_enabled;
  if ((word & 0x6F) == 0x07) return S::quick_stop_active;
  if ((word & 0x4F) == 0x0F) return S::fault_reaction_active;
  if ((word & 0x4F) == 0x08) return S::fault;
  return std::nullopt;
}

// ---- Objects.

bool Device::has(std::uint16_t index, std::uint8_t sub) {
  const std::uint32_t key = static_cast<std::uint32_t>(index) << 8 | sub;
  if (const auto at = known_.find(key); at != known_.end()) return at->second;
  const auto value = bus.upload(index, sub);
  const bool missing = !value && value.error().kind == SdoFailure::Kind::aborted &&
                       (value.error().code == no_object || value.error().code == no_sub_index);
  if (!value && value.error().kind == SdoFailure::Kind::no_answer) return false;  // asked again the next time
  return known_[key] = !missing;
}

Bytes Device::bytes(std::uint16_t index, std::uint8_t sub) {
  auto value = bus.upload(index, sub);
  if (!value) throw Mismatch{object_name(index, sub) + " can be read", value.error().text()};
  return *std::move(value);
}

std::int64_t Device::get(std::uint16_t index, std::uint8_t sub) {
  const Bytes b = bytes(index, sub);
  expect(!b.empty() && b.size() <= 8, object_name(index, sub) + " is a number", fmt::format("{} bytes", b.size()));
  return decode(Type::u32, b);
}

std::int64_t Device::get_signed(std::uint16_t index, std::uint8_t sub) {
  const Bytes b = bytes(index, sub);
  expect(!b.empty() && b.size() <= 8, object_name(index, sub) + " is a number", fmt::format("{} bytes", b.size()));
  return decode(Type::i32, b);
}

std::size_t Device::size_of(std::uint16_t index, std::uint8_t sub) {
  if (index == od::controlword) return 2;  // a device may keep it write-only
  auto& size = sizes_[static_cast<std::uint32_t>(index) << 8 | sub];
  if (size == 0) size = bytes(index, sub).size();
  return size;
}

void Device::put(std::uint16_t index, std::uint8_t sub, std::int64_t value) {
  const auto written = bus.download(index, sub, little_endian(value, size_of(index, sub)));
  if (!written) throw Mismatch{fmt::format("{} accepts {}", object_name(index, sub), value), written.error().text()};
}

void Device::keep(std::uint16_t index, std::uint8_t sub) { changes_.push_back({index, sub, bytes(index, sub)}); }

void Device::set(std::uint16_t index, std::uint8_t sub, std::int64_t value) {
  if (const auto code = refusal(index, sub, value))
    throw Mismatch{fmt::format("{} accepts {}", object_name(index, sub), value), fmt::format("abort {:08X}h", *code)};
}

/// The old value is noted before the write, whose answer an interrupt may cut off.
std::optional<std::uint32_t> Device::refusal(std::uint16_t index, std::uint8_t sub, std::int64_t value,
                                             std::size_t size) {
  const auto before = bus.upload(index, sub);
  if (size == 0) size = before ? before->size() : 4;
  if (before) changes_.push_back({index, sub, *before});
  const auto written = bus.download(index, sub, little_endian(value, size));
  if (written) return std::nullopt;
  if (written.error().kind != SdoFailure::Kind::aborted)
    throw Mismatch{fmt::format("a write to {} is answered", object_name(index, sub)), written.error().text()};
  if (before) changes_.pop_back();
  return written.error().code;
}

std::string Device::expect_refused(std::uint16_t index, std::uint8_t sub, std::int64_t value,
                                   std::vector<std::uint32_t> codes, std::size_t size) {
  std::vector<std::string> names;
  for (const auto code : codes) names.push_back(hex(code, 8));
  const auto code = refusal(index, sub, value, size);
  const std::string name = object_name(index, sub);
  const std::string expected =
      codes.empty() ? fmt::format("writing {} to {} is refused", value, name)
                    : fmt::format("writing {} to {} ends with abort {}", value, name, fmt::join(names, " or "));
  if (!code) throw Mismatch{expected, "accepted"};
  const std::string seen = fmt::format("abort {:08X}h", *code);
  expect(codes.empty() || std::ranges::find(codes, *code) != codes.end(), expected, seen);
  return seen;
}

std::vector<std::string> Device::restore() {
  std::vector<std::string> failures;
  for (; !changes_.empty(); changes_.pop_back()) {
    const Change& c = changes_.back();
    if (const auto written = bus.download(c.index, c.sub, c.before); !written)
      failures.push_back(fmt::format("{} ({})", object_name(c.index, c.sub), written.error().text()));
  }
  return failures;
}

void Device::needs(std::uint16_t index, std::uint8_t sub) {
  if (!has(index, sub)) throw NotApplicable{"there is no object " + object_name(index, sub)};
}

// ---- NMT.

/// A state change by NMT is unconfirmed: the node gets some time.
void Device::command(NmtCommand command) {
  bus.nmt(command);
  bus.listen(20 * ms_ns);
}

void Device::reset(NmtCommand command) {
  bus.forget();
  bus.nmt(command);
  const auto booted = [&] {
    return std::ranges::any_of(bus.heard(cob::heartbeat + node()),
                               [](const HeardFrame& h) { return h.frame.size == 1 && h.frame.data[0] == 0; });
  };
  expect(bus.until(booted, options.boot_ns),
         fmt::format("boot-up message {}#00 within {} ms of NMT {}", hex(cob::heartbeat + node(), 3),
                     options.boot_ns / ms_ns, hex(static_cast<std::uint8_t>(command), 2)),
         "none");
  // Some devices need a moment more for their SDO server.
  const std::int64_t end_ns = bus.now_ns() + options.boot_ns;
  while (!bus.upload(od::device_type, 0) && bus.now_ns() < end_ns) bus.listen(20 * ms_ns);
}

void Device::hear_heartbeat() {
  needs(od::producer_heartbeat_time);
  set(od::producer_heartbeat_time, 0, 50);
}

std::uint8_t Device::nmt_state() {
  const std::uint32_t id = cob::heartbeat + node();
  bus.forget();
  expect(bus.until([&] { return !bus.heard(id).empty(); }, 500 * ms_ns), "a heartbeat every 50 ms", "none in 500 ms");
  return bus.heard(id).front().frame.data[0];
}

// ---- Drive.

std::optional<DriveState> Device::state() { return state_of(status()); }

void Device::expect_state(DriveState wanted, std::int64_t within_ns) {
  std::uint16_t word = 0;
  const std::int64_t end_ns = bus.now_ns() + within_ns;
  while (true) {
    word = status();
    if (state_of(word) == wanted) return;
    if (bus.now_ns() >= end_ns) break;
    bus.listen(5 * ms_ns);
  }
  const auto seen = state_of(word);
  throw Mismatch{fmt::format("state {}", name_of(wanted)),
                 fmt::format("statusword {}, {}", hex(word, 4), seen ? name_of(*seen) : "no state")};
}

/// Down by disable voltage, then up one state at a time: never through a state above the one that is wanted.
void Device::bring_to(S wanted) {
  for (int step = 0; step < 12; ++step) {
    const auto now = state();
    if (now == wanted) return;
    if (now == S::fault) {
      control(0x00);
      control(0x80);
      control(0x00);
    } else if (now && *now != S::fault_reaction_active) {
      const bool quick_stop = wanted == S::quick_stop_active && now == S::operation_enabled;
      control(quick_stop ? 0x02 : *now < wanted ? next_word(*now) : 0x00);
    }
    bus.until([&] { return state() != now; }, 500 * ms_ns);
  }
  expect_state(wanted);
}

bool Device::make_safe() {
  const auto unpowered = [&] {
    const auto word = bus.upload(od::statusword, 0);
    if (!word || word->size() != 2) return false;
    const auto now = state_of(static_cast<std::uint16_t>(decode(Type::u16, *word)));
    if (now == S::switch_on_disabled) return true;
    // The fault reset is an edge.
    for (const std::int64_t w : {now == S::fault ? 0x80 : 0x00, 0x00})
      bus.download(od::controlword, 0, little_endian(w, 2));
    return false;
  };
  return bus.until(unpowered, 3000 * ms_ns);
}

void Device::set_mode(int mode) {
  set(od::modes_of_operation, 0, mode);
  const auto shown = [&] { return get_signed(od::modes_of_operation_display) == mode; };
  expect(bus.until(shown, 500 * ms_ns), fmt::format("6061h follows 6060h to {}", mode),
         fmt::format("6061h = {}", get_signed(od::modes_of_operation_display)));
}

// ---- Motion.

void Device::start_cycle() {
  if (has(od::communication_cycle_period)) refusal(od::communication_cycle_period, 0, cycle_ns / 1000);
  if (has(od::interpolation_time_period, 1)) {
    refusal(od::interpolation_time_period, 2, -3);
    refusal(od::interpolation_time_period, 1, cycle_ns / ms_ns);
  }
  bus.cycle(cycle_ns);
}

void Device::enable_in(int mode) {
  start_cycle();
  operational();
  bring_to(S::switch_on_disabled);
  set_mode(mode);
  if (has(od::target_velocity)) refusal(od::target_velocity, 0, 0);
  if (has(od::target_torque)) refusal(od::target_torque, 0, 0);
  if (has(od::target_position)) refusal(od::target_position, 0, get_signed(od::position_actual_value));
  bring_to(S::operation_enabled);
}

std::int64_t Device::amplitude() {
  if (options.amplitude) return *options.amplitude;
  if (!has(od::position_encoder_resolution, 1) || !has(od::position_encoder_resolution, 2))
    throw NotApplicable{"608Fh does not tell the counts of a turn; give --amplitude"};
  const auto turns = std::max<std::int64_t>(1, get(od::position_encoder_resolution, 2));
  const double counts = static_cast<double>(get(od::position_encoder_resolution, 1)) / static_cast<double>(turns);
  return std::max<std::int64_t>(1, std::llround(default_turns * counts));
}

/// 60A9h: the upper byte is the exponent of ten; B4h over 47h is revolutions per minute.
std::int64_t Device::speed() {
  if (options.speed) return *options.speed;
  const std::int64_t unit = has(od::si_unit_velocity) ? get(od::si_unit_velocity) : 0;
  if ((unit & 0xFFFFFF) != 0xB44700)
    throw NotApplicable{"60A9h does not say that the velocity unit is a power of ten rpm; give --speed"};
  const auto exponent = static_cast<std::int8_t>(unit >> 24);
  return std::max<std::int64_t>(1, std::llround(default_speed_rpm * std::pow(10.0, -exponent)));
}

int Device::any_mode() {
  for (const int mode : {8, 9, 10, 1, 3})
    if (supports(mode)) return mode;
  throw NotApplicable{"6502h names none of the modes CSP, CSV, CST, PP, PV"};
}

}  // namespace tribotwin::hil
