#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/twin/io/input.hpp>

/// What a sweep varies: one key of the scenario.
namespace tribotwin::twin::sweep {

struct Factor {
  enum class Kind {
    levels,   ///< a list or {from, to, count}: all equally probable
    uniform,  ///< low .. high
    normal    ///< mean, standard deviation
  };
  std::string key;  ///< of the scenario, dotted
  Kind kind = Kind::levels;
  std::vector<std::string> levels;
  double a = 0, b = 0;  ///< of uniform and normal

  /// Whether all levels are numbers; always of the others.
  bool numeric() const;
  /// The value at u in (0, 1), as the text of a setting; numbers read back as the same double.
  std::string value(double u) const;
  /// Values that show whether the scenario accepts the factor: all levels up to 100, else the ends; of normal the mean.
  std::vector<std::string> trial_values() const;
};

/// The factor at `key` of the mapping `factors`. Throws InputError.
Factor read_factor(Mapping& factors, const std::string& key);

}  // namespace tribotwin::twin::sweep
