#include <algorithm>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

using Codes = std::vector<std::uint32_t>;

constexpr std::uint32_t no_object = 0x06020000, not_mappable = 0x06040041, too_many = 0x06040042,
                        no_sub_index = 0x06090011, out_of_range = 0x06090030;

constexpr std::uint16_t communication(bool transmit) {
  return transmit ? od::tpdo_communication : od::rpdo_communication;
}

std::int64_t entry(Device& d, bool transmit) {
  d.needs(communication(transmit), 1);
  return d.get(communication(transmit), 1);
}

/// The first PDO exists, with an object: some devices refuse to switch on an empty one.
void switch_on(Device& d, bool transmit) {
  d.needs(communication(transmit), 1);
  const std::uint16_t map = od::mapping_of(communication(transmit));
  if (d.has(map) && d.get(map, 0) == 0) {
    use_pdo(d, transmit, {transmit ? map_statusword : map_controlword}, 255);
    return;
  }
  const auto now = entry(d, transmit);
  const auto id = (transmit ? cob::tpdo(0) : cob::rpdo(0)) + d.node();
  if (now & cob::off) d.set(communication(transmit), 1, (now & cob::no_rtr) | id);
}

void switch_off(Device& d, bool transmit) { d.set(communication(transmit), 1, entry(d, transmit) | cob::off); }

/// The mapping of the first PDO is empty, and can be filled.
std::uint16_t empty_mapping(Device& d, bool transmit) {
  switch_off(d, transmit);
  const std::uint16_t map = od::mapping_of(communication(transmit));
  d.needs(map);
  if (const auto code = d.refusal(map, 0, 0))
    throw NotApplicable{fmt::format("{} is fixed (abort {:08X}h)", object_name(map, 0), *code)};
  return map;
}

constexpr bool both[] = {false, true};

std::string mapping_while_existing(Device& d) {
  std::string seen;
  for (const bool transmit : both) {
    empty_mapping(d, transmit);
    d.restore();
    switch_on(d, transmit);
    const std::uint16_t map = od::mapping_of(communication(transmit));
    seen = d.expect_refused(map, 0, 0, {});
  }
  return seen;
}

std::string entry_while_counted(Device& d) {
  std::string seen;
  for (const bool transmit : both) {
    d.needs(transmit ? od::statusword : od::controlword);
    const std::uint16_t map = empty_mapping(d, transmit);
    d.set(map, 1, transmit ? map_statusword : map_controlword);
    d.set(map, 0, 1);
    const std::uint32_t other = transmit ? 0x60640020 : 0x607A0020;
    if (!d.has(static_cast<std::uint16_t>(other >> 16))) continue;
    seen = d.expect_refused(map, 1, other, {});
  }
  return seen;
}

/// Refused as soon as the device can know: with the entry or with the count.
std::string refused_entry(Device& d, bool transmit, std::uint32_t value, const Codes& codes) {
  if (MappingEntry::of(value).index == od::statusword) d.needs(od::statusword);
  const std::uint16_t map = empty_mapping(d, transmit);
  if (const auto code = d.refusal(map, 1, value)) {
    expect(std::ranges::find(codes, *code) != codes.end(),
           fmt::format("{:08X}h in {} ends with abort {:08X}h", value, object_name(map, 1), codes.front()),
           fmt::format("abort {:08X}h", *code));
    return fmt::format("abort {:08X}h", *code);
  }
  return d.expect_refused(map, 0, 1, codes);
}

std::string map_unknown(Device& d) {
  refused_entry(d, false, 0x5FFF0010, {no_object, not_mappable});
  return refused_entry(d, true, 0x5FFF0010, {no_object, not_mappable});
}

std::string map_unknown_sub_index(Device& d) {
  return refused_entry(d, true, 0x60415510, {no_sub_index, no_object, not_mappable});
}

std::string map_not_mappable(Device& d) { return refused_entry(d, true, 0x10180120, {not_mappable}); }

std::string map_read_only(Device& d) { return refused_entry(d, false, map_statusword, {not_mappable, 0x06010002}); }

std::string map_wrong_length(Device& d) {
  return refused_entry(d, true, 0x60410020, {not_mappable, 0x06070010, 0x06070012, out_of_range});
}

std::string map_too_long(Device& d) {
  const std::uint16_t map = empty_mapping(d, true);
  constexpr std::uint32_t position = 0x60640020;
  d.needs(0x6064);
  for (std::uint8_t sub = 1; sub <= 3; ++sub) {
    d.needs(map, sub);
    if (const auto code = d.refusal(map, sub, position)) {
      expect(*code == too_many, fmt::format("12 bytes end with abort {:08X}h", too_many),
             fmt::format("abort {:08X}h", *code));
      return fmt::format("abort {:08X}h with entry {}", *code, sub);
    }
  }
  return d.expect_refused(map, 0, 3, {too_many});
}

std::string identifier_while_existing(Device& d) {
  std::string seen;
  for (const bool transmit : both) {
    switch_on(d, transmit);
    const auto now = entry(d, transmit);
    const auto other = (now & ~std::int64_t{cob::id_29_bit}) | (0x680 + d.node() % 0x50);
    seen = d.expect_refused(communication(transmit), 1, other, {});
  }
  return seen;
}

/// CiA 301, table 40 (7.3.5).
std::string restricted(Device& d) {
  constexpr std::uint32_t ids[] = {0x000, 0x001, 0x07F, 0x101, 0x180, 0x581, 0x5FF, 0x601,
                                   0x67F, 0x6E0, 0x6FF, 0x701, 0x77F, 0x780, 0x7FF};
  for (const bool transmit : both) {
    switch_on(d, transmit);  // so that the identifier is the only thing to refuse
    switch_off(d, transmit);
    const auto flags = entry(d, transmit) & cob::no_rtr;
    for (const auto id : ids) d.expect_refused(communication(transmit), 1, flags | id, {out_of_range});
  }
  return fmt::format("{} identifiers refused", std::size(ids));
}

std::string unrestricted(Device& d) {
  constexpr std::uint32_t ids[] = {0x181, 0x57F, 0x680, 0x6DF};
  for (const bool transmit : both) {
    switch_on(d, transmit);  // so that the identifier is the only thing to refuse
    switch_off(d, transmit);
    const auto flags = entry(d, transmit) & cob::no_rtr;
    for (const auto id : ids) {
      const std::string name = fmt::format("{} accepts {:03X}h", object_name(communication(transmit), 1), id);
      const auto code = d.refusal(communication(transmit), 1, flags | id);
      expect(!code, name, code ? fmt::format("abort {:08X}h", *code) : "");
      switch_off(d, transmit);
    }
  }
  return "181h, 57Fh, 680h, 6DFh accepted";
}

std::string inhibit_while_existing(Device& d) {
  d.needs(od::tpdo_communication, 3);
  switch_on(d, true);
  return d.expect_refused(od::tpdo_communication, 3, d.get(od::tpdo_communication, 3) + 10, {});
}

std::string transmission_types(Device& d) {
  for (const bool transmit : both)
    for (const int type : {241, 251}) {
      entry(d, transmit);
      d.expect_refused(communication(transmit), 2, type, {out_of_range, 0x06090031});
    }
  return "241 and 251 refused";
}

std::string off_and_on(Device& d) {
  for (const bool transmit : both) {
    switch_on(d, transmit);
    switch_off(d, transmit);
    expect(entry(d, transmit) & cob::off, object_name(communication(transmit), 1) + " with bit 31", "bit 31 clear");
    switch_on(d, transmit);
    expect(!(entry(d, transmit) & cob::off), object_name(communication(transmit), 1) + " without bit 31", "bit 31 set");
  }
  return "bit 31 as written";
}

constexpr auto none = Needs::nothing;

constexpr Check checks[] = {
    {"pdo.off_and_on", "CiA 301, 7.5.2.35", "Bit 31 of the COB-ID switches a PDO off and on.", none, off_and_on},
    {"pdo.mapping_while_existing", "CiA 301, 7.5.2.36", "The mapping of a PDO that exists cannot be changed.", none,
     mapping_while_existing},
    {"pdo.entry_while_counted", "CiA 301, 7.5.2.36", "A mapping entry cannot be changed while :00 is not 0.", none,
     entry_while_counted},
    {"pdo.map_unknown_object", "CiA 301, 7.5.2.36",
     "Mapping an object that does not exist: abort 06020000h or 06040041h.", none, map_unknown},
    {"pdo.map_unknown_sub_index", "CiA 301, 7.5.2.36",
     "Mapping a sub-index that does not exist: abort 06090011h, 06020000h or 06040041h.", none, map_unknown_sub_index},
    {"pdo.map_not_mappable", "CiA 301, 7.5.2.38", "Mapping 1018h: abort 06040041h.", none, map_not_mappable},
    {"pdo.map_read_only", "CiA 301, 7.5.2.36", "Mapping a read-only object into an RPDO: abort 06040041h or 06010002h.",
     none, map_read_only},
    {"pdo.map_wrong_length", "CiA 301, 7.5.2.38", "Mapping 6041h with 32 bits is refused.", none, map_wrong_length},
    {"pdo.map_too_long", "CiA 301, 7.5.2.38", "Mapping 12 bytes: abort 06040042h.", none, map_too_long},
    {"pdo.identifier_while_existing", "CiA 301, 7.5.2.35", "The identifier of a PDO that exists cannot be changed.",
     none, identifier_while_existing},
    {"pdo.restricted_identifiers", "CiA 301, 7.3.5", "Restricted identifiers: abort 06090030h.", none, restricted},
    {"pdo.free_identifiers", "CiA 301, 7.3.5", "Identifiers beside the restricted ones are accepted.", none,
     unrestricted},
    {"pdo.inhibit_while_existing", "CiA 301, 7.5.2.37", "The inhibit time of a PDO that exists cannot be changed.",
     none, inhibit_while_existing},
    {"pdo.transmission_types", "CiA 301, 7.5.2.35", "Reserved transmission types: abort 06090030h.", none,
     transmission_types},
};

}  // namespace

Checks pdo_parameter_checks() { return checks; }

/// Refusals of parts of a fixed PDO make a check not applicable; other defects of the way are found by
/// pdo_parameter_checks.
std::uint32_t use_pdo(Device& d, bool transmit, std::vector<std::uint32_t> mapping, int type) {
  const std::uint16_t index = communication(transmit), map = od::mapping_of(index);
  const auto id = (transmit ? cob::tpdo(0) : cob::rpdo(0)) + d.node();
  const auto flags = entry(d, transmit) & cob::no_rtr;
  switch_off(d, transmit);
  const auto write = [&](std::uint16_t object, std::uint8_t sub, std::int64_t value) {
    if (d.get(object, sub) == value) return;
    if (const auto code = d.refusal(object, sub, value))
      throw NotApplicable{fmt::format("{} := {:X}h: abort {:08X}h", object_name(object, sub), value, *code)};
  };
  write(map, 0, 0);
  std::uint8_t count = 0;
  for (const auto object : mapping) write(map, ++count, object);
  write(map, 0, count);
  write(index, 2, type);
  write(index, 1, flags | id);
  return id;
}

}  // namespace tribotwin::hil
