#include <algorithm>
#include <cassert>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/hil/can/frame.hpp>

namespace tribotwin::hil {

bool Frame::operator==(const Frame& other) const {
  const bool same_header = id == other.id && extended == other.extended && remote == other.remote &&
                           error == other.error && fd == other.fd && bit_rate_switch == other.bit_rate_switch &&
                           error_passive == other.error_passive && size == other.size;
  if (!same_header || remote) return same_header;  // a remote frame carries a length but no data
  const auto used = std::min<std::size_t>(size, data.size());
  return std::equal(data.begin(), data.begin() + static_cast<std::ptrdiff_t>(used), other.data.begin());
}

Frame classic(std::uint32_t id, std::span<const std::uint8_t> bytes) {
  assert(id <= 0x7FF && bytes.size() <= 8);
  Frame frame;
  frame.id = id;
  frame.size = static_cast<std::uint8_t>(std::min<std::size_t>(bytes.size(), 8));
  std::copy_n(bytes.begin(), frame.size, frame.data.begin());
  return frame;
}

bool valid_size(bool fd, std::uint8_t size) {
  if (size <= 8 || !fd) return size <= 8;
  return size <= 24 ? size % 4 == 0 : size <= 64 && size % 16 == 0;
}

std::string text(const Frame& frame) {
  constexpr std::uint32_t error_flag = 0x20000000;  // CAN_ERR_FLAG of SocketCAN; candump prints it with the class
  std::string out = frame.error      ? fmt::format("{:08X}#", frame.id | error_flag)
                    : frame.extended ? fmt::format("{:08X}#", frame.id)
                                     : fmt::format("{:03X}#", frame.id);
  if (frame.remote) return out + (frame.size ? fmt::format("R{:X}", frame.size) : "R");
  if (frame.fd) out += fmt::format("#{:X}", (frame.bit_rate_switch ? 1 : 0) | (frame.error_passive ? 2 : 0));
  const auto used = std::min<std::size_t>(frame.size, frame.data.size());
  for (std::size_t i = 0; i < used; ++i) fmt::format_to(std::back_inserter(out), "{:02X}", frame.data[i]);
  return out;
}

Bits classic_bits(int size) {
  // 44 bits from start of frame to end of frame and 3 between frames; only the first 34 and the data can be stuffed,
  // with at most one bit after the first five equal ones and then one after every four.
  const int min = 44 + 8 * size + 3;
  return {.min = min, .max = min + (33 + 8 * size) / 4};
}

Bits fd_bits(int size) {
  constexpr int faster = 5;
  // Start of frame to BRS, then CRC delimiter to the end of the pause between frames.
  constexpr int begin = 17, end = 13;
  // ESI, length, data; a count of stuff bits and the CRC, both with a fixed bit after every four.
  const int body = 5 + 8 * size, sum = size <= 16 ? 4 + 17 + 6 : 4 + 21 + 7;
  const auto whole = [](int slow, int fast) { return slow + (fast + faster - 1) / faster; };
  return {.min = whole(begin + end, body + sum), .max = whole(begin + (begin - 1) / 4 + end, body + body / 4 + sum)};
}

Bits bits_of(const Frame& frame) {
  if (frame.error) return {0, 0};
  return frame.fd ? fd_bits(frame.size) : classic_bits(std::min<int>(frame.size, 8));
}

}  // namespace tribotwin::hil
