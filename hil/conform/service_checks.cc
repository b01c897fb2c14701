#include <algorithm>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/sdo.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::uint32_t unknown_command = 0x05040001, wrong_crc = 0x05040004, unsupported_access = 0x06010000,
                        read_only = 0x06010002, not_now = 0x08000022;
constexpr std::uint8_t crc_bit = 0x04;

// ---- Block transfers.

/// The answer to the first request of a block transfer; NotApplicable where the server has none.
SdoFrame begin_block(Device& d, const SdoFrame& request) {
  const auto begun = d.bus.transfer(request);
  const auto code = begun ? 0 : begun.error().code;
  if (code == unknown_command || code == unsupported_access) throw NotApplicable{"the server has no block transfer"};
  expect(begun.has_value(), "an answer to the first request of a block transfer", begun ? "" : begun.error().text());
  return *begun;
}

SdoFrame next(Device& d, const SdoFrame& request, std::uint8_t wanted, std::uint8_t mask) {
  const auto answer = d.bus.transfer(request);
  const std::string seen = answer ? fmt::format("{:02X}h", (*answer)[0]) : answer.error().text();
  expect(answer && ((*answer)[0] & mask) == wanted, fmt::format("answer {:02X}h", wanted), seen);
  return *answer;
}

/// The segments of one block up to the last of the transfer; they have to come in order.
Bytes segments(Device& d) {
  const std::uint32_t id = cob::sdo_to_client + d.node();
  const auto ended = [&] {
    const auto all = d.bus.heard(id);
    return !all.empty() && (all.back().frame.data[0] & 0x80);
  };
  expect(d.bus.until(ended, 1000 * ms_ns), "a last segment", "none within 1 s");
  Bytes bytes;
  std::uint8_t number = 0;
  for (const HeardFrame& h : d.bus.heard(id)) {
    const auto seen = static_cast<std::uint8_t>(h.frame.data[0] & 0x7F);
    expect(seen == ++number, fmt::format("segment {}", number), fmt::format("{}", seen));
    bytes.insert(bytes.end(), h.frame.data.begin() + 1, h.frame.data.begin() + 8);
  }
  return bytes;
}

std::string block_upload(Device& d) {
  d.needs(od::device_name);
  const Bytes wanted = d.bytes(od::device_name);
  if (wanted.size() > 7 * 127) throw NotApplicable{"1008h is longer than a block"};
  constexpr std::uint8_t block_size = 127;
  const SdoFrame begun = begin_block(d, sdo_frame(0xA0 | crc_bit, od::device_name, 0, block_size));
  expect((begun[0] & 0xF9) == 0xC0, "answer C0h to the request", fmt::format("{:02X}h", begun[0]));
  if ((begun[0] & 2) && sdo_value(begun) != wanted.size())
    throw Mismatch{fmt::format("{} bytes announced", wanted.size()), fmt::format("{}", sdo_value(begun))};
  d.bus.forget();
  const std::uint8_t start[8] = {0xA3};
  d.bus.send(cob::sdo_to_server + d.node(), start);
  Bytes bytes = segments(d);
  const auto count = static_cast<std::uint8_t>(bytes.size() / 7);
  const SdoFrame end = next(d, {0xA2, count, block_size}, 0xC1, 0xE3);
  bytes.resize(bytes.size() - std::min<std::size_t>(bytes.size(), end[0] >> 2 & 7));
  const std::uint8_t confirm[8] = {0xA1};
  d.bus.send(cob::sdo_to_server + d.node(), confirm);
  expect(bytes == wanted, "the value that a segmented upload has", fmt::format("{} other bytes", bytes.size()));
  const auto crc = decode(Type::u16, std::span(end).subspan(1, 2));
  if ((begun[0] & crc_bit) && crc != sdo_crc(bytes))
    throw Mismatch{fmt::format("CRC {:04X}h", sdo_crc(bytes)), fmt::format("{:04X}h", crc)};
  return fmt::format("1008h, {} bytes in {} segments", bytes.size(), count);
}

/// 1017h = 300 in a block of one segment, up to the request that ends it. Returns whether the server checks a CRC.
bool send_block(Device& d) {
  d.needs(od::producer_heartbeat_time);
  d.keep(od::producer_heartbeat_time, 0);
  const SdoFrame begun = begin_block(d, sdo_frame(0xC2 | crc_bit, od::producer_heartbeat_time, 0, 2));
  expect((begun[0] & 0xFB) == 0xA0, "answer A0h to the request", fmt::format("{:02X}h", begun[0]));
  const SdoFrame taken = next(d, {0x81, 0x2C, 0x01}, 0xA2, 0xFF);
  expect(taken[1] == 1, "segment 1 confirmed", fmt::format("{}", taken[1]));
  return begun[0] & crc_bit;
}

SdoFrame end_of_block(std::uint16_t crc) {
  constexpr std::uint8_t unused = 5;
  return {0xC1 | unused << 2, static_cast<std::uint8_t>(crc), static_cast<std::uint8_t>(crc >> 8)};
}

const std::uint16_t crc_of_300 = sdo_crc(Bytes{0x2C, 0x01});

std::string block_download(Device& d) {
  send_block(d);
  next(d, end_of_block(crc_of_300), 0xA1, 0xFF);
  const auto now = d.get(od::producer_heartbeat_time);
  expect(now == 300, "1017h = 300", fmt::format("{}", now));
  return "1017h = 300";
}

std::string block_crc(Device& d) {
  d.needs(od::producer_heartbeat_time);
  const auto before = d.get(od::producer_heartbeat_time);
  if (!send_block(d)) throw NotApplicable{"the server checks no CRC"};
  const auto answer = d.bus.transfer(end_of_block(static_cast<std::uint16_t>(crc_of_300 ^ 1)));
  const std::string seen = answer ? "accepted" : answer.error().text();
  expect(!answer && answer.error().code == wrong_crc, "a wrong CRC ends with abort 05040004h", seen);
  const auto now = d.get(od::producer_heartbeat_time);
  expect(now == before, fmt::format("1017h stays {}", before), fmt::format("{}", now));
  return seen;
}

// ---- Store and restore: only what has to be refused, so that nothing is stored.

template <std::uint16_t index>
std::string signature(Device& d) {
  d.needs(index, 1);
  constexpr std::uint32_t wrong = 0x12345678;
  const auto written = d.bus.download(index, 1, Bytes{0x78, 0x56, 0x34, 0x12});
  const std::string seen = written ? "accepted" : written.error().text();
  if (!written && written.error().code == read_only) throw NotApplicable{object_name(index, 1) + " is read-only"};
  expect(!written && (written.error().code >> 4) == 0x0800002,
         fmt::format("{:08X}h in {} ends with abort 0800002xh", wrong, object_name(index, 1)), seen);
  return seen;
}

// ---- SYNC counter, inhibit time of EMCY.

std::string counter_while_cyclic(Device& d) {
  d.needs(od::synchronous_counter_overflow);
  d.needs(od::communication_cycle_period);
  if (d.get(od::communication_cycle_period) == 0 && d.refusal(od::communication_cycle_period, 0, 10'000))
    throw NotApplicable{"1006h stays 0"};
  return d.expect_refused(od::synchronous_counter_overflow, 0, 10, {not_now});
}

std::string counter_range(Device& d) {
  d.needs(od::synchronous_counter_overflow);
  if (d.has(od::communication_cycle_period)) d.refusal(od::communication_cycle_period, 0, 0);
  d.expect_refused(od::synchronous_counter_overflow, 0, 241, {0x06090030, 0x06090031});
  return d.expect_refused(od::synchronous_counter_overflow, 0, 1, {0x06090030, 0x06090032});
}

// ---- LSS: this device alone is selected, asked, and left again.

std::string lss_selective(Device& d) {
  for (std::uint8_t sub = 1; sub <= 4; ++sub) d.needs(od::identity, sub);
  const auto request = [&](std::uint8_t command, std::int64_t value) {
    Bytes frame(8);
    frame[0] = command;
    encode(value, std::span(frame).subspan(1, 4));
    d.bus.forget();
    d.bus.send(cob::lss_to_slave, frame);
    d.bus.until([&] { return !d.bus.heard(cob::lss_to_master).empty(); }, 100 * ms_ns);
  };
  constexpr std::uint8_t select = 0x40, selected = 0x44, inquire_node = 0x5E, switch_global = 0x04;
  for (std::uint8_t sub = 1; sub <= 4; ++sub)
    request(static_cast<std::uint8_t>(select + sub - 1), d.get(od::identity, sub));
  const auto answer = d.bus.heard(cob::lss_to_master);
  if (answer.empty()) throw NotApplicable{"the device does not answer to LSS"};
  request(inquire_node, 0);
  const auto node = d.bus.heard(cob::lss_to_master);
  request(switch_global, 0);
  expect(answer.front().frame.data[0] == selected, "7E4h#44", text(answer.front().frame));
  expect(!node.empty() && node.front().frame.data[0] == inquire_node && node.front().frame.data[1] == d.node(),
         fmt::format("7E4h#5E{:02X}", d.node()), node.empty() ? "nothing" : text(node.front().frame));
  return text(node.front().frame);
}

constexpr auto none = Needs::nothing;

constexpr Check checks[] = {
    {"sdo.block_upload", "CiA 301, 7.2.4.3.12", "A block upload has the segments in order, the value and its CRC.",
     none, block_upload},
    {"sdo.block_download", "CiA 301, 7.2.4.3.9", "A value can be written in a block.", none, block_download},
    {"sdo.block_crc", "CiA 301, 7.2.4.3.16", "A block download with a wrong CRC: abort 05040004h.", none, block_crc},
    {"store.signature", "CiA 301, 7.5.2.13", "1010h refuses a signature other than \"save\": abort 0800002xh.", none,
     signature<od::store_parameters>},
    {"restore.signature", "CiA 301, 7.5.2.14", "1011h refuses a signature other than \"load\": abort 0800002xh.", none,
     signature<od::restore_default_parameters>},
    {"sync.counter_while_cyclic", "CiA 301, 7.5.2.22", "1019h cannot change while 1006h is not 0: abort 08000022h.",
     none, counter_while_cyclic},
    {"sync.counter_range", "CiA 301, 7.5.2.22", "1019h = 1 and 241 are reserved: abort 06090030h.", none,
     counter_range},
    {"lss.selective", "CiA 305, switch state selective", "Selected by its 1018h, the device tells its node number.",
     none, lss_selective},
};

}  // namespace

Checks service_checks() { return checks; }

}  // namespace tribotwin::hil
