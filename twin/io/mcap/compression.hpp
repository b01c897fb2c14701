#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>

/// Private to this folder: the compressions of MCAP chunks.
namespace tribotwin::twin::mcap {

/// Memory that is used again and again; pages that were not written cost nothing.
class Buffer {
 public:
  char* at_least(std::size_t bytes) {
    if (bytes > capacity_) memory_ = std::make_unique_for_overwrite<char[]>(bytes), capacity_ = bytes;
    return memory_.get();
  }

 private:
  std::unique_ptr<char[]> memory_;
  std::size_t capacity_ = 0;
};

/// `bytes`, compressed as `format` ("", "lz4", "zstd") says, which are `size` bytes uncompressed: in `buffer`, or
/// themselves. A size that so few bytes cannot become takes no memory. Fails with what is wrong, without the file.
Result<std::string_view> decompress(std::string_view format, std::string_view bytes, std::uint64_t size,
                                    Buffer& buffer);

/// As zstd at its default level. Throws std::bad_alloc.
std::string compressed(std::string_view bytes);

}  // namespace tribotwin::twin::mcap
