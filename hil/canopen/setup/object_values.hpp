#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/hil/canopen/dictionary.hpp>

/// Values for many objects at once: what a drive kept, or what a configuration file gives it.
namespace tribotwin::hil {

struct ObjectValue {
  std::uint16_t index;
  std::uint8_t sub;
  std::vector<std::uint8_t> bytes;  ///< as on the bus, little-endian
  int line = 0;                     ///< of the file that it came from; 0: of none
};

/// What a drive keeps while it is off (1010h, LSS).
struct KeptParameters {
  std::optional<std::uint8_t> node_number;  ///< FFh: none
  std::vector<ObjectValue> values;
};

/// A value that an object refused.
struct RefusedValue {
  ObjectValue value;
  Abort why;

  /// "1017h:00: does not exist": for messages.
  std::string text() const;
};

/// Writes the values as a master would, with all checks and in the order that CiA 301 asks for: a PDO is switched off
/// while its parameters change, 1006h is 0 while 1019h does, and no TIME is taken while 1012h does. The first that is
/// refused ends it.
std::optional<RefusedValue> download(Dictionary& dictionary, std::vector<ObjectValue> values);

/// A dictionary with the objects of another maker's drive beside its own: those of other indices, and from 2000h on
/// other sub-indices. Who the drive says it is (1000h, 1008h to 100Ah, 1018h:01 to :03) is taken over. `node`: is added
/// to values with a base.
Dictionary with_foreign_objects(const Dictionary& own, std::span<const Object> foreign, std::uint8_t node);

/// The value of an object now.
ObjectValue value_of(const Object& object);

}  // namespace tribotwin::hil
