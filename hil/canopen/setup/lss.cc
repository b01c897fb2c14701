#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/setup/lss.hpp>

namespace tribotwin::hil {
namespace {

/// Command specifiers (CiA 305).
enum Command : std::uint8_t {
  switch_state_global = 0x04,
  configure_node_id = 0x11,
  configure_bit_timing = 0x13,
  store_configuration = 0x17,
  select_vendor = 0x40,
  select_serial_number = 0x43,
  selected = 0x44,
  identify_vendor = 0x46,
  identify_serial_number_high = 0x4B,
  identify_unconfigured = 0x4C,
  identified = 0x4F,
  unconfigured_identified = 0x50,
  fast_scan = 0x51,
  inquire_vendor = 0x5A,
  inquire_serial_number = 0x5D,
  inquire_node_id = 0x5E,
};

/// Of the configuration services.
enum Error : std::uint8_t { none = 0, out_of_range = 1, not_supported = 1, cannot_be_kept = 2 };

std::uint32_t value_of(const Frame& frame) {
  return static_cast<std::uint32_t>(decode(Type::u32, frame.bytes().subspan(1, 4)));
}

}  // namespace

bool LssSlave::receive(const Frame& frame) {
  if (frame.size != 8) return false;
  const std::uint8_t command = frame.data[0];
  if (command == switch_state_global) return switch_global(frame.data[1]);
  if (command >= identify_vendor && command <= identify_serial_number_high) {
    if (follows(command, value_of(frame), identify_vendor, identify_serial_number_high)) answer(identified);
  } else if (command == identify_unconfigured) {
    if (unconfigured()) answer(unconfigured_identified);
  } else if (configuring_) {
    configure(frame);
  } else if (command >= select_vendor && command <= select_serial_number) {
    configuring_ = follows(command, value_of(frame), select_vendor, select_serial_number);
    if (configuring_) answer(selected);
  } else if (command == fast_scan) {
    fastscan(frame);
  }
  return false;
}

bool LssSlave::switch_global(std::uint8_t mode) {
  enum Mode : std::uint8_t { waiting = 0, configuration = 1 };
  if (mode > configuration) return false;
  const bool left = configuring_ && mode == waiting;
  configuring_ = mode == configuration;
  return left && node_.id == unconfigured_node && pending_ != unconfigured_node;
}

void LssSlave::configure(const Frame& frame) {
  const std::uint8_t command = frame.data[0], number = frame.data[1];
  switch (command) {
    case configure_node_id:
      if (!is_node_number(number) && number != unconfigured_node) return answer(command, out_of_range);
      pending_ = number;
      return answer(command, none);
    case configure_bit_timing:  // no bus here has a bit rate that a drive can set
      return answer(command, not_supported);
    case store_configuration:
      return answer(command, !keep_ ? not_supported : keep_(pending_) ? none : cannot_be_kept);
    case inquire_node_id:
      return answer(command, node_.id);
    default:
      if (command >= inquire_vendor && command <= inquire_serial_number)
        answer(command, identity(command - inquire_vendor + 1));
  }
}

/// Bits of the identity, from the highest on; a drive that answers has them. After the last bit of the serial number
/// the one drive that is left is selected.
void LssSlave::fastscan(const Frame& frame) {
  constexpr std::uint8_t begin = 0x80;
  const std::uint8_t bit = frame.data[5], part = frame.data[6], next = frame.data[7];
  if (!unconfigured() || (bit > 31 && bit != begin) || part > 3 || next > 3) return;
  if (bit == begin) {
    fastscan_at_ = 0;
    return answer(identified);
  }
  if (part != fastscan_at_ || (identity(part + 1) ^ value_of(frame)) >> bit != 0) return;
  fastscan_at_ = next;
  configuring_ = bit == 0 && next < part;
  answer(identified);
}

bool LssSlave::follows(std::uint8_t command, std::uint32_t value, std::uint8_t first, std::uint8_t last) {
  const bool ranges = first == identify_vendor;  // of revision and serial number: from, to
  const int step = command - first;
  const std::uint32_t mine = identity(ranges && step > 1 ? 3 + (step - 2) / 2 : 1 + step);
  const bool bound = ranges && step > 1;
  const bool fits = !bound ? value == mine : step % 2 == 0 ? mine >= value : mine <= value;
  const bool in_turn = command == first || command == expected_;
  expected_ = in_turn && fits ? static_cast<std::uint8_t>(command + 1) : std::uint8_t{0};
  return expected_ != 0 && command == last;
}

std::uint32_t LssSlave::identity(int sub) const {
  return static_cast<std::uint32_t>(node_.dictionary.get(od::identity, static_cast<std::uint8_t>(sub)));
}

void LssSlave::answer(std::uint8_t command, std::uint32_t value) {
  std::array<std::uint8_t, 8> data{command};
  encode(value, std::span(data).subspan(1, 4));
  node_.send(cob::lss_to_master, data);
}

}  // namespace tribotwin::hil
