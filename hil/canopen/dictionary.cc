#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/dictionary.hpp>

namespace tribotwin::hil {
namespace {

using T = Type;
constexpr Access ro = Access::read_only, rw = Access::read_write, constant = Access::constant;

struct Limits {
  std::int64_t low, high;
};

Limits limits_of(Type type) {
  switch (type) {
    case T::u8:
      return {0, 0xff};
    case T::u16:
      return {0, 0xffff};
    case T::u32:
      return {0, 0xffffffffLL};
    case T::i8:
      return {-0x80, 0x7f};
    case T::i16:
      return {-0x8000, 0x7fff};
    case T::i32:
      return {std::numeric_limits<std::int32_t>::min(), std::numeric_limits<std::int32_t>::max()};
    case T::text:
      break;
  }
  return {0, 0};
}

/// What most objects need not say.
struct Extra {
  std::string text{};
  double scale = 1;
  std::string unit{}, meaning{};
};
void add(std::vector<Object>& objects, Object object, Extra extra) {
  object.text = std::move(extra.text);
  object.scale = extra.scale;
  object.unit = std::move(extra.unit);
  object.meaning = std::move(extra.meaning);
  objects.push_back(std::move(object));
}

constexpr std::uint32_t off = 0x80000000;     // of a COB-ID: this service does not exist
constexpr std::uint32_t no_rtr = 0x40000000;  // remote frames are not answered

/// VISIBLE_STRING has ASCII only.
std::string visible(std::string text) {
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7e) c = '?';
  return text;
}

std::uint32_t mapping(std::uint16_t index, std::uint8_t sub, int bits) {
  return static_cast<std::uint32_t>(index) << 16 | static_cast<std::uint32_t>(sub) << 8 |
         static_cast<std::uint32_t>(bits);
}

struct DefaultPdo {
  std::uint32_t cob;
  std::uint8_t type;
  std::vector<std::uint32_t> map;
};

void add_pdos(std::vector<Object>& o, std::uint8_t node) {
  const std::uint32_t control = mapping(0x6040, 0, 16), status = mapping(0x6041, 0, 16);
  const DefaultPdo receive[pdo_count] = {{0x200U + node, 255, {control}},
                                         {0x300U + node, 255, {control, mapping(0x6060, 0, 8)}},
                                         {0x400U + node, 1, {control, mapping(0x607A, 0, 32)}},
                                         {off | (0x500U + node), 1, {control, mapping(0x60FF, 0, 32)}},
                                         {off, 1, {control, mapping(0x6071, 0, 16)}}};
  const DefaultPdo transmit[pdo_count] = {{no_rtr | (0x180U + node), 255, {status}},
                                          {no_rtr | (0x280U + node), 255, {status, mapping(0x6061, 0, 8)}},
                                          {no_rtr | (0x380U + node), 1, {status, mapping(0x6064, 0, 32)}},
                                          {off | no_rtr | (0x480U + node), 1, {status, mapping(0x606C, 0, 32)}},
                                          {off | no_rtr, 1, {status, mapping(0x6077, 0, 16)}}};
  for (int way = 0; way < 2; ++way)
    for (std::uint16_t i = 0; i < pdo_count; ++i) {
      const DefaultPdo& pdo = way ? transmit[i] : receive[i];
      const std::string name = fmt::format("{}PDO{}", way ? "T" : "R", i + 1);
      const auto at = static_cast<std::uint16_t>((way ? 0x1800 : 0x1400) + i),
                 map = static_cast<std::uint16_t>(at + 0x200);
      o.push_back({at, 0, name + " highest sub-index", T::u8, constant, false, 5});
      add(o, {at, 1, name + " COB-ID", T::u32, rw, false, pdo.cob}, {.meaning = "bit 31: the PDO does not exist"});
      add(o, {at, 2, name + " transmission type", T::u8, rw, false, pdo.type},
          {.meaning = "0: SYNC, on change; 1..240: every n-th SYNC; 254, 255: event"});
      if (way) add(o, {at, 3, name + " inhibit time", T::u16, rw, false, 0}, {.scale = 1e-4, .unit = "s"});
      add(o, {at, 5, name + (way ? " event timer" : " deadline"), T::u16, rw, false, 0},
          {.scale = 1e-3,
           .unit = "s",
           .meaning = way ? "0: none" : "0: none; without the PDO for so long: abort connection (6007h)"});
      o.push_back(
          {map, 0, name + " mapped objects", T::u8, rw, false, static_cast<std::int64_t>(pdo.map.size()), 0, 8});
      for (std::uint8_t k = 0; k < 8; ++k)
        add(o,
            {map, static_cast<std::uint8_t>(k + 1), fmt::format("{} object {}", name, k + 1), T::u32, rw, false,
             k < pdo.map.size() ? pdo.map[k] : 0},
            {.meaning = "index, sub-index, bits"});
    }
}

void add_communication(std::vector<Object>& o, const DriveParameters& p) {
  const auto node = p.node;
  add(o, {0x1000, 0, "device type", T::u32, constant, false, 0x00020192}, {.meaning = "servo drive, CiA 402"});
  o.push_back({0x1001, 0, "error register", T::u8, ro, true});
  add(o, {0x1003, 0, "number of errors", T::u8, rw, false, 0}, {.meaning = "writing 0 clears the history"});
  for (std::uint8_t i = 1; i <= 8; ++i)
    add(o, {0x1003, i, fmt::format("error {}", i), T::u32, ro}, {.meaning = "newest first"});
  o.push_back({0x1005, 0, "COB-ID SYNC", T::u32, rw, false, 0x80, 0x80, 0x80});
  add(o, {0x1006, 0, "communication cycle period", T::u32, rw, false, p.cycle_us, 0, 1000000},
      {.scale = 1e-6, .unit = "s", .meaning = "simulated time of one SYNC in lockstep"});
  add(o, {0x1008, 0, "device name", T::text, constant}, {.text = "tribotwin drive " + visible(p.name)});
  add(o, {0x1009, 0, "hardware version", T::text, constant}, {.text = "simulated"});
  add(o, {0x100A, 0, "software version", T::text, constant}, {.text = "tribotwin 0.1"});
  o.push_back({0x1014, 0, "COB-ID EMCY", T::u32, ro, false, 0x80 + node});
  o.push_back({0x1016, 0, "heartbeats watched", T::u8, constant, false, 2});
  for (std::uint8_t i = 1; i <= 2; ++i)
    add(o, {0x1016, i, fmt::format("heartbeat watched {}", i), T::u32, rw, false, 0, 0, 0x7fffff},
        {.meaning = "65536 x node + time [ms]; 0: none"});
  add(o, {0x1017, 0, "heartbeat time", T::u16, rw, false, 500}, {.scale = 1e-3, .unit = "s", .meaning = "0: none"});
  o.push_back({0x1018, 0, "highest sub-index", T::u8, constant, false, 4});
  o.push_back({0x1018, 1, "vendor", T::u32, constant});
  o.push_back({0x1018, 2, "product", T::u32, constant, false, 0x7477});
  o.push_back({0x1018, 3, "revision", T::u32, constant, false, 0x00010000});
  o.push_back({0x1018, 4, "serial number", T::u32, constant, false, node});
  o.push_back({0x1029, 0, "highest sub-index", T::u8, constant, false, 1});
  add(o, {0x1029, 1, "reaction to communication errors", T::u8, rw, false, 0, 0, 2},
      {.meaning = "0: pre-operational, 1: none, 2: stopped"});
  o.push_back({0x1200, 0, "highest sub-index", T::u8, constant, false, 2});
  o.push_back({0x1200, 1, "COB-ID SDO to the drive", T::u32, constant, false, 0x600 + node});
  o.push_back({0x1200, 2, "COB-ID SDO from the drive", T::u32, constant, false, 0x580 + node});
  add_pdos(o, node);
}

void add_drive(std::vector<Object>& o, const DriveParameters& p) {
  const double increment = 2 * std::numbers::pi / increments_per_turn,
               milli_rpm = 2e-3 * std::numbers::pi / 60;  // rad, rad/s
  const auto rated = std::max<std::int64_t>(1, std::llround(1e3 * p.rated_torque_nm));
  const double per_mille = static_cast<double>(rated) * 1e-6;  // Nm
  const auto increments = [&](double joint_rad) {
    return saturated(T::i32, std::llround(joint_rad * p.gear_ratio / increment));
  };
  const auto position = [&](std::uint16_t index, std::uint8_t sub, const char* name, Access access, bool mappable,
                            std::int64_t value, const char* meaning = "") {
    add(o, {index, sub, name, T::i32, access, mappable, value},
        {.scale = increment, .unit = "rad", .meaning = meaning});
  };
  const auto velocity = [&](std::uint16_t index, const char* name, Access access, const char* meaning = "") {
    add(o, {index, 0, name, T::i32, access, true}, {.scale = milli_rpm, .unit = "rad/s", .meaning = meaning});
  };
  const auto torque = [&](std::uint16_t index, const char* name, Type type, Access access, std::int64_t value,
                          const char* meaning = "") {
    add(o, {index, 0, name, type, access, true, value}, {.scale = per_mille, .unit = "Nm", .meaning = meaning});
  };
  add(o, {0x6007, 0, "abort connection option", T::i16, rw, false, 3, 1, 3},
      {.meaning = "lost commands: 1 fault reaction (605Eh), 2 no voltage, 3 quick stop (605Ah); then fault"});
  o.push_back({0x603F, 0, "error code", T::u16, ro, true});
  o.push_back({0x6040, 0, "controlword", T::u16, rw, true});
  o.push_back({0x6041, 0, "statusword", T::u16, ro, true, 0x50});
  add(o, {0x605A, 0, "quick stop option", T::i16, rw, false, 2, 0, 6},
      {.meaning = "0 no voltage; 1, 2 ramp, then switch on disabled; 5, 6 ramp, then hold"});
  add(o, {0x605B, 0, "shutdown option", T::i16, rw, false, 0, 0, 1}, {.meaning = "0 no voltage, 1 ramp first"});
  add(o, {0x605C, 0, "disable operation option", T::i16, rw, false, 1, 0, 1},
      {.meaning = "0 no voltage, 1 ramp first"});
  add(o, {0x605E, 0, "fault reaction option", T::i16, rw, false, 2, 0, 2},
      {.meaning = "0 no voltage; 1, 2 ramp first"});
  add(o, {0x6060, 0, "mode of operation", T::i8, rw, true, 8}, {.meaning = "8 CSP, 9 CSV, 10 CST"});
  o.push_back({0x6061, 0, "mode of operation display", T::i8, ro, true, 8});
  position(0x6062, 0, "position demand", ro, true, 0);
  position(0x6064, 0, "position actual", ro, true, 0, "motor side");
  add(o, {0x6065, 0, "following error window", T::u32, rw, false, increments(0.05)},
      {.scale = increment, .unit = "rad", .meaning = "FFFFFFFFh: not watched"});
  add(o, {0x6066, 0, "following error time", T::u16, rw, false, 100}, {.scale = 1e-3, .unit = "s"});
  velocity(0x606C, "velocity actual", ro, "motor side");
  torque(0x6071, "target torque", T::i16, rw, 0, "CST");
  torque(0x6072, "max torque", T::u16, rw, 1000);
  torque(0x6074, "torque demand", T::i16, ro, 0);
  add(o, {0x6076, 0, "motor rated torque", T::u32, ro, false, rated},
      {.scale = 1e-3, .unit = "Nm", .meaning = "torque_max_nm / gear_ratio; 1000 of 6071h, 6072h, 6077h"});
  torque(0x6077, "torque actual", T::i16, ro, 0, "motor side");
  position(0x607A, 0, "target position", rw, true, 0, "CSP");
  o.push_back({0x607D, 0, "highest sub-index", T::u8, constant, false, 2});
  position(0x607D, 1, "min position limit", rw, false,
           p.limited ? increments(p.position_low_rad) : limits_of(T::i32).low);
  position(0x607D, 2, "max position limit", rw, false,
           p.limited ? increments(p.position_high_rad) : limits_of(T::i32).high);
  add(o,
      {0x6080, 0, "max motor speed", T::u32, rw, false, std::llround(p.speed_max_rad_s * 30 / std::numbers::pi), 1,
       1000000},
      {.scale = std::numbers::pi / 30, .unit = "rad/s", .meaning = "rpm"});
  add(o,
      {0x6085, 0, "quick stop deceleration", T::u32, rw, false,
       std::llround(std::min(4.0 * p.speed_max_rad_s / milli_rpm, 4e9)), 1, 0xffffffffLL},
      {.scale = milli_rpm, .unit = "rad/s2"});
  o.push_back({0x608F, 0, "highest sub-index", T::u8, constant, false, 2});
  o.push_back({0x608F, 1, "encoder increments", T::u32, constant, false, increments_per_turn});
  o.push_back({0x608F, 2, "motor revolutions", T::u32, constant, false, 1});
  o.push_back({0x6091, 0, "highest sub-index", T::u8, constant, false, 2});
  o.push_back({0x6091, 1, "gear: motor revolutions", T::u32, constant, false, std::llround(1000 * p.gear_ratio)});
  o.push_back({0x6091, 2, "gear: joint revolutions", T::u32, constant, false, 1000});
  add(o, {0x60A9, 0, "velocity unit", T::u32, constant, false, 0xFDB44700},
      {.meaning = "10^-3 revolutions per minute"});
  velocity(0x60B1, "velocity offset", rw, "added in CSP and CSV");
  torque(0x60B2, "torque offset", T::i16, rw, 0, "added in every mode");
  o.push_back({0x60C2, 0, "highest sub-index", T::u8, constant, false, 2});
  add(o,
      {0x60C2, 1, "interpolation time", T::u8, rw, false, std::max<std::int64_t>(1, std::llround(p.cycle_us / 1e3)), 1,
       255},
      {.meaning = "CSP: set points are joined by straight lines over this time"});
  add(o, {0x60C2, 2, "interpolation time exponent", T::i8, rw, false, -3, -6, 0}, {.meaning = "of ten, seconds"});
  add(o, {0x60F4, 0, "following error", T::i32, ro, true}, {.scale = increment, .unit = "rad"});
  velocity(0x60FF, "target velocity", rw, "CSV");
  add(o, {0x6502, 0, "supported modes", T::u32, constant, false, 0x380}, {.meaning = "CSP, CSV, CST"});
  o.push_back({0x67FF, 0, "single device type", T::u32, constant, false, 0x00020192});

  o.push_back({0x2100, 0, "highest sub-index", T::u8, constant, false, 1});
  add(o, {0x2100, 1, "lubricant temperature", T::i16, ro, true, std::llround(10 * p.start_degC)},
      {.scale = 0.1, .unit = "degC"});
  o.push_back({0x2101, 0, "highest sub-index", T::u8, constant, false, 1});
  add(o, {0x2101, 1, "friction torque", T::i32, ro, true},
      {.scale = 1e-3, .unit = "Nm", .meaning = "arm side, positive when it opposes positive motion"});
  o.push_back({0x2102, 0, "highest sub-index", T::u8, constant, false, 1});
  add(o, {0x2102, 1, "load torque", T::i32, ro, true},
      {.scale = 1e-3, .unit = "Nm", .meaning = "arm side: what the gear carries"});
  o.push_back({0x2110, 0, "highest sub-index", T::u8, constant, false, 1});
  add(o, {0x2110, 1, "measured temperature", T::i16, rw, true, -32768},
      {.scale = 0.1, .unit = "degC", .meaning = "of a bench; overrides the thermal model; 8000h: none"});
  o.push_back({0x2111, 0, "highest sub-index", T::u8, constant, false, 1});
  add(o, {0x2111, 1, "temperature limit", T::i16, rw, false, 1200},
      {.scale = 0.1, .unit = "degC", .meaning = "above: fault 4310h; a warning 10 K before"});
  o.push_back({0x2120, 0, "highest sub-index", T::u8, constant, false, 1});
  add(o, {0x2120, 1, "SYNC deadline", T::u16, rw, false, 100, 1, 60000},
      {.scale = 1e-3, .unit = "s", .meaning = "enabled and without SYNC for so long: abort connection (6007h)"});
}

auto key(const Object& o) { return static_cast<std::uint32_t>(o.index) << 8 | o.sub; }

const char* name_of(Type type) {
  constexpr const char* names[] = {"u8", "u16", "u32", "i8", "i16", "i32", "text"};
  return names[static_cast<int>(type)];
}

}  // namespace

int size_of(Type type) {
  constexpr int sizes[] = {1, 2, 4, 1, 2, 4, 0};
  return sizes[static_cast<int>(type)];
}

bool is_signed(Type type) { return type == T::i8 || type == T::i16 || type == T::i32; }

std::int64_t saturated(Type type, std::int64_t value) {
  const Limits l = limits_of(type);
  return std::clamp(value, l.low, l.high);
}

std::int64_t decode(Type type, std::span<const std::uint8_t> bytes) {
  std::uint64_t raw = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) raw |= static_cast<std::uint64_t>(bytes[i]) << (8 * i);
  if (!is_signed(type)) return static_cast<std::int64_t>(raw);
  const std::uint64_t sign = 1ULL << (8 * bytes.size() - 1);
  return static_cast<std::int64_t>((raw ^ sign) - sign);
}

void encode(std::int64_t value, std::span<std::uint8_t> bytes) {
  for (std::size_t i = 0; i < bytes.size(); ++i)
    bytes[i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i));
}

Dictionary::Dictionary(const DriveParameters& p) {
  add_communication(objects_, p);
  add_drive(objects_, p);
  std::ranges::sort(objects_, {}, key);
  for (auto& o : objects_)
    if (o.low == o.high && o.index != 0x1005) o.low = limits_of(o.type).low, o.high = limits_of(o.type).high;
}

Object* Dictionary::find(std::uint16_t index, std::uint8_t sub) {
  const auto wanted = static_cast<std::uint32_t>(index) << 8 | sub;
  const auto at = std::ranges::lower_bound(objects_, wanted, {}, key);
  return at != objects_.end() && key(*at) == wanted ? &*at : nullptr;
}

bool Dictionary::has_index(std::uint16_t index) const {
  return std::ranges::binary_search(objects_, index, {}, &Object::index);
}

std::int64_t Dictionary::get(std::uint16_t index, std::uint8_t sub) const {
  return const_cast<Dictionary*>(this)->find(index, sub)->value;
}

void Dictionary::set(std::uint16_t index, std::uint8_t sub, std::int64_t value) {
  Object* o = find(index, sub);
  o->value = saturated(o->type, value);
}

tl::expected<std::vector<std::uint8_t>, Abort> Dictionary::read(std::uint16_t index, std::uint8_t sub) const {
  const Object* o = const_cast<Dictionary*>(this)->find(index, sub);
  if (!o) return tl::unexpected(has_index(index) ? Abort::no_sub_index : Abort::no_object);
  if (o->type == T::text) return std::vector<std::uint8_t>(o->text.begin(), o->text.end());
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size_of(o->type)));
  encode(o->value, bytes);
  return bytes;
}

tl::expected<void, Abort> Dictionary::write(std::uint16_t index, std::uint8_t sub,
                                            std::span<const std::uint8_t> bytes) {
  Object* o = find(index, sub);
  if (!o) return tl::unexpected(has_index(index) ? Abort::no_sub_index : Abort::no_object);
  if (o->access != rw) return tl::unexpected(Abort::read_only);
  const auto size = static_cast<std::size_t>(size_of(o->type));
  if (bytes.size() != size) return tl::unexpected(bytes.size() > size ? Abort::too_long : Abort::too_short);
  const std::int64_t value = decode(o->type, bytes);
  if (value > o->high) return tl::unexpected(Abort::too_high);
  if (value < o->low) return tl::unexpected(Abort::too_low);
  if (may_write)
    if (auto allowed = may_write(*o, value); !allowed) return allowed;
  o->value = value;
  if (written) written(*o);
  return {};
}

std::string reference_markdown(const Dictionary& dictionary) {
  std::string s =
      "| index | name | type | access | PDO | default | one count | meaning |\n|---|---|---|---|---|---|---|---|\n";
  for (const Object& o : dictionary.objects()) {
    if ((o.sub == 0 && o.name == "highest sub-index") || (o.index >= 0x1400 && o.index < 0x1C00)) continue;
    s += fmt::format("| {:04X}h:{:02X} | {} | {} | {} | {} | {} | {} | {} |\n", o.index, o.sub, o.name, name_of(o.type),
                     o.access == rw ? "rw" : "ro", o.mappable ? "yes" : "",
                     o.type == T::text ? o.text : fmt::to_string(o.value),
                     o.unit.empty() ? "" : fmt::format("{:.6g} {}", o.scale, o.unit), o.meaning);
  }
  return s;
}

}  // namespace tribotwin::hil
