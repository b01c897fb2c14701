#pragma once

#include <functional>
#include <span>
#include <string>

#include <tribotwin/twin/control/servo.hpp>

/// The numbers of DcPositionOptions by the names that files give them.
namespace tribotwin::twin {

struct DcPositionKey {
  std::string name;
  double minimum, maximum;
  std::function<double&(DcPositionOptions&)> value;
  bool required = false;
  bool knot = false;  ///< says where a knot of a curve lies
};
std::span<const DcPositionKey> dc_position_keys();

/// What is wrong with numbers that depend on each other, "KEY: why"; empty where nothing is. Knots must come in order,
/// and factors need one.
std::string problem_of(const DcPositionOptions& options);

}  // namespace tribotwin::twin
