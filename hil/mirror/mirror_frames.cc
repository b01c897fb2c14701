#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/hil/mirror/mirror_frames.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::uint32_t command_id = 0x100, status_id = 0x180;

/// A number in a frame: value = offset + factor x count.
struct Signal {
  const char* name;
  int bit, bits;
  bool is_signed;
  double factor = 1, offset = 0;
  const char* unit = "";
};

struct CommandLayout {
  std::uint8_t size;
  Signal counter, mode, set_point, feed_forward;  ///< no bits: not carried
};
struct StatusLayout {
  std::uint8_t size;
  Signal counter, state, position, velocity, torque, temperature;
};

constexpr Signal counter_signal{"counter", 0, 4, false};
constexpr Signal mode_signal{"mode", 4, 4, false}, state_signal{"state", 4, 4, false};
constexpr Signal set_point_signal{"set_point", 8, 32, true};

constexpr CommandLayout commands[] = {
    {8, counter_signal, mode_signal, set_point_signal, {"feed_forward", 0, 0, true}},
    {12, counter_signal, mode_signal, set_point_signal, {"feed_forward", 40, 32, true, 1e-3, 0, "Nm"}}};
constexpr StatusLayout statuses[] = {{8,
                                      counter_signal,
                                      state_signal,
                                      {"position", 8, 24, true, 1e-5, 0, "rad"},
                                      {"velocity", 0, 0, true},
                                      {"torque", 32, 12, true, 1e-3, 0, "Nm"},
                                      {"temperature", 44, 12, false, 0.1, -50, "degC"}},
                                     {16,
                                      counter_signal,
                                      state_signal,
                                      {"position", 8, 32, true, 1e-6, 0, "rad"},
                                      {"velocity", 40, 32, true, 1e-6, 0, "rad/s"},
                                      {"torque", 72, 24, true, 1e-6, 0, "Nm"},
                                      {"temperature", 96, 16, true, 0.01, 0, "degC"}}};

const CommandLayout& command_layout(MirrorFormat format) { return commands[static_cast<std::size_t>(format)]; }
const StatusLayout& status_layout(MirrorFormat format) { return statuses[static_cast<std::size_t>(format)]; }

/// One count of a set point.
double count_of(MirrorMode mode) { return mode == MirrorMode::torque ? 1e-3 : 1e-6; }

std::uint8_t crc_of(std::uint32_t id, std::span<const std::uint8_t> bytes) {
  const std::uint8_t head[] = {static_cast<std::uint8_t>(id), static_cast<std::uint8_t>(id >> 8)};
  return static_cast<std::uint8_t>(crc8_j1850(bytes, crc8_j1850(head)) ^ 0xFF);
}

void put(Frame& frame, const Signal& s, double value) {
  const double high = std::pow(2.0, s.is_signed ? s.bits - 1 : s.bits) - 1, low = s.is_signed ? -high - 1 : 0;
  const double counts = (value - s.offset) / s.factor;
  const std::int64_t held = std::llround(std::isfinite(counts) ? std::clamp(counts, low, high) : 0);
  for (int i = 0; i < s.bits; ++i) {
    auto& byte = frame.data[static_cast<std::size_t>((s.bit + i) / 8)];
    byte = static_cast<std::uint8_t>(byte | (held >> i & 1) << (s.bit + i) % 8);
  }
}

double get(const Frame& frame, const Signal& s) {
  std::int64_t count = 0;
  for (int i = 0; i < s.bits; ++i)
    count |= static_cast<std::int64_t>(frame.data[static_cast<std::size_t>((s.bit + i) / 8)] >> (s.bit + i) % 8 & 1)
             << i;
  if (s.is_signed && count >> (s.bits - 1) & 1) count -= std::int64_t{1} << s.bits;
  return s.offset + s.factor * static_cast<double>(count);
}

MirrorFormat format_of(const Frame& frame) { return frame.fd ? MirrorFormat::fd : MirrorFormat::classic; }

bool whole(const Frame& frame, std::uint8_t size) {
  const auto body = static_cast<std::size_t>(size - 1);
  return !frame.extended && !frame.remote && !frame.error && frame.size == size &&
         frame.data[body] == crc_of(frame.id, frame.bytes().first(body));
}

Frame blank(std::uint32_t id, std::uint8_t size, MirrorFormat format) {
  const bool fd = format == MirrorFormat::fd;
  return {.id = id, .fd = fd, .bit_rate_switch = fd, .size = size};
}

Frame sealed(Frame frame) {
  const auto body = static_cast<std::size_t>(frame.size - 1);
  frame.data[body] = crc_of(frame.id, frame.bytes().first(body));
  return frame;
}

bool is_command(MirrorMode mode) {
  return mode == MirrorMode::off || mode == MirrorMode::torque || mode == MirrorMode::position ||
         mode == MirrorMode::velocity || mode == MirrorMode::clear_fault;
}

}  // namespace

std::uint8_t crc8_j1850(std::span<const std::uint8_t> bytes, std::uint8_t crc) {
  for (const std::uint8_t byte : bytes) {
    crc = static_cast<std::uint8_t>(crc ^ byte);
    for (int i = 0; i < 8; ++i) crc = static_cast<std::uint8_t>(crc & 0x80 ? crc << 1 ^ 0x1D : crc << 1);
  }
  return crc;
}

std::uint32_t mirror_command_id(int node) { return command_id + static_cast<std::uint32_t>(node); }
std::uint32_t mirror_status_id(int node) { return status_id + static_cast<std::uint32_t>(node); }

Frame encode(const MirrorCommand& c, int node, MirrorFormat format) {
  const CommandLayout& layout = command_layout(format);
  Frame frame = blank(mirror_command_id(node), layout.size, format);
  put(frame, layout.counter, c.counter & 15);
  put(frame, layout.mode, static_cast<int>(c.mode));
  put(frame, layout.set_point, c.set_point / count_of(c.mode));
  if (layout.feed_forward.bits) put(frame, layout.feed_forward, c.feed_forward_nm);
  return sealed(frame);
}

Frame encode(const MirrorStatus& s, int node, MirrorFormat format) {
  const StatusLayout& layout = status_layout(format);
  Frame frame = blank(mirror_status_id(node), layout.size, format);
  put(frame, layout.counter, s.counter & 15);
  put(frame, layout.state, static_cast<int>(s.state));
  put(frame, layout.position, s.position_rad);
  if (layout.velocity.bits) put(frame, layout.velocity, s.velocity_rad_s);
  put(frame, layout.torque, s.torque_norm);
  put(frame, layout.temperature, s.temperature_degC);
  return sealed(frame);
}

std::optional<MirrorCommand> decode_command(const Frame& frame) {
  const CommandLayout& layout = command_layout(format_of(frame));
  if (!whole(frame, layout.size)) return std::nullopt;
  MirrorCommand c{static_cast<std::uint8_t>(get(frame, layout.counter)),
                  static_cast<MirrorMode>(get(frame, layout.mode))};
  if (!is_command(c.mode)) return std::nullopt;
  c.set_point = count_of(c.mode) * get(frame, layout.set_point);
  if (layout.feed_forward.bits) c.feed_forward_nm = get(frame, layout.feed_forward);
  return c;
}

std::optional<MirrorStatus> decode_status(const Frame& frame) {
  const StatusLayout& layout = status_layout(format_of(frame));
  if (!whole(frame, layout.size)) return std::nullopt;
  MirrorStatus s{static_cast<std::uint8_t>(get(frame, layout.counter)),
                 static_cast<MirrorMode>(get(frame, layout.state)), get(frame, layout.position),
                 get(frame, layout.torque), get(frame, layout.temperature)};
  if (layout.velocity.bits) s.velocity_rad_s = get(frame, layout.velocity);
  return s;
}

namespace {

std::string line(const Signal& s, const std::string& reader, double factor) {
  if (s.bits == 0) return "";
  const std::string range = s.bits == 4 ? "0|15" : "0|0";
  return fmt::format(" SG_ {} : {}|{}@1{} ({},{}) [{}] \"{}\" {}\n", s.name, s.bit, s.bits, s.is_signed ? '-' : '+',
                     factor, s.offset, range, s.unit, reader);
}
std::string line(const Signal& s, const std::string& reader) { return line(s, reader, s.factor); }

std::string crc_line(std::uint8_t size, const std::string& reader) {
  return fmt::format(" SG_ crc : {}|8@1+ (1,0) [0|255] \"\" {}\n\n", 8 * (size - 1), reader);
}

std::string messages(const DescribedMirror& d, MirrorFormat format) {
  const CommandLayout& c = command_layout(format);
  const StatusLayout& s = status_layout(format);
  const std::string drive = fmt::format("drive{}", d.node), master = "master";
  return fmt::format("BO_ {} command{}: {} master\n", mirror_command_id(d.node), d.node, c.size) +
         line(c.counter, drive) + line(c.mode, drive) + line(c.set_point, drive) + line(c.feed_forward, drive) +
         crc_line(c.size, drive) +
         fmt::format("BO_ {} status{}: {} {}\n", mirror_status_id(d.node), d.node, s.size, drive) +
         line(s.counter, master) + line(s.state, master) + line(s.position, master) + line(s.velocity, master) +
         line(s.torque, master, s.torque.factor * d.torque_max_nm) + line(s.temperature, master) +
         crc_line(s.size, master);
}

std::string comments(const DescribedMirror& d, MirrorFormat format) {
  std::string s =
      fmt::format("CM_ SG_ {} set_point \"torque: mNm; position: 1e-6 rad; velocity: 1e-6 rad/s; arm side\";\n",
                  mirror_command_id(d.node));
  for (const auto& [id, size] : {std::pair{mirror_command_id(d.node), command_layout(format).size},
                                 {mirror_status_id(d.node), status_layout(format).size}})
    s += fmt::format("CM_ SG_ {} crc \"SAE J1850 over identifier (2 bytes, low first) and bytes 0 to {}\";\n", id,
                     size - 2);
  return s;
}

std::string values(const DescribedMirror& d) {
  return fmt::format(
      "VAL_ {} mode 0 \"off\" 1 \"torque\" 2 \"position\" 3 \"velocity\" 15 \"clear fault\" ;\nVAL_ {} state 0 "
      "\"off\" 1 \"torque\" 2 \"position\" 3 \"velocity\" 8 \"stopping\" 15 \"fault\" ;\n",
      mirror_command_id(d.node), mirror_status_id(d.node));
}

/// The attribute by which readers of DBC files know FD frames; its last value is theirs.
constexpr const char* fd_attributes =
    "BA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"ExtendedCAN\",\"reserved\",\"reserved\",\"reserved\","
    "\"reserved\",\"reserved\",\"reserved\",\"reserved\",\"reserved\",\"reserved\",\"reserved\",\"reserved\","
    "\"reserved\",\"StandardCAN_FD\",\"ExtendedCAN_FD\";\n"
    "BA_DEF_ \"BusType\" STRING ;\nBA_DEF_DEF_ \"VFrameFormat\" \"StandardCAN\";\nBA_DEF_DEF_ \"BusType\" "
    "\"CAN\";\nBA_ \"BusType\" \"CAN FD\";\n";

}  // namespace

std::string mirror_dbc(std::span<const DescribedMirror> drives, MirrorFormat format) {
  std::string s = "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: master", notes, meanings, formats;
  for (const auto& d : drives) s += fmt::format(" drive{}", d.node);
  s += "\n\n";
  for (const auto& d : drives) {
    s += messages(d, format);
    notes += comments(d, format);
    meanings += values(d);
    for (const auto id : {mirror_command_id(d.node), mirror_status_id(d.node)})
      formats += fmt::format("BA_ \"VFrameFormat\" BO_ {} 14;\n", id);
  }
  return s + notes + (format == MirrorFormat::fd ? fd_attributes + formats : "") + meanings;
}

}  // namespace tribotwin::hil
