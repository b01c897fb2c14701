#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <tribotwin/hil/canopen/dictionary.hpp>

/// Service data objects (CiA 301, 7.2.4): access to the dictionary by index and sub-index. Frames of 8 bytes: a command
/// byte, then index (2, low first), sub-index (1) and up to 4 bytes of data (expedited), or 7 bytes of data (segments;
/// in a block up to 127 of them, numbered, with one answer).
namespace tribotwin::hil {

/// CRC-16/XMODEM, of block transfers: polynomial 1021h, initially 0.
std::uint16_t sdo_crc(std::span<const std::uint8_t> bytes);

/// The SDO server of a node: expedited, segmented and block transfers; every error is answered by an abort code.
class SdoServer {
 public:
  using Answer = std::array<std::uint8_t, 8>;
  /// Sends a frame to the client; false: the bus did not take it.
  using SendAnswer = std::function<bool(const Answer&)>;

  SdoServer(Dictionary& dictionary, SendAnswer send) : dictionary_(dictionary), send_(std::move(send)) {}
  /// Answers a request of 8 bytes; other lengths are no requests.
  void request(std::span<const std::uint8_t> bytes, std::int64_t now_ns);
  /// Aborts a transfer that has been silent for a second. Asks for segments of a block that are missing for half of
  /// that, and continues a block that the bus did not take.
  void tick(std::int64_t now_ns);
  /// Next time at which `tick` has something to do.
  std::int64_t next_ns() const;
  void reset() { transfer_ = {}; }
  static bool is_abort(const Answer& answer) { return answer[0] == abort_command; }

 private:
  using Request = std::span<const std::uint8_t>;
  static constexpr std::uint8_t abort_command = 0x80;

  void initiate_download(Request bytes, std::int64_t now_ns);
  void expedited_download(Request bytes);
  void download_segment(Request bytes, std::int64_t now_ns);
  void initiate_upload(std::int64_t now_ns);
  void upload(std::vector<std::uint8_t> value, std::int64_t now_ns);
  void upload_segment(Request bytes, std::int64_t now_ns);
  void abort(Abort code);

  void block_download(Request bytes, std::int64_t now_ns);
  void initiate_block_download(Request bytes, std::int64_t now_ns);
  void block_segment(Request bytes, std::int64_t now_ns);
  void acknowledge_block();
  void end_block_download(Request bytes);
  void block_upload(Request bytes, std::int64_t now_ns);
  void initiate_block_upload(Request bytes, std::int64_t now_ns);
  void block_acknowledged(Request bytes);
  void send_block();
  void end_block_upload();

  enum class Way : std::uint8_t {
    none,
    upload,
    download,
    block_download,
    block_download_end,  ///< all segments came
    block_upload_start,  ///< the client has not said start yet
    block_upload,        ///< a block was sent
    block_upload_end,    ///< the client has to confirm the end
  };
  /// A transfer of more than one request.
  struct Transfer {
    Way way = Way::none;
    std::uint16_t index = 0;
    std::uint8_t sub = 0;
    bool toggle = false;
    std::vector<std::uint8_t> bytes;
    std::size_t at = 0;                         ///< upload: bytes that the client has
    std::size_t longest = 0;                    ///< download: bytes announced, or those of the object
    bool announced = false;                     ///< download: `longest` is the length
    bool crc = false;                           ///< of a block transfer
    std::uint8_t block_size = 0, sequence = 0;  ///< segments in this block: at most, and so far
    bool last = false;                          ///< this block has the last segment
    bool incomplete = false;                    ///< download: segments of this block came, not all
    std::int64_t last_ns = 0;                   ///< of the last request
  };
  /// Whether the segment continues the transfer of this way; else why not.
  tl::expected<void, Abort> continues(Way way, std::uint8_t command);
  /// The transfer of a download to the object of the request, or why there is none.
  tl::expected<Transfer, Abort> begin_download(Way way, bool announced, Request bytes, std::int64_t now_ns);
  /// Writes what was downloaded; fails after an abort.
  bool finish_download();
  Answer answer(std::uint8_t command) const;

  Dictionary& dictionary_;
  SendAnswer send_;
  Transfer transfer_;
  std::uint16_t index_ = 0;  // of the request under way, for aborts
  std::uint8_t sub_ = 0;
};

}  // namespace tribotwin::hil
