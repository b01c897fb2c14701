#include <algorithm>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

using S = DriveState;

std::size_t count(Device& d, std::uint32_t id) { return d.bus.heard(id).size(); }

/// PDOs in answer to SYNCs, 20 ms apart.
std::size_t after_syncs(Device& d, std::uint32_t id, int syncs) {
  d.bus.forget();
  for (int i = 0; i < syncs; ++i) {
    d.bus.sync();
    d.bus.listen(20 * ms_ns);
  }
  return count(d, id);
}

std::string expect_count(std::size_t seen, std::size_t wanted, const char* of) {
  const std::string text = fmt::format("{} PDOs for {}", seen, of);
  expect(seen == wanted, fmt::format("{} PDOs for {}", wanted, of), text);
  return text;
}

// ---- Transmit.

std::string every_sync(Device& d) {
  const auto id = use_pdo(d, true, {map_statusword}, 1);
  d.operational();
  return expect_count(after_syncs(d, id, 6), 6, "6 SYNCs");
}

/// The count of SYNCs may begin anywhere.
std::string every_third_sync(Device& d) {
  const auto id = use_pdo(d, true, {map_statusword}, 3);
  d.operational();
  return expect_count(after_syncs(d, id, 9), 3, "9 SYNCs");
}

std::string only_sync(Device& d) {
  const auto id = use_pdo(d, true, {map_statusword}, 1);
  d.operational();
  d.bus.forget();
  d.control(0x06);
  d.control(0x00);
  d.bus.listen(100 * ms_ns);
  return expect_count(count(d, id), 0, "two changes without SYNC");
}

std::string acyclic_sync(Device& d) {
  const auto id = use_pdo(d, true, {map_statusword}, 0);
  d.operational();
  after_syncs(d, id, 2);
  const auto idle = after_syncs(d, id, 5);
  d.control(0x06);
  d.bus.listen(50 * ms_ns);
  const auto early = count(d, id) - idle;
  const auto changed = after_syncs(d, id, 3);
  const std::string seen = fmt::format("{} without a change, {} before the SYNC, {} after it", idle, early, changed);
  expect(idle == 0 && early == 0 && changed == 1, "0 without a change, 0 before the SYNC, 1 after it", seen);
  return seen;
}

template <int type>
std::string on_change(Device& d) {
  const auto id = use_pdo(d, true, {map_statusword}, type);
  d.operational();
  d.bus.listen(50 * ms_ns);
  d.bus.forget();
  d.control(0x06);
  d.bus.listen(100 * ms_ns);
  const auto seen = d.bus.heard(id);
  expect(!seen.empty(), fmt::format("a PDO {:03X}h when the statusword changes", id), "none in 100 ms");
  const auto word = d.status();
  const Frame& last = seen.back().frame;
  expect(last.size == 2 && decode(Type::u16, last.bytes()) == word, fmt::format("statusword {:04X}h", word),
         text(last));
  return text(last);
}

std::string event_timer(Device& d) {
  d.needs(od::tpdo_communication, 5);
  const auto id = use_pdo(d, true, {map_statusword}, 255);
  d.set(od::tpdo_communication, 5, 100);
  d.operational();
  d.bus.listen(20 * ms_ns);
  d.bus.forget();
  const bool enough = d.bus.until([&] { return count(d, id) >= 6; }, 2000 * ms_ns);
  expect(enough, "6 PDOs in 2 s", fmt::format("{}", count(d, id)));
  const auto all = d.bus.heard(id);
  const double period_ms =
      1e-6 * static_cast<double>(all.back().time_ns - all.front().time_ns) / static_cast<double>(all.size() - 1);
  const std::string seen = fmt::format("mean period {:.1f} ms", period_ms);
  expect(period_ms > 90 && period_ms < 110, "100 ms within 10 %", seen);
  return seen;
}

std::string inhibit_time(Device& d) {
  d.needs(od::tpdo_communication, 3);
  use_pdo(d, true, {map_statusword}, 255);
  d.set(od::tpdo_communication, 1, d.get(od::tpdo_communication, 1) | cob::off);
  d.set(od::tpdo_communication, 3, 1000);  // x 100 us
  const auto id = use_pdo(d, true, {map_statusword}, 255);
  d.operational();
  d.bus.listen(150 * ms_ns);
  d.bus.forget();
  for (int i = 0; i < 10; ++i) {
    d.control(i % 2 ? 0x00 : 0x06);
    d.bus.listen(20 * ms_ns);
  }
  const auto all = d.bus.heard(id);
  expect(!all.empty(), "PDOs for 10 changes", "none");
  for (std::size_t i = 1; i < all.size(); ++i) {
    const double gap_ms = 1e-6 * static_cast<double>(all[i].time_ns - all[i - 1].time_ns);
    expect(gap_ms > 80, "at least 100 ms between PDOs (less the jitter of a bus)", fmt::format("{:.1f} ms", gap_ms));
  }
  return fmt::format("{} PDOs for 10 changes in 200 ms", all.size());
}

std::string switched_off(Device& d) {
  const auto id = use_pdo(d, true, {map_statusword}, 1);
  d.set(od::tpdo_communication, 1, d.get(od::tpdo_communication, 1) | cob::off);
  d.operational();
  return expect_count(after_syncs(d, id, 5), 0, "5 SYNCs");
}

std::string remapped(Device& d) {
  d.needs(0x6064);
  const auto id = use_pdo(d, true, {0x60610008, 0x60640020, map_statusword}, 1);
  d.operational();
  d.bus.listen(20 * ms_ns);
  after_syncs(d, id, 1);
  const auto all = d.bus.heard(id);
  expect(!all.empty(), "a PDO", "none");
  const Frame& frame = all.back().frame;
  expect(frame.size == 7, "7 bytes: 6061h, 6064h, 6041h", text(frame));
  const auto bytes = frame.bytes();
  const auto mode = d.get_signed(0x6061), word = d.get(0x6041);
  expect(decode(Type::i8, bytes.first(1)) == mode && decode(Type::u16, bytes.subspan(5, 2)) == word,
         fmt::format("6061h = {}, 6041h = {:04X}h", mode, word), text(frame));
  return text(frame);
}

std::string other_sync(Device& d) {
  d.needs(od::cob_id_sync);
  const auto id = use_pdo(d, true, {map_statusword}, 1);
  if (d.refusal(od::cob_id_sync, 0, 0x0FF)) throw NotApplicable{"1005h accepts 080h only"};
  d.operational();
  const auto old = after_syncs(d, id, 3);
  d.bus.forget();
  for (int i = 0; i < 3; ++i) {
    d.bus.sync(0x0FF);
    d.bus.listen(20 * ms_ns);
  }
  const auto now = count(d, id);
  const std::string seen = fmt::format("{} for 080h, {} for 0FFh", old, now);
  expect(old == 0 && now == 3, "0 for 080h, 3 for 0FFh", seen);
  return seen;
}

// ---- Receive. Shutdown (6040h = 6) shows that a PDO was processed.

void send_word(Device& d, std::uint32_t id, std::vector<std::uint8_t> bytes) {
  d.bus.send(id, bytes);
  d.bus.listen(50 * ms_ns);
}

std::string rpdo(Device& d) {
  const auto id = use_pdo(d, false, {map_controlword}, 255);
  d.operational();
  send_word(d, id, {6, 0});
  d.expect_state(S::ready_to_switch_on);
  return "ready to switch on";
}

std::string rpdo_with_sync(Device& d) {
  const auto id = use_pdo(d, false, {map_controlword}, 1);
  d.operational();
  d.expect_state(S::switch_on_disabled);
  send_word(d, id, {6, 0});
  expect(d.state() == S::switch_on_disabled, "nothing before the SYNC", "the state changed");
  d.bus.sync();
  d.bus.listen(50 * ms_ns);
  d.expect_state(S::ready_to_switch_on);
  return "ready to switch on after the SYNC";
}

std::string rpdo_in_pre_operational(Device& d) {
  const auto id = use_pdo(d, false, {map_controlword}, 255);
  send_word(d, id, {6, 0});
  d.expect_state(S::switch_on_disabled);
  return "switch on disabled";
}

std::string rpdo_off(Device& d) {
  const auto id = use_pdo(d, false, {map_controlword}, 255);
  d.set(od::rpdo_communication, 1, d.get(od::rpdo_communication, 1) | cob::off);
  d.operational();
  send_word(d, id, {6, 0});
  d.expect_state(S::switch_on_disabled);
  return "switch on disabled";
}

std::string rpdo_short(Device& d) {
  const auto id = use_pdo(d, false, {map_controlword}, 255);
  d.operational();
  d.bus.listen(50 * ms_ns);
  d.bus.forget();
  send_word(d, id, {6});
  const auto codes = emergencies(d);
  expect(std::ranges::find(codes, 0x8210) != codes.end(), "EMCY 8210h", codes.empty() ? "none" : "others");
  d.expect_state(S::switch_on_disabled);
  return "EMCY 8210h, switch on disabled";
}

std::string rpdo_long(Device& d) {
  const auto id = use_pdo(d, false, {map_controlword}, 255);
  d.operational();
  send_word(d, id, {6, 0, 0, 0, 0, 0});
  d.expect_state(S::ready_to_switch_on);
  return "ready to switch on";
}

constexpr auto none = Needs::nothing;

constexpr Check checks[] = {
    {"pdo.every_sync", "CiA 301, 7.5.2.37", "Type 1: one TPDO for each SYNC.", none, every_sync},
    {"pdo.every_third_sync", "CiA 301, 7.5.2.37", "Type 3: one TPDO for three SYNCs.", none, every_third_sync},
    {"pdo.only_sync", "CiA 301, 7.5.2.37", "Type 1: no TPDO without SYNC.", none, only_sync},
    {"pdo.acyclic_sync", "CiA 301, 7.5.2.37", "Type 0: a TPDO with the SYNC after a change.", none, acyclic_sync},
    {"pdo.event_254", "CiA 301, 7.5.2.37", "Type 254: a TPDO when a mapped object changes.", none, on_change<254>},
    {"pdo.event_255", "CiA 402-2, TPDO 1", "Type 255: a TPDO when the statusword changes.", none, on_change<255>},
    {"pdo.event_timer", "CiA 301, 7.5.2.37", "The event timer sends a TPDO every 100 ms within 10 %.", none,
     event_timer},
    {"pdo.inhibit_time", "CiA 301, 7.5.2.37", "The inhibit time passes between two TPDOs.", none, inhibit_time},
    {"pdo.off", "CiA 301, 7.5.2.37", "A TPDO with bit 31 is not sent.", none, switched_off},
    {"pdo.remapped", "CiA 301, 7.5.2.38", "A new mapping has its objects in its order.", none, remapped},
    {"sync.identifier", "CiA 301, 7.5.2.5", "A new identifier in 1005h replaces 080h.", none, other_sync},
    {"rpdo.event", "CiA 301, 7.5.2.35", "Type 255: an RPDO takes effect at once.", none, rpdo},
    {"rpdo.with_sync", "CiA 301, 7.5.2.35", "Type 1: an RPDO takes effect with the next SYNC.", none, rpdo_with_sync},
    {"rpdo.pre_operational", "CiA 301, 7.3.2.2.2", "In pre-operational an RPDO has no effect.", none,
     rpdo_in_pre_operational},
    {"rpdo.off", "CiA 301, 7.5.2.35", "An RPDO with bit 31 has no effect.", none, rpdo_off},
    {"rpdo.short", "CiA 301, 7.2.2.5", "An RPDO with too few bytes: EMCY 8210h and no effect.", none, rpdo_short},
    {"rpdo.long", "CiA 301, 7.2.2.5", "An RPDO with more bytes than mapped takes effect.", none, rpdo_long},
};

}  // namespace

Checks pdo_checks() { return checks; }

}  // namespace tribotwin::hil
