#include <algorithm>
#include <optional>
#include <set>
#include <string_view>
#include <unordered_map>
#include <unordered_set>

#include <fmt/format.h>

#include <tribotwin/twin/io/tables/layout.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::tables {
namespace {

using Status = Result<void>;

LaidColumn by_name(const std::string& header) {
  LaidColumn column{.name = header, .joint = {}, .problem = {}};
  const auto parsed = parse_column(header);
  if (!parsed) {
    column.problem = parsed.error().message;
  } else if (*parsed) {
    column.name = (*parsed)->text(), column.joint = (*parsed)->joint, column.quantity = (*parsed)->quantity;
    if (const Unit* unit = (*parsed)->unit) column.factor = unit->factor, column.offset = unit->offset;
  }
  return column;
}

/// What the '*' of a pattern is in a name; nothing where the name does not fit.
std::optional<std::string> matched(std::string_view pattern, std::string_view name) {
  const auto star = pattern.find('*');
  const auto before = pattern.substr(0, star), after = pattern.substr(star + 1);
  if (name.size() <= before.size() + after.size() || !name.starts_with(before) || !name.ends_with(after))
    return std::nullopt;
  return std::string(name.substr(before.size(), name.size() - before.size() - after.size()));
}

/// One entry for every column that a pattern fits.
Result<std::vector<MappedColumn>> expanded(std::vector<MappedColumn> map, const Layout& layout) {
  std::vector<MappedColumn> all;
  for (auto& entry : map) {
    if (!entry.is_pattern()) {
      all.push_back(std::move(entry));
      continue;
    }
    const std::size_t before = all.size();
    for (const auto& header : layout.headers)
      if (const auto part = matched(entry.from, header)) {
        MappedColumn& one = all.emplace_back(entry);
        one.from = header;
        one.name.joint.replace(one.name.joint.find('*'), 1, *part);
      }
    if (all.size() == before)
      return tl::unexpected(fmt::format("{}: {} has no column like {}; the header names {}", entry.where,
                                        layout.file.string(), shown(entry.from), shown(layout.headers)));
  }
  return all;
}

/// Places by text, each list ascending: files have up to limits::array_columns columns.
class Places {
 public:
  Places() = default;
  explicit Places(const std::vector<std::string>& texts) {
    for (const auto& text : texts) add(text);
  }
  void add(const std::string& text) { places_[text].push_back(count_++); }
  const std::vector<std::size_t>& of(const std::string& text) const {
    static const std::vector<std::size_t> none;
    const auto found = places_.find(text);
    return found == places_.end() ? none : found->second;
  }

 private:
  std::unordered_map<std::string, std::vector<std::size_t>> places_;
  std::size_t count_ = 0;
};

Places names_of(const Layout& layout) {
  Places places;
  for (const auto& column : layout.columns) places.add(column.name);
  return places;
}

/// Entries of --columns take the place of what the headers say.
Status apply_map(Layout& layout, const std::filesystem::path& file, const std::vector<std::string>& texts) {
  if (file.empty()) return {};
  auto given = read_column_map(file, texts);
  if (!given) return tl::unexpected(given.error());
  const auto map = expanded(std::move(*given), layout);
  if (!map) return tl::unexpected(map.error());
  std::set<std::string> mapped;
  Places headers(layout.headers), names = names_of(layout);
  for (const auto& entry : *map) {
    if (entry.rate_hz > 0) {
      for (auto& column : layout.columns)
        if (column.name == "time_s") column.name.clear();
      layout.headers.emplace_back("rate_hz");
      layout.columns.push_back({.name = "time_s", .joint = {}, .rate_hz = entry.rate_hz, .problem = {}});
      headers.add("rate_hz"), names.add("time_s");
      continue;
    }
    const auto& places = headers.of(entry.from);
    if (places.empty())
      return tl::unexpected(fmt::format("{}: {} has no column {}; the header names {}", entry.where,
                                        layout.file.string(), shown(entry.from), shown(layout.headers)));
    if (places.size() > 1)
      return tl::unexpected(fmt::format("{}: {} has {} columns {}; rename all but one", entry.where,
                                        layout.file.string(), places.size(), shown(entry.from)));
    const std::size_t at = places.front();
    if (!mapped.insert(entry.from).second)
      return tl::unexpected(fmt::format("{}: {} is mapped already", entry.where, shown(entry.from)));
    layout.columns[at] = {.name = entry.name.text(),
                          .joint = entry.name.joint,
                          .quantity = entry.name.quantity,
                          .date = entry.date,
                          .factor = entry.factor,
                          .offset = entry.offset,
                          .problem = {}};
    // A column that has this name by itself is not meant.
    for (const std::size_t k : names.of(layout.columns[at].name))
      if (k != at && !mapped.contains(layout.headers[k]) && layout.columns[k].name == layout.columns[at].name)
        layout.columns[k] = {.name = {}, .joint = {}, .problem = {}};
  }
  return {};
}

/// torque = KT x gear ratio x current.
Status apply_torque_constant(Layout& layout, const TableOptions& options) {
  if (!options.torque_constant.given()) return {};
  std::size_t used = 0;
  Places names = names_of(layout);
  for (std::size_t k = 0; k < layout.columns.size(); ++k) {
    LaidColumn& column = layout.columns[k];
    if (!column.quantity || column.quantity->name != "current") continue;
    // A table of one joint may go without its name.
    const std::string joint = column.joint.empty() ? options.joint : column.joint;
    const auto constant = options.torque_constant.find(joint), gear = options.gear_ratio.find(joint);
    if (!constant) continue;
    const std::string torque = column.joint.empty() ? "torque_nm" : fmt::format("torque_{}_nm", column.joint);
    if (!names.of(torque).empty())
      return tl::unexpected(fmt::format(
          "{}:1: has {} beside {}; --torque-constant would replace it: take one of the columns out, or the option",
          layout.file.string(), torque, shown(layout.headers[k])));
    if (!gear)
      return tl::unexpected(
          fmt::format("{}:1: column {}: torque at the arm is torque constant x gear ratio x current: --gear-ratio is "
                      "needed (1 where the constant is that of the arm side)",
                      layout.file.string(), shown(layout.headers[k])));
    column.name = torque, names.add(torque);
    column.factor *= *constant * *gear, column.offset *= *constant * *gear;
    ++used;
  }
  if (used == 0)
    return tl::unexpected(
        fmt::format("{}:1: --torque-constant: no column current_JOINT_a of such a joint; the header "
                    "names {}",
                    layout.file.string(), shown(layout.headers)));
  return {};
}

/// The joints of the table, in the order of the header.
std::vector<std::string> joints_of(const Layout& layout) {
  std::vector<std::string> joints;
  std::unordered_set<std::string_view> there;
  for (const auto& column : layout.columns)
    if (column.quantity && !column.joint.empty() && there.insert(column.joint).second) joints.push_back(column.joint);
  return joints;
}

void rename_joint(Layout& layout, const std::string& from, const std::string& to) {
  for (auto& column : layout.columns) {
    if (!column.quantity || column.joint != from) continue;
    const std::string rest = column.name.substr(column.quantity->name.size() + (from.empty() ? 0 : 1 + from.size()));
    // Time belongs to all joints.
    if (from.empty() && (column.quantity->name == "time" || column.quantity->dimensions.empty())) continue;
    column.joint = to;
    column.name = fmt::format("{}{}{}{}", column.quantity->name, to.empty() ? "" : "_", to, rest);
  }
}

/// Readers of one joint want names without a joint, readers of a robot names with one; a table of one joint suits both.
Status choose_joint(Layout& layout, const std::vector<std::string>& wanted, const std::string& joint) {
  const auto joints = joints_of(layout);
  std::set<std::string> asked;  // joints that are wanted
  bool ambiguous = false, jointless = false;
  for (const auto& name : wanted) {
    const auto parsed = parse_column(name);
    if (!parsed || !*parsed || (*parsed)->quantity->name == "time" || !(*parsed)->unit) continue;
    asked.insert((*parsed)->joint);
    if (!(*parsed)->joint.empty()) continue;
    const bool there = std::ranges::find(layout.columns, name, &LaidColumn::name) != layout.columns.end();
    jointless |= there;
    ambiguous |= !there && std::ranges::any_of(layout.columns, [&](const LaidColumn& c) {
      return c.quantity == (*parsed)->quantity && !c.joint.empty();
    });
  }
  if (asked.contains("")) {
    if (!ambiguous || (jointless && joint.empty())) return {};
    if (joint.empty() && joints.size() > 1)
      return tl::unexpected(
          fmt::format("{}:1: has the joints {}; --joint says which", layout.file.string(), shown(joints)));
    if (!joint.empty() && std::ranges::find(joints, joint) == joints.end())
      return tl::unexpected(
          fmt::format("{}:1: no joint {}; it has {}", layout.file.string(), shown(joint), shown(joints)));
    if (!joints.empty()) rename_joint(layout, joint.empty() ? joints.front() : joint, "");
  } else if (asked.size() == 1 && joints.empty()) {
    rename_joint(layout, "", *asked.begin());
  }
  return {};
}

/// Two columns for one quantity cannot both be meant; columns of something else may have one name.
Status refuse_twice(const Layout& layout) {
  const Places names = names_of(layout);
  for (std::size_t k = 0; k < layout.columns.size(); ++k)
    if (layout.columns[k].quantity && !layout.columns[k].name.empty()) {
      const std::size_t i = names.of(layout.columns[k].name).front();
      if (i == k) continue;
      return tl::unexpected(layout.headers[i] == layout.headers[k]
                                ? fmt::format("{}:1: column {} twice", layout.file.string(), shown(layout.headers[k]))
                                : fmt::format("{}:1: columns {} and {} are both {}; take one out", layout.file.string(),
                                              shown(layout.headers[i]), shown(layout.headers[k]),
                                              shown(layout.columns[k].name)));
    }
  return {};
}

/// The name that a slide's column has where the hinge's is `name`.
std::string of_slide(const std::string& name) {
  const auto parsed = parse_column(name);
  if (!parsed || !*parsed || !(*parsed)->unit) return name;
  for (const auto& [hinge, slide] : {std::pair{Dimension::angle, Dimension::length},
                                     {Dimension::angular_speed, Dimension::speed},
                                     {Dimension::torque, Dimension::force}}) {
    const Unit* unit = find_unit(base_unit(slide), (*parsed)->quantity->dimensions);
    if ((*parsed)->unit->dimension == hinge && unit)
      return ColumnName{(*parsed)->quantity, (*parsed)->joint, unit}.text();
  }
  return name;
}

/// Whether a column without a usable unit stands where `wanted` would: it names the same quantity, and the joint.
bool stands_for(const std::string& header, const ColumnName& wanted) {
  const auto says = [&](std::string_view part) {
    if (part.empty()) return true;
    for (auto at = header.find(part); at != header.npos; at = header.find(part, at + 1)) {
      const auto end = at + part.size();
      const bool begins = at == 0 || header[at - 1] == '_' || header[at - 1] == '.' || header[at - 1] == '/',
                 ends = end == header.size() || header[end] == '_' || header[end] == '.' || header[end] == '/' ||
                        header[end] == ' ';
      if (begins && ends) return true;
    }
    return false;
  };
  return says(wanted.quantity->name) && says(wanted.joint);
}

}  // namespace

Result<std::vector<Pick>> Layout::picks(const std::vector<std::string>& wanted) const {
  std::vector<Pick> out;
  for (std::size_t place = 0; place < wanted.size(); ++place) {
    if (wanted[place].empty()) continue;
    const auto found = std::ranges::find(columns, wanted[place], &LaidColumn::name);
    if (found != columns.end()) {
      const bool as_it_is = found->factor == 1 && found->offset == 0;
      out.push_back({.header = static_cast<std::size_t>(found - columns.begin()),
                     .place = place,
                     .factor = found->factor,
                     .offset = found->offset,
                     .as_it_is = as_it_is,
                     .rate_hz = found->rate_hz,
                     .date = found->date,
                     .quantity = quantity_of(wanted[place])});
      continue;
    }
    const auto name = parse_column(wanted[place]);
    if (!name || !*name) continue;
    for (std::size_t k = 0; k < columns.size(); ++k)
      if (!columns[k].problem.empty() && stands_for(headers[k], **name))
        return tl::unexpected(fmt::format("{}:1: {}", file.string(), columns[k].problem));
  }
  return out;
}

Result<Layout> lay_out(const std::filesystem::path& file, const std::vector<std::string>& headers,
                       const std::vector<std::string>& wanted, const TableOptions& options,
                       const std::vector<std::string>& texts) {
  Layout layout{.file = file, .headers = headers, .columns = {}};
  for (const auto& header : headers) layout.columns.push_back(by_name(header));
  if (auto ok = apply_map(layout, options.columns, texts); !ok) return tl::unexpected(ok.error());
  if (auto ok = apply_torque_constant(layout, options); !ok) return tl::unexpected(ok.error());
  if (auto ok = refuse_twice(layout); !ok) return tl::unexpected(ok.error());
  if (auto ok = choose_joint(layout, wanted, options.joint); !ok) return tl::unexpected(ok.error());
  for (const auto& name : wanted)
    if (options.any_joint && std::ranges::find(layout.columns, name, &LaidColumn::name) == layout.columns.end())
      for (auto& column : layout.columns)
        if (column.name == of_slide(name)) column.name = name;
  return layout;
}

}  // namespace tribotwin::twin::tables
