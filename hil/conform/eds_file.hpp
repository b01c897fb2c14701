#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

/// Reads an electronic data sheet (CiA 306) for comparison with a device.
namespace tribotwin::hil {

struct EdsObject {
  std::uint16_t index;
  std::uint8_t sub;
  std::string name;
  std::uint16_t data_type = 0;                         ///< number of the type (CiA 301, table 44)
  std::string access;                                  ///< lower case: ro, rw, wo, rwr, rww, const
  std::optional<std::int64_t> value{}, low{}, high{};  ///< default and limits, where they are numbers

  bool readable() const { return access != "wo"; }
  bool writable() const { return access != "ro" && access != "const"; }
  /// Bytes of the data type; 0: of any length, or a type that is no number.
  int size() const;
  bool is_signed() const;
};

struct Eds {
  std::vector<EdsObject> objects;  ///< that have a value, in the order of the file
  std::optional<std::int64_t> vendor, product;
};

/// `node` replaces $NODEID. Fails with FILE:LINE, or with what is missing.
Result<Eds> load_eds(const std::filesystem::path& file, std::uint8_t node);

}  // namespace tribotwin::hil
