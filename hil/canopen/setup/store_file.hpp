#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string_view>

#include <tribotwin/hil/canopen/setup/object_values.hpp>
#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::hil {

/// What the drives of a bus keep, in one text file:
///
///     tribotwin-hil store 1
///     [drive 3]
///     number = 34
///     1017h:00 = 64 00
///     checksum = 0A1B2C3D
///
/// Drives by their serial numbers; values in hexadecimal bytes as on the bus; the checksum (CRC-32) is that of all
/// lines before it.
class StoreFile {
 public:
  /// A file that does not exist keeps nothing yet. Fails with file, line and what would be right where it is damaged.
  static Result<StoreFile> read(const std::filesystem::path& file);
  /// The same of a file's content; without one it keeps nothing yet.
  static Result<StoreFile> parse(std::optional<std::string_view> content, const std::filesystem::path& file);

  const std::filesystem::path& file() const { return file_; }
  /// Of the drive with this serial number.
  KeptParameters of(std::uint32_t serial_number) const;
  /// Changes what that drive keeps, on the disk and here: both, or neither when it fails.
  Result<void> keep(std::uint32_t serial_number, const KeptParameters& parameters);

 private:
  std::filesystem::path file_;
  std::map<std::uint32_t, KeptParameters> drives_;
};

}  // namespace tribotwin::hil
