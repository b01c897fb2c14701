#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/law.hpp>

/// Numbers of a twin that identification by simulation may change.
namespace tribotwin::twin::identification {

/// Part of the twin that a quantity belongs to: a drive's configuration, its MJCF joint, a body, the controller of a
/// drive, the recorded motion.
enum class Place { drive, joint, body, control, motion };
std::string_view name(Place place);

/// What followed the set points when a recording was made: a small servo's firmware (DcPositionOptions), or the loops
/// of industrial drives (CascadedOptions without gravity) from the outermost to the innermost.
enum class Controller { dc_position, servo, velocity, torque };
std::string_view name(Controller controller);

/// The accepted keys of a place; for the drive those of one law, for the controller those of any.
std::vector<std::string_view> keys_of(Place place, const friction::LawInfo& law);
/// Whether the controller has this key. Loops have those of the loops within them.
bool has_key(Controller controller, std::string_view key);
/// The accepted range of a key. Unlimited for keys of a drive that are no law parameter: the loader checks them.
std::pair<double, double> accepted_range(Place place, const friction::LawInfo& law, std::string_view key);

/// A number of the twin, known or to be identified (`free`).
struct Quantity {
  Place place = Place::drive;
  std::string key;
  std::string owner{};  ///< joint or body; empty: the motion, or the model's only joint
  double start = 0;     ///< the value where it is known, the prior mean where it is free
  bool free = false;
  double low = 0, high = 0;  ///< bounds, start within them
  double sigma = 0;          ///< prior standard deviation, of ln(value) if logarithmic; 0: no prior
  bool logarithmic = false;  ///< needs low > 0

  std::string path() const;      ///< "drive.Fcl", "drive.elbow.Fcl"
  double scale() const;          ///< of the coordinate z of the search
  double value(double z) const;  ///< clamped to the bounds
  double coordinate(double value) const;
};

}  // namespace tribotwin::twin::identification
