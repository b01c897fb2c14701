#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin::mcap {

using Texts = std::vector<std::pair<std::string, std::string>>;

/// Writes MCAP 1.0: messages in chunks of zstd with their index, a summary, and a checksum of everything. Schemas and
/// channels are numbered from 1.
class Writer {
 public:
  /// Takes the bytes of the file in their order.
  using Sink = std::function<Result<void>(std::string_view)>;

  Writer(Sink sink, std::string_view profile, std::string_view library);
  Writer(Writer&&) noexcept;
  ~Writer();

  /// The number of the schema; the same one again where it is known.
  std::uint16_t add_schema(std::string_view name, std::string_view encoding, std::string_view data);
  std::uint16_t add_channel(std::string_view topic, std::string_view encoding, std::uint16_t schema,
                            const Texts& metadata = {});
  void add_metadata(std::string_view name, const Texts& metadata);
  /// Fails where the sink does.
  Result<void> add_message(std::uint16_t channel, std::uint64_t time_ns, std::string_view data);
  /// The rest of the file; nothing may follow. Fails where the sink did at any time.
  Result<void> finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tribotwin::twin::mcap
