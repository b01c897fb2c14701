#pragma once

#include <string_view>

#include <tribotwin/twin/control/dc_position_keys.hpp>
#include <tribotwin/twin/identification/quantity.hpp>

/// Internal to this folder, not installed.
namespace tribotwin::twin::identification {

/// A key of joint, body, controller or motion.
struct Key {
  Place place;
  std::string_view name;
  double minimum, maximum;
  const DcPositionKey* dc = nullptr;  ///< of keys of the controllers
  double LoopGains::*servo = nullptr;
  Controller innermost = Controller::servo;  ///< of the loops that have it
};

/// Null where there is no such key, also for keys of a drive.
const Key* find_key(Place place, std::string_view name);

/// Whether some law has this parameter.
bool is_law_parameter(std::string_view key);

}  // namespace tribotwin::twin::identification
