#include <algorithm>
#include <bit>
#include <charconv>
#include <sstream>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/setup/eds_reader.hpp>
#include <tribotwin/hil/canopen/setup/parameter_keeper.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil {
namespace {

constexpr od::Index first_object = 0x1000;  // below: data types
constexpr std::int64_t longest_text = 4096;

std::string lower(std::string_view text) {
  std::string out(text);
  for (char& c : out) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return out;
}

/// For messages: printable, not long.
std::string shown(std::string_view text) { return twin::printable(text.substr(0, 60)); }

template <class... Arguments>
tl::unexpected<Error> problem(const std::filesystem::path& file, int line, fmt::format_string<Arguments...> format,
                              Arguments&&... arguments) {
  return tl::unexpected<Error>(
      fmt::format("{}:{}: {}", file.string(), line, fmt::format(format, std::forward<Arguments>(arguments)...)));
}

/// A number as CiA 306 writes it: decimal, 0x hexadecimal, octal with a leading 0; a sign.
struct Number {
  std::int64_t value = 0;
  bool hexadecimal = false, plus_node = false;
};

std::optional<Number> plain_number(std::string_view text) {
  const bool negative = text.starts_with('-');
  std::string t = lower(twin::trimmed(text.substr(negative || text.starts_with('+') ? 1 : 0)));
  const bool hexadecimal = t.starts_with("0x");
  const int base = hexadecimal ? 16 : t.size() > 1 && t[0] == '0' ? 8 : 10;
  const auto bits = to_integer<std::uint64_t>(std::string_view(t).substr(hexadecimal ? 2 : 0), base);
  if (!bits) return std::nullopt;
  constexpr std::uint64_t lowest = 1ULL << 63;  // without its sign
  if (*bits > lowest - 1 && !(negative ? *bits == lowest : hexadecimal)) return std::nullopt;
  return Number{static_cast<std::int64_t>(negative ? 0 - *bits : *bits), hexadecimal};
}

/// The same, or a sum with $NODEID.
std::optional<Number> parsed(std::string_view text) {
  const auto plus = text.find('+', 1);
  const auto is_node = [](std::string_view part) { return lower(twin::trimmed(part)) == "$nodeid"; };
  if (is_node(text)) return Number{.plus_node = true};
  if (plus == text.npos || plus > text.size()) return plain_number(text);
  const auto first = text.substr(0, plus), second = text.substr(plus + 1);
  if (is_node(first) == is_node(second)) return std::nullopt;
  auto base = plain_number(twin::trimmed(is_node(first) ? second : first));
  if (base) base->plus_node = true;
  return base;
}

/// Of an object: its limits, the number with the sign of the type. None where it is not of the type.
std::optional<std::int64_t> in_type(Number n, Type type, std::uint8_t node) {
  if (n.plus_node && type == Type::u64) {  // the number is its bits
    const std::uint64_t base = static_cast<std::uint64_t>(n.value), sum = base + node;
    return sum < base ? std::nullopt : std::optional(static_cast<std::int64_t>(sum));
  }
  if (n.plus_node && __builtin_add_overflow(n.value, node, &n.value)) return std::nullopt;
  const int bits = 8 * size_of(type);
  // Hexadecimal numbers of signed types are their bits.
  if (n.hexadecimal && is_signed(type) && bits < 64 && n.value < std::int64_t{1} << bits && n.value >> (bits - 1) == 1)
    n.value -= std::int64_t{1} << bits;
  const Limits limits = limits_of(type);
  if (n.value < limits.low || n.value > limits.high) return std::nullopt;
  return n.value;
}

template <class Real>
std::optional<Real> real(std::string_view text) {
  Real value = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || stop != text.data() + text.size()) return std::nullopt;
  return value;
}

std::optional<std::int64_t> number_of(std::string_view text, Type type, std::uint8_t node) {
  if (type == Type::real32)
    if (const auto value = real<float>(text)) return std::bit_cast<std::uint32_t>(*value);
  if (type == Type::real64)
    if (const auto value = real<double>(text)) return std::bit_cast<std::int64_t>(*value);
  const auto n = parsed(text);
  return n ? in_type(*n, type, node) : std::nullopt;
}

/// "01 02 AB" or "0102AB".
std::optional<std::string> octets(std::string_view text) {
  std::string bytes;
  for (std::size_t at = 0; at < text.size();) {
    if (text[at] == ' ') {
      ++at;
      continue;
    }
    const auto digits = text.substr(at, 2);
    const auto byte = to_integer<std::uint8_t>(digits, 16);
    if (!byte || digits.size() != 2) return std::nullopt;
    bytes += static_cast<char>(*byte);
    at += 2;
  }
  return bytes;
}

std::string range_of(Type type) {
  const Limits limits = limits_of(type);
  return fmt::format("{} from {} to {}", facts_of(type).name, limits.low, limits.high);
}

/// Makes objects of sections.
class Objects {
 public:
  Objects(const std::filesystem::path& file, const EdsSections& sections) : file_(file), sections_(sections) {}

  Result<std::vector<EdsObject>> run() {
    for (const auto& [name, keys] : sections_) {
      const auto index = name.size() == 4 ? to_integer<std::uint16_t>(name, 16) : std::nullopt;
      if (!index || *index < first_object) continue;
      if (auto ok = add_object(*index, name, keys); !ok) return tl::unexpected(ok.error());
      if (objects_.size() > limits::eds_objects)
        return tl::unexpected<Error>(fmt::format("{}: more than {} objects", file_.string(), limits::eds_objects));
    }
    if (objects_.empty())
      return tl::unexpected<Error>(
          fmt::format("{}: no objects ([1000] and so on): is it an EDS or DCF?", file_.string()));
    std::ranges::sort(objects_, {}, [](const EdsObject& o) { return o.index << 8 | o.sub; });
    return std::move(objects_);
  }

 private:
  static const EdsText* find(const EdsKeys& keys, const char* key) {
    const auto found = keys.find(key);
    return found == keys.end() ? nullptr : &found->second;
  }
  const EdsKeys* section(const std::string& name) const {
    const auto found = sections_.find(name);
    return found == sections_.end() ? nullptr : &found->second;
  }
  static int line_of(const EdsKeys& keys) {
    int line = std::numeric_limits<int>::max();
    for (const auto& [key, value] : keys) line = std::min(line, value.line);
    return keys.empty() ? 1 : line;
  }
  /// A small number of a key; `otherwise` where it has none.
  Result<int> code(const EdsKeys& keys, const char* key, int otherwise, int highest) const {
    const EdsText* text = find(keys, key);
    if (!text) return otherwise;
    const auto n = parsed(text->text);
    if (!n || n->plus_node || n->value < 0 || n->value > highest)
      return problem(file_, text->line, "{}: '{}' is no number from 0 to {}", key, shown(text->text), highest);
    return static_cast<int>(n->value);
  }

  Result<void> add_object(std::uint16_t index, const std::string& name, const EdsKeys& keys) {
    const auto kind = code(keys, "objecttype", 7, 255), compact = code(keys, "compactsubobj", 0, 254);
    if (!kind) return tl::unexpected(kind.error());
    if (!compact) return tl::unexpected(compact.error());
    constexpr int domain = 2, definition = 5, array = 8, record = 9;
    if (*kind == definition) return {};
    if (*kind != array && *kind != record) return add_entry(index, 0, keys, *kind == domain);
    if (*compact > 0) return add_compact(index, name, keys, *compact);
    bool any = false;
    for (int sub = 0; sub <= 255; ++sub) {
      const EdsKeys* entry = section(fmt::format("{}sub{:x}", name, sub));
      if (!entry) continue;
      any = true;
      if (auto ok = add_entry(index, static_cast<std::uint8_t>(sub), *entry, false); !ok) return ok;
    }
    if (!any) return problem(file_, line_of(keys), "[{}] has no sub-indices: expected [{}sub0] and so on", name, name);
    return {};
  }

  /// All sub-indices alike, their values in lists.
  Result<void> add_compact(std::uint16_t index, const std::string& name, const EdsKeys& keys, int count) {
    EdsObject highest{.index = index, .name = "highest sub-index", .type = Type::u8, .line = line_of(keys)};
    highest.default_value = EdsText{fmt::to_string(count), highest.line};
    objects_.push_back(highest);
    for (int sub = 1; sub <= count; ++sub) {
      if (auto ok = add_entry(index, static_cast<std::uint8_t>(sub), keys, false); !ok) return ok;
      const std::string number = fmt::to_string(sub);
      if (const EdsKeys* values = section(name + "value"))
        if (const EdsText* value = find(*values, number.c_str())) objects_.back().parameter_value = *value;
      if (const EdsKeys* names = section(name + "name"))
        if (const EdsText* text = find(*names, number.c_str())) objects_.back().name = text->text;
    }
    return {};
  }

  Result<void> add_entry(std::uint16_t index, std::uint8_t sub, const EdsKeys& keys, bool is_domain) {
    EdsObject o{.index = index, .sub = sub, .line = line_of(keys)};
    const auto take = [&](const char* key) {
      const EdsText* text = find(keys, key);
      return text ? std::optional(*text) : std::nullopt;
    };
    constexpr int domain_type = 0x0F;
    const auto type = code(keys, "datatype", is_domain ? domain_type : -1, 0xFFFF);
    if (!type) return tl::unexpected(type.error());
    if (*type < 0) return problem(file_, o.line, "{} has no DataType", object_name(index, sub));
    constexpr int first_complex_type = 0x20;  // CiA 301, table 44: records of the profiles and of the makers
    if (const auto known = type_of(*type))
      o.type = *known;
    else if (*type >= first_complex_type && *type < first_object)
      o.type = Type::domain;
    else
      return problem(file_, find(keys, "datatype")->line,
                     "DataType {:#x} is none of CiA 301: 0x1 to 0xD, 0xF to 0x16, 0x18 to 0x1B, 0x20 to 0xFFF", *type);
    if (auto access = access_of(keys, o.line); access)
      o.access = *access;
    else
      return tl::unexpected(access.error());
    const auto mappable = code(keys, "pdomapping", 0, 1);
    if (!mappable) return tl::unexpected(mappable.error());
    o.mappable = *mappable == 1;
    if (const EdsText* name = find(keys, "parametername")) o.name = name->text;
    o.default_value = take("defaultvalue"), o.parameter_value = take("parametervalue");
    o.low = take("lowlimit"), o.high = take("highlimit");
    objects_.push_back(std::move(o));
    return {};
  }

  Result<Access> access_of(const EdsKeys& keys, int line) const {
    const EdsText* text = find(keys, "accesstype");
    if (!text) return problem(file_, line, "AccessType is missing: ro, wo, rw, rwr, rww or const");
    const std::string access = lower(text->text);
    if (access == "ro") return Access::read_only;
    if (access == "const") return Access::constant;
    if (access == "wo") return Access::write_only;
    if (access == "rw" || access == "rwr" || access == "rww") return Access::read_write;
    return problem(file_, text->line, "AccessType is ro, wo, rw, rwr, rww or const, not '{}'", shown(text->text));
  }

  const std::filesystem::path& file_;
  const EdsSections& sections_;
  std::vector<EdsObject> objects_;
};

/// Sets the value of an object from its text.
Result<void> set_value(const EdsFile& eds, const EdsText& from, Object& o, std::uint8_t node) {
  if (is_number(o.type)) {
    const auto value = eds.number(from, o.type, node, object_name(o.index, o.sub));
    if (!value) return tl::unexpected(value.error());
    o.value = *value;
  } else if (o.type == Type::octets) {
    const auto bytes = octets(from.text);
    if (!bytes)
      return problem(eds.file, from.line, "{}: octets are pairs of hexadecimal digits, not '{}'",
                     object_name(o.index, o.sub), shown(from.text));
    o.text = *bytes;
  } else if (o.type == Type::text) {
    o.text = from.text;
  }
  return {};
}

Result<void> set_limits(const std::filesystem::path& file, const EdsObject& entry, Object& o) {
  if (!is_number(o.type)) {
    o.high = longest_text;
    return {};
  }
  const Limits all = limits_of(o.type);
  o.low = all.low, o.high = all.high;
  if (o.type == Type::real32 || o.type == Type::real64 || o.type == Type::u64) return {};
  for (const bool upper : {false, true}) {
    const auto& text = upper ? entry.high : entry.low;
    if (!text || (parsed(text->text) && parsed(text->text)->plus_node)) continue;
    const auto value = number_of(text->text, o.type, 0);
    if (!value)
      return problem(file, text->line, "{}: the limit '{}' is no {}", object_name(o.index, o.sub), shown(text->text),
                     range_of(o.type));
    (upper ? o.high : o.low) = *value;
  }
  if (o.low > o.high)
    return problem(file, entry.low ? entry.low->line : entry.line, "{}: LowLimit {} is above HighLimit {}",
                   object_name(o.index, o.sub), o.low, o.high);
  return {};
}

}  // namespace

Result<EdsSections> parse_eds_sections(const std::string& content, const std::filesystem::path& file) {
  std::istringstream stream(content);
  EdsSections sections;
  std::string raw, section;
  for (int line = 1; std::getline(stream, raw); ++line) {
    if (raw.size() > limits::eds_line_bytes)
      return problem(file, line, "a line has at most {} characters", limits::eds_line_bytes);
    const std::string_view text = twin::trimmed(raw);
    if (text.empty() || text[0] == ';' || text[0] == '#') continue;
    if (text[0] == '[') {
      if (text.back() != ']') return problem(file, line, "a section ends with ']', not '{}'", shown(text));
      section = lower(twin::trimmed(text.substr(1, text.size() - 2)));
      sections[section];
      continue;
    }
    const auto equals = text.find('=');
    if (section.empty() || equals == text.npos)
      return problem(file, line, "must be [SECTION], or KEY=VALUE in a section, not '{}'", shown(text));
    const EdsText value{std::string(twin::trimmed(text.substr(equals + 1))), line};
    if (value.text.empty()) continue;
    const std::string key = lower(twin::trimmed(text.substr(0, equals)));
    const auto [place, fresh] = sections[section].emplace(key, value);
    if (!fresh && place->second.text != value.text)
      return problem(file, line, "{} of [{}] has another value in line {}", shown(key), shown(section),
                     place->second.line);
  }
  return sections;
}

Result<EdsFile> read_eds_file(const std::filesystem::path& file) {
  const auto content = twin::read_text(file, "an EDS or DCF");
  if (!content) return tl::unexpected(content.error());
  return parse_eds(*content, file);
}

Result<EdsFile> parse_eds(const std::string& content, const std::filesystem::path& file) {
  const auto sections = parse_eds_sections(content, file);
  if (!sections) return tl::unexpected(sections.error());
  auto objects = Objects(file, *sections).run();
  if (!objects) return tl::unexpected(objects.error());
  EdsFile eds{.file = file, .node_number = {}, .objects = std::move(*objects), .device_info = {}};
  if (const auto info = sections->find("deviceinfo"); info != sections->end()) eds.device_info = info->second;
  for (const char* section : {"devicecomissioning", "devicecommissioning"}) {  // CiA 306 writes the first
    const auto found = sections->find(section);
    if (found == sections->end() || !found->second.contains("nodeid")) continue;
    const EdsText& text = found->second.at("nodeid");
    const auto n = parsed(text.text);
    if (!n || n->plus_node || n->value < 1 || n->value > 127)
      return problem(file, text.line, "NodeID is a number from 1 to 127, not '{}'", shown(text.text));
    eds.node_number = static_cast<std::uint8_t>(n->value);
  }
  return eds;
}

const EdsText* EdsObject::value() const {
  if (parameter_value) return &*parameter_value;
  return default_value ? &*default_value : nullptr;
}

const EdsObject* EdsFile::find(std::uint16_t index, std::uint8_t sub) const {
  const auto found = std::ranges::find_if(objects, [&](const auto& o) { return o.index == index && o.sub == sub; });
  return found == objects.end() ? nullptr : &*found;
}

Result<std::int64_t> EdsFile::number(const EdsText& text, Type type, std::uint8_t node, std::string_view name) const {
  if (const auto value = number_of(text.text, type, node)) return *value;
  return problem(file, text.line, "{}: '{}' is no {}", name, shown(text.text), range_of(type));
}

Result<std::vector<ObjectValue>> EdsFile::values(std::uint8_t node) const {
  std::vector<ObjectValue> values;
  for (const EdsObject& entry : objects) {
    if (!entry.parameter_value || entry.access == Access::read_only || entry.access == Access::constant) continue;
    if (entry.index == od::predefined_error_field || ParameterKeeper::owns(entry.index)) continue;
    Object o{.index = entry.index, .sub = entry.sub, .type = entry.type};
    if (auto ok = set_value(*this, *entry.parameter_value, o, node); !ok) return tl::unexpected(ok.error());
    values.push_back(value_of(o));
    values.back().line = entry.parameter_value->line;
  }
  return values;
}

Result<std::vector<Object>> EdsFile::defaults() const {
  std::vector<Object> all;
  for (const EdsObject& entry : objects) {
    Object o{.index = entry.index,
             .sub = entry.sub,
             .name = entry.name,
             .type = entry.type,
             .access = entry.access,
             .mappable = entry.mappable && is_number(entry.type) && entry.type != Type::boolean};
    if (auto ok = set_limits(file, entry, o); !ok) return tl::unexpected(ok.error());
    if (entry.default_value) {
      const auto n = is_number(o.type) ? parsed(entry.default_value->text) : std::nullopt;
      o.plus_node = n && n->plus_node;
      // Of any node: the sum must not overflow.
      const std::uint8_t highest = o.plus_node && size_of(o.type) == 8 ? 127 : 0;
      for (const std::uint8_t node : {highest, std::uint8_t{0}})
        if (auto ok = set_value(*this, *entry.default_value, o, node); !ok) return tl::unexpected(ok.error());
    }
    all.push_back(std::move(o));
  }
  return all;
}

}  // namespace tribotwin::hil
