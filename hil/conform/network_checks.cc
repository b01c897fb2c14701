#include <algorithm>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

std::string nmt_name(std::uint8_t state) { return fmt::format("heartbeat with state {:02X}h", state); }

std::string expect_nmt(Device& d, Nmt wanted) {
  const auto seen = d.nmt_state();
  expect(seen == static_cast<std::uint8_t>(wanted), nmt_name(static_cast<std::uint8_t>(wanted)), nmt_name(seen));
  return nmt_name(seen);
}

// ---- Start and NMT.

std::string boot_up(Device& d, NmtCommand command) {
  d.reset(command);
  const auto boots = d.bus.heard(cob::heartbeat + d.node());
  const auto& first = boots.front().frame;
  expect(first.size == 1 && first.data[0] == 0, fmt::format("{:03X}h#00 first", cob::heartbeat + d.node()),
         text(first));
  return text(first);
}

std::string pre_operational_after_boot(Device& d) {
  d.reset(NmtCommand::reset_node);
  d.hear_heartbeat();
  if (d.nmt_state() == static_cast<std::uint8_t>(Nmt::operational))
    throw NotApplicable{"the node starts by itself (CiA 302-2, 1F80h)"};
  return expect_nmt(d, Nmt::pre_operational) + ", SDO answers";
}

template <NmtCommand command, Nmt state>
std::string obeys(Device& d) {
  d.hear_heartbeat();
  for (const NmtCommand before : {NmtCommand::start, NmtCommand::stop, NmtCommand::enter_pre_operational}) {
    d.command(before);
    d.command(command);
    expect_nmt(d, state);
  }
  d.pre_operational();
  return nmt_name(static_cast<std::uint8_t>(state)) + ", from all three states";
}

/// Other nodes, seen by what a CANopen node sends: heartbeats and EMCY.
bool alone(Device& d) {
  d.bus.forget();
  d.bus.listen(1000 * ms_ns);
  return std::ranges::none_of(d.bus.heard(), [&](const HeardFrame& h) {
    const std::uint32_t node = h.frame.id & 0x7F, service = h.frame.id & 0x780;
    return node != 0 && node != d.node() && (service == cob::heartbeat || service == cob::emcy);
  });
}

std::string obeys_broadcast(Device& d) {
  if (!alone(d)) throw NotApplicable{"other nodes are on the bus"};
  d.hear_heartbeat();
  d.bus.nmt(NmtCommand::start, 0);
  d.bus.listen(20 * ms_ns);
  const auto seen = expect_nmt(d, Nmt::operational);
  d.pre_operational();
  return seen;
}

std::string ignores_other_node(Device& d) {
  d.hear_heartbeat();
  d.bus.nmt(NmtCommand::start, unused_node(d));
  d.bus.listen(20 * ms_ns);
  return expect_nmt(d, Nmt::pre_operational);
}

std::string ignores_unknown_command(Device& d) {
  d.hear_heartbeat();
  constexpr std::uint8_t unknown[] = {0x00, 0x03, 0x7F, 0x83, 0xFF};
  for (const std::uint8_t command : unknown) {
    d.bus.nmt(NmtCommand{command});
    d.bus.listen(20 * ms_ns);
    expect_nmt(d, Nmt::pre_operational);
  }
  return nmt_name(0x7F) + " after commands 00h, 03h, 7Fh, 83h, FFh";
}

std::string ignores_short_command(Device& d) {
  d.hear_heartbeat();
  const std::uint8_t start[] = {1};
  d.bus.send(cob::nmt, start);
  d.bus.listen(20 * ms_ns);
  return expect_nmt(d, Nmt::pre_operational);
}

// ---- Services of the states.

std::string no_sdo_in_stopped(Device& d) {
  d.command(NmtCommand::stop);
  const auto answer = d.bus.upload(od::device_type, 0);
  d.pre_operational();
  expect(!answer && answer.error().kind == SdoFailure::Kind::no_answer, "no SDO answer in stopped",
         answer ? "1000h was read" : answer.error().text());
  return "no answer";
}

std::string sdo_in_operational(Device& d) {
  d.operational();
  const auto value = hex(static_cast<std::uint64_t>(d.get(od::device_type)), 8);
  d.pre_operational();
  return "1000h = " + value;
}

template <NmtCommand state>
std::string no_pdo(Device& d) {
  const auto id = use_pdo(d, true, {map_statusword}, 1);
  d.command(state);
  d.bus.forget();
  for (int i = 0; i < 5; ++i) {
    d.bus.sync();
    d.bus.listen(20 * ms_ns);
  }
  const auto count = d.bus.heard(id).size();
  d.pre_operational();
  expect(count == 0, fmt::format("no PDO {:03X}h outside operational", id), fmt::format("{} for 5 SYNCs", count));
  return "none for 5 SYNCs";
}

std::string heartbeat_in_stopped(Device& d) {
  d.hear_heartbeat();
  d.command(NmtCommand::stop);
  const auto seen = expect_nmt(d, Nmt::stopped);
  d.pre_operational();
  return seen;
}

// ---- Resets.

/// A value other than the one that it has, for objects that every node and drive can change.
struct Changed {
  std::uint16_t index;
  std::int64_t before;
};
Changed change_heartbeat(Device& d) {
  d.needs(od::producer_heartbeat_time);
  const auto before = d.get(od::producer_heartbeat_time);
  d.set(od::producer_heartbeat_time, 0, before == 150 ? 200 : 150);
  return {od::producer_heartbeat_time, before};
}

std::string reset_takes_back(Device& d, NmtCommand command) {
  d.reset(command);
  const auto [index, before] = change_heartbeat(d);
  d.reset(command);
  const auto now = d.get(index);
  expect(now == before, fmt::format("1017h = {} as after the reset before", before), fmt::format("1017h = {}", now));
  return fmt::format("1017h = {}", now);
}

std::string reset_communication_keeps_application(Device& d) {
  const std::uint16_t index = od::quick_stop_option_code;
  d.needs(index);
  const auto before = d.get(index), other = before == 1 ? std::int64_t{2} : std::int64_t{1};
  if (d.refusal(index, 0, other)) throw NotApplicable{"605Ah has one value"};
  d.reset(NmtCommand::reset_communication);
  const auto now = d.get(index);
  expect(now == other, fmt::format("605Ah = {} as written before", other), fmt::format("605Ah = {}", now));
  return fmt::format("605Ah = {}", now);
}

// ---- Heartbeat.

/// Mean time between heartbeats [ms].
double heartbeat_period_ms(Device& d, int count, std::int64_t within_ns) {
  const std::uint32_t id = cob::heartbeat + d.node();
  d.bus.forget();
  const auto enough = [&] { return d.bus.heard(id).size() > static_cast<std::size_t>(count); };
  expect(d.bus.until(enough, within_ns), fmt::format("{} heartbeats in {} ms", count + 1, within_ns / ms_ns),
         fmt::format("{}", d.bus.heard(id).size()));
  const auto all = d.bus.heard(id);
  return 1e-6 * static_cast<double>(all.back().time_ns - all.front().time_ns) / static_cast<double>(all.size() - 1);
}

std::string expect_period(Device& d, int period_ms, int count) {
  const double seen = heartbeat_period_ms(d, count, 2 * (count + 1) * period_ms * ms_ns);
  const std::string text = fmt::format("mean of {} periods {:.1f} ms", count, seen);
  expect(seen > 0.9 * period_ms && seen < 1.1 * period_ms, fmt::format("{} ms within 10 %", period_ms), text);
  return text;
}

std::string heartbeat_period(Device& d) {
  d.needs(od::producer_heartbeat_time);
  d.set(od::producer_heartbeat_time, 0, 100);
  return expect_period(d, 100, 10);
}

std::string heartbeat_change(Device& d) {
  d.needs(od::producer_heartbeat_time);
  d.set(od::producer_heartbeat_time, 0, 2000);
  d.set(od::producer_heartbeat_time, 0, 150);
  return expect_period(d, 150, 5);
}

std::string heartbeat_off(Device& d) {
  d.hear_heartbeat();
  d.set(od::producer_heartbeat_time, 0, 0);
  d.bus.listen(60 * ms_ns);
  d.bus.forget();
  d.bus.listen(600 * ms_ns);
  const auto count = d.bus.heard(cob::heartbeat + d.node()).size();
  expect(count == 0, "no heartbeat with 1017h = 0", fmt::format("{} in 600 ms", count));
  return "none in 600 ms";
}

std::string heartbeat_frame(Device& d) {
  d.hear_heartbeat();
  d.nmt_state();
  const Frame frame = d.bus.heard(cob::heartbeat + d.node()).front().frame;
  expect(frame.size == 1 && !(frame.data[0] & 0x80), "one byte, bit 7 clear", text(frame));
  return text(frame);
}

// ---- Identifiers.

std::string expect_identifier(Device& d, std::uint16_t index, std::uint8_t sub, std::uint32_t wanted) {
  d.needs(index, sub);
  const auto entry = static_cast<std::uint32_t>(d.get(index, sub));
  const std::string seen = fmt::format("{} = {:08X}h", object_name(index, sub), entry);
  expect((entry & cob::id_29_bit) == wanted, fmt::format("{} names {:03X}h", object_name(index, sub), wanted), seen);
  return seen;
}

std::string emcy_identifier(Device& d) { return expect_identifier(d, od::cob_id_emcy, 0, cob::emcy + d.node()); }

std::string sdo_identifiers(Device& d) {
  return expect_identifier(d, od::sdo_server_parameter, 1, cob::sdo_to_server + d.node()) + ", " +
         expect_identifier(d, od::sdo_server_parameter, 2, cob::sdo_to_client + d.node());
}

/// A PDO that does not exist (bit 31) may have any identifier.
std::string pdo_identifiers(Device& d) {
  d.reset(NmtCommand::reset_node);
  std::vector<std::string> seen;
  for (int i = 0; i < 4; ++i)
    for (const bool transmit : {false, true}) {
      const auto index = static_cast<std::uint16_t>((transmit ? od::tpdo_communication : od::rpdo_communication) + i);
      if (!d.has(index, 1) || (d.get(index, 1) & cob::off)) continue;
      const auto wanted = (transmit ? cob::tpdo(i) : cob::rpdo(i)) + d.node();
      seen.push_back(expect_identifier(d, index, 1, wanted));
    }
  if (seen.empty()) throw NotApplicable{"no PDO exists after a reset"};
  return fmt::format("{}", fmt::join(seen, ", "));
}

constexpr auto none = Needs::nothing;
using C = NmtCommand;

constexpr Check checks[] = {
    {"nmt.boot_up", "CiA 301, 7.2.8.3.3", "After reset node the boot-up message comes first, one byte 0.", none,
     [](Device& d) { return boot_up(d, C::reset_node); }},
    {"nmt.boot_up_communication", "CiA 301, 7.2.8.3.3",
     "After reset communication the boot-up message comes first, one byte 0.", none,
     [](Device& d) { return boot_up(d, C::reset_communication); }},
    {"nmt.pre_operational", "CiA 301, 7.3.2.2.2", "After boot-up the node is pre-operational and its SDO answers.",
     none, pre_operational_after_boot},
    {"nmt.start", "CiA 301, 7.2.8.3.1.1", "Start leads to operational from every state.", none,
     obeys<C::start, Nmt::operational>},
    {"nmt.stop", "CiA 301, 7.2.8.3.1.2", "Stop leads to stopped from every state.", none, obeys<C::stop, Nmt::stopped>},
    {"nmt.enter_pre_operational", "CiA 301, 7.2.8.3.1.3",
     "Enter pre-operational leads to pre-operational from every state.", none,
     obeys<C::enter_pre_operational, Nmt::pre_operational>},
    {"nmt.broadcast", "CiA 301, 7.2.8.3.1", "A command to node 0 is obeyed.", none, obeys_broadcast},
    {"nmt.other_node", "CiA 301, 7.2.8.3.1", "A command to another node is ignored.", none, ignores_other_node},
    {"nmt.unknown_command", "CiA 301, 7.2.8.3.1", "An unknown command is ignored.", none, ignores_unknown_command},
    {"nmt.short_command", "CiA 301, 7.2.8.3.1", "A command of one byte is ignored.", none, ignores_short_command},
    {"nmt.no_sdo_in_stopped", "CiA 301, 7.3.2.2.4", "In stopped the SDO server is silent.", none, no_sdo_in_stopped},
    {"nmt.sdo_in_operational", "CiA 301, 7.3.2.2.3", "In operational the SDO server answers.", none,
     sdo_in_operational},
    {"nmt.no_pdo_in_pre_operational", "CiA 301, 7.3.2.2.2", "In pre-operational no PDO is sent.", none,
     no_pdo<C::enter_pre_operational>},
    {"nmt.no_pdo_in_stopped", "CiA 301, 7.3.2.2.4", "In stopped no PDO is sent.", none, no_pdo<C::stop>},
    {"nmt.heartbeat_in_stopped", "CiA 301, 7.3.2.2.4", "In stopped the heartbeat goes on.", none, heartbeat_in_stopped},
    {"nmt.reset_node_restores", "CiA 301, 7.3.2.2.1", "Reset node restores 1017h.", none,
     [](Device& d) { return reset_takes_back(d, C::reset_node); }},
    {"nmt.reset_communication_restores", "CiA 301, 7.3.2.2.1", "Reset communication restores 1017h.", none,
     [](Device& d) { return reset_takes_back(d, C::reset_communication); }},
    {"nmt.reset_communication_keeps", "CiA 301, 7.3.2.2.1", "Reset communication keeps the objects from 2000h on.",
     none, reset_communication_keeps_application},
    {"heartbeat.period", "CiA 301, 7.5.2.20", "1017h = 100 ms is kept within 10 %.", none, heartbeat_period},
    {"heartbeat.change", "CiA 301, 7.5.2.20", "A new 1017h takes effect at once.", none, heartbeat_change},
    {"heartbeat.off", "CiA 301, 7.5.2.20", "1017h = 0 switches the heartbeat off.", none, heartbeat_off},
    {"heartbeat.frame", "CiA 301, 7.2.8.3.2.2", "A heartbeat is one byte, bit 7 clear.", none, heartbeat_frame},
    {"cob_id.emcy", "CiA 301, 7.3.3", "EMCY has 080h + node.", none, emcy_identifier},
    {"cob_id.sdo", "CiA 301, 7.3.3", "The SDO server has 600h and 580h + node.", none, sdo_identifiers},
    {"cob_id.pdo", "CiA 301, 7.3.3", "After a reset PDOs 1 to 4 that exist have 180h to 500h + node.", none,
     pdo_identifiers},
};

}  // namespace

Checks network_checks() { return checks; }

std::uint8_t unused_node(const Device& device) {
  for (std::uint8_t node = 127; node > 1; --node)
    if (node != device.node() &&
        std::ranges::none_of(device.bus.heard(), [&](const HeardFrame& h) { return (h.frame.id & 0x7F) == node; }))
      return node;
  return 1;
}

}  // namespace tribotwin::hil
