#include <algorithm>
#include <limits>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/heartbeat.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::int64_t never = std::numeric_limits<std::int64_t>::max();

}  // namespace

HeartbeatProducer::HeartbeatProducer(NodeContext& node)
    : node_(node), period_(node.dictionary.find(od::producer_heartbeat_time, 0)) {}

void HeartbeatProducer::boot_up(std::int64_t now_ns) {
  constexpr std::uint8_t boot[] = {0};
  node_.send(cob::heartbeat + node_.id, boot);
  last_ns_ = now_ns;
}

void HeartbeatProducer::tick(std::int64_t now_ns) {
  const std::int64_t period = period_ns();
  if (period <= 0 || now_ns - last_ns_ < period) return;
  last_ns_ = now_ns - last_ns_ > 2 * period ? now_ns : last_ns_ + period;
  const std::uint8_t state[] = {static_cast<std::uint8_t>(node_.nmt)};
  node_.send(cob::heartbeat + node_.id, state);
}

std::int64_t HeartbeatProducer::next_ns() const {
  const std::int64_t period = period_ns();
  return period > 0 ? last_ns_ + period : never;
}

tl::expected<void, Abort> HeartbeatConsumer::may_configure(const Object& entry, std::int64_t value) const {
  const Watched wanted = Watched::of(value);
  for (std::size_t i = 0; i < watched_.size(); ++i)
    if (i + 1 != entry.sub && wanted.period_ns && watched_[i].period_ns && watched_[i].node == wanted.node)
      return tl::unexpected(Abort::incompatible);
  return {};
}

void HeartbeatConsumer::configure(const Object& entry) {
  watched_[static_cast<std::size_t>(entry.sub - 1)] = Watched::of(entry.value);
}

bool HeartbeatConsumer::watches(std::uint32_t cob_id) const {
  return std::ranges::any_of(watched_,
                             [&](const Watched& w) { return w.period_ns > 0 && cob_id == cob::heartbeat + w.node; });
}

void HeartbeatConsumer::hear(std::uint32_t cob_id, std::int64_t now_ns) {
  for (Watched& w : watched_)
    if (w.period_ns && cob_id == cob::heartbeat + w.node) w.last_ns = now_ns;
}

int HeartbeatConsumer::lost(std::int64_t now_ns) {
  int count = 0;
  for (Watched& w : watched_)
    if (w.period_ns && w.last_ns >= 0 && now_ns - w.last_ns > w.period_ns) {
      w.last_ns = -1;
      ++count;
    }
  return count;
}

std::int64_t HeartbeatConsumer::next_ns() const {
  std::int64_t next = never;
  for (const Watched& w : watched_)
    if (w.period_ns && w.last_ns >= 0) next = std::min(next, w.last_ns + w.period_ns + 1);
  return next;
}

NodeGuard::NodeGuard(NodeContext& node)
    : node_(node),
      guard_time_(node.dictionary.find(od::guard_time, 0)),
      life_factor_(node.dictionary.find(od::life_time_factor, 0)),
      heartbeat_(node.dictionary.find(od::producer_heartbeat_time, 0)) {}

void NodeGuard::asked(std::int64_t now_ns) {
  if (heartbeat_->value) return reset();
  const std::uint8_t answer[] = {static_cast<std::uint8_t>(static_cast<int>(node_.nmt) | (toggle_ ? 0x80 : 0))};
  node_.send(cob::heartbeat + node_.id, answer);
  toggle_ = !toggle_;
  last_ns_ = now_ns;
}

bool NodeGuard::lost(std::int64_t now_ns) {
  if (last_ns_ < 0 || life_ns() == 0 || now_ns - last_ns_ <= life_ns()) return false;
  last_ns_ = -1;
  return true;
}

std::int64_t NodeGuard::next_ns() const { return last_ns_ < 0 || life_ns() == 0 ? never : last_ns_ + life_ns() + 1; }

}  // namespace tribotwin::hil
