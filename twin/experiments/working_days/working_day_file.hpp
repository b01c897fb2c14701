#pragma once

#include <cstddef>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/working_days/working_day.hpp>

/// A test of a campaign as JSON text.
namespace tribotwin::twin::repeatability {

std::string to_text(const WorkingDay& day);

/// Number of joints and base parameters of the robot.
struct Shape {
  std::size_t joints, base;
};
/// ErrorKind::input on text that is no day of such a robot, with the key and what would be right; every number is
/// finite and in its range.
Result<WorkingDay> from_text(const std::string& text, const Shape& shape);

}  // namespace tribotwin::twin::repeatability
