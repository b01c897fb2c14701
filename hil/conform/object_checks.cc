#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

using Codes = std::vector<std::uint32_t>;
constexpr std::uint32_t read_only = 0x06010002, no_sub_index = 0x06090011;

std::string list_of(const std::vector<std::string>& names) { return fmt::format("{}", fmt::join(names, ", ")); }

std::string device_type(Device& d) {
  const auto type = static_cast<std::uint32_t>(d.get(od::device_type));
  const std::string seen = fmt::format("1000h = {:08X}h", type);
  expect((type & 0xFFFF) == 402, "1000h with 402 (0192h) in its lower half", seen);
  return seen;
}

/// CiA 402-2, 1000h: bits 16 to 18 frequency converter, servo drive, stepper motor.
std::string drive_type(Device& d) {
  const auto type = static_cast<std::uint32_t>(d.get(od::device_type));
  const std::string seen = fmt::format("1000h = {:08X}h", type);
  expect((type >> 16 & 0x7F) != 0, "1000h with a drive type in bits 16 to 22", seen);
  return seen;
}

std::string expect_all(Device& d, std::initializer_list<std::pair<std::uint16_t, std::uint8_t>> objects) {
  std::vector<std::string> there, missing;
  for (const auto& [index, sub] : objects) (d.has(index, sub) ? there : missing).push_back(object_name(index, sub));
  expect(missing.empty(), "the objects " + list_of(there) + (there.empty() ? "" : ", ") + list_of(missing),
         "missing: " + list_of(missing));
  return list_of(there);
}

std::string error_control(Device& d) {
  expect(d.has(od::producer_heartbeat_time) || d.has(0x100C), "1017h or 100Ch", "neither");
  return d.has(od::producer_heartbeat_time) ? "1017h" : "100Ch";
}

std::string no_error(Device& d) {
  const auto value = d.get(od::error_register);
  expect(!(value & 1), "1001h with bit 0 clear, without an error", fmt::format("1001h = {:02X}h", value));
  return fmt::format("1001h = {:02X}h", value);
}

/// Arrays and records of CiA 301 and 402 whose last entry has the number in :00.
std::string highest_sub_indices(Device& d) {
  std::vector<std::string> seen;
  constexpr std::uint16_t indices[] = {0x1016, 0x1018, 0x1029, 0x1200, 0x1400, 0x1800, 0x607D, 0x608F, 0x6091, 0x60C2};
  for (const std::uint16_t index : indices) {
    if (!d.has(index)) continue;
    const auto highest = d.get(index);
    expect(highest >= 1 && highest <= 254 && d.has(index, static_cast<std::uint8_t>(highest)),
           fmt::format("{:04X}h:00 names the last entry", index), fmt::format("{}, which is not there", highest));
    const auto beyond = d.bus.upload(index, static_cast<std::uint8_t>(highest + 1));
    expect(!beyond && beyond.error().code == no_sub_index,
           fmt::format("{} ends with abort {:08X}h", object_name(index, static_cast<std::uint8_t>(highest + 1)),
                       no_sub_index),
           beyond ? "a value" : beyond.error().text());
    seen.push_back(fmt::format("{:04X}h: {}", index, highest));
  }
  return list_of(seen);
}

std::string names(Device& d) {
  std::vector<std::string> seen;
  for (const std::uint16_t index : {od::device_name, od::hardware_version, od::software_version}) {
    if (!d.has(index)) continue;
    const Bytes text = d.bytes(index);
    expect(std::ranges::all_of(text, [](std::uint8_t c) { return c == 0 || (c >= 0x20 && c <= 0x7E); }),
           fmt::format("{:04X}h in ASCII", index), "other bytes");
    seen.push_back(fmt::format("{:04X}h \"{}\"", index, std::string(text.begin(), std::ranges::find(text, 0))));
  }
  if (seen.empty()) throw NotApplicable{"there is none of 1008h, 1009h, 100Ah"};
  return list_of(seen);
}

std::string expect_read_only(Device& d, std::initializer_list<std::uint16_t> indices) {
  std::vector<std::string> seen;
  for (const auto index : indices) {
    if (!d.has(index)) continue;
    d.expect_refused(index, 0, 0, Codes{read_only});
    seen.push_back(fmt::format("{:04X}h", index));
  }
  return list_of(seen) + ": abort 06010002h";
}

/// Lengths of CiA 301 and 402-2 in bytes.
std::string lengths(Device& d) {
  constexpr std::pair<std::uint16_t, std::size_t> standard[] = {
      {0x1000, 4}, {0x1001, 1}, {0x1005, 4}, {0x1006, 4}, {0x1014, 4}, {0x1017, 2}, {0x6007, 2}, {0x603F, 2},
      {0x6040, 2}, {0x6041, 2}, {0x605A, 2}, {0x605B, 2}, {0x605C, 2}, {0x605D, 2}, {0x605E, 2}, {0x6060, 1},
      {0x6061, 1}, {0x6062, 4}, {0x6064, 4}, {0x6065, 4}, {0x6066, 2}, {0x606C, 4}, {0x6071, 2}, {0x6072, 2},
      {0x6074, 2}, {0x6076, 4}, {0x6077, 2}, {0x607A, 4}, {0x6080, 4}, {0x6081, 4}, {0x6083, 4}, {0x6084, 4},
      {0x6085, 4}, {0x6098, 1}, {0x60B1, 4}, {0x60B2, 2}, {0x60F4, 4}, {0x60FD, 4}, {0x60FF, 4}, {0x6502, 4}};
  int count = 0;
  for (const auto& [index, size] : standard) {
    if (!d.has(index)) continue;
    const auto seen = d.bytes(index).size();
    expect(seen == size, fmt::format("{:04X}h with {} bytes", index, size), fmt::format("{}", seen));
    ++count;
  }
  return fmt::format("{} objects", count);
}

/// What the modes that 6502h names cannot do without (CiA 402-2, the object lists of the modes).
std::string objects_of_modes(Device& d) {
  static const std::pair<int, std::vector<std::uint16_t>> needed[] = {
      {1, {0x607A, 0x6064, 0x6081, 0x6083}},
      {3, {0x60FF, 0x606C, 0x6083}},
      {4, {0x6071, 0x6077}},
      {6, {0x6098, 0x6099}},
      {7, {0x60C1, 0x6064}},
      {8, {0x607A, 0x6064}},
      {9, {0x60FF, 0x606C}},
      {10, {0x6071, 0x6077}},
  };
  std::vector<std::string> modes, missing;
  for (const auto& [mode, objects] : needed) {
    if (!d.supports(mode)) continue;
    modes.push_back(fmt::format("mode {}", mode));
    for (const auto index : objects)
      if (!d.has(index)) missing.push_back(fmt::format("{:04X}h of mode {}", index, mode));
  }
  expect(missing.empty(), "the objects of all modes in 6502h", "missing: " + list_of(missing));
  return list_of(modes);
}

constexpr auto none = Needs::nothing;

constexpr Check checks[] = {
    {"objects.profile", "CiA 301, 7.5.2.1; CiA 402-2, 1000h", "1000h names the profile 402.", none, device_type},
    {"objects.drive_type", "CiA 402-2, 1000h", "1000h names a type of drive.", none, drive_type},
    {"objects.mandatory", "CiA 301, 7.5.1", "1000h, 1001h, 1018h with the vendor exist.", none,
     [](Device& d) {
       return expect_all(d, {{0x1000, 0}, {0x1001, 0}, {0x1018, 0}, {0x1018, 1}});
     }},
    {"objects.error_control", "CiA 301, 7.2.8.2.2", "The node has a heartbeat (1017h) or node guarding (100Ch).", none,
     error_control},
    {"objects.error_register", "CiA 301, 7.5.2.2", "1001h reports no error while there is none.", none, no_error},
    {"objects.highest_sub_index", "CiA 301, 7.4.3", "Sub-index 0 names the last entry; beyond it there is none.", none,
     highest_sub_indices},
    {"objects.names", "CiA 301, 7.5.2.8", "1008h, 1009h and 100Ah are readable text.", none, names},
    {"objects.constant", "CiA 301, 7.5.2.1", "1000h, 1001h and 1018h cannot be written.", none,
     [](Device& d) {
       return expect_read_only(d, {0x1000, 0x1001, 0x1018});
     }},
    {"objects.drive_mandatory", "CiA 402-2, 6040h, 6041h, 6060h, 6061h, 6502h",
     "Controlword, statusword, mode, mode display and supported modes exist.", none,
     [](Device& d) {
       return expect_all(d, {{0x6040, 0}, {0x6041, 0}, {0x6060, 0}, {0x6061, 0}, {0x6502, 0}});
     }},
    {"objects.drive_read_only", "CiA 402-2, 6041h, 6061h, 6064h, 606Ch, 6077h, 603Fh",
     "Statusword and actual values cannot be written.", none,
     [](Device& d) {
       return expect_read_only(d, {0x6041, 0x6061, 0x603F, 0x6064, 0x606C, 0x6077});
     }},
    {"objects.lengths", "CiA 301 and CiA 402-2, data types", "Standard objects have their standard length.", none,
     lengths},
    {"objects.of_modes", "CiA 402-2, 6502h", "Each supported mode has its objects.", none, objects_of_modes},
};

}  // namespace

Checks object_checks() { return checks; }

}  // namespace tribotwin::hil
