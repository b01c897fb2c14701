#pragma once

#include <cstdint>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/node_context.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>

namespace tribotwin::hil {

/// Takes the time from the bus (TIME, CiA 301, 7.2.6): frame 100h (1012h) with milliseconds after midnight (28 bits)
/// and days since 1984-01-01 (16). 2181h shows it, continued by the clock of the bus.
class TimeConsumer {
 public:
  explicit TimeConsumer(NodeContext& node) : node_(node), cob_(node.dictionary.find(od::cob_id_time, 0)) {}

  /// This drive sends no TIME; the identifier changes while none is taken.
  tl::expected<void, Abort> may_write(std::int64_t value) const {
    const auto id = static_cast<std::uint32_t>(value) & cob::id_29_bit, old = cob_value() & cob::id_29_bit;
    if (value & (cob::produces | cob::extended) || id > cob::id_11_bit) return tl::unexpected(Abort::out_of_range);
    if (value & cob::consumes && id != cob::time_stamp && cob::restricted(id))
      return tl::unexpected(Abort::out_of_range);
    if (cob_value() & cob::consumes && id != old) return tl::unexpected(Abort::not_now);
    return {};
  }
  /// Whether data frames with this identifier are TIME for it.
  bool takes(std::uint32_t id) const { return cob_value() & cob::consumes && id == (cob_value() & cob::id_11_bit); }
  /// A data frame.
  void hear(const Frame& frame, std::int64_t now_ns) {
    if (!takes(frame.id) || frame.size != 6) return;
    told_ms_ = decode(Type::u32, frame.bytes().first(4)) & 0xfffffff;
    told_days_ = decode(Type::u16, frame.bytes().subspan(4));
    told_ns_ = now_ns;
    show(now_ns);
  }
  /// Brings 2181h up to date.
  void show(std::int64_t now_ns) {
    if (told_ns_ < 0) return;
    constexpr std::int64_t day_ms = 24 * 3600 * 1000;
    const std::int64_t ms = told_ms_ + (now_ns - told_ns_) / ns_per_ms;
    node_.dictionary.set(od::time_of_day, 1, ms % day_ms);
    node_.dictionary.set(od::time_of_day, 2, told_days_ + ms / day_ms);
  }

 private:
  std::uint32_t cob_value() const { return static_cast<std::uint32_t>(cob_->value); }

  NodeContext& node_;
  const Object* cob_;
  std::int64_t told_ms_ = 0, told_days_ = 0, told_ns_ = -1;
};

}  // namespace tribotwin::hil
