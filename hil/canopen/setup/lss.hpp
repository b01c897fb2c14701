#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include <tribotwin/hil/canopen/node_context.hpp>

/// Layer setting services (CiA 305): a master gives drives their node numbers, found by their identity (1018h). Frames
/// of 8 bytes, 7E5h from the master and 7E4h from the drives: a command byte, then its data.
namespace tribotwin::hil {

inline constexpr std::uint8_t unconfigured_node = 0xFF;

constexpr bool is_node_number(std::uint8_t number) { return number >= 1 && number <= 127; }

class LssSlave {
 public:
  /// Keeps a node number (or FFh) for the next start; false: that failed. Empty: nothing can be kept.
  using Keep = std::function<bool(std::uint8_t)>;

  LssSlave(NodeContext& node, Keep keep) : node_(node), keep_(std::move(keep)), pending_(node.id) {}

  /// A frame with identifier cob::lss_to_slave. True: the node got its first number and has to boot.
  bool receive(const Frame& frame);
  /// The node number from the next reset of the communication on; FFh: none.
  std::uint8_t pending() const { return pending_; }
  /// As after power-up, with this number.
  void reset(std::uint8_t number) {
    pending_ = number;
    configuring_ = false;
    expected_ = fastscan_at_ = 0;
  }

 private:
  bool switch_global(std::uint8_t mode);
  void configure(const Frame& frame);
  void fastscan(const Frame& frame);
  /// Whether the value fits this drive, and the command follows the one before; true after the last of them.
  bool follows(std::uint8_t command, std::uint32_t value, std::uint8_t first, std::uint8_t last);
  std::uint32_t identity(int sub) const;
  bool unconfigured() const { return node_.id == unconfigured_node && pending_ == unconfigured_node; }
  void answer(std::uint8_t command, std::uint32_t value = 0);

  NodeContext& node_;
  Keep keep_;
  std::uint8_t pending_;
  bool configuring_ = false;      // else waiting
  std::uint8_t expected_ = 0;     // the next command of a sequence that selects or identifies
  std::uint8_t fastscan_at_ = 0;  // 0..3: vendor, product, revision, serial number
};

}  // namespace tribotwin::hil
