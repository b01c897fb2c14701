#include <algorithm>
#include <array>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/emcy.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::uint8_t history_size = 8;

}  // namespace

Emcy::Emcy(NodeContext& node)
    : node_(node),
      register_object_(node.dictionary.find(od::error_register, 0)),
      inhibit_(node.dictionary.find(od::inhibit_time_emcy, 0)) {}

void Emcy::raise(std::uint16_t code, std::uint8_t register_bits, std::span<const std::uint8_t> extra) {
  ++node_.counters.emergencies;
  register_ = static_cast<std::uint8_t>(register_ | register_bits | generic_error);
  register_object_->value = register_;
  remember(code);
  send(code, extra);
}

void Emcy::report(ErrorCode code, std::span<const std::uint8_t> extra, std::uint8_t register_bits) {
  const std::uint8_t before = register_;
  raise(static_cast<std::uint16_t>(code), register_bits, extra);
  register_ = before;
  register_object_->value = before;
  if (before == 0) send(0, {});
}

void Emcy::clear() {
  register_ = 0;
  register_object_->value = 0;
  send(0, {});
}

void Emcy::reset() {
  held_back_.clear();
  register_ = 0;
  register_object_->value = 0;
}

void Emcy::clear_history() {
  for (std::uint8_t i = 1; i <= history_size; ++i) node_.dictionary.set(od::predefined_error_field, i, 0);
}

void Emcy::remember(std::uint16_t code) {
  Dictionary& d = node_.dictionary;
  for (std::uint8_t i = history_size; i > 1; --i)
    d.set(od::predefined_error_field, i, d.get(od::predefined_error_field, static_cast<std::uint8_t>(i - 1)));
  d.set(od::predefined_error_field, 1, code);
  d.set(od::predefined_error_field, 0, std::min<std::int64_t>(history_size, d.get(od::predefined_error_field, 0) + 1));
}

void Emcy::send(std::uint16_t code, std::span<const std::uint8_t> extra) {
  Message message{static_cast<std::uint8_t>(code), static_cast<std::uint8_t>(code >> 8), register_};
  std::copy_n(extra.begin(), std::min<std::size_t>(extra.size(), 5), message.begin() + 3);
  node_.changed = true;
  if (node_.nmt == Nmt::stopped || node_.nmt == Nmt::initialising) return;
  if (held_back_.empty() && node_.now_ns - last_ns_ >= inhibit_ns()) return put(message, node_.now_ns);
  if (held_back_.size() == history_size) held_back_.pop_front();
  held_back_.push_back(message);
}

void Emcy::put(const Message& message, std::int64_t now_ns) {
  last_ns_ = now_ns;
  node_.send(cob::emcy + node_.id, message);
}

void Emcy::tick(std::int64_t now_ns) {
  if (node_.nmt == Nmt::stopped) held_back_.clear();
  while (!held_back_.empty() && now_ns - last_ns_ >= inhibit_ns()) {
    put(held_back_.front(), now_ns);
    held_back_.pop_front();
  }
}

std::int64_t Emcy::next_ns() const {
  return held_back_.empty() ? std::numeric_limits<std::int64_t>::max() : last_ns_ + inhibit_ns();
}

}  // namespace tribotwin::hil
