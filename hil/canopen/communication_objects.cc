#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/communication_objects.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil {
namespace {

using T = Type;
constexpr std::int64_t user_data_bytes = 4096;
constexpr Access ro = Access::read_only, rw = Access::read_write, constant = Access::constant;

void add_pdo(std::vector<Object>& o, const DefaultPdo& pdo, bool transmit, int number) {
  const std::string name = fmt::format("{}PDO{}", transmit ? "T" : "R", number + 1);
  const od::Index at = pdo_index(transmit, number);
  const od::Index map = od::mapping_of(at);
  add(o, {at, 0, name + " highest sub-index", T::u8, constant, false, transmit ? 6 : 5});
  add(o, {at, 1, name + " COB-ID", T::u32, rw, false, pdo.cob},
      {.meaning = "bit 31: the PDO does not exist", .plus_node = (pdo.cob & cob::id_11_bit) != 0});
  add(o, {at, 2, name + " transmission type", T::u8, rw, false, pdo.type},
      {.meaning = "0: SYNC, on change; 1..240: every n-th SYNC; 254, 255: event"});
  if (transmit) add(o, {at, 3, name + " inhibit time", T::u16, rw, false, 0}, {.scale = 1e-4, .unit = "s"});
  add(o, {at, 5, name + (transmit ? " event timer" : " deadline"), T::u16, rw, false, 0},
      {.scale = 1e-3,
       .unit = "s",
       .meaning = transmit ? "0: none" : "0: none; without the PDO for so long: abort connection (6007h)"});
  if (transmit)
    add(o, {at, 6, name + " SYNC start value", T::u8, rw, false, 0, 0, 240},
        {.meaning = "counter of the SYNC with which it begins; 0: with any"});
  add(o, {map, 0, name + " mapped objects", T::u8, rw, false, static_cast<std::int64_t>(pdo.map.size()), 0, pdo_bytes});
  for (std::size_t k = 0; k < pdo_bytes; ++k)
    add(o,
        {map, static_cast<std::uint8_t>(k + 1), fmt::format("{} object {}", name, k + 1), T::u32, rw, false,
         k < pdo.map.size() ? pdo.map[k].value() : 0},
        {.meaning = "index, sub-index, bits"});
}

void add_identity(std::vector<Object>& o, std::uint32_t serial_number) {
  add(o, {od::identity, 0, "highest sub-index", T::u8, constant, false, 4});
  add(o, {od::identity, 1, "vendor", T::u32, constant});
  add(o, {od::identity, 2, "product", T::u32, constant, false, 0x7477});
  add(o, {od::identity, 3, "revision", T::u32, constant, false, 0x00010000});
  add(o, {od::identity, 4, "serial number", T::u32, constant, false, serial_number});
}

/// Areas of the parameters that a drive stores and restores.
void add_store(std::vector<Object>& o) {
  constexpr const char* areas[] = {"all", "communication", "application", "manufacturer"};
  for (const od::Index index : {od::store_parameters, od::restore_default_parameters}) {
    const bool store = index == od::store_parameters;
    add(o, {index, 0, "highest sub-index", T::u8, constant, false, 4});
    for (std::uint8_t i = 1; i <= 4; ++i)
      add(o,
          {index, i, fmt::format("{} {} parameters", store ? "store" : "restore", areas[i - 1]), T::u32, rw, false, 0},
          {.meaning = store ? "\"save\" keeps them; 1: it can (--store), 0: it cannot"
                            : "\"load\": their defaults after the next reset"});
  }
}

}  // namespace

void add_communication_objects(std::vector<Object>& o, const DriveParameters& p, std::uint32_t device_type,
                               const DefaultPdos& pdos) {
  const auto node = p.node;
  add(o, {od::device_type, 0, "device type", T::u32, constant, false, device_type},
      {.meaning = "servo drive, CiA 402"});
  add(o, {od::error_register, 0, "error register", T::u8, ro, true});
  add(o, {od::predefined_error_field, 0, "number of errors", T::u8, rw, false, 0},
      {.meaning = "writing 0 clears the history"});
  for (std::uint8_t i = 1; i <= 8; ++i)
    add(o, {od::predefined_error_field, i, fmt::format("error {}", i), T::u32, ro}, {.meaning = "newest first"});
  add(o, {od::cob_id_sync, 0, "COB-ID SYNC", T::u32, rw, false, cob::sync, cob::sync, cob::sync});
  add(o, {od::communication_cycle_period, 0, "communication cycle period", T::u32, rw, false, p.cycle_us, 0, 1000000},
      {.scale = 1e-6, .unit = "s", .meaning = "simulated time of one SYNC in lockstep"});
  add(o, {od::device_name, 0, "device name", T::text, constant},
      {.text = "tribotwin drive " + twin::printable(p.name)});
  add(o, {od::hardware_version, 0, "hardware version", T::text, constant}, {.text = "simulated"});
  add(o, {od::software_version, 0, "software version", T::text, constant}, {.text = "tribotwin 0.1"});
  add(o, {od::guard_time, 0, "guard time", T::u16, rw},
      {.scale = 1e-3,
       .unit = "s",
       .meaning = "of node guarding, which needs 1017h = 0; 0: the drive does not watch it"});
  add(o, {od::life_time_factor, 0, "life time factor", T::u8, rw},
      {.meaning = "guard times without a request until commands count as lost; 0: the drive does not watch it"});
  add_store(o);
  add(o, {od::cob_id_time, 0, "COB-ID TIME", T::u32, rw, false, cob::consumes | cob::time_stamp},
      {.meaning = "bit 31: the time is taken, shown by 2181h"});
  add(o, {od::cob_id_emcy, 0, "COB-ID EMCY", T::u32, ro, false, cob::emcy + node}, {.plus_node = true});
  add(o, {od::inhibit_time_emcy, 0, "inhibit time EMCY", T::u16, rw}, {.scale = 1e-4, .unit = "s"});
  add(o, {od::consumer_heartbeat_time, 0, "heartbeats watched", T::u8, constant, false, 2});
  for (std::uint8_t i = 1; i <= 2; ++i)
    add(o, {od::consumer_heartbeat_time, i, fmt::format("heartbeat watched {}", i), T::u32, rw, false, 0, 0, 0x7fffff},
        {.meaning = "65536 x node + time [ms]; 0: none"});
  add(o, {od::producer_heartbeat_time, 0, "heartbeat time", T::u16, rw, false, 500},
      {.scale = 1e-3, .unit = "s", .meaning = "0: none"});
  add_identity(o, p.serial_number ? p.serial_number : node);
  add(o, {od::synchronous_counter_overflow, 0, "synchronous counter overflow", T::u8, rw, false, 0, 0, 240},
      {.meaning = "0: SYNC without a counter; changes while 1006h is 0"});
  add(o, {od::store_eds, 0, "store EDS", T::domain, ro}, {.meaning = "the EDS of this drive"});
  add(o, {od::store_format, 0, "store format", T::u16, constant}, {.meaning = "ASCII, not compressed"});
  add(o, {od::error_behavior, 0, "highest sub-index", T::u8, constant, false, 1});
  add(o, {od::error_behavior, 1, "reaction to communication errors", T::u8, rw, false, 0, 0, 2},
      {.meaning = "0: pre-operational, 1: none, 2: stopped"});
  add(o, {od::sdo_server_parameter, 0, "highest sub-index", T::u8, constant, false, 2});
  add(o, {od::sdo_server_parameter, 1, "COB-ID SDO to the drive", T::u32, constant, false, cob::sdo_to_server + node},
      {.plus_node = true});
  add(o, {od::sdo_server_parameter, 2, "COB-ID SDO from the drive", T::u32, constant, false, cob::sdo_to_client + node},
      {.plus_node = true});
  for (int i = 0; i < pdo_count; ++i) {
    add_pdo(o, pdos.receive[static_cast<std::size_t>(i)], false, i);
    add_pdo(o, pdos.transmit[static_cast<std::size_t>(i)], true, i);
  }
  add(o, {od::user_data, 0, "user data", T::domain, rw, false, 0, 0, user_data_bytes},
      {.meaning = "memory for the master, at most 4096 bytes"});
  add(o, {od::time_of_day, 0, "highest sub-index", T::u8, constant, false, 2});
  add(o, {od::time_of_day, 1, "time after midnight", T::u32, ro},
      {.scale = 1e-3, .unit = "s", .meaning = "of TIME, continued"});
  add(o, {od::time_of_day, 2, "days since 1984-01-01", T::u16, ro});
}

std::uint16_t pdo_index(bool transmit, int number) {
  return static_cast<od::Index>((transmit ? od::tpdo_communication : od::rpdo_communication) + number);
}

PdoParameters pdo_parameters(const Dictionary& d, bool transmit, int number) {
  const od::Index index = pdo_index(transmit, number), map = od::mapping_of(index);
  const auto entry = d.get(index, 1);
  PdoParameters pdo{.exists = !(entry & cob::off),
                    .cob = static_cast<std::uint32_t>(entry) & cob::id_11_bit,
                    .type = static_cast<std::uint8_t>(d.get(index, 2)),
                    .map = {}};
  for (std::uint8_t k = 1; k <= d.get(map, 0); ++k) pdo.map.push_back(MappingEntry::of(d.get(map, k)));
  return pdo;
}

}  // namespace tribotwin::hil
