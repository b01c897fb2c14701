#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/law.hpp>

/// Numbers of a twin that identification by simulation may change.
namespace tribotwin::twin::identification {

/// Part of the twin that a quantity belongs to: a drive's configuration, its MJCF joint, the controller, the recorded
/// motion.
enum class Place { drive, joint, control, motion };
std::string_view name(Place place);
/// The accepted keys of a place; for the drive those of one law.
std::vector<std::string_view> keys_of(Place place, const friction::LawInfo& law);
/// The accepted range of a key. Unlimited for keys of a drive that are no law parameter: the loader checks them.
std::pair<double, double> accepted_range(Place place, const friction::LawInfo& law, std::string_view key);

/// A number of the twin, known or to be identified (`free`).
struct Quantity {
  Place place = Place::drive;
  std::string key;
  double start = 0;  ///< the value where it is known, the prior mean where it is free
  bool free = false;
  double low = 0, high = 0;  ///< bounds, start within them
  double sigma = 0;          ///< prior standard deviation, of ln(value) if logarithmic; 0: no prior
  bool logarithmic = false;  ///< needs low > 0

  std::string path() const;      ///< "drive.Fcl"
  double scale() const;          ///< of the coordinate z of the search
  double value(double z) const;  ///< clamped to the bounds
  double coordinate(double value) const;
};

}  // namespace tribotwin::twin::identification
