#pragma once

#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

/// Results of tasks as bytes that travel between the ranks of one job: numbers as they lie in memory, so that nothing
/// is rounded. Not for files: all ranks run the same build.
namespace tribotwin::twin {

template <class T>
concept PlainNumber = std::is_arithmetic_v<T> || std::is_enum_v<T>;

class BytesOut {
 public:
  template <PlainNumber T>
  BytesOut& put(T x) {
    bytes_.append(reinterpret_cast<const char*>(&x), sizeof x);
    return *this;
  }
  BytesOut& put(std::string_view text) {
    put<std::uint64_t>(text.size());
    bytes_.append(text);
    return *this;
  }
  template <PlainNumber T>
  BytesOut& put(std::span<const T> all) {
    put<std::uint64_t>(all.size());
    bytes_.append(reinterpret_cast<const char*>(all.data()), all.size_bytes());
    return *this;
  }
  std::string take() { return std::move(bytes_); }
  std::size_t size() const { return bytes_.size(); }

 private:
  std::string bytes_;
};

/// Reads what BytesOut has put, in the same order. Throws std::runtime_error where the bytes end too early.
class BytesIn {
 public:
  explicit BytesIn(std::string_view bytes) : left_(bytes) {}
  template <PlainNumber T>
  T get() {
    T x;
    std::memcpy(&x, cut(sizeof x).data(), sizeof x);
    return x;
  }
  std::string text() { return std::string(cut(get<std::uint64_t>())); }
  template <PlainNumber T>
  std::vector<T> numbers() {
    const auto count = get<std::uint64_t>();
    if (count > left_.size() / sizeof(T)) cut(left_.size() + 1);
    std::vector<T> all(count);
    if (count > 0) std::memcpy(all.data(), cut(count * sizeof(T)).data(), count * sizeof(T));
    return all;
  }
  bool empty() const { return left_.empty(); }

 private:
  std::string_view cut(std::size_t size) {
    if (size > left_.size()) throw std::runtime_error("a message between ranks is cut off");
    const std::string_view part = left_.substr(0, size);
    left_.remove_prefix(size);
    return part;
  }
  std::string_view left_;
};

}  // namespace tribotwin::twin
