#include <algorithm>
#include <new>

#include <fmt/format.h>
#include <lz4frame.h>
#include <zstd.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/mcap/compression.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::mcap {
namespace {

/// How many bytes were made of `bytes`; at most `size`.
Result<std::uint64_t> from_zstd(std::string_view bytes, char* to, std::uint64_t size) {
  const std::size_t made = ZSTD_decompress(to, size, bytes.data(), bytes.size());
  if (ZSTD_isError(made)) return tl::unexpected(fmt::format("zstd: {}", ZSTD_getErrorName(made)));
  return made;
}

Result<std::uint64_t> from_lz4(std::string_view bytes, char* to, std::uint64_t size) {
  LZ4F_dctx* made = nullptr;
  const auto created = LZ4F_createDecompressionContext(&made, LZ4F_VERSION);
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(made,
                                                                                     LZ4F_freeDecompressionContext);
  if (LZ4F_isError(created)) return tl::unexpected(fmt::format("lz4: {}", LZ4F_getErrorName(created)));
  std::uint64_t done = 0;
  while (!bytes.empty()) {
    std::size_t taken = bytes.size(), given = size - done;
    const auto wanted = LZ4F_decompress(context.get(), to + done, &given, bytes.data(), &taken, nullptr);
    if (LZ4F_isError(wanted)) return tl::unexpected(fmt::format("lz4: {}", LZ4F_getErrorName(wanted)));
    bytes.remove_prefix(taken), done += given;
    if (wanted == 0) break;
    if (taken == 0 && given == 0) return tl::unexpected(Error("lz4: holds more bytes than the chunk promises"));
  }
  return done;
}

struct Format {
  std::string_view name;
  std::uint64_t best_ratio;  ///< of any data, rounded up: zstd repeats 128 KiB in 4 bytes, lz4 255 in one
  Result<std::uint64_t> (*decompress)(std::string_view bytes, char* to, std::uint64_t size);
};
constexpr Format formats[] = {{"zstd", 43700, from_zstd}, {"lz4", 256, from_lz4}};

}  // namespace

Result<std::string_view> decompress(std::string_view format, std::string_view bytes, std::uint64_t size,
                                    Buffer& buffer) {
  const auto wrong_size = [&](std::uint64_t found) {
    return tl::unexpected(Error(fmt::format("{} bytes uncompressed, where the chunk promises {}", found, size)));
  };
  if (format.empty()) return bytes.size() == size ? Result<std::string_view>(bytes) : wrong_size(bytes.size());
  const auto* known = std::ranges::find(formats, format, &Format::name);
  if (known == std::end(formats))
    return tl::unexpected(
        fmt::format("compression '{}' is not known; accepted are zstd, lz4 and none", printable(format.substr(0, 40))));
  if (size > limits::mcap_chunk_bytes || size / known->best_ratio > bytes.size())
    return tl::unexpected(fmt::format("{} compressed bytes cannot be the {} that the chunk promises (at most {})",
                                      bytes.size(), size, limits::mcap_chunk_bytes));
  char* const to = buffer.at_least(size);
  const auto made = known->decompress(bytes, to, size);
  if (!made) return tl::unexpected(made.error());
  if (*made != size) return wrong_size(*made);
  return std::string_view(to, size);
}

std::string compressed(std::string_view bytes) {
  std::string out(ZSTD_compressBound(bytes.size()), '\0');
  const std::size_t size = ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), ZSTD_CLEVEL_DEFAULT);
  if (ZSTD_isError(size)) throw std::bad_alloc();  // with room for the worst case nothing else can fail
  out.resize(size);
  return out;
}

}  // namespace tribotwin::twin::mcap
