#pragma once

#include <cstdint>
#include <span>

#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/canopen/nmt.hpp>
#include <tribotwin/hil/drives/bus_drive.hpp>

namespace tribotwin::hil {

struct NodeCounters {
  std::uint64_t pdo_received = 0, pdo_sent = 0, pdo_short = 0, pdo_late = 0, sdo_requests = 0, sdo_aborts = 0,
                emergencies = 0, heartbeats_lost = 0, syncs_lost = 0,
                foreign = 0;  ///< frames with an identifier that only this node may send: another node has its number
};

/// What the services of one node share. Times [ns] are of the caller's clock.
struct NodeContext {
  std::uint8_t id;
  Send send_frame;
  Dictionary dictionary;
  Nmt nmt = Nmt::pre_operational;
  bool changed = true;  ///< a mapped object may have changed since the event PDOs were last looked at
  NodeCounters counters{};
  std::int64_t now_ns = 0;  ///< when the node was last called

  bool operational() const { return nmt == Nmt::operational; }
  /// Whether the bus took the frame.
  bool send(std::uint32_t cob_id, std::span<const std::uint8_t> bytes) {
    return send_frame(classic(cob_id, bytes)) == Sent::done;
  }
};

constexpr std::int64_t ns_per_ms = 1'000'000;

}  // namespace tribotwin::hil
