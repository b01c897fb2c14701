#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// An electronic data sheet (CiA 306), or DCF, for comparison with a device.
namespace tribotwin::hil {

/// An object with its default as its value; without limits in the file it has those of its type.
struct SheetObject : Object {
  bool has_default = false;  ///< and is a number
};

struct Eds {
  std::vector<SheetObject> objects;  ///< by index and sub-index
  std::optional<std::int64_t> vendor, product;
};

/// `node` replaces $NODEID. Fails with FILE:LINE and what would be right.
Result<Eds> load_eds(const std::filesystem::path& file, std::uint8_t node);

}  // namespace tribotwin::hil
