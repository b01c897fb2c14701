#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <lz4frame.h>
#include <zstd.h>

#include <tribotwin/twin/io/checksum.hpp>

/// MCAP files and ROS messages made byte by byte after the specifications, independently of the code under test.
namespace tribotwin::mcap_bytes {

template <class T>
std::string le(T value) {
  std::string out(sizeof value, '\0');
  std::memcpy(out.data(), &value, sizeof value);
  return out;
}
inline std::string text(const std::string& s) { return le(static_cast<std::uint32_t>(s.size())) + s; }
inline std::string record(int op, const std::string& content) {
  return static_cast<char>(op) + le(std::uint64_t{content.size()}) + content;
}
inline const std::string magic("\x89MCAP0\r\n", 8);
inline const std::string header = record(1, text("ros2") + text("a test"));

inline std::string schema(std::uint16_t id, const std::string& name) {
  return record(3, le(id) + text(name) + text("ros2msg") + text("float64 x"));
}
inline std::string channel(std::uint16_t id, std::uint16_t schema_id, const std::string& topic,
                           const std::string& encoding = "cdr") {
  return record(4, le(id) + le(schema_id) + text(topic) + text(encoding) + text(text("key") + text("value")));
}
inline std::string message(std::uint16_t channel_id, std::uint64_t time_ns, const std::string& data) {
  return record(5, le(channel_id) + le(std::uint32_t{0}) + le(time_ns) + le(time_ns) + data);
}

inline std::string packed(const std::string& format, const std::string& bytes) {
  std::string out;
  if (format == "zstd") {
    out.resize(ZSTD_compressBound(bytes.size()));
    out.resize(ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), 1));
  } else if (format == "lz4") {
    out.resize(LZ4F_compressFrameBound(bytes.size(), nullptr));
    out.resize(LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), nullptr));
  } else {
    out = bytes;
  }
  return out;
}
/// `size` and `crc`: what the chunk claims, instead of what is right.
inline std::string chunk(const std::string& format, const std::string& records, std::int64_t size = -1,
                         std::int64_t crc = -1) {
  const std::string bytes = packed(format, records);
  return record(6, le(std::uint64_t{0}) + le(std::uint64_t{9}) +
                       le(size < 0 ? std::uint64_t{records.size()} : static_cast<std::uint64_t>(size)) +
                       le(crc < 0 ? twin::crc32(records) : static_cast<std::uint32_t>(crc)) + text(format) +
                       le(std::uint64_t{bytes.size()}) + bytes);
}
/// A whole file without summary; with the checksum of the data.
inline std::string file(const std::string& data) {
  const std::string begin = magic + header + data;
  return begin + record(15, le(twin::crc32(begin))) + record(2, std::string(20, '\0')) + magic;
}

/// Numbers at multiples of their size behind the encapsulation header; `big`: big-endian, as old DDS on PowerPC.
class Cdr {
 public:
  explicit Cdr(bool big = false) : big_(big), bytes_(big ? std::string(4, '\0') : std::string("\0\1\0\0", 4)) {}
  template <class T>
  Cdr& add(T value) {
    while ((bytes_.size() - 4) % sizeof value) bytes_ += '\0';
    std::string raw = le(value);
    if (big_) std::reverse(raw.begin(), raw.end());
    bytes_ += raw;
    return *this;
  }
  Cdr& add(const std::string& s) {
    add(static_cast<std::uint32_t>(s.size() + 1));
    bytes_ += s + '\0';
    return *this;
  }
  template <class T>
  Cdr& add(const std::vector<T>& all) {
    add(static_cast<std::uint32_t>(all.size()));
    for (const T& one : all) add(one);
    return *this;
  }
  operator std::string() const { return bytes_; }

 private:
  bool big_;
  std::string bytes_;
};

using Texts = std::vector<std::string>;
using Doubles = std::vector<double>;

inline std::string joint_state(double time_s, const Texts& names, const Doubles& position, const Doubles& velocity = {},
                               const Doubles& effort = {}, bool big = false) {
  const auto ns = static_cast<std::int64_t>(time_s * 1e9 + 0.5);
  return Cdr(big)
      .add(static_cast<std::int32_t>(ns / 1000000000))
      .add(static_cast<std::uint32_t>(ns % 1000000000))
      .add(std::string("base"))
      .add(names)
      .add(position)
      .add(velocity)
      .add(effort);
}

}  // namespace tribotwin::mcap_bytes
