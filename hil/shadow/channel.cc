#include <algorithm>
#include <cmath>
#include <utility>

#include <tribotwin/hil/shadow/channel.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::size_t most_samples = 20'000;  // while nobody forgets them: more than any window holds

}  // namespace

/// A frame that comes early makes up for one that seemed lost: it was late.
void Channel::count_lost(std::int64_t missing) { lost_ = std::max<std::int64_t>(0, lost_ + missing); }

void Channel::add(const Stamp& stamp, double value, Sending sending, int every, double span_s) {
  const std::int64_t before = std::exchange(cycle_, stamp.cycle);
  const double before_s = std::exchange(heard_s_, stamp.time_s);
  sending_ = sending;
  ++heard_;
  if (!samples_.empty() && stamp.cycle >= 0 && stamp.cycle == before) {
    // Two in one cycle: the first one was late, and belongs to the SYNC before if that had none.
    const bool late = samples_.size() < 2 || samples_[samples_.size() - 2].time_s < stamp.previous_s;
    if (late && stamp.previous_s < stamp.time_s)
      samples_.back().time_s = stamp.previous_s, count_lost(-1);
    else
      samples_.pop_back();
  } else if (!samples_.empty() && samples_.back().time_s >= stamp.time_s) {
    samples_.pop_back();
  }
  samples_.push_back({stamp.time_s, value, span_s});
  if (samples_.size() > most_samples) samples_.pop_front();
  if (heard_ < 2) {
    period_.add(stamp.time_s);
    return;
  }
  if (sending == Sending::with_sync && before >= 0 && stamp.cycle > before)
    count_lost((stamp.cycle - before) / every - 1);
  if (sending != Sending::periodic) return;
  period_.add(stamp.time_s);
  if (const auto period = period_.period_s(); period && period_.complete())
    count_lost(std::llround((stamp.time_s - before_s) / *period) - 1);
}

void Channel::hold(double time_s, double longest_s) {
  if (sending_ != Sending::on_change || samples_.empty()) return;
  if (time_s - heard_s_ <= longest_s && time_s > samples_.back().time_s)
    samples_.push_back({time_s, samples_.back().value});
}

}  // namespace tribotwin::hil
