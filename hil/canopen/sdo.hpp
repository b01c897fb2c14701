#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include <tribotwin/hil/canopen/dictionary.hpp>

/// Service data objects (CiA 301, 7.2.4): access to the dictionary by index and sub-index. Frames of 8 bytes: a command
/// byte, then index (2, low first), sub-index (1) and up to 4 bytes of data (expedited), or 7 bytes of data (segments).
namespace tribotwin::hil {

/// The SDO server of a node: expedited and segmented transfers; every error is answered by an abort code.
class SdoServer {
 public:
  using Answer = std::array<std::uint8_t, 8>;

  explicit SdoServer(Dictionary& dictionary) : dictionary_(dictionary) {}
  /// The answer to a request of 8 bytes; none where CiA 301 requires none.
  std::optional<Answer> request(std::span<const std::uint8_t> bytes, std::int64_t now_ns);
  /// Aborts a segmented transfer that has been silent for a second.
  std::optional<Answer> tick(std::int64_t now_ns);
  void reset() { transfer_ = {}; }
  static bool is_abort(const Answer& answer) { return answer[0] == abort_command; }

 private:
  using Request = std::span<const std::uint8_t>;
  static constexpr std::uint8_t abort_command = 0x80;

  Answer initiate_download(Request bytes, std::int64_t now_ns);
  Answer expedited_download(Request bytes);
  Answer download_segment(Request bytes, std::int64_t now_ns);
  Answer initiate_upload(Request bytes, std::int64_t now_ns);
  Answer upload_segment(Request bytes, std::int64_t now_ns);
  Answer abort(Abort code);

  /// A segmented transfer under way.
  struct Transfer {
    enum class Way { none, upload, download } way = Way::none;
    std::uint16_t index = 0;
    std::uint8_t sub = 0;
    bool toggle = false;
    std::vector<std::uint8_t> bytes;
    std::size_t at = 0, announced = 0;
    std::int64_t last_ns = 0;
  };
  /// Whether the segment continues the transfer of this way; else why not.
  tl::expected<void, Abort> continues(Transfer::Way way, std::uint8_t command);

  Dictionary& dictionary_;
  Transfer transfer_;
  std::uint16_t index_ = 0;  // of the request under way, for aborts
  std::uint8_t sub_ = 0;
};

}  // namespace tribotwin::hil
