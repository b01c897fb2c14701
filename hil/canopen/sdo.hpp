#pragma once

#include <optional>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/canopen/dictionary.hpp>

namespace tribotwin::hil {

/// The SDO server of a node: expedited and segmented transfers, every fault answered by the abort code of CiA 301.
class SdoServer {
 public:
  explicit SdoServer(Dictionary& dictionary) : dictionary_(dictionary) {}
  /// The 8 bytes of a request; the 8 bytes of the answer, none where CiA 301 wants silence.
  std::optional<std::array<std::uint8_t, 8>> request(std::span<const std::uint8_t> bytes, std::int64_t now_ns);
  /// Aborts a segmented transfer that has been silent for a second.
  std::optional<std::array<std::uint8_t, 8>> tick(std::int64_t now_ns);
  void reset() { transfer_ = {}; }

 private:
  using Answer = std::array<std::uint8_t, 8>;
  Answer abort(Abort code);
  struct Transfer {
    enum class Way { none, upload, download } way = Way::none;
    std::uint16_t index = 0;
    std::uint8_t sub = 0;
    bool toggle = false;
    std::vector<std::uint8_t> bytes;
    std::size_t at = 0, announced = 0;
    std::int64_t last_ns = 0;
  };
  Dictionary& dictionary_;
  Transfer transfer_;
  std::uint16_t index_ = 0;  // of the request under way, for aborts
  std::uint8_t sub_ = 0;
};

}  // namespace tribotwin::hil
