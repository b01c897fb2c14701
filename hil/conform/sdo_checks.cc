#include <algorithm>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

using Codes = std::vector<std::uint32_t>;

constexpr std::uint32_t toggle = 0x05030000, unknown_command = 0x05040001, unsupported_access = 0x06010000,
                        read_only = 0x06010002, no_object = 0x06020000, wrong_length = 0x06070010,
                        too_long = 0x06070012, too_short = 0x06070013, no_sub_index = 0x06090011,
                        out_of_range = 0x06090030, general = 0x08000000;

std::string expect_abort(Device& d, const SdoFrame& request, const Codes& codes, const char* what) {
  const auto answer = d.bus.transfer(request);
  const std::string seen = answer ? fmt::format("answer {:02X}h", (*answer)[0]) : answer.error().text();
  expect(!answer && answer.error().kind == SdoFailure::Kind::aborted &&
             std::ranges::find(codes, answer.error().code) != codes.end(),
         fmt::format("{} ends with abort {:08X}h", what, codes.front()), seen);
  return seen;
}

/// The node still answers.
void expect_alive(Device& d) { d.get(od::device_type); }

// ---- Aborts.

constexpr std::uint16_t unused_index = 0x0FFF;  // CiA 301, table 37: below 1000h there are data types only

std::string unknown_object(Device& d) {
  expect_abort(d, sdo_frame(0x40, unused_index, 0), {no_object}, "an upload of 0FFFh");
  return expect_abort(d, sdo_frame(0x23, unused_index, 0), {no_object}, "a download to 0FFFh");
}

std::string unknown_sub_index(Device& d) {
  expect_abort(d, sdo_frame(0x40, od::device_type, 0x20), {no_sub_index}, "an upload of 1000h:20");
  return expect_abort(d, sdo_frame(0x40, od::identity, 0x20), {no_sub_index}, "an upload of 1018h:20");
}

std::string write_read_only(Device& d) {
  return expect_abort(d, sdo_frame(0x23, od::device_type, 0, 0), {read_only}, "a download to 1000h");
}

/// A download of a wrong length is refused and changes nothing. 1017h has 2 bytes.
std::string wrong_size(Device& d, std::size_t size, Codes codes) {
  d.needs(od::producer_heartbeat_time);
  const auto before = d.get(od::producer_heartbeat_time);
  const auto seen = d.expect_refused(od::producer_heartbeat_time, 0, 0x55, std::move(codes), size);
  const auto now = d.get(od::producer_heartbeat_time);
  expect(now == before, fmt::format("1017h stays {}", before), fmt::format("{}", now));
  return seen;
}

std::string longer(Device& d) { return wrong_size(d, 4, {too_long, wrong_length}); }
std::string shorter(Device& d) { return wrong_size(d, 1, {too_short, wrong_length}); }

/// Transmission types 241 to 251 are reserved (CiA 301, table 66).
std::string range(Device& d) {
  for (const std::uint16_t index : {od::tpdo_communication, od::rpdo_communication})
    if (d.has(index, 2)) {
      const auto before = d.get(index, 2);
      const auto seen = d.expect_refused(index, 2, 245, {out_of_range, 0x06090031});
      expect(d.get(index, 2) == before, fmt::format("{} stays {}", object_name(index, 2), before), "changed");
      return seen;
    }
  throw NotApplicable{"there is no PDO"};
}

std::string unknown_commands(Device& d) {
  const auto seen = expect_abort(d, {0xE0}, {unknown_command}, "command E0h");
  expect_alive(d);
  return seen;
}

std::string no_transfer(Device& d) {
  expect_abort(d, {0x60}, {unknown_command}, "an upload segment without a transfer");
  return expect_abort(d, {0x00}, {unknown_command}, "a download segment without a transfer");
}

// ---- Segmented transfers.

/// An object with more than 4 bytes.
std::uint16_t long_object(Device& d) {
  for (const std::uint16_t index : {od::device_name, od::hardware_version, od::software_version})
    if (d.has(index) && d.bytes(index).size() > 4) return index;
  throw NotApplicable{"1008h, 1009h and 100Ah have no value of more than 4 bytes"};
}

/// Begins a segmented upload; the device answers with the length.
SdoFrame begin_upload(Device& d, std::uint16_t index) {
  const auto begun = d.bus.transfer(sdo_frame(0x40, index, 0));
  expect(begun && !((*begun)[0] & 2), fmt::format("{:04X}h begins a segmented upload", index),
         begun ? fmt::format("answer {:02X}h", (*begun)[0]) : begun.error().text());
  return *begun;
}

std::string segmented_upload(Device& d) {
  const auto index = long_object(d);
  const SdoFrame begun = begin_upload(d, index);
  Bytes bytes;
  for (std::uint8_t bit = 0;; bit ^= 0x10) {
    const auto segment = d.bus.transfer({static_cast<std::uint8_t>(0x60 | bit)});
    expect(segment.has_value(), "a segment", segment ? "" : segment.error().text());
    const std::uint8_t command = (*segment)[0];
    expect((command & 0xF0) == bit, fmt::format("segment {:02X}h", bit), fmt::format("{:02X}h", command));
    bytes.insert(bytes.end(), segment->begin() + 1, segment->begin() + 8 - (command >> 1 & 7));
    if (command & 1) break;
    expect(bytes.size() < 4096, "an end of the transfer", "none within 4096 bytes");
  }
  if ((begun[0] & 1) && sdo_value(begun) != bytes.size())
    throw Mismatch{fmt::format("{} bytes, as announced", sdo_value(begun)), fmt::format("{}", bytes.size())};
  return fmt::format("{:04X}h, {} bytes", index, bytes.size());
}

std::string upload_toggle(Device& d) {
  begin_upload(d, long_object(d));
  const auto seen = expect_abort(d, {0x70}, {toggle}, "a first segment with toggle bit 1");
  expect_abort(d, {0x60}, {unknown_command}, "a segment after the abort");
  return seen;
}

std::string upload_toggle_repeated(Device& d) {
  const auto index = long_object(d);
  if (d.bytes(index).size() <= 7) throw NotApplicable{fmt::format("{:04X}h has one segment", index)};
  begin_upload(d, index);
  expect(d.bus.transfer({0x60}).has_value(), "the first segment", "none");
  return expect_abort(d, {0x60}, {toggle}, "a second segment with toggle bit 0");
}

/// NotApplicable where the server has no segmented downloads: objects of at most 4 bytes do not need them.
void begin_download(Device& d, std::uint16_t index, std::uint32_t size) {
  d.needs(index);
  const auto begun = d.bus.transfer(sdo_frame(0x21, index, 0, size));
  if (!begun && (begun.error().code == unknown_command || begun.error().code == unsupported_access))
    throw NotApplicable{"the server refuses segmented downloads"};
  expect(begun && (*begun)[0] == 0x60, fmt::format("{:04X}h begins a segmented download", index),
         begun ? fmt::format("answer {:02X}h", (*begun)[0]) : begun.error().text());
}

std::string segmented_download(Device& d) {
  begin_download(d, od::producer_heartbeat_time, 2);
  d.bus.abort(od::producer_heartbeat_time, 0, general);
  d.keep(od::producer_heartbeat_time, 0);
  const Bytes other{0x2C, 0x01};
  const auto written = d.bus.download_segmented(od::producer_heartbeat_time, 0, other);
  const auto now = d.bytes(od::producer_heartbeat_time);
  expect(written.has_value(), "1017h is written in a segment", written ? "" : written.error().text());
  expect(now == other, "1017h = 300", fmt::format("{}", decode(Type::u16, now)));
  return "1017h = 300";
}

std::string download_toggle(Device& d) {
  begin_download(d, od::producer_heartbeat_time, 2);
  return expect_abort(d, {0x1B, 0x2C, 0x01}, {toggle}, "a first segment with toggle bit 1");
}

std::string download_length(Device& d) {
  d.needs(od::producer_heartbeat_time);
  const auto before = d.get(od::producer_heartbeat_time);
  d.keep(od::producer_heartbeat_time, 0);
  begin_download(d, od::producer_heartbeat_time, 2);
  const auto answer = d.bus.transfer({0x09, 1, 2, 3});  // 3 bytes, the last segment
  const auto now = d.get(od::producer_heartbeat_time);
  const std::string seen = answer ? "accepted" : answer.error().text();
  expect(!answer && (answer.error().code >> 4) == 0x0607001,
         "3 bytes after 2 announced end with abort 06070010h or 12h", seen);
  expect(now == before, fmt::format("1017h stays {}", before), fmt::format("{}", now));
  return seen;
}

std::string abort_received(Device& d) {
  const auto index = long_object(d);
  begin_upload(d, index);
  d.bus.abort(index, 0, general);
  d.bus.listen(20 * ms_ns);
  const auto seen = expect_abort(d, {0x60}, {unknown_command}, "a segment after the client's abort");
  expect_alive(d);
  return seen;
}

std::string new_request(Device& d) {
  begin_upload(d, long_object(d));
  const auto type = d.get(od::device_type);
  return fmt::format("1000h = {:08X}h in the middle of a transfer", type);
}

// ---- Forms of requests.

std::string names_the_object(Device& d) {
  const auto answer = d.bus.transfer(sdo_frame(0x40, od::device_type, 0));
  expect(answer.has_value(), "an answer", answer ? "" : answer.error().text());
  expect((*answer)[1] == 0x00 && (*answer)[2] == 0x10 && (*answer)[3] == 0, "1000h:00 in bytes 1 to 3",
         object_name(static_cast<std::uint16_t>((*answer)[1] | (*answer)[2] << 8), (*answer)[3]));
  const auto aborted = d.bus.request(sdo_frame(0x40, unused_index, 7));
  expect(aborted && (*aborted)[0] == 0x80, "an abort", aborted ? "no abort" : aborted.error().text());
  expect((*aborted)[1] == 0xFF && (*aborted)[2] == 0x0F && (*aborted)[3] == 7, "0FFFh:07 in bytes 1 to 3 of the abort",
         object_name(static_cast<std::uint16_t>((*aborted)[1] | (*aborted)[2] << 8), (*aborted)[3]));
  return "1000h:00, 0FFFh:07";
}

std::string size_not_indicated(Device& d) {
  d.needs(od::producer_heartbeat_time);
  d.keep(od::producer_heartbeat_time, 0);
  const auto answer = d.bus.transfer(sdo_frame(0x22, od::producer_heartbeat_time, 0, 300));
  const auto now = d.get(od::producer_heartbeat_time);
  expect(answer.has_value(), "command 22h is accepted", answer ? "" : answer.error().text());
  expect(now == 300, "1017h = 300", fmt::format("{}", now));
  return "1017h = 300";
}

std::string short_request(Device& d) {
  const std::uint8_t bytes[] = {0x40, 0x00, 0x10, 0x00};
  d.bus.send(cob::sdo_to_server + d.node(), bytes);
  d.bus.listen(50 * ms_ns);
  expect_alive(d);
  return "1000h was read afterwards";
}

constexpr auto none = Needs::nothing;

constexpr Check checks[] = {
    {"sdo.unknown_object", "CiA 301, 7.2.4.3.17", "An object that does not exist: abort 06020000h.", none,
     unknown_object},
    {"sdo.unknown_sub_index", "CiA 301, 7.2.4.3.17", "A sub-index that does not exist: abort 06090011h.", none,
     unknown_sub_index},
    {"sdo.read_only", "CiA 301, 7.2.4.3.17", "A write to a read-only object: abort 06010002h.", none, write_read_only},
    {"sdo.too_long", "CiA 301, 7.2.4.3.17", "Too many bytes: abort 06070012h or 06070010h, nothing changes.", none,
     longer},
    {"sdo.too_short", "CiA 301, 7.2.4.3.17", "Too few bytes: abort 06070013h or 06070010h, nothing changes.", none,
     shorter},
    {"sdo.range", "CiA 301, 7.5.2.37", "A reserved transmission type: abort 06090030h, nothing changes.", none, range},
    {"sdo.unknown_command", "CiA 301, 7.2.4.3.17", "An undefined command: abort 05040001h.", none, unknown_commands},
    {"sdo.no_transfer", "CiA 301, 7.2.4.3.17", "A segment without a transfer: abort 05040001h.", none, no_transfer},
    {"sdo.segmented_upload", "CiA 301, 7.2.4.3.6", "Segments alternate their toggle bit and have the announced length.",
     none, segmented_upload},
    {"sdo.upload_toggle", "CiA 301, 7.2.4.3.6", "A first segment with toggle bit 1: abort 05030000h.", none,
     upload_toggle},
    {"sdo.upload_toggle_repeated", "CiA 301, 7.2.4.3.6", "A toggle bit that does not alternate: abort 05030000h.", none,
     upload_toggle_repeated},
    {"sdo.segmented_download", "CiA 301, 7.2.4.3.4", "A value can be written in segments.", none, segmented_download},
    {"sdo.download_toggle", "CiA 301, 7.2.4.3.4", "A first segment with toggle bit 1: abort 05030000h.", none,
     download_toggle},
    {"sdo.download_length", "CiA 301, 7.2.4.3.4", "More bytes than announced are refused, nothing changes.", none,
     download_length},
    {"sdo.abort_received", "CiA 301, 7.2.4.3.17", "An abort of the client ends the transfer.", none, abort_received},
    {"sdo.new_request", "CiA 301, 7.2.4.3.5", "A new request ends the transfer under way.", none, new_request},
    {"sdo.names_the_object", "CiA 301, 7.2.4.3.5", "Answer and abort name the object.", none, names_the_object},
    {"sdo.size_not_indicated", "CiA 301, 7.2.4.3.3", "An expedited download without a size has the object's.", none,
     size_not_indicated},
    {"sdo.short_request", "CiA 301, 7.2.4.3", "The server survives a request of 4 bytes.", none, short_request},
};

}  // namespace

Checks sdo_checks() { return checks; }

}  // namespace tribotwin::hil
