#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

/// The one convention for the columns of all tables: QUANTITY[_JOINT]_UNIT, such as time_s, position_joint1_rad,
/// velocity_shoulder_pan_joint_rad_s. JOINT.QUANTITY_UNIT and JOINT/QUANTITY_UNIT say the same; the unit may also stand
/// in brackets behind the rest, as in "position_joint1 [deg]".
namespace tribotwin::twin {

/// Unit and plausible range of a measured number. A number outside is no measurement of a joint.
struct Quantity {
  std::string_view unit;
  double minimum, maximum;

  bool contains(double value) const { return value >= minimum && value <= maximum; }
  /// "must be within MINIMUM .. MAXIMUM UNIT"
  std::string requirement() const;
};
/// The quantity by the base unit at the end of a column's name: "time_s", "torque_joint2_nm".
const Quantity& quantity_of(std::string_view column);

/// What is measured alike: all units of a dimension convert into its base unit.
enum class Dimension { time, angle, length, angular_speed, speed, torque, force, current, temperature, power, ratio };

/// base = factor x number + offset
struct Unit {
  std::string_view name;  ///< at the end of a column's name; upper and lower case differ
  Dimension dimension;
  double factor, offset;
};
std::span<const Unit> units();
/// The unit of that name among those of `dimensions`, or of any where there are none.
const Unit* find_unit(std::string_view name, std::span<const Dimension> dimensions = {});
/// How a base unit is spelled in names: "rad_s".
std::string_view base_unit(Dimension dimension);

/// A quantity that columns are named after.
struct ColumnQuantity {
  std::string_view name, aliases;     ///< aliases: former or other spellings, with blanks between
  std::vector<Dimension> dimensions;  ///< none: a number without a unit
  std::string_view meaning;
};
std::span<const ColumnQuantity> column_quantities();

/// A column's name, taken apart.
struct ColumnName {
  const ColumnQuantity* quantity;
  std::string joint;  ///< empty where the name has none
  const Unit* unit;   ///< nothing: a number without a unit

  /// QUANTITY[_JOINT]_UNIT in the base unit: the name by which readers ask for the column.
  std::string text() const;
};

/// Takes a header's cell apart. Nothing where it begins with no quantity of the convention: a column of something else.
/// Fails where it names a quantity but no unit of it, or can be read in two ways; the message has the header's text and
/// what is accepted.
Result<std::optional<ColumnName>> parse_column(std::string_view header);

/// Names and units as the part of a README that follows from these tables.
std::string column_reference_markdown();

/// For messages: printable, quoted and, where long, cut.
std::string shown(std::string_view cell);
/// The cells of a header for messages, at most about 60.
std::string shown(std::span<const std::string> header);

}  // namespace tribotwin::twin
