#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/tables/column_map.hpp>

namespace tribotwin::twin {
namespace {

constexpr char iso8601[] = "iso8601";

/// The unit of the foreign numbers: that of the entry, or of the key.
const Unit* unit_of(Mapping& entry, const ColumnName& name, bool& date) {
  if (!entry.has("unit")) return name.unit;
  const std::string text = entry.text("unit");
  if (!name.unit) entry.fail("unit", fmt::format("{} has no unit", name.quantity->name));
  date = text == iso8601 && name.unit->dimension == Dimension::time;
  if (date) return name.unit;
  const Unit* unit = find_unit(text, std::array{name.unit->dimension});
  if (unit) return unit;
  std::string accepted;
  for (const auto& u : units())
    if (u.dimension == name.unit->dimension) accepted += fmt::format("{}{}", accepted.empty() ? "" : ", ", u.name);
  if (name.unit->dimension == Dimension::time) accepted += fmt::format(", {}", iso8601);
  entry.fail("unit", fmt::format("{} is no unit of {}; accepted are {}", shown(text), name.quantity->name, accepted));
}

MappedColumn read_entry(Mapping& in, const std::string& key, const std::filesystem::path& file) {
  const auto name = parse_column(key);
  if (!name) in.fail(key, name.error().message);
  if (!*name)
    in.fail(key, "is no name of a column; it must be QUANTITY_JOINT_UNIT, for example position_joint1_rad or time_s");
  MappedColumn out{.name = **name,
                   .from = {},
                   .factor = (*name)->unit ? (*name)->unit->factor : 1,
                   .offset = (*name)->unit ? (*name)->unit->offset : 0,
                   .where = fmt::format("{}: {}", file.string(), key)};
  const YAML::Node node = in.raw(key);
  if (node.IsScalar()) {
    out.from = in.text(key);
  } else {
    auto entry = in.mapping(key);
    if (!entry) in.fail(key, "must be a name, or a mapping with the key 'from'");
    entry->accept({"from", "unit", "scale", "offset", "sign", "rate_hz"});
    if (entry->has("rate_hz")) {
      if (out.name.text() != "time_s" || entry->has("from"))
        entry->fail("rate_hz", "makes the time_s of a table that has none; it goes without 'from'");
      out.rate_hz = entry->number("rate_hz", {1e-6, 1e9});
      entry->done();
      return out;
    }
    out.from = entry->text("from");
    const Unit* unit = unit_of(*entry, out.name, out.date);
    const double scale = entry->number_or("scale", 1, {-1e12, 1e12}), sign = entry->number_or("sign", 1, {-1, 1}),
                 offset = entry->number_or("offset", 0, {-1e12, 1e12});
    if (scale == 0) entry->fail("scale", "must not be 0");
    if (sign != 1 && sign != -1) entry->fail("sign", "must be 1 or -1");
    const double factor = unit ? unit->factor : 1;
    out.factor = factor * (sign * scale);
    out.offset = factor * offset + (unit ? unit->offset : 0);
    entry->done();
  }
  if (out.from.empty()) in.fail(key, "must name a column of the table");
  if (out.is_pattern() && (std::ranges::count(out.from, '*') != 1 || std::ranges::count(out.name.joint, '*') != 1))
    in.fail(key, fmt::format("is a pattern; it takes one * in the joint's name and one in the foreign name, {}",
                             shown(out.from)));
  return out;
}

}  // namespace

Result<std::vector<MappedColumn>> read_column_map(const std::filesystem::path& file,
                                                  const std::vector<std::string>& texts) try {
  Mapping in(file.string(), "", load_yaml(file));
  std::vector<MappedColumn> all;
  bool any_text = false;
  for (const auto& key : in.names()) {
    if (std::ranges::find(texts, key) != texts.end()) {
      any_text = !in.text(key).empty();
      continue;
    }
    auto entry = read_entry(in, key, file);
    if (const auto twice = std::ranges::find(all, entry.name.text(), [](const auto& m) { return m.name.text(); });
        twice != all.end())
      in.fail(key, fmt::format("is {}, which is mapped from {} already", entry.name.text(), shown(twice->from)));
    all.push_back(std::move(entry));
  }
  if (all.empty() && !any_text) throw InputError(fmt::format("{}: maps no column", file.string()));
  in.done();
  return all;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

Result<std::vector<std::string>> read_text_map(const std::filesystem::path& file,
                                               const std::vector<std::string>& texts) try {
  Mapping in(file.string(), "", load_yaml(file));
  std::vector<std::string> all;
  for (const auto& key : texts) {
    all.push_back(in.has(key) ? in.text(key) : "");
    if (in.has(key) && all.back().empty()) in.fail(key, "must name a column of the table");
  }
  return all;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin
