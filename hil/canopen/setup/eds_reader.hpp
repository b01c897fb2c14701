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
using EdsKeys = std::map<std::string, EdsText>;
using EdsSections = std::map<std::string, EdsKeys>;

/// Fails with file and line where a line is neither [SECTION] nor KEY=VALUE, or gives a key another value. `file`: for
/// messages.
Result<EdsSections> parse_eds_sections(const std::string& content, const std::filesystem::path& file);

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

  /// ParameterValue (DCF), without one DefaultValue; null without both.
  const EdsText* value() const;
};

struct EdsFile {
  std::filesystem::path file;
  std::optional<std::uint8_t> node_number;  ///< of a DCF
  std::vector<EdsObject> objects;           ///< by index and sub-index; data types (below 1000h) are left out
  EdsKeys device_info;                      ///< of [DeviceInfo]

  /// Null where the file has no such entry.
  const EdsObject* find(std::uint16_t index, std::uint8_t sub) const;
  /// A number in the range of `type`, $NODEID being `node`. Fails with file, line and the range; `name` says of what.
  Result<std::int64_t> number(const EdsText& text, Type type, std::uint8_t node, std::string_view name) const;
  /// The values of a DCF (ParameterValue) for a node of this number, those that can be written and are no
  /// commands to a memory (1003h, 1010h, 1011h).
  Result<std::vector<ObjectValue>> values(std::uint8_t node) const;
  /// The objects with their defaults; a base where the file adds $NODEID.
  Result<std::vector<Object>> defaults() const;
};

/// Fails with file, line and what would be right.
Result<EdsFile> read_eds_file(const std::filesystem::path& file);
/// The same of a file's content.
Result<EdsFile> parse_eds(const std::string& content, const std::filesystem::path& file);

}  // namespace tribotwin::hil
