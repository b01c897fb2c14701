#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/shadow/eds_file.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil {
namespace {

constexpr double gear_tolerance = 0.01;
constexpr int tpdo_limit = 512, longest_map = 64, longest_pdo_bits = 512;

std::string lower(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}
std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\r"), end = text.find_last_not_of(" \t\r");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

struct Entry {
  std::string text;
  std::size_t line = 0;
};
using Sections = std::map<std::string, std::map<std::string, Entry>>;  // names in lower case

Result<Sections> read_sections(const std::filesystem::path& file) {
  auto stream = twin::open_text(file, "an EDS or DCF file");
  if (!stream) return tl::unexpected(stream.error());
  Sections sections;
  std::string raw, section;
  for (std::size_t line = 1; std::getline(*stream, raw); ++line) {
    const std::string text = trimmed(raw);
    if (text.empty() || text[0] == ';' || text[0] == '#') continue;
    const auto fail = [&](const std::string& what) {
      return tl::unexpected(fmt::format("{}:{}: {}", file.string(), line, what));
    };
    if (text[0] == '[') {
      if (!text.ends_with(']')) return fail("a section ends with ']'");
      section = lower(trimmed(text.substr(1, text.size() - 2)));
      continue;
    }
    const auto equals = text.find('=');
    if (section.empty() || equals == std::string::npos) return fail("must be [SECTION] or KEY=VALUE in a section");
    const std::string key = lower(trimmed(text.substr(0, equals)));
    const Entry entry{trimmed(text.substr(equals + 1)), line};
    const auto [place, fresh] = sections[section].emplace(key, entry);
    if (!fresh && place->second.text != entry.text)
      return fail(fmt::format("{} of [{}] has another value in line {}", key, section, place->second.line));
  }
  return sections;
}

/// An unsigned number as CiA 306 writes it: decimal, 0x hexadecimal, octal with a leading 0.
std::optional<std::uint64_t> plain_number(const std::string& text) {
  const std::string t = lower(text);
  const int base = t.starts_with("0x") ? 16 : t.size() > 1 && t[0] == '0' ? 8 : 10;
  const char *begin = t.data() + (base == 16 ? 2 : 0), *end = t.data() + t.size();
  std::uint64_t value = 0;
  const auto [stop, error] = std::from_chars(begin, end, value, base);
  if (error != std::errc{} || stop != end || value > 0xFFFFFFFF) return std::nullopt;
  return value;
}

/// The same, or a sum with $NODEID.
std::optional<std::uint64_t> number(const std::string& text, int node) {
  const auto plus = text.find('+');
  const std::string first = lower(trimmed(text.substr(0, plus)));
  if (plus == std::string::npos) return first == "$nodeid" ? std::optional<std::uint64_t>(node) : plain_number(first);
  const std::string second = lower(trimmed(text.substr(plus + 1)));
  if ((first == "$nodeid") == (second == "$nodeid")) return std::nullopt;
  const auto rest = plain_number(first == "$nodeid" ? second : first);
  if (!rest || *rest + static_cast<unsigned>(node) > 0xFFFFFFFF) return std::nullopt;
  return *rest + static_cast<unsigned>(node);
}

class EdsReader {
 public:
  EdsReader(const std::filesystem::path& file, const Sections& sections, const DriveParameters& p)
      : file_(file), sections_(sections), p_(p) {
    drive_.node = p.node;
  }

  Result<CanopenDrive> read(std::optional<double> increments) {
    if (auto ok = node(); !ok) return tl::unexpected(ok.error());
    for (int i = 0; i < tpdo_limit; ++i)
      if (auto ok = tpdo(static_cast<std::uint16_t>(od::tpdo_communication + i)); !ok)
        return tl::unexpected(ok.error());
    if (auto ok = position(increments); !ok) return tl::unexpected(ok.error());
    if (auto ok = torque(); !ok) return tl::unexpected(ok.error());
    return std::move(drive_);
  }

 private:
  tl::unexpected<Error> fail(const Entry& entry, const std::string& what) const {
    return tl::unexpected(Error(fmt::format("{}:{}: {}", file_.string(), entry.line, what)));
  }
  const Entry* entry(const std::string& section, const std::string& key) const {
    const auto found = sections_.find(section);
    if (found == sections_.end()) return nullptr;
    const auto value = found->second.find(key);
    return value == found->second.end() || value->second.text.empty() ? nullptr : &value->second;
  }
  /// Of an object: its own section, or the list of a compact one.
  const Entry* value(int index, int sub) const {
    const std::string own = sub < 0 ? fmt::format("{:04x}", index) : fmt::format("{:04x}sub{:x}", index, sub);
    if (const Entry* e = entry(own, "parametervalue")) return e;
    if (sub > 0)
      if (const Entry* e = entry(fmt::format("{:04x}value", index), fmt::to_string(sub))) return e;
    return entry(own, "defaultvalue");
  }
  Result<std::uint64_t> parsed(const Entry& e, const std::string& what) const {
    const auto n = number(e.text, drive_.node);
    if (!n)
      return fail(e, fmt::format("{}: '{}' is no number from 0 to 0xFFFFFFFF, with $NODEID+ or without", what, e.text));
    return *n;
  }
  /// None where the file has no value.
  Result<std::optional<std::uint64_t>> get(int index, int sub) const {
    const Entry* e = value(index, sub);
    if (!e) return std::nullopt;
    const auto n = parsed(*e, sub < 0 ? fmt::format("{:04X}h", index) : fmt::format("{:04X}h:{:02X}", index, sub));
    if (!n) return tl::unexpected(n.error());
    return *n;
  }

  Result<void> node() {
    for (const char* section : {"devicecomissioning", "devicecommissioning"})
      if (const Entry* e = entry(section, "nodeid")) {
        const auto n = parsed(*e, "NodeID");
        if (!n) return tl::unexpected(n.error());
        if (*n < 1 || *n > 127) return fail(*e, fmt::format("NodeID {} is not from 1 to 127", *n));
        drive_.node = static_cast<int>(*n);
      }
    return {};
  }

  Result<void> tpdo(std::uint16_t index) {
    const std::uint16_t map = od::mapping_of(index);
    const auto id = get(index, 1), type = get(index, 2), count = get(map, 0);
    for (const auto* part : {&id, &type, &count})
      if (!*part) return tl::unexpected(part->error());
    if (!*id) return {};
    if (type->value_or(255) > 255) return fail(*value(index, 2), "a transmission type is from 0 to 255");
    if (count->value_or(0) > longest_map) return fail(*value(map, 0), "a PDO has at most 64 mapped objects");
    set(index, 1, **id);
    set(index, 2, type->value_or(255));
    set(map, 0, count->value_or(0));
    std::uint64_t bits = 0;
    for (int k = 1; k <= static_cast<int>(count->value_or(0)); ++k) {
      const auto mapped = get(map, k);
      if (!mapped) return tl::unexpected(mapped.error());
      if (!*mapped)
        return fail(*value(map, 0),
                    fmt::format("{:04X}h maps {} objects, but has no value of :{:02X}", map, count->value_or(0), k));
      if (auto ok = mapping(*value(map, k), static_cast<std::int64_t>(**mapped)); !ok) return ok;
      bits += **mapped & 0xFF;
      if (bits > longest_pdo_bits) return fail(*value(map, k), fmt::format("{:04X}h maps more than 64 bytes", map));
      set(map, k, **mapped);
    }
    return {};
  }

  /// The objects that a shadow reads must have their size.
  Result<void> mapping(const Entry& at, std::int64_t number) const {
    constexpr std::pair<std::uint16_t, int> sizes[] = {
        {od::statusword, 16}, {od::position_actual_value, 32}, {od::torque_actual_value, 16}};
    const auto entry = MappingEntry::of(number);
    for (const auto& [index, bits] : sizes)
      if (entry.index == index && entry.bits != bits)
        return fail(at, fmt::format("{:04X}h is mapped with {} bits; it has {}", index, entry.bits, bits));
    return {};
  }
  void set(std::uint16_t index, int sub, std::uint64_t number) {
    drive_.tpdo_objects[{index, static_cast<std::uint8_t>(sub)}] = static_cast<std::int64_t>(number);
  }

  /// The quotient of an object's sub-indices 1 and 2, as 608Fh and 6091h have it; none where the file has no value.
  Result<std::optional<double>> quotient(int index) const {
    const auto over = get(index, 1), under = get(index, 2);
    if (!over) return tl::unexpected(over.error());
    if (!under) return tl::unexpected(under.error());
    if (!*over) return std::nullopt;
    for (const int sub : {1, 2})
      if ((sub == 1 ? **over : under->value_or(1)) == 0)
        return fail(*value(index, sub), fmt::format("{:04X}h:{:02X} is 0; it must be at least 1", index, sub));
    return static_cast<double>(**over) / static_cast<double>(under->value_or(1));
  }

  Result<void> position(std::optional<double> increments) {
    const auto gear = quotient(od::gear_ratio);
    if (!gear) return tl::unexpected(gear.error());
    if (!increments) {
      const auto resolution = quotient(od::position_encoder_resolution);
      if (!resolution) return tl::unexpected(resolution.error());
      increments = *resolution;
    }
    if (!increments)
      return tl::unexpected(
          fmt::format("{}: no encoder resolution (608Fh:01) for {}: give the counts of 6064h per motor "
                      "turn with --increments",
                      file_.string(), p_.name));
    if (*gear && **gear != 1 && std::abs(**gear / p_.gear_ratio - 1) > gear_tolerance)
      return fail(*value(od::gear_ratio, 1),
                  fmt::format("6091h has a gear ratio of {:.6g}, the scenario's {} one of {:.6g}", **gear, p_.name,
                              p_.gear_ratio));
    drive_.position_rad = 2 * std::numbers::pi / *increments / p_.gear_ratio;
    return {};
  }

  Result<void> torque() {
    const auto rated = get(od::motor_rated_torque, -1);
    if (!rated) return tl::unexpected(rated.error());
    const double rated_nm = rated->value_or(0) > 0 ? 1e-3 * static_cast<double>(**rated) : p_.rated_torque_nm;
    drive_.torque_nm = 1e-3 * rated_nm * p_.gear_ratio;
    return {};
  }

  const std::filesystem::path& file_;
  const Sections& sections_;
  const DriveParameters& p_;
  CanopenDrive drive_;
};

}  // namespace

Result<CanopenDrive> read_eds(const std::filesystem::path& file, const DriveParameters& parameters,
                              std::optional<double> increments) {
  const auto sections = read_sections(file);
  if (!sections) return tl::unexpected(sections.error());
  if (std::ranges::none_of(*sections, [](const auto& section) { return section.first.starts_with("1800"); }))
    return tl::unexpected(fmt::format("{}: no TPDO ([1800]): is it the EDS or DCF of a drive?", file.string()));
  return EdsReader(file, *sections, parameters).read(increments);
}

}  // namespace tribotwin::hil
