#pragma once

namespace tribotwin {

/// A key of a configuration: a row of the table that reading, messages and documentation follow.
struct Key {
  const char* name;
  const char* unit;
  const char* fallback;  ///< "" = required
  double minimum, maximum;
  const char* meaning;
};

}  // namespace tribotwin
