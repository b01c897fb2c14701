#include <algorithm>
#include <limits>
#include <utility>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/pdo.hpp>

namespace tribotwin::hil {
namespace {

bool in(od::Index index, od::Index first) { return index >= first && index < first + pdo_count; }
bool is_mapping(od::Index index) { return in(index, od::rpdo_mapping) || in(index, od::tpdo_mapping); }
bool is_communication(od::Index index) {
  return in(index, od::rpdo_communication) || in(index, od::tpdo_communication);
}

tl::unexpected<Abort> refuse(Abort why) { return tl::unexpected(why); }

}  // namespace

PdoService::PdoService(NodeContext& node, Emcy& emcy) : node_(node), emcy_(emcy) { reload(); }

// ---- Parameters.

bool PdoService::owns(std::uint16_t index) { return is_mapping(index) || is_communication(index); }

tl::expected<int, Abort> PdoService::mapped_bytes(MappingEntry entry, bool receive) const {
  constexpr int gap_bits[] = {8, 16, 32, 8, 16, 32};
  if (receive && entry.sub == 0 && entry.index >= 2 && entry.index <= 7) {  // CiA 301: a gap of that data type
    if (entry.bits == gap_bits[entry.index - 2]) return entry.bits / 8;
    return refuse(Abort::not_mappable);
  }
  const Object* o = node_.dictionary.find(entry.index, entry.sub);
  if (!o) return refuse(node_.dictionary.has_index(entry.index) ? Abort::no_sub_index : Abort::no_object);
  if (!o->mappable || (receive && o->access != Access::read_write) || entry.bits != 8 * size_of(o->type))
    return refuse(Abort::not_mappable);
  return entry.bits / 8;
}

tl::expected<void, Abort> PdoService::may_write(const Object& o, std::int64_t value) const {
  if (is_mapping(o.index)) return may_map(o, value);
  if (o.sub == 1) return may_set_cob(o, value);
  const bool inhibit_time = o.index >= od::tpdo_communication && o.sub == 3;
  const bool start_value = o.index >= od::tpdo_communication && o.sub == 6;
  if ((inhibit_time || start_value) && value != o.value && !(node_.dictionary.get(o.index, 1) & cob::off))
    return refuse(Abort::not_now);
  if (o.sub == 2 && value > last_synchronous && value < first_event) return refuse(Abort::out_of_range);
  return {};
}

tl::expected<void, Abort> PdoService::may_map(const Object& o, std::int64_t value) const {
  const od::Index owner = od::communication_of(o.index);
  const bool receive = o.index < od::tpdo_mapping;
  if (value != o.value && !(node_.dictionary.get(owner, 1) & cob::off)) return refuse(Abort::not_now);
  if (o.sub > 0) {
    if (node_.dictionary.get(o.index, 0) != 0) return refuse(Abort::not_now);
    if (auto size = mapped_bytes(MappingEntry::of(value), receive); value != 0 && !size) return refuse(size.error());
    return {};
  }
  int total = 0;
  for (std::uint8_t k = 1; k <= value; ++k) {
    auto size = mapped_bytes(MappingEntry::of(node_.dictionary.get(o.index, k)), receive);
    if (!size) return refuse(size.error());
    total += *size;
  }
  if (total > static_cast<int>(pdo_bytes)) return refuse(Abort::pdo_too_long);
  return {};
}

tl::expected<void, Abort> PdoService::may_set_cob(const Object& o, std::int64_t value) const {
  const auto id = static_cast<std::uint32_t>(value) & cob::id_29_bit;
  const bool exists = !(value & cob::off);
  if (value & cob::extended) return refuse(Abort::out_of_range);  // 11-bit identifiers only
  if (exists && cob::restricted(id)) return refuse(Abort::out_of_range);
  // Allowed by CiA 301, but these two are this node's own.
  if (exists && (id == cob::sync || id == cob::emcy + node_.id)) return refuse(Abort::incompatible);
  // An existing PDO changes its identifier by way of bit 31.
  if (!(o.value & cob::off) && exists && o.value != value) return refuse(Abort::not_now);
  return {};
}

void PdoService::load(Pdo& pdo, bool transmit, int number) {
  const Dictionary& d = node_.dictionary;
  const bool existed = pdo.exists;
  const PdoParameters now = pdo_parameters(d, transmit, number);
  const od::Index index = pdo_index(transmit, number);
  pdo.cob = now.cob;
  pdo.exists = now.exists;
  pdo.type = now.type;
  pdo.inhibit_ns = transmit ? d.get(index, 3) * 100'000 : 0;  // counts of 100 us
  pdo.timer_ns = d.get(index, 5) * ns_per_ms;
  pdo.start = transmit ? static_cast<std::uint8_t>(d.get(index, 6)) : std::uint8_t{0};
  pdo.map.clear();
  pdo.sizes.clear();
  pdo.refused.assign(now.map.size(), std::nullopt);
  pdo.size = 0;
  for (const MappingEntry& entry : now.map) {
    pdo.map.push_back(node_.dictionary.find(entry.index, entry.sub));
    pdo.sizes.push_back(entry.bits / 8);
    pdo.size += pdo.sizes.back();
  }
  if (!existed || !pdo.exists) pdo.pending = pdo.sent_once = pdo.started = false, pdo.syncs = 0;
  if (!existed) pdo.last_ns = -1;
}

void PdoService::reload() {
  for (int i = 0; i < pdo_count; ++i) {
    load(receive_[static_cast<std::size_t>(i)], false, i);
    load(transmit_[static_cast<std::size_t>(i)], true, i);
  }
}

void PdoService::reset() {
  receive_ = {};
  transmit_ = {};
  reload();
}

void PdoService::start() {
  for (Pdo& pdo : receive_) pdo.last_ns = -1, pdo.pending = false;
  for (Pdo& pdo : transmit_) pdo.sent_once = pdo.started = false, pdo.syncs = 0, pdo.last_ns = -1;
}

// ---- Frames.

bool PdoService::sends(std::uint32_t cob_id) const {
  return std::ranges::any_of(transmit_, [&](const Pdo& p) { return p.exists && p.cob == cob_id; });
}

bool PdoService::takes(std::uint32_t cob_id) const {
  return std::ranges::any_of(receive_, [&](const Pdo& p) { return p.exists && p.cob == cob_id; });
}

void PdoService::receive(const Frame& frame, std::int64_t now_ns) {
  const auto bytes = frame.bytes();
  for (Pdo& pdo : receive_) {
    if (!pdo.exists || pdo.cob != frame.id) continue;
    if (static_cast<int>(bytes.size()) < pdo.size) {
      ++node_.counters.pdo_short;
      const std::uint8_t sizes[] = {static_cast<std::uint8_t>(bytes.size()), static_cast<std::uint8_t>(pdo.size)};
      emcy_.report(ErrorCode::pdo_too_short, sizes);
      continue;
    }
    ++node_.counters.pdo_received;
    std::ranges::copy(bytes, pdo.data.begin());
    pdo.last_ns = now_ns;
    if (pdo.synchronous())
      pdo.pending = true;
    else
      accept(pdo);
  }
}

void PdoService::accept(Pdo& pdo) {
  pdo.pending = false;
  pdo.delivered = true;
  std::size_t at = 0;
  for (std::size_t k = 0; k < pdo.map.size(); ++k) {
    const auto size = static_cast<std::size_t>(pdo.sizes[k]);
    if (Object* o = pdo.map[k]) {
      // A value that the object does not accept stays unwritten, as it would by SDO; said once until it changes.
      const auto bytes = std::span(pdo.data).subspan(at, size);
      const bool taken = node_.dictionary.write(o->index, o->sub, bytes).has_value();
      const std::optional<std::int64_t> refused = taken ? std::nullopt : std::optional(decode(o->type, bytes));
      if (std::exchange(pdo.refused[k], refused) != refused && refused) report_refused(*o, *refused);
    }
    at += size;
  }
}

void PdoService::report_refused(const Object& o, std::int64_t value) {
  std::array<std::uint8_t, 5> where{static_cast<std::uint8_t>(o.index), static_cast<std::uint8_t>(o.index >> 8), o.sub};
  encode(value, std::span(where).subspan(3));
  emcy_.report(ErrorCode::parameter_error, where, profile_error);
}

std::array<std::uint8_t, pdo_bytes> PdoService::gather(const Pdo& pdo) const {
  std::array<std::uint8_t, pdo_bytes> data{};
  std::size_t at = 0;
  for (std::size_t k = 0; k < pdo.map.size(); ++k) {
    encode(pdo.map[k]->value, std::span(data).subspan(at, static_cast<std::size_t>(pdo.sizes[k])));
    at += static_cast<std::size_t>(pdo.sizes[k]);
  }
  return data;
}

void PdoService::send(Pdo& pdo, std::int64_t now_ns) {
  pdo.data = gather(pdo);
  pdo.pending = false;
  pdo.sent_once = true;
  pdo.last_ns = now_ns;
  if (node_.send(pdo.cob, std::span(pdo.data).first(static_cast<std::size_t>(pdo.size)))) ++node_.counters.pdo_sent;
}

bool PdoService::waits(Pdo& pdo, std::optional<std::uint8_t> counter) const {
  if (pdo.start == 0 || pdo.started || node_.dictionary.get(od::synchronous_counter_overflow) == 0) return false;
  if (counter != pdo.start) return true;
  pdo.started = true;
  pdo.syncs = static_cast<std::uint8_t>(pdo.type - 1);  // due with this one
  return false;
}

void PdoService::sync(std::int64_t now_ns, std::optional<std::uint8_t> counter) {
  for (Pdo& pdo : transmit_) {
    if (!pdo.exists || !pdo.synchronous() || waits(pdo, counter)) continue;
    if (pdo.type == 0) {
      if (!pdo.sent_once || gather(pdo) != pdo.data) send(pdo, now_ns);
    } else if (++pdo.syncs >= pdo.type) {
      pdo.syncs = 0;
      send(pdo, now_ns);
    }
  }
  for (Pdo& pdo : receive_)
    if (pdo.pending) accept(pdo);
}

// ---- Timers.

int PdoService::late(std::int64_t now_ns) {
  int count = 0;
  for (Pdo& pdo : receive_)
    if (pdo.exists && pdo.timer_ns && pdo.last_ns >= 0 && now_ns - pdo.last_ns > pdo.timer_ns) {
      pdo.last_ns = -1;
      ++count;
    }
  return count;
}

void PdoService::tick(std::int64_t now_ns) {
  for (Pdo& pdo : transmit_) {
    if (!pdo.exists || !pdo.event_driven()) continue;
    const bool due = pdo.timer_ns && pdo.sent_once && now_ns - pdo.last_ns >= pdo.timer_ns;
    if (!pdo.inhibited(now_ns) && (due || !pdo.sent_once || ((node_.changed || held_back_) && gather(pdo) != pdo.data)))
      send(pdo, now_ns);
  }
  node_.changed = false;
  held_back_ = std::ranges::any_of(transmit_, [&](const Pdo& p) { return p.inhibited(now_ns); });
}

std::int64_t PdoService::next_ns() const {
  std::int64_t next = std::numeric_limits<std::int64_t>::max();
  const auto at = [&](std::int64_t t) { next = std::min(next, t); };
  for (const Pdo& pdo : receive_)
    if (pdo.exists && pdo.timer_ns && pdo.last_ns >= 0) at(pdo.last_ns + pdo.timer_ns + 1);
  for (const Pdo& pdo : transmit_)
    if (pdo.exists && pdo.event_driven() && pdo.sent_once) {
      if (pdo.timer_ns) at(pdo.last_ns + std::max(pdo.timer_ns, pdo.inhibit_ns));
      if (held_back_ && pdo.inhibit_ns) at(pdo.last_ns + pdo.inhibit_ns);
    }
  return next;
}

bool PdoService::any_synchronous_rpdo() const {
  return std::ranges::any_of(receive_, [](const Pdo& p) { return p.exists && p.synchronous(); });
}

PdoDelivery PdoService::delivery(std::uint16_t index, std::uint16_t or_index) {
  PdoDelivery found;
  for (Pdo& pdo : receive_) {
    if (!std::exchange(pdo.delivered, false)) continue;
    if (std::ranges::any_of(pdo.map, [&](const Object* o) { return o && (o->index == index || o->index == or_index); }))
      found = {true, pdo.synchronous() ? std::max<int>(1, pdo.type) : 0, pdo.timer_ns != 0};
  }
  return found;
}

}  // namespace tribotwin::hil
