#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

/// The object dictionary of a node (CiA 301, 7.4): one table, from which the SDO server, the PDO mapping, the EDS and
/// DBC files and the reference in hil/README.md are made.
namespace tribotwin::hil {

enum class Type : std::uint8_t {
  u8,
  u16,
  u32,
  i8,
  i16,
  i32,
  text,
  domain,
  // Of drives of other makers:
  boolean,
  u24,
  u40,
  u48,
  u56,
  u64,
  i24,
  i40,
  i48,
  i56,
  i64,
  real32,
  real64,
  octets,
  unicode,
  time_of_day,
  time_difference
};
enum class Access : std::uint8_t { read_only, read_write, write_only, constant };

/// A data type as others call it.
struct TypeFacts {
  std::string_view name;
  int code;   ///< CiA 301, 7.4.7: index of the data type
  int bytes;  ///< of a value; 0: of any length
  bool is_signed;
};
const TypeFacts& facts_of(Type type);
/// The type with this code, if there is one.
std::optional<Type> type_of(int code);

/// Bytes of a value; 0 for text, octets and domains.
int size_of(Type type);
bool is_signed(Type type);
inline bool is_number(Type type) { return size_of(type) != 0; }

/// SDO abort codes (CiA 301, 7.2.4.3.17, table 22).
enum class Abort : std::uint32_t {
  toggle = 0x05030000,
  timed_out = 0x05040000,
  unknown_command = 0x05040001,
  block_size = 0x05040002,  ///< of a block transfer
  sequence_number = 0x05040003,
  crc = 0x05040004,
  write_only = 0x06010001,
  read_only = 0x06010002,
  no_object = 0x06020000,
  not_mappable = 0x06040041,
  pdo_too_long = 0x06040042,
  incompatible = 0x06040043,  ///< with another parameter
  hardware = 0x06060000,
  wrong_length = 0x06070010,
  too_long = 0x06070012,
  too_short = 0x06070013,
  no_sub_index = 0x06090011,
  out_of_range = 0x06090030,
  too_high = 0x06090031,
  too_low = 0x06090032,
  not_stored = 0x08000020,
  not_now = 0x08000022,
  no_data = 0x08000024,
};
/// "does not exist": completes "1017h:00: ...".
std::string_view reason(Abort abort);

/// "1018h:04"
std::string object_name(std::uint16_t index, std::uint8_t sub);

struct Object {
  std::uint16_t index;
  std::uint8_t sub;
  std::string name;
  Type type;
  Access access;
  bool mappable = false;
  std::int64_t value = 0;          ///< now; the default in a fresh dictionary
  std::int64_t low = 0, high = 0;  ///< accepted range, of text its length; both 0: the range of the type
  std::string text{};              ///< value of what is no number
  double scale = 1;                ///< size of one count in `unit`
  std::string unit{};              ///< "" for codes
  std::string meaning{};           ///< one line for the reference
  bool plus_node = false;          ///< the value is a base and the node number ($NODEID in an EDS)
};

/// Of an object: the largest number of bytes that a value has.
std::size_t longest(const Object& object);
/// Whether a value of so many bytes is one of the object.
tl::expected<void, Abort> fits(const Object& object, std::size_t bytes);

/// Members that most objects leave at their defaults.
struct Extra {
  std::string text{};
  double scale = 1;
  std::string unit{}, meaning{};
  bool plus_node = false;
};
void add(std::vector<Object>& objects, Object object, Extra extra = {});

class Dictionary {
 public:
  /// Sorts `objects`; an object without a range gets that of its type.
  explicit Dictionary(std::vector<Object> objects);

  std::span<const Object> objects() const { return objects_; }
  /// Null when there is none. The pointer is valid as long as the dictionary.
  Object* find(std::uint16_t index, std::uint8_t sub);
  const Object* find(std::uint16_t index, std::uint8_t sub) const;
  bool has_index(std::uint16_t index) const;
  /// Value of an object that must exist.
  std::int64_t get(std::uint16_t index, std::uint8_t sub = 0) const;
  /// Sets an object that must exist, without a check; the value saturates to the range of the type.
  void set(std::uint16_t index, std::uint8_t sub, std::int64_t value);

  /// Access by the bus (SDO, RPDO), with every check of CiA 301: little-endian bytes.
  tl::expected<std::vector<std::uint8_t>, Abort> read(std::uint16_t index, std::uint8_t sub) const;
  tl::expected<void, Abort> write(std::uint16_t index, std::uint8_t sub, std::span<const std::uint8_t> bytes);
  /// The object, if the bus may write it at all.
  tl::expected<const Object*, Abort> writable(std::uint16_t index, std::uint8_t sub) const;

  /// Called by `read`: an Abort refuses it.
  std::function<tl::expected<void, Abort>(const Object&)> may_read;
  /// Called by `write` before the new value (of text: its length) takes effect: an Abort refuses it.
  std::function<tl::expected<void, Abort>(const Object&, std::int64_t)> may_write;
  /// Called by `write` after the new value took effect.
  std::function<void(const Object&)> written;

 private:
  std::vector<Object> objects_;  // sorted by index and sub-index
};

/// Little-endian bytes and back.
std::int64_t decode(Type type, std::span<const std::uint8_t> bytes);
void encode(std::int64_t value, std::span<std::uint8_t> bytes);
/// The nearest value in the range of the type.
std::int64_t saturated(Type type, std::int64_t value);
/// Lowest and highest value of a number type; of 8 bytes and of reals: of the bytes, as a signed number.
struct Limits {
  std::int64_t low, high;
};
Limits limits_of(Type type);

/// An object as a PDO mapping parameter names it (CiA 301, 7.5.2.36): index, sub-index and length in bits.
struct MappingEntry {
  std::uint16_t index;
  std::uint8_t sub;
  int bits;

  static constexpr MappingEntry of(std::int64_t value) {
    return {static_cast<std::uint16_t>(value >> 16), static_cast<std::uint8_t>(value >> 8),
            static_cast<int>(value & 0xff)};
  }
  constexpr std::uint32_t value() const {
    return static_cast<std::uint32_t>(index) << 16 | static_cast<std::uint32_t>(sub) << 8 |
           static_cast<std::uint32_t>(bits);
  }
};

/// The table as Markdown: the reference part of hil/README.md.
std::string reference_markdown(const Dictionary& dictionary);

}  // namespace tribotwin::hil
