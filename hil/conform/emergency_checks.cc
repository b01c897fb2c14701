#include <algorithm>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::uint16_t pdo_length = 0x8210, heartbeat_lost = 0x8130;

std::string codes_of(const std::vector<std::uint16_t>& codes) {
  std::vector<std::string> names;
  for (const auto code : codes) names.push_back(fmt::format("{:04X}h", code));
  return names.empty() ? "no EMCY" : fmt::format("EMCY {}", fmt::join(names, ", "));
}

bool contains(const std::vector<std::uint16_t>& codes, std::uint16_t code) {
  return std::ranges::find(codes, code) != codes.end();
}

/// The RPDO of the checks with the right length, and a controlword that changes nothing.
void send_right_length(Device& d) {
  const std::uint8_t disable_voltage[] = {0, 0};
  d.bus.send(cob::rpdo(0) + d.node(), disable_voltage);
  d.bus.listen(50 * ms_ns);
}

/// An RPDO with one byte too few: the error that no drive moves for. Some devices report it again only after one of the
/// right length.
void provoke_length_error(Device& d) {
  const auto id = use_pdo(d, false, {map_controlword}, 255);
  d.operational();
  send_right_length(d);
  d.bus.forget();
  const std::uint8_t byte[] = {6};
  d.bus.send(id, byte);
  d.bus.until([&] { return contains(emergencies(d), pdo_length); }, 200 * ms_ns);
  expect(contains(emergencies(d), pdo_length), "EMCY 8210h for an RPDO that is too short", codes_of(emergencies(d)));
}

std::string frame(Device& d) {
  provoke_length_error(d);
  for (const HeardFrame& h : d.bus.heard(cob::emcy + d.node()))
    expect(h.frame.size == 8, "EMCY with 8 bytes", text(h.frame));
  return text(d.bus.heard(cob::emcy + d.node()).front().frame);
}

/// Of the first EMCY with an error code.
std::string error_register(Device& d) {
  provoke_length_error(d);
  const auto all = d.bus.heard(cob::emcy + d.node());
  const auto error = std::ranges::find_if(all, [](const HeardFrame& h) { return h.frame.data[0] || h.frame.data[1]; });
  const Frame& first = error->frame;
  expect(first.data[2] & 1, "byte 2 with bit 0, the generic error", text(first));
  return text(first);
}

/// The error is over with the frame, or with the next one of the right length.
std::string end(Device& d) {
  provoke_length_error(d);
  send_right_length(d);
  const auto over = [&] { return contains(emergencies(d), 0) && d.get(od::error_register) == 0; };
  const bool ended = d.bus.until(over, 500 * ms_ns);
  const std::string seen = fmt::format("{}, 1001h = {:02X}h", codes_of(emergencies(d)), d.get(od::error_register));
  expect(ended, "EMCY 0000h and 1001h = 00h when the error is over", seen);
  return seen;
}

std::string history(Device& d) {
  d.needs(od::predefined_error_field);
  d.put(od::predefined_error_field, 0, 0);
  provoke_length_error(d);
  const auto count = d.get(od::predefined_error_field);
  const auto newest = d.get(od::predefined_error_field, 1) & 0xFFFF;
  const std::string seen = fmt::format("1003h:00 = {}, 1003h:01 = {:04X}h", count, newest);
  expect(count >= 1 && newest == pdo_length, "1003h:01 with 8210h in its lower half", seen);
  return seen;
}

std::string history_order(Device& d) {
  d.needs(od::predefined_error_field);
  d.needs(od::consumer_heartbeat_time, 1);
  d.put(od::predefined_error_field, 0, 0);
  provoke_length_error(d);
  watch_heartbeat(d, 100);
  d.bus.listen(300 * ms_ns);
  const auto count = d.get(od::predefined_error_field);
  expect(count >= 2, "1003h:00 of at least 2 after two errors", fmt::format("{}", count));
  const auto newest = d.get(od::predefined_error_field, 1) & 0xFFFF,
             older = d.get(od::predefined_error_field, 2) & 0xFFFF;
  const std::string seen = fmt::format("1003h:01 = {:04X}h, :02 = {:04X}h", newest, older);
  expect(newest == heartbeat_lost && older == pdo_length, "8130h before 8210h, the newest first", seen);
  return seen;
}

std::string history_clear(Device& d) {
  d.needs(od::predefined_error_field);
  provoke_length_error(d);
  d.put(od::predefined_error_field, 0, 0);
  const auto count = d.get(od::predefined_error_field);
  expect(count == 0, "1003h:00 = 0", fmt::format("{}", count));
  const auto empty = d.bus.upload(od::predefined_error_field, 1);
  expect(!empty && (empty.error().code == 0x08000024 || empty.error().code == 0x06090011),
         "1003h:01 of an empty history ends with abort 08000024h", empty ? "a value" : empty.error().text());
  return empty.error().text();
}

std::string history_write(Device& d) {
  d.needs(od::predefined_error_field);
  return d.expect_refused(od::predefined_error_field, 0, 1, {0x06090030, 0x06090031});
}

// ---- Heartbeat consumer.

std::string heartbeat_lost_once(Device& d) {
  watch_heartbeat(d, 100);
  d.bus.forget();
  d.bus.listen(60 * ms_ns);
  expect(!contains(emergencies(d), heartbeat_lost), "nothing within the time", codes_of(emergencies(d)));
  d.bus.listen(500 * ms_ns);
  const auto codes = emergencies(d);
  const auto count = std::ranges::count(codes, heartbeat_lost);
  expect(count == 1, "EMCY 8130h, once", codes_of(codes));
  return codes_of(codes);
}

std::string heartbeat_kept(Device& d) {
  const auto node = watch_heartbeat(d, 200);
  d.bus.forget();
  const std::uint8_t operational[] = {5};
  for (int i = 0; i < 10; ++i) {
    d.bus.send(cob::heartbeat + node, operational);
    d.bus.listen(50 * ms_ns);
  }
  expect(!contains(emergencies(d), heartbeat_lost), "no EMCY 8130h while the heartbeat comes",
         codes_of(emergencies(d)));
  return "no EMCY 8130h in 500 ms";
}

std::string heartbeat_not_begun(Device& d) {
  d.needs(od::consumer_heartbeat_time, 1);
  d.bus.forget();
  d.set(od::consumer_heartbeat_time, 1, unused_node(d) << 16 | 100);
  d.bus.listen(500 * ms_ns);
  expect(!contains(emergencies(d), heartbeat_lost), "no EMCY 8130h before a first heartbeat", codes_of(emergencies(d)));
  return "no EMCY 8130h in 500 ms";
}

std::string heartbeat_twice(Device& d) {
  d.needs(od::consumer_heartbeat_time, 2);
  const auto node = unused_node(d);
  d.set(od::consumer_heartbeat_time, 2, 0);
  d.set(od::consumer_heartbeat_time, 1, node << 16 | 100);
  return d.expect_refused(od::consumer_heartbeat_time, 2, node << 16 | 200, {0x06040043});
}

template <int behavior, Nmt after>
std::string error_behavior(Device& d) {
  d.needs(od::error_behavior, 1);
  d.hear_heartbeat();
  if (d.refusal(od::error_behavior, 1, behavior)) throw NotApplicable{fmt::format("1029h:01 refuses {}", behavior)};
  d.operational();
  watch_heartbeat(d, 100);
  d.bus.listen(300 * ms_ns);
  const auto seen = d.nmt_state();
  d.pre_operational();
  expect(seen == static_cast<std::uint8_t>(after),
         fmt::format("NMT state {:02X}h after a lost heartbeat", static_cast<int>(after)),
         fmt::format("{:02X}h", seen));
  return fmt::format("NMT state {:02X}h", seen);
}

constexpr auto none = Needs::nothing;

constexpr Check checks[] = {
    {"emcy.frame", "CiA 301, 7.2.7.3", "EMCY has 8 bytes: code, error register, 5 of the maker.", none, frame},
    {"emcy.register", "CiA 301, 7.5.2.2", "Byte 2 of an EMCY has bit 0 of the error register.", none, error_register},
    {"emcy.end", "CiA 301, 7.2.7.1", "EMCY 0000h says that the errors are over.", none, end},
    {"emcy.history", "CiA 301, 7.5.2.4", "1003h:01 is the code of the last EMCY.", none, history},
    {"emcy.history_order", "CiA 301, 7.5.2.4", "1003h has the newest error first.", none, history_order},
    {"emcy.history_clear", "CiA 301, 7.5.2.4", "Writing 0 to 1003h:00 empties the history.", none, history_clear},
    {"emcy.history_write", "CiA 301, 7.5.2.4", "Writing 1 to 1003h:00: abort 06090030h.", none, history_write},
    {"consumer.lost", "CiA 301, 7.2.8.2.2.2", "A watched heartbeat that ends: EMCY 8130h, once.", none,
     heartbeat_lost_once},
    {"consumer.kept", "CiA 301, 7.2.8.2.2.2", "A watched heartbeat that goes on: no EMCY.", none, heartbeat_kept},
    {"consumer.not_begun", "CiA 301, 7.5.2.19", "A heartbeat is watched from its first arrival on.", none,
     heartbeat_not_begun},
    {"consumer.twice", "CiA 301, 7.5.2.19", "A node in two entries of 1016h: abort 06040043h.", none, heartbeat_twice},
    {"consumer.to_pre_operational", "CiA 301, 7.5.2.32", "1029h:01 = 0: a lost heartbeat leads to pre-operational.",
     none, error_behavior<0, Nmt::pre_operational>},
    {"consumer.no_change", "CiA 301, 7.5.2.32", "1029h:01 = 1: a lost heartbeat leaves operational.", none,
     error_behavior<1, Nmt::operational>},
    {"consumer.to_stopped", "CiA 301, 7.5.2.32", "1029h:01 = 2: a lost heartbeat leads to stopped.", none,
     error_behavior<2, Nmt::stopped>},
};

}  // namespace

Checks emergency_checks() { return checks; }

std::vector<std::uint16_t> emergencies(const Device& device) {
  std::vector<std::uint16_t> codes;
  for (const HeardFrame& h : device.bus.heard(cob::emcy + device.node()))
    if (h.frame.size >= 2) codes.push_back(static_cast<std::uint16_t>(decode(Type::u16, h.frame.bytes().first(2))));
  return codes;
}

std::uint8_t watch_heartbeat(Device& d, int period_ms) {
  d.needs(od::consumer_heartbeat_time, 1);
  const auto node = unused_node(d);
  d.set(od::consumer_heartbeat_time, 1, node << 16 | period_ms);
  const std::uint8_t operational[] = {5};
  d.bus.send(cob::heartbeat + node, operational);
  return node;
}

}  // namespace tribotwin::hil
