#include <algorithm>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>

namespace tribotwin::hil {
namespace {

using T = Type;

auto key(const Object& o) { return static_cast<std::uint32_t>(o.index) << 8 | o.sub; }

}  // namespace

namespace {

// In the order of Type.
constexpr TypeFacts types[] = {{"u8", 0x05, 1, false},
                               {"u16", 0x06, 2, false},
                               {"u32", 0x07, 4, false},
                               {"i8", 0x02, 1, true},
                               {"i16", 0x03, 2, true},
                               {"i32", 0x04, 4, true},
                               {"text", 0x09, 0, false},
                               {"domain", 0x0F, 0, false},
                               {"boolean", 0x01, 1, false},
                               {"u24", 0x16, 3, false},
                               {"u40", 0x18, 5, false},
                               {"u48", 0x19, 6, false},
                               {"u56", 0x1A, 7, false},
                               {"u64", 0x1B, 8, false},
                               {"i24", 0x10, 3, true},
                               {"i40", 0x12, 5, true},
                               {"i48", 0x13, 6, true},
                               {"i56", 0x14, 7, true},
                               {"i64", 0x15, 8, true},
                               {"real32", 0x08, 4, false},
                               {"real64", 0x11, 8, false},
                               {"octets", 0x0A, 0, false},
                               {"unicode", 0x0B, 0, false},
                               {"time of day", 0x0C, 6, false},
                               {"time difference", 0x0D, 6, false}};
static_assert(std::size(types) == static_cast<std::size_t>(Type::time_difference) + 1);

}  // namespace

const TypeFacts& facts_of(Type type) { return types[static_cast<std::size_t>(type)]; }

std::optional<Type> type_of(int code) {
  const auto found = std::ranges::find(types, code, &TypeFacts::code);
  if (found == std::end(types)) return std::nullopt;
  return static_cast<Type>(found - std::begin(types));
}

std::string_view reason(Abort abort) {
  switch (abort) {
    case Abort::read_only:
      return "can only be read";
    case Abort::no_object:
      return "this object does not exist";
    case Abort::no_sub_index:
      return "this sub-index does not exist";
    case Abort::not_mappable:
      return "names an object that cannot be mapped so";
    case Abort::pdo_too_long:
      return "more than 8 bytes in a PDO";
    case Abort::incompatible:
      return "does not fit another parameter";
    case Abort::too_long:
      return "more bytes than the object has";
    case Abort::too_short:
      return "fewer bytes than the object has";
    case Abort::out_of_range:
      return "a value that it does not have";
    case Abort::too_high:
      return "more than its upper limit";
    case Abort::too_low:
      return "less than its lower limit";
    default:
      return "cannot be written at the start";
  }
}

Limits limits_of(Type type) {
  const TypeFacts& facts = facts_of(type);
  if (facts.bytes == 0) return {0, 0};
  if (type == T::boolean) return {0, 1};
  if (facts.bytes == 8) return {std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max()};
  const std::int64_t values = std::int64_t{1} << (8 * facts.bytes);
  return facts.is_signed ? Limits{-values / 2, values / 2 - 1} : Limits{0, values - 1};
}

void add(std::vector<Object>& objects, Object object, Extra extra) {
  object.text = std::move(extra.text);
  object.scale = extra.scale;
  object.unit = std::move(extra.unit);
  object.meaning = std::move(extra.meaning);
  object.plus_node = extra.plus_node;
  objects.push_back(std::move(object));
}

std::string object_name(std::uint16_t index, std::uint8_t sub) { return fmt::format("{:04X}h:{:02X}", index, sub); }

int size_of(Type type) { return facts_of(type).bytes; }

bool is_signed(Type type) { return facts_of(type).is_signed; }

std::size_t longest(const Object& o) { return static_cast<std::size_t>(is_number(o.type) ? size_of(o.type) : o.high); }

tl::expected<void, Abort> fits(const Object& o, std::size_t bytes) {
  if (bytes > longest(o)) return tl::unexpected(Abort::too_long);
  if (bytes < longest(o) && is_number(o.type)) return tl::unexpected(Abort::too_short);
  return {};
}

std::int64_t saturated(Type type, std::int64_t value) {
  const Limits l = limits_of(type);
  return std::clamp(value, l.low, l.high);
}

std::int64_t decode(Type type, std::span<const std::uint8_t> bytes) {
  std::uint64_t raw = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) raw |= static_cast<std::uint64_t>(bytes[i]) << (8 * i);
  if (!is_signed(type)) return static_cast<std::int64_t>(raw);
  const std::uint64_t sign = 1ULL << (8 * bytes.size() - 1);
  return static_cast<std::int64_t>((raw ^ sign) - sign);
}

void encode(std::int64_t value, std::span<std::uint8_t> bytes) {
  for (std::size_t i = 0; i < bytes.size(); ++i)
    bytes[i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i));
}

Dictionary::Dictionary(std::vector<Object> objects) : objects_(std::move(objects)) {
  std::ranges::sort(objects_, {}, key);
  for (auto& o : objects_)
    if (o.low == 0 && o.high == 0) o.low = limits_of(o.type).low, o.high = limits_of(o.type).high;
}

const Object* Dictionary::find(std::uint16_t index, std::uint8_t sub) const {
  const auto wanted = static_cast<std::uint32_t>(index) << 8 | sub;
  const auto at = std::ranges::lower_bound(objects_, wanted, {}, key);
  return at != objects_.end() && key(*at) == wanted ? &*at : nullptr;
}

Object* Dictionary::find(std::uint16_t index, std::uint8_t sub) {
  return const_cast<Object*>(std::as_const(*this).find(index, sub));
}

bool Dictionary::has_index(std::uint16_t index) const {
  return std::ranges::binary_search(objects_, index, {}, &Object::index);
}

std::int64_t Dictionary::get(std::uint16_t index, std::uint8_t sub) const { return find(index, sub)->value; }

void Dictionary::set(std::uint16_t index, std::uint8_t sub, std::int64_t value) {
  Object* o = find(index, sub);
  o->value = saturated(o->type, value);
}

tl::expected<std::vector<std::uint8_t>, Abort> Dictionary::read(std::uint16_t index, std::uint8_t sub) const {
  const Object* o = find(index, sub);
  if (!o) return tl::unexpected(has_index(index) ? Abort::no_sub_index : Abort::no_object);
  if (o->access == Access::write_only) return tl::unexpected(Abort::write_only);
  if (may_read)
    if (auto allowed = may_read(*o); !allowed) return tl::unexpected(allowed.error());
  if (!is_number(o->type)) return std::vector<std::uint8_t>(o->text.begin(), o->text.end());
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size_of(o->type)));
  encode(o->value, bytes);
  return bytes;
}

tl::expected<const Object*, Abort> Dictionary::writable(std::uint16_t index, std::uint8_t sub) const {
  const Object* o = find(index, sub);
  if (!o) return tl::unexpected(has_index(index) ? Abort::no_sub_index : Abort::no_object);
  if (o->access != Access::read_write && o->access != Access::write_only) return tl::unexpected(Abort::read_only);
  return o;
}

tl::expected<void, Abort> Dictionary::write(std::uint16_t index, std::uint8_t sub,
                                            std::span<const std::uint8_t> bytes) {
  if (const auto may = writable(index, sub); !may) return tl::unexpected(may.error());
  Object* o = find(index, sub);
  if (auto allowed = fits(*o, bytes.size()); !allowed) return allowed;
  const bool number = is_number(o->type);
  const std::int64_t value = number ? decode(o->type, bytes) : static_cast<std::int64_t>(bytes.size());
  if (value > o->high) return tl::unexpected(Abort::too_high);
  if (value < o->low) return tl::unexpected(Abort::too_low);
  if (may_write)
    if (auto allowed = may_write(*o, value); !allowed) return allowed;
  if (number)
    o->value = value;
  else
    o->text.assign(bytes.begin(), bytes.end());
  if (written) written(*o);
  return {};
}

std::string reference_markdown(const Dictionary& dictionary) {
  std::string s =
      "| index | name | type | access | PDO | default | one count | meaning |\n|---|---|---|---|---|---|---|---|\n";
  for (const Object& o : dictionary.objects()) {
    if ((o.sub == 0 && o.name == "highest sub-index") ||
        (o.index >= od::rpdo_communication && o.index < od::after_pdos))
      continue;
    s += fmt::format("| {:04X}h:{:02X} | {} | {} | {} | {} | {} | {} | {} |\n", o.index, o.sub, o.name,
                     facts_of(o.type).name, o.access == Access::read_write ? "rw" : "ro", o.mappable ? "yes" : "",
                     is_number(o.type) ? fmt::to_string(o.value) : o.text,
                     o.unit.empty() ? "" : fmt::format("{:.6g} {}", o.scale, o.unit), o.meaning);
  }
  return s;
}

}  // namespace tribotwin::hil
