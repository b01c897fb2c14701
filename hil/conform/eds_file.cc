#include <algorithm>
#include <fstream>
#include <map>
#include <string_view>

#include <fmt/format.h>

#include <tribotwin/hil/conform/eds_file.hpp>
#include <tribotwin/plugins/friction/number.hpp>

namespace tribotwin::hil {
namespace {

/// Data types of CiA 301, table 44, that are numbers.
struct NumberType {
  std::uint16_t number;
  int bytes;
  bool is_signed;
};
constexpr NumberType number_types[] = {
    {0x01, 1, false}, {0x02, 1, true},  {0x03, 2, true},  {0x04, 4, true},  {0x05, 1, false}, {0x06, 2, false},
    {0x07, 4, false}, {0x10, 3, true},  {0x12, 5, true},  {0x13, 6, true},  {0x14, 7, true},  {0x15, 8, true},
    {0x16, 3, false}, {0x18, 5, false}, {0x19, 6, false}, {0x1A, 7, false}, {0x1B, 8, false},
};
const NumberType* number_type(std::uint16_t number) {
  const auto found = std::ranges::find(number_types, number, &NumberType::number);
  return found == std::end(number_types) ? nullptr : found;
}

std::string lower(std::string_view text) {
  std::string s(text);
  for (char& c : s)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return s;
}

std::string_view trimmed(std::string_view s) {
  constexpr std::string_view blanks = " \t\r";
  const auto begin = s.find_first_not_of(blanks);
  return begin == s.npos ? std::string_view{} : s.substr(begin, s.find_last_not_of(blanks) - begin + 1);
}

/// A number of CiA 306: decimal, 0x hexadecimal, or $NODEID plus one.
std::optional<std::int64_t> number(std::string_view text, std::uint8_t node) {
  constexpr std::string_view node_id = "$nodeid";
  const std::string all = lower(trimmed(text));
  std::string_view s = all;
  if (s.starts_with(node_id)) {
    s = trimmed(s.substr(node_id.size()));
    if (s.empty()) return node;
    if (s.front() != '+') return std::nullopt;
    const auto rest = number(s.substr(1), 0);
    return rest ? std::optional(*rest + node) : std::nullopt;
  }
  if (const auto plus = s.find('+'); plus != s.npos && trimmed(s.substr(plus + 1)) == node_id) {
    const auto rest = number(s.substr(0, plus), 0);
    return rest ? std::optional(*rest + node) : std::nullopt;
  }
  if (s.starts_with("0x")) return to_integer<std::int64_t>(s.substr(2), 16);
  return to_integer<std::int64_t>(s);
}

using Section = std::map<std::string, std::string>;

Result<std::map<std::string, Section>> sections_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) return tl::unexpected(Error(fmt::format("{}: cannot be read; give an EDS file", file.string())));
  std::map<std::string, Section> all;
  Section* section = nullptr;
  std::string raw;
  for (int line = 1; std::getline(in, raw); ++line) {
    const std::string_view text = trimmed(raw);
    if (text.empty() || text.front() == ';') continue;
    const auto equals = text.find('=');
    if (text.front() == '[' && text.back() == ']')
      section = &all[lower(text.substr(1, text.size() - 2))];
    else if (section && equals != text.npos)
      (*section)[lower(trimmed(text.substr(0, equals)))] = trimmed(text.substr(equals + 1));
    else
      return tl::unexpected(
          Error(fmt::format("{}:{}: '{}' is neither [SECTION] nor KEY=VALUE of an EDS", file.string(), line, text)));
  }
  return all;
}

/// "6040" or "1018sub1"; nothing for other sections.
std::optional<EdsObject> named(const std::string& section) {
  const auto sub = section.find("sub");
  const auto index = to_integer<std::uint16_t>(section.substr(0, sub), 16);
  const auto number = sub == section.npos ? std::optional<std::uint8_t>(std::uint8_t{0})
                                          : to_integer<std::uint8_t>(section.substr(sub + 3), 16);
  if (section.substr(0, sub).size() != 4 || !index || !number) return std::nullopt;
  return EdsObject{.index = *index, .sub = *number, .name = {}, .access = {}};
}

/// A limit or default that a signed type writes as its bits.
std::optional<std::int64_t> as_signed(const EdsObject& o, std::optional<std::int64_t> value) {
  const int bits = 8 * o.size();
  if (value && o.is_signed() && bits < 64 && *value >= std::int64_t{1} << (bits - 1)) *value -= std::int64_t{1} << bits;
  return value;
}

void read(EdsObject& o, const Section& section, std::uint8_t node) {
  const auto text = [&](const char* key) {
    const auto found = section.find(key);
    return found == section.end() ? std::string{} : found->second;
  };
  o.name = text("parametername");
  o.data_type = static_cast<std::uint16_t>(number(text("datatype"), 0).value_or(0));
  o.access = lower(text("accesstype"));
  if (!o.size()) return;
  o.value = as_signed(o, number(text("defaultvalue"), node));
  o.low = as_signed(o, number(text("lowlimit"), node));
  o.high = as_signed(o, number(text("highlimit"), node));
}

}  // namespace

int EdsObject::size() const {
  const NumberType* type = number_type(data_type);
  return type ? type->bytes : 0;
}

bool EdsObject::is_signed() const {
  const NumberType* type = number_type(data_type);
  return type && type->is_signed;
}

Result<Eds> load_eds(const std::filesystem::path& file, std::uint8_t node) {
  auto sections = sections_of(file);
  if (!sections) return tl::unexpected(sections.error());
  Eds eds;
  for (const auto& [name, section] : *sections) {
    auto object = named(name);
    if (!object) continue;
    // An array or a record has its values in its sub-indices.
    const auto kind = section.find("objecttype");
    const auto type = kind == section.end() ? 7 : number(kind->second, 0).value_or(7);
    if (type != 7 && type != 2) continue;
    read(*object, section, node);
    if (object->access.empty())
      return tl::unexpected(Error(fmt::format("{}: [{}] has no AccessType", file.string(), name)));
    eds.objects.push_back(*std::move(object));
  }
  if (eds.objects.empty())
    return tl::unexpected(Error(fmt::format("{}: describes no object; give an EDS file (CiA 306)", file.string())));
  const Section& device = (*sections)["deviceinfo"];
  if (const auto at = device.find("vendornumber"); at != device.end()) eds.vendor = number(at->second, 0);
  if (const auto at = device.find("productnumber"); at != device.end()) eds.product = number(at->second, 0);
  return eds;
}

}  // namespace tribotwin::hil
