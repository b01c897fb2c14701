#include <algorithm>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

using Codes = std::vector<std::uint32_t>;

const Eds& eds_of(const Device& d) {
  if (!d.options.eds) throw NotApplicable{"no --eds FILE was given"};
  return *d.options.eds;
}

/// Throws where there are problems, else says how many objects had none.
std::string verdict(int count, const std::vector<std::string>& problems, const char* expected) {
  constexpr std::size_t most = 8;
  if (problems.empty()) return fmt::format("{} objects", count);
  const std::span some(problems.data(), std::min(problems.size(), most));
  const auto more = problems.size() - some.size();
  throw Mismatch{expected, fmt::format("{}{}", fmt::join(some, "; "), more ? fmt::format("; {} more", more) : "")};
}

std::string name(const SheetObject& o) { return object_name(o.index, o.sub); }
bool readable(const SheetObject& o) { return o.access != Access::write_only; }
bool writable(const SheetObject& o) { return o.access == Access::read_write || o.access == Access::write_only; }

/// Of an empty entry of the history there is no data (CiA 301, 7.5.2.4).
bool absent_for_now(const SheetObject& o, const SdoFailure& f) {
  return o.index == od::predefined_error_field && f.kind == SdoFailure::Kind::aborted && f.code == 0x08000024;
}

std::string exist(Device& d) {
  int count = 0;
  std::vector<std::string> problems;
  for (const SheetObject& o : eds_of(d).objects) {
    if (!readable(o)) continue;
    ++count;
    const auto value = d.bus.upload(o.index, o.sub);
    if (!value && !absent_for_now(o, value.error()))
      problems.push_back(fmt::format("{} {}", name(o), value.error().text()));
  }
  return verdict(count, problems, "every readable object of the EDS can be read");
}

std::string lengths(Device& d) {
  int count = 0;
  std::vector<std::string> problems;
  for (const SheetObject& o : eds_of(d).objects) {
    if (!readable(o) || size_of(o.type) == 0) continue;
    const auto value = d.bus.upload(o.index, o.sub);
    if (!value) continue;
    ++count;
    if (value->size() != static_cast<std::size_t>(size_of(o.type)))
      problems.push_back(fmt::format("{} has {} bytes instead of {}", name(o), value->size(), size_of(o.type)));
  }
  return verdict(count, problems, "the length of every object is that of its DataType");
}

/// Writes the value that the object has, so that a device that accepts it does not change.
std::string access(Device& d) {
  int count = 0;
  std::vector<std::string> problems;
  for (const SheetObject& o : eds_of(d).objects) {
    if (!readable(o) || writable(o)) continue;
    const auto value = d.bus.upload(o.index, o.sub);
    if (!value) continue;
    ++count;
    const auto written = d.bus.download(o.index, o.sub, *value);
    if (written)
      problems.push_back(name(o) + " was written");
    else if (written.error().code != 0x06010002)
      problems.push_back(fmt::format("{} {}", name(o), written.error().text()));
  }
  return verdict(count, problems, "a write to an object with AccessType ro or const ends with abort 06010002h");
}

std::string write_only(Device& d) {
  int count = 0;
  std::vector<std::string> problems;
  for (const SheetObject& o : eds_of(d).objects) {
    if (readable(o)) continue;
    ++count;
    const auto value = d.bus.upload(o.index, o.sub);
    if (value)
      problems.push_back(name(o) + " was read");
    else if (value.error().code != 0x06010001)
      problems.push_back(fmt::format("{} {}", name(o), value.error().text()));
  }
  if (count == 0) throw NotApplicable{"the EDS has no object with AccessType wo"};
  return verdict(count, problems, "a read of an object with AccessType wo ends with abort 06010001h");
}

std::string defaults(Device& d) {
  const Eds& eds = eds_of(d);
  d.reset(NmtCommand::reset_node);
  int count = 0;
  std::vector<std::string> problems;
  for (const SheetObject& o : eds.objects) {
    // Read-only objects are what the device measures.
    if (!o.has_default || !readable(o) || o.access == Access::read_only) continue;
    const auto value = d.bus.upload(o.index, o.sub);
    if (!value || value->size() != static_cast<std::size_t>(size_of(o.type))) continue;
    ++count;
    const std::int64_t seen = decode(o.type, *value);
    if (seen != o.value) problems.push_back(fmt::format("{} is {} instead of {}", name(o), seen, o.value));
  }
  return verdict(count, problems,
                 "after a reset every constant and writable object has its DefaultValue (unless others are stored)");
}

/// Whether a write beyond the limits shows the limits, and nothing else.
bool has_own_limits(const SheetObject& o) {
  const bool pdo = o.index >= od::rpdo_communication && o.index < od::after_pdos;
  const bool command = o.index == od::controlword || o.index == 0x1010 || o.index == 0x1011;
  return writable(o) && readable(o) && size_of(o.type) > 0 && size_of(o.type) <= 4 && !pdo && !command;
}

std::string limits(Device& d) {
  int count = 0;
  std::vector<std::string> problems;
  for (const SheetObject& o : eds_of(d).objects) {
    if (!has_own_limits(o)) continue;
    const Limits all = limits_of(o.type);
    const auto beyond = [&](std::int64_t value) {
      ++count;
      const auto code = d.refusal(o.index, o.sub, value);
      if (!code)
        problems.push_back(fmt::format("{} accepts {}", name(o), value));
      else if (*code != 0x06090030 && *code != 0x06090031 && *code != 0x06090032)
        problems.push_back(fmt::format("{} := {}: abort {:08X}h", name(o), value, *code));
    };
    if (o.low > all.low) beyond(o.low - 1);
    if (o.high < all.high) beyond(o.high + 1);
  }
  if (count == 0) throw NotApplicable{"the EDS gives no limits inside the range of a type"};
  if (problems.empty()) return fmt::format("{} values refused", count);
  return verdict(count, problems, "values beyond LowLimit and HighLimit end with abort 06090030h, 31h or 32h");
}

std::string identity(Device& d) {
  const Eds& eds = eds_of(d);
  if (!eds.vendor && !eds.product) throw NotApplicable{"the EDS has no VendorNumber and no ProductNumber"};
  std::vector<std::string> seen;
  const auto same = [&](std::uint8_t sub, const char* key, const std::optional<std::int64_t>& wanted) {
    if (!wanted || !d.has(od::identity, sub)) return;
    const auto value = d.get(od::identity, sub);
    seen.push_back(fmt::format("{} {:X}h", key, value));
    expect(value == *wanted, fmt::format("1018h:{:02X} = {} = {:X}h", sub, key, *wanted), fmt::format("{:X}h", value));
  };
  same(1, "VendorNumber", eds.vendor);
  same(2, "ProductNumber", eds.product);
  return fmt::format("{}", fmt::join(seen, ", "));
}

/// What this program asks a device for by itself should be in its EDS.
std::string complete(Device& d) {
  const Eds& eds = eds_of(d);
  std::vector<std::string> problems;
  int count = 0;
  for (std::uint32_t index = 0x1000; index <= 0x6FFF; ++index) {
    if (index == 0x1030) index = 0x1200;
    if (index == 0x1201) index = 0x1400;
    if (index == 0x1408) index = 0x1600;
    if (index == 0x1608) index = 0x1800;
    if (index == 0x1808) index = 0x1A00;
    if (index == 0x1A08) index = 0x6000;
    if (index == 0x6100) index = 0x6500;
    if (index == 0x6510) break;
    const auto i = static_cast<std::uint16_t>(index);
    if (!d.has(i)) continue;
    ++count;
    if (std::ranges::find(eds.objects, i, &SheetObject::index) == eds.objects.end())
      problems.push_back(fmt::format("{:04X}h", i));
  }
  return verdict(count, problems, "every standard object of the device is in its EDS");
}

constexpr auto none = Needs::nothing;

constexpr Check checks[] = {
    {"eds.exist", "CiA 306", "Every readable object of the EDS can be read.", none, exist},
    {"eds.complete", "CiA 306", "Every standard object of the device is in its EDS.", none, complete},
    {"eds.lengths", "CiA 306, DataType", "Every object has the length of its data type.", none, lengths},
    {"eds.access", "CiA 306, AccessType", "Objects that are ro or const cannot be written.", none, access},
    {"eds.write_only", "CiA 306, AccessType", "Objects that are wo cannot be read: abort 06010001h.", none, write_only},
    {"eds.defaults", "CiA 306, DefaultValue", "After a reset objects have their default.", none, defaults},
    {"eds.limits", "CiA 306, LowLimit, HighLimit", "Values beyond the limits are refused.", none, limits},
    {"eds.identity", "CiA 306, DeviceInfo", "Vendor and product number are those of 1018h.", none, identity},
};

}  // namespace

Checks eds_checks() { return checks; }

}  // namespace tribotwin::hil
