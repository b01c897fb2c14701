#include <algorithm>
#include <array>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/twin/io/tables/column.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

constexpr double pi = std::numbers::pi;

/// By Dimension. The ranges are wide: those who know the joint judge what is merely unlikely (degrees for kelvins).
constexpr struct {
  Dimension dimension;
  std::string_view name, base;
  Quantity quantity;
} dimension_table[] = {{Dimension::time, "time", "s", {" s", -1e10, 1e10}},
                       {Dimension::angle, "an angle", "rad", {" rad", -1e6, 1e6}},
                       {Dimension::length, "a length", "m", {" m", -1e6, 1e6}},
                       {Dimension::angular_speed, "an angular speed", "rad_s", {" rad/s", -1e6, 1e6}},
                       {Dimension::speed, "a speed", "m_s", {" m/s", -1e4, 1e4}},
                       {Dimension::torque, "a torque", "nm", {" Nm", -1e7, 1e7}},
                       {Dimension::force, "a force", "n", {" N", -1e7, 1e7}},
                       {Dimension::current, "a current", "a", {" A", -1e6, 1e6}},
                       {Dimension::temperature, "a temperature", "degC", {" degC", -273.15, 1000}},
                       {Dimension::power, "a power", "w", {" W", -1e7, 1e7}},
                       {Dimension::ratio, "a ratio", "norm", {"", -1e6, 1e6}}};
constexpr Quantity any_number{"", -1e12, 1e12};

/// The base unit of a dimension comes first.
constexpr Unit unit_table[] = {{"s", Dimension::time, 1, 0},
                               {"ms", Dimension::time, 1e-3, 0},
                               {"us", Dimension::time, 1e-6, 0},
                               {"ns", Dimension::time, 1e-9, 0},
                               {"min", Dimension::time, 60, 0},
                               {"h", Dimension::time, 3600, 0},
                               {"rad", Dimension::angle, 1, 0},
                               {"mrad", Dimension::angle, 1e-3, 0},
                               {"deg", Dimension::angle, pi / 180, 0},
                               {"rev", Dimension::angle, 2 * pi, 0},
                               {"m", Dimension::length, 1, 0},
                               {"cm", Dimension::length, 1e-2, 0},
                               {"mm", Dimension::length, 1e-3, 0},
                               {"rad_s", Dimension::angular_speed, 1, 0},
                               {"mrad_s", Dimension::angular_speed, 1e-3, 0},
                               {"deg_s", Dimension::angular_speed, pi / 180, 0},
                               {"rev_s", Dimension::angular_speed, 2 * pi, 0},
                               {"rpm", Dimension::angular_speed, 2 * pi / 60, 0},
                               {"m_s", Dimension::speed, 1, 0},
                               {"mm_s", Dimension::speed, 1e-3, 0},
                               {"nm", Dimension::torque, 1, 0},
                               {"Nm", Dimension::torque, 1, 0},
                               {"mnm", Dimension::torque, 1e-3, 0},
                               {"mNm", Dimension::torque, 1e-3, 0},
                               {"ncm", Dimension::torque, 1e-2, 0},
                               {"Ncm", Dimension::torque, 1e-2, 0},
                               {"knm", Dimension::torque, 1e3, 0},
                               {"kNm", Dimension::torque, 1e3, 0},
                               {"n", Dimension::force, 1, 0},
                               {"N", Dimension::force, 1, 0},
                               {"kn", Dimension::force, 1e3, 0},
                               {"kN", Dimension::force, 1e3, 0},
                               {"a", Dimension::current, 1, 0},
                               {"A", Dimension::current, 1, 0},
                               {"ma", Dimension::current, 1e-3, 0},
                               {"mA", Dimension::current, 1e-3, 0},
                               {"degC", Dimension::temperature, 1, 0},
                               {"degF", Dimension::temperature, 5.0 / 9, -160.0 / 9},
                               {"K", Dimension::temperature, 1, -273.15},
                               {"w", Dimension::power, 1, 0},
                               {"W", Dimension::power, 1, 0},
                               {"mW", Dimension::power, 1e-3, 0},
                               {"kW", Dimension::power, 1e3, 0},
                               {"norm", Dimension::ratio, 1, 0},
                               {"percent", Dimension::ratio, 1e-2, 0}};

using enum Dimension;
/// What commands write and read. Longer names come before names that they begin with.
const ColumnQuantity quantity_table[] = {
    {"time", "", {time}, "from any start, increasing"},
    {"position", "", {angle, length}, "of the joint, arm side"},
    {"velocity", "", {angular_speed, speed}, "of the joint, arm side"},
    {"torque", "measured", {torque, force}, "of the motor, seen from the arm: motor_torque x gear ratio"},
    {"motor_torque", "", {torque}, "of the motor, motor side"},
    {"current", "", {current}, "of the motor; becomes torque by --torque-constant"},
    {"temperature", "cycle_temperature", {temperature}, "of the lubricant"},
    {"load", "", {torque, force, ratio}, "what the gear transmits to the arm; norm: over torque_max_nm"},
    {"friction",
     "",
     {torque, force, ratio},
     "positive when it opposes positive motion, arm side; norm: over torque_max_nm"},
    {"power", "cycle_friction_power", {power}, "friction heat of the joint"},
    {"set_point",
     "",
     {angle, length, angular_speed, speed, torque, force},
     "what the controller was commanded: position, speed or torque of the motor, seen from the arm"},
    {"torsion", "", {angle, length}, "of the transmission, arm side"},
    {"transmission_torque", "", {torque, force}, "of the transmission on the arm"},
    {"arm_position", "", {angle, length}, "behind the transmission"},
    {"arm_set_point", "", {angle, length}, "of the arm's position"},
    {"predicted", "", {torque, force}, "torque that a motion needs"},
    {"band", "", {torque, force}, "half the width of the 95 % band of measured about predicted torque"},
    {"residual", "", {torque, force}, "measured - predicted torque"},
    {"moving", "", {}, "1 where the joint moves, 0 where it rests and friction does not follow from its motion"},
    {"force", "", {force}, "at the tool; the joint is its axis"},
    {"speed", "", {angular_speed}, "of the motor, motor side"},
    {"stderr", "", {torque, ratio}, "standard error of friction"},
    {"friction_forward", "", {torque, ratio}, "friction of positive motion"},
    {"friction_backward", "", {torque, ratio}, "friction of negative motion"},
    {"lag", "", {time}, "of the torque behind the position"},
    {"ripple", "", {torque}, "torque periodic in the joint's angle"},
    {"lost_motion", "", {angle}, "travel after a reversal before the gear carries torque"},
    {"series", "", {}, "name of a group of curves"},
    {"curve", "", {}, "number of a friction curve"},
    {"section", "", {}, "number of a part of a motion"}};

std::string units_of(const ColumnQuantity& quantity) {
  std::string s;
  for (const auto& unit : unit_table)
    if (std::ranges::find(quantity.dimensions, unit.dimension) != quantity.dimensions.end())
      s += fmt::format("{}{}", s.empty() ? "" : ", ", unit.name);
  return s;
}

/// All names of a quantity, its own first.
std::vector<std::string_view> spellings(const ColumnQuantity& quantity) {
  std::vector<std::string_view> all{quantity.name};
  for (std::string_view rest = quantity.aliases; !rest.empty();) {
    const auto blank = std::min(rest.find(' '), rest.size());
    all.push_back(rest.substr(0, blank));
    rest.remove_prefix(std::min(blank + 1, rest.size()));
  }
  return all;
}

/// The longest unit of the quantity that `text` ends with, behind a '_'.
const Unit* unit_at_end(std::string_view text, const ColumnQuantity& quantity) {
  const Unit* longest = nullptr;
  for (const auto& unit : unit_table)
    if (text.size() > unit.name.size() && text.ends_with(unit.name) &&
        text[text.size() - unit.name.size() - 1] == '_' &&
        std::ranges::find(quantity.dimensions, unit.dimension) != quantity.dimensions.end() &&
        (!longest || unit.name.size() > longest->name.size()))
      longest = &unit;
  return longest;
}

/// QUANTITY[_JOINT]_UNIT; the longest quantity that has a unit there applies.
std::optional<ColumnName> in_order(std::string_view text) {
  std::optional<ColumnName> found;
  std::size_t longest = 0;
  for (const auto& quantity : quantity_table)
    for (const auto name : spellings(quantity)) {
      if (!text.starts_with(name) || name.size() < longest) continue;
      if (quantity.dimensions.empty() && text == name) found = {&quantity, "", nullptr}, longest = name.size();
      const Unit* unit = unit_at_end(text.substr(name.size()), quantity);
      if (!unit) continue;
      const std::string_view between = text.substr(name.size(), text.size() - name.size() - unit->name.size() - 1);
      if (!between.empty() && (between.size() < 2 || between[0] != '_')) continue;
      found = {&quantity, std::string(between.empty() ? between : between.substr(1)), unit};
      longest = name.size();
    }
  constexpr std::string_view former = "power_w_";  // of thermal: power_w_JOINT
  if (!found && text.size() > former.size() && text.starts_with(former))
    return ColumnName{&*std::ranges::find(quantity_table, "power", &ColumnQuantity::name),
                      std::string(text.substr(former.size())), find_unit("w")};
  return found;
}

/// JOINT.QUANTITY_UNIT or JOINT/QUANTITY_UNIT. Joints may have points in their names, quantities have none.
std::optional<ColumnName> joint_first(std::string_view text) {
  const auto point = text.find_last_of("./");
  if (point == text.npos || point == 0) return std::nullopt;
  auto rest = in_order(text.substr(point + 1));
  if (!rest || !rest->joint.empty()) return std::nullopt;
  rest->joint = text.substr(0, point);
  return rest;
}

/// "position_joint1 [deg/s]" as "position_joint1_deg_s"; anything else as it is.
std::string without_brackets(std::string_view text) {
  if (text.empty() || (text.back() != ']' && text.back() != ')')) return std::string(text);
  const auto open = text.rfind(text.back() == ']' ? '[' : '(');
  if (open == text.npos || open == 0) return std::string(text);
  std::string unit(trimmed(text.substr(open + 1, text.size() - open - 2)));
  for (const auto& [sign, name] : {std::pair{"\xC2\xB0", "deg"}, {"/", "_"}})
    if (const auto at = unit.find(sign); at != unit.npos) unit.replace(at, std::string_view(sign).size(), name);
  return fmt::format("{}_{}", trimmed(text.substr(0, open)), unit);
}

/// The quantity that the text begins with as a whole word, the longest; for messages.
const ColumnQuantity* quantity_at_start(std::string_view text) {
  const ColumnQuantity* found = nullptr;
  std::size_t longest = 0;
  for (const auto& quantity : quantity_table)
    for (const auto name : spellings(quantity))
      if (name.size() > longest && !quantity.dimensions.empty() && text.starts_with(name) &&
          (text.size() == name.size() || text[name.size()] == '_' || text[name.size()] == ' '))
        found = &quantity, longest = name.size();
  return found;
}

/// "a is a unit of a current"
std::string what_it_is(std::string_view text) {
  const auto last = text.find_last_of("_. ");
  const std::string_view end = last == text.npos ? text : text.substr(last + 1);
  const Unit* unit = find_unit(end);
  if (!unit || last == text.npos) return "its name ends with no unit";
  return fmt::format("'{}' is a unit of {}", end, dimension_table[static_cast<std::size_t>(unit->dimension)].name);
}

Error no_unit(std::string_view header, std::string_view text, const ColumnQuantity& quantity) {
  return fmt::format(
      "column {}: {}; {} is in {}{}", shown(header), what_it_is(text), quantity.name, units_of(quantity),
      what_it_is(text).ends_with("current") ? "; a current is current_JOINT_a with --torque-constant" : "");
}

}  // namespace

std::string Quantity::requirement() const {
  return fmt::format("must be within {:g} .. {:g}{}", minimum, maximum, unit);
}

const Quantity& quantity_of(std::string_view column) {
  const Quantity* found = &any_number;
  std::size_t longest = 0;
  for (const auto& row : dimension_table)
    if (column.size() > row.base.size() && row.base.size() > longest && column.ends_with(row.base) &&
        column[column.size() - row.base.size() - 1] == '_')
      found = &row.quantity, longest = row.base.size();
  return *found;
}

std::span<const Unit> units() { return unit_table; }

const Unit* find_unit(std::string_view name, std::span<const Dimension> dimensions) {
  for (const auto& unit : unit_table)
    if (unit.name == name && (dimensions.empty() || std::ranges::find(dimensions, unit.dimension) != dimensions.end()))
      return &unit;
  return nullptr;
}

std::string_view base_unit(Dimension dimension) { return dimension_table[static_cast<std::size_t>(dimension)].base; }

std::span<const ColumnQuantity> column_quantities() { return quantity_table; }

std::string ColumnName::text() const {
  std::string s(quantity->name);
  if (!joint.empty()) s += "_" + joint;
  if (unit) s += fmt::format("_{}", base_unit(unit->dimension));
  return s;
}

Result<std::optional<ColumnName>> parse_column(std::string_view header) {
  const std::string text = without_brackets(trimmed(header));
  const auto first = joint_first(text), last = in_order(text);
  if (first && last && first->text() != last->text())
    return tl::unexpected(fmt::format("column {}: is {} of joint {} or {} of joint {}; write QUANTITY_JOINT_UNIT",
                                      shown(header), first->quantity->name, shown(first->joint), last->quantity->name,
                                      shown(last->joint)));
  if (first) return first;
  if (last) return last;
  const auto point = text.find_last_of("./");
  for (const std::string_view part :
       {std::string_view(text), point == text.npos ? std::string_view{} : std::string_view(text).substr(point + 1)})
    if (const auto* quantity = quantity_at_start(part)) return tl::unexpected(no_unit(header, text, *quantity));
  return std::nullopt;
}

std::string column_reference_markdown() {
  std::string s = "| quantity | base unit | of |\n|---|---|---|\n";
  for (const auto& quantity : quantity_table) {
    std::string names = fmt::format("`{}`", quantity.name), bases;
    for (const auto name : spellings(quantity))
      if (name != quantity.name) names += fmt::format(", `{}`", name);
    for (const auto dimension : quantity.dimensions)
      bases += fmt::format("{}`{}`", bases.empty() ? "" : ", ", base_unit(dimension));
    s += fmt::format("| {} | {} | {} |\n", names, bases.empty() ? "none" : bases, quantity.meaning);
  }
  s += "\n| unit | converts into | by |\n|---|---|---|\n";
  for (const auto& unit : unit_table)
    s += fmt::format(
        "| `{}` | `{}` | x {:.10g}{} |\n", unit.name, base_unit(unit.dimension), unit.factor,
        unit.offset == 0 ? "" : fmt::format(" {} {:.10g}", unit.offset < 0 ? '-' : '+', std::abs(unit.offset)));
  return s;
}

std::string shown(std::string_view cell) {
  constexpr std::size_t longest = 60;
  return fmt::format("'{}'{}", printable(cell.substr(0, longest)), cell.size() > longest ? "..." : "");
}

std::string shown(std::span<const std::string> header) {
  constexpr std::size_t most = 60, longest = 60;
  std::vector<std::string> names;
  for (const auto& name : header.first(std::min(most, header.size())))
    names.push_back(printable(name.substr(0, longest)) + (name.size() > longest ? "..." : ""));
  return joined(names) + (header.size() > most ? fmt::format(" and {} more", header.size() - most) : "");
}

}  // namespace tribotwin::twin
