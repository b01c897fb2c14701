#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/hil/can/socketcand_protocol.hpp>
#include <tribotwin/plugins/friction/number.hpp>

namespace tribotwin::hil::socketcand {
namespace {

constexpr std::uint32_t last_11_bit = 0x7FF, last_29_bit = 0x1FFFFFFF;
constexpr std::size_t digits_of_29_bit = 8, longest_data = 8;

std::string identifier(const Frame& frame) {
  return frame.extended ? fmt::format("{:08X}", frame.id) : fmt::format("{:03X}", frame.id);
}

std::optional<Frame> with_identifier(std::string_view digits) {
  const auto id = to_integer<std::uint32_t>(digits, 16);
  if (!id || *id > last_29_bit || digits.size() > digits_of_29_bit) return std::nullopt;
  return Frame{.id = *id, .extended = digits.size() == digits_of_29_bit || *id > last_11_bit};
}

bool add_byte(Frame& frame, std::string_view digits) {
  const auto byte = to_integer<std::uint8_t>(digits, 16);
  if (!byte || frame.size == longest_data) return false;
  frame.data[frame.size++] = *byte;
  return true;
}

/// "sec.usec" as nanoseconds; 0 where it is no time.
std::int64_t time_of(std::string_view text) {
  const auto seconds = to_number(text);
  return seconds && *seconds >= 0 && *seconds < 1e10 ? std::llround(*seconds * 1e6) * 1000 : 0;
}

}  // namespace

std::string send_command(const Frame& frame) {
  std::string out = fmt::format("< send {} {}", identifier(frame), frame.size);
  for (const auto byte : frame.bytes()) fmt::format_to(std::back_inserter(out), " {:02X}", byte);
  return out + " >";
}

std::optional<Frame> parse_send(std::span<const std::string_view> parts) {
  if (parts.size() < 3) return std::nullopt;
  auto frame = with_identifier(parts[1]);
  const auto size = to_integer<std::uint8_t>(parts[2], 16);
  if (!frame || !size || parts.size() != 3u + *size) return std::nullopt;
  for (const auto byte : parts.subspan(3))
    if (!add_byte(*frame, byte)) return std::nullopt;
  return frame;
}

/// Begins with a blank: python-can 4.1.0 drops the character behind the last complete frame of each read, which must
/// not be the '<' of the next. Without data there are two blanks before '>'; it needs both.
std::string frame_command(const Frame& frame) {
  std::string out = fmt::format(" < frame {} {}.{:06} ", identifier(frame), frame.time_ns / 1'000'000'000,
                                frame.time_ns % 1'000'000'000 / 1000);
  for (const auto byte : frame.bytes()) fmt::format_to(std::back_inserter(out), "{:02X}", byte);
  return out + " >";
}

std::optional<Frame> parse_frame(std::span<const std::string_view> parts) {
  if (parts.size() < 3) return std::nullopt;
  auto frame = with_identifier(parts[1]);
  if (!frame) return std::nullopt;
  frame->time_ns = time_of(parts[2]);
  std::string digits;
  for (const auto part : parts.subspan(3)) digits += part;
  for (std::size_t at = 0; at < digits.size(); at += 2)
    if (digits.size() % 2 != 0 || !add_byte(*frame, std::string_view(digits).substr(at, 2))) return std::nullopt;
  return frame;
}

}  // namespace tribotwin::hil::socketcand
