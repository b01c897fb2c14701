#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/hil/canopen/setup/object_values.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// EDS and DCF files (CiA 306): INI, one section per object.
namespace tribotwin::hil {

/// A value of a key.
struct EdsText {
  std::string text;
  int line = 0;
};

/// Sections and keys, in lower case. Empty values are left out.
using EdsSections = std::map<std::string, std::map<std::string, EdsText>>;

/// Fails with file and line where a line is neither [SECTION] nor KEY=VALUE, or gives a key another value.
Result<EdsSections> read_eds_sections(const std::filesystem::path& file);

/// One entry of the object dictionary.
struct EdsObject {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  std::string name;
  Type type = Type::u32;
  Access access = Access::read_only;
  bool mappable = false;
  std::optional<EdsText> default_value, parameter_value, low, high;
  int line = 0;
};

struct EdsFile {
  std::filesystem::path file;
  std::optional<std::uint8_t> node_number;  ///< of a DCF
  std::vector<EdsObject> objects;           ///< by index and sub-index; data types (below 1000h) are left out

  /// The values of a DCF (ParameterValue) for a node of this number, those that can be written and are no
  /// commands to a memory (1003h, 1010h, 1011h).
  Result<std::vector<ObjectValue>> values(std::uint8_t node) const;
  /// The objects with their defaults; a base where the file adds $NODEID.
  Result<std::vector<Object>> defaults() const;
};

/// Fails with file, line and what would be right.
Result<EdsFile> read_eds_file(const std::filesystem::path& file);

}  // namespace tribotwin::hil
