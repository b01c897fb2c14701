#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

/// The object dictionary of a drive: one table, from which the SDO server, the PDO mapping, EDS and DBC files and the
/// documentation are made. Sources: CiA 301 (communication), CiA 402 (drive).
namespace tribotwin::hil {

enum class Type : std::uint8_t { u8, u16, u32, i8, i16, i32, text };
enum class Access : std::uint8_t { read_only, read_write, constant };

/// Bytes of a value; 0 for text.
int size_of(Type type);
bool is_signed(Type type);

/// SDO abort codes (CiA 301, 7.2.4.3.17).
enum class Abort : std::uint32_t {
  toggle = 0x05030000,
  timed_out = 0x05040000,
  unknown_command = 0x05040001,
  write_only = 0x06010001,
  read_only = 0x06010002,
  no_object = 0x06020000,
  not_mappable = 0x06040041,
  pdo_too_long = 0x06040042,
  wrong_length = 0x06070010,
  too_long = 0x06070012,
  too_short = 0x06070013,
  no_sub_index = 0x06090011,
  out_of_range = 0x06090030,
  too_high = 0x06090031,
  too_low = 0x06090032,
  not_now = 0x08000022,
};

struct Object {
  std::uint16_t index;
  std::uint8_t sub;
  std::string name;
  Type type;
  Access access;
  bool mappable = false;
  std::int64_t value = 0;          ///< now; the default in a fresh dictionary
  std::int64_t low = 0, high = 0;  ///< accepted; low == high: what the type holds
  std::string text{};              ///< of a text object
  double scale = 1;                ///< what one count is, in `unit`
  std::string unit{};              ///< "" for codes
  std::string meaning{};           ///< one line for the documentation
};

/// What makes one drive different from the next. Motor side.
struct DriveParameters {
  std::uint8_t node = 1;                               ///< 1..127
  std::string name;                                    ///< of the joint
  double gear_ratio = 1;                               ///< motor turns per joint turn
  double rated_torque_nm = 1;                          ///< 6076h, motor side; torque_max_nm / gear_ratio
  double speed_max_rad_s = 1000;                       ///< 6080h, motor side
  std::uint32_t cycle_us = 2000;                       ///< 1006h
  bool limited = false;                                ///< has position limits:
  double position_low_rad = 0, position_high_rad = 0;  ///< joint side
  double start_degC = 25;
};

inline constexpr int increments_per_turn = 65536;  ///< 608Fh, motor side
inline constexpr int pdo_count = 5;                ///< each way

class Dictionary {
 public:
  explicit Dictionary(const DriveParameters& parameters);

  std::span<const Object> objects() const { return objects_; }
  /// Null when there is none. Stays valid as long as the dictionary.
  Object* find(std::uint16_t index, std::uint8_t sub);
  bool has_index(std::uint16_t index) const;
  /// For objects that are known to exist.
  std::int64_t get(std::uint16_t index, std::uint8_t sub = 0) const;
  void set(std::uint16_t index, std::uint8_t sub, std::int64_t value);  ///< without a check, saturating to the type

  /// As an SDO client does, with every check.
  tl::expected<std::vector<std::uint8_t>, Abort> read(std::uint16_t index, std::uint8_t sub) const;
  tl::expected<void, Abort> write(std::uint16_t index, std::uint8_t sub, std::span<const std::uint8_t> bytes);

  /// Asked before a write takes effect, with the new value; an Abort refuses it. And told after.
  std::function<tl::expected<void, Abort>(const Object&, std::int64_t)> may_write;
  std::function<void(const Object&)> written;

 private:
  std::vector<Object> objects_;  // sorted by index and sub-index
};

std::int64_t decode(Type type, std::span<const std::uint8_t> bytes);
void encode(std::int64_t value, std::span<std::uint8_t> bytes);
/// The nearest value that the type holds.
std::int64_t saturated(Type type, std::int64_t value);

/// The table as Markdown: the reference part of hil/README.md.
std::string reference_markdown(const Dictionary& dictionary);

}  // namespace tribotwin::hil
